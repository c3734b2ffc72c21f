"""The jerk-limited motion through the waypoint states of an optimum (mathematics, section 4).

In a segment a joint may take any convex combination of its two extreme profiles that covers the
displacement. The motion has the accelerations of that combination at its breaks and is straight
between them: so it keeps the limits of jerk and acceleration wherever the breaks are. What the
breaks cost is made up for, first by the velocities at the waypoints, each as its briefer segment
would have it, then by a smooth change of acceleration.

All joints of a segment share its breaks. A joint for which two even ones suffice needs no others.
The rest need those at which their profiles change their jerk.

The barrier keeps off waypoint states at which a phase vanishes, and leaves brief phases there. So
the states settle first: an acceleration that is close to the level that it is to reach becomes that
level. And a trajectory stores its breaks as times since its start, after half a minute to 4e-15 s:
times are rounded before anything else.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from baselines.exact.acceleration_motion import Task, pieces
from baselines.exact.cells import at_ends
from baselines.exact.jerk_cells import Cells, Point, Rows
from baselines.exact.jerk_profiles import CRUISE, HOLD, RAMP, RELEASE
from baselines.exact.rounded import Pieces, integrated, later, mended, missing
from baselines.exact.scaled import Scaled
from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools
from trajopt.core.trajectory import Trajectory

# Segments whose times are rounded by more than this, relative, decide how fast they are passed.
ROUNDED_RTOL = 4e-12
# An extreme profile whose displacement is so close, relative to what limits allow, is alone.
TIGHT_RTOL = 1e-12
# Phases that may vanish when states settle, relative to the longest ramp, and what that may cost.
BRIEF_RTOL = 1e-2
SETTLED_RTOL = 1e-11
NEWTON_STEPS = 2
EVEN = 2  # evenly spaced inner breaks of a segment
# Share of a limit. A joint that exceeds one by more needs breaks of its own.
EXCESS_RTOL = 3e-11
# A break is left out if that costs as little velocity as jerk gains in this share of a ramp.
LEAST_RTOL = 7e-6
TINY = 1e-300  # instead of dividing by 0
# What is at the end of a segment is seen backwards.
FLIPS = np.array([1.0, -1.0]).reshape(2, 1, 1, 1, 1)


class Reachable(Scaled):
    """A problem without units, and the motions of its optima."""

    def trajectory(self, times: Array, states: Point) -> Trajectory:
        """The motion of an optimum.

        Args:
            times: of the segments, `(segments,)`.
            states: the unknowns of one start.
        """
        passages = np.append(0.0, np.cumsum(self._storable(times) * self.unit))
        with np.errstate(all="ignore"):
            joints = self._joints(passages, states)
        return Trajectory.of_moving(self.problem.waypoints[0], self.moving, joints, passages)

    def _storable(self, times: Array) -> Array:
        """Times of the segments, slower by what rounding takes, 1e-10 or so.

        The rounded time of a brief segment decides how fast it is passed. From one such segment to
        the next the motion slows down evenly.
        """
        passages = np.append(0.0, np.cumsum(times * self.unit))
        spacing = np.spacing(passages[1:]) / self.unit
        (brief,) = np.nonzero(spacing > ROUNDED_RTOL * times)
        if not brief.size:
            return times
        rounded = np.ceil(times / spacing) * spacing
        middles = (passages[1:] + passages[:-1]) / 2
        return times * np.interp(middles, middles[brief], rounded[brief] / times[brief])

    def _joints(self, passages: Array, states: Point) -> list[Pieces]:
        """Each joint's breaks, s, and its position as coefficients, rad/s^power."""
        breaks, levels, velocity = _fitted(self, passages, states)
        lengths = np.diff(breaks, axis=0)
        _, a_unit, v_unit, _ = self.units
        cubics, *_ = integrated(lengths[..., None], a_unit * levels, v_unit * velocity[:-1])
        cubics[-1] += self.problem.waypoints[:-1, self.moving]
        used = lengths.T > 0
        stored = np.append(breaks[:-1].T[used], passages[-1])
        by_joint = cubics.transpose(3, 0, 2, 1)
        joints = [(stored, table[:, used]) for table in by_joint]
        (unlimited,) = np.nonzero(~self.r.any(axis=0))
        if unlimited.size:
            task = Task.of(self, velocity, unlimited)
            for i, own in zip(unlimited.tolist(), pieces(task, passages), strict=True):
                joints[i] = own
        return joints


def _fitted(scaled: Scaled, passages: Array, states: Point) -> tuple[Array, Array, Array]:
    """The motion with the fewest breaks that suffice.

    Args:
        scaled: the problem.
        passages: when the waypoints are passed, as it is stored, s, `(segments + 1,)`.
        states: the optimum.

    Returns:
        Breaks, s, `(breaks, segments)`, where the end of a segment repeats; accelerations there,
        `(breaks, segments, joints)`; velocities at the waypoints, `(segments + 1, joints)`.
    """
    limits = _Limits.of(scaled, passages)
    rows = _settled(Rows(Cells(scaled), states), limits)
    profiles = _Profiles.of(rows, limits)
    ends = rows.mean + rows.t * rows.point.ends
    velocity = _agreed(*ends[:, 0], limits.weights)

    even = _Times.of(np.linspace(limits.start, limits.end, EVEN + 2), limits)
    gentle = profiles.accelerations(even.since)
    gentle = mended(even.lengths, gentle, velocity[:-1], velocity[1:], scaled.h)
    excess = _excess(scaled, even.lengths, gentle, velocity)
    needs_own = limits.jerky & ~(excess <= EXCESS_RTOL)

    breaks = _breaks(profiles, limits, needs_own)
    times = _Times.of(breaks, limits)
    own = profiles.accelerations(times.since)
    levels = np.where(needs_own, own, _between(gentle, times.passed))
    slow, short = missing(times.lengths, levels, velocity[:-1], velocity[1:], scaled.h)
    # a cell that misses nothing would have that much more velocity at its ends
    added = short / limits.times
    velocity = velocity + _agreed(added - slow, added, limits.weights)
    levels = mended(times.lengths, levels, velocity[:-1], velocity[1:], scaled.h)
    return breaks, levels, velocity


class _Limits(NamedTuple):
    """The segments as they are stored, and the motion that limits allow in them.

    Attributes:
        start: s since the motion's start, `(segments,)`.
        end: likewise.
        unit: of the motion's own times, s.
        times: of the segments, in `unit`; 1 where that is rounded to 0, `(segments, 1)`.
        jerky: which joints have jerk limits.
        gained: the acceleration that jerk allows in the time, at most its limit.
        ramp: the longest time with the same jerk, `(segments, joints)`.
        weights: how much a waypoint's velocity matters to a cell, `(segments, joints)`.
    """

    start: Array
    end: Array
    unit: float
    times: Array
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
        gained = np.minimum(steepest, times / np.maximum(slow, TINY))
        faster = np.minimum(slowest, steepest * times)
        ramp = np.sqrt(np.minimum(faster * slow, times**2))
        takes_time = rounded > 0
        weights = takes_time / (times * gained) ** 2
        return cls(start, end, scaled.unit, times, slow > 0, gained, ramp, weights)


class _Times(NamedTuple):
    """Breaks as the motion counts time, `(…, segments, 1)`.

    Attributes:
        since: from both ends of their segment, `(2 ends, breaks, segments, 1)`.
        lengths: of the pieces.
        passed: the share of the segment's time.
    """

    since: Array
    lengths: Array
    passed: Array

    @classmethod
    def of(cls, breaks: Array, limits: _Limits) -> Self:
        since = np.array([breaks - limits.start, limits.end - breaks])[..., None] / limits.unit
        lengths = np.diff(breaks, axis=0)[..., None] / limits.unit
        return cls(since, lengths, since[0] / limits.times)


def _settled(rows: Rows, limits: _Limits) -> Rows:
    """The cells with states that leave no brief phase at the waypoints, where none loses reach.

    Of two neighbours one waypoint settles first: so each cell is spoilt by one at most.
    """
    point = rows.point
    odd = np.arange(point.velocity.shape[1])[:, None] % 2 == 1
    for chosen in (odd, ~odd):
        after = rows
        for _ in range(NEWTON_STEPS):
            after = _settling(after, limits, chosen)
        least = np.minimum(rows.reach, 0.0) - SETTLED_RTOL * limits.gained
        # a ramp of negative length is out of reach
        negative = after.phases[RAMP] < -SETTLED_RTOL * limits.ramp / rows.t
        spoilt = (negative & (_shares(after, limits) > 0)).any(axis=0)
        fine = ((after.reach >= least) & ~spoilt).all(axis=0)
        kept = fine[:, 1:] & fine[:, :-1]
        before = rows.point
        rows = _moved(
            rows,
            np.where(kept, after.point.velocity, before.velocity),
            np.where(kept, after.point.acceleration, before.acceleration),
        )
    return rows


def _settling(rows: Rows, limits: _Limits, chosen: Bools) -> Rows:
    """The cells after a step of Newton's method at some of the waypoints."""
    cells = rows.cells
    profiles = rows.profiles
    phases = rows.phases
    is_alone = _shares(rows, limits) == 1
    brief = is_alone & limits.jerky & (phases < BRIEF_RTOL * limits.ramp / rows.t)
    # a dip below the velocity limit
    dips = _beside(brief[RAMP] & brief[RELEASE] & (phases[HOLD] <= 0) & (phases[CRUISE] > 0))
    # the level of a change in acceleration changes by the share r1 of r1 + r2
    ahead = (profiles.rises - profiles.acceleration) * (1 + cells.up / cells.down)
    level = _beside(cells.signs * FLIPS * (profiles.acceleration + ahead))
    levels = np.where(dips, 0.0, np.clip(level, *cells.scaled.a))
    lengths = np.where(_beside(brief[RAMP]), _beside(phases[RAMP]), np.inf)
    briefest = lengths.argmin(axis=0)[None]
    found, level, dip = (
        np.take_along_axis(table, briefest, axis=0)[0] for table in (lengths < np.inf, levels, dips)
    )
    is_slack = limits.jerky & ~is_alone.any(axis=0)
    free = is_slack[:, 1:] & is_slack[:, :-1]
    velocity = rows.point.velocity
    acceleration = rows.point.acceleration
    low, high = cells.scaled.v
    limit = np.where(velocity > 0, high, low)
    return _moved(
        rows,
        np.where(chosen & found & dip, limit, velocity),
        np.select([~chosen, found, free], [acceleration, level, 0.0], acceleration),
    )


def _moved(rows: Rows, velocity: Array, acceleration: Array) -> Rows:
    """The cells between other states."""
    point = rows.point
    ends = point.ends + at_ends(velocity - point.velocity) / rows.t
    return Rows(rows.cells, Point(point.log, ends, velocity, acceleration))


def _beside(cells: Array) -> Array:
    """What is at the ends of cells, `(2 ends, 2 sides, 1, segments, joints)`, at the waypoints."""
    start, end = cells
    return np.concatenate([end[:, :, :-1], start[:, :, 1:]])


def _shares(rows: Rows, limits: _Limits) -> Array:
    """Shares of both profiles that cover the displacement, `(2 sides, 1, segments, joints)`."""
    is_tight = rows.reach <= TIGHT_RTOL * limits.gained
    high, low = np.where(is_tight, 0.0, rows.reach)
    share = low / np.maximum(high + low, TINY)
    return np.array([share, 1 - share])


class _Profiles(NamedTuple):
    """The extreme profiles of every cell, from both ends to the peak between them.

    Attributes:
        lengths: of ramp, hold and release, `(3, 2 ends, 2 sides, 1, segments, joints)`.
        levels: accelerations at the end, at the hold and at the peak, of the same shape.
        shares: of both profiles in the motion, `(2 sides, 1, segments, joints)`.
        ends: of these phases, s since the motion's start, of the shape of the lengths.
        waypoints: accelerations there, `(segments + 1, joints)`.
    """

    lengths: Array
    levels: Array
    shares: Array
    ends: Array
    waypoints: Array

    @classmethod
    def of(cls, rows: Rows, limits: _Limits) -> Self:
        """The profiles of these cells.

        Where rounding changed a segment's time, each phase keeps its share, and no ramp of jerk
        gets briefer.
        """
        cells = rows.cells
        profiles = rows.profiles
        first = profiles.acceleration
        shares = _shares(rows, limits)
        # phases that have settled are rounding, and so is a dip of no acceleration at the limit
        phases = rows.phases
        room = profiles.limits.top - profiles.velocity
        is_fast = room <= SETTLED_RTOL * cells.highest / rows.t
        is_dip = is_fast & (first == 0) & (phases[CRUISE] > 0)
        own = phases[:CRUISE]
        is_gone = is_dip | (own < SETTLED_RTOL * limits.ramp / rows.t)
        takes = np.where(is_gone, 0.0, own) * limits.times * limits.unit
        # the end is passed backwards
        origins = np.array([limits.start, -limits.end])
        places = [origins[:, None, None, :, None] + 0 * first]
        for length in takes:
            places.append(later(places[-1], length))
        # without a cruise both meet, however they are rounded, and may reach less
        from_start, from_end = places[-1]
        places[-1] = np.array([from_start, np.minimum(from_end, -from_start)])
        lengths = np.diff(places, axis=0) / limits.unit
        rise, fall = profiles.rises
        peak = np.clip(0.0, -fall, rise)
        peaks = np.array([peak, -peak])
        held = np.fmin(profiles.rises, peaks + lengths[RELEASE] / cells.down)
        levels = cells.signs * FLIPS * np.array([first, held, peaks])
        waypoints = np.pad(rows.point.acceleration[0], ((1, 1), (0, 0)))
        return cls(lengths, levels, shares, FLIPS * np.array(places[1:]), waypoints)

    def breaks(self, limits: _Limits) -> Array:
        """The ends of phases within segments, s, or not a number, `(12, segments, joints)`."""
        after_start = self.ends > limits.start[:, None]
        before_end = self.ends < limits.end[:, None]
        wanted = after_start & before_end & (self.shares > 0)
        breaks = np.where(wanted, self.ends, np.nan)
        return breaks.reshape(-1, *breaks.shape[-2:])

    def accelerations(self, since: Array) -> Array:
        """Accelerations at times since both ends, `(times, segments, joints)`.

        Args:
            since: `(2 ends, times, segments, 1)`.
        """
        after = since[:, None]
        ramp, hold, release = self.lengths
        first, held, peak = self.levels
        halves = first - peak
        halves = halves + _share(after, ramp) * (held - first)
        halves += _share(after - ramp - hold, release) * (peak - held)
        profiles = peak[0] + halves.sum(axis=0)
        # without a jerk limit there is no such profile
        inner = np.nan_to_num((self.shares * profiles).sum(axis=0))
        inner = np.where(since[0] > 0, inner, self.waypoints[:-1])
        return np.where(since[1] > 0, inner, self.waypoints[1:])


def _share(after: Array, length: Array) -> Array:
    """The share of a phase that is over, so long after its start."""
    share = np.clip(after / length, 0.0, 1.0)
    return np.where(length > 0, share, after >= 0)


def _between(levels: Array, passed: Array) -> Array:
    """Values between even breaks, where that share of the time has passed."""
    place = passed * (EVEN + 1)
    before = np.clip(place.astype(int), 0, EVEN)
    left = np.take_along_axis(levels, before, axis=0)
    right = np.take_along_axis(levels, before + 1, axis=0)
    return left + (place - before) * (right - left)


def _agreed(at_start: Array, at_end: Array, weights: Array) -> Array:
    """The weighted means of what the two cells at each waypoint want, `(segments + 1, joints)`."""
    wanted = weights[1:] * at_start[1:] + weights[:-1] * at_end[:-1]
    both = weights[1:] + weights[:-1]
    return np.pad(wanted / np.maximum(both, TINY), ((1, 1), (0, 0)))


def _breaks(profiles: _Profiles, limits: _Limits, needs_own: Bools) -> Array:
    """The breaks of all joints of a segment, s, `(breaks, segments)`, where its end repeats."""
    wanted = profiles.breaks(limits)
    briefs = np.broadcast_to(LEAST_RTOL * limits.ramp * limits.unit, wanted.shape)
    even = np.linspace(limits.start, limits.end, EVEN + 2).T.tolist()
    found = []
    for k, (start, *inner, end) in enumerate(even):
        own = needs_own[k] & np.isfinite(wanted[:, k])
        pairs = zip(wanted[:, k][own].tolist(), briefs[:, k][own].tolist(), strict=True)
        found.append(_apart(start, sorted([*pairs, *((time, 0.0) for time in inner)]), end))
    most = max(map(len, found))
    return np.array([breaks + [breaks[-1]] * (most - len(breaks)) for breaks in found]).T


def _apart(start: float, wanted: list[tuple[float, float]], end: float) -> list[float]:
    """Breaks in order, without pieces so short that a longer one costs next to nothing.

    Without a break its joint is faster by half its change of jerk times the times to the breaks
    before and after. So one that follows another one closely may move away from it.

    Args:
        start: of the segment, s.
        wanted: breaks, s, each with the time whose square it may cost, s, in order.
        end: of the segment, s.
    """
    kept = [start]
    following = [time for time, _ in wanted[1:]]
    for (time, brief), after in zip(wanted, [*following, end], strict=True):
        gap = time - kept[-1]
        if gap * (after - time) > brief**2:
            kept.append(max(time, kept[-1] + brief**2 / gap))
    *_, (_, brief) = wanted
    gap = end - kept[-1]
    if gap < brief and len(kept) > 1:
        last = kept.pop()
        if gap * (last - kept[-1]) > brief**2:
            kept.append(end - brief**2 / gap)
    return [*kept, end]


def _excess(scaled: Scaled, lengths: Array, levels: Array, velocity: Array) -> Array:
    """The largest share by which a motion exceeds a limit, `(segments, joints)`."""
    cubics, *_ = integrated(lengths, levels, velocity[:-1])
    jerks = np.array([[-1.0], [1.0]]) / scaled.r
    shares = []
    for order, limits in enumerate([scaled.v, scaled.a, jerks], start=1):
        unit = polynomials.stretched(polynomials.derivative(cubics, order), lengths)
        pieces = unit.reshape(len(unit), -1)
        values = polynomials.evaluate(pieces[:, None], polynomials.critical_points(pieces))
        table = values.reshape(-1, *unit.shape[1:])
        shares += [np.fmax.reduce(table / limit, axis=(0, 1)) for limit in limits]
    return np.max(shares, axis=0) - 1
