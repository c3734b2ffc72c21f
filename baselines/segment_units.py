"""Moderate numbers for a solver with absolute tolerances: every segment in units of its own.

Time counts in the time that the segment takes from stop to stop, a joint's way in the distance that
the joint can cover from stop to stop meanwhile, at its tightest limit. Then velocity limits are 1
or more, acceleration limits 4 or more, jerk limits 32 or more, displacements at most 1, and a miss
of 1e-8 costs as little on a segment of 1e-5 rad as on one of 1 rad. The units belong to the motion
and not to the file it came from: degrees for radians, or milliseconds for seconds, give the solver
the same numbers but for rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.problem import Limits, Problem
from trajopt.planners.rest_to_rest import stop_times

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Units:
    """A unit of time, s, and one of length for each joint `(joints,)`, rad."""

    time: float
    lengths: Array

    def states(self, states: Array) -> tuple[Array, Array]:
        """Velocities and accelerations `(2, joints)`, rad/s and rad/s², in these units."""
        return states_in(states, self.time, self.lengths)

    def limits(self, limits: Limits) -> Limits:
        """Limits of velocity, acceleration and jerk in these units."""
        rate = self.time / self.lengths[:, None]
        return Limits(
            velocity=limits.velocity * rate,
            acceleration=limits.acceleration * rate * self.time,
            jerk=limits.jerk * rate * self.time**2,
        )

    def in_radians(self, coefficients: Array, joint: int) -> Array:
        """A joint's polynomials of time `(degree + 1, pieces)` in these units, in rad and s."""
        by_time = polynomials.stretched(coefficients, 1 / self.time)
        return np.asarray(by_time * self.lengths[joint])


def states_in(
    states: Array,
    time: Array | float,
    lengths: Array,
) -> tuple[Array, Array]:
    """Velocities and accelerations `(2, …, joints)`, rad/s and rad/s², in units of each case.

    Args:
        states: the velocities, then the accelerations.
        time: units of time, s, `(…, 1)`, or one for all cases.
        lengths: units of length, rad, `(…, joints)`.
    """
    velocity, acceleration = states * time / lengths
    return velocity, acceleration * time


def of_segments(problem: Problem) -> list[Units]:
    """The units of each segment of a problem (no two consecutive waypoints alike)."""
    sides = problem.limits
    V = np.abs(sides.velocity).min(axis=1)
    A = np.abs(sides.acceleration).min(axis=1)
    J = np.abs(sides.jerk).min(axis=1)
    units = []
    for time in stop_times(problem):
        # From stop to stop in T at one limit alone: V T, A T²/4, J T³/32.
        reaches = [
            V * time,
            A * time**2 / 4,
            J * time**3 / 32,
        ]
        shortest = np.min(reaches, axis=0)
        units.append(Units(float(time), shortest))
    return units
