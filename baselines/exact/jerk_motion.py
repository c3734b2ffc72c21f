"""The jerk-limited motion through given waypoint states (mathematics, section 4).

In a segment a joint may take any convex combination of its two extreme profiles that covers the
displacement. A trajectory stores its breaks as times since its start, after half a minute to
4e-15 s. So breaks are rounded first. The motion has the accelerations of that combination at the
breaks and is straight between them: so it keeps the limits of jerk and acceleration wherever the
breaks are.

All joints of a segment share its breaks. Where two even ones serve, a joint needs no others; else
it needs those at which its profiles change their jerk. The barrier leaves phases that take no time
at the optimum. Such a phase shares a longer piece with the next one: of the velocity that may cost
as little as jerk gains in 7e-6 of the longest ramp.

What the breaks cost is made up for: first by the velocities at the waypoints, each as its briefer
segment would have it, then by a smooth change of acceleration.
"""

from __future__ import annotations

from operator import itemgetter
from typing import NamedTuple, Self

import numpy as np

from baselines.exact.acceleration_motion import covering
from baselines.exact.jerk_cells import Cells
from baselines.exact.rounded import NO_PIECES, assembled, clocks, integrated, later
from baselines.exact.scaled import Scaled
from trajopt.core.arrays import Array, Bools
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify

EVEN = 2  # evenly spaced inner breaks of a segment
# Share of a limit. A joint that exceeds one by more needs breaks of its own.
EXCESS_RTOL = 3e-11
# An extreme profile with a smaller share is left out.
MIN_SHARE = 1e-11
# The longest phase that a longer piece may leave out, in units of the longest ramp.
BRIEF_RTOL = 7e-6
# A break is left out where the phase before it is this much briefer than what may move.
NEGLIGIBLE = 0.025
# Displacement that a dip below a velocity limit may cost, relative to that at the limit.
DIP_RTOL = 1e-12
# Room for the rounding of velocities, relative to them: it takes some of a brief segment's jerk.
ROUNDING_RTOL = 1e-14
MAX_ROUNDING_SHARE = 1e-3
MENDINGS = 2  # the second one mends the rounding of the first
# Dilations that are tried, which differ by how they are rounded, and a certified duration that is
# short enough: relative to the optimum's.
DILATIONS = 1 + 1e-10 * np.arange(20)
ENOUGH = 1 + 1e-9
TINY = 1e-300  # instead of dividing by 0


class Reachable(Scaled):
    """A problem without units, and the motions through given waypoint states."""

    def trajectory(self, times: Array, states: Array) -> Trajectory:
        """The motion of an optimum: the one certified shortest of some that differ by rounding.

        Args:
            times: of the segments, `(segments,)`.
            states: velocities and accelerations at inner waypoints, `(2, segments - 1, joints)`.
        """
        within = self.problem.without("position")
        enough = ENOUGH * self.unit * times.sum()
        tried = []
        for k in DILATIONS:
            powers = np.array([k, k**2])
            slower = states / powers[:, None, None]
            motion = self._motion(k * times, slower)
            certificate = verify(within, motion)
            certified = certificate.certified_duration or np.inf
            tried.append((certified, motion))
            if certified <= enough:
                break
        _, best = min(tried, key=itemgetter(0))
        return best

    def _motion(self, times: Array, states: Array) -> Trajectory:
        passages = np.append(0.0, np.cumsum(times * self.unit))
        whole_states = np.pad(states, ((0, 0), (1, 1), (0, 0)))
        with np.errstate(all="ignore"):
            breaks, velocity, cubics = _fitted(self, times, passages, whole_states)
        jerky = self.r.any(axis=0)
        segments = []
        for k, clock in enumerate(clocks(passages, self.unit)):
            own_breaks = breaks[:, k]
            used = np.diff(own_breaks) > 0
            stored = own_breaks[np.append(True, used)]
            pieces = []
            for i in range(len(jerky)):
                own = (stored, cubics[:, used, k, i])
                if clock.length <= 0:
                    own = NO_PIECES
                elif not jerky[i]:
                    ends = velocity[k : k + 2, i]
                    own = covering(self.h[k, i], ends, self.v[:, i], self.a[:, i], clock)
                stored_own, part = own
                units = self.units[-len(part) :, i, None]
                pieces.append((stored_own, part * units))
            segments.append(pieces)
        return assembled(self.problem, passages, segments)


def _fitted(
    scaled: Scaled, times: Array, passages: Array, states: Array
) -> tuple[Array, Array, Array]:
    """The motion with the fewest breaks that serve.

    Args:
        scaled: the problem.
        times: of the segments, `(segments,)`.
        passages: when the waypoints are passed, as it is stored, s, `(segments + 1,)`.
        states: velocities and accelerations there, `(2, segments + 1, joints)`.

    Returns:
        Breaks, s, `(breaks, segments)`, where the end of a segment repeats; velocities at the
        waypoints; position coefficients `(4, pieces, segments, joints)`.
    """
    limits = _Limits.of(scaled, passages)
    states = _without_dips(scaled, limits, states)
    velocity, acceleration = states
    profiles = _Profiles.of(scaled, limits, times, states)
    spare, turns = _spared(scaled, limits, acceleration)
    needs_own = np.zeros_like(scaled.h, dtype=bool)
    while True:
        breaks = _breaks(profiles, limits, needs_own)
        since = limits.since(breaks)
        lengths = np.diff(breaks, axis=0)[..., None] / limits.unit
        passed = since[0] / limits.times

        levels = profiles.accelerations(since, acceleration)
        straight = _straight(acceleration, passed)
        turned = _straight(turns, passed)
        levels += spare * (straight - levels) + turned
        slow, short = _missing(lengths, levels, velocity, scaled.h)
        # a cell that misses nothing would have that much more velocity at its ends
        added = short / limits.times
        weights = needs_own * limits.weights
        agreed = velocity + _agreed(added - slow, added, weights)
        levels = _mended(lengths, passed, levels, agreed, scaled.h)

        excess = _excess(scaled, lengths, levels, agreed)
        excess[needs_own | ~limits.jerky] = 0.0
        worst = excess.max(axis=1, keepdims=True)
        is_worst = excess == worst
        more = is_worst & (worst > EXCESS_RTOL)
        if not more.any():
            cubics, *_ = integrated(lengths, levels, agreed[:-1])
            return breaks, agreed, cubics
        needs_own |= more


class _Limits(NamedTuple):
    """The segments as they are stored, and the motion that limits allow in them.

    Attributes:
        start: s since the motion's start, `(segments,)`.
        end: likewise.
        unit: of the motion's own times, s.
        times: of the segments, in `unit`; 1 where that is rounded to 0, `(segments, 1)`.
        slow: inverse jerk limits, the larger of both sides, `(joints,)`.
        jerky: which joints have jerk limits.
        gained: the acceleration that jerk allows in the time, at most its limit.
        ramp: the longest time with the same jerk, `(segments, joints)`.
        weights: how much a waypoint's state matters to a cell, `(segments, joints)`.
    """

    start: Array
    end: Array
    unit: float
    times: Array
    slow: Array
    jerky: Bools
    gained: Array
    ramp: Array
    weights: Array

    @classmethod
    def of(cls, scaled: Scaled, passages: Array) -> Self:
        start = passages[:-1]
        end = passages[1:]
        rounded = (end - start)[:, None] / scaled.unit
        times = np.where(rounded > 0, rounded, 1.0)
        slowest = np.abs(scaled.v).min(axis=0)
        steepest = np.abs(scaled.a).min(axis=0)
        slow = scaled.r.max(axis=0)
        gained = np.minimum(steepest, times / slow)
        faster = np.minimum(slowest, steepest * times)
        ramp = np.sqrt(np.minimum(faster * slow, times**2))
        takes_time = rounded > 0
        weights = takes_time / (times * gained) ** 2
        return cls(
            start,
            end,
            scaled.unit,
            times,
            slow,
            slow > 0,
            gained,
            ramp,
            weights,
        )

    def since(self, breaks: Array) -> Array:
        """Breaks `(breaks, segments)` counted from both ends, `(2, breaks, segments, 1)`."""
        since = np.array([breaks - self.start, self.end - breaks])
        return since[..., None] / self.unit


class _Profiles(NamedTuple):
    """The extreme profiles of every cell, from both ends to the peak between them.

    Attributes:
        lengths: of ramp, hold and ramp, `(3, 2 ends, 2 sides, segments, joints)`.
        levels: accelerations at the end, at the hold and at the peak, of the same shape.
        shares: of both profiles in the motion, `(2 sides, segments, joints)`.
        ends: of these phases, s since the motion's start, of the shape of the lengths.
    """

    lengths: Array
    levels: Array
    shares: Array
    ends: Array

    @classmethod
    def of(cls, scaled: Scaled, limits: _Limits, times: Array, states: Array) -> Self:
        """The profiles of these times between waypoint states `(2, segments + 1, joints)`.

        Where rounding changed a segment's time, each phase keeps its share, and no ramp of jerk
        gets briefer.
        """
        rows = Cells(scaled).rows(times[None], *states[:, None, 1:-1])
        rises = rows.profiles.rises[:, :, 0]
        at_ends = rows.profiles.acceleration[:, :, 0]
        rise, fall = rises
        peak = np.clip(0.0, -fall, rise)
        # the end is seen backwards, and the lower profile mirrored
        flips = np.array([1.0, -1.0]).reshape(2, 1, 1, 1)
        levels = np.array(
            [
                flips * at_ends,
                flips * rises,
                [peak, peak],
            ]
        )
        high, low = np.maximum(rows.reach[:, 0], 0.0)
        share = low / np.maximum(high + low, TINY)
        shares = np.array([share, 1 - share])
        shares[shares < MIN_SHARE] = 0.0
        shares[shares > 1 - MIN_SHARE] = 1.0
        # the end is passed backwards
        origins = np.array([limits.start, -limits.end])
        places = [origins[:, None, :, None] + 0 * rises]
        phases = np.maximum(rows.phases[:3, :, :, 0], 0.0)
        for length in phases * limits.times * limits.unit:
            places.append(later(places[-1], length))
        lengths = np.diff(places, axis=0) / limits.unit
        ends = flips * np.array(places[1:])
        return cls(lengths, flips[:, 0] * levels, shares, ends)

    def breaks(self, limits: _Limits) -> Array:
        """The ends of phases within segments, s, or not a number, `(12, segments, joints)`."""
        after_start = self.ends > limits.start[:, None]
        before_end = self.ends < limits.end[:, None]
        wanted = after_start & before_end & (self.shares > 0)
        breaks = np.where(wanted, self.ends, np.nan)
        return breaks.reshape(-1, *self.shares.shape[1:])

    def accelerations(self, since: Array, at_ends: Array) -> Array:
        """Accelerations at times since both ends, `(times, segments, joints)`.

        Args:
            since: `(2 ends, times, segments, 1)`.
            at_ends: at the waypoints, `(segments + 1, joints)`.
        """
        after = since[:, :, None]
        ramp, hold, release = self.lengths[:, :, None]
        first, held, peak = self.levels[:, :, None]
        halves = first - peak
        halves = halves + _share(after, ramp) * (held - first)
        halves += _share(after - ramp - hold, release) * (peak - held)
        profiles = peak[0] + halves.sum(axis=0)
        inner = (self.shares * profiles).sum(axis=1)
        inner = np.where(since[0] > 0, inner, at_ends[:-1])
        return np.where(since[1] > 0, inner, at_ends[1:])


def _share(after: Array, length: Array) -> Array:
    """The share of a phase that is over, so long after its start."""
    share = np.clip(after / length, 0.0, 1.0)
    return np.where(length > 0, share, after >= 0)


def _straight(at_waypoints: Array, passed: Array) -> Array:
    """The straight lines between values at the waypoints, `(breaks, segments, joints)`."""
    return at_waypoints[:-1] + passed * np.diff(at_waypoints, axis=0)


def _without_dips(scaled: Scaled, limits: _Limits, states: Array) -> Array:
    """The states, those that are at a velocity limit but for a brief ramp put on it."""
    velocity, acceleration = states
    low, high = scaled.v
    limit = np.where(velocity > 0, high, low)
    size = np.abs(limit)
    before = np.append(limits.times[:1], limits.times, axis=0)
    after = np.append(limits.times, limits.times[-1:], axis=0)
    briefer = np.minimum(before, after)
    # a dip of velocity d takes the time sqrt(r d)
    lost = DIP_RTOL * size * briefer
    deepest = (lost / np.sqrt(limits.slow)) ** (2 / 3)
    dip = np.abs(limit - velocity)
    square = acceleration**2
    ramp = limits.slow * square / 2
    brief = np.maximum(dip, ramp) <= deepest
    on_limit = limits.jerky & brief
    put = np.where(on_limit, limit, velocity)
    steady = np.where(on_limit, 0.0, acceleration)
    return np.array([put, steady])


def _spared(scaled: Scaled, limits: _Limits, acceleration: Array) -> tuple[Array, Array]:
    """The share of a cell's jerk that the rounding of velocities may take, and what it needs.

    Returns:
        By how much a cell's acceleration approaches a straight one, `(segments, joints)`, and by
        how much the waypoints' change, so that a straight one leaves that room.
    """
    mean = np.abs(scaled.h) / limits.times
    by_jerk = limits.gained * limits.times
    needed = ROUNDING_RTOL * mean / by_jerk
    spare = np.minimum(needed, MAX_ROUNDING_SHARE)
    usable = (1 - spare) * limits.times
    down, up = usable / scaled.r[:, None]
    steps = np.diff(acceleration, axis=0)
    allowed = np.clip(steps, -down, up)
    beyond = (steps - allowed) / 2
    return spare, _agreed(beyond, -beyond, limits.weights)


def _agreed(at_start: Array, at_end: Array, weights: Array) -> Array:
    """The weighted means of what the two cells at each waypoint want, `(segments + 1, joints)`."""
    agreed = np.zeros((len(weights) + 1, weights.shape[1]))
    wanted = weights[1:] * at_start[1:] + weights[:-1] * at_end[:-1]
    both = weights[1:] + weights[:-1]
    agreed[1:-1] = wanted / np.maximum(both, TINY)
    return agreed


def _breaks(profiles: _Profiles, limits: _Limits, needs_own: Bools) -> Array:
    """The breaks of all joints of a segment, s, `(breaks, segments)`, where its end repeats."""
    start = limits.start
    end = limits.end
    own = np.where(needs_own, profiles.breaks(limits), np.nan)
    longest = BRIEF_RTOL * limits.ramp * limits.unit
    brief = np.broadcast_to(longest, own.shape)
    even = np.linspace(start, end, EVEN + 2)[1:-1]
    wanted = np.concatenate([even, _rows(own)])
    briefs = np.concatenate([0 * even, _rows(brief)])
    most = np.isfinite(wanted).sum(axis=0).max()
    order = np.argsort(wanted, axis=0)[:most]
    wanted = np.take_along_axis(wanted, order, axis=0)
    briefs = np.take_along_axis(briefs, order, axis=0)
    # breaks move away from the ends, at most a part of the widest gap
    placed = np.where(np.isnan(wanted), end, wanted)
    gaps = np.diff(np.concatenate([start[None], placed, end[None]]), axis=0)
    numbers = np.arange(len(wanted))[:, None]
    widest = gaps.argmax(axis=0)
    early = numbers < widest
    most_early = widest.max()
    fewest_early = widest.min()
    farthest = gaps.max(axis=0) / 4
    from_start = np.where(early, wanted, np.nan)
    from_end = np.where(early, np.nan, wanted)
    found = [
        start[None],
        _apart(from_start[:most_early], briefs[:most_early], start, 1.0, farthest),
        _apart(from_end[fewest_early:][::-1], briefs[fewest_early:][::-1], end, -1.0, farthest),
        end[None],
    ]
    breaks = np.sort(np.concatenate(found), axis=0)
    most = np.isfinite(breaks).sum(axis=0).max()
    return np.where(np.isnan(breaks), end, breaks)[:most]


def _rows(table: Array) -> Array:
    """A table `(…, segments, joints)` as rows `(rows, segments)`."""
    return table.swapaxes(-1, -2).reshape(-1, table.shape[-2])


def _apart(wanted: Array, briefs: Array, origin: Array, sign: float, farthest: Array) -> Array:
    """Breaks without those of phases too brief for a piece of their own, `(breaks, segments)`.

    A break a time `d` after the one before would cost the motion `½ J d x` of its velocity, if the
    piece ended a time `x` after that instead: with `x = brief² / d` it moves that far.

    Args:
        wanted: breaks in the order of their distance from the origin, s; some not a number.
        briefs: the longest phase of each that may be lost, s.
        origin: the first break, s, `(segments,)`.
        sign: 1 forwards in time, -1 backwards.
        farthest: how far a break may move, s, `(segments,)`.
    """
    last = origin
    following = np.full_like(origin, np.nan)
    found = []
    for time, brief in zip(wanted, briefs, strict=True):
        reached = sign * (time - following) >= 0
        found.append(np.where(reached, following, np.nan))
        last = np.where(reached, following, last)
        following[reached] = np.nan
        ahead = sign * (time - last)
        longer = brief**2 / ahead
        length = np.maximum(ahead, np.minimum(longer, farthest))
        moved = last + sign * length
        chosen = np.where(longer > ahead, moved, time)
        needed = ahead * farthest > NEGLIGIBLE * brief**2
        nearer = needed & ~(sign * (chosen - following) >= 0)
        following = np.where(nearer, chosen, following)
    return np.array([*found, following])


def _missing(lengths: Array, levels: Array, velocity: Array, h: Array) -> tuple[Array, Array]:
    """The velocity and the displacement that motions of these accelerations miss at their end."""
    _, reached, travelled = integrated(lengths, levels, velocity[:-1])
    return velocity[1:] - reached, h - travelled


def _mended(lengths: Array, passed: Array, levels: Array, velocity: Array, h: Array) -> Array:
    """Accelerations with which nothing is missing, `(breaks, segments, joints)`.

    They change by a multiple of `x (1 - x)` and one of `x (1 - x) (1 - 2 x)`.

    Args:
        lengths: of the pieces, `(pieces, segments, 1)`.
        passed: the share `x` of the segment's time that has passed, `(breaks, segments, 1)`.
        levels: accelerations, `(breaks, segments, joints)`.
        velocity: at the waypoints.
        h: displacements.
    """
    even = passed * (1 - passed)
    odd = even * (1 - 2 * passed)
    none = np.zeros_like(passed[0])
    _, even_gain, even_way = integrated(lengths, even, none)
    _, odd_gain, odd_way = integrated(lengths, odd, none)
    # both equations by Cramer's rule
    size = even_gain * odd_way - odd_gain * even_way
    for _ in range(MENDINGS):
        slow, short = _missing(lengths, levels, velocity, h)
        evenly = slow * odd_way - odd_gain * short
        oddly = even_gain * short - even_way * slow
        change = evenly * even + oddly * odd
        levels = levels + change / size
    return levels


def _excess(scaled: Scaled, lengths: Array, levels: Array, velocity: Array) -> Array:
    """The largest share by which a motion exceeds a limit, `(segments, joints)`."""
    first = levels[:-1]
    steps = np.diff(levels, axis=0)
    jerk = np.where(lengths > 0, steps / lengths, 0.0)
    gains = lengths * (first + steps / 2)
    before = velocity[:-1] + np.cumsum(gains, axis=0) - gains
    # velocity where acceleration vanishes in a piece; where it does not, at its nearer end
    when = np.clip(-first / jerk, 0.0, lengths)
    when[jerk == 0] = 0.0
    turning = before + when * (first + when * jerk / 2)
    signs = np.array([[-1.0], [1.0]])
    kinds = [
        (jerk, signs / scaled.r),
        (levels, scaled.a),
        (turning, scaled.v),
    ]
    shares = []
    for values, (low, high) in kinds:
        shares.append((values / low).max(axis=0))
        shares.append((values / high).max(axis=0))
    excess = np.max(shares, axis=0) - 1
    return np.nan_to_num(excess, nan=np.inf)
