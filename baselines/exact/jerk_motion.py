"""The jerk-limited motion through given waypoint states (mathematics, section 4).

In a segment a joint may take any convex combination of its two extreme profiles that covers the
displacement. A trajectory stores its breaks as times since its start, after half a minute to
4e-15 s. So breaks are rounded first. The motion has the accelerations of that combination at the
breaks and is straight between them: so it keeps the limits of jerk and acceleration wherever the
breaks are.

The barrier leaves phases at the waypoints that take no time at the optimum. So waypoint states are
settled first: an acceleration that is close to the level that it is to reach becomes that level.

All joints of a segment share its breaks. Where two even ones serve, a joint needs no others; else
it needs those at which its profiles change their jerk. What the breaks cost is made up for: first
by the velocities at the waypoints, each as its briefer segment would have it, then by a smooth
change of acceleration.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from baselines.exact.acceleration_motion import Task, pieces
from baselines.exact.cells import at_ends
from baselines.exact.chain import owners
from baselines.exact.jerk_cells import Cells, Point, Rows
from baselines.exact.jerk_profiles import CRUISE, HOLD, RAMP, RELEASE
from baselines.exact.rounded import integrated, later
from baselines.exact.scaled import Scaled
from trajopt.core.arrays import Array, Bools
from trajopt.core.trajectory import Trajectory

EVEN = 2  # evenly spaced inner breaks of a segment
# Share of a limit. A joint that exceeds one by more needs breaks of its own.
EXCESS_RTOL = 3e-11
# An extreme profile with a smaller share is left out; one with all but this share is active.
MIN_SHARE = 1e-11
ACTIVE_SHARE = 1e-9
SLACK_SHARE = 1e-3
# A phase that may vanish when waypoints settle, and what that may cost of a ramp and of the reach.
BRIEF_RTOL = 1e-2
SETTLED_RTOL = 1e-11
NEWTON_STEPS = 3
TURNS = (1, 0, 1, 0)
# The shortest piece in units of the longest ramp.
LEAST_RTOL = 1e-5
# Residuals that are rounding, relative to the numbers that they come from.
ROUNDING_RTOL = 4e-15
MENDINGS = 2  # the second one mends the rounding of the first
ANCHOR = 4e-12
TINY = 1e-300  # instead of dividing by 0


# Numbers at a segment's end are seen backwards.
FLIPS = np.array([1.0, -1.0]).reshape(2, 1, 1, 1)


class Reachable(Scaled):
    """A problem without units, and the motions through given waypoint states."""

    def trajectory(self, times: Array, states: Point) -> Trajectory:
        """The motion of an optimum.

        Args:
            times: of the segments, `(segments,)`.
            states: of one start.
        """
        times, states = self._storable(times, states)
        passages = np.append(0.0, np.cumsum(times * self.unit))
        with np.errstate(all="ignore"):
            breaks, velocity, levels = _fitted(self, times, passages, states)
        lengths = np.diff(breaks, axis=0)
        used = lengths.T > 0
        _, a_unit, v_unit, q_unit = self.units
        cubics, *_ = integrated(lengths[..., None], a_unit * levels, v_unit * velocity[:-1])
        cubics[-1] += self.problem.waypoints[:-1, self.moving]
        stored = np.append(breaks[:-1].T[used], passages[-1])
        by_segment = cubics.swapaxes(1, 2)[:, used]
        joints = [(stored, by_segment[..., i]) for i in range(len(a_unit))]
        jerky = self.r.any(axis=0)
        for i in np.flatnonzero(~jerky).tolist():
            one = slice(i, i + 1)
            task = Task(
                self.h[:, one],
                velocity[:-1, one],
                velocity[1:, one],
                self.v[:, one],
                self.a[:, one],
                self.unit,
                self.units[1:, one],
                self.problem.waypoints[:-1, self.moving][:, one],
                np.array([[-np.inf], [np.inf]]),
            )
            joints[i], = pieces(task, passages)
        return Trajectory.of_moving(self.problem.waypoints[0], self.moving, joints, passages)

    def _storable(self, times: Array, states: Point) -> tuple[Array, Point]:
        """The times and states of a motion that is slower by what rounding takes, 1e-10 or so.

        Where a segment is brief its rounded time decides how fast it is passed. In between the
        motion slows down evenly from one such segment to the next one.
        """
        passages = np.append(0.0, np.cumsum(times * self.unit))
        spacing = np.spacing(passages[1:]) / self.unit
        rounded = np.ceil(times / spacing) * spacing
        (brief,) = np.nonzero(spacing > ANCHOR * times)
        if not brief.size:
            return times, states
        slower = rounded[brief] / times[brief] - 1
        at = np.array([passages[brief], passages[brief + 1]]).T.ravel()
        by_waypoint = np.interp(passages, at, np.repeat(slower, 2))
        first = by_waypoint[:-1]
        last = by_waypoint[1:]
        of_cells = (first + last) / 2
        of_cells[brief] = slower
        apart = np.array([first - of_cells, last - of_cells])[:, None, :, None]
        velocity = at_ends(states.velocity)
        t = times[:, None]
        ends = states.ends / (1 + of_cells[:, None]) ** 2 - velocity * apart / t
        inner = 1 + by_waypoint[1:-1, None]
        log = states.log + np.log1p(of_cells)
        slow = Point(log, ends, states.velocity / inner, states.acceleration / inner**2)
        return times * (1 + of_cells), slow


def _fitted(
    scaled: Scaled, times: Array, passages: Array, states: Point
) -> tuple[Array, Array, Array]:
    """The motion with the fewest breaks that serve.

    Args:
        scaled: the problem.
        times: of the segments, `(segments,)`.
        passages: when the waypoints are passed, as it is stored, s, `(segments + 1,)`.
        states: at the waypoints.

    Returns:
        Breaks, s, `(breaks, segments)`, where the end of a segment repeats; velocities at the
        waypoints; accelerations at the breaks, `(breaks, segments, joints)`.
    """
    limits = _Limits.of(scaled, passages)
    rows = _settled(Cells(scaled), limits, states)
    velocity = _velocities(rows)
    acceleration = np.pad(rows.point.acceleration[0], ((1, 1), (0, 0)))
    profiles = _Profiles.of(limits, rows)
    # with even breaks alone
    even = np.linspace(limits.start, limits.end, EVEN + 2)
    since = limits.since(even)
    lengths = np.diff(since[0], axis=0)
    passed = since[0] / limits.times
    gentle = profiles.accelerations(since, acceleration)
    gentle = _mended(lengths, passed, gentle, velocity, scaled.h)
    excess = _excess(scaled, lengths, gentle, velocity)
    needs_own = limits.jerky & (excess > EXCESS_RTOL)

    breaks = _breaks(profiles, limits, needs_own)
    since = limits.since(breaks)
    lengths = np.diff(breaks, axis=0)[..., None] / limits.unit
    passed = since[0] / limits.times
    own = profiles.accelerations(since, acceleration)
    levels = np.where(needs_own, own, _between(gentle, passed))
    slow, short = _missing(lengths, levels, velocity, scaled.h)
    # a cell that misses nothing would have that much more velocity at its ends
    added = short / limits.times
    agreed = velocity + _agreed(added - slow, added, limits.weights)
    return breaks, agreed, _mended(lengths, passed, levels, agreed, scaled.h)


def _between(levels: Array, passed: Array) -> Array:
    """Values between even breaks, where that share of the time has passed."""
    place = passed * (EVEN + 1)
    before = np.clip(place.astype(int), 0, EVEN)
    left = np.take_along_axis(levels, before, axis=0)
    right = np.take_along_axis(levels, before + 1, axis=0)
    return left + (place - before) * (right - left)


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

    def since(self, breaks: Array) -> Array:
        """Breaks `(breaks, segments)` counted from both ends, `(2, breaks, segments, 1)`."""
        since = np.array([breaks - self.start, self.end - breaks])
        return since[..., None] / self.unit


def _settled(cells: Cells, limits: _Limits, states: Point) -> Rows:
    """The cells with states that leave no brief phase at the waypoints, where that costs no reach.

    Neighbouring waypoints take turns, so that one that may not settle keeps no other from it.
    """
    rows = Rows(cells, states)
    numbers = np.arange(states.velocity.shape[1])[:, None]
    for turn in TURNS:
        after = rows
        for _ in range(NEWTON_STEPS):
            after = Rows(cells, _settling(after, limits, numbers % 2 == turn))
        least = np.minimum(rows.reach[:, 0], 0.0) - SETTLED_RTOL * limits.gained
        # a ramp of negative length is out of reach
        negative = after.phases[RAMP, ..., 0, :, :] < -SETTLED_RTOL * limits.ramp / rows.t[0]
        spoilt = negative & (_shares(after) > MIN_SHARE)
        kept = ((after.reach[:, 0] >= least) & ~spoilt.any(axis=0)).all(axis=0)
        rows = Rows(cells, _chosen(kept[1:] & kept[:-1], after.point, rows.point))
    return rows


def _settling(rows: Rows, limits: _Limits, chosen: Bools) -> Point:
    """The point after a step of Newton's method towards states that leave no brief phase."""
    point = rows.point
    cells = rows.cells
    velocity = point.velocity[0]
    acceleration = point.acceleration[0]
    shares = _shares(rows)
    phases = rows.phases[..., 0, :, :]
    ramp = limits.ramp / rows.t[0]
    is_active = (shares > 1 - ACTIVE_SHARE) & limits.jerky
    brief = (phases < BRIEF_RTOL * ramp) & is_active
    # a dip below the velocity limit
    dips = brief[RAMP] & brief[RELEASE] & (phases[HOLD] <= 0) & (phases[CRUISE] > 0)
    dips = _beside(dips)
    # a change of the first acceleration changes the level by the share r1 of r1 + r2
    rises = rows.profiles.rises[..., 0, :, :]
    level = _beside(rises * cells.signs[:, 0] * FLIPS)
    slower = np.vstack([cells.down[:2, 0] / (cells.up + cells.down)[:2, 0]] * 2)
    settled = acceleration + (level - acceleration) / slower
    settled = np.clip(settled, *cells.scaled.a)
    settled = np.where(dips, 0.0, settled)
    briefest = np.where(_beside(brief[RAMP]), _beside(phases[RAMP]), np.inf)
    nearest = briefest.argmin(axis=0)[None]
    settles = np.take_along_axis(briefest, nearest, axis=0)[0] < np.inf
    to = np.take_along_axis(settled, nearest, axis=0)[0]
    dip = np.take_along_axis(dips, nearest, axis=0)[0] & settles & chosen
    is_slack = (shares.max(axis=0) < 1 - SLACK_SHARE) & limits.jerky
    free = is_slack[1:] & is_slack[:-1]
    to = np.where(settles, to, np.where(free, 0.0, acceleration))
    low, high = cells.scaled.v
    limit = np.where(velocity > 0, high, low)
    faster = np.where(dip, limit, velocity)[None]
    put = at_ends(dip[None] * 1.0) > 0
    ends = (at_ends(faster) - rows.mean) / rows.t
    return Point(
        point.log,
        np.where(put, ends, point.ends),
        faster,
        np.where(chosen, to, acceleration)[None],
    )


def _chosen(some: Bools, one: Point, other: Point) -> Point:
    """The states of one point at some waypoints, and of another one at the rest."""
    put = at_ends(some[None] * 1.0) > 0
    return Point(
        other.log,
        np.where(put, one.ends, other.ends),
        np.where(some, one.velocity, other.velocity),
        np.where(some, one.acceleration, other.acceleration),
    )


def _beside(ends: Array) -> Array:
    """A table `(2 ends, 2 sides, segments, joints)` beside inner waypoints, `(4, …)`."""
    start, end = ends
    return np.concatenate([end[:, :-1], start[:, 1:]])


def _shares(rows: Rows) -> Array:
    """The shares of both extreme profiles that cover the displacement, `(2, segments, joints)`."""
    high, low = np.maximum(rows.reach[:, 0], 0.0)
    share = low / np.maximum(high + low, TINY)
    return np.array([share, 1 - share])


def _velocities(rows: Rows) -> Array:
    """Velocities at the waypoints as the briefer segment has them, `(segments + 1, joints)`."""
    first, last = (rows.mean + rows.t * rows.point.ends)[:, 0]
    _, is_last = owners(rows.times)[:, 0]
    velocity = np.where(is_last[:-1], last[:-1], first[1:])
    return np.pad(velocity, ((1, 1), (0, 0)))


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
    def of(cls, limits: _Limits, rows: Rows) -> Self:
        """The profiles of these cells.

        Where rounding changed a segment's time, each phase keeps its share, and no ramp of jerk
        gets briefer.
        """
        signs = rows.cells.signs[:, 0]
        rises = rows.profiles.rises[:, :, 0]
        at_waypoints = rows.profiles.acceleration[:, :, 0]
        rise, fall = rises
        peak = np.clip(0.0, -fall, rise)
        shares = _shares(rows)
        shares[shares < MIN_SHARE] = 0.0
        shares[shares > 1 - MIN_SHARE] = 1.0
        phases = rows.phases[:, :, :, 0]
        # at rest on the velocity limit a dip is rounding, and so is what is left of a settled phase
        room = rows.profiles.limits.top - rows.profiles.velocity
        on_limit = (room <= SETTLED_RTOL * rows.cells.highest / rows.t)[:, :, 0]
        dips = on_limit & (at_waypoints == 0) & (phases[CRUISE] > 0)
        ramp = limits.ramp / rows.t[0]
        vanish = dips | (phases < SETTLED_RTOL * ramp)
        phases = np.where(vanish, 0.0, phases)
        # the end is passed backwards
        origins = np.array([limits.start, -limits.end])
        places = [origins[:, None, :, None] + 0 * rises]
        for length in phases[:CRUISE] * limits.times * limits.unit:
            places.append(later(places[-1], length))
        # without a cruise both meet, however they are rounded
        from_start, from_end = places[-1]
        places[-1] = np.array([from_start, np.minimum(from_end, -from_start)])
        lengths = np.diff(places, axis=0) / limits.unit
        ends = FLIPS * np.array(places[1:])
        peaks = np.array([peak, -peak])
        allowed = peaks + lengths[RELEASE] / rows.cells.down[:, 0]
        held = np.fmin(rises, allowed)
        levels = np.array([FLIPS * at_waypoints, FLIPS * held, [peak, peak]])
        return cls(lengths, signs * levels, shares, ends)

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
    of_joints = np.broadcast_to(LEAST_RTOL * limits.ramp * limits.unit, own.shape)
    even = np.linspace(start, end, EVEN + 2)[1:-1]
    times = np.concatenate([even, _rows(own)])
    least = np.concatenate([0 * even, _rows(of_joints)])
    order = np.argsort(times, axis=0)
    times = np.take_along_axis(times, order, axis=0)
    least = np.take_along_axis(least, order, axis=0)
    found = []
    for first, last, wanted, shortest in zip(start, end, times.T, least.T, strict=True):
        count = np.isfinite(wanted).sum()
        found.append(_apart([first, *wanted[:count], last], [0.0, *shortest[:count], 0.0]))
    most = max(map(len, found))
    return np.array([own + [own[-1]] * (most - len(own)) for own in found]).T


def _apart(times: list[float], least: list[float]) -> list[float]:
    """Breaks in order, without pieces so short that a longer one costs next to nothing.

    A break left out makes its joint faster by half its change of jerk times the times to the breaks
    before and after. So one that is close to the break before may move away from it.

    Args:
        times: breaks, s; the first and the last stay.
        least: the times whose square may be lost, s.
    """
    kept = times[:1]
    for time, after, short in zip(times[1:-1], times[2:], least[1:-1], strict=True):
        gap = time - kept[-1]
        if gap * (after - time) > short**2:
            kept.append(time if gap >= short else kept[-1] + short**2 / gap)
    end = times[-1]
    gap = end - kept[-1]
    short = least[-2]
    if len(kept) > 1 and gap < short:
        last = kept.pop()
        if gap * (last - kept[-1]) > short**2:
            kept.append(end - short**2 / gap)
    return [*kept, end]


def _rows(table: Array) -> Array:
    """A table `(…, segments, joints)` as rows `(rows, segments)`."""
    return table.swapaxes(-1, -2).reshape(-1, table.shape[-2])


def _missing(lengths: Array, levels: Array, velocity: Array, h: Array) -> tuple[Array, Array]:
    """The velocity and the displacement that motions of these accelerations miss at their end."""
    _, reached, travelled = integrated(lengths, levels, velocity[:-1])
    slow = velocity[1:] - reached
    short = h - travelled
    size = np.abs(velocity[1:]) + np.abs(velocity[:-1])
    slow[np.abs(slow) <= ROUNDING_RTOL * size] = 0.0
    short[np.abs(short) <= ROUNDING_RTOL * np.abs(h)] = 0.0
    return slow, short


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
