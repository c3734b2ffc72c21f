"""Stopping at every waypoint: each segment on its own, from rest to rest, in closed form.

The plainest trajectory that every planner must beat, and the scale of every search.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trajopt.problem import Problem

Array = NDArray[np.float64]


def stop_times(problem: Problem) -> Array:
    """Time of each segment if every joint stops at every waypoint, `(segments,)`, s.

    The minimum for velocity and acceleration limits, symmetric or not (trapezoidal profile), and
    for symmetric limits with jerk (seven phases). Asymmetric limits with jerk count as symmetric
    ones at their tighter side, which is an upper bound.
    """
    h, limits = problem.displacements, problem.limits
    times = trapezoidal(h, limits.velocity, limits.acceleration)
    jerk_limited = np.isfinite(limits.jerk).any(axis=1)
    tighter = (np.abs(x).min(axis=1) for x in (limits.velocity, limits.acceleration, limits.jerk))
    with_jerk = seven_phase(np.abs(h), *tighter)
    return np.asarray(np.where(jerk_limited, with_jerk, times).max(axis=1))


def trapezoidal(h: Array, velocity: Array, acceleration: Array) -> Array:
    """Rest-to-rest minimum time over displacements `h` `(…, joints)` for `(joints, 2)` limits."""
    top = np.where(h >= 0, velocity[:, 1], -velocity[:, 0])
    ramps = (1 / np.abs(acceleration)).sum(axis=1)  # speeding up and braking, per unit of speed
    peak = np.minimum(np.sqrt(2 * np.abs(h) / ramps), top)
    return np.asarray(np.where(peak < top, peak * ramps, np.abs(h) / top + top * ramps / 2))


def seven_phase(h: Array, velocity: Array, acceleration: Array, jerk: Array) -> Array:
    """Rest-to-rest minimum time over `h ≥ 0` `(…, joints)` for symmetric limits `(joints,)`."""
    slope = acceleration / jerk  # time to reach full acceleration
    with_plateau = acceleration / 2 * (np.sqrt(slope**2 + 4 * h / acceleration) - slope)
    without = np.cbrt(h) ** 2 * np.cbrt(np.where(np.isfinite(jerk), jerk, 0) / 4)
    peak = np.minimum(
        np.where(with_plateau >= acceleration * slope, with_plateau, without), velocity
    )
    ramp = np.where(
        peak >= acceleration * slope, peak / acceleration + slope, 2 * np.sqrt(peak / jerk)
    )
    cruise = np.where(peak > 0, h / np.maximum(peak, 1e-300) - ramp, 0)
    return np.asarray(2 * ramp + np.maximum(cruise, 0))
