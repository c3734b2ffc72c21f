"""The relaxation behind the lower bound, with every limit (docs/mathematics.md, section 7b).

A segment of duration `T` is described in normalised time, with velocity `v`, scaled acceleration
`α = a T` and scaled jerk `j T²`. The inequalities of a segment are linear in `T`, `S = 1/T`,
`Q = T²` and the states at its ends; `costates.py` computes them. Two relations are not linear: the
curve `(T, 1/T, T²)` of each segment, and `α = a T` on both sides of a waypoint, whose acceleration
`a` two segments share. On a box of segment times and accelerations, linear inequalities enclose
both.

All units are powers of two, so scaling is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import FallingVelocity
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

# Outward rounding, relative, of quantities that result from a few operations.
ROUNDING_RTOL = 2.0**-48
# Entries of a row of costates: T, S, Q of a segment and the states at its ends.
ROW_ENTRIES = 7
_MCCORMICK_ROWS = 4
# Boxes are apart where their centres are, in some joint, this many times both half widths.
APART = 1025 / 1024


class BoundConstraints(NamedTuple):
    """Inequalities `Σ coefficients · x[columns] ≤ bounds`, `(rows, entries)` and `(rows,)`."""

    columns: Indices
    coefficients: Array
    bounds: Array

    def chosen(self, numbers: Indices) -> BoundConstraints:
        """Return some of the rows."""
        return BoundConstraints(
            self.columns[numbers], self.coefficients[numbers], self.bounds[numbers]
        )

    def single(self, number: int) -> BoundConstraints:
        """Return one of the rows."""
        one = slice(number, number + 1)
        return BoundConstraints(self.columns[one], self.coefficients[one], self.bounds[one])


def joined(parts: Sequence[BoundConstraints]) -> BoundConstraints:
    """Put rows one after the other."""
    columns, coefficients, bounds = zip(*parts, strict=True)
    return BoundConstraints(
        np.concatenate(columns), np.concatenate(coefficients), np.concatenate(bounds)
    )


class VariableBounds(NamedTuple):
    """Bounds of the variables, `(variables,)` each."""

    low: Array
    high: Array


class Relaxation:
    """A problem's variables, their first box, and the inequalities that enclose its curves.

    The last variable is always 0. It stands for states at which the motion rests. In a closed
    motion the last waypoint has a state, which is also the first one's. A velocity or acceleration
    that is given at an end is a variable whose lower and upper bound are equal.

    Attributes:
        cutoff: Only motions shorter than this are bounded, in `time_unit`.
        h: Displacements, `(segments, joints)`.
        v, a, j: Sizes of the limits, downwards and upwards, `(2, segments, joints)`. Velocities are
            those that accelerating and braking within the cut-off can reach.
        least: Least times of the segments, `(segments,)`; given times are least times too.
        tolerance: Largest offsets of the waypoints that have a state, `(states, joints)`.
        reduced: Largest decrease of each displacement by these offsets, `(segments, joints)`.
        instants: Indices of the segments that can take next to no time, `(instants,)`.
        given_times: Given times of the segments, 0 where there is none, `(segments,)`.
        waits: Times at rest at the waypoints, s, `(waypoints,)`. They add to the bound, outside
            all variables.
        limited: Where a joint has a jerk limit, on one side at least, `(segments, joints)`.
        jerky: Which joints have one in any segment.
        below, above: Position limits minus each segment's start, `(segments, joints)`. Where
            velocity limits fall, they end where no motion towards the end is allowed.
        falling: Velocity limits that fall towards the ends of a range.
        time, inverse, square: Variables `T`, `S`, `Q`, `(segments,)`.
        velocity, acceleration: Variables `v`, `a` of the waypoints that have a state,
            `(states, joints)`.
        before, after: Variables `a T` of the segments before and after a waypoint, likewise.
        segment_before, segment_after: The segments on both sides of such a waypoint, `(states,)`.
        end_states: Velocities and accelerations at the motion's ends, `(2 orders, 2 ends, joints)`.
        velocity_at, acceleration_at, scaled_at: Variables `v`, `a`, `a T` at the start and the end
            of each segment, `(2 ends, segments, joints)`. Where `a` is given, `scaled_at` is the
            variable `T`, to be multiplied by `scaled_factors`; elsewhere these are 1.
    """

    def __init__(
        self, problem: Problem, cutoff: float, time_unit: float, length_units: Array
    ) -> None:
        limits = problem.limits
        waypoints = problem.waypoints
        lengths = np.asarray(length_units, dtype=float)
        _check_units(time_unit, lengths, problem.joints)
        self.time_unit = time_unit
        self.length_units = lengths
        self.cutoff = cutoff / time_unit
        self.segments = problem.segments
        self.joints = len(lengths)

        self.h = np.diff(waypoints, axis=0) / lengths
        self.a = self._sizes(limits.acceleration, lengths / time_unit**2)
        velocity = self._sizes(limits.velocity, lengths / time_unit)
        route = problem.route
        self.closed = bool(route.demand("closed"))
        r = route.demand("tolerance") / lengths
        self.tolerant = bool(r.any())
        self.tolerance = r[1:] if self.closed else r[1:-1]
        self.reduced = r[:-1] + r[1:]
        units = lengths / time_unit ** np.array([[1.0], [2.0]])
        ends = np.stack([route.start, route.end], axis=1)
        self.end_states = ends / units[:, None]
        # A motion speeds up from its first velocity to a peak and brakes to its last one. A change
        # of velocity takes at least its size over A1 or A2, and both together at most the cut-off.
        slowness = 1 / self.a.max(axis=1)
        gained = (np.abs(self.end_states[0]) * slowness.max(axis=0)).sum(axis=0)
        reached = (self.cutoff + gained) / slowness.sum(axis=0)
        reached *= 1 + ROUNDING_RTOL
        # a closed motion may begin at any velocity
        self.v = velocity if self.closed else np.minimum(velocity, reached)
        self.j = self._sizes(limits.jerk, lengths / time_unit**3)
        self.limited: Bools = np.asarray(np.isfinite(self.j).any(axis=0))
        self.jerky: Bools = np.asarray(self.limited.any(axis=0))
        lowest, highest = limits.position.T
        starts = waypoints[:-1]
        self.below = (lowest - starts) / lengths
        self.above = (highest - starts) / lengths
        # a waypoint within a tolerance has no fixed falling velocity limit
        known = problem.without(FallingVelocity.key) if self.tolerant else problem
        self.falling = _falling(known, time_unit, lengths)
        self.above = np.fmin(self.above, self.falling.room[1])
        self.below = np.fmax(self.below, -self.falling.room[0])
        self.given_times = problem.route.demand("given_times") / time_unit
        self.least = problem.route.demand("least_times") / time_unit + self.given_times
        self.waits = problem.route.demand("dwell")
        overlaps = (np.abs(self.h) <= APART * self.reduced).all(axis=1) & (self.least == 0)
        self.instants = np.flatnonzero(overlaps)
        self._count_variables()

    @classmethod
    def of(cls, problem: Problem, cutoff: float) -> Relaxation:
        """Return the relaxation in units that suit the problem.

        Args:
            problem: Without identical consecutive waypoints; all joints move.
            cutoff: Only motions shorter than this are bounded, s.
        """
        time_unit = float(powers_of_two(cutoff / problem.segments))
        known = problem.limits.in_all_segments(tightest=False)
        largest = np.abs(known.acceleration).max(axis=1)
        lengths = powers_of_two(largest * time_unit**2)
        return cls(problem, cutoff, time_unit, lengths)

    def _sizes(self, pairs: Array, units: Array) -> Array:
        """Return sizes downwards and upwards, `(2, segments, joints)`."""
        sides = np.moveaxis(np.abs(pairs), -1, 0).reshape(2, -1, self.joints)
        return np.broadcast_to(sides / units, (2, self.segments, self.joints))

    def _of_both(self, sizes: Array) -> Array:
        """Return the tighter of both segments, at waypoints with a state: `(2, states, joints)`."""
        return np.minimum(sizes[:, self.segment_before], sizes[:, self.segment_after])

    def _count_variables(self) -> None:
        segments = self.segments
        inner = (segments - (not self.closed), self.joints)
        numbers = np.arange(4 * inner[0] * inner[1])
        states = 3 * segments + numbers.reshape(4, *inner)
        self.segment_before = np.arange(len(states[0]))
        self.segment_after = (self.segment_before + 1) % segments
        self.time = np.arange(segments)
        self.inverse = self.time + segments
        self.square = self.time + 2 * segments
        self.velocity, self.acceleration, self.before, self.after = states
        first = 3 * segments + states.size
        self.given = first + np.arange(self.end_states.size).reshape(self.end_states.shape)
        moves = self.end_states.any()
        first += self.end_states.size if moves else 0
        products = (3, *inner) if self.tolerant else (3, 0, self.joints)
        offsets = first + np.arange(np.prod(products)).reshape(products)
        self.offset, self.offset_before, self.offset_after = offsets
        self.nothing = first + offsets.size
        if not moves:  # every variable costs some rounding
            self.given = np.full_like(self.given, self.nothing)
        self.variables = self.nothing + 1
        self.velocity_at = self._at_ends(self.velocity, self.velocity)
        self.acceleration_at = self._at_ends(self.acceleration, self.acceleration)
        self.scaled_at = self._at_ends(self.after, self.before)
        if self.tolerant:
            self.offset_at = self._at_ends(self.offset_after, self.offset_before)
        self.scaled_factors = np.ones(self.scaled_at.shape)
        for end, segment in ((0, 0), (1, -1)):
            velocity, acceleration = self.end_states[:, end] != 0
            place = end, segment
            variable, rate = self.given[:, end]
            self.velocity_at[place] = np.where(velocity, variable, self.velocity_at[place])
            self.acceleration_at[place] = np.where(acceleration, rate, self.acceleration_at[place])
            scaled = np.where(acceleration, self.time[segment], self.scaled_at[place])
            self.scaled_at[place] = scaled
            self.scaled_factors[place] = np.where(acceleration, self.end_states[1, end], 1.0)

    def _at_ends(self, after: Indices, before: Indices) -> Indices:
        """Variables at both ends of each segment, from those on both sides of waypoints."""
        found = np.full((2, self.segments, self.joints), self.nothing)
        found[0, self.segment_after] = after
        found[1, self.segment_before] = before
        return found

    def at(self, problem: Problem, motion: Trajectory) -> Array:
        """Return a motion's times, velocities and accelerations; other variables are 0."""
        x = np.zeros(self.variables)
        inner = motion.waypoint_times[1 : None if self.closed else -1]
        unit = self.time_unit
        velocities = motion(inner, 1) / self.length_units
        accelerations = motion(inner, 2) / self.length_units
        moving = np.diff(motion.waypoint_times) - self.waits[:-1]
        moving[-1] -= self.waits[-1]
        x[self.time] = moving / unit
        x[self.velocity] = velocities * unit
        x[self.acceleration] = accelerations * unit**2
        x[self.given] = self.end_states
        if self.tolerant:
            places = problem.waypoints[1 : len(inner) + 1]
            away = (motion(inner) - places) / self.length_units
            x[self.offset] = np.clip(away, -self.tolerance, self.tolerance)
        return x

    def row_columns(self, segment: int, joint: int) -> Indices:
        """Return the variables of one segment and joint.

        Returns:
            `T, S, Q`, velocity at both ends, `α` at both ends: `(7,)`. Where the acceleration at an
            end is given, `T` in place of `α` (`row_factors`). With a tolerance also the offsets at
            both ends times `S`: `(9,)`.
        """
        columns = np.full(self.row_entries, self.nothing)
        columns[0] = self.time[segment]
        columns[1] = self.inverse[segment]
        columns[2] = self.square[segment]
        columns[3:5] = self.velocity_at[:, segment, joint]
        columns[5:7] = self.scaled_at[:, segment, joint]
        if self.tolerant:
            columns[7:] = self.offset_at[:, segment, joint]
        return columns

    @property
    def row_entries(self) -> int:
        """Entries of a row of costates."""
        return ROW_ENTRIES + 2 * self.tolerant

    @cached_property
    def every_row_columns(self) -> Indices:
        """The variables of all segments and joints, `(segments, joints, 7)`."""
        return np.array(
            [
                [self.row_columns(segment, joint) for joint in range(self.joints)]
                for segment in range(self.segments)
            ]
        )

    def row_factors(self, segment: int, joint: int) -> Array:
        """Return the factors on the variables of `row_columns`, `(7,)`."""
        factors = np.ones(self.row_entries)
        factors[5:7] = self.scaled_factors[:, segment, joint]
        return factors

    @cached_property
    def every_row_factors(self) -> Array:
        """The factors on the variables of `every_row_columns`, `(segments, joints, 7)`."""
        return np.array(
            [
                [self.row_factors(segment, joint) for joint in range(self.joints)]
                for segment in range(self.segments)
            ]
        )

    def total(self) -> Array:
        """Return the objective `Σ T`, `(variables,)`."""
        objective = np.zeros(self.variables)
        objective[self.time] = 1.0
        return objective

    def root_box(self) -> VariableBounds:
        """Return a box that holds every motion below the cut-off."""
        low = np.zeros(self.variables)
        high = np.zeros(self.variables)
        # |h| ≤ V T
        least = np.abs(self.h)
        if self.tolerant:
            least = least - self.reduced - ROUNDING_RTOL * (least + self.reduced)
            least = np.maximum(least, 0.0)  # boxes may overlap
        forwards = np.copysign(least, self.h) / self.v[1]
        backwards = np.copysign(least, -self.h) / self.v[0]
        shortest = np.maximum(forwards, backwards).max(axis=1)
        low[self.time] = np.maximum(shortest * (1 - ROUNDING_RTOL), self.least)
        high[self.time] = np.where(self.given_times > 0, self.given_times, self.cutoff)
        slowest, fastest = np.fmin(
            self._of_both(self.v), self.falling.allowed[:, self.segment_before + 1]
        )
        low[self.velocity] = -slowest
        high[self.velocity] = fastest
        braking, speeding = self._of_both(self.a)
        low[self.acceleration] = np.where(self.jerky, -braking, 0.0)
        high[self.acceleration] = np.where(self.jerky, speeding, 0.0)
        for state in np.flatnonzero(self.waits[1:-1]):
            at_rest = [self.velocity[state], self.acceleration[state]]
            low[at_rest] = high[at_rest] = 0.0
        low[self.given] = high[self.given] = self.end_states
        if self.tolerant:
            low[self.offset] = -self.tolerance
            high[self.offset] = self.tolerance
        return self.completed(VariableBounds(low, high))

    def completed(self, box: VariableBounds) -> VariableBounds:
        """Return the box with the bounds of `S`, `Q` and `a T` that follow from the others.

        Where `T` may be 0, `S` and what is multiplied by it have infinite ones: rows that hold them
        say nothing (`dual_check.dual_bound`).
        """
        low = box.low.copy()
        high = box.high.copy()
        shortest = low[self.time]
        longest = high[self.time]
        low[self.inverse] = (1 - ROUNDING_RTOL) / longest
        brief = shortest <= 0
        high[self.inverse] = (1 + ROUNDING_RTOL) / np.where(brief, 1.0, shortest)
        low[self.square] = (1 - ROUNDING_RTOL) * shortest**2
        high[self.square] = (1 + ROUNDING_RTOL) * longest**2
        sides = ((self.before, self.segment_before), (self.after, self.segment_after))
        for side, neighbours in sides:
            least, most = _products(
                low[self.acceleration],
                high[self.acceleration],
                shortest[neighbours, None],
                longest[neighbours, None],
            )
            low[side] = least
            high[side] = most
        for side, neighbours in self._offset_sides():
            inverse = self.inverse[neighbours, None]
            least, most = _products(
                low[self.offset], high[self.offset], low[inverse], high[inverse]
            )
            low[side] = np.where(brief[neighbours, None], -np.inf, least)
            high[side] = np.where(brief[neighbours, None], np.inf, most)
        low[self.inverse[brief]] = -np.inf
        high[self.inverse[brief]] = np.inf
        return VariableBounds(low, high)

    def _offset_sides(self) -> list[tuple[Indices, Indices]]:
        """Return the variables offset times `S` before and after waypoints, and their segments."""
        if not self.tolerant:
            return []
        return [(self.offset_before, self.segment_before), (self.offset_after, self.segment_after)]

    def box_rows(self, box: VariableBounds) -> BoundConstraints:
        """Return the inequalities of a box: the cut-off, secants, McCormick's, then ways."""
        parts = (self._cutoff_row(), self._secants(box), self._mccormick(box), self._ways())
        return joined(parts)

    @property
    def entries(self) -> int:
        """Number of entries of a row. Unused ones belong to the variable that is always 0."""
        return max(self.row_entries, self.segments)

    def blank(self, count: int) -> BoundConstraints:
        """Return rows of zeros."""
        shape = (count, self.entries)
        return BoundConstraints(np.full(shape, self.nothing), np.zeros(shape), np.zeros(count))

    def _cutoff_row(self) -> BoundConstraints:
        row = self.blank(1)
        row.columns[0, self.time] = self.time
        row.coefficients[0, self.time] = 1.0
        row.bounds[0] = self.cutoff
        return row

    def _secants(self, box: VariableBounds) -> BoundConstraints:
        """Return the secants `T + lo hi S ≤ lo + hi` and `Q ≤ (lo + hi) T − lo hi`."""
        low = box.low[self.time]
        high = box.high[self.time]
        rows = self.blank(2 * self.segments)
        for curve in (self.inverse, self.square):
            start = 0 if curve is self.inverse else 1
            rows.columns[start::2, 0] = self.time
            rows.columns[start::2, 1] = curve
        rows.coefficients[0::2, 0] = 1.0
        rows.coefficients[0::2, 1] = low * high
        rows.bounds[0::2] = low + high
        rows.coefficients[1::2, 0] = -(low + high)
        rows.coefficients[1::2, 1] = 1.0
        rows.bounds[1::2] = -low * high
        return rows

    def _mccormick(self, box: VariableBounds) -> BoundConstraints:
        """Return McCormick's envelopes of `α = a T`, and of offsets times `S`.

        At a corner `x, t` of the box, `(a − x)(T − t)` has a fixed sign. So `α ≥ x T + t a − x t`
        at the corners low-low and high-high, and `≤` at the two others.
        """
        jerky = np.flatnonzero(self.jerky)
        accelerations = self.acceleration[:, jerky].ravel()
        parts = []
        factors = []
        sides = ((self.before, self.segment_before), (self.after, self.segment_after))
        for side, segments in sides:
            times = np.repeat(self.time[segments], len(jerky))
            factors.append((side[:, jerky].ravel(), accelerations, times))
        # and in the same way the offsets times S
        state, joint = np.nonzero(self.tolerance)
        for side, segments in self._offset_sides():
            inverse = self.inverse[segments[state]]
            factors.append((side[state, joint], self.offset[state, joint], inverse))
        for products, accelerations, times in factors:
            rows = self.blank(_MCCORMICK_ROWS * len(products))
            corners = (
                (-1.0, box.low, box.low),
                (-1.0, box.high, box.high),
                (1.0, box.high, box.low),
                (1.0, box.low, box.high),
            )
            for place, (sign, of_acceleration, of_time) in enumerate(corners):
                corner = slice(place, None, _MCCORMICK_ROWS)
                x = of_acceleration[accelerations]
                t = of_time[times]
                t = np.where(np.isfinite(t), t, 0.0)  # such a row says nothing
                rows.columns[corner, 0] = products
                rows.columns[corner, 1] = times
                rows.columns[corner, 2] = accelerations
                rows.coefficients[corner, 0] = sign
                rows.coefficients[corner, 1] = -sign * x
                rows.coefficients[corner, 2] = -sign * t
                rows.bounds[corner] = -sign * x * t
            parts.append(rows)
        return joined(parts)

    def _ways(self) -> BoundConstraints:
        """`h + p₁ − p₀ ≤ V T` of segments that may take no time, upwards and downwards."""
        rows = self.blank(2 * len(self.instants) * self.joints)
        number = 0
        for segment in self.instants.tolist():
            ends = self._at_ends(self.offset, self.offset)[:, segment]
            for joint in range(self.joints):
                for side, sign in ((0, -1.0), (1, 1.0)):
                    start, end = ends[:, joint]
                    rows.columns[number, :3] = self.time[segment], start, end
                    rows.coefficients[number, 0] = -self.v[side, segment, joint]
                    moves = np.array([start, end]) != self.nothing
                    rows.coefficients[number, 1:3] = np.where(moves, [-sign, sign], 0.0)
                    rows.bounds[number] = -sign * self.h[segment, joint]
                    number += 1
        return rows

    def tangent(self, segment: int, at: float) -> BoundConstraints:
        """Return the tangent to `1/T` at `t > 0`: `S ≥ 2/t − T/t²`, or `−T − t² S ≤ −2t`."""
        row = self.blank(1)
        row.columns[0, 0] = self.time[segment]
        row.columns[0, 1] = self.inverse[segment]
        row.coefficients[0, 0] = -1.0
        row.coefficients[0, 1] = -at * at
        row.bounds[0] = -2 * at
        return row


class FallingRows(NamedTuple):
    """Falling velocity limits of the joints that move, in a relaxation's units.

    Axes of two are the sides, downwards and upwards. Values are NaN, or False, for a joint without
    such a limit.

    Attributes:
        offset, deceleration: `(joints,)`.
        distance: From the start of each segment to the end of the range, `(2, segments, joints)`.
        room: From the start of each segment to where no motion towards the end is allowed, at
            least 0, likewise.
        acts: Whether the motion begins where some velocity is allowed; then it stays where one is.
        allowed: Highest velocity at each waypoint, `(2, waypoints, joints)`.
    """

    offset: Array
    deceleration: Array
    distance: Array
    room: Array
    acts: Bools
    allowed: Array


def _falling(problem: Problem, time_unit: float, lengths: Array) -> FallingRows:
    """Return the falling velocity limits, each number rounded outward."""
    rows = np.full((problem.joints, 4), np.nan)
    own = problem.limits.kinds.get(FallingVelocity.key)
    if isinstance(own, FallingVelocity):
        rows = own.numbers
    offset, deceleration, low, high = rows.T
    offset = offset / (lengths / time_unit)
    deceleration = deceleration / (lengths / time_unit**2)
    waypoints = problem.waypoints
    distance = np.stack([waypoints - low, high - waypoints]) / lengths
    blocked = offset * offset / (2 * deceleration)
    margin = ROUNDING_RTOL * (np.abs(distance) + blocked)
    slack = distance - blocked
    starts = slice(None, -1)
    speed = np.sqrt(np.maximum(2 * deceleration * distance, 0.0))
    allowed = np.maximum(speed * (1 + ROUNDING_RTOL) - offset, 0.0) + ROUNDING_RTOL * offset
    return FallingRows(
        offset=offset,
        deceleration=deceleration,
        distance=distance[:, starts],
        room=np.maximum(slack + margin, 0.0)[:, starts],
        acts=(slack > margin)[:, starts],
        allowed=allowed,
    )


def powers_of_two(values: Array | float) -> Array:
    """Return the powers of two next to positive values; 1 for 0."""
    positive = np.where(np.equal(values, 0.0), 1.0, values)
    exponents = np.round(np.log2(positive))
    return np.exp2(exponents)


def _check_units(time_unit: float, lengths: Array, joints: int) -> None:
    units = np.append(lengths, time_unit)
    mantissas, _ = np.frexp(units)
    if len(lengths) != joints or not (mantissas == 0.5).all():
        expected = f"powers of two, a time and {joints} lengths"
        raise InvalidInput("proof units", expected, value=units.tolist())


def _products(low: Array, high: Array, shortest: Array, longest: Array) -> tuple[Array, Array]:
    """Return the least and the largest product of two intervals, rounded outward."""
    corners = np.stack([low * shortest, low * longest, high * shortest, high * longest])
    margin = ROUNDING_RTOL * np.abs(corners).max(axis=0)
    least = corners.min(axis=0)
    most = corners.max(axis=0)
    return least - margin, most + margin
