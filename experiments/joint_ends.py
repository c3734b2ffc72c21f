"""What does a constant velocity cost near the ends of a Franka FR3's joints?

    python -m experiments.joint_ends            # six problems, a minute
    python -m experiments.joint_ends --quick    # those of four waypoints

The arm's velocity limits fall near the ends of its joints' ranges, and neither Ruckig nor TOPP-RA
knows such a limit. Their users choose one velocity limit that is safe at every waypoint: the one
allowed at the waypoint nearest to each end. Between waypoints a path may come nearer; the motion
then breaks the limit and is dilated. The optimum without the limit is dilated too. Percentages are
above the best known motion.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import progress, save_table
from trajopt import Problem, verify
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue
from trajopt.core.limits import FallingVelocity
from trajopt.planners.registry import load

PROBLEMS = tuple(
    f"robots-franka-fr3-w{count}{jerk}" for count in (4, 8, 16) for jerk in ("", "-jerk")
)
CONSTANT = {
    "Ruckig, stops": "ruckig-stop",
    "Ruckig, searched": "ruckig-search",
    "TOPP-RA": "toppra",
}


def with_constant_velocity(problem: Problem) -> Problem:
    """Return the problem with one velocity limit, which is allowed at every waypoint."""
    own = problem.limits.kinds[FallingVelocity.key]
    offset, deceleration, low, high = own.numbers.T
    distances = np.array([problem.waypoints - low, high - problem.waypoints]).min(axis=1)
    allowed = np.sqrt(2 * deceleration * distances) - offset
    given = np.abs(problem.limits.velocity).T
    down, up = np.fmin(given, allowed)
    limits = problem.limits.without(FallingVelocity.key)
    return replace(problem, limits=replace(limits, velocity=np.column_stack([-down, up])))


def above(problem: Problem, asked: Problem, planner: str, best: float) -> float:
    """Return how far a planner's certified duration is above the best, percent; NaN without one."""
    motion = load(planner).solve(asked).trajectory
    found = None if motion is None else verify(problem, motion).certified_duration
    return np.nan if found is None else 100 * (found / best - 1)


def row(name: str) -> dict[str, object]:
    """Return the row of one problem."""
    problem = catalogue.load(name)
    record = records.find(problem)
    if record is None:
        raise LookupError(name)
    free = "exact-jerk" if problem.has("jerk") else "exact"
    constant = with_constant_velocity(problem)
    return {
        "problem": name,
        "best known, s": record.duration,
        "proved within, %": 100 * record.proved_within,
        "optimum without the limit, slowed down, %": above(problem, problem, free, record.duration),
        **{
            f"{words}, %": above(problem, constant, planner, record.duration)
            for words, planner in CONSTANT.items()
        },
    }


def main(output: Path = Path("results/joint-ends"), quick: bool = False) -> None:
    """Plan every problem in each way, or the first two if `quick`; print the table."""
    names = PROBLEMS[:2] if quick else PROBLEMS
    rows = []
    with progress(len(names), "problems") as advance:
        for name in names:
            rows.append(row(name))
            advance(1)
    table = pd.DataFrame(rows)
    print(table.to_string(index=False))
    save_table(table, output / "joint-ends")


if __name__ == "__main__":
    cyclopts.run(main)
