"""Every planner on every suite: who solves what, how far from optimal, and at what cost?

    python -m experiments.sweep            # some 10,000 trials, about two hours on two cores
    python -m experiments.sweep --quick    # two problems of each suite, two seeds: three minutes
    python -m experiments.sweep --stored   # the tables anew, of the trials that are there

It can be stopped and started again; `--planner` runs only those named. Other people's planners
have a comparison of their own (`trajopt compare --planner copp …`). Into `--output` go the
results, `report.html`, `sweep.csv` and `.md` (one line per planner), `suites.csv` and `.md` (one
per suite and planner), `files.csv` and `.md` (their sizes). `proved` counts the problems whose
reference is the optimum but for 0.1 %, by this run's proofs or by those of the best known answers:
after better proofs were recorded (`trajopt best-known propose`), `--stored` counts again.
"""

from __future__ import annotations

from pathlib import Path

import cyclopts
import pandas as pd

from experiments.common.output import save_table
from trajopt import Problem
from trajopt import comparison as run
from trajopt.benchmark.suites import catalogue as suite
from trajopt.cli import console
from trajopt.planners.registry import entries
from trajopt.views import report
from trajopt.views.analysis.overview import overview
from trajopt.views.analysis.results import Results

SUITES = ("six-axis", "edges", "robots", "literature")
PROOF = "certify:time_limit=15"  # s; a proof on a large problem is endless
MENDED = [f"{name}:fitness=scaled" for name in ("pso", "ssa", "issa")]  # the paper's, mended


def drawn(size: int | None = None) -> dict[str, list[Problem]]:
    """Per suite, a random family each for itself, its problems, or the first `size` of them."""
    names = [*SUITES]
    names += [name for name in suite.suites() if name.startswith("random-")]
    return {name: suite.problems(name, size) for name in names}


def planners() -> list[str]:
    """Every planner of ours, those that wait to be asked for too, and the mended swarms."""
    found = entries().items()
    names = [name for name, entry in found if "third_party" not in entry.point.module]
    place = names.index("certify")
    names[place] = PROOF
    return names + MENDED


def sizes(folder: Path, trials: int) -> pd.DataFrame:
    """Size of what there is on the disk, MB, and KB per trial."""
    files = {
        "results.h5": [folder / "results.h5"],
        "report.html": [folder / "report.html"],
        "trials/": list(folder.glob("trials/*.json")),
    }
    rows = []
    for name, own in files.items():
        size = sum(file.stat().st_size for file in own)
        row = {
            "what": name,
            "files": len(own),
            "MB": size / 1e6,
            "KB per trial": size / 1e3 / trials,
        }
        rows.append(row)
    return pd.DataFrame(rows)


def main(
    *,
    seeds: int = 30,
    jobs: int = 2,
    timeout: float = 45.0,
    quick: bool = False,
    stored: bool = False,
    planner: list[str] | None = None,
    output: Path = Path("results/sweep"),
) -> None:
    """Run what is missing, then write and print the tables."""
    size = None
    if quick and not stored:
        size = 2
        seeds = 2
    problems: list[Problem] = []
    suite_of = {}
    for name, own in drawn(size).items():
        problems += own
        for problem in own:
            suite_of[problem.name] = name
    if stored:
        results = Results(output)
    else:
        with console.trials() as advance:
            results = run.compare(
                problems,
                planner or planners(),
                output,
                seeds=seeds,
                jobs=jobs,
                timeout=timeout,
                progress=advance,
            )
    page = output / "report.html"
    report.write(results, page, command="python -m experiments.sweep")
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
