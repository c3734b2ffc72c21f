"""What do planners answer on each other's tests?

    python -m experiments.rivals_own    # 31 problems, five minutes of CPU
    python -m experiments.rivals_own --quick    # three of them

The suite `rivals-own` has the inputs of the test suites of toppra, Ruckig and MoveIt. Every planner
that is installed runs on each, the packages' own and other authors' as they run by default
(`baselines/third_party`). A cell is the certified duration above the best known one in percent, or
why there is none: – where the planner knows not what the problem asks for, `fails` where it finds
no motion, `invalid` where its motion cannot be slowed down into the limits.

The folder `--output` keeps the trials, and a second run adds only what is missing. Its files
`rivals-own.csv` and `rivals-own.md` hold the table.
"""

from __future__ import annotations

from pathlib import Path

import cyclopts
import pandas as pd

from experiments.common.output import save_table
from trajopt import compare
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue, rivals_own
from trajopt.cli import console
from trajopt.planners.registry import entries

PLANNERS = (
    "toppra",
    "ruckig-stop",
    "ruckig-search",
    "totg",
    "totg-ruckig",
    "iterative-spline",
    "copp",
    "drake-kto",
    "minsnap",
)
QUICK = ("toppra-algorithm", "ruckig-single-joint", "moveit-corner")
_WORDS = {"unsupported": "–", "failed": "fails", "invalid": "invalid"}
# Gaps below it are the solvers' tolerances.
_ROUNDING = 5e-5


def cell(status: str, gap: float) -> str:
    """Return the gap in percent, or why there is none."""
    if status == "solved":
        return f"{100 * max(gap, 0) if gap > -_ROUNDING else 100 * gap:.1f}"
    return _WORDS.get(status, status)


def main(*, output: Path = Path("results/rivals-own"), quick: bool = False) -> None:
    """Run what is missing, then write and print the table.

    Args:
        output: The folder.
        quick: Three problems, one of each package.
    """
    problems = catalogue.problems("rivals-own")
    prefix = "rivals-own-"
    if quick:
        problems = [own for own in problems if own.name.removeprefix(prefix) in QUICK]
    planners = [name for name in PLANNERS if entries()[name].missing() is None]
    results = compare(problems, planners, output, jobs=2, progress=console.progress_line())
    trials = results.gaps()
    expected = rivals_own.expected()
    rows = []
    for problem in problems:
        own = trials[trials["digest"] == problem.digest()].set_index("planner")
        best = records.find(problem)
        row: dict[str, str | float | None] = {
            "test": problem.name.removeprefix(prefix),
            "it expects, s": expected.get(problem.name),
            "best known, s": best.duration if best is not None else None,
        }
        for name in planners:
            row[name] = cell(*own.loc[name, ["status", "gap"]])
        rows.append(row)
    table = pd.DataFrame(rows)
    save_table(table, output / "rivals-own")
    print(table.to_string(index=False))


if __name__ == "__main__":
    cyclopts.run(main)
