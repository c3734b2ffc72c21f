"""Compare the best members of families of trajectories with the optimum.

    python -m experiments.families                # 50 random problems, fifteen CPU minutes
    python -m experiments.families --quick        # 4 random problems

The best trajectory of each family beside the optimum under the same limits, on the six-axis
problem, the published problems, the arms' four-waypoint problems and random four-waypoint problems,
those with and those without jerk limits apart. Position limits are lifted: most families know none.

The folder `--output` keeps the trials, and a second run adds only what is missing. Its files
`families.csv` and `families.md` hold the table.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cyclopts

from experiments.common.output import save_table
from experiments.common.spread import compared, spread
from trajopt import Problem
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.suites.random import random_problem

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


def main(*, random: int = 50, output: Path = Path("families"), quick: bool = False) -> None:
    """Run what is missing, then write and print the table.

    Args:
        random: How many random problems.
        output: The folder.
        quick: Four random problems at most.
    """
    if quick:
        random = min(random, 4)
    trials = compared(problems(random), FAMILIES.items(), output)
    table = spread(trials, ["jerk", "planner"]).reindex(list(FAMILIES), level="planner")
    by_family = table[[group for group in GROUPS if group in table]]
    save_table(by_family, output / "families")
    print(by_family.to_string())


if __name__ == "__main__":
    cyclopts.run(main)
