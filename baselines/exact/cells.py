"""The program of `exact.acceleration`, and its Newton steps cell by cell.

A cell is one segment of one joint. Its unknowns are both end velocities and both peaks, counted
from the segment's mean velocity in units of its time (mathematics, section 3); the others are the
logarithms of the segment times and the waypoint velocities. What happens in a cell depends on one
segment time and two waypoint velocities only. So a Newton step eliminates peaks and end velocities
in closed form, all cells at once; what is left is a banded matrix as wide as there are joints, and
its work grows in proportion to the segments.

Small tables cost NumPy's calls, not their numbers. So every table has one more axis, the first: one
start each, all of them at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import scipy  # its parts are imported when they are used: listing needs none
from numpy.typing import NDArray

Array = NDArray[np.float64]

_START_ROOM = 0.98  # of the velocity limits

# Axes from the last: joints, segments, sides (ends, where there are no sides), ends.
_SIDE = -3
_END = -4

# The upper profile, and the lower one seen mirrored: h, u, w and peaks change their signs.
_SIDES = np.array([1.0, -1.0]).reshape(2, 1, 1)


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
        ends: velocities at the start and at the end of each segment, from its mean velocity, in
            units of its time, `(starts, 2, segments, joints)`.
        peaks: of the upper and of the mirrored lower profile, likewise.
    """

    log: Array
    velocity: Array
    ends: Array
    peaks: Array

    def moved(self, step: Point, length: Array) -> Point:
        """The point so far along a step, `(starts,)`."""
        of_vectors = length[:, None]
        of_tables = of_vectors[:, None]
        of_pairs = of_tables[:, None]
        return Point(
            self.log + of_vectors * step.log,
            self.velocity + of_tables * step.velocity,
            self.ends + of_pairs * step.ends,
            self.peaks + of_pairs * step.peaks,
        )


class Rows(NamedTuple):
    """One number for every inequality of the program, and for every start.

    Attributes:
        room: of each peak below the velocity limit, `(starts, 2, segments, joints)`.
        reach: of the displacement beyond `h`, likewise.
    """

    room: Array
    reach: Array


def at_ends(velocity: Array) -> Array:
    """Waypoint velocities at the start and the end of each segment, the motion's ends at rest."""
    *starts, inner, joints = velocity.shape
    ends = np.zeros((*starts, 2, inner + 1, joints))
    ends[..., 0, 1:, :] = velocity
    ends[..., 1, :-1, :] = velocity
    return ends


class Cells:
    """What stays the same from step to step."""

    def __init__(self, scaled: Scaled) -> None:
        v1, v2 = np.abs(scaled.v)
        a1, a2 = np.abs(scaled.a)
        fastest = np.stack([v2, v1])
        # of both sides: what leads from the start to a peak, and from it to the end
        speeding = np.stack([a2, a1])
        braking = np.stack([a1, a2])
        a = np.stack([speeding, braking])
        half = a[:, :1] / 2

        self.segments = len(scaled.h)
        self.joints = len(v1)
        self.rows = int(4 * scaled.h.size)
        self.h = _SIDES * scaled.h
        self.stop = scaled.stop[:, None]
        self.fastest = fastest[:, None]
        self.a = a[:, :, None]
        self.twice_a = 2 * self.a
        self.lowest_ends = -half
        self.highest_ends = half[::-1]
        self.highest_peaks = self.a.sum(axis=0) / 2
        # no velocity is above its limit, nor above accelerating at 1 all the time
        limit = fastest.max(axis=0)
        self.top = np.minimum(limit, self.stop.sum())

    def named(self, flat: Array) -> Rows:
        """The parts, seen not copied, of vectors with a number for every inequality."""
        by_kind = flat.reshape(-1, 2, *self.h.shape)
        return Rows(
            by_kind[:, 0],
            by_kind[:, 1],
        )

    def times(self, log: Array) -> Array:
        """Segment times, `(starts, segments, 1)`."""
        stops = np.exp(log)
        return np.asarray(self.stop * stops[..., None])

    def start(self, times: Array, velocities: Array) -> Point:
        """Within velocity limits; peaks as high as times and limits allow."""
        fastest = _START_ROOM * self.fastest
        highest, lowest = fastest
        velocity = np.clip(velocities, -lowest, highest)
        t = times[..., None]
        by_side = t[:, None]
        mean = self.h / by_side
        excess = at_ends(velocity) - mean[:, :1]
        ends = np.clip(excess / by_side, self.lowest_ends, self.highest_ends)
        # (A1 A2 T + A1 u + A2 w) / (A1 + A2)
        x = _on_both(ends)
        weighted = self.a[::-1] * x
        gained = self.a.prod(axis=0)
        faster = gained + weighted.sum(axis=_END)
        filling = faster / self.a.sum(axis=0)
        allowed = (fastest - mean) / by_side
        peaks = np.minimum(filling, allowed)
        peaks = np.maximum(peaks, x.max(axis=_END))
        log = np.log(t / self.stop)
        point = Point(
            log[..., 0],
            velocity,
            ends,
            peaks,
        )
        return self.clipped(point)

    def clipped(self, point: Point) -> Point:
        """End velocities and peaks no further from the mean than half a limit leads in `T`."""
        ends = np.clip(point.ends, self.lowest_ends, self.highest_ends)
        peaks = np.clip(point.peaks, 0.0, self.highest_peaks)
        return point._replace(ends=ends, peaks=peaks)

    def values(self, point: Point) -> Array:
        """What every inequality leaves, negative where it is broken, `(starts, rows)`."""
        log, _, ends, peaks = point
        t = self.times(log)[:, None]
        x = _on_both(ends)
        flat = np.empty((len(log), self.rows))
        rows = self.named(flat)
        # (V − h/T − p T) / top
        mean = self.h / t
        rows.room[:] = self.fastest
        rows.room[:] -= mean + t * peaks
        rows.room[:] /= self.top
        # p − (p − u)²/(2 A2) − (p − w)²/(2 A1)
        spent = (peaks[:, None] - x) ** 2
        spent /= self.twice_a
        rows.reach[:] = peaks - spent.sum(axis=_END)
        return flat

    def linear(
        self,
        point: Point,
        multipliers: Array,
        weights: Array,
    ) -> Linear:
        """The model of a Newton step from a point.

        Args:
            point: where the rows are linear.
            multipliers: of the rows.
            weights: what their squares count.
        """
        return Linear(
            self,
            point,
            self.named(multipliers),
            self.named(weights),
        )


class Linear:
    """The program near a point: rows linear, the objective quadratic, peaks and ends eliminated.

    With `s` the logarithm of the time `T`, `x` an end velocity and `p` a peak. The matrix over
    them is the Lagrangian's, and each row's gradient squared times its weight.

    Attributes:
        duration: the sum of the segment times.
        apart: the most that an end velocity differs from its waypoint's, in the fastest ones.
    """

    def __init__(
        self,
        cells: Cells,
        point: Point,
        multipliers: Rows,
        weights: Rows,
    ) -> None:
        a = cells.a
        top = cells.top
        _, velocity, ends, peaks = point
        y_room, y_reach = multipliers
        w_room, w_reach = weights
        times = cells.times(point.log)
        t = times[:, None]
        mean = cells.h / t
        steep = mean / t
        x = _on_both(ends)

        # the gradients of room over s and p, of reach over x and p
        spread = t * peaks
        room_s = (mean - spread) / top
        room_p = -t / top
        reach_x = (peaks[:, None] - x) / a
        reach_p = 1 - reach_x.sum(axis=_END)

        # the matrix over x and p
        curved = y_reach[:, None] / a
        weighted = w_reach[:, None] * reach_x
        squared = weighted * reach_x
        xx = curved + squared
        uw = weighted[:, 0] * reach_x[:, 1]
        xp = weighted * reach_p[:, None]
        xp -= curved
        pressed = w_room * room_p
        squared = w_reach * reach_p**2
        pp = curved.sum(axis=_END)
        pp += pressed * room_p
        pp += squared
        # and over s: x counts from the mean velocity, so its share of the Lagrangian bends
        sx = y_reach[:, None] * reach_x
        sp = pressed * room_s
        sp -= y_room * room_p
        bent = sx * (steep[:, None] + x)
        ss = bent.sum(axis=_END)
        ss += w_room * room_s**2
        fastest = mean + spread
        ss += y_room * fastest / top

        # peaks eliminated; then both sides are one
        peak_x = xp / pp[:, None]
        peak_s = sp / pp
        ss -= sp * peak_s
        sx -= xp * peak_s[:, None]
        xx -= xp * peak_x
        uw -= xp[:, 0] * peak_x[:, 1]

        # x = (v − h/T)/T: its slope over s, and what it misses
        at_waypoints = at_ends(velocity)
        in_cells = mean[:, :1] + t * ends
        missing = at_waypoints - in_cells
        relative = np.abs(missing) / top

        self.cells = cells
        self.times = times
        self.t = t
        self.duration = times.sum(axis=(1, 2))
        self.apart = relative.max(axis=(1, 2, 3))
        self.room_s = room_s
        self.room_p = room_p
        self.reach_x = reach_x
        self.reach_p = reach_p
        self.pp = pp
        self.peak_x = peak_x
        self.peak_s = peak_s
        self.ss = ss.sum(axis=_SIDE)
        self.sx = _both(sx)
        self.xx = xx.sum(axis=_SIDE)
        self.uw = uw.sum(axis=_SIDE)
        self.slope_x = steep[:, :1] - ends
        self.missing = missing / t

    def matrix(self) -> Array:
        """The rest over `(s, v)`, segment by segment, as LAPACK's lower band, of every start."""
        segments = self.cells.segments
        joints = self.cells.joints
        slope = self.slope_x
        pulled = self._pulled(slope)
        twice = 2 * self.sx
        along = slope * (twice + pulled)
        ss = self.ss + along.sum(axis=_SIDE)
        sv = self.sx + pulled
        sv /= self.t
        squared = self.t**2
        vv = self.xx / squared
        across = self.uw / self.times**2

        # columns: a segment's time, then the velocities after it; after the last there are none
        rows = joints + 2
        columns = joints + 1
        band = np.zeros((len(ss), rows, segments, columns))
        times = band[..., 0]
        velocities = band[:, :, :-1, 1:]
        diagonal = velocities[:, 0]
        times[:, 0] = ss.sum(axis=-1)
        times[:, 0] += self.times[..., 0]
        diagonal += vv[:, 1, :-1]
        diagonal += vv[:, 0, 1:]
        band[:, 0, -1, 1:] = 1.0
        # a time beside the velocities after it, and the next time beside them
        after = sv[:, 1, :-1]
        before = sv[:, 0, 1:]
        times[:, 1:-1, :-1] = after.swapaxes(1, 2)
        for joint in range(joints):
            velocities[:, joints - joint, :, joint] = before[..., joint]
        velocities[:, -1, :-1] = across[:, 1:-1]
        return band.reshape(len(band), rows, -1)

    def slope(self, multipliers: Array) -> Array:
        """The largest entry of the Lagrangian's gradient, `(starts,)`."""
        by_s, by_x, by_p = self._gradients(multipliers)
        down = self._descent(
            by_s.sum(axis=_SIDE),
            _both(by_x),
        )
        steepest = np.abs(down).max(axis=(1, 2))
        steepest_peak = np.abs(by_p).max(axis=(1, 2, 3))
        return np.asarray(np.maximum(steepest, steepest_peak))

    def step(self, factors: Sequence[Array], aim: Array) -> tuple[Point, Array]:
        """The Newton step to multipliers, and by how much it changes every row.

        Args:
            factors: the Cholesky factors of `matrix`.
            aim: the multipliers, less what the rows' misses cost.
        """
        by_s, by_x, by_p = self._gradients(aim)
        by_s -= self.peak_s * by_p
        by_x -= self.peak_x * by_p[:, None]
        cost = self.sx * self.missing
        by_s = by_s.sum(axis=_SIDE)
        by_s -= cost.sum(axis=_SIDE)
        by_x = _both(by_x)
        by_x -= self._pulled(self.missing)
        columns = self._descent(by_s, by_x)
        for factor, own in zip(factors, columns, strict=True):
            solved, _ = scipy.linalg.lapack.dpbtrs(factor, own.ravel(), lower=1)
            own[:] = solved.reshape(own.shape)

        log = columns[..., 0]
        velocity = columns[:, :-1, 1:]
        s = log[:, None, :, None]
        faster = at_ends(velocity) / self.t
        ends = faster + self.slope_x * s
        ends += self.missing
        x = _on_both(ends)
        led = self.peak_x * x
        peaks = by_p / self.pp
        peaks -= self.peak_s * s
        peaks -= led.sum(axis=_END)
        step = Point(
            log,
            velocity,
            ends,
            peaks,
        )
        return step, self._change(step, x)

    def _change(self, step: Point, x: Array) -> Array:
        """By how much a step changes every row; `x` are its ends, of both sides."""
        s = step.log[:, None, :, None]
        flat = np.empty((len(s), self.cells.rows))
        rows = self.cells.named(flat)
        reached = self.reach_x * x
        rows.room[:] = self.room_s * s
        rows.room[:] += self.room_p * step.peaks
        rows.reach[:] = reached.sum(axis=_END)
        rows.reach[:] += self.reach_p * step.peaks
        return flat

    def _pulled(self, ends: Array) -> Array:
        """The matrix over both ends, times these."""
        other = self.uw[:, None] * ends[:, ::-1]
        return np.asarray(self.xx * ends + other)

    def _gradients(self, numbers: Array) -> tuple[Array, Array, Array]:
        """The rows' gradients times a number each, by s, x and p."""
        room, reach = self.cells.named(numbers)
        by_s = self.room_s * room
        by_x = self.reach_x * reach[:, None]
        by_p = self.room_p * room
        by_p += self.reach_p * reach
        return by_s, by_x, by_p

    def _descent(self, by_s: Array, by_x: Array) -> Array:
        """Gradients over `(s, v)`, a row per segment, less that of the duration."""
        through_x = self.slope_x * by_x
        by_time = by_s + through_x.sum(axis=_SIDE)
        by_end = by_x / self.t
        *segments, joints = by_s.shape
        down = np.zeros((*segments, joints + 1))
        times = down[..., 0]
        velocities = down[:, :-1, 1:]
        times += by_time.sum(axis=-1)
        times -= self.times[..., 0]
        velocities += by_end[:, 1, :-1]
        velocities += by_end[:, 0, 1:]
        return down


def _on_both(ends: Array) -> Array:
    """Ends as both sides see them, the lower one mirrored: `(…, 2, K, n)` to `(…, 2, 2, K, n)`."""
    return np.asarray(ends[:, :, None] * _SIDES)


def _both(by_side: Array) -> Array:
    """Of both sides together, seen from the upper one: `(…, 2, 2, K, n)` to `(…, 2, K, n)`."""
    upper = by_side[:, :, 0]
    lower = by_side[:, :, 1]
    return np.asarray(upper - lower)
