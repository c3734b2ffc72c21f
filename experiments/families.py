"""Compare the best members of families of trajectories with the optimum.

    python -m experiments.families                # 50 random problems, fifteen CPU minutes
    python -m experiments.families --random 4     # a quick look

The best trajectory of each family beside the optimum under the same limits, on the six-axis
problem, the published problems, the arms' four-waypoint problems and random four-waypoint problems,
those with and those without jerk limits apart. Position limits are lifted: most families know none.
Written to `--output`: `trials.csv`, to which a second run adds only what is missing, and the table
`families`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt import Problem, Solution, Status, verify
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.suites.random import random_problem
from trajopt.explain.references import Answer
from trajopt.planners.registry import load

# Two starts, and the exchange until limits are kept to about 1e-5.
EFFORT = "starts=2,rounds=6"
FAMILIES = {
    "3-5-3": "spline353-nlp:starts=2",
    "4-3-4": f"spline:shape=4-3-4,{EFFORT}",
    "cubic": f"spline:degree=3,{EFFORT}",
    "quintic, 5-5-5": f"spline:degree=5,{EFFORT}",
    "septic, 7-7-7": f"spline:degree=7,{EFFORT}",
    "trapezoids, stopping": "ruckig-stop",
    "trapezoids, through the waypoints": "ruckig-search:evaluations=600",
}
GROUPS = ("six-axis", "published", "robots", "random")
PERCENT = 100


def problems(random: int) -> Iterator[tuple[str, Problem]]:
    """Every problem with its group, position limits lifted."""
    yield "six-axis", catalogue.load("six-axis")
    for problem in catalogue.problems("literature"):
        yield "published", problem.without("position")
    for problem in catalogue.problems("robots"):
        if problem.segments == 3:
            yield "robots", problem.without("position")
    for seed in range(random):
        with_jerk = seed % 2 == 1
        yield "random", random_problem(seed, waypoints=4, jerk=with_jerk)


def certified(problem: Problem, solution: Solution | Answer) -> float:
    """Certified duration, s; NaN without one."""
    if solution.trajectory is None:
        return np.nan
    duration = verify(problem, solution.trajectory).certified_duration
    return np.nan if duration is None else duration


def trials(problem: Problem) -> list[dict[str, Any]]:
    """Every family on one problem."""
    jerk = problem.has("jerk")
    reference = "exact:starts=3"
    if jerk:
        reference = "exact-jerk:starts=2"
    optimum = certified(problem, load(reference).solve(problem))
    rows = []
    for family, spec in FAMILIES.items():
        solution = load(spec).solve(problem)
        row = {
            "jerk": jerk,
            "family": family,
            "status": str(solution.status),
            "seconds": certified(problem, solution),
            "optimum": optimum,
        }
        rows.append(row)
    return rows


def gaps(table: pd.DataFrame) -> pd.DataFrame:
    """Median gap in percent, lowest and highest, by family, jerk limits and group."""
    known = table[table["status"] != str(Status.UNSUPPORTED)].dropna(subset=["optimum"])
    gap = PERCENT * (known["seconds"] / known["optimum"] - 1)
    by = [known["jerk"], known["family"], known["group"]]
    grouped = gap.groupby(by)
    cells = grouped.agg(["median", "min", "max", "count", "size"])
    texts = [cell(row) for row in cells.itertuples(index=False)]
    wide = pd.Series(texts, index=cells.index).unstack("group")
    order = [family for family in FAMILIES if family in known["family"].unique()]
    groups = [group for group in GROUPS if group in wide.columns]
    return wide.reindex(order, level="family")[groups]


def cell(row: Any) -> str:
    """Median, lowest and highest; and how many have an answer, where some have none."""
    if row.count == 0:
        return f"none of {row.size}"
    median = f"{row.median:z.1f}"
    if row.size == 1:
        return median
    solved = f"{row.count}"
    if row.count < row.size:
        solved = f"{row.count} of {row.size}"
    return f"{median} ({row.min:z.1f} to {row.max:z.1f}; {solved})"


def main(*, random: int = 50, output: Path = Path("families")) -> None:
    """Run what is missing, then write and print the table.

    Args:
        random: How many random problems.
        output: The folder.
    """
    cells = {}
    for group, problem in problems(random):
        cells[group, problem.name] = partial(trials, problem)
    table = kept(output / "trials.csv", ["group", "problem"], cells)
    by_family = gaps(table)
    save_table(by_family, output / "families")
    print(by_family.to_string())


if __name__ == "__main__":
    cyclopts.run(main)
