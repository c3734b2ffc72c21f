"""The jerk-limited program, cell by cell: unknowns, inequalities, Newton steps (mathematics, 4).

A cell is one segment of one joint, with the time `T` and the displacement `h`. The unknowns are the
logarithms of the segment times, velocity and acceleration at the inner waypoints, and the cells'
end velocities `x`. They are counted from the cell's mean velocity, in units of its time. A link
ties each to its waypoint's velocity `v`: `h/T + T x = v`. The inequalities of a cell depend on its
time, its end velocities and its waypoints' accelerations only. Several starts share every array:
`(2 ends, 2 sides, starts, segments, joints)`.

With a tolerance `r` the offsets `p` of the inner waypoints from their nominal positions are
unknowns too, and `|p| ≤ r`. A cell's displacement grows by the offset `p'` at its end less the one
`p` at its start, so its displacement inequalities change by `(p' − p)/T²`, in units of its time.

Along a Newton step 1/T, the accelerations, and at each waypoint the `x` of the shorter segment
change linearly. The velocities then change nearly linearly too. Along a step that is linear in
`log T` they would not, in a segment of 1e-7 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from baselines.exact.jerk.profiles import (
    ACCELERATIONS,
    TIME,
    VELOCITIES,
    ExtremeProfiles,
    SegmentLimits,
    Slopes,
)
from baselines.exact.method.chain import Chain, Links, at_ends, beside_it, owners
from baselines.exact.method.interior_point import (
    MIN_KEPT_SLACK,
    ROW_AXES,
    chosen,
    joined,
    moved,
)
from baselines.exact.method.scaled import Abreast, Scaled
from trajopt.core.arrays import Array, Bools, Indices

# Order of a cell's inequalities, each for both sides: displacement (of both kinds of profiles, see
# `JerkTables`), acceleration and velocity at the cell's end. Then the least time, if one is asked
# for, and the box around the waypoint at the cell's end, with a tolerance. Where limits differ from
# segment to segment, the velocity at the cell's start is last. Before it, where one instant passes
# several waypoints, comes the velocity at the cell's end again, with the limits of the segments
# between these waypoints.
REACH = 4
SLOWER = slice(REACH, REACH + 2)
FASTER = slice(REACH + 2, REACH + 4)
LEAST = REACH + 4
EARLY = slice(-2, None)
PASSED = slice(-4, -2)
# With a tolerance the offsets at both ends of a cell follow its other five variables. In the chain
# each follows the acceleration of its waypoint.
OFFSETS = 5, 6
_IN_CHAIN = [0, 1, 2, 5, 3, 4, 6]
_FROM_CHAIN = [0, 1, 2, 4, 5, 3, 6]
# Signs of acceleration at both ends: the end is seen backwards in time, where it is mirrored.
FLIPS = np.reshape([1.0, -1.0], (2, 1, 1, 1, 1))
_UP_AND_DOWN = np.reshape([-1.0, 1.0], (2, 1, 1, 1))  # signs of an offset in its box
# A smaller residual of a link, relative to its velocities, is rounding.
_ROUNDING_RTOL = 4e-15
# Barrier parameter of a start, times the number of inequalities, relative to the duration. Halved
# or doubled: 2 % more or fewer steps.
START_BARRIER_RTOL = 0.1


class JerkUnknowns(NamedTuple):
    """The unknowns of every start, or a step of them.

    Attributes:
        log: logarithms of the segment times, `(starts, segments)`.
        ends: the cells' end velocities, `(2 ends, starts, segments, joints)`.
        velocity: at the inner waypoints, `(starts, segments - 1, joints)`.
        acceleration: likewise.
        offset: of these waypoints from their nominal positions, likewise.
    """

    log: Array
    ends: Array
    velocity: Array
    acceleration: Array
    offset: Array


class JerkTables:
    """The constant tables of the program.

    Args:
        scaled: the problem; of several the first.
        every: the problem of each start, where they are several, without demands.
        kinds: extreme profiles on each side. 2: one without the velocity limit and one with a
            cruise, which may take a little negative time; both are smooth. 1: the lesser of the
            two, with a kink where the cruise begins.
    """

    def __init__(self, scaled: Scaled, kinds: int = 1, every: Sequence[Scaled] = ()) -> None:
        abreast = Abreast(every or [scaled])
        v1, v2 = np.abs(abreast.v)
        a1, a2 = np.abs(abreast.a)
        r1, r2 = abreast.r
        one = np.ones_like(v1)

        def sides(upper: Array, lower: Array) -> Array:
            return np.array([upper, lower] * kinds)

        self.scaled = scaled
        self.every = every
        self.kinds = kinds
        self.beyond = kinds > 1
        self.signs = sides(one, -one)

        rising = sides(a2, a1)
        falling = sides(a1, a2)
        self.h = abreast.h
        self.end_v = abreast.end_v
        self.end_a = abreast.end_a
        self.steepest = np.array([rising, falling])
        self.fastest = np.array([v2, v1])
        self.highest = sides(v2, v1)
        if self.beyond:
            self.highest[:2] = np.inf
        self.up = sides(r2, r1)
        self.down = sides(r1, r2)
        self.falling = self.down[:2]
        self.widest = np.array([a2, a1])
        self.waypoint_v, self.waypoint_a = abreast.waypoint_v, abreast.waypoint_a
        self.by_segment = scaled.by_segment
        # cells whose first waypoint has a velocity and an acceleration among the unknowns
        self.starts = np.ones((1, 1, len(scaled.h), 1), dtype=bool)
        self.starts[:, :, 0] = scaled.closed
        if self.by_segment:
            low, high = self.waypoint_a
            self.widest[:, :, : high.shape[1]] = high, -low
        self.passing = None
        if scaled.passing is not None:
            low, high = scaled.passing[0]
            self.passing = np.full((2, 1, *scaled.h.shape), np.inf)
            self.passing[:, 0, : len(high)] = high, -low
        self.closed = scaled.closed
        # a given last state needs no inequalities: those of that waypoint are the constant 1
        self.given = bool(np.any(scaled.end_v) or np.any(scaled.end_a))
        self.least = scaled.least if scaled.least.any() else None
        self.tolerant = bool(scaled.tolerance.any())
        if self.tolerant:
            # half width of the box around the waypoint at each cell's end; 1 for an exact waypoint
            box = np.zeros(scaled.h.shape)
            box[: len(scaled.tolerance)] = scaled.tolerance
            self.free = box > 0
            self.box = np.where(self.free, box, 1.0)
            self.free_before = np.roll(self.free, 1, axis=0)
            self.free_before[0] &= scaled.closed

    @cached_property
    def seen(self) -> tuple[Array, Array]:
        """Signs of a cell's variables on each side, in the order of `jerk.profiles`; of pairs."""
        seen = np.ones((5, *self.signs.shape))
        seen[1:4] = self.signs
        seen[4] = -self.signs
        return seen, seen[:, None] * seen

    def linked(self, times: Array, velocity: Array, acceleration: Array) -> JerkUnknowns:
        """Return the point with these segment times, `(starts, segments)`, and waypoint states.

        Its end velocities keep every link, and its waypoints are at their nominal positions.
        """
        t = times[..., None]
        ends = (at_ends(velocity, self.end_v, self.closed) - self.h / t) / t
        return JerkUnknowns(np.log(times), ends, velocity, acceleration, np.zeros_like(velocity))

    def of(self, some: Bools | Indices) -> Self:
        """Return the tables of some of the starts; those of one problem are the same for all."""
        if not self.every:
            return self
        numbers = np.arange(len(self.every))[some]
        return type(self)(self.scaled, self.kinds, [self.every[i] for i in numbers])

    def with_others(self, others: Sequence[JerkTables]) -> Self:
        """Return the tables of these starts, then of the others."""
        tables: list[JerkTables] = [self, *others]
        every = [scaled for own in tables for scaled in own.every]
        return type(self)(self.scaled, self.kinds, every)


class JerkInequalities:
    """The inequalities of the program at a point, and the residuals of its links.

    Attributes:
        values: slack of every inequality, `(inequalities, 1, starts, segments, joints)`: first the
            displacement; at a cell's end the acceleration; there the velocity after the ramp that
            ends this acceleration. Each is for both sides. Where limits differ from segment to
            segment, a ramp counts in the cell in which it lies: the one before a waypoint if it
            runs backwards in time, the one after it if forwards.
        reach: slack of the extreme displacements, in units of the cell's time squared,
            `(sides, starts, segments, joints)`.
        t: the segment times, `(starts, segments, 1)`.
    """

    start_slack = 0.0
    # with a smaller gap, rounding would bring the stored motion beyond its limits
    min_gap_rtol = 3e-13
    max_log_step = 0.7

    def __init__(self, cells: JerkTables, point: JerkUnknowns) -> None:
        times = np.exp(point.log)
        t = times[..., None]
        mean = cells.h / t
        steep = mean / t
        limits = SegmentLimits(
            cells.steepest,
            cells.highest / t - cells.signs * steep,
            cells.up / t,
            cells.down / t,
            cells.signs * steep,
            cells.beyond,
        )
        waypoints = at_ends(point.acceleration, cells.end_a, cells.closed)
        profiles = ExtremeProfiles(
            point.ends[:, None] * cells.signs, waypoints[:, None] * cells.signs * FLIPS, limits
        )
        reach = profiles.value
        # after the ramp that ends an acceleration, forwards or backwards: r1 a²/2 up to a peak
        started, acceleration = waypoints
        early, velocity = at_ends(point.velocity, cells.end_v, cells.closed)
        signs = cells.signs[:2]
        slower = cells.widest - signs * acceleration
        ramped = _sided(acceleration, -signs) if cells.by_segment else acceleration
        faster = signs * velocity + cells.falling * ramped**2 / 2
        tables = [reach, slower, cells.fastest - faster]
        if cells.given:
            for table in tables[1:]:
                table[..., -1, :] = 1.0
        if cells.least is not None:
            tables.append(_longer(times, cells.least, velocity.shape))
        if cells.tolerant:
            # a time may tend to 0, or a box may be as wide as the displacement
            self.max_iterations = 120
            first, last = at_ends(point.offset, closed=cells.closed)
            self.way = cells.signs * ((last - first) / t**2)
            reach = tables[0] = reach - self.way
            share = last / cells.box
            begin = sum(map(len, tables))
            self.boxes = slice(begin, begin + 2)
            tables.append(np.where(cells.free, [1 - share, 1 + share], 1.0))
        if cells.passing is not None:
            room = cells.passing - signs * velocity
            tables.append(np.where(np.isfinite(room), room, 1.0))
        if cells.by_segment:
            self.ramping = _sided(started, signs)
            faster = signs * early + cells.falling * self.ramping**2 / 2
            tables.append(np.where(cells.starts, cells.fastest - faster, 1.0))
        values = np.concatenate(tables)[:, None]

        self.cells = cells
        self.point = point
        self.times = times
        self.t = t
        self.mean = mean
        self.steep = steep
        self.profiles = profiles
        self.reach = reach
        self.ramped = ramped
        self.values = values
        self.start_barrier = START_BARRIER_RTOL * times.sum(axis=1) / values[:, 0, 0].size

    def linear(self, multipliers: Array, weights: Array) -> JerkLinearisation:
        """Return the model of a Newton step. `weights`: multiplier over slack, per inequality."""
        return JerkLinearisation(self, multipliers, weights)

    def after(self, step: JerkUnknowns, length: Array) -> Self:
        """Return the inequalities after this length of a step, `(starts,)`.

        1/T changes linearly with the length.
        """
        return type(self)(self.cells, self._stepped(step, length))

    def _stepped(self, step: Any, length: Array) -> Any:
        """Return the point after a step, at which the velocities of the ends are as given."""
        point = moved(self.point, step, length)
        point = point._replace(log=self.point.log - np.log1p(-length[:, None] * step.log))
        if not self.cells.given:
            return point
        ends = np.array(point.ends)
        for end, segment in ((0, 0), (1, -1)):
            t = np.exp(point.log[:, [segment]])
            velocity = self.cells.end_v[end]
            ends[end, :, segment] = (velocity - self.cells.h[:, segment] / t) / t
        return point._replace(ends=ends)

    def follows(self, before: JerkInequalities) -> Bools:
        """Return where slacks keep their least share and states are reachable, `(starts,)`."""
        kept = (self.values / before.values).min(axis=ROW_AXES)
        reachable = self.profiles.reachable.all(axis=(0, 2, 3))
        return np.asarray((kept >= MIN_KEPT_SLACK) & reachable)

    def of(self, some: Bools | Indices) -> Self:
        """Return the inequalities of some of the starts."""
        return type(self)(self.cells.of(some), chosen(self.point, some))

    def with_others(self, others: Sequence[Self]) -> Self:
        """Return the inequalities of these starts, then of the others."""
        cells = self.cells.with_others([own.cells for own in others])
        return type(self)(cells, joined([self.point, *(own.point for own in others)]))

    @cached_property
    def slopes(self) -> Slopes:
        """Derivatives of the inequalities by a cell's variables.

        The first ones of all, the second ones of the displacements.
        """
        reach, second = self.profiles.slopes()
        seen, seen_twice = self.cells.seen
        second *= seen_twice
        signs = self.cells.signs[:2]
        own = self.t * signs
        starts, ends = self.point.ends
        first = np.zeros((5 + 2 * self.cells.tolerant, len(self.values), *self.mean.shape))
        np.multiply(reach, seen, out=first[:5, :REACH])
        first[ACCELERATIONS[1], SLOWER] = -signs
        # dv = T dx − (h/T − T x) ds
        first[TIME, FASTER] = own * (self.steep - ends)
        first[VELOCITIES[1], FASTER] = -own
        first[ACCELERATIONS[1], FASTER] = -self.cells.falling * self.ramped
        if self.cells.given:
            first[:, REACH:LEAST, ..., -1, :] = 0.0
        if self.cells.least is not None:
            first[TIME, LEAST, ..., 0] = self.cells.least > 0
        if self.cells.passing is not None:
            is_passed = np.isfinite(self.cells.passing)
            first[TIME, PASSED] = own * (self.steep - ends) * is_passed
            first[VELOCITIES[1], PASSED] = -own * is_passed
        if self.cells.by_segment:
            first[TIME, EARLY] = own * (self.steep - starts)
            first[VELOCITIES[0], EARLY] = -own
            first[ACCELERATIONS[0], EARLY] = -self.cells.falling * self.ramping
            first[:, EARLY] *= self.cells.starts
        if self.cells.tolerant:
            second = self._slopes_of_offsets(first, second)
        return Slopes(first, second)

    def _slopes_of_offsets(self, first: Array, second: Array) -> Array:
        """Add what depends on the offsets to the first derivatives; return the second ones."""
        cells = self.cells
        before, after = OFFSETS
        by_square = cells.signs / self.t**2
        first[TIME, :REACH] += 2 * self.way
        first[before, :REACH] = by_square * cells.free_before
        first[after, :REACH] = -by_square * cells.free
        first[after, self.boxes] = _UP_AND_DOWN * (cells.free / cells.box)
        wider = np.zeros((7, 7, *second.shape[2:]))
        wider[:5, :5] = second
        wider[TIME, TIME] -= 4 * self.way
        for offset in OFFSETS:
            wider[TIME, offset] = wider[offset, TIME] = -2 * first[offset, :REACH]
        return wider

    @cached_property
    def missing(self) -> Array:
        """Residual of the links in units of the cells' ends, `(2, starts, segments, joints)`."""
        velocity = at_ends(self.point.velocity, self.cells.end_v, self.cells.closed)
        missing = velocity - self.mean - self.t * self.point.ends
        size = np.abs(velocity) + np.abs(self.mean)
        is_rounding = np.abs(missing) <= _ROUNDING_RTOL * size
        return np.where(is_rounding, 0.0, missing / self.t)

    @property
    def apart(self) -> Array:
        """The largest residual of a link, in units of the cells' ends, `(starts,)`."""
        return np.asarray(np.abs(self.missing).max(axis=(0, 2, 3)))


class JerkLinearisation:
    """The program near a point: linear inequalities, a quadratic Lagrangian.

    Args:
        rows: the inequalities at the point.
        multipliers: of the inequalities.
        weights: `z / s` of each inequality, multiplier over slack.
    """

    def __init__(self, rows: JerkInequalities, multipliers: Array, weights: Array) -> None:
        first, second = rows.slopes
        cells = rows.cells
        ends = rows.point.ends
        z = multipliers[:, 0]
        if cells.given:
            z = z.copy()
            z[REACH:LEAST, ..., -1, :] = 0.0
        w = weights[:, 0]
        matrix = np.einsum("ir...,jr...->ij...", w * first, first)
        matrix -= (z[:REACH] * second).sum(axis=2)
        before, after = ACCELERATIONS
        bend = z[FASTER] * cells.falling
        matrix[after, after] += (bend * (rows.ramped != 0) if cells.by_segment else bend).sum(
            axis=0
        )
        gradient = (z[:REACH] * first[:, :REACH]).sum(axis=1)
        # v depends on 1/T and on the `x` of the shorter segment. So the derivatives by v at the
        # other segment's end, and of the velocity limits, count as derivatives by that `x`.
        by_end = gradient[list(VELOCITIES)] / rows.t
        by_velocity = by_end.copy()
        late = z[FASTER] if cells.passing is None else z[FASTER] + z[PASSED]
        by_limits = late * cells.signs[:2]
        by_velocity[1] -= by_limits.sum(axis=0)
        if cells.by_segment:
            early = z[EARLY] * cells.starts
            matrix[before, before] += (early * cells.falling * (rows.ramping != 0)).sum(axis=0)
            by_velocity[0] -= (early * cells.signs[:2]).sum(axis=0)
        of_both_cells = by_velocity + beside_it(by_velocity, cells.closed)
        owned = owners(rows.times, cells.closed)
        mixed = rows.t * (by_end - np.where(owned, of_both_cells, 0.0))
        twice = 2 * mixed * ends
        matrix[TIME, TIME] += twice.sum(axis=0) - gradient[TIME]
        # second derivative of T along a step that is linear in 1/T, shared among the joints
        matrix[TIME, TIME] += rows.t / mixed.shape[-1]
        if cells.least is not None:
            matrix[TIME, TIME] -= z[LEAST] * first[TIME, LEAST]
        for v, by_time in zip(VELOCITIES, mixed, strict=True):
            matrix[TIME, v] += by_time
            matrix[v, TIME] += by_time
        links = Links(rows.steep - ends, rows.missing)
        self.rows = rows
        self.weights = w
        # the residual of a link is one of the velocity's inequality too
        self.missed = np.zeros_like(w)
        self.missed[FASTER] = rows.t * cells.signs[:2] * rows.missing[1]
        if cells.passing is not None:
            self.missed[PASSED] = self.missed[FASTER] * np.isfinite(cells.passing)
        if cells.given:
            self.missed[FASTER, ..., -1, :] = 0.0
        if cells.by_segment:
            self.missed[EARLY] = rows.t * cells.signs[:2] * rows.missing[0] * cells.starts
        self.chain = Chain(rows.times, links, self._by_cell(matrix), cells.closed)

    def slope(self, multipliers: Array) -> Array:
        """Return the largest entry of the right-hand side that belongs to a time, `(starts,)`.

        It includes the residuals of the links: the barrier parameter falls when both are small.
        """
        chain = self.chain
        gradient = chain.descent(self._gradient(multipliers))
        return np.asarray(np.abs(gradient[:, :: chain.layout.width]).max(axis=1))

    def step(self, aim: Array) -> tuple[JerkUnknowns, Array]:
        """Return the Newton step to these multipliers, and its first-order change of the slacks."""
        log, cells, velocity = self.chain.step(self._gradient(aim))
        by_variable = cells.transpose(3, 0, 1, 2)
        tolerant = self.rows.cells.tolerant
        if tolerant:
            by_variable = by_variable[_FROM_CHAIN]
        change = (self.rows.slopes.first * by_variable[:, None]).sum(axis=0) + self.missed
        inner = slice(velocity.shape[1])
        acceleration = by_variable[ACCELERATIONS[1], :, inner]
        offset = by_variable[OFFSETS[1], :, inner] if tolerant else np.zeros_like(velocity)
        step = JerkUnknowns(log, by_variable[list(VELOCITIES)], velocity, acceleration, offset)
        return step, change[:, None]

    def bending(self, step: JerkUnknowns) -> Array:
        """Return the second-order change of every slack by a step."""
        rows = self.rows
        changes = self._changes(step)
        log, _, before, _, after, *_ = changes
        bent = (rows.slopes.second * changes[:, None]).sum(axis=1)
        table = np.zeros_like(self.weights)
        by_times = rows.slopes.first[TIME, :REACH] * log**2
        by_changes = (bent * changes[:, None]).sum(axis=0)
        table[:REACH] = (by_times + by_changes) / 2
        table[FASTER] = -rows.cells.falling * after**2 / 2
        if rows.cells.least is not None:
            table[LEAST] = rows.slopes.first[TIME, LEAST] * log**2 / 2
        if rows.cells.by_segment:
            table[FASTER] *= rows.ramped != 0
            bending = rows.cells.starts * (rows.ramping != 0)
            table[EARLY] = -rows.cells.falling * before**2 / 2 * bending
        return table[:, None]

    def _changes(self, step: JerkUnknowns) -> Array:
        """Return a step over the variables of every cell."""
        cells = self.rows.cells
        changes = np.empty((5 + 2 * cells.tolerant, *step.ends[0].shape))
        changes[TIME] = step.log[..., None]
        changes[list(VELOCITIES)] = step.ends
        changes[list(ACCELERATIONS)] = at_ends(step.acceleration, closed=cells.closed)
        if cells.tolerant:
            changes[list(OFFSETS)] = at_ends(step.offset, closed=cells.closed)
        return changes

    def _by_cell(self, matrix: Array) -> Array:
        """Return the matrix over each cell's variables with the axes in the order of `Chain`."""
        cells = self.rows.cells
        if cells.tolerant:
            # an exact waypoint has no offset: an entry on the diagonal keeps the matrix regular
            matrix[OFFSETS[1], OFFSETS[1]] += ~cells.free
            matrix = matrix[np.ix_(_IN_CHAIN, _IN_CHAIN)]
        return matrix.transpose(2, 3, 4, 0, 1)

    def _gradient(self, multipliers: Array) -> Array:
        """Return the gradient over the cells' variables, the residuals of the links included."""
        pressed = multipliers[:, 0] - self.weights * self.missed
        gradient = (pressed * self.rows.slopes.first).sum(axis=1)
        if self.rows.cells.tolerant:
            gradient = gradient[_IN_CHAIN]
        return gradient.transpose(1, 2, 3, 0)


def _sided(acceleration: Array, signs: Array) -> Array:
    """Return the accelerations that have a side's sign, for both sides, and 0 for the others."""
    return np.where(signs * acceleration > 0, acceleration, 0.0)


def _longer(times: Array, least: Array, shape: tuple[int, ...]) -> Array:
    """Return `log(T / least T)` of each segment, `(1, starts, segments, joints)`.

    It stands in the cell of the first joint. It is 1 in all other cells, and where a segment has no
    least time.
    """
    longer = np.ones((1, *shape))
    own = np.where(least > 0, least, 1.0)
    longer[0, ..., 0] = np.where(least > 0, np.log(times / own), 1.0)
    return longer
