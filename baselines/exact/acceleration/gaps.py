"""Initial guesses where a motion begins or ends in motion: one on each side of every gap in time.

A joint begins at the velocity `v0` and cannot stop before the next waypoint: `v0² > 2 A h`. It can
pass this waypoint before `(v0 − √(v0² − 2 A h)) / A` or after `(v0 + √(v0² − 2 A h)) / A`, but not
in between (mathematics, section 4). A descent rarely crosses such a gap. So there is an initial
guess in every interval of time between the gaps of all joints. The first segment has such
intervals, and each next one as long as the joints have had no time to stop. Backwards from the last
segment it is the same. The guesses are all combinations of these intervals.

An interval may be a single time: one joint speeds up throughout the segment and another one brakes
throughout it, or one brakes throughout it to the velocity limit of the next segment. A part of an
optimal motion often has such a segment. So the guesses before a gap are
also tried with times that stay between the middles of the gaps (`before_gaps`).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from baselines.exact.acceleration.profiles import extremes
from baselines.exact.method.scaled import Scaled
from trajopt.core.arrays import Array

MAX_STARTS = 64  # combinations of intervals that are tried; fewer may miss that of the optimum
# Time of a guess, relative to the start of its interval. At 1 it has no slack; a large one may be
# behind the optimum of another joint.
_INSIDE = 1.1
# Place of a second, slower guess in an interval before a gap, as a share of the interval: near its
# end, where the velocity at the next waypoint is least. At 1 it has no slack.
_SLOW_SHARE = 0.95
# Longest over least time of an interval that counts as a single time: it may be one, and the
# velocity before it is a guess. Smaller: that guess hides such a time. Larger: an interval with an
# inside gets one guess, not two.
_ONE_TIME = 1 + 1e-6
# Largest share of the velocity limits that a guess uses. At 1 it has no slack, and of a motion of
# three segments under jerk limits one part takes 12 % too long (seed 77 of `moving_ends`).
_LIMIT_SHARE = 0.98
# Number of times that are tried for a segment between two given velocities, and for a problem of
# one segment; there each edge of an interval is then halved so many times, to rounding. Fewer
# times: an interval between two of them is missed.
_TRIED = 600
_BORDER_TRIED = 2000
_HALVINGS = 60
_TINY = 1e-300  # in place of the velocity 0 of a joint that rests
# The longest time that is tried, relative to the time in which every joint can stop. Larger: the
# same number of times is sparser. Smaller: intervals beyond it are missed.
_LONGEST = 4.0


class _Way(NamedTuple):
    """The segments in the order of time, or backwards in time.

    Attributes:
        h: Displacements, `(segments, joints)`.
        v, a: Limits of velocity and acceleration of each segment, `(2, segments, joints)`.
        stop: Times in which every joint can stop, `(segments,)`.
        passing: Velocity limits at the waypoints, `(2, segments + 1, joints)`.
    """

    h: Array
    v: Array
    a: Array
    stop: Array
    passing: Array

    @property
    def backwards(self) -> _Way:
        """Return the segments backwards in time, where velocities and their limits change sign."""
        v, passing = (-own[::-1, ::-1] for own in (self.v, self.passing))
        return _Way(-self.h[::-1], v, self.a[:, ::-1], self.stop[::-1], passing)


class _Interval(NamedTuple):
    """Times between the gaps of all joints, in which a segment may be passed.

    Attributes:
        low, high: Its least time and its longest one; the last interval has no longest one.
        earliest, latest: The middles of the gaps before it and after it.
    """

    low: float
    high: float = np.inf
    earliest: float = 0.0
    latest: float = np.inf

    @property
    def times(self) -> list[float]:
        """Return times of guesses within the interval, or beyond the last gap."""
        low, high = self.low, self.high
        if np.isinf(high):
            return [_INSIDE * low]
        early = min((low + high) / 2, _INSIDE * low) if low > 0 else high / 2
        if high <= _ONE_TIME * low:
            return [early]
        # a slower guess too: the next segment may require a low velocity
        return [early, low + _SLOW_SHARE * (high - low)]


class _Fast(NamedTuple):
    """Times and velocities of the first segments, in which the joints have no time to stop.

    Attributes:
        times: Of these segments; none where the joints can stop in the first one.
        velocities: At their waypoints, one more than times, `(joints,)` each.
        first: The interval of the first segment's time; None where there is no segment.
    """

    times: tuple[float, ...]
    velocities: tuple[Array, ...]
    first: _Interval = _Interval(0.0)


class Start(NamedTuple):
    """An initial guess.

    Attributes:
        times: Of the segments, `(segments,)`.
        velocities: At the inner waypoints, `(segments - 1, joints)`.
        between: Times of the segments in the gaps before and after the guess, `(2, segments)`; 0
            and infinite where there is none.
    """

    times: Array
    velocities: Array
    between: Array


def starts(scaled: Scaled) -> list[tuple[Array, Array]]:
    """Return initial guesses, segment times and inner velocities, in every combination.

    Args:
        scaled: A problem that begins or ends in motion.
    """
    return [own[:2] for own in islice(_starts(scaled, scaled.stop), MAX_STARTS)]


def before_gaps(scaled: Scaled) -> list[Start]:
    """Return the initial guesses in intervals before a gap of the first or the last segment.

    A descent from there may cross a gap unless the times are kept between the middles of the gaps.
    After the gaps there is time to stop in some guesses, and in others just time to come back.

    Args:
        scaled: A problem that begins or ends in motion, with limits that are wide enough for an
            interval of a single time to have a width.
    """
    found: list[Start] = []
    for stop in (scaled.stop, 0 * scaled.stop):
        own = (start for start in _starts(scaled, stop) if np.isfinite(start.between[1]).any())
        known = {start.times.tobytes() for start in found}
        found += (start for start in islice(own, MAX_STARTS) if start.times.tobytes() not in known)
    return found


def _starts(scaled: Scaled, stop: Array) -> Iterator[Start]:
    segments = len(scaled.h)
    whole = (2, *scaled.h.shape)
    v, a = (np.broadcast_to(own.reshape(2, -1, whole[-1]), whole) for own in (scaled.v, scaled.a))
    passing = np.concatenate([v[:, :1], v], axis=1)
    passing[:, 1:-1] = scaled.waypoint_v
    way = _Way(scaled.h, v, a, stop, passing)
    back = way.backwards
    start, end = scaled.end_v
    for first, last in product(_fast(way, start), _fast(back, -end)):
        begun, ended = len(first.times), len(last.times)
        between = segments - begun - ended
        u, w = first.velocities[-1], -last.velocities[-1]
        velocities = np.zeros((segments + 1, len(u)))
        velocities[: begun + 1] = first.velocities
        velocities[segments - ended :] = [-v for v in last.velocities[::-1]]
        times = np.array(scaled.stop)
        times[:begun] = first.times
        times[segments - ended :] = last.times[::-1]
        around = np.tile([[0.0], [np.inf]], segments)
        for segment, interval in ((-1, last.first), (0, first.first)):
            around[:, segment] = interval.earliest, interval.latest
        if between == 1:
            middles = _between(way, begun, u, w)
        elif between > 1:
            times[segments - ended - 1] = _last_time(back, ended, -w)
            middles = [_last_time(way, begun, u)]
        elif between == 0:
            velocities[begun] = (u + w) / 2
            middles = [times[-1]] if begun == segments else [times[begun]]
        else:
            continue
        for middle in middles:
            own = times.copy()
            own[min(begun, segments - 1)] = middle
            yield Start(own, velocities[1:-1], around)


def borders(scaled: Scaled) -> list[float]:
    """Return the times at which a problem of one segment may become possible, in order.

    At such a time one joint reaches its waypoint with an extreme profile, or with constant
    acceleration. The first of these times that is possible for all joints is the optimum. It is
    found without a descent, also where a gap leaves one single time before it.
    """
    (u, w), h = scaled.end_v, scaled.h[0]
    v, a = (own.reshape(2, -1, len(h))[:, 0] for own in (scaled.v, scaled.a))
    low = max(float(scaled.shortest[0]), float(np.abs((w - u) / a).max()) / 4, 1e-9)
    times = np.geomspace(0.99 * low, _LONGEST * max(float(scaled.stop[0]), low), _BORDER_TRIED)

    def beyond(t: Array) -> Array:
        reach = extremes(u, w, t, v, a)
        return np.stack([reach.d_up - h, h - reach.d_lo])

    with np.errstate(all="ignore"):
        values = beyond(times[:, None])
        side, place, joint = np.nonzero(values[:, 1:] * values[:, :-1] <= 0)
        first, last = times[place], times[place + 1]
        rising = values[side, place + 1, joint] > 0
        for _ in range(_HALVINGS):
            middle = (first + last) / 2
            found = beyond(middle[:, None])[side, np.arange(len(side)), joint]
            is_after = (found > 0) == rising
            first, last = np.where(is_after, first, middle), np.where(is_after, middle, last)
    evenly = ((w - u) / a).ravel()
    every = np.concatenate([first, last, evenly[evenly > 0]])
    return sorted(every.tolist())


def _fast(way: _Way, u: Array) -> Iterator[_Fast]:
    """Yield every combination of intervals before the joints can stop, first that of no segment."""
    yield _Fast((), (u,))
    begun = [_Fast((), (u,))]
    for segment in range(len(way.h)):
        longer = []
        for own in begun:
            for interval in _intervals(way, segment, own.velocities[-1])[:-1]:
                first = own.first if segment else interval
                for time in interval.times:
                    # velocity at the end of a constant acceleration
                    w = 2 * way.h[segment] / time - own.velocities[-1]
                    low, high = _LIMIT_SHARE * way.v[:, segment]
                    velocities = (*own.velocities, np.clip(w, low, high))
                    longer.append(_Fast((*own.times, time), velocities, first))
        yield from longer
        begun = longer


def _between(way: _Way, segment: int, u: Array, w: Array) -> list[float]:
    """Return a time of every interval in which a segment leads from velocity `u` to `w`."""
    v, a, h = way.v[:, segment], way.a[:, segment], way.h[segment]
    low = max(float(np.maximum(h / v[1], h / v[0]).max()), float(np.abs((w - u) / a).max() / 4))
    high = _LONGEST * max(_last_time(way, segment, u), float(way.stop[segment]), low)
    times = np.geomspace(max(low, high * 1e-6), high, _TRIED)
    t = times[:, None]
    braking, speeding = a
    with np.errstate(all="ignore"):
        reach = extremes(u + 0 * t, w + 0 * t, t, v, a)
        kept = (braking * t <= w - u) & (w - u <= speeding * t)
        kept &= (reach.d_lo <= h) & (h <= reach.d_up)
    inside = np.concatenate([[False], kept.all(axis=1), [False]])
    edges = np.flatnonzero(inside[1:] != inside[:-1])
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [float(times[min((first + after) // 2, first + 5)]) for first, after in pairs]


def _last_time(way: _Way, segment: int, v0: Array) -> float:
    """Return the time of a guess after all gaps, in which every joint can stop."""
    (time,) = _intervals(way, segment, v0)[-1].times
    return max(time, float(way.stop[segment]))


def _intervals(way: _Way, segment: int, v0: Array) -> list[_Interval]:
    """Return the intervals between the gaps of all joints; the last one has no end.

    The velocities at the segment's end are free.
    """
    h, v, a = way.h[segment], way.v[:, segment], way.a[:, segment]
    # mirrored so that displacements are positive; where one is 0, the first velocity
    side = np.where(h == 0, np.where(v0 < 0, -1.0, 1.0), np.sign(h))
    u = side * v0
    distance = side * h
    upwards = side > 0
    braking = np.where(upwards, -a[0], a[1])
    speeding = np.where(upwards, a[1], -a[0])
    top = np.where(upwards, v[1], -v[0])
    low, high = way.passing[:, segment + 1]
    last = np.minimum(np.where(upwards, high, -low), top)
    earliest = float(_earliest(u, distance, top, last, speeding, braking).max())
    square = u**2 - 2 * braking * distance
    gaps = []
    for joint in np.flatnonzero((u > 0) & (square > 0)):
        ends = (u[joint] + np.array([-1, 1]) * np.sqrt(square[joint])) / braking[joint]
        gaps.append(ends.tolist())
    low = earliest
    before = 0.0
    found = []
    for begin, end in sorted(gaps):
        if begin > 0 and begin * _ONE_TIME >= low:
            found.append(_Interval(min(low, begin), max(low, begin), before, (begin + end) / 2))
        if end > low:
            low, before = end, (begin + end) / 2
    return [*found, _Interval(low)]


def _earliest(
    u: Array, way: Array, top: Array, last: Array, speeding: Array, braking: Array
) -> Array:
    """Return each joint's least time: it speeds up, cruises, and brakes to the limit at the end.

    A joint that cannot brake to it before the end gets the time of braking, which is in its gap.
    """
    # without a limit between: it speeds up to `peak`, then brakes to `last` if that is slower
    free = np.sqrt(u**2 + 2 * speeding * way)
    both = 2 * speeding * braking * way + braking * u**2 + speeding * last**2
    peak = np.where(free <= last, free, np.sqrt(both / (speeding + braking)))
    peak = np.minimum(np.maximum(peak, u), top)
    end = np.minimum(peak, last)
    ramps = (peak**2 - u**2) / (2 * speeding) + (peak**2 - end**2) / (2 * braking)
    cruising = np.maximum(way - ramps, 0.0) / np.maximum(peak, _TINY)
    return (peak - u) / speeding + (peak - end) / braking + cruising
