"""Starts of a motion that begins or ends in motion: one on each side of every gap in time.

A joint that cannot stop before the next waypoint, `v0² > 2 A h`, passes it before
`(v0 − √(v0² − 2 A h)) / A` or after `(v0 + √(v0² − 2 A h)) / A`, and never in between (mathematics,
section 3). A descent does not cross such a gap. So the starts stand in every interval of time that
the gaps of all joints leave: from the first waypoint on as long as there is no time to stop,
backwards from the last one likewise, and in all combinations.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from baselines.exact.acceleration.profiles import extremes
from baselines.exact.method.scaled import Scaled
from trajopt.core.arrays import Array

MAX_STARTS = 64
# Beside the edge of an interval, as a factor of the time.
_INSIDE = 1.1
# Place of a slow start in an interval of time before a gap.
_SLOW_SHARE = 0.95
# Share of the velocity limits that a start uses at most.
_LIMIT_SHARE = 0.98
# Times at which a segment between two given velocities is tried.
_TRIED = 600
_BORDER_TRIED = 2000
_HALVINGS = 60
# The longest of them, relative to the time in which every joint can stop.
_LONGEST = 4.0

Start = tuple[Array, Array]  # segment times, waypoint velocities


class _Way(NamedTuple):
    """The segments in their order, or in the order backwards in time.

    Attributes:
        h: Displacements, `(segments, joints)`.
        v, a: Limits of velocity and acceleration of each segment, `(2, segments, joints)`.
        stop: Times in which every joint can stop, `(segments,)`.
    """

    h: Array
    v: Array
    a: Array
    stop: Array

    @property
    def backwards(self) -> _Way:
        """Backwards in time: velocities change their signs, and so do their limits."""
        return _Way(-self.h[::-1], -self.v[::-1, ::-1], self.a[:, ::-1], self.stop[::-1])


class _Fast(NamedTuple):
    """The beginning of a way that is passed before the joints have time to stop.

    Attributes:
        times: Of its segments.
        velocities: At the waypoints from the first one on, one more than times.
    """

    times: tuple[float, ...]
    velocities: tuple[Array, ...]


def starts(scaled: Scaled) -> list[Start]:
    """Return segment times and inner velocities in every combination of intervals.

    Args:
        scaled: A problem that begins or ends in motion.
    """
    return list(islice(_starts(scaled), MAX_STARTS))


def _starts(scaled: Scaled) -> Iterator[Start]:
    segments = len(scaled.h)
    whole = (2, *scaled.h.shape)
    v, a = (np.broadcast_to(own.reshape(2, -1, whole[-1]), whole) for own in (scaled.v, scaled.a))
    way = _Way(scaled.h, v, a, scaled.stop)
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
        if between == 1:
            middles = _between(way, begun, u, w)
        elif between > 1:
            times[segments - ended - 1] = _intervals(back, ended, -w)[-1]
            middles = [_intervals(way, begun, u)[-1]]
        else:
            continue
        for middle in middles:
            own = times.copy()
            own[begun] = middle
            yield own, velocities[1:-1]


def borders(scaled: Scaled) -> list[float]:
    """Return every time at which a problem of one segment may become possible, the least first.

    There a joint reaches its waypoint with an extreme profile, or accelerates evenly. The shortest
    of these times that is possible is the optimum: no descent is needed, and none ends where what
    is possible before a gap is one single time.
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
    """Every beginning before the joints can stop, the empty one first; a segment is always left."""
    yield _Fast((), (u,))
    begun = [_Fast((), (u,))]
    for segment in range(len(way.h) - 1):
        longer = []
        for own in begun:
            for time in _intervals(way, segment, own.velocities[-1])[:-1]:
                # as a constant acceleration leads
                w = 2 * way.h[segment] / time - own.velocities[-1]
                low, high = _LIMIT_SHARE * way.v[:, segment]
                velocities = (*own.velocities, np.clip(w, low, high))
                longer.append(_Fast((*own.times, time), velocities))
        yield from longer
        begun = longer


def _between(way: _Way, segment: int, u: Array, w: Array) -> list[float]:
    """A time in every interval in which a segment leads from `u` to `w`, of those tried."""
    v, a, h = way.v[:, segment], way.a[:, segment], way.h[segment]
    low = max(float(np.maximum(h / v[1], h / v[0]).max()), float(np.abs((w - u) / a).max() / 4))
    high = _LONGEST * max(float(_intervals(way, segment, u)[-1]), float(way.stop[segment]), low)
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


def _intervals(way: _Way, segment: int, v0: Array) -> list[float]:
    """Times in every interval that the gaps of all joints leave; the last one has no end.

    The velocities at the segment's end are free.
    """
    h, v, a = way.h[segment], way.v[:, segment], way.a[:, segment]
    # as if every joint moved upwards; one that stays, the way in which it starts
    side = np.where(h == 0, np.where(v0 < 0, -1.0, 1.0), np.sign(h))
    u = side * v0
    distance = side * h
    upwards = side > 0
    braking = np.where(upwards, -a[0], a[1])
    speeding = np.where(upwards, a[1], -a[0])
    top = np.where(upwards, v[1], -v[0])
    earliest = float(_earliest(u, distance, top, speeding).max())
    square = u**2 - 2 * braking * distance
    gaps = []
    for joint in np.flatnonzero((u > 0) & (square > 0)):
        ends = (u[joint] + np.array([-1, 1]) * np.sqrt(square[joint])) / braking[joint]
        gaps.append(ends.tolist())
    low = earliest
    found = []
    for begin, end in sorted(gaps):
        if begin >= low:
            found.append(min((low + begin) / 2, _INSIDE * low) if low > 0 else begin / 2)
            # also as slow as there is time for: the next waypoint may want that
            found.append(low + _SLOW_SHARE * (begin - low))
        low = max(low, end)
    found.append(max(_INSIDE * low, float(way.stop[segment])))
    return [time for time in found if time > 0]


def _earliest(u: Array, way: Array, top: Array, speeding: Array) -> Array:
    """The first passage: to the top speed, then at it."""
    peak = np.sqrt(u**2 + 2 * speeding * way)
    ramp = (top**2 - u**2) / (2 * speeding)
    cruising = (top - u) / speeding + (way - ramp) / top
    return np.where(peak <= top, (peak - u) / speeding, cruising)
