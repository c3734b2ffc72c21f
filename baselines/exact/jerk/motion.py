"""The jerk-limited motion through the waypoint states of an optimum (mathematics, section 5).

`_fitted` makes it in these steps:

1. *States* (`_settled`). The barrier of the interior point keeps away from waypoint states at which
   a phase vanishes. There the displacement depends on the state at second order only, so the
   optimum's state has a short phase that the motion does not need. Newton's method moves the state
   to where that phase vanishes. A state close to its limit becomes the limit. An
   acceleration becomes 0 where the joint has slack in both segments. Only states at inner waypoints
   change, and only where neither segment becomes impossible.
2. *Waypoints that were left out* (`_bent`). In a brief segment each joint bends towards one.
3. *Accelerations* (`_KnottedProfiles`). Each joint takes the convex combination of its two extreme
   profiles that covers the displacement. The motion has the accelerations of that combination at
   its breaks, and they are linear in between. So it keeps the limits of jerk and acceleration
   wherever the breaks are. But it misses the next waypoint a little.
4. *Breaks* (`_breaks`). All joints of a segment share its breaks. A smooth change of acceleration
   (`Segments.mended`) corrects the motion with two evenly spaced breaks. The joints that then
   exceed a limit add the breaks at which their profiles change their jerk.
5. *Corrections and removals* (`Segments.thinned`). The same smooth change corrects the motion with
   all breaks. Where a joint then exceeds a limit, a linear program changes its accelerations.
   Breaks close to another one are removed one by one: each removal is corrected in the same way,
   and undone if a joint exceeds a limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from typing import NamedTuple, Self

import numpy as np

from baselines.exact.jerk.cells import FLIPS, JerkInequalities, JerkTables, JerkUnknowns
from baselines.exact.method.brief_steps import MISS
from baselines.exact.method.chain import at_ends
from baselines.exact.method.pieces import Pieces, quotient, summed
from baselines.exact.method.scaled import (
    BRIEF_PIECE_S,
    Abreast,
    Scaled,
    inner_velocities,
    motions,
)
from baselines.exact.method.segments import MOST, MOST_IN_MOTION, Segments
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.trajectory import Trajectory

# A phase shorter than this share of the longest ramp is removed from a state. The barrier leaves
# phases of 1e-6 to 1e-3. Smaller: brief pieces stay. Larger: real phases are tried too.
BRIEF_RTOL = 1e-2
# Rounding of a phase, as a share of its segment's time. Smaller: pieces of rounding stay.
ROUNDING = 4e-15
# A state closer to its limit than this, relative, becomes the limit. Smaller: a dip of the
# acceleration stays beside the limit. Larger: states are tried that belong inside.
NEAR_RTOL = 1e-4
NEWTON_STEPS = 2  # the phase vanishes to 1e-14; fewer: a brief piece may stay
# Number of evenly spaced inner breaks of a segment. 1: two pieces cannot meet a position and a
# velocity, so every joint needs the breaks of its profiles: twice the pieces. 4: a tenth more
# pieces.
EVEN = 2
# Breaks closer than this to another one, relative to the segment's shortest full ramp, are tried.
# Smaller: more breaks stay. Larger: more attempts.
CLOSE_RTOL = 1e-2
# Share of a jerk limit that the last place of a velocity may cost in a segment. Larger: such a
# segment exceeds its jerk limit by as much. Smaller: more segments have velocities of their own,
# which their neighbours have to meet.
BRIEF_USE = 1e-9
# In a segment with a waypoint left out: a joint whose step is a smaller share of the largest one is
# no leader. Smaller: leaders whose time is mostly rounding are tried.
LEAST_MOVE = 1e-2
# A joint with less slack, relative to its reachable displacements, keeps its motion. Larger: joints
# that could pass the waypoint miss it. Smaller: changes are tried that
# limits forbid.
LEAST_SLACK = 1e-7
LEADER_STEPS = 4  # to the leader's time; fewer: the waypoint is missed by what they leave
# Where the motion misses a waypoint by more than `MISS` roundings, one is tried that is slower by
# `SLOWER` of its time. The judge allows a miss of 1. A larger `SLOWER`: a longer duration. A
# smaller one: less slack.
SLOWER = 3e-7
# Least and largest square of a factor of a brief segment's time. Larger: its neighbours get too
# little time.
TIMES = (1 / 64, 64.0)
HALVES = np.array([[-0.5], [0.5]])
TINY = 1e-300  # instead of dividing by 0


class _Simpler(NamedTuple):
    """What a motion with fewer and longer phases may cost.

    Attributes:
        most: largest share of a limit that the motion may use.
        slack: of a displacement, relative to what the limits allow. Where an extreme displacement
            is closer than this, its profile is taken alone.
        brief: a break is removed if that costs less velocity than jerk gains in this share of a
            ramp.
    """

    most: float
    slack: float
    brief: float


# A larger `brief`: fewer pieces, and velocities above their limits by more.
AT_REST = _Simpler(MOST, 1e-11, 7e-6)
# The judge cannot dilate a motion between given velocities: all three are smaller.
IN_MOTION = _Simpler(MOST_IN_MOTION, 1e-13, 3e-7)


class Reachable(Scaled):
    """A problem without units, and the motions of its optima.

    Attributes:
        left_out: one of the waypoints left out of each segment, rad, `(segments, joints)`; NaN
            where there is none.
    """

    left_out: Array | None = None

    def trajectory(self, times: Array, states: JerkUnknowns) -> Trajectory:
        """Return the motion of an optimum.

        Args:
            times: of the segments, `(segments,)`.
            states: the unknowns of one start.
        """
        if self.tolerance.any():
            moved = self.shifted(np.clip(states.offset[0], -self.tolerance, self.tolerance))
            own = JerkTables(moved).linked(times[None], states.velocity, states.acceleration)
            return moved.trajectory(times, own)
        (motion,) = fitted([self], times[None], states)
        return motion


def fitted(every: Sequence[Reachable], times: Array, states: JerkUnknowns) -> list[Trajectory]:
    """Return the motions of optima, with few breaks, in the steps of the module's docstring.

    Args:
        every: problems of one shape, from rest to rest; or one alone.
        times: of their segments, `(problems, segments)`.
        states: the unknowns of one start for each.
    """
    with np.errstate(all="ignore"):
        pieces, segments = _fitted(every, times, states)
        return motions(every, pieces, segments.u, segments)


def _fitted(
    every: Sequence[Reachable], times: Array, states: JerkUnknowns
) -> tuple[Pieces, Segments]:
    """Return the pieces of all problems' segments, some of no length, and what they are to meet."""
    abreast = Abreast(every)
    allowed = _AllowedMotion.of(abreast, times)
    rows = _settled(JerkInequalities(JerkTables(every[0], every=every), states), allowed)
    left_out = every[0].left_out
    if left_out is not None:
        rows = _bent(rows, allowed, every[0], left_out)
        times = rows.times
        allowed = _AllowedMotion.of(abreast, times)
    limits = allowed.in_a_row()
    profiles = _KnottedProfiles.of(rows, allowed)
    starts, stops = _velocities(abreast, times, rows.point.ends)
    times = times.ravel()
    signs = np.reshape([-1.0, 1.0], (2, 1, 1, 1))
    shape = 2, *abreast.h.shape
    limited = abreast.v, abreast.a, signs / abreast.r
    most = limits.simpler.most
    segments = Segments.under(
        _in_a_row(starts),
        _in_a_row(stops),
        _in_a_row(abreast.h),
        *(_in_a_row(np.broadcast_to(sides, shape)) for sides in limited),
    )._replace(most=most)

    even = np.linspace(0.0, np.ones_like(times), EVEN + 2)
    gentle = segments.mended(profiles.pieces(even, limits))
    suffices = segments.use(gentle) <= most
    needs_own = ~(suffices & limits.jerky)
    breaks = _breaks(profiles, limits, even, needs_own)
    own = profiles.pieces(breaks, limits)
    others = _cut(gentle, breaks, limits)
    start = np.where(needs_own, own.start, others.start)
    jerk = np.where(needs_own, own.jerk, others.jerk)
    pieces = Pieces(own.lengths, start, jerk)
    ramps = np.where(limits.jerky, limits.ramp, np.inf)
    briefest = ramps.min(axis=1) * times
    brief = np.repeat([BRIEF_PIECE_S / own.unit for own in every], abreast.h.shape[1])
    close = np.maximum(CLOSE_RTOL * briefest, brief)
    return segments.thinned(pieces, close, brief), segments


def _in_a_row(table: Array) -> Array:
    """Return a table `(…, problems, segments, joints)` with the segments of all on one axis."""
    return table.reshape(*table.shape[:-3], -1, table.shape[-1])


def _velocities(abreast: Abreast, times: Array, ends: Array) -> tuple[Array, Array]:
    """Return the velocities at the segments' starts and ends, `(problems, segments, joints)` each.

    They are the waypoints' velocities. In a segment so short that a unit in the last place of a
    velocity would cost a noticeable jerk they are the segment's own; the long segments beside it
    take up the difference.
    """
    inner = inner_velocities(abreast.h, times, ends, abreast.closed)
    velocities = at_ends(inner, abreast.end_v, abreast.closed)
    t = times[..., None]
    own = abreast.h / t + t * ends
    speeds = np.abs(own).max(axis=0)
    is_brief = ROUNDING * speeds * abreast.r.max(axis=0) > BRIEF_USE * t**2
    is_brief[:, [0, -1]] = False
    starts, stops = np.where(is_brief, own, velocities)
    return starts, stops


def _lengths(breaks: Array, limits: _AllowedMotion) -> Array:
    """Return the times between breaks, `(pieces, segments, 1)`."""
    shares = np.diff(breaks, axis=0)
    return shares[..., None] * limits.times


def _cut(gentle: Pieces, breaks: Array, limits: _AllowedMotion) -> Pieces:
    """Return evenly spaced pieces, cut at further breaks that include theirs."""
    count = EVEN + 1
    which = np.minimum(count * breaks, EVEN).astype(int)
    every = np.arange(breaks.shape[1])
    since = breaks - which / count
    change = gentle.jerk[which, every] * since[..., None] * limits.times
    levels = gentle.start[which, every] + change
    return Pieces.straight(_lengths(breaks, limits), levels[:-1], levels[1:])


class _AllowedMotion(NamedTuple):
    """Largest changes that the limits allow in each segment.

    Attributes:
        times: of the segments, `(problems, segments, 1)`.
        jerky: which joints have jerk limits.
        gained: the acceleration that jerk allows in the time, at most its limit,
            `(problems, segments, joints)`.
        ramp: the longest time with the same jerk, as a share of the segment's, likewise.
        vanished: a phase of a smaller share is rounding, likewise.
        slack: what a simpler motion may cost of a displacement, likewise.
        simpler: what else it may cost.
    """

    times: Array
    jerky: Bools
    gained: Array
    ramp: Array
    vanished: Array
    slack: Array
    simpler: _Simpler

    @classmethod
    def of(cls, abreast: Abreast, segment_times: Array) -> Self:
        times = segment_times[..., None]
        slowest = np.abs(abreast.v).min(axis=0)
        steepest = np.abs(abreast.a).min(axis=0)
        slow = abreast.r.max(axis=0)
        by_jerk = times / np.maximum(slow, TINY)
        gained = np.minimum(steepest, by_jerk)
        faster = np.minimum(slowest, steepest * times)
        ramp = np.sqrt(faster * slow) / times
        ramp = np.minimum(ramp, 1.0)
        simpler = AT_REST if abreast.every[0].problem.route.at_rest else IN_MOTION
        vanished = simpler.slack * ramp + ROUNDING
        jerky = (slow > 0).any(axis=(0, 1))
        return cls(times, jerky, gained, ramp, vanished, simpler.slack * gained, simpler)

    def in_a_row(self) -> Self:
        """Return the tables with the segments of all problems on one axis."""
        return self._replace(
            times=_in_a_row(self.times),
            gained=_in_a_row(self.gained),
            ramp=_in_a_row(self.ramp),
            vanished=_in_a_row(self.vanished),
            slack=_in_a_row(self.slack),
        )


def _bent(
    rows: JerkInequalities, limits: _AllowedMotion, scaled: Reachable, left_out: Array
) -> JerkInequalities:
    """Return the program with states whose motion bends towards waypoints that were left out.

    Where limits leave too little freedom for that the motion is slower by `SLOWER`, and its brief
    segments may take other times.
    """
    *_, q_unit = scaled.units
    away = (left_out - scaled.problem.waypoints[:-1]) / q_unit
    rounding = scaled.problem.rounding / q_unit
    passed = _Passed(limits, away, rounding)
    bent = passed.by(rows, LEAST_SLACK)
    if bent.missed <= MISS or not scaled.problem.route.at_rest:
        return bent.rows
    for factors in (np.ones_like(rows.times), passed.times(rows)):
        slower = passed.by(passed.slower(rows, factors), -np.inf)
        within = slower.rows.values >= -limits.slack
        if slower.missed <= MISS and within.all():
            return slower.rows
    return bent.rows


class _Bend(NamedTuple):
    """The inequalities at new states, and the largest miss of a waypoint by their motion.

    Attributes:
        rows: The inequalities.
        missed: The miss at the time at which the leader passes the waypoint, relative to the
            rounding of the waypoint's coordinates.
    """

    rows: JerkInequalities
    missed: float


class _Passed(NamedTuple):
    """Waypoints that were left out, one in each of some brief segments.

    The *leader* is the joint whose motion says when the waypoint is passed: its state stays. The
    other joints bend so that they pass the waypoint at that time.

    Attributes:
        limits: of the motion.
        away: from the segments' starts, `(segments, joints)`; NaN where there is none.
        rounding: of each joint's coordinates, `(joints,)`.
    """

    limits: _AllowedMotion
    away: Array
    rounding: Array

    @property
    def brief(self) -> Indices:
        """The segments of these waypoints."""
        return np.flatnonzero(np.isfinite(self.away[1:-1]).all(axis=1)) + 1

    def by(self, rows: JerkInequalities, least: float) -> _Bend:
        """Return the program whose motion passes them, if it can.

        A joint of no more than the `least` slack keeps its motion. Each joint of a large enough
        step (`LEAST_MOVE`) is tried as leader; that of the least miss counts.
        """
        worst = 0.0
        for segment in self.brief:
            steps = np.abs(rows.cells.scaled.h[segment])
            leaders = np.flatnonzero(steps >= LEAST_MOVE * steps.max())
            follows = self.limits.jerky & (self._slack(rows, segment) > least)
            bends = [self._led(rows, segment, leader, follows) for leader in leaders.tolist()]
            best = min(bends, key=attrgetter("missed"))
            rows = best.rows
            worst = max(worst, best.missed)
        return _Bend(rows, worst)

    def times(self, rows: JerkInequalities) -> Array:
        """Return factors of the times with which the joint of least slack bends as it should."""
        factors = np.ones_like(rows.times)
        for segment in self.brief:
            leader = int(np.abs(rows.cells.scaled.h[segment]).argmax())
            own = rows.point.acceleration[0, segment - 1 : segment + 1].mean(axis=0)
            _, wished = self._wished(rows, segment, leader)
            slack = self._slack(rows, segment)
            slack[leader] = np.inf
            tightest = slack.argmin()
            factors[0, segment] = np.sqrt(np.clip(wished[tightest] / own[tightest], *TIMES))
        return factors

    def slower(self, rows: JerkInequalities, factors: Array) -> JerkInequalities:
        """Return the program of a slower motion, with each joint's mean acceleration in between."""
        slower = 1 + SLOWER
        times = slower * rows.times
        longer = (factors - 1) * times
        times += longer
        # the segments beside make up for it
        times[:, :-1] -= longer[:, 1:] / 2
        times[:, 1:] -= longer[:, :-1] / 2
        velocity, acceleration = rows.point.velocity / slower, rows.point.acceleration / slower**2
        for segment in self.brief:
            ends = [segment - 1, segment]
            t = times[0, segment]
            mean = acceleration[0, ends].mean(axis=0)
            acceleration[0, ends] = mean
            velocity[0, ends] = rows.cells.scaled.h[segment] / t + HALVES * mean * t
        return JerkInequalities(rows.cells, rows.cells.linked(times, velocity, acceleration))

    def _slack(self, rows: JerkInequalities, segment: int) -> Array:
        """Return what the segments beside leave each joint, of what they reach."""
        beside = [segment - 1, segment + 1]
        reach = rows.reach[:, 0, beside].min(axis=(0, 1))
        return np.asarray(reach / self.limits.gained[0, beside].min(axis=0))

    def _wished(self, rows: JerkInequalities, segment: int, leader: int) -> tuple[float, Array]:
        """Return when the leader passes the waypoint, and with which acceleration all joints do."""
        h, t, away = rows.cells.scaled.h[segment], rows.times[0, segment], self.away[segment]
        bend = rows.point.acceleration[0, segment - 1 : segment + 1, leader].mean() * t**2 / 2
        # h s + a t² s (s − 1)/2 = d
        share = away[leader] / h[leader]
        for _ in range(LEADER_STEPS):
            share = (away[leader] - bend * share * (share - 1)) / h[leader]
        return share, 2 * (away - h * share) / (t**2 * share * (share - 1))

    def _led(self, rows: JerkInequalities, segment: int, leader: int, follows: Bools) -> _Bend:
        """Return the program whose joints pass the waypoint at the time at which the leader does.

        In the brief segment acceleration is constant. The joints that follow take the one with
        which they pass the waypoint, where the segments beside allow it.
        """
        ends = [segment - 1, segment]
        h, t = rows.cells.scaled.h[segment], rows.times[0, segment]
        share, wished = self._wished(rows, segment, leader)
        follows = follows & (np.arange(len(h)) != leader)
        velocity = rows.point.velocity.copy()
        acceleration = rows.point.acceleration.copy()
        turned = h / t + HALVES * wished * t
        velocity[0, ends] = np.where(follows, turned, velocity[0, ends])
        acceleration[0, ends] = np.where(follows, wished, acceleration[0, ends])
        after = _moved(rows, velocity, acceleration)
        own = slice(segment - 1, segment + 2)
        least = np.minimum(rows.values, 0.0) - self.limits.slack
        fine = (after.values >= least)[:, 0, 0, own].all(axis=(0, 1))
        velocity = np.where(fine, velocity, rows.point.velocity)
        acceleration = np.where(fine, acceleration, rows.point.acceleration)
        bends = (acceleration[0, ends].mean(axis=0) - wished) * t**2 / 2
        bends[leader] = 0.0
        missed = np.abs(bends * share * (share - 1)) / self.rounding
        return _Bend(_moved(rows, velocity, acceleration), missed.max())


def _settled(rows: JerkInequalities, limits: _AllowedMotion) -> JerkInequalities:
    """Return the program with states without short phases, where no cell becomes unreachable.

    Odd waypoints change first, then the even ones: so a cell never depends on two changes at once.
    """
    _, waypoints, _ = rows.point.velocity.shape
    odd = np.arange(waypoints)[:, None] % 2 == 1
    for chosen in (odd, ~odd):
        after = rows
        for _ in range(NEWTON_STEPS):
            after = _settling(after, limits, chosen)
        least = np.minimum(rows.reach, 0.0) - limits.slack
        # A ramp of negative length means that the state is not reachable.
        negative = after.profiles.first < -limits.vanished
        is_used = _shares(after, limits) > 0
        is_spoilt = is_used & negative.any(axis=0)
        is_fine = (after.reach >= least) & ~is_spoilt
        kept = _of_both_cells(is_fine.all(axis=0), rows.cells.closed)
        if (kept | ~chosen).all():
            rows = after
            continue
        velocity = np.where(kept, after.point.velocity, rows.point.velocity)
        acceleration = np.where(kept, after.point.acceleration, rows.point.acceleration)
        rows = _moved(rows, velocity, acceleration)
    return rows


def _settling(rows: JerkInequalities, limits: _AllowedMotion, chosen: Bools) -> JerkInequalities:
    """Return the program after a step of Newton's method at some of the waypoints.

    A joint that moves by one extreme profile (`is_alone`) in a cell gets the acceleration at which
    the profile's short first phase vanishes; of several such accelerations, the nearest. A joint
    with slack in both cells gets the acceleration 0.
    """
    cells = rows.cells
    first = rows.profiles.acceleration
    velocity, acceleration = rows.point.velocity, rows.point.acceleration
    is_alone = _shares(rows, limits) == 1
    is_brief = rows.profiles.first < BRIEF_RTOL * limits.ramp
    # the level changes by the share up/(up + down) of a change in acceleration
    missing = rows.profiles.rises - first
    ahead = missing * (1 + cells.up / cells.down)
    level = cells.signs * FLIPS * (first + ahead)
    sides = cells.waypoint_a
    wished = _by_waypoint(level, cells.closed)
    changes = np.clip(wished, *sides) - acceleration
    is_wanted = _by_waypoint(is_alone & limits.jerky & is_brief, cells.closed)
    wanted = np.where(is_wanted, changes, np.inf)
    least = np.abs(wanted).argmin(axis=0)[None]
    (change,) = np.take_along_axis(wanted, least, axis=0)
    free = _of_both_cells(limits.jerky & ~is_alone.any(axis=0), cells.closed)
    # At a velocity limit a short ramp would leave a dip: velocity and acceleration are set to it.
    fastest, is_fast = _nearest(velocity, cells.waypoint_v, limits)
    steepest, is_steep = _nearest(acceleration, sides, limits)
    cases = [~chosen, is_fast, is_steep, free, np.isfinite(change)]
    values = [acceleration, 0.0, steepest, 0.0, acceleration + change]
    settled = np.select(cases, values, acceleration)
    faster = np.where(chosen & is_fast, fastest, velocity)
    return _moved(rows, faster, settled)


def _nearest(values: Array, sides: Array, limits: _AllowedMotion) -> tuple[Array, Bools]:
    """Return the limit on each value's side, and whether the value is close to it."""
    low, high = sides
    limit = np.where(values > 0, high, low)
    room = np.abs(limit - values)
    is_near = room < NEAR_RTOL * np.abs(limit)
    return limit, is_near


def _moved(rows: JerkInequalities, velocity: Array, acceleration: Array) -> JerkInequalities:
    """Return the program with other waypoint states."""
    point = rows.point
    change = at_ends(velocity - point.velocity, closed=rows.cells.closed)
    ends = point.ends + change / rows.t
    moved = point._replace(ends=ends, velocity=velocity, acceleration=acceleration)
    return JerkInequalities(rows.cells, moved)


def _by_waypoint(cells: Array, closed: bool) -> Array:
    """Return values of the cells before and after each waypoint with a state among the unknowns.

    From `(2 ends, 2 sides, 1, segments, joints)` to `(4, 1, waypoints, joints)`: both sides of the
    cell before the waypoint, then of the one after it.
    """
    start, end = cells
    if closed:
        return np.concatenate([end, np.roll(start, -1, axis=2)])
    before = end[:, :, :-1]
    after = start[:, :, 1:]
    return np.concatenate([before, after])


def _of_both_cells(cells: Bools, closed: bool) -> Bools:
    """Return at which waypoints this holds for the cell before it and for the one after it."""
    if closed:
        return np.asarray(cells & np.roll(cells, -1, axis=1))
    before = cells[:, :-1]
    after = cells[:, 1:]
    return np.asarray(before & after)


def _shares(rows: JerkInequalities, limits: _AllowedMotion) -> Array:
    """Return the shares of both profiles that cover the displacement.

    `(2 sides, 1, segments, joints)`.
    """
    is_tight = rows.reach <= limits.slack
    high, low = np.where(is_tight, 0.0, rows.reach)
    share = low / np.maximum(high + low, TINY)
    return np.array([share, 1 - share])


class _KnottedProfiles(NamedTuple):
    """The extreme profiles of every cell, from both ends to the peak between them.

    Attributes:
        knots: shares of the segment's time, `(8, 2 sides, segments, joints)`.
        levels: accelerations there, straight in between, of the same shape.
        shares: of both profiles in the motion, `(2 sides, segments, joints)`.
    """

    knots: Array
    levels: Array
    shares: Array

    @classmethod
    def of(cls, rows: JerkInequalities, limits: _AllowedMotion) -> Self:
        """Return the profiles of these cells."""
        cells = rows.cells
        profiles = rows.profiles
        rises = profiles.rises
        first = profiles.acceleration
        rise, fall = rises
        peak = np.clip(0.0, -fall, rise)
        peaks = np.array([peak, -peak])
        last = profiles.limits.down * (rises - peaks)
        own = np.array([profiles.first, profiles.hold, last])
        # A phase that was removed from the state has a length of rounding.
        phases = np.where(own < limits.vanished, 0.0, own)
        moving = _in_order(phases, phases)
        cruise = _in_a_row(profiles.cruise)
        knots = _knots(np.insert(moving, len(phases), cruise, axis=0))
        is_held = limits.jerky & (phases[0] == 0)
        held = np.where(is_held, first, rises)
        levels = cells.signs * np.array([first, held, held, peaks])
        shares = _in_a_row(_shares(rows, limits))
        return cls(knots, _in_order(levels, -levels), shares)

    def breaks(self) -> Array:
        """Return the ends of phases within segments, NaN elsewhere, `(16, segments, joints)`."""
        is_inside = (self.knots > 0) & (self.knots < 1)
        is_used = is_inside & (self.shares > 0)
        breaks = np.where(is_used, self.knots, np.nan)
        return breaks.reshape(-1, *breaks.shape[2:])

    def pieces(self, breaks: Array, limits: _AllowedMotion) -> Pieces:
        """Return the motion with the profiles' accelerations at breaks, `(breaks, segments)`.

        Without a jerk limit they jump at breaks: a piece has that of its middle throughout.
        """
        middles = (breaks[:-1] + breaks[1:]) / 2
        both = self._levels(np.concatenate([breaks, middles]))
        at_breaks, within = np.split(both, [len(breaks)])
        return Pieces.between(_lengths(breaks, limits), at_breaks, within, limits.jerky)

    def _levels(self, times: Array) -> Array:
        """Return accelerations at shares of the segments' times, `(times, segments, joints)`."""
        # the index of the phase of each profile
        passed = self.knots[1:-1] <= times[:, None, None, :, None]
        phase = passed.sum(axis=1)
        start = np.take_along_axis(self.knots, phase, axis=0)
        end = np.take_along_axis(self.knots, phase + 1, axis=0)
        low = np.take_along_axis(self.levels, phase, axis=0)
        high = np.take_along_axis(self.levels, phase + 1, axis=0)
        since = times[:, None, :, None] - start
        length = end - start
        share = quotient(since, length, length > 0)
        change = share * (high - low)
        # One of both profiles may not exist.
        parts = np.nan_to_num(self.shares * (low + change))
        return np.asarray(parts.sum(axis=1))


def _in_order(from_start: Array, from_end: Array) -> Array:
    """Return values of both ends, each ordered inwards, on one axis in the order of time."""
    start = from_start[:, 0]
    end = from_end[:, 1]
    return _in_a_row(np.concatenate([start, end[::-1]]))


def _knots(phases: Array) -> Array:
    """Return 0 and the ends of the phases; the longest phase takes the rest of the time 1."""
    from_start = summed(0.0, phases)
    left = summed(0.0, phases[::-1])
    from_end = 1 - left[::-1]
    numbers = np.arange(len(from_start))
    longest = phases.argmax(axis=0)
    is_before = numbers[:, None, None, None] <= longest
    return np.where(is_before, from_start, from_end)


def _breaks(
    profiles: _KnottedProfiles, limits: _AllowedMotion, even: Array, needs_own: Bools
) -> Array:
    """Return the breaks of all joints of a segment, shares of its time, `(breaks, segments)`.

    They end with ones, where a segment has fewer than others.
    """
    wanted = np.where(needs_own, profiles.breaks(), np.inf)
    wanted[np.isnan(wanted)] = np.inf
    briefs = np.broadcast_to(limits.simpler.brief * limits.ramp, wanted.shape)
    inner = even[1:-1]
    times = np.concatenate([inner, _by_segment(wanted)])
    brief = np.concatenate([0 * inner, _by_segment(briefs)])
    order = np.lexsort((brief, times), axis=0)
    ordered = (np.take_along_axis(table, order, axis=0) for table in (times, brief))
    return _apart(*ordered)


def _by_segment(table: Array) -> Array:
    """Return a table `(phases, segments, joints)` with all of a segment's on one axis."""
    return np.moveaxis(table, 1, -1).reshape(-1, table.shape[1])


def _apart(wanted: Array, brief: Array) -> Array:
    """Return breaks of segments without those whose removal costs next to nothing.

    Without a break its joint is faster by half its change of jerk times the times to the breaks
    before and after. So one that follows another one closely may move away from it.

    Args:
        wanted: shares of the segments' times, in order, infinite where there are no more,
            `(breaks, segments)`.
        brief: leaving a break out may cost this time's square, likewise.

    Returns:
        The breaks from 0 to 1, and ones after them.
    """
    wanted = wanted[np.isfinite(wanted).any(axis=1)]
    last = np.zeros(wanted.shape[1])
    kept = np.ones((len(wanted) + 2, len(last)))
    kept[0] = last
    for number, time in enumerate(wanted, start=1):
        after = wanted[number] if number < len(wanted) else np.inf
        gap = time - last
        cost = brief[number - 1] ** 2
        earliest = last + cost / gap
        latest = 1 - cost / (1 - time)
        own = np.minimum(np.maximum(time, earliest), latest)
        is_kept = np.isfinite(time) & (gap * (np.minimum(after, 1.0) - time) > cost)
        kept[number] = np.where(is_kept, own, 1.0)
        last = np.where(is_kept, own, last)
    return np.sort(kept, axis=0)[: (kept < 1).sum(axis=0).max() + 1]
