"""Newton steps of the program of `jerk_cells`.

A cell depends on its segment's time and on velocity and acceleration at two waypoints: the matrix
is a band of `4n + 2` below the diagonal for `n` joints, factored by LAPACK's Cholesky, and a step's
work grows in proportion to the segments.

At a waypoint between a brief segment and a long one the brief one's own end velocity stands for the
velocity: `dv = T dx + (T x − h/T) ds`. A change of velocity that is nothing to the long one is many
times what the brief one can reach, and in one sum of squares rounding would lose the less of both.

At given times the program is convex. So where the matrix is not positive definite it becomes so by
additions to the times alone, of those segments where Cholesky's method ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.exact.cells import at_ends
from baselines.exact.jerk_cells import Point, Rows
from baselines.exact.jerk_profiles import ACCELERATIONS, TIME, VELOCITIES

Array = NDArray[np.float64]

# What is added to a time's diagonal entry at least where it is too small, and how that grows.
_LEAST_SHARE = 1e-2
_MORE = 8.0
_LARGEST = 1e14


class Rooms(NamedTuple):
    """One number for every inequality: see `Rows`."""

    reach: Array
    room: Array


class _Unknown(NamedTuple):
    """One unknown that a cell depends on.

    Attributes:
        variable: of the cell, that changes with it.
        factor: by how much.
        block: whose unknown it is: −1 of the segment before, 0 of this one, 1 of the one after.
        place: among those: 0 the time, 1 velocity and 2 acceleration after the segment.
    """

    variable: int
    factor: Array
    block: int
    place: int


class Newton:
    """The program near a point: rows linear, the Lagrangian quadratic.

    Args:
        rows: the program at the point.
        multipliers: of the rows.
        weights: what their squares count.
    """

    def __init__(self, rows: Rows, multipliers: Rooms, weights: Rooms) -> None:
        first, second = rows.slopes
        point = rows.point
        weighted = weights.reach * first
        matrix = (weighted[:, None] * first).sum(axis=2)
        matrix -= (multipliers.reach * second).sum(axis=2)
        pull = (multipliers.reach * first).sum(axis=1)
        for end, v in enumerate(VELOCITIES):
            # the link h/T + T x = v bends too
            matrix[TIME, TIME] += pull[v] * (rows.steep + point.ends[end])
            matrix[TIME, v] += pull[v]
            matrix[v, TIME] += pull[v]

        starts, segments, joints = rows.steep.shape
        self.rows = rows
        self.size = (starts, segments, 2 * joints + 1)
        self.slope = rows.steep - point.ends  # of x over the time, at a given velocity
        times = rows.times
        owned = np.zeros(
            (2, starts, segments, 1),
            dtype=bool,
        )
        briefer = times[:, :-1] < times[:, 1:]
        owned[1, :, :-1, 0] = briefer
        owned[0, :, 1:, 0] = ~briefer
        self.owned = owned
        self._link()
        self._add_rooms(
            matrix,
            multipliers.room,
            weights.room,
        )
        self.matrix = matrix
        self.reduced = self._over_time(
            self._over_time(matrix).swapaxes(
                0,
                1,
            )
        )

    def _link(self) -> None:
        """How a cell's variables change with the unknowns.

        Where the waypoint is the neighbour's: `x` as its velocity over the time of this cell.
        """
        t = self.rows.t
        missing = self.rows.missing
        ratio = np.ones_like(self.owned, dtype=float)
        ratio[0, :, 1:] = t[:, :-1] / t[:, 1:]
        ratio[1, :, :-1] = t[:, 1:] / t[:, :-1]
        beside = _neighbours(self.slope)
        neighbours = ~self.owned
        factor = np.where(
            self.owned,
            1.0,
            ratio,
        )
        by_neighbours_time = np.where(
            self.owned,
            0.0,
            -ratio * beside,
        )
        self.own_slope = neighbours * self.slope
        self.constant = neighbours * (missing - ratio * _neighbours(missing))
        one = np.ones((1, 1, 1))
        self.unknowns = [
            _Unknown(
                TIME,
                one,
                0,
                0,
            )
        ]
        for end, (v, a) in enumerate(
            zip(
                VELOCITIES,
                ACCELERATIONS,
                strict=True,
            )
        ):
            block = end - 1
            self.unknowns += [
                _Unknown(
                    v,
                    factor[end],
                    block,
                    1,
                ),
                _Unknown(a, one, block, 2),
                _Unknown(
                    v,
                    by_neighbours_time[end],
                    2 * end - 1,
                    0,
                ),
            ]

    def _add_rooms(self, matrix: Array, multipliers: Array, weights: Array) -> None:
        """The waypoints' own rows, in the cell whose waypoint it is."""
        ramps = self.rows.ramps
        of_acceleration, of_velocity = weights
        pressed = of_velocity * ramps
        bent = multipliers[1] * self.rows.cells.falling
        in_acceleration = of_acceleration + pressed * ramps + bent
        tables = np.array(
            [
                of_velocity.sum(axis=0),
                pressed[0] - pressed[1],
                in_acceleration.sum(axis=0),
            ]
        )
        t = self.rows.t
        self.by_waypoint = self.owned * np.array([at_ends(table) for table in tables])
        for end, (v, a) in enumerate(
            zip(
                VELOCITIES,
                ACCELERATIONS,
                strict=True,
            )
        ):
            vv, va, aa = self.by_waypoint[:, end]
            slope = self.slope[end]
            # dv = T (dx − slope ds)
            xx = t**2 * vv
            xa = t * va
            matrix[v, v] += xx
            matrix[a, a] += aa
            matrix[TIME, TIME] += slope**2 * xx
            for i, j, value in ((TIME, v, -slope * xx), (TIME, a, -slope * xa), (v, a, xa)):
                matrix[i, j] += value
                matrix[j, i] += value

    def _over_time(self, table: Array) -> Array:
        """A table over a cell's variables, the time's with the ends that change with it."""
        table = table.copy()
        for v, slope in zip(
            VELOCITIES,
            self.own_slope,
            strict=True,
        ):
            table[TIME] += slope * table[v]
        return table

    def bands(self) -> Array:
        """The matrix over `(s, x, a)` segment by segment, as a lower band, of every start."""
        starts, segments, width = self.size
        band = np.zeros((starts, segments, width, 2 * width + 1))
        by_joint = 2 * np.arange((width - 1) // 2)
        for one in self.unknowns:
            for other in self.unknowns:
                down = (other.block - one.block) * width
                if (other.block, other.place) < (one.block, one.place):
                    continue
                cells, at = _range(
                    segments,
                    one,
                    other,
                )
                entry = self.reduced[one.variable, other.variable]
                entry = (one.factor * other.factor * entry)[:, cells]
                if one.place == 0 and other.place == 0:
                    band[:, at, 0, down] += entry.sum(axis=2)
                elif one.place == 0:
                    band[:, at, 0][..., down + other.place + by_joint] += entry
                elif other.place == 0:
                    place = one.place + by_joint
                    band[:, at, place, down - place] += entry
                else:
                    place = one.place + by_joint
                    band[:, at, place, down + other.place - one.place] += entry
        band[:, :, 0, 0] += self.rows.times
        band[:, -1, 1:, 0] = 1.0
        return band

    def gradient(self, aims: Rooms) -> Array:
        """What these multipliers pull over `(s, x, a)`, less what the duration does."""
        rows = self.rows
        segments, width = self.size[1:]
        by_cell = (aims.reach * rows.slopes.first).sum(axis=1)
        for end, v in enumerate(VELOCITIES):
            by_cell -= self.matrix[:, v] * self.constant[end]
        of_acceleration, of_velocity = aims.room
        pressed = (of_velocity * rows.ramps).sum(axis=0)
        by_velocity = at_ends(of_velocity[1] - of_velocity[0])
        by_acceleration = at_ends(of_acceleration[1] - of_acceleration[0] - pressed)
        vv, va, _ = self.by_waypoint
        missed = rows.t * rows.missing
        by_velocity = rows.t * (self.owned * by_velocity + vv * missed)
        by_acceleration = self.owned * by_acceleration + va * missed
        for end, (v, a) in enumerate(
            zip(
                VELOCITIES,
                ACCELERATIONS,
                strict=True,
            )
        ):
            by_cell[v] += by_velocity[end]
            by_cell[TIME] -= self.slope[end] * by_velocity[end]
            by_cell[a] += by_acceleration[end]
        by_cell = self._over_time(by_cell)
        gradient = np.zeros(self.size)
        by_joint = 2 * np.arange((width - 1) // 2)
        for unknown in self.unknowns:
            cells, at = _range(
                segments,
                unknown,
                unknown,
            )
            entry = (unknown.factor * by_cell[unknown.variable])[:, cells]
            if unknown.place == 0:
                gradient[:, at, 0] += entry.sum(axis=2)
            else:
                gradient[:, at][..., unknown.place + by_joint] += entry
        gradient[:, :, 0] -= rows.times
        return gradient

    def step(self, aims: Rooms) -> Point:
        """The Newton step to the multipliers that rows as they are would have."""
        import scipy  # late: planners that are only listed need none of it

        gradient = self.gradient(aims)
        solved = np.empty(self.size)
        for start, band in enumerate(self.bands()):
            factor = self._factor(band, start)
            own = gradient[start].ravel()
            solution, _ = scipy.linalg.lapack.dpbtrs(
                factor,
                own,
                lower=1,
            )
            solved[start] = solution.reshape(gradient[start].shape)
        return self._expanded(solved)

    def _factor(self, band: Array, start: int) -> Array:
        """The Cholesky factor of a band, its times' entries larger where that is needed."""
        import scipy  # late: planners that are only listed need none of it

        entries = band[:, 0, 0]
        diagonal = entries.copy()
        added = np.zeros_like(diagonal)
        flat = band.reshape(
            -1,
            band.shape[-1],
        ).T
        while True:
            entries[:] = diagonal + added
            factor, failed = scipy.linalg.lapack.dpbtrf(
                flat,
                lower=1,
            )
            if not failed or not added.max() < _LARGEST:
                return np.asarray(factor)
            added = np.maximum(
                _MORE * added,
                _LEAST_SHARE * self.rows.times[start],
            )

    def _expanded(self, solved: Array) -> Point:
        """The step of all unknowns, from that of times, ends and accelerations."""
        rows = self.rows
        t = rows.t
        log = solved[..., 0]
        s = log[..., None]
        own = at_ends(solved[:, :-1, 1::2])
        acceleration = solved[:, :-1, 2::2]
        velocities = t * (own - self.slope * s - rows.missing)
        before = self.owned[1, :, :-1]
        velocity = np.where(
            before,
            velocities[1, :, :-1],
            velocities[0, :, 1:],
        )
        linked = at_ends(velocity) / t + self.slope * s + rows.missing
        ends = np.where(
            self.owned,
            own,
            linked,
        )
        return Point(log, ends, velocity, acceleration)

    def change(self, step: Point) -> Rooms:
        """By how much a step changes every row."""
        rows = self.rows
        acceleration = step.acceleration
        at_waypoints = at_ends(acceleration)
        s = step.log[..., None]
        first = rows.slopes.first
        reach = first[TIME] * s
        for end, (v, a) in enumerate(
            zip(
                VELOCITIES,
                ACCELERATIONS,
                strict=True,
            )
        ):
            reach = reach + first[v] * step.ends[end] + first[a] * at_waypoints[end]
        onwards = np.array([-acceleration, acceleration])
        faster = np.array([-step.velocity, step.velocity])
        return Rooms(
            reach,
            np.array([onwards, faster - rows.ramps * acceleration]),
        )

    def steepest(self, multipliers: Rooms) -> Array:
        """The largest entry of the Lagrangian's gradient over the times, `(starts,)`."""
        return np.asarray(np.abs(self.gradient(multipliers)[..., 0]).max(axis=1))


def _neighbours(ends: Array) -> Array:
    """What the cell beside has at the same waypoint, `(2 ends, starts, segments, joints)`."""
    beside = np.zeros_like(ends)
    beside[0, :, 1:] = ends[1, :, :-1]
    beside[1, :, :-1] = ends[0, :, 1:]
    return beside


def _range(segments: int, one: _Unknown, other: _Unknown) -> tuple[slice, slice]:
    """The cells that have both unknowns, and the blocks of the one."""
    before = (
        min(
            one.block,
            other.block,
        )
        < 0
    )
    ends = [unknown.block + (unknown.place > 0) for unknown in (one, other)]
    last = segments - (max(ends) > 0)
    first = int(before)
    return slice(
        first,
        last,
    ), slice(
        first + one.block,
        last + one.block,
    )
