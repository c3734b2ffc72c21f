"""Families of splines as functions of their segment times alone: what swarms are given to search.

A candidate is a point of the unit cube, mapped linearly to segment times. Its fitness is its
duration once dilated to the limits (docs/mathematics.md, section 2), from exact peaks, so that no
candidate breaks a limit and the verifier certifies what the search claims.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from trajopt.core import polynomials
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners import spline353
from trajopt.planners.rest_to_rest import stop_times

Array = NDArray[np.float64]
FamilyName = Literal["3-5-3", "quintic B-spline"]

# Of the longest stop-to-stop time of any segment.
_LONGEST = 4.0
_SHORTEST = 0.02


@dataclass(frozen=True, eq=False)
class SplineTimes:
    """A family of splines through a problem's waypoints, shared by all joints.

    Attributes:
        problem: without position limits, which no dilation mends.
        family: `3-5-3`, or the quintic B-spline through the waypoints with its knots at them, four
            times continuously differentiable, without velocity and acceleration at both ends.
    """

    problem: Problem
    family: FamilyName

    @property
    def dimension(self) -> int:
        return self.problem.segments

    @cached_property
    def scale(self) -> float:
        """What a coordinate of 1 means, s."""
        longest = stop_times(self.problem).max()
        return _LONGEST * float(longest)

    def seconds(self, x: Array) -> Array:
        """Segment times of points of the unit cube, s."""
        shortest = _SHORTEST / _LONGEST
        inside = np.clip(x, 0.0, 1.0)
        return self.scale * (shortest + (1 - shortest) * inside)

    def coordinates(self, times: Array) -> Array:
        """The points of the unit cube of these segment times, s."""
        shortest = _SHORTEST / _LONGEST
        return (times / self.scale - shortest) / (1 - shortest)

    def trajectory(self, x: Array) -> Trajectory:
        """The candidate, not dilated."""
        times = self.seconds(x)
        if self.family == "3-5-3":
            return spline353.trajectory(self.problem, times)
        passed = np.concatenate([[0.0], np.cumsum(times)])
        still = np.zeros(self.problem.joints)
        at_rest = [(1, still), (2, still)]
        spline = make_interp_spline(
            passed,
            self.problem.waypoints,
            k=5,
            bc_type=(at_rest, at_rest),
            check_finite=False,
        )
        return Trajectory.from_spline(spline, waypoint_times=passed)

    def fitness(self, x: Array) -> float:
        """Duration of one candidate once dilated to the limits, s."""
        if self.family == "3-5-3":
            return self._fitness_353(x)
        trajectory = self.trajectory(x)
        dilation = 0.0
        for order, bounds in enumerate(self._bounds, start=1):
            use = _peak_use(trajectory.pieces(order), bounds)
            dilation = max(dilation, use ** (1 / order))
        return dilation * trajectory.duration

    def _fitness_353(self, x: Array) -> float:
        """The same, every peak in closed form."""
        times = self.seconds(x)
        displacements = self.problem.displacements.T
        use = spline353.limit_use(displacements, times, self.problem.limits)
        dilation = spline353.cheapest_dilation(*use)
        return float(dilation.max() * times.sum())

    def fitness_of_runs(self, x: Array) -> Array:
        """The same for candidates `(runs, m, dimension)`: `(runs, m)`."""
        flat = x.reshape(-1, self.dimension)
        values = np.array([self.fitness(candidate) for candidate in flat])
        return values.reshape(x.shape[:2])

    @cached_property
    def _bounds(self) -> list[Array]:
        """Velocity, acceleration and, where there are any, jerk limits, `(joints, 2)`."""
        limits = self.problem.limits
        bounds = [limits.velocity, limits.acceleration]
        if self.problem.has("jerk"):
            bounds.append(limits.jerk)
        return bounds


def _peak_use(pieces: Array, bounds: Array) -> float:
    """The largest value over its limit of polynomials on the unit interval.

    Args:
        pieces: coefficients `(degree + 1, pieces, joints)`.
        bounds: `(joints, 2)`.
    """
    flat = pieces.reshape(len(pieces), -1)
    at = _extremes(flat)
    values = polynomials.evaluate(flat[:, None], at)
    by_joint = values.reshape(len(at), *pieces.shape[1:])
    low, high = bounds.T
    use = np.maximum(by_joint / high, by_joint / low)
    return float(use.max())


def _extremes(coefficients: Array) -> Array:
    """Both ends and, in closed form, where the derivative of degree 1 to 3 vanishes in between.

    Roots outside the unit interval are moved to its ends, so that they change nothing.
    """
    slope = polynomials.derivative(coefficients)
    with np.errstate(invalid="ignore", divide="ignore"):
        if len(slope) == 4:
            inner = polynomials.cubic_roots(*slope)
        elif len(slope) == 3:
            inner = polynomials.quadratic_roots(*slope)
        else:
            a, b = slope
            inner = (-b / a)[None]
    inner = np.nan_to_num(inner, nan=0.0, posinf=1.0, neginf=0.0)
    start = np.zeros_like(inner[:1])
    inside = np.clip(inner, 0.0, 1.0)
    return np.concatenate([start, start + 1.0, inside])
