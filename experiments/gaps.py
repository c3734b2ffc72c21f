"""Which gap to the best known motion does each planner leave, suite by suite?

    python -m experiments.gaps                       # every suite, an hour of one core
    python -m experiments.gaps --planner spline      # another planner, or some of them
    python -m experiments.gaps --quick               # six-axis alone

It runs the planners that `trajopt compare` runs by default, with their default options, on every
problem of a suite; but not `prove`, which answers with another planner's motion. Planners that
search at random run with `SEEDS` seeds. A gap is to the problem's best known motion. Where the
planners of a suite do not support the same problems, a second column pairs them: the gap of one
planner that supports most (the heading names it) on the problems of each line. The folder
`--output` keeps the trials, and a second run adds only what is missing. Its files `gaps.csv` and
`gaps.md` hold the table.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import save_table, say
from trajopt import compare
from trajopt.benchmark.suites import catalogue
from trajopt.cli import console
from trajopt.explain.references import PROOF
from trajopt.planners.registry import entries, load

SEEDS = 3
TIMEOUT = 120.0  # s, of a trial
PERCENT = 100


def planners() -> list[str]:
    """The names of those that run by default, and can run here."""
    here = [name for name, entry in entries().items() if entry.missing() is None]
    return [name for name in here if name != PROOF and not load(name).on_request]


def columns(suite: str, planners: pd.DataFrame) -> dict[str, pd.Series[str]]:
    """The column of a suite, and the one that pairs its lines where their problems differ.

    Args:
        suite: Its name.
        planners: The rows of `Results.planners()`.
    """
    rows = list(planners.itertuples())
    found = {suite: [cell(row) for row in rows]}
    if planners["there"].nunique() > 1:
        yardstick = planners["yardstick"].iloc[0]
        found[f"{suite}: {yardstick} there"] = [paired(row) for row in rows]
    return {name: pd.Series(cells, planners.index) for name, cells in found.items()}


def paired(row: Any) -> str:
    """Median gap of the yardstick on the problems of a line, in percent."""
    return "" if np.isnan(row.there) else f"{PERCENT * row.there:z.2f}"


def cell(row: Any) -> str:
    """Median gap and worst, in percent; and how many answers there are, where some are missing."""
    asked = row.trials - row.bounds
    if not asked:
        return ""
    if not row.solved:
        return f"0 of {asked}"
    text = f"{PERCENT * row.gap:z.2f} ({PERCENT * row.worst:z.2f})"
    if row.solved < asked:
        text += f"; {row.solved} of {asked}"
    return text


def main(
    *,
    suite: list[str] | None = None,
    planner: list[str] | None = None,
    output: Path = Path("gaps"),
    jobs: int = 2,
    quick: bool = False,
) -> None:
    """Run what is missing, then write and print the table.

    Args:
        suite: Names of suites; all if left out.
        planner: Names of planners; by default those that `planners` returns.
        output: The folder.
        jobs: Trials side by side.
        quick: The suite six-axis alone.
    """
    table: dict[str, pd.Series[str]] = {}
    names = planner or planners()
    if quick:
        suite = ["six-axis"]
    for name in suite or catalogue.suites():
        say(f"every planner on {name}")
        results = compare(
            list(catalogue.problems(name)),
            names,
            output,
            seeds=SEEDS,
            jobs=jobs,
            timeout=TIMEOUT,
            progress=console.progress_line(),
        )
        table |= columns(name, results.planners())
    wide = pd.DataFrame(table).reindex(names).rename_axis("planner").fillna("")
    save_table(wide, output / "gaps")
    print(wide.to_string())


if __name__ == "__main__":
    cyclopts.run(main)
