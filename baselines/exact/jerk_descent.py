"""The program of `jerk_cells` by a primal-dual interior-point method made for it.

Every point keeps every inequality: what is left of them are the slacks, and a step is shortened
until that holds. What a point misses are the links between cells and waypoints alone, and Newton's
method meets those. So a cell never leaves the states that are within reach, where its formulas
mean something, however brief its segment is. Several starts take their steps together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

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
_LARGEST_GAP = 1e8
_NO_STEP = 1e-14
# The gradient over the times that does not hold the barrier up: beside the gap, of the duration.
_PULL_PER_GAP = 10.0
_BALANCED_RTOL = 1e-2
_MULTIPLIER_SPREAD = 1e10  # of a multiplier from barrier over row, either way


def minimised(scaled: Scaled, starts: Sequence[Start]) -> list[Optimum]:
    """The local optimum near each start."""
    cells = Cells(scaled, kinds=2)
    columns = [
        np.array(column)
        for column in zip(
            *starts,
            strict=True,
        )
    ]
    # a method that diverges overflows: it has not converged
    with np.errstate(all="ignore"):
        iterate = _begun(
            Rows(
                cells,
                cells.start(*columns),
            )
        )
        optima: list[Optimum | None] = [None] * len(starts)
        running = np.arange(len(starts))
        for _ in range(_MOST_STEPS):
            arrived = iterate.arrived(1.0)
            ended = arrived | iterate.lost
            for i in np.flatnonzero(ended):
                optima[running[i]] = _optimum(iterate, i)
            if ended.all():
                break
            if ended.any():
                running = running[~ended]
                iterate = iterate.of(~ended)
            iterate = _stepped(iterate)
        else:
            for i in np.arange(len(running)):
                optima[running[i]] = _optimum(iterate, i)
    return [optimum for optimum in optima if optimum is not None]


def _optimum(iterate: Iterate, i: np.intp) -> Optimum:
    """Where one of the starts ended."""
    point = iterate.rows.point
    times = np.exp(point.log[i])
    states = np.stack([point.velocity[i], point.acceleration[i]])
    if iterate.arrived(_ACCEPTED)[i]:
        return Optimum(
            float(times.sum()),
            times,
            states,
            "Converged",
        )
    return Optimum(np.inf, times, states, "Not_Converged")


class Iterate(NamedTuple):
    """How far some starts are.

    Attributes:
        rows: the program where they are.
        multipliers: of its rows.
        length: of each one's last step, up to 1, `(starts,)`.
        gained: what the whole of that step would have changed the duration by, `(starts,)`.
    """

    rows: Rows
    multipliers: Rooms
    length: Array
    gained: Array

    @property
    def gap(self) -> Array:
        """What the multipliers leave of the objective, `(starts,)`."""
        by_reach = self.multipliers.reach * self.rows.reach
        by_room = self.multipliers.room * self.rows.room
        return np.asarray(by_reach.sum(axis=(0, 2, 3)) + by_room.sum(axis=(0, 1, 3, 4)))

    @property
    def lost(self) -> Bools:
        """Which starts go no further, `(starts,)`."""
        diverged = ~(self.gap < _LARGEST_GAP * self.rows.duration)
        return np.asarray(diverged | (self.length == 0))

    def arrived(self, times: float) -> Bools:
        """Which starts are at a local optimum, to so many times the tolerances."""
        rows = self.rows
        missed = np.abs(rows.missing).max(axis=(0, 2, 3))
        near = missed <= times * _MISS_TOL
        near &= self.gap <= times * _GAP_RTOL * rows.duration
        return np.asarray(near & (self.gained <= times * _GAIN_RTOL * rows.duration))

    def of(self, some: Bools) -> Iterate:
        """Some of the starts."""
        reach = self.multipliers.reach[:, some]
        room = self.multipliers.room[:, :, some]
        return Iterate(
            Rows(
                self.rows.cells,
                self.rows.point.of(some),
            ),
            Rooms(reach, room),
            self.length[some],
            self.gained[some],
        )


def _begun(rows: Rows) -> Iterate:
    """No step yet."""
    starts = len(rows.times)
    barrier = _START_BARRIER * rows.duration / _count(rows)
    return Iterate(
        rows,
        _of_barrier(rows, barrier),
        length=np.full(starts, _START_LENGTH),
        gained=np.full(starts, np.inf),
    )


def _stepped(iterate: Iterate) -> Iterate:
    """After a Newton step to `row × multiplier = barrier`."""
    rows, multipliers, length, _ = iterate
    gap = iterate.gap
    weights = Rooms(
        multipliers.reach / rows.reach,
        multipliers.room / rows.room,
    )
    newton = Newton(rows, multipliers, weights)
    # as long as the multipliers do not balance, the barrier waits
    pull = newton.steepest(multipliers)
    unbalanced = pull > np.maximum(
        _PULL_PER_GAP * gap,
        _BALANCED_RTOL * rows.duration,
    )
    left = np.where(
        unbalanced,
        1.0,
        np.maximum(1 - length, _LEAST_LEFT),
    )
    wanted = left**_FALL_POWER * gap
    barrier = np.maximum(
        wanted,
        _LEAST_BARRIER_RTOL * rows.duration,
    ) / _count(rows)
    aims = _of_barrier(rows, barrier)
    direction = newton.step(aims)
    change = newton.change(direction)
    rise = Rooms(
        aims.reach - multipliers.reach - weights.reach * change.reach,
        aims.room - multipliers.room - weights.room * change.room,
    )
    farthest = np.abs(direction.log).max(axis=1)
    forwards = _LONGEST_STEP / np.maximum(farthest, _LONGEST_STEP)
    forwards = np.minimum(
        forwards,
        _longest(Rooms(rows.reach, rows.room), change),
    )
    upwards = _longest(multipliers, rise)
    moved, forwards = _shortened(rows, direction, forwards)
    return Iterate(
        moved,
        _moved(multipliers, rise, upwards, _of_barrier(moved, barrier)),
        np.where(
            forwards < _NO_STEP,
            0.0,
            np.minimum(forwards, upwards),
        ),
        np.abs((rows.times * direction.log).sum(axis=1)),
    )


def _shortened(rows: Rows, direction: Point, length: Array) -> tuple[Rows, Array]:
    """The rows after a step, as long as every inequality keeps its share."""
    for _ in range(_MOST_SHORTENED):
        moved = Rows(
            rows.cells,
            rows.point.moved(direction, length),
        )
        kept = _least(moved.reach / rows.reach)
        kept = np.minimum(
            kept,
            _least(moved.room / rows.room),
        )
        reachable = moved.profiles.reachable.all(axis=(0, 2, 3))
        good = (kept >= _LEAST_KEPT) & reachable
        if good.all():
            return moved, length
        length = np.where(good, length, _SHORTER * length)
    length = np.where(good, length, 0.0)
    return Rows(
        rows.cells,
        rows.point.moved(direction, length),
    ), length


def _moved(multipliers: Rooms, rise: Rooms, length: Array, aims: Rooms) -> Rooms:
    """Multipliers after a step, none too far from what the barrier asks for."""
    tables = []
    for value, step, aim in zip(
        multipliers,
        rise,
        aims,
        strict=True,
    ):
        moved = value + length[:, None, None] * step
        moved = np.maximum(moved, aim / _MULTIPLIER_SPREAD)
        tables.append(
            np.minimum(
                moved,
                aim * _MULTIPLIER_SPREAD,
            )
        )
    return Rooms(*tables)


def _of_barrier(rows: Rows, barrier: Array) -> Rooms:
    """The multipliers for which every row times its own is the barrier."""
    by_cell = barrier[:, None, None]
    return Rooms(
        by_cell / rows.reach,
        by_cell / rows.room,
    )


def _count(rows: Rows) -> int:
    """How many inequalities a start has."""
    return int(rows.reach[:, 0].size + rows.room[:, :, 0].size)


def _longest(values: Rooms, step: Rooms) -> Array:
    """How far along a step, at most all of it, no value loses more than its share, `(starts,)`."""
    fastest = -_least(step.reach / values.reach)
    fastest = np.maximum(
        fastest,
        -_least(step.room / values.room),
    )
    return np.asarray(
        _TO_BOUNDARY
        / np.maximum(
            fastest,
            _TO_BOUNDARY,
        )
    )


def _least(values: Array) -> Array:
    """The least value of each start; the last three axes are starts, segments and joints."""
    starts = values.shape[-3]
    by_start = np.moveaxis(
        values,
        -3,
        0,
    ).reshape(
        starts,
        -1,
    )
    return np.asarray(by_start.min(axis=1, initial=np.inf))
