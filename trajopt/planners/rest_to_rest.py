"""Stopping at every waypoint: each segment on its own, from rest to rest, in closed form.

The plainest trajectory that every planner must beat, and the scale of every search.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.demand import DEMANDS
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.resolution import thinned

# Exceeds the rounding errors of the closed forms.
_ROUNDING_RTOL = 1e-12


def stop_times(problem: Problem) -> Array:
    """Return the time of each segment if every joint stops at every waypoint, `(segments,)`, s.

    The minimum for velocity and acceleration limits, symmetric or not (trapezoidal profile), and
    for symmetric limits with jerk (seven phases). Asymmetric limits with jerk count as symmetric
    ones at their tighter side, which is an upper bound.
    """
    return step_times(problem.displacements, problem.limits).max(axis=1)


def step_times(h: Array, limits: Limits) -> Array:
    """Return the time of each joint for each displacement `h`, from rest to rest, s.

    As `stop_times`, but joint by joint: `(…, joints)`.
    """
    return _alone(h, limits, _tighter)


@lru_cache(maxsize=2048)  # each view of the same trials asks for it
def end_to_end_bound(problem: Problem) -> float:
    """Return a lower bound on the duration in closed form, s (docs/mathematics.md, section 8).

    It is the larger of two relaxations. The first one, for motions from rest to rest, is every
    joint alone, straight from the first to the last waypoint; with two waypoints and symmetric jerk
    limits that is the optimum. The second one is every segment at full velocity, or in its least or
    given time, or in that which a limit implies (`Limit.least_times`). Waits are added. A time that
    is asked of the whole motion is a bound too. Position limits, and waypoints that a motion may
    miss by rounding, are left out. With a tolerance each segment is as short as it allows.
    """
    left_out = [DEMANDS[key].left_out for key in problem.demands]
    way = problem.waypoints[-1] - problem.waypoints[0]
    straight = _alone(way[None], problem.limits.in_all_segments(tightest=False), _wider)
    if "" in left_out:  # it may begin or end in motion
        straight = np.zeros(1)
    # |h|/V, each joint in the direction of its displacement
    merged, _ = problem.merged()
    passed = thinned(merged)
    route = passed.route
    h = passed.displacements
    backward, forward = _sides(passed.limits.velocity)
    top = np.where(h >= 0, forward, -backward)
    r = route.demand("tolerance")
    cruising = np.maximum(np.abs(h) - r[:-1] - r[1:], 0.0) / top
    least = route.demand("least_times") + route.demand("given_times")
    of_limits = [own.least_times(passed) for own in passed.limits.others.values()]
    longest = np.maximum.reduce([cruising.max(axis=1), least, *of_limits])
    bound = max(straight.max(), longest.sum()) + route.demand("dwell").sum()
    asked = route.demand("least_duration") + route.demand("duration")
    return max(float(bound) * (1 - _ROUNDING_RTOL), float(asked))


def _alone(h: Array, limits: Limits, side: Callable[[Array], Array]) -> Array:
    """Rest-to-rest times of each joint alone over `h` `(…, joints)`; `side` picks one of a pair."""
    without_jerk = trapezoidal(h, limits.velocity, limits.acceleration)
    with_jerk = seven_phase(
        np.abs(h),
        velocity=side(limits.velocity),
        acceleration=side(limits.acceleration),
        jerk=side(limits.jerk),
    )
    return np.where(limits.jerk_limited, with_jerk, without_jerk)


def trapezoidal(h: Array, velocity: Array, acceleration: Array) -> Array:
    """Rest-to-rest minimum time over displacements `h` `(…, joints)` for `(joints, 2)` limits.

    Limits may be of each segment, `(segments, joints, 2)`, as `h` is.
    """
    backward, forward = _sides(velocity)
    top = np.where(h >= 0, forward, -backward)
    # Speeding up to v and braking take v (1/A1 + 1/A2).
    slowness = 1 / np.abs(acceleration)
    ramps = slowness.sum(axis=-1)
    # A triangle of height v and that base covers h = v² (1/A1 + 1/A2) / 2.
    distance = np.abs(h)
    triangle = np.sqrt(2 * distance / ramps)
    peak = np.minimum(triangle, top)
    without_cruise = peak * ramps
    # With a cruise at the top: h/V, and half of the ramps' time on top.
    with_cruise = distance / top + top * ramps / 2
    return np.where(peak < top, without_cruise, with_cruise)


def seven_phase(h: Array, velocity: Array, acceleration: Array, jerk: Array) -> Array:
    """Rest-to-rest minimum time over `h ≥ 0` `(…, joints)` for symmetric limits `(joints,)`."""
    A = acceleration
    # Time to reach full acceleration, and the speed reached when easing off at once.
    slope = A / jerk
    easing = A * slope
    # No cruise: each half covers h/2 = v/2 (v/A + A/J), so v = A/2 (√(A²/J² + 4 h/A) − A/J);
    square = slope**2 + 4 * h / A
    root = np.sqrt(square)
    with_plateau = A / 2 * (root - slope)
    # without full acceleration, h/2 = v √(v/J), so v = ∛(J h²/4).
    finite_jerk = np.where(np.isfinite(jerk), jerk, 0)
    quarter = np.cbrt(finite_jerk / 4)
    root = np.cbrt(h)
    without_plateau = root**2 * quarter
    plateau = with_plateau >= easing
    unlimited = np.where(plateau, with_plateau, without_plateau)
    peak = np.minimum(unlimited, velocity)
    # Time from rest to the peak: v/A + A/J, or 2 √(v/J).
    long_ramp = peak / A + slope
    short_ramp = 2 * np.sqrt(peak / jerk)
    ramp = np.where(peak >= easing, long_ramp, short_ramp)
    # Two ramps cover v · ramp; the rest is cruised. (A joint at rest has no peak.)
    positive = np.maximum(peak, 1e-300)
    cruise = h / positive - ramp
    cruise = np.where(peak > 0, cruise, 0)
    cruise = np.maximum(cruise, 0)
    return 2 * ramp + cruise


def _tighter(pairs: Array) -> Array:
    """The smaller of both sides' sizes, `(…, joints)`."""
    sizes = np.abs(pairs)
    return sizes.min(axis=-1)


def _wider(pairs: Array) -> Array:
    """The larger of both sides' sizes, `(…, joints)`."""
    sizes = np.abs(pairs)
    return sizes.max(axis=-1)


def _sides(pairs: Array) -> tuple[Array, Array]:
    """Lowest and highest values, `(…, joints)` each."""
    return pairs[..., 0], pairs[..., 1]
