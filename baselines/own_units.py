"""Moderate numbers for a solver with absolute tolerances: time and each joint in their own units.

The units belong to the motion and not to the file it came from: time counts in the time that the
longest segment takes from stop to stop, each joint in the distance between its extreme waypoints.
So degrees for radians, or milliseconds for seconds, give the solver the same numbers but for
rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import wraps
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from trajopt.problem import Limits, Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Units:
    """A unit of time, s, and one of length for each joint `(joints,)`, rad."""

    time: float
    lengths: Array

    def applied(self, problem: Problem) -> Problem:
        """The problem in these units."""
        length = self.lengths[:, None]
        own = problem.limits
        limits = Limits(
            velocity=own.velocity * self.time / length,
            acceleration=own.acceleration * self.time**2 / length,
            jerk=own.jerk * self.time**3 / length,
            position=own.position / length,
        )
        waypoints = problem.waypoints / self.lengths
        return Problem(
            waypoints,
            limits,
            problem.name,
            problem.source,
        )

    def restored(self, solution: Solution) -> Solution:
        """A solution in these units, in s and rad."""
        trajectory = solution.trajectory
        history = solution.history
        bound = solution.lower_bound
        if trajectory is not None:
            in_radians = trajectory.coefficients * self.lengths
            moved = Trajectory(trajectory.breaks, in_radians, trajectory.waypoint_times)
            trajectory = moved.dilated(self.time)
        if history is not None:
            history = history * [1.0, self.time]
        if bound is not None:
            bound = bound * self.time
        return replace(
            solution,
            trajectory=trajectory,
            history=history,
            lower_bound=bound,
        )


SolveT = TypeVar("SolveT", bound=Callable[..., Solution])


def in_own_units(solve: SolveT) -> SolveT:
    """Let a `solve` method see moderate numbers, and the problem's own where all those fail."""

    @wraps(solve)
    def rescaled_solve(self: object, problem: Problem, *, seed: int = 0) -> Solution:
        for units in candidates(problem):
            solution = solve(self, units.applied(problem), seed=seed)
            if solution.status is not Status.FAILED:
                return units.restored(solution)
        return solve(self, problem, seed=seed)

    return cast(SolveT, rescaled_solve)


def candidates(problem: Problem) -> Iterator[Units]:
    """Units to try in turn: time by the longest, the mean, and the briefest segment."""
    spans = np.ptp(problem.waypoints, axis=0)
    lengths = np.where(spans > 0, spans, 1.0)
    times = stop_times(problem)
    longest = times.max()
    mean = np.exp(np.log(times).mean())
    briefest = times.min()
    for time in (longest, mean, briefest):
        yield Units(float(time), lengths)
