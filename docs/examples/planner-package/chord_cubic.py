"""A planner in one file: a clamped cubic spline, its times in proportion to the way to go."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from trajopt import Planner, Problem, Solution, Status, Trajectory


@dataclass(frozen=True)
class ChordCubic(Planner):
    """A clamped cubic spline; each segment's time is its slowest joint's at full velocity.

    It knows nothing of accelerations: trajopt's verifier slows its answer to the limits.

    Attributes:
        spare: How many times as long as at full velocity each segment takes.
    """

    spare: float = 2.0

    def unsupported(self, problem: Problem) -> str | None:
        """A clamped spline starts with a jump of acceleration, which a jerk limit forbids."""
        return "its acceleration jumps at both ends" if problem.has("jerk") else None

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The spline through all waypoints, from rest to rest."""
        merged, index = problem.merged()  # a waypoint twice is one
        velocity = np.abs(merged.limits.velocity).min(axis=1)
        slowest = (np.abs(merged.displacements) / velocity).max(axis=1)
        times = self.spare * np.concatenate([[0.0], np.cumsum(slowest)])
        spline = CubicSpline(times, merged.waypoints, bc_type="clamped")
        trajectory = Trajectory(spline.x, spline.c, times[index])
        return Solution(Status.SOLVED, trajectory)
