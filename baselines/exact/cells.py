"""The program of `exact.acceleration`, cell by cell: its unknowns and its inequalities.

A cell is one segment of one joint. Its unknowns are both end velocities and both peaks, counted
from the segment's mean velocity in units of its time (mathematics, section 3); the others are the
logarithms of the segment times and the waypoint velocities. What happens in a cell depends on one
segment time and two waypoint velocities only.

Small tables cost NumPy's calls, not their numbers, and a call on tables of different shapes costs
three on tables of one. So several starts share every table, what is the same for all of them is
repeated, and the axes of two come first: `(2 ends, 2 sides, starts, segments, joints)`.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from baselines.exact.interior_point import chosen, moved
from trajopt.core.arrays import Array, Bools

if TYPE_CHECKING:
    from baselines.exact.newton_step import Linear


START_BARRIER = 0.1
# Share of the velocity limits that a start uses at most.
_START_ROOM = 0.98

# The upper profile, and the lower one seen mirrored: h, u, w and peaks change their signs.
_SIGNS = np.array([1.0, -1.0])
_SIDES = _SIGNS.reshape(2, 1, 1, 1)


class Scaled(Protocol):
    """A problem without units: see `exact.acceleration.Scaled`."""

    h: Array
    v: Array
    a: Array
    stop: Array


class Point(NamedTuple):
    """The unknowns of every start, or a step of them.

    Attributes:
        log: logarithms of the segment times in stop times, `(starts, segments)`.
        velocity: at the inner waypoints, `(starts, segments - 1, joints)`.
        inner: of the cells, `(2, 2, starts, segments, joints)`: `ends`, then `peaks`.
    """

    log: Array
    velocity: Array
    inner: Array

    @property
    def ends(self) -> Array:
        """Velocities at the start and at the end, from the mean one, in units of the time."""
        return self.inner[0]

    @property
    def peaks(self) -> Array:
        """Peaks of the upper and of the mirrored lower profile, in the units of `ends`."""
        return self.inner[1]


def at_ends(velocity: Array) -> Array:
    """Waypoint velocities at the start and the end of each segment, the motion's ends at rest."""
    starts, inner, joints = velocity.shape
    segments = inner + 1
    shape = (2, starts, segments, joints)
    ends = np.zeros(shape)
    first, last = ends
    first[:, 1:] = velocity
    last[:, :-1] = velocity
    return ends


def with_rest(inner: Array) -> Array:
    """Values at the inner waypoints, zeros at the motion's ends, `(segments + 1, joints)`."""
    waypoints, joints = inner.shape
    ends = np.zeros((waypoints + 2, joints))  # in place of `np.pad`, 50 us slower
    ends[1:-1] = inner
    return ends


def _by_axes_of_two(limits: ArrayLike) -> Array:
    """Limits `(…, joints)`, for tables of so many axes of two."""
    tables = np.asarray(limits)
    return tables[..., None, None, :]


class Cells:
    """The constant tables of the program, repeated for each start."""

    def __init__(self, scaled: Scaled, starts: int) -> None:
        every = (starts, *scaled.h.shape)

        def table(numbers: Array) -> Array:
            axes_of_two = numbers.shape[:-3]
            shape = (*axes_of_two, *every)
            repeated = np.empty(shape)
            repeated[:] = numbers
            return repeated

        v1, v2 = np.abs(scaled.v)
        a1, a2 = np.abs(scaled.a)
        # no velocity is above its limit, nor above accelerating at 1 all the time
        limit = np.maximum(v1, v2)
        whole = scaled.stop.sum()
        top = np.minimum(limit, whole)
        fastest = _by_axes_of_two([v2, v1])
        # of both sides: what leads from the start to a peak, and from it to the end
        speeding = [a2, a1]
        braking = [a1, a2]
        # end velocities and peaks are no further from the mean than half a limit leads in T
        half_a1 = a1 / 2
        half_a2 = a2 / 2
        wide = half_a1 + half_a2
        zero = 0 * wide
        lowest_ends = [-half_a2, -half_a1]
        highest_ends = [half_a1, half_a2]
        lowest = [lowest_ends, [zero, zero]]
        highest = [highest_ends, [wide, wide]]

        self.scaled = scaled
        self.every = every
        self.h = table(_SIDES * scaled.h)
        stops = [scaled.stop] * starts
        self.stop = np.array(stops)
        self.ones = np.ones(every)
        leading = [speeding, braking]
        self.a = table(_by_axes_of_two(leading))
        self.lowest = table(_by_axes_of_two(lowest))
        self.highest = table(_by_axes_of_two(highest))
        # velocities in units of their top
        self.top = table(_by_axes_of_two(top))
        self.h_by_top = self.h / self.top
        self.fastest = table(fastest / top)

    def of(self, starts: int) -> Cells:
        """Return the tables for another number of starts."""
        return Cells(self.scaled, starts)

    def start(self, times: Array, velocities: Array) -> Point:
        """Within velocity limits; peaks as high as times and limits allow.

        Args:
            times: of the segments, `(starts, segments)`.
            velocities: at the inner waypoints, `(starts, segments - 1, joints)`.
        """
        fastest = _START_ROOM * self.fastest * self.top
        inner_limits = fastest[:, :, :-1]
        highest, lowest = inner_limits
        velocity = np.clip(velocities, -lowest, highest)
        t = times[..., None]
        mean = self.h / t
        upper_mean, _ = mean
        excess = at_ends(velocity) - upper_mean
        inner = np.empty_like(self.lowest)
        ends, peaks = inner
        lowest_ends, _ = self.lowest
        highest_ends, _ = self.highest
        np.clip(excess / t, lowest_ends, highest_ends, out=ends)
        # the peak that fills the time: (A1 A2 T + A1 u + A2 w) / (A1 + A2)
        x = both_sides(ends)
        other_a = self.a[::-1]
        weighted = other_a * x
        gained = self.a.prod(axis=0)
        faster = gained + weighted.sum(axis=0)
        filling = faster / self.a.sum(axis=0)
        allowed = (fastest - mean) / t
        limited = np.minimum(filling, allowed)
        faster_end = x.max(axis=0)
        np.maximum(limited, faster_end, out=peaks)
        log = np.log(times / self.stop)
        point = Point(log, velocity, inner)
        return self.clipped(point)

    def clipped(self, point: Point) -> Point:
        """End velocities and peaks where an answer can have them."""
        inner = np.maximum(point.inner, self.lowest)
        np.minimum(inner, self.highest, out=inner)
        return Point(point.log, point.velocity, inner)


class Gradients(NamedTuple):
    """Rows' gradients, each times a number, over what a cell has.

    Attributes:
        s: over the logarithm of the time, `(2 sides, starts, segments, joints)`.
        x: over the end velocities, `(2 ends, 2 sides, starts, segments, joints)`.
        p: over the peak, `(2 sides, starts, segments, joints)`.
    """

    s: Array
    x: Array
    p: Array


class Rows:
    """Every inequality of the program at a point: what it leaves, and how that changes.

    Two rows for each side of a cell: the room of the peak `p` below the velocity limit, and the
    reach of the displacement beyond `h`. Over the logarithm `s` of the time `T`, the end velocities
    `x` and `p` they have the gradients `room_s`, `room_p`, `reach_x` and `reach_p`.

    Attributes:
        values: what is left, negative where a row is broken,
            `(2 kinds, 2 sides, starts, segments, joints)`.
        times: of the segments, `(starts, segments)`.
        t: the same for every joint.
        x: end velocities as both sides see them.
        cruise: velocity of the cruise, in the fastest ones.
    """

    start_slack = 0.1
    min_gap_rtol = 1e-13
    max_log_step = 1.0

    def __init__(self, cells: Cells, point: Point) -> None:
        peaks = point.peaks
        in_stop_times = np.exp(point.log)
        times = cells.stop * in_stop_times
        by_segment = times[..., None]
        t = by_segment * cells.ones
        # (V − h/T − p T) / top
        mean = cells.h_by_top / t
        room_p = -t / cells.top
        falling = room_p * peaks
        cruise = mean - falling
        # p − (p − u)²/(2 A2) − (p − w)²/(2 A1)
        x = both_sides(point.ends)
        risen = peaks - x
        reach_x = risen / cells.a
        spent_each = risen * reach_x
        spent = spent_each[0] + spent_each[1]
        values = np.empty_like(cells.lowest)
        values[0] = cells.fastest - cruise
        values[1] = peaks - spent / 2

        self.cells = cells
        self.point = point
        self.values = values
        self.start_barrier = np.full(len(times), START_BARRIER)
        self.times = times
        self.t = t
        self.x = x
        self.cruise = cruise
        self.room_s = mean + falling
        self.room_p = room_p
        self.reach_x = reach_x
        of_both_ends = reach_x[0] + reach_x[1]
        self.reach_p = 1 - of_both_ends

    def linear(self, multipliers: Array, weights: Array) -> Linear:
        """The model of a Newton step; `weights` are multiplier over slack of each row."""
        from baselines.exact.newton_step import Linear  # it needs the rows

        return Linear(self, multipliers, weights)

    def after(self, step: Point, length: Array) -> Rows:
        """The rows after such a length of a step, clipped."""
        cells = self.cells
        return Rows(cells, cells.clipped(moved(self.point, step, length)))

    def follows(self, before: Rows) -> Bools:
        """Every point is allowed: clipping replaces a line search."""
        return np.ones(len(self.times), dtype=bool)

    def of(self, some: Bools) -> Rows:
        """The rows of some of the starts."""
        return Rows(self.cells.of(int(some.sum())), chosen(self.point, some))

    @cached_property
    def missing(self) -> Array:
        """Residual of the links in units of the cells' ends, `(2, starts, segments, joints)`."""
        mean, _ = self.cells.h / self.t
        excess = at_ends(self.point.velocity) - mean
        return excess / self.t - self.point.ends

    @property
    def apart(self) -> Array:
        """The most that a link misses, in units of the highest velocity, `(starts,)`."""
        missed = np.abs(self.missing * self.room_p)
        return missed.max(axis=(0, 2, 3))

    def gradients(self, numbers: Array) -> Gradients:
        """The rows' gradients times a number each."""
        room, reach = numbers
        by_p = self.room_p * room
        by_p += self.reach_p * reach
        return Gradients(self.room_s * room, self.reach_x * reach, by_p)

    def change(self, step: Point, x: Array) -> Array:
        """By how much a step changes every row; `x` are its ends, of both sides."""
        s = step.log[..., None]
        peaks = step.peaks
        change = np.empty_like(self.values)
        by_time = self.room_s * s
        change[0] = by_time + self.room_p * peaks
        reached = self.reach_x * x
        by_ends = reached[0] + reached[1]
        change[1] = by_ends + self.reach_p * peaks
        return change


def both_sides(ends: Array) -> Array:
    """Ends as both sides see them, the lower one mirrored: `(2, …)` to `(2, 2, …)`."""
    of_each_side = ends[:, None]
    return of_each_side * _SIDES
