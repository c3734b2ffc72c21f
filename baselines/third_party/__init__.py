"""Other people's planners, one file each, used as their documentation has it.

Each is an extra of this package (`pip install "trajopt[rivals]"` for all), runs on request, and is
judged as every other planner is.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import wraps
from typing import Any, cast

import numpy as np

from trajopt import polynomials
from trajopt.planner import SolveT, backend
from trajopt.problem import Limits, Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution
from trajopt.trajectory import Trajectory


def imported(name: str, extra: str) -> tuple[Any, float]:
    """A module, and the seconds that importing it took, which are setup and not solving.

    Raises:
        MissingBackend: It is not installed; the message names the extra.
    """
    began = time.perf_counter()
    module = backend(name, extra)
    return module, time.perf_counter() - began


def in_own_units(solve: SolveT) -> SolveT:
    """Let a `solve` method see lengths and times near 1, whatever units the problem has.

    Others' solvers have absolute tolerances. The unit of time is that of stopping at every
    waypoint, the unit of length the largest displacement of all joints. Numbers among `stats` are
    durations.
    """

    @wraps(solve)
    def measured_solve(self: Any, problem: Problem, *, seed: int = 0) -> Solution:
        second = float(stop_times(problem).sum())
        length = float(np.abs(problem.displacements).max())
        solution = solve(self, _in_units(problem, length, second), seed=seed)
        stats = {}
        for key, value in solution.stats.items():
            if isinstance(value, float):
                value *= second
            stats[key] = value
        own = solution.trajectory
        if own is None:
            return replace(solution, stats=stats)
        by_second = polynomials.stretched(own.coefficients, 1 / second)
        trajectory = Trajectory(
            breaks=own.breaks * second,
            coefficients=by_second * length,
            waypoint_times=own.waypoint_times * second,
        )
        return replace(solution, trajectory=trajectory, stats=stats)

    return cast(SolveT, measured_solve)


def _in_units(problem: Problem, length: float, second: float) -> Problem:
    """The problem with lengths counted in `length`, rad, and times in `second`, s."""
    rate = second / length
    limits = Limits(
        velocity=problem.limits.velocity * rate,
        acceleration=problem.limits.acceleration * rate * second,
        jerk=problem.limits.jerk * rate * second**2,
        position=problem.limits.position / length,
    )
    return replace(problem, waypoints=problem.waypoints / length, limits=limits)
