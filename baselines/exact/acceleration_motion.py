"""The motion through given waypoint velocities without a jerk limit (mathematics, section 3).

In each segment each joint takes the profile of least acceleration, at most two ramps and a cruise.
Those joints that need all of their limits decide when a segment's breaks are; the others have time
to spare, so that a break of theirs a millionth of the segment beside another joint's, or beside a
waypoint, moves there, and where the profile leaves the joint's position limits it is the one that
strays least. Each joint's peak follows from its breaks and its displacement.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from baselines.exact.acceleration_profiles import Ramps, extremes, gentlest, straightest
from trajopt.core.arrays import Array, Bools

# Breaks no further apart than this share of a segment become one where limits allow it.
_SLIVER = 1e-6
# Share of the unused acceleration that a joint keeps, so that breaks can move.
_KEPT_SHARE = 1e-3
# With less unused acceleration, relative to the limit, there is only one motion.
_LEAST_SPARE = 1e-6
# Rounding, relative to a limit or to the way that a joint travels.
_EXCESS_RTOL = 1e-12
# Breaks of a segment that only rounding keeps apart, relative to its time, are one.
_ROUNDING_RTOL = 4e-15


Sides = Array | tuple[Array, Array]  # low first


class Task(NamedTuple):
    """The motion required of every joint in every segment, in the joint's own units.

    Attributes:
        times: of the segments, `(segments, 1)`.
        h: displacements, `(segments, joints)`.
        u: velocities at the segments' starts, likewise.
        w: velocities at their ends, likewise.
        v: velocity limits, `(2, joints)`, low first.
        a: acceleration limits, likewise.
        q: where the segments start, `(segments, joints)`.
        positions: position limits, `(2, joints)`, low first.
    """

    times: Array
    h: Array
    u: Array
    w: Array
    v: Array
    a: Array
    q: Array
    positions: Array


class _Breaks(NamedTuple):
    """Times since the segment's start, `(segments, joints)`; the end is `(segments, 1)`."""

    first: Array  # end of the first ramp
    last: Array  # start of the last ramp
    end: Array

    def where(self, chosen: Bools, others: _Breaks) -> _Breaks:
        """Others where they are chosen `(segments, joints)`."""
        first = np.where(
            chosen,
            others.first,
            self.first,
        )
        last = np.where(
            chosen,
            others.last,
            self.last,
        )
        return self._replace(first=first, last=last)

    def moved(self, priority: Array, closest: Array) -> _Breaks:
        """Breaks of a segment that are no further apart than `closest`, at one place.

        That is the break of highest `priority` `(segments, joints)`, or the segment's start or end.
        """
        inner = np.concatenate([self.first, self.last], axis=1)
        if not self._crowded(closest):
            return self
        priorities = np.hstack([priority, priority])
        order = np.argsort(inner, axis=1)
        times = np.take_along_axis(
            inner,
            order,
            axis=1,
        )
        ranks = np.take_along_axis(
            priorities,
            order,
            axis=1,
        )
        # neighbours that are as close form a group
        steps = np.diff(times, axis=1)
        is_new = np.ones(times.shape, dtype=bool)
        is_new[:, 1:] = steps > closest
        group = np.cumsum(is_new)
        group -= 1
        # the highest of each group comes last
        by_rank = np.lexsort((ranks.ravel(), group))
        sizes = np.bincount(group)
        highest = by_rank[np.cumsum(sizes) - 1]
        leaders = times.ravel()[highest]
        shared = leaders[group]
        moved = np.empty_like(inner)
        np.put_along_axis(
            moved,
            order,
            shared.reshape(inner.shape),
            axis=1,
        )
        moved = np.where(self.end - moved <= closest, self.end, moved)
        moved = np.where(moved <= closest, 0.0, moved)
        first, last = np.hsplit(moved, 2)
        return self._replace(first=first, last=last)

    def sorted(self) -> Array:
        """All breaks of each segment in order, its ends among them, `(segments, breaks)`."""
        times = np.hstack([np.zeros_like(self.end), self.first, self.last, self.end])
        times.sort(axis=1)
        return times

    def _crowded(self, closest: Array) -> bool:
        """Return whether two distinct breaks are that close, or one is that close to an end."""
        times = self.sorted()
        steps = np.diff(times, axis=1)
        crowded = (steps > 0) & (steps <= closest)
        return bool(crowded.any())


class _Profiles(NamedTuple):
    """Velocity profiles over breaks, three pieces each."""

    lengths: Array  # `(3, segments, joints)`
    velocity: Array  # at the breaks, `(4, segments, joints)`
    acceleration: Array

    @property
    def travelled(self) -> Array:
        """The displacement over each piece."""
        before = self.velocity[:-1]
        after = self.velocity[1:]
        mean = (before + after) / 2
        return self.lengths * mean

    @property
    def starts(self) -> Array:
        """The displacement before each piece."""
        displacement = np.zeros_like(self.lengths)
        displacement[1:] = np.cumsum(self.travelled[:-1], axis=0)
        return displacement


def pieces(task: Task) -> tuple[Array, Array]:
    """The motion of all joints, on breaks that they share.

    Returns:
        Lengths of the pieces, `(pieces, segments)`, some of them 0, and the accelerations,
        `(pieces, segments, joints)`.
    """
    between = task.u, task.w, task.times
    limits = task.v, task.a
    # rounding may ask for a little more than limits allow
    reach = extremes(*between, *limits)
    task = task._replace(h=np.clip(task.h, reach.d_lo, reach.d_up))
    ramps = gentlest(*between, task.h, *limits)
    if np.isfinite(task.positions).any():
        ramps = _within_positions(ramps, task)
    breaks = _apart(ramps, task)
    profiles = _covering(breaks, task)
    # over a brief piece, rounding of the velocities shows
    braking, cruising, speeding = np.clip(profiles.acceleration, *task.a)
    own = breaks.sorted().T
    middles = (own[:-1] + own[1:])[..., None] / 2
    is_first = middles < breaks.first
    is_last = middles > breaks.last
    acceleration = np.where(is_first, braking, np.where(is_last, speeding, cruising))
    return np.diff(own, axis=0), acceleration


def _within_positions(ramps: Ramps, task: Task) -> Ramps:
    """Ramps that stray least, where these ones leave the position limits."""
    spare = np.maximum(1 - ramps.share, 0.0)
    # joints that decide the segment's time have no choice
    has_choice = spare > _LEAST_SPARE
    leaves = has_choice & _leaves_positions(ramps, task)
    taken = 1 - _KEPT_SHARE * spare
    cruise, first, last = straightest(
        task.u,
        task.w,
        task.times,
        task.h,
        taken * task.a[:, None],
    )
    return Ramps(
        np.where(
            leaves,
            cruise,
            ramps.peak,
        ),
        np.where(
            leaves,
            first,
            ramps.first,
        ),
        np.where(
            leaves,
            last,
            ramps.last,
        ),
        ramps.share,
    )


def _leaves_positions(ramps: Ramps, task: Task) -> Bools:
    """Which joints leave their position limits, in which segments: waypoints are within them."""
    peak = ramps.peak
    cruise = task.times - ramps.first - ramps.last
    lengths = np.array([ramps.first, cruise, ramps.last])
    velocity = np.array([task.u, peak, peak, task.w])
    profiles = _profiles(lengths, velocity)
    before = velocity[:-1]
    after = velocity[1:]
    # velocity vanishes v₀ T/(v₀ − v₁) into a piece; its mean until then is v₀/2
    turns = before * after < 0
    elapsed = np.divide(
        before * lengths,
        before - after,
        out=np.zeros_like(lengths),
        where=turns,
    )
    turning = profiles.starts + before * elapsed / 2
    return _beyond(task.q + turning, task.positions)


def _apart(ramps: Ramps, task: Task) -> _Breaks:
    """The breaks of these ramps, none too close to others where limits allow that."""
    end = task.times
    first = np.minimum(ramps.first, end)
    last = np.maximum(first, end - ramps.last)
    own = _Breaks(first, last, end)
    # the place of a waypoint, or of another joint's break
    shared = own.moved(ramps.share, _SLIVER * end)
    allowed = _allowed(_covering(shared, task), task)
    return own.where(allowed, shared).moved(ramps.share, _ROUNDING_RTOL * end)


def _covering(breaks: _Breaks, task: Task) -> _Profiles:
    """The profiles that have these breaks: their peaks cover the displacement.

    Without the first ramp velocity changes evenly from the start to where the last one begins, and
    likewise at the end.
    """
    u = task.u
    w = task.w
    first = breaks.first
    middle = breaks.last - first
    last = breaks.end - breaks.last
    lengths = np.array([first, middle, last])
    has_first = first > 0
    has_last = last > 0
    speeds_up = has_first & (middle + last > 0)
    slows_down = has_last & (first + middle > 0)
    # 2 h = (u + v1) t1 + (v1 + v2) t2 + (v2 + w) t3, where v1, v2 are the peak p, or u, w
    by_first = np.where(
        speeds_up,
        first + middle,
        0.0,
    )
    by_last = np.where(
        slows_down,
        middle + last,
        0.0,
    )
    weight = by_first + by_last
    from_u = u * np.where(
        speeds_up,
        first,
        middle,
    )
    from_w = w * np.where(
        slows_down,
        last,
        middle,
    )
    known = from_u + from_w
    peak = np.divide(
        2 * task.h - known,
        weight,
        out=np.zeros_like(u),
        where=weight > 0,
    )
    # a ramp that is all of the segment leads from one end to the other
    before = np.where(
        has_first,
        w,
        u,
    )
    before = np.where(
        speeds_up,
        peak,
        before,
    )
    after = np.where(
        has_last,
        u,
        w,
    )
    after = np.where(
        slows_down,
        peak,
        after,
    )
    velocity = np.array([u, before, after, w])
    return _profiles(lengths, velocity)


def _profiles(lengths: Array, velocity: Array) -> _Profiles:
    steps = velocity[1:] - velocity[:-1]
    acceleration = np.divide(
        steps,
        lengths,
        out=np.zeros_like(lengths),
        where=lengths > 0,
    )
    return _Profiles(
        lengths,
        velocity,
        acceleration,
    )


def _allowed(profiles: _Profiles, task: Task) -> Bools:
    """Which joints keep their limits, and cover their displacement, in which segments."""
    wider = 1 + _EXCESS_RTOL
    # in a brief segment rounding of the velocities at its ends is much of what it gains
    rounding = _ROUNDING_RTOL * (np.abs(task.u) + np.abs(task.w)) / task.times
    braking, speeding = wider * task.a
    steep = _beyond(profiles.acceleration, (braking - rounding, speeding + rounding))
    fast = _beyond(profiles.velocity[1:3], wider * task.v)
    travelled = profiles.travelled.sum(axis=0)
    missed = np.abs(travelled - task.h)
    speeds = np.abs(profiles.velocity)
    fastest = np.maximum(speeds[:-1], speeds[1:])
    paths = profiles.lengths * fastest
    # nothing is missed that the rounding of the waypoint hides
    hidden = np.spacing(np.abs(task.q))
    excess = _EXCESS_RTOL * paths.sum(axis=0)
    covered = missed <= np.maximum(excess, hidden)
    return covered & ~steep & ~fast


def _beyond(values: Array, limits: Sides) -> Bools:
    """Return where one of the values along the first axis lies beyond its limits."""
    low, high = limits
    outside = (values < low) | (values > high)
    return np.asarray(outside.any(axis=0))
