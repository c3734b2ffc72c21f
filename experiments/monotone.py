"""Is `exact-jerk` beaten where one joint moves one way through many waypoints?

    python -m experiments.monotone                    # 300 problems, a quarter of an hour on a core
    python -m experiments.monotone --problems 20      # a quick look

Six to ten waypoints, some segments a millionth of the others, limits up to 100:1 apart, one in four
asymmetric. A joint that moves one way passes waypoints without losing time, so the optimum is
Ruckig's from the first waypoint to the last: an answer from another program. Reported: how often
and by how much it is better, and what the planner's answers cost.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import cyclopts
import numpy as np
import pandas as pd

from baselines.exact.jerk import ExactJerk
from baselines.ruckig_ import RuckigStop
from trajopt import Problem, Solution, verify
from trajopt.benchmark.suites.random import random_problem

BEATEN = (1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # relative


def drawn(seed: int) -> Problem:
    """A random problem whose joint moves one way, under symmetric jerk limits."""
    rng = np.random.default_rng([17, seed])
    problem = random_problem(
        seed,
        joints=1,
        waypoints=int(rng.integers(6, 11)),
        jerk=True,
    )
    lengths = np.abs(problem.displacements)
    passed = np.cumsum(lengths, axis=0)
    waypoints = np.vstack([[0.0], passed])
    return Problem(waypoints, problem.limits)


def at_once(problem: Problem) -> Problem:
    """From the first waypoint to the last."""
    ends = problem.waypoints[[0, -1]]
    return Problem(ends, problem.limits)


def reference(problem: Problem) -> float:
    """The optimum, s."""
    solution = RuckigStop().solve(at_once(problem))
    if solution.trajectory is None:
        return np.inf
    return solution.trajectory.duration


def rows(problems: int, starts: int) -> Iterator[dict[str, float]]:
    """One row a problem: excess over the reference (infinite without an answer), seconds."""
    for seed in range(problems):
        problem = drawn(seed)
        if not problem.moving.any():
            continue
        began = time.perf_counter()
        solution = ExactJerk(starts).solve(problem)
        seconds = time.perf_counter() - began - solution.setup_time
        excess = excess_of(problem, solution)
        if excess > BEATEN[0]:
            print(f"problem {seed}: {excess:.1e}", flush=True)
        yield {
            "problem": seed,
            "excess": excess,
            "seconds": seconds,
        }


def excess_of(problem: Problem, solution: Solution) -> float:
    """Relative excess of the certified duration over the reference; infinite without one."""
    if solution.trajectory is None:
        return np.inf
    certified = verify(problem, solution.trajectory).certified_duration
    if certified is None:
        return np.inf
    return certified / reference(problem) - 1


def main(problems: int = 300, starts: int = 4) -> None:
    """Solve, compare, and print how often the reference is better by how much."""
    frame = pd.DataFrame(rows(problems, starts))
    excess = frame["excess"]
    for threshold in BEATEN:
        beaten = excess > threshold
        print(f"beaten by more than {threshold:.0e}: {beaten.sum()} of {len(frame)}")
    print(f"excess: {excess.min():.1e} to {excess.max():.1e}")
    seconds = frame["seconds"]
    print(f"seconds: median {seconds.median():.2f}, mean {seconds.mean():.2f}")


if __name__ == "__main__":
    cyclopts.run(main)
