"""When a motion passes waypoints: where it comes closest to each of them, in order.

The squared distance of a polynomial piece to a waypoint is a polynomial too: its minima are found
from roots, none is missed between samples. Of all minima and breaks, the times are chosen together
that do not decrease and miss least in sum, by dynamic programming: a motion that comes by a
waypoint early, on its way to another, does not mislead it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.trajectory import EPS, Trajectory, nearest

Array = NDArray[np.float64]

# A break this near to the closest approach is it, where its miss is no worse than rounding.
_SAME_TIME_RTOL = 1e-9
_COORDINATE_RTOL = 16 * EPS
_NEWTON_STEPS = 3


def waypoint_times(trajectory: Trajectory, waypoints: Array) -> Array:
    """When the motion passes each waypoint, s, `(waypoints,)`; the first at 0, the last at its end.

    Args:
        trajectory: of as many joints as the waypoints.
        waypoints: rad, `(waypoints, joints)`. Closest is meant in joint space, over all joints.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # beyond all bounds is far away
        return _waypoint_times(trajectory, waypoints)


def _waypoint_times(trajectory: Trajectory, waypoints: Array) -> Array:
    candidates = [trajectory.breaks]
    for waypoint in waypoints[1:-1]:
        candidates.append(_minima(trajectory, waypoint))
    together = np.concatenate(candidates)
    times = np.unique(together)
    misses = []
    for waypoint in waypoints:
        misses.append(_miss(trajectory, waypoint, times))
    chosen = _in_order(np.array(misses))
    return _at_breaks(trajectory, waypoints, times[chosen])


def _minima(trajectory: Trajectory, waypoint: Array) -> Array:
    """Times within pieces where the distance to a waypoint has a minimum (or maximum), s."""
    away = np.array(trajectory.pieces())
    away[-1] -= waypoint
    terms = len(away)
    # |q(s) − w|², summed over joints
    pieces = away.shape[1]
    degree = 2 * (terms - 1)
    square = np.zeros((degree + 1, pieces))
    for power, factor in enumerate(away):
        products = away * factor
        rows = slice(power, power + terms)
        square[rows] += products.sum(axis=2)
    slope = polynomials.derivative(square)
    shares = polynomials.unit_roots(slope)
    row, piece = np.nonzero(np.isfinite(shares))
    start = trajectory.breaks[piece]
    length = trajectory.lengths[piece]
    elapsed = shares[row, piece] * length
    return _polished(trajectory, waypoint, start + elapsed)


def _polished(
    trajectory: Trajectory,
    waypoint: Array,
    times: Array,
) -> Array:
    """Gauss and Newton's steps, each kept only where it comes nearer: squares round too much."""
    for _ in range(_NEWTON_STEPS):
        away = trajectory(times) - waypoint
        velocity = trajectory(times, 1)
        along = (away * velocity).sum(axis=1)
        speed = np.square(velocity).sum(axis=1)
        # where it stands there is no step
        speed[speed == 0] = np.inf
        step = along / speed
        moved = np.clip(times - step, 0.0, trajectory.duration)
        before = _miss(trajectory, waypoint, times)
        after = _miss(trajectory, waypoint, moved)
        times = np.where(after < before, moved, times)
    return times


def _miss(
    trajectory: Trajectory,
    waypoint: Array,
    times: Array,
) -> Array:
    """How far it is from the waypoint, rad, over all joints."""
    away = trajectory(times) - waypoint
    distance = np.linalg.norm(away, axis=1)
    return np.asarray(np.nan_to_num(distance, nan=np.inf))


def _in_order(misses: Array) -> NDArray[np.intp]:
    """Which candidate each waypoint has: not decreasing, of the least sum of misses.

    Args:
        misses: `(waypoints, candidates)`, candidates in the order of time.
    """
    candidates = misses.shape[1]
    numbers = np.arange(candidates)
    total = np.full(candidates, np.inf)
    total[0] = misses[0, 0]
    before = []
    for miss in misses[1:]:
        # The least sum up to each candidate, and the first candidate that has it.
        least = np.minimum.accumulate(total)
        earlier = np.full(candidates, np.inf)
        earlier[1:] = least[:-1]
        first = np.where(total < earlier, numbers, 0)
        before.append(np.maximum.accumulate(first))
        total = least + miss
    last = candidates - 1
    backwards = [last]
    for sources in reversed(before):
        last = int(sources[last])
        backwards.append(last)
    return np.array(backwards[::-1])


def _at_breaks(
    trajectory: Trajectory,
    waypoints: Array,
    times: Array,
) -> Array:
    """The same, at a break where that is as near: no sliver of a piece is cut off for nothing."""
    breaks = trajectory.breaks[nearest(trajectory.breaks, times)]
    distance = np.abs(breaks - times)
    close = distance <= _SAME_TIME_RTOL * trajectory.duration
    missed = trajectory(times) - waypoints
    missed_there = trajectory(breaks) - waypoints
    miss = np.abs(missed).max(axis=1)
    miss_there = np.abs(missed_there).max(axis=1)
    largest = np.abs(waypoints).max()
    rounding = _COORDINATE_RTOL * largest
    as_near = miss_there <= miss + rounding
    found = np.where(close & as_near, breaks, times)
    return np.maximum.accumulate(found)
