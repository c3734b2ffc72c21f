"""The unknowns of the program of `exact.acceleration`, cell by cell.

A cell is one segment of one joint. Its unknowns are both end velocities and both peaks, counted
from the segment's mean velocity in units of its time (mathematics, section 4). The other unknowns
are the logarithms of the segment times, the waypoint velocities, and the offsets of waypoints that
have a tolerance. The inequalities of a cell depend on one segment time and two waypoints only.

On small arrays the overhead of a NumPy call dominates, and a call that broadcasts costs as much as
three that do not. So several starts share every array, constants are repeated for each start, and
the axes of length two come first: `(2 ends, 2 sides, starts, segments, joints)`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from baselines.exact.method.chain import at_ends
from baselines.exact.method.scaled import Abreast
from trajopt.core.arrays import Array, Bools, Indices

# Barrier parameter of a start. Halved or doubled: 1 to 2 % more steps.
START_BARRIER = 0.1
# Largest share of the velocity limits that an initial guess uses. At 1 it has no slack.
_START_ROOM = 0.98
# Least excess of an initial guess over a least time, relative to it. At 0 it has no slack.
_LATER = 1e-3

# Signs of the upper profile and of the lower one, which is mirrored: h, u, w, peaks change sign.
_SIGNS = np.array([1.0, -1.0])
SIDES = _SIGNS.reshape(2, 1, 1, 1)


class AccelerationUnknowns(NamedTuple):
    """The unknowns of every start, or a step of the unknowns.

    Attributes:
        log: logarithms of the segment times in stop times, `(starts, segments)`.
        velocity: at the inner waypoints; of a closed motion at all waypoints but the first,
            `(starts, waypoints, joints)`.
        inner: of the cells, `(2, 2, starts, segments, joints)`: `ends`, then `peaks`.
        offset: of the same waypoints from their nominal positions, as `velocity`.
    """

    log: Array
    velocity: Array
    inner: Array
    offset: Array

    @property
    def ends(self) -> Array:
        """Return the velocities at both ends, from the mean one, in units of the time."""
        return self.inner[0]

    @property
    def peaks(self) -> Array:
        """Return the peaks of the upper and the mirrored lower profile, in the units of `ends`."""
        return self.inner[1]


def both_sides(ends: Array) -> Array:
    """Return end velocities for both sides, mirrored for the lower one: `(2, …)` to `(2, 2, …)`."""
    of_each_side = ends[:, None]
    return of_each_side * SIDES


class AccelerationTables:
    """The constant tables of the program.

    Args:
        scaled: the problem of each start (`Passing`), all with the same kinds of demands.
    """

    def __init__(self, scaled: Abreast) -> None:
        every = scaled.h.shape

        def table(limits: ArrayLike) -> Array:
            numbers = np.asarray(limits)
            axes_of_two = numbers.shape[:-3]
            repeated = np.empty((*axes_of_two, *every))
            repeated[:] = numbers
            return repeated

        v1, v2 = np.abs(scaled.v)
        a1, a2 = np.abs(scaled.a)
        # A velocity is at most its limit, and at most that of accelerating at 1 for the whole time.
        limit = np.maximum(v1, v2)
        whole = scaled.stop.sum(axis=1)
        top = np.minimum(limit, whole[:, None, None])
        fastest = np.array([v2, v1])
        # For both sides: the acceleration from the start to a peak, and from the peak to the end.
        speeding = [a2, a1]
        braking = [a1, a2]
        # End velocities and peaks are at most half an acceleration limit times T from the mean.
        half_a1 = a1 / 2
        half_a2 = a2 / 2
        wide = half_a1 + half_a2
        zero = 0 * wide
        lowest_ends = [-half_a2, -half_a1]
        highest_ends = [half_a1, half_a2]

        self.scaled = scaled
        self.every = every
        self.h = SIDES * scaled.h
        self.stop = scaled.stop
        self.ones = np.ones(every)
        self.a = table([speeding, braking])
        self.lowest = table([lowest_ends, [zero, zero]])
        self.highest = table([highest_ends, [wide, wide]])
        # velocities in units of their top
        self.top = table(top)
        self.h_by_top = self.h / self.top
        self.fastest = table(fastest / top)
        self.kinds = 2
        self.passing: Array | None = None
        if scaled.by_segment:
            # at a segment's end the next segment's velocity limits count too; the last has none
            low, high = scaled.waypoint_v
            passing = np.full((2, *every), np.inf)
            passing[:, :, : high.shape[1]] = high, -low
            self.passing = passing / top
            self.kinds += 1
        problems: Sequence[Any] = scaled.every
        self.tolerance = np.array([own.tolerance for own in problems])
        self.tolerant = bool(self.tolerance.any())
        if self.tolerant:
            # half width of the box around the waypoint at each cell's end; 1 for an exact waypoint
            box = np.zeros(every)
            box[:, : self.tolerance.shape[1]] = self.tolerance
            self.free = box > 0
            self.box = np.where(self.free, box, 1.0)
            self.free_before, _ = self.offsets(np.sign(self.tolerance))
            self.kinds += 1
        self.latest = np.array([own.latest for own in problems])
        self.bounded = np.array([scaled.least > 0, np.isfinite(self.latest)])
        self.timed = bool(self.bounded.any())
        self.kinds += self.timed

    def of(self, some: Bools | Indices) -> Self:
        """Return the tables of some of the starts."""
        return type(self)(self.scaled.of(some))

    def with_others(self, others: Sequence[Self]) -> Self:
        """Return the tables of these starts, then of the others."""
        return type(self)(self.scaled.with_others([own.scaled for own in others]))

    def at_ends(self, velocity: Array) -> Array:
        """Return waypoint velocities at the start and the end of each segment."""
        return at_ends(velocity, self.scaled.end_v, self.scaled.closed)

    def offsets(self, offset: Array) -> Array:
        """Return the offsets at the start and the end of each segment, 0 at the motion's ends."""
        return at_ends(offset, closed=self.scaled.closed)

    def start(self, times: Array, velocities: Array, offset: Array) -> AccelerationUnknowns:
        """Return a point within velocity limits, with peaks as high as times and limits allow.

        Its times are not below the least ones, its offsets are within their boxes.

        Args:
            times: of the segments, `(starts, segments)`.
            velocities: at the waypoints with a state, `(starts, waypoints, joints)`.
            offset: of these waypoints from their nominal positions, likewise.
        """
        h = self.h
        if self.timed:
            times = np.maximum(times, self.scaled.least * (1 + _LATER))
        if self.tolerant:
            box = _START_ROOM * self.tolerance
            offset = np.clip(offset, -box, box)
            first, last = self.offsets(offset)
            h = h + SIDES * (last - first)
        fastest = _START_ROOM * self.fastest * self.top
        both = np.minimum(fastest, np.roll(fastest, -1, axis=2))
        if self.passing is not None:
            both = np.minimum(both, _START_ROOM * self.passing * self.top)
        inner_limits = both[:, :, : velocities.shape[1]]
        highest, lowest = inner_limits
        velocity = np.clip(velocities, -lowest, highest)
        t = times[..., None]
        mean = h / t
        upper_mean, _ = mean
        excess = self.at_ends(velocity) - upper_mean
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
        if self.tolerant:
            inner += self._shift(offset, t)
        log = np.log(times / self.stop)
        return self.clipped(AccelerationUnknowns(log, velocity, inner, offset))

    def clipped(self, point: AccelerationUnknowns) -> AccelerationUnknowns:
        """Return the point with ends and peaks clipped to where an answer can have them."""
        inner = point.inner
        if self.tolerant:
            shift = self._shift(point.offset, (self.stop * np.exp(point.log))[..., None])
            inner = np.clip(inner - shift, self.lowest, self.highest) + shift
        else:
            inner = np.maximum(inner, self.lowest)
            np.minimum(inner, self.highest, out=inner)
        return point._replace(inner=inner)

    def _shift(self, offset: Array, t: Array) -> Array:
        """Return by how much offsets move the mean velocity from which bounds of `inner` count.

        Ends and peaks themselves count from the mean velocity between the nominal waypoints.
        """
        first, last = self.offsets(offset)
        mean = (last - first) / t**2
        return np.array([[mean, mean], mean * SIDES])
