"""Moderate numbers for a solver with absolute tolerances: time and each joint in their own units.

Units are powers of two, so that nothing is rounded, and 1 where numbers are moderate already.
"""

from __future__ import annotations

from dataclasses import replace
from functools import wraps
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajopt.problem import Limits, Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

_MODERATE = 10.0  # powers of two, up or down


def in_own_units(solve: Any) -> Any:
    """Let a `solve` method see moderate numbers first, and the problem's own where that fails."""

    @wraps(solve)
    def rescaled_solve(self: Any, problem: Problem, *, seed: int = 0) -> Solution:
        time, joints = units(problem)
        if time != 1 or (joints != 1).any():
            found = solve(self, _rescaled(problem, time, joints), seed=seed)
            if found.status is not Status.FAILED:
                return _restored(found, time, joints)
        return solve(self, problem, seed=seed)  # type: ignore[no-any-return]

    return rescaled_solve


def units(problem: Problem) -> tuple[float, Array]:
    """Units of time, s, and of each joint, rad, from the longest segment and the joints' spans."""
    return float(_unit(stop_times(problem).max())), _unit(np.ptp(problem.waypoints, axis=0))


def _unit(size: ArrayLike) -> Array:
    power = np.round(np.log2(np.where(np.asarray(size) > 0, size, 1.0)))
    return np.asarray(np.where(np.abs(power) > _MODERATE, 2.0**power, 1.0))


def _rescaled(problem: Problem, time: float, joints: Array) -> Problem:
    own, side = problem.limits, joints[:, None]
    limits = Limits(
        own.velocity * time / side, own.acceleration * time**2 / side, own.jerk * time**3 / side,
        own.position / side,
    )  # fmt: skip
    return Problem(problem.waypoints / joints, limits, problem.name, problem.source)


def _restored(solution: Solution, time: float, joints: Array) -> Solution:
    t, history, bound = solution.trajectory, solution.history, solution.lower_bound
    if t is not None:
        moved = Trajectory(t.breaks, t.coefficients * joints, t.waypoint_times)
        solution = replace(solution, trajectory=moved.dilated(time))
    return replace(
        solution,
        history=None if history is None else history * [1.0, time],
        lower_bound=None if bound is None else bound * time,
    )
