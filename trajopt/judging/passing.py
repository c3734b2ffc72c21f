"""The times at which a motion passes waypoints: where it comes closest to each, in order.

The squared distance of a polynomial piece to a waypoint is a polynomial too. Its minima are found
from roots, so none is missed. Among all minima and breaks, dynamic programming chooses times that
do not decrease and have the least sum of distances. A motion that comes near a waypoint too early,
on its way to another one, is therefore timed correctly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Indices
from trajopt.core.problem import Problem
from trajopt.core.route import COORDINATE_RTOL
from trajopt.core.trajectory import BREAK_RTOL, Trajectory, nearest

# A break replaces the closest approach if their distance is smaller, relative to the duration, and
# if the motion misses the waypoint there by no more than rounding.
SAME_TIME_RTOL = 1e-9
NEWTON_STEPS = 3
# Weight of a miss, relative to the largest coordinate, against a use of limits above 1.
NEAR_WEIGHT = 1e9
# Relative to the duration: rounding of the time at which a waypoint is passed.
PASSING_RTOL = 4 * BREAK_RTOL


def misses(problem: Problem, trajectory: Trajectory) -> Array:
    """Return the miss of each waypoint over its rounding (`Problem.rounding`).

    The joint with the largest miss counts, at a time within rounding of the stated one.

    Args:
        problem: Of as many joints and waypoints as the trajectory has.
        trajectory: Its times are rounded: 3 s after the start, at 1 rad/s, that is 4e-16 rad.

    Returns:
        `(waypoints,)`; up to 1 the miss is no larger than the rounding.
    """
    times = trajectory.waypoint_times
    rounding = np.maximum(problem.rounding, np.finfo(float).tiny)
    away = (trajectory(times) - problem.waypoints) / rounding
    velocity = trajectory(times, 1) / rounding
    speed = np.square(velocity).sum(axis=1)
    along = (away * velocity).sum(axis=1)
    late = along / np.where(speed > 0, speed, np.inf)
    slack = PASSING_RTOL * trajectory.duration
    missed = away - np.clip(late, -slack, slack)[:, None] * velocity
    return np.asarray(np.abs(missed).max(axis=1))


def within_tolerance(problem: Problem, trajectory: Trajectory) -> Problem:
    """Return the problem with each waypoint moved to where the motion passes, within its box.

    Outside the box it is the box's nearest point. A problem without a tolerance stays as it is.
    """
    if "tolerance" not in problem.demands:
        return problem
    passed = trajectory(trajectory.waypoint_times)
    r = problem.demands["tolerance"]
    low, high = problem.limits.position.T
    inside = _at_one_instant(problem, trajectory.waypoint_times, passed)
    moved = np.where(r > 0, np.clip(inside, low, high), problem.waypoints)
    return replace(problem.without("tolerance"), waypoints=moved)


def _at_one_instant(problem: Problem, times: Array, passed: Array) -> Array:
    """Return the nearest places in the boxes, one place for waypoints that are passed at one time.

    Such waypoints are one waypoint, in the intersection of their boxes. Boxes that miss each other
    by the rounding of their coordinates touch. Boxes that do not meet have a place each.
    """
    r = problem.demands["tolerance"]
    lowest, highest = problem.waypoints - r, problem.waypoints + r
    inside = np.clip(passed, lowest, highest)
    (begins,) = np.nonzero(np.diff(times, prepend=-np.inf) > 0)
    for own in map(slice, begins, [*begins[1:], len(times)]):
        low, high = lowest[own].max(axis=0), highest[own].min(axis=0)
        if own.stop - own.start > 1 and (low <= high + problem.rounding).all():
            inside[own] = np.clip(passed[own][0], low, np.maximum(low, high))
    return inside


def waypoint_times(
    trajectory: Trajectory,
    waypoints: Array,
    tolerance: Array | float = 0.0,
    least: Array | float = 0.0,
    excess: Callable[[int, Array], Array] | None = None,
) -> Array:
    """Return when the motion passes each waypoint, s, `(waypoints,)`.

    The first time is 0, the last one the motion's end.

    Args:
        trajectory: of as many joints as the waypoints.
        waypoints: rad, `(waypoints, joints)`. Distances are those in joint space.
        tolerance: of each waypoint and joint, rad; a smaller distance counts as 0.
        least: least times of the segments, s, kept where the misses stay as small.
        excess: returns, for a waypoint's index and some times, the excess over limits if the
            waypoint is passed then, as a ratio. Among times of the same miss the least one is
            taken.
    """
    r = np.broadcast_to(tolerance, waypoints.shape)
    with np.errstate(over="ignore", invalid="ignore"):  # an infinite distance is far away
        candidates = [trajectory.breaks]
        for waypoint, own in zip(waypoints[1:-1], r[1:-1], strict=True):
            candidates.append(_minima(trajectory, waypoint))
            if own.any():
                candidates.append(_crossings(trajectory, waypoint, own))
        together = np.concatenate(candidates)
        times = np.unique(together)
        separate = np.broadcast_to(least, len(waypoints) - 1)
        if r.any() and separate.any():
            apart = np.unique(separate[separate > 0])[:, None]
            later = np.concatenate([times[None], times + apart, times - apart])
            times = np.unique(np.clip(later, 0.0, trajectory.duration))
        misses = [_miss(trajectory, *own, times) for own in zip(waypoints, r, strict=True)]
        if excess is not None:
            broken = [excess(number, times) for number in range(len(waypoints))]
            unit = NEAR_WEIGHT / max(float(np.abs(waypoints).max()), np.finfo(float).tiny)
            misses = [unit * miss + own for miss, own in zip(misses, broken, strict=True)]
        chosen = _in_order(np.array(misses), times, separate)
        return _at_breaks(trajectory, waypoints, times[chosen])


def _crossings(trajectory: Trajectory, waypoint: Array, tolerance: Array) -> Array:
    """Return the times at which joints cross the sides of a waypoint's box, and midpoints, s."""
    found = [trajectory.breaks[[0, -1]]]
    for side in (waypoint - tolerance, waypoint + tolerance):
        away = np.array(trajectory.pieces())
        away[-1] -= side
        shares = polynomials.unit_roots(away.reshape(len(away), -1))
        row, number = np.nonzero(np.isfinite(shares))
        piece = number // trajectory.joints
        found.append(trajectory.breaks[piece] + shares[row, number] * trajectory.lengths[piece])
    times = np.unique(np.concatenate(found))
    return np.concatenate([times, (times[:-1] + times[1:]) / 2])


def _minima(trajectory: Trajectory, waypoint: Array) -> Array:
    """Return times within pieces where the distance to a waypoint is extreme, s."""
    away = np.array(trajectory.pieces())
    away[-1] -= waypoint
    squares = polynomials.product(away, away)
    distance = squares.sum(axis=2)  # |q(s) − w|², summed over joints
    slope = polynomials.derivative(distance)
    shares = polynomials.unit_roots(slope)
    row, piece = np.nonzero(np.isfinite(shares))
    start = trajectory.breaks[piece]
    length = trajectory.lengths[piece]
    elapsed = shares[row, piece] * length
    return _polished(trajectory, waypoint, start + elapsed)


def _polished(trajectory: Trajectory, waypoint: Array, times: Array) -> Array:
    """Improve times by Gauss-Newton steps, each kept only where it reduces the distance.

    Roots of the squared distance alone round too much.
    """
    exact = np.zeros_like(waypoint)
    for _ in range(NEWTON_STEPS):
        away = trajectory(times) - waypoint
        velocity = trajectory(times, 1)
        along = (away * velocity).sum(axis=1)
        speed = np.square(velocity).sum(axis=1)
        speed[speed == 0] = np.inf  # no step where the robot stands
        step = along / speed
        moved = np.clip(times - step, 0.0, trajectory.duration)
        before = _miss(trajectory, waypoint, exact, times)
        after = _miss(trajectory, waypoint, exact, moved)
        times = np.where(after < before, moved, times)
    return times


def _miss(trajectory: Trajectory, waypoint: Array, tolerance: Array, times: Array) -> Array:
    """Return the distance from the waypoint in joint space, beyond the tolerances, rad."""
    away = np.maximum(np.abs(trajectory(times) - waypoint) - tolerance, 0.0)
    distance = np.linalg.norm(away, axis=1)
    return np.nan_to_num(distance, nan=np.inf)


def _in_order(misses: Array, times: Array, least: Array) -> Indices:
    """Return a candidate for each waypoint, in order of time, with the least sum of misses.

    Args:
        misses: `(waypoints, candidates)`, candidates in the order of time.
        times: of the candidates, s.
        least: least times between waypoints, s, `(waypoints - 1,)`; ignored where impossible.
    """
    candidates = misses.shape[1]
    numbers = np.arange(candidates)
    total = np.full(candidates, np.inf)
    total[0] = misses[0, 0]
    before = []
    slack = BREAK_RTOL * times[-1]
    for miss, apart in zip(misses[1:], least, strict=True):
        # The least sum up to each candidate, and the first candidate with that sum.
        shortest = np.minimum.accumulate(total)
        earlier = np.full(candidates, np.inf)
        earlier[1:] = shortest[:-1]
        first = np.where(total < earlier, numbers, 0)
        source = np.maximum.accumulate(first)
        if apart > 0:
            latest = np.searchsorted(times, times - apart + slack, side="right") - 1
            shortest = np.where(latest >= 0, shortest[latest], np.inf)
            source = source[latest]
        before.append(source)
        total = shortest + miss
    if np.isinf(total[-1]) and least.any():
        return _in_order(misses, times, np.zeros_like(least))
    last = candidates - 1
    backwards = [last]
    for sources in reversed(before):
        last = int(sources[last])
        backwards.append(last)
    return np.array(backwards[::-1])


def _at_breaks(trajectory: Trajectory, waypoints: Array, times: Array) -> Array:
    """Return times moved to breaks that are as near to the waypoint, to avoid short pieces."""
    breaks = trajectory.breaks[nearest(trajectory.breaks, times)]
    distance = np.abs(breaks - times)
    close = distance <= SAME_TIME_RTOL * trajectory.duration
    missed = trajectory(times) - waypoints
    missed_there = trajectory(breaks) - waypoints
    miss = np.abs(missed).max(axis=1)
    miss_there = np.abs(missed_there).max(axis=1)
    largest = np.abs(waypoints).max()
    rounding = COORDINATE_RTOL * largest
    as_near = miss_there <= miss + rounding
    found = np.where(close & as_near, breaks, times)
    return np.maximum.accumulate(found)
