"""Every planner on every suite: who solves what, how far from optimal, and at what cost?

    python -m experiments.sweep            # 7500 trials, about two hours on two cores
    python -m experiments.sweep --quick    # two problems of each suite, two seeds: three minutes

It can be stopped and started again. Into `--output` go the results, `report.html`, `sweep.csv`
and `.md` (one line per planner), `suites.csv` and `.md` (one per suite and planner), `files.csv`
and `.md` (their sizes).
"""

from __future__ import annotations

from pathlib import Path

import cyclopts
import pandas as pd

from experiments.common.output import save_table
from trajopt import Problem
from trajopt.benchmark import compare as run
from trajopt.benchmark import report
from trajopt.benchmark.analysis.overview import overview
from trajopt.benchmark.suites import catalogue as suite
from trajopt.cli import console
from trajopt.registry import entries

SUITES = ("six-axis", "edges", "robots", "random")
PROOF = "certify:time_limit=15"  # s; a proof on a large problem is endless
MENDED = [f"{name}:fitness=scaled" for name in ("pso", "ssa", "issa")]  # the paper's, mended


def drawn(size: int | None = None) -> dict[str, list[Problem]]:
    """Per suite, a random family each for itself, its problems, or the first `size` of them."""
    families = [name for name in suite.suites() if name.startswith("random-")]
    return {name: suite.problems(name, size) for name in (*SUITES[:-1], *families)}


def planners() -> list[str]:
    """Every registered planner, those that wait to be asked for too, and the mended swarms."""
    return [PROOF if name == "certify" else name for name in entries()] + MENDED


def sizes(folder: Path, trials: int) -> pd.DataFrame:
    """Size of what there is on the disk, MB, and KB per trial."""
    files = {name: [folder / name] for name in ("results.h5", "report.html")}
    files["trials/"] = list((folder / "trials").glob("*.h5"))
    total = {name: sum(f.stat().st_size for f in own) for name, own in files.items()}
    rows = [(name, len(files[name]), n / 1e6, n / 1e3 / trials) for name, n in total.items()]
    return pd.DataFrame(rows, columns=["what", "files", "MB", "KB per trial"])


def main(
    *,
    seeds: int = 30,
    jobs: int = 2,
    timeout: float = 45.0,
    quick: bool = False,
    output: Path = Path("results/sweep"),
) -> None:
    """Run what is missing, then write and print the tables."""
    found, seeds = drawn(2 if quick else None), 2 if quick else seeds
    problems = [problem for own in found.values() for problem in own]
    with console.trials() as advance:
        results = run.compare(
            problems, planners(), output, seeds=seeds, jobs=jobs, timeout=timeout, progress=advance
        )
    report.write(results, output / "report.html", command="python -m experiments.sweep")
    suite_of = {problem.name: name for name, own in found.items() for problem in own}
    tables = {
        "sweep": overview(results),
        "suites": overview(results, by=suite_of.__getitem__),
        "files": sizes(output, len(results.items)),
    }
    for name, table in tables.items():
        save_table(table, output / name)
        print(table.to_string(float_format="{:.4g}".format), end="\n\n")


if __name__ == "__main__":
    cyclopts.run(main)
