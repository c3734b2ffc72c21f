"""How far above the optimum are answers to problems with tiny steps, and how long do they take?

    python -m experiments.tiny_steps            # 288 problems, a minute
    python -m experiments.tiny_steps --quick    # one joint and one jerk limit

Each problem is a straight line of 1 rad whose optimum is known in closed form, with tiny steps at a
third and in the middle of the line, at its start or at its end. There are one joint or three on a
line, and jerk limits of 1, 10 and 100 times the acceleration limits. A cell is the worst of 24
certified durations over the optimum, minus 1. The last columns are the worst of `exact` without
jerk limits, and the longest CPU time.
"""

from __future__ import annotations

import itertools
import time
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from experiments.common.output import save_table
from trajopt import Limits, Problem, verify
from trajopt.planners.rest_to_rest import end_to_end_bound

SIZES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)  # size of a step, relative to the line
COUNTS = (1, 2, 4, 8)
PLACES = ("third", "middle", "start", "end")
STIFFNESSES = (1.0, 10.0, 100.0)  # jerk over acceleration, 1/s
SCALES = np.array([1.0, 0.7, -0.4])  # displacements of the joints, relative to the first


def straight(size: float, count: int, place: str, joints: int, stiffness: float) -> Problem:
    """From 0 to 1 rad, with so many steps of this size (rad)."""
    steps = size * np.arange(count + 1)
    firsts = {"third": 1 / 3, "middle": 0.5, "start": 0.0, "end": 1.0 - steps[-1]}
    line = np.unique([0.0, *(firsts[place] + steps), 1.0])
    ones = np.ones(joints)
    jerk = stiffness * ones if np.isfinite(stiffness) else None
    limits = Limits(2 * ones, ones, jerk=jerk)
    return Problem(line[:, None] * SCALES[:joints], limits)


def above(problem: Problem) -> tuple[float, float]:
    """How far the certified duration is above the optimum, relative, and the CPU time, s."""
    began = time.process_time()
    planner = ExactJerk() if problem.has("jerk") else Exact()
    trajectory = planner.solve(problem).trajectory
    spent = time.process_time() - began
    if trajectory is None:
        return np.inf, spent
    duration = verify(problem, trajectory).certified_duration or np.inf
    return duration / end_to_end_bound(problem) - 1, spent


def worst(
    size: float, count: int, joints: tuple[int, ...], stiffnesses: tuple[float, ...]
) -> tuple[float, float]:
    """The worst of all places, joints and stiffnesses, and the longest CPU time, s."""
    cases = itertools.product(PLACES, joints, stiffnesses)
    found = [above(straight(size, count, *case)) for case in cases]
    late, spent = np.max(found, axis=0)
    return float(late), float(spent)


def main(
    joints: tuple[int, ...] = (1, 3),
    stiffnesses: tuple[float, ...] = STIFFNESSES,
    output: Path = Path("results/tiny-steps"),
    quick: bool = False,
) -> None:
    """Solve every problem, or those of one joint and one jerk limit if `quick`; print the table."""
    if quick:
        joints, stiffnesses = joints[:1], stiffnesses[:1]
    rows = []
    for size in SIZES:
        row: dict[str, object] = {"step over way": size}
        longest = 0.0
        for count in COUNTS:
            late, spent = worst(size, count, joints, stiffnesses)
            row[f"{count} steps"] = late
            longest = max(longest, spent)
        late, spent = worst(size, COUNTS[-1], joints, (np.inf,))
        row["8 steps, no jerk limit"] = late
        row["longest, CPU s"] = max(longest, spent)
        rows.append(row)
        print(row, flush=True)
    save_table(pd.DataFrame(rows), output / "tiny-steps")


if __name__ == "__main__":
    cyclopts.run(main)
