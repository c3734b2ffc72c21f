"""The motion through given waypoint velocities without a jerk limit (mathematics, section 3).

In each segment each joint takes the profile of least acceleration, at most two ramps and a cruise.
Those joints that need all of their limits decide when a segment's breaks are; the others have time
to spare, so that a break of theirs a millionth of the segment beside another joint's, or beside a
waypoint, moves there, and where the profile leaves the joint's position limits it is the one that
strays least. What is stored are times since the motion's start, rounded, and each joint's
peak follows from the rounded ones.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from baselines.exact.acceleration_profiles import Ramps, extremes, gentlest, straightest
from baselines.exact.rounded import DISTINCT_RTOL, Pieces
from baselines.exact.scaled import Scaled
from trajopt.core.arrays import Array, Bools, Indices

# Breaks no further apart than this share of a segment become one where limits allow it.
_SLIVER = 1e-6
# Share of the unused acceleration that a joint keeps, so that breaks can move.
_KEPT_SHARE = 1e-3
# With less unused acceleration, relative to the limit, there is only one motion.
_LEAST_SPARE = 1e-6
# Rounding, relative to a limit or to the way that a joint travels.
_EXCESS_RTOL = 1e-12


class Task(NamedTuple):
    """The motion required of every joint in every segment, in the joint's own units.

    Attributes:
        h: displacements, `(segments, joints)`.
        u: velocities at the segments' starts, likewise.
        w: velocities at their ends, likewise.
        v: velocity limits, `(2, joints)`, low first.
        a: acceleration limits, likewise.
        unit: the unit of time, s.
        units: the units of acceleration, velocity and position, rad/s^power, `(3, joints)`.
        q: where the segments start, rad, `(segments, joints)`.
        positions: position limits, rad, `(2, joints)`, low first.
    """

    h: Array
    u: Array
    w: Array
    v: Array
    a: Array
    unit: float
    units: Array
    q: Array
    positions: Array

    @classmethod
    def of(cls, scaled: Scaled, velocity: Array, joints: Indices) -> Self:
        """The task of some of the moving joints.

        Args:
            scaled: the problem.
            velocity: at the waypoints, of all that move, `(segments + 1, moving joints)`.
            joints: which of these.
        """
        among_all = np.flatnonzero(scaled.moving)[joints]
        own = velocity[:, joints]
        return cls(
            scaled.h[:, joints],
            own[:-1],
            own[1:],
            scaled.v[:, joints],
            scaled.a[:, joints],
            scaled.unit,
            scaled.units[1:, joints],
            scaled.problem.waypoints[:-1, among_all],
            scaled.problem.limits.position[among_all].T,
        )


class _Breaks(NamedTuple):
    """Stored times of every segment and joint, s since the motion's start, `(segments, joints)`."""

    start: Array
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
        if not self._crowded(inner, closest):
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
        start = self.start[:, :1]
        end = self.end[:, :1]
        moved = np.where(
            end - moved <= closest,
            end,
            moved,
        )
        moved = np.where(
            moved - start <= closest,
            start,
            moved,
        )
        first, last = np.hsplit(moved, 2)
        return self._replace(first=first, last=last)

    def _crowded(self, inner: Array, closest: Array) -> bool:
        """Return whether two distinct breaks are that close, or one is that close to an end."""
        ends = (self.start[:, :1], self.end[:, :1])
        times = np.concatenate([*ends, inner], axis=1)
        times.sort(axis=1)
        steps = np.diff(times, axis=1)
        crowded = (steps > 0) & (steps <= closest)
        return bool(crowded.any())


class _Profiles(NamedTuple):
    """Velocity profiles over breaks, three pieces each."""

    lengths: Array  # in units of time, `(3, segments, joints)`
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


def pieces(task: Task, passages: Array) -> list[Pieces]:
    """Each joint's breaks, s, and its position as coefficients, rad/s^power.

    Args:
        task: what the joints do.
        passages: when the waypoints are passed, s, `(segments + 1,)`.
    """
    duration = passages[-1]
    whole = np.diff(passages)[:, None]
    between = (task.u, task.w, whole / task.unit)
    limits = (task.v, task.a)
    # in the segment's rounded time the limits may allow a little less than all of it
    reach = extremes(*between, *limits)
    covered = np.clip(
        task.h,
        reach.d_lo,
        reach.d_up,
    )
    task = task._replace(h=covered)
    ramps = gentlest(*between, covered, *limits)
    if np.isfinite(task.positions).any():
        ramps = _within_positions(
            ramps,
            task,
            whole / task.unit,
        )
    breaks = _apart(
        ramps,
        task,
        passages,
    )
    # a trajectory stores breaks as one that only rounding separates
    resolution = np.full_like(whole, DISTINCT_RTOL * duration)
    breaks = breaks.moved(ramps.share, resolution)
    profiles = _covering(breaks, task)
    allowed = _allowed(profiles, task)
    if not allowed.all():
        read = _read(
            breaks,
            ramps,
            task,
        )
        velocity = np.where(
            allowed,
            profiles.velocity,
            read,
        )
        profiles = _profiles(profiles.lengths, velocity)
    return _by_joint(
        breaks,
        profiles,
        task,
        duration,
    )


def _within_positions(ramps: Ramps, task: Task, t: Array) -> Ramps:
    """Ramps that stray least, where these ones leave the position limits."""
    spare = np.maximum(1 - ramps.share, 0.0)
    # joints that decide the segment's time have no choice
    has_choice = spare > _LEAST_SPARE
    leaves = has_choice & _leaves_positions(
        ramps,
        task,
        t,
    )
    taken = 1 - _KEPT_SHARE * spare
    cruise, first, last = straightest(
        task.u,
        task.w,
        t,
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


def _leaves_positions(ramps: Ramps, task: Task, t: Array) -> Bools:
    """Which joints leave their position limits, in which segments: waypoints are within them."""
    peak = ramps.peak
    cruise = t - ramps.first - ramps.last
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
    positions = task.q + task.units[-1] * turning
    return _beyond(positions, task.positions)


def _apart(ramps: Ramps, task: Task, passages: Array) -> _Breaks:
    """The breaks of these ramps, none too close to others where limits allow that."""
    own = _stored(
        ramps,
        task,
        passages,
    )
    whole = own.end - own.start
    closest = np.maximum(_SLIVER * whole, DISTINCT_RTOL * passages[-1])
    # the place of a waypoint, or of another joint's break
    shared = own.moved(ramps.share, closest[:, :1])
    allowed = _allowed(_covering(shared, task), task)
    return own.where(allowed, shared)


def _stored(ramps: Ramps, task: Task, passages: Array) -> _Breaks:
    """When ramps end and begin, rounded so that none gets briefer."""
    shape = task.h.shape
    start = np.broadcast_to(passages[:-1, None], shape)
    end = np.broadcast_to(passages[1:, None], shape)
    unit = task.unit
    first = start + ramps.first * unit
    later = np.nextafter(first, np.inf)
    is_brief = (first - start) / unit < ramps.first
    first = np.where(
        is_brief,
        later,
        first,
    )
    first = np.minimum(first, end)
    last = end - ramps.last * unit
    earlier = np.nextafter(last, -np.inf)
    is_brief = (end - last) / unit < ramps.last
    last = np.where(
        is_brief,
        earlier,
        last,
    )
    last = np.maximum(first, last)
    return _Breaks(
        start,
        first,
        last,
        end,
    )


def _covering(breaks: _Breaks, task: Task) -> _Profiles:
    """The profiles that have these breaks: their peaks cover the displacement.

    Without the first ramp velocity changes evenly from the start to where the last one begins, and
    likewise at the end.
    """
    u = task.u
    w = task.w
    lengths = _lengths(breaks, task)
    first, middle, last = lengths
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


def _read(breaks: _Breaks, ramps: Ramps, task: Task) -> Array:
    """The velocities that these ramps have at rounded breaks: no steeper than they are."""
    peak = ramps.peak
    from_start = task.u - peak
    from_end = task.w - peak
    velocity = [task.u]
    for time in (breaks.first, breaks.last):
        elapsed = (time - breaks.start) / task.unit
        remaining = (breaks.end - time) / task.unit
        rising = from_start * _left(elapsed, ramps.first)
        falling = from_end * _left(remaining, ramps.last)
        velocity.append(peak + rising + falling)
    velocity.append(task.w)
    return np.array(velocity)


def _left(elapsed: Array, ramp: Array) -> Array:
    """Return the remaining share of a ramp."""
    gone = np.divide(
        elapsed,
        ramp,
        out=np.ones_like(ramp),
        where=ramp > 0,
    )
    return np.maximum(1 - gone, 0.0)


def _lengths(breaks: _Breaks, task: Task) -> Array:
    """Return the lengths of the three pieces, in units of time, `(3, segments, joints)`."""
    times = np.array(breaks)
    lengths = times[1:] - times[:-1]
    lengths /= task.unit
    return lengths


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
    steep = _beyond(profiles.acceleration, wider * task.a)
    fast = _beyond(profiles.velocity[1:3], wider * task.v)
    travelled = profiles.travelled.sum(axis=0)
    missed = np.abs(travelled - task.h)
    speeds = np.abs(profiles.velocity)
    fastest = np.maximum(speeds[:-1], speeds[1:])
    paths = profiles.lengths * fastest
    covered = missed <= _EXCESS_RTOL * paths.sum(axis=0)
    return covered & ~steep & ~fast


def _beyond(values: Array, limits: Array) -> Bools:
    """Return where one of the values along the first axis lies beyond its limits."""
    low, high = limits
    outside = (values < low) | (values > high)
    return outside.any(axis=0)


def _by_joint(
    breaks: _Breaks,
    profiles: _Profiles,
    task: Task,
    duration: float,
) -> list[Pieces]:
    """Every joint's pieces that take time, one segment after another."""
    # over a brief piece, rounding of the velocities shows
    acceleration = np.clip(profiles.acceleration, *task.a)
    before = profiles.velocity[:-1]
    by_power = np.array([acceleration / 2, before, profiles.starts])
    by_power *= task.units[:, None, None]
    by_power[-1] += task.q
    starts = np.array(breaks[:-1])
    joints = []
    for i in range(task.h.shape[1]):
        takes_time = profiles.lengths[..., i].T > 0
        own = starts[..., i].T[takes_time]
        coefficients = by_power[..., i].swapaxes(1, 2)
        stored = np.append(own, duration)
        joints.append((stored, coefficients[:, takes_time]))
    return joints
