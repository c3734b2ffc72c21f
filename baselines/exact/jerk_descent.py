"""The program of `jerk_cells` by a primal-dual interior-point method made for it.

Every point keeps every inequality: what is left of them are the slacks, and a step is shortened
until that holds. What a point misses are the links between cells and waypoints alone, and Newton's
method meets those. So a cell never leaves the states that are within reach, where its formulas
mean something, however brief its segment is. Several starts take their steps together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.exact.jerk_cells import Cells, Point, Rows, Scaled
from baselines.exact.jerk_step import Newton, Rooms
from baselines.exact.several_starts import Optimum

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Start = tuple[Array, Array, Array]  # segment times, inner waypoint velocities and accelerations

_MOST_STEPS = 300
# Where the method has converged: what the multipliers leave of the objective, what its last step
# would have changed, and what the links miss.
_GAP_RTOL = 1e-12
_GAIN_RTOL = 1e-10
_MISS_TOL = 1e-13
_ACCEPTED = 100.0  # times as much, where rounding lets it go no further
_START_BARRIER = 0.1  # of the duration
_START_LENGTH = 0.5
# The barrier falls to this power of what the last step left of its way, not below the least.
_FALL_POWER = 1.5
_LEAST_LEFT = 0.02
_LEAST_BARRIER_RTOL = 3e-13
_TO_BOUNDARY = 0.99  # of the way to where a row or a multiplier vanishes
_LEAST_KEPT = 0.005  # of a row, in one step
_LONGEST_STEP = 1.0  # of the logarithm of a segment time
_SHORTER = 0.6
_MOST_SHORTENED = 40
_NO_STEP = 1e-14
# The gradient over the times that does not hold the barrier up: beside the gap, of the duration.
_PULL_PER_GAP = 10.0
_BALANCED_RTOL = 1e-2
_MULTIPLIER_SPREAD = 1e10  # of a multiplier from barrier over row, either way


def minimised(scaled: Scaled, starts: Sequence[Start]) -> list[Optimum]:
    """The local optimum near each start."""
    cells = Cells(scaled)
    columns = [np.array(column) for column in zip(*starts, strict=True)]
    # a method that diverges overflows: it has not converged
    with np.errstate(all="ignore"):
        point, converged = _descended(cells, cells.start(*columns))
    times = np.exp(point.log)
    inner = np.stack([point.velocity, point.acceleration], axis=1)
    optima = []
    for own, states, arrived in zip(times, inner, converged, strict=True):
        duration = float(own.sum()) if arrived else np.inf
        status = "Converged" if arrived else "Not_Converged"
        optima.append(Optimum(duration, own, states, status))
    return optima


def _descended(cells: Cells, point: Point) -> tuple[Point, Bools]:
    """Steps until every start has converged or goes no further; which ones have."""
    rows = Rows(cells, point)
    count = _count(rows)
    multipliers = _of_barrier(rows, _START_BARRIER * rows.duration / count)
    length = np.full(len(rows.times), _START_LENGTH)
    gained = np.full(len(rows.times), np.inf)
    for _ in range(_MOST_STEPS):
        gap = _total(multipliers, rows)
        weights = Rooms(multipliers.reach / rows.reach, multipliers.room / rows.room)
        newton = Newton(rows, multipliers, weights)
        if _arrived(rows, gap, gained, 1.0).all() or not length.any():
            break
        # as long as the multipliers do not balance, the barrier waits
        pull = newton.steepest(multipliers)
        unbalanced = pull > np.maximum(_PULL_PER_GAP * gap, _BALANCED_RTOL * rows.duration)
        left = np.where(unbalanced, 1.0, np.maximum(1 - length, _LEAST_LEFT))
        wanted = left**_FALL_POWER * gap
        barrier = np.maximum(wanted, _LEAST_BARRIER_RTOL * rows.duration) / count
        aims = _of_barrier(rows, barrier)
        direction = newton.step(aims)
        change = newton.change(direction)
        rise = Rooms(
            aims.reach - multipliers.reach - weights.reach * change.reach,
            aims.room - multipliers.room - weights.room * change.room,
        )
        gained = np.abs((rows.times * direction.log).sum(axis=1))
        farthest = np.abs(direction.log).max(axis=1)
        forwards = _LONGEST_STEP / np.maximum(farthest, _LONGEST_STEP)
        forwards = np.minimum(forwards, _longest(Rooms(rows.reach, rows.room), change))
        upwards = _longest(multipliers, rise)
        rows, forwards = _shortened(rows, direction, forwards)
        multipliers = _moved(multipliers, rise, upwards, _of_barrier(rows, barrier))
        length = np.where(forwards < _NO_STEP, 0.0, np.minimum(forwards, upwards))
    return rows.point, _arrived(rows, _total(multipliers, rows), gained, _ACCEPTED)


def _arrived(rows: Rows, gap: Array, gained: Array, times: float) -> Bools:
    """Which starts are at a local optimum, to so many times the tolerances."""
    missed = np.abs(rows.missing).max(axis=(0, 2, 3))
    near = missed <= times * _MISS_TOL
    near &= gap <= times * _GAP_RTOL * rows.duration
    return np.asarray(near & (gained <= times * _GAIN_RTOL * rows.duration))


def _shortened(rows: Rows, direction: Point, length: Array) -> tuple[Rows, Array]:
    """The rows after a step, as long as every inequality keeps its share."""
    for _ in range(_MOST_SHORTENED):
        moved = Rows(rows.cells, rows.point.moved(direction, length))
        kept = _least(moved.reach / rows.reach)
        kept = np.minimum(kept, _least(moved.room / rows.room))
        reachable = moved.profiles.reachable.all(axis=(0, 2, 3))
        good = (kept >= _LEAST_KEPT) & reachable
        if good.all():
            return moved, length
        length = np.where(good, length, _SHORTER * length)
    length = np.where(good, length, 0.0)
    return Rows(rows.cells, rows.point.moved(direction, length)), length


def _moved(multipliers: Rooms, rise: Rooms, length: Array, aims: Rooms) -> Rooms:
    """Multipliers after a step, none too far from what the barrier asks for."""
    tables = []
    for value, step, aim in zip(multipliers, rise, aims, strict=True):
        moved = value + length[:, None, None] * step
        moved = np.maximum(moved, aim / _MULTIPLIER_SPREAD)
        tables.append(np.minimum(moved, aim * _MULTIPLIER_SPREAD))
    return Rooms(*tables)


def _of_barrier(rows: Rows, barrier: Array) -> Rooms:
    """The multipliers for which every row times its own is the barrier."""
    by_cell = barrier[:, None, None]
    return Rooms(by_cell / rows.reach, by_cell / rows.room)


def _count(rows: Rows) -> int:
    """How many inequalities a start has."""
    return int(rows.reach[:, 0].size + rows.room[:, :, 0].size)


def _total(multipliers: Rooms, rows: Rows) -> Array:
    """What the multipliers leave of the objective, `(starts,)`."""
    by_reach = (multipliers.reach * rows.reach).sum(axis=(0, 2, 3))
    by_room = (multipliers.room * rows.room).sum(axis=(0, 1, 3, 4))
    return np.asarray(by_reach + by_room)


def _longest(values: Rows | Rooms, step: Rooms) -> Array:
    """How far along a step, at most all of it, no value loses more than its share, `(starts,)`."""
    fastest = -_least(step.reach / values.reach)
    fastest = np.maximum(fastest, -_least(step.room / values.room))
    return np.asarray(_TO_BOUNDARY / np.maximum(fastest, _TO_BOUNDARY))


def _least(values: Array) -> Array:
    """The least value of each start; the last three axes are starts, segments and joints."""
    starts = values.shape[-3]
    by_start = np.moveaxis(values, -3, 0).reshape(starts, -1)
    return np.asarray(by_start.min(axis=1, initial=np.inf))
