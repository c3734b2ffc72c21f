"""Measure other people's planners against the optimum: as documented, and with equal effort.

    python -m experiments.rivals            # 44 problems, half an hour of CPU
    python -m experiments.rivals six-axis   # one of them

Every rival runs twice on the six-axis problem, `jerk-limit` and the 42 problems of eleven arms: as
its authors' example has it (one try), and with the effort that each of them gets, the best of
twelve settings (`baselines/third_party`). What is certified stands beside the best known motion.
Written to `--output`: `trials.csv`, to which a second run adds only what is missing, and the table
`rivals`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cyclopts
import pandas as pd

from experiments.common.kept import kept
from experiments.common.output import save_table
from experiments.families import cell, certified
from trajopt import Problem
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import entries, load

# By planner: as its authors' example has it, and with the effort of all.
RIVALS = {
    "toppra": ("toppra:knots=uniform,ends=not-a-knot", "toppra"),
    "copp": ("copp:tries=1", "copp"),
    "drake-toppra": ("drake-toppra:tries=1", "drake-toppra"),
    "drake-kto": ("drake-kto:tries=1", "drake-kto"),
    "totg": ("totg:tries=1", "totg"),
    "minsnap": ("minsnap:tries=1", "minsnap"),
    "ruckig-search": ("ruckig-stop", "ruckig-search"),
}
MODES = ("documented", "effort")
GROUPS = ("six-axis", "jerk-limit", "4 waypoints", "8 waypoints", "16 waypoints", "jerk limits")


def problems() -> Iterator[tuple[str, Problem]]:
    """Every problem with its group."""
    for name in ("six-axis", "jerk-limit"):
        yield name, catalogue.load(name)
    for problem in catalogue.problems("robots"):
        group = f"{len(problem.waypoints)} waypoints"
        if problem.has("jerk"):
            group = "jerk limits"
        yield group, problem


def trials(problem: Problem) -> list[dict[str, Any]]:
    """Every rival that knows the problem's kinds of limits and is installed, both ways."""
    best = certified(problem, records.answer(problem))
    rows = []
    for planner, specs in RIVALS.items():
        if entries()[planner].missing() is not None:
            continue
        for mode, spec in zip(MODES, specs, strict=True):
            rival = load(spec)
            if rival.unsupported(problem) is not None:
                continue
            began = time.process_time()
            solution = rival.solve(problem)
            row = {
                "planner": planner,
                "mode": mode,
                "seconds": certified(problem, solution),
                "best known": best,
                "answer": solution.stats.get("spline", solution.message),
                "cpu": time.process_time() - began,
            }
            rows.append(row)
    return rows


def gaps(table: pd.DataFrame) -> pd.DataFrame:
    """Median gap in percent, lowest, highest and how many are solved, by planner and mode."""
    gap = 100 * (table["seconds"] / table["best known"] - 1)
    grouped = gap.groupby([table["planner"], table["mode"], table["group"]])
    cells = grouped.agg(["median", "min", "max", "count", "size"])
    texts = [cell(row) for row in cells.itertuples(index=False)]
    wide = pd.Series(texts, index=cells.index).unstack("group")
    rows = [(planner, mode) for planner in RIVALS for mode in MODES]
    known = [row for row in rows if row in wide.index]
    return wide.loc[known, [group for group in GROUPS if group in wide.columns]].fillna("–")


def main(*problem: str, output: Path = Path("results/rivals")) -> None:
    """Run what is missing, then write and print the table.

    Args:
        problem: Names of problems; all 44 if none is given.
        output: The folder.
    """
    cells = {}
    for group, own in problems():
        if not problem or own.name in problem:
            cells[group, own.name] = partial(trials, own)
    table = gaps(kept(output / "trials.csv", ["group", "problem"], cells))
    save_table(table, output / "rivals")
    print(table.to_string())


if __name__ == "__main__":
    cyclopts.run(main)
