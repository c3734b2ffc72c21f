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

import itertools
from typing import NamedTuple, Self

import numpy as np

from baselines.exact.acceleration_motion import Task, pieces
from baselines.exact.cells import at_ends, with_rest
from baselines.exact.jerk_cells import FLIPS, Cells, Point, Rows
from baselines.exact.rounded import Pieces, integrated, later, mended, missing
from baselines.exact.scaled import Scaled
from trajopt.core.arrays import Array, Bools
from trajopt.core.trajectory import Trajectory

# Segments whose times are rounded by more than this, relative, decide how fast they are passed.
ROUNDED_RTOL = 4e-12
# An extreme profile whose displacement is so close, relative to what limits allow, is alone.
TIGHT_RTOL = 1e-11
# Phases that may vanish when states settle, relative to the longest ramp, and what that may cost.
BRIEF_RTOL = 1e-2
SETTLED_RTOL = 1e-11
# A state so close to its limit, relative, settles there.
NEAR_RTOL = 1e-4
NEWTON_STEPS = 2
# Jerk changes the velocity of a fast cell by less than this, relative.
FAST_RTOL = 1e-5
EVEN = 2  # evenly spaced inner breaks of a segment
# Share of a limit. A joint that exceeds one by more needs breaks of its own.
EXCESS_RTOL = 3e-11
# A break is left out if that costs as little velocity as jerk gains in this share of a ramp.
LEAST_RTOL = 7e-6
TINY = 1e-300  # instead of dividing by 0


class Reachable(Scaled):
    """A problem without units, and the motions of its optima."""

    def trajectory(self, times: Array, states: Point) -> Trajectory:
        """The motion of an optimum.

        Args:
            times: of the segments, `(segments,)`.
            states: the unknowns of one start.
        """
        passages = self._passages(times)
        with np.errstate(all="ignore"):
            joints = self._joints(passages, states)
        first = self.problem.waypoints[0]
        return Trajectory.of_moving(first, self.moving, joints, passages)

    def _passages(self, times: Array) -> Array:
        """When the waypoints are passed, s, later by what rounding takes, 1e-10 or so.

        The rounded time of a brief segment decides how fast it is passed. From one such segment to
        the next the motion slows down evenly.
        """
        exact = np.cumsum(times * self.unit)
        spacing = np.spacing(exact) / self.unit
        (brief,) = np.nonzero(spacing > ROUNDED_RTOL * times)
        if brief.size:
            slower = np.ceil(times / spacing) * spacing / times
            starts = exact - times * self.unit
            times = times * np.interp(starts, starts[brief], slower[brief])
        return np.append(0.0, np.cumsum(times * self.unit))

    def _joints(self, passages: Array, states: Point) -> list[Pieces]:
        """Each joint's breaks, s, and its position as coefficients, rad/s^power."""
        breaks, levels, velocity = _fitted(self, passages, states)
        lengths = np.diff(breaks, axis=0)[..., None]
        _, a_unit, v_unit, _ = self.units
        leaving = v_unit * velocity[:-1]
        cubics, *_ = integrated(lengths, a_unit * levels, leaving)
        cubics[-1] += self.problem.waypoints[:-1, self.moving]
        used = lengths[..., 0].T > 0
        starts = breaks[:-1].T[used]
        stored = np.append(starts, passages[-1])
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

    Returns:
        Breaks, s, `(breaks, segments)`, where the end of a segment repeats; accelerations there,
        `(breaks, segments, joints)`; velocities at the waypoints, `(segments + 1, joints)`.
    """
    limits = _Limits.of(scaled, passages)
    rows = _settled(Rows(Cells(scaled), states), limits)
    profiles = _Profiles.of(rows, limits)
    mean = scaled.h / limits.times
    ends = rows.point.ends[:, 0]
    first, last = mean + limits.times * ends
    velocity = _agreed(first, last, limits.weights)

    even = np.linspace(limits.start, limits.end, EVEN + 2)
    lengths = _lengths(even, limits)
    given = profiles.accelerations(even)
    gentle = mended(lengths, given, *_both(velocity), scaled.h)
    needs_own = _exceeds(scaled, lengths, gentle, velocity)
    # jerk does not make up for what a fast cell misses
    steep = np.abs(scaled.h) / limits.times**2
    is_fast = limits.gained < FAST_RTOL * steep
    is_slack = profiles.shares > 0
    fast = needs_own & is_fast & is_slack.all(axis=0)
    if fast.any():
        velocity = _refitted(scaled, limits, lengths, given, velocity, fast)
        gentle = mended(lengths, given, *_both(velocity), scaled.h)
        needs_own = _exceeds(scaled, lengths, gentle, velocity)

    breaks = _breaks(profiles, limits, even, needs_own)
    lengths = _lengths(breaks, limits)
    own = profiles.accelerations(breaks)
    knots = np.broadcast_to(even[..., None], gentle.shape)
    levels = np.where(needs_own, own, _between(breaks, knots, gentle))
    every = np.ones_like(needs_own)
    velocity = _refitted(scaled, limits, lengths, levels, velocity, every)
    levels = mended(lengths, levels, *_both(velocity), scaled.h)
    return breaks, levels, velocity


def _refitted(
    scaled: Scaled,
    limits: _Limits,
    lengths: Array,
    levels: Array,
    velocity: Array,
    cells: Bools,
) -> Array:
    """Velocities at the waypoints with which these cells would miss next to nothing.

    A cell that misses nothing has that much more velocity at its ends.
    """
    slow, short = missing(lengths, levels, *_both(velocity), scaled.h)
    at_start = np.where(cells, short / limits.times, 0.0)
    at_end = np.where(cells, at_start - slow, 0.0)
    wanted = velocity + _agreed(at_start, at_end, limits.weights)
    return np.clip(wanted, *scaled.v)


def _lengths(breaks: Array, limits: _Limits) -> Array:
    """The pieces between breaks, s, as the motion counts time, `(pieces, segments, 1)`."""
    lengths = np.diff(breaks, axis=0)
    return lengths[..., None] / limits.unit


def _both(waypoints: Array) -> tuple[Array, Array]:
    """Values at the start and at the end of every segment."""
    return waypoints[:-1], waypoints[1:]


class _Limits(NamedTuple):
    """The segments as they are stored, and the motion that limits allow in them.

    Attributes:
        start: s since the motion's start, `(segments,)`.
        end: likewise.
        unit: of the motion's own times, s.
        times: of the segments, in `unit`, `(segments, 1)`.
        jerky: which joints have jerk limits.
        gained: the acceleration that jerk allows in the time, at most its limit,
            `(segments, joints)`.
        ramp: the longest time with the same jerk, as a share of the segment's, likewise.
        weights: how much a waypoint's velocity matters to a cell, likewise.
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
        times = (end - start)[:, None] / scaled.unit
        slowest = np.abs(scaled.v).min(axis=0)
        steepest = np.abs(scaled.a).min(axis=0)
        slow = scaled.r.max(axis=0)
        by_jerk = times / np.maximum(slow, TINY)
        gained = np.minimum(steepest, by_jerk)
        faster = np.minimum(slowest, steepest * times)
        ramp = np.sqrt(faster * slow) / times
        ramp = np.minimum(ramp, 1.0)
        weights = 1 / (times * gained) ** 2
        jerky = slow > 0
        return cls(start, end, scaled.unit, times, jerky, gained, ramp, weights)


def _settled(rows: Rows, limits: _Limits) -> Rows:
    """The cells with states that leave no brief phase at the waypoints, where none loses reach.

    Of two neighbours one waypoint settles first: so each cell is spoilt by one at most.
    """
    _, waypoints, _ = rows.point.velocity.shape
    odd = np.arange(waypoints)[:, None] % 2 == 1
    for chosen in (odd, ~odd):
        after = rows
        for _ in range(NEWTON_STEPS):
            after = _settling(after, limits, chosen)
        rounding = SETTLED_RTOL * limits.gained
        least = np.minimum(rows.reach, 0.0) - rounding
        # a ramp of negative length is out of reach
        negative = after.profiles.first < -SETTLED_RTOL * limits.ramp
        is_used = _shares(after, limits) > 0
        is_spoilt = is_used & negative.any(axis=0)
        is_fine = (after.reach >= least) & ~is_spoilt
        kept = _of_both_cells(is_fine.all(axis=0))
        velocity, acceleration = (
            np.where(kept, new, old)
            for new, old in zip(after.point[2:], rows.point[2:], strict=True)
        )
        rows = _moved(rows, velocity, acceleration)
    return rows


def _settling(rows: Rows, limits: _Limits, chosen: Bools) -> Rows:
    """The cells after a step of Newton's method at some of the waypoints."""
    cells = rows.cells
    first = rows.profiles.acceleration
    _, _, velocity, acceleration = rows.point
    is_alone = _shares(rows, limits) == 1
    is_brief = rows.profiles.first < BRIEF_RTOL * limits.ramp
    # the level changes by the share up/(up + down) of a change in acceleration
    missing = rows.profiles.rises - first
    ahead = missing * (1 + cells.up / cells.down)
    level = cells.signs * FLIPS * (first + ahead)
    allowed = np.clip(level, *cells.scaled.a)
    changes = _beside(allowed) - acceleration
    is_wanted = _beside(is_alone & limits.jerky & is_brief)
    wanted = np.where(is_wanted, changes, np.inf)
    least = np.abs(wanted).argmin(axis=0)[None]
    (change,) = np.take_along_axis(wanted, least, axis=0)
    free = _of_both_cells(limits.jerky & ~is_alone.any(axis=0))
    # a brief ramp below the velocity limit would lead to a dip
    fastest, is_fast = _nearest(velocity, cells.scaled.v, limits)
    steepest, is_steep = _nearest(acceleration, cells.scaled.a, limits)
    cases = [~chosen, is_fast, is_steep, free, np.isfinite(change)]
    values = [acceleration, 0.0, steepest, 0.0, acceleration + change]
    settled = np.select(cases, values, acceleration)
    faster = np.where(chosen & is_fast, fastest, velocity)
    return _moved(rows, faster, settled)


def _nearest(values: Array, sides: Array, limits: _Limits) -> tuple[Array, Bools]:
    """The limit on each value's own side, and whether the value is close to it."""
    low, high = sides
    limit = np.where(values > 0, high, low)
    room = np.abs(limit - values)
    is_near = room < NEAR_RTOL * np.abs(limit)
    return limit, limits.jerky & is_near


def _moved(rows: Rows, velocity: Array, acceleration: Array) -> Rows:
    """The cells between other states."""
    point = rows.point
    change = at_ends(velocity - point.velocity)
    ends = point.ends + change / rows.t
    return Rows(rows.cells, Point(point.log, ends, velocity, acceleration))


def _beside(cells: Array) -> Array:
    """Values at the ends of cells, `(2 ends, 2 sides, 1, segments, joints)`, by waypoint."""
    start, end = cells
    before = end[:, :, :-1]
    after = start[:, :, 1:]
    return np.concatenate([before, after])


def _of_both_cells(cells: Bools) -> Bools:
    """At which inner waypoints this is true of both cells."""
    before = cells[:, :-1]
    after = cells[:, 1:]
    return np.asarray(before & after)


def _shares(rows: Rows, limits: _Limits) -> Array:
    """Shares of both profiles that cover the displacement, `(2 sides, 1, segments, joints)`."""
    is_tight = rows.reach <= TIGHT_RTOL * limits.gained
    high, low = np.where(is_tight, 0.0, rows.reach)
    share = low / np.maximum(high + low, TINY)
    return np.array([share, 1 - share])


class _Profiles(NamedTuple):
    """The extreme profiles of every cell, from both ends to the peak between them.

    Attributes:
        knots: s since the motion's start, `(8, 2 sides, segments, joints)`.
        levels: accelerations there, straight in between, of the same shape.
        shares: of both profiles in the motion, `(2 sides, segments, joints)`.
    """

    knots: Array
    levels: Array
    shares: Array

    @classmethod
    def of(cls, rows: Rows, limits: _Limits) -> Self:
        """The profiles of these cells.

        Where rounding changed a segment's time, each phase keeps its share, and no ramp of jerk
        gets briefer.
        """
        cells = rows.cells
        profiles = rows.profiles
        rises = profiles.rises
        first = profiles.acceleration
        rise, fall = rises
        peak = np.clip(0.0, -fall, rise)
        peaks = np.array([peak, -peak])
        last = profiles.limits.down * (rises - peaks)
        own = np.array([profiles.first, profiles.hold, last])
        # a phase that has settled is rounding, and so is a dip of no acceleration at the limit
        room = profiles.limits.top - profiles.velocity
        is_fast = room <= SETTLED_RTOL * cells.highest / rows.t
        cruises = profiles.cruise > 0
        is_dip = is_fast & (first == 0) & cruises
        is_gone = is_dip | (own < SETTLED_RTOL * limits.ramp)
        exact = np.where(is_gone, 0.0, own) * limits.times
        # the end is passed backwards
        ends = np.array([limits.start, -limits.end])
        nearest = ends[:, None, None, :, None]
        farthest = -nearest[::-1]
        places = [nearest + 0 * first]
        for length in exact * limits.unit:
            place = later(places[-1], length)
            places.append(np.minimum(place, farthest))
        # without a cruise both meet, however they are rounded: the briefer hold makes room
        briefer = profiles.hold.argmin(axis=0)
        makes_room = np.array([briefer == 0, briefer == 1])
        reached = places[-1]
        room = np.minimum(reached, -reached[::-1])
        places[-1] = np.where(makes_room, room, reached)
        lengths = np.diff(places, axis=0)
        ramp, hold, release = lengths / limits.unit

        # in a longer time less acceleration leads to the velocity limit, and from a waypoint to 0
        exact_ramp, exact_hold, exact_release = exact
        spent = 2 * hold + release
        exact_spent = 2 * exact_hold + exact_release
        gained = exact_ramp * (first + rises) + exact_spent * rises
        shares = _shares(rows, limits)
        is_at_once = (ramp == 0) & (shares > 0)
        longer = np.where(is_at_once, 1 - exact_spent / spent, 0.0)
        less = np.fmax(_beside(longer).max(axis=0), 0.0)
        kept = 1 - at_ends(less)
        first = first * kept[:, None]
        level = (gained - ramp * first) / (ramp + spent)
        allowed = np.fmin(rises, peaks + release / cells.down)
        held = np.where(cruises, np.fmin(allowed, level), allowed)
        held = np.where(ramp > 0, held, first)
        levels = cells.signs * np.array([first, held, held, peaks])
        knots = np.array(places)
        return cls(_in_order(knots), _in_order(levels), shares[:, 0])

    def breaks(self, limits: _Limits) -> Array:
        """The ends of phases within segments, s, or not a number, `(16, segments, joints)`."""
        after_start = self.knots > limits.start[:, None]
        before_end = self.knots < limits.end[:, None]
        is_inside = after_start & before_end
        is_used = is_inside & (self.shares > 0)
        breaks = np.where(is_used, self.knots, np.nan)
        return breaks.reshape(-1, *breaks.shape[2:])

    def accelerations(self, times: Array) -> Array:
        """Accelerations at times since the motion's start, s, `(times, segments, joints)`."""
        _, *cells = self.shares.shape
        total = np.zeros((len(times), *cells))
        for side, share in enumerate(self.shares):
            knots = self.knots[:, side]
            levels = self.levels[:, side]
            values = _between(times, knots, levels)
            # there may be no such profile
            total += np.nan_to_num(share * values)
        return total


def _in_order(table: Array) -> Array:
    """Values from both ends inwards, `(4, 2 ends, 2 sides, 1, segments, joints)`, on one axis."""
    from_start = table[:, 0, :, 0]
    from_end = -table[:, 1, :, 0]
    return np.concatenate([from_start, from_end[::-1]])


def _between(times: Array, knots: Array, levels: Array) -> Array:
    """Values at times `(…, segments)`, straight between knots `(…, segments, joints)`."""
    _, *cells = levels.shape
    found = np.empty((len(times), *cells))
    for k, i in np.ndindex(*cells):
        own = knots[:, k, i]
        values = levels[:, k, i]
        found[:, k, i] = np.interp(times[:, k], own, values)
    return found


def _agreed(
    at_start: Array,
    at_end: Array,
    weights: Array,
) -> Array:
    """The weighted means of what the two cells at each waypoint want, `(segments + 1, joints)`."""
    before, after = _both(weights)
    starts = after * at_start[1:]
    ends = before * at_end[:-1]
    both = np.maximum(before + after, TINY)
    return with_rest((starts + ends) / both)


def _breaks(profiles: _Profiles, limits: _Limits, even: Array, needs_own: Bools) -> Array:
    """The breaks of all joints of a segment, s, `(breaks, segments)`, where its end repeats."""
    wanted = np.where(needs_own, profiles.breaks(limits), np.nan)
    briefs = LEAST_RTOL * limits.ramp * limits.times * limits.unit
    found = []
    for k, (start, *inner, end) in enumerate(even.T.tolist()):
        own = wanted[:, k]
        phase, joint = np.nonzero(np.isfinite(own))
        times = own[phase, joint]
        pairs = [(time, 0.0) for time in inner]
        pairs += zip(times, briefs[k, joint], strict=True)
        found.append(_apart(start, sorted(pairs), end))
    rows = itertools.zip_longest(*found)
    table = np.array(list(rows), dtype=float)
    return np.where(np.isnan(table), limits.end, table)


def _apart(start: float, wanted: list[tuple[float, float]], end: float) -> list[float]:
    """Breaks of a segment, s, without pieces so short that a longer one costs next to nothing.

    Without a break its joint is faster by half its change of jerk times the times to the breaks
    before and after. So one that follows another one closely may move away from it. `wanted` holds
    the breaks in order, each with a time, s: leaving it out may cost that time's square.
    """
    kept = [start]
    inner = [time for time, _ in wanted]
    after = [*inner[1:], end]
    for (time, brief), following in zip(wanted, after, strict=True):
        last = kept[-1]
        gap = time - last
        if gap * (following - time) > brief**2:
            earliest = last + brief**2 / gap
            latest = end - brief**2 / (end - time)
            kept.append(min(max(time, earliest), latest))
    return [*kept, end]


def _exceeds(
    scaled: Scaled,
    lengths: Array,
    levels: Array,
    velocity: Array,
) -> Bools:
    """Which cells with jerk limits have a motion that exceeds a limit, `(segments, joints)`."""
    cubics, *_ = integrated(lengths, levels, velocity[:-1])
    first, last = _both(levels)
    speeds = cubics[2]
    jerks = (last - first) / lengths
    # the fastest point of a piece, at no acceleration
    passes = first * last < 0
    lost = np.where(passes, first**2 / (2 * jerks), 0.0)
    velocities = np.concatenate([speeds, speeds - lost])
    signs = np.array([[-1.0], [1.0]])
    limits = [scaled.v, scaled.a, signs / scaled.r]
    shares = []
    for values, sides in zip([velocities, levels, jerks], limits, strict=True):
        shares += [np.fmax.reduce(values / side) for side in sides]
    exceeds = np.max(shares, axis=0) > 1 + EXCESS_RTOL
    return np.asarray(exceeds & scaled.r.any(axis=0))
