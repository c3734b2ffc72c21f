"""A problem without units: the form in which both exact programs solve it."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Self

import numpy as np

from baselines.exact.method.pieces import Pieces
from baselines.exact.method.segments import Segments
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.problem import Problem
from trajopt.core.rounding import KEPT_RTOL
from trajopt.core.trajectory import Trajectory
from trajopt.planners.rest_to_rest import stop_times

# Shorter pieces are removed wherever the limits allow it, s. Smaller: pieces shorter than a cycle
# of any controller stay. Larger: more linear programs.
BRIEF_PIECE_S = 1e-6
# Added to the stop time of a first or last segment that begins or ends in motion, in times of
# braking: the joints may have to stop, to come back, and to speed up again. Less: the guess after
# all gaps has too little time. More: it is farther from the optimum.
RETURNS = 3.0
# Tables of a problem, by where the axis for the starts of several problems is: first, or second.
_OF_SEGMENTS = ("h", "stop", "least")
_OF_SIDES = ("v", "a", "r", "waypoint_v", "waypoint_a", "end_v", "end_a")
_KEPT = KEPT_RTOL / 2  # half of what the judge counts as rounding; the rest is for the motion's own


class Scaled:
    """All joints without units: time in mean stop times, accelerations of order one.

    Args:
        problem: its joints all move; its position limits are ignored.
        jerk: whether jerk limits count.
        passing: further limits at the waypoints, of velocity, rad/s, and of acceleration, rad/s²,
            `(2 orders, waypoints, joints, 2)`.

    Attributes:
        h: displacements, `(segments, joints)`.
        v: velocity limits, `(2, segments, joints)`, low first; `(2, 1, joints)` where all segments
            have the same limits, as in the next two.
        a: acceleration limits, likewise.
        r: inverse jerk limits, likewise, not negative.
        waypoint_v, waypoint_a: at the inner waypoints, the tightest of both segments' limits and of
            `passing`, `(2, segments - 1, joints)` or `(2, 1, joints)`.
        passing: further limits at these waypoints, `(2 orders, 2, segments - 1, joints)`; None
            where there are none.
        by_segment: whether these differ from segment to segment.
        stop: each segment's time if all joints stop at both its ends, `(segments,)`.
        shortest: each segment's time at the velocity limit, `(segments,)`.
        end_v, end_a: velocities and accelerations at the motion's ends, `(2 ends, joints)`.
        unit: the unit of time, s.
        units: the units of jerk, acceleration, velocity and position, rad/s^power, `(4, joints)`.
    """

    def __init__(self, problem: Problem, jerk: bool = True, passing: Array | None = None) -> None:
        known = problem.without("position") if jerk else problem.without("jerk", "position")
        limits = known.limits
        self.by_segment = limits.segments is not None or passing is not None
        rows = problem.segments if self.by_segment else 1
        velocity = _by_side(limits.velocity, rows)
        acceleration = _by_side(limits.acceleration, rows)
        jerks = np.abs(_by_side(limits.jerk, rows))

        # given times count as least times: their sum is the optimum, if any motion has these times
        least = problem.route.demand("least_times") + problem.route.demand("given_times")
        stop = np.maximum(stop_times(known), least)
        route = problem.route
        end_v, end_a = np.stack([route.start, route.end], axis=1)
        if not route.at_rest:
            slowest = np.abs(acceleration).min(axis=0).reshape(-1, len(end_v[0])).min(axis=0)
            stop[0] += (RETURNS * np.abs(end_v[0]) / slowest).max()
            stop[-1] += (RETURNS * np.abs(end_v[1]) / slowest).max()
        unit = float(stop.mean())
        # the acceleration that is reached: at its limit, or as far as jerk allows
        reached = np.minimum(np.abs(acceleration), jerks * unit).min(axis=(0, 1))
        units = reached * unit ** np.arange(-1.0, 3.0)[:, None]
        j_unit, a_unit, v_unit, q_unit = units

        self.problem = problem
        self.unit = unit
        self.units = units
        self.stop = stop / unit
        self.r = j_unit / jerks
        self.a = acceleration / a_unit
        self.v = velocity / v_unit
        self.end_v = end_v / v_unit
        self.end_a = end_a / a_unit
        self.h = problem.displacements / q_unit
        self.closed = bool(route.demand("closed"))
        self.least = least / unit
        tolerance = route.demand("tolerance")
        self.tolerance = tolerance[1 : None if self.closed else -1] / q_unit
        # T ≥ h / V2 forwards, T ≥ h / (−V1) backwards
        self.shortest = (self.h / self.v).max(axis=(0, 2))
        self.waypoint_v = self._of_both_segments(self.v)
        self.waypoint_a = self._of_both_segments(self.a)
        self.passing = None
        if passing is not None:
            inner = slice(1, None if self.closed else -1)
            own = np.moveaxis(passing[:, inner], -1, 1)
            self.passing = own / np.stack([v_unit, a_unit])[:, None, None]
            self.waypoint_v = _tighter(self.waypoint_v, self.passing[0])
            self.waypoint_a = _tighter(self.waypoint_a, self.passing[1])

    def _of_both_segments(self, limits: Array) -> Array:
        """Return the tighter limits of both segments at each waypoint with a state."""
        low, high = limits
        if len(low) == 1:
            return limits
        lows = np.maximum(low, np.roll(low, -1, axis=0))
        highs = np.minimum(high, np.roll(high, -1, axis=0))
        return np.array([lows, highs])[:, : None if self.closed else -1]

    def shifted(self, offset: Array) -> Self:
        """Return the problem without tolerance, with waypoints moved by `offset`.

        Args:
            offset: without units, at the waypoints with a state, `(waypoints, joints)`.
        """
        waypoints = np.array(self.problem.waypoints)
        waypoints[1 : len(offset) + 1] += offset * self.units[-1]
        own = copy(self)
        own.problem = replace(self.problem.without("tolerance", "position"), waypoints=waypoints)
        own.tolerance = 0 * self.tolerance
        own.h = own.problem.displacements / self.units[-1]
        return own

    def velocities(self, times: Array, ends: Array) -> Array:
        """Return the velocities at the inner waypoints, `(segments - 1, joints)`.

        Of a waypoint's two segments the shorter one determines them: rounding matters most there.

        Args:
            times: of the segments, `(segments,)`.
            ends: velocities at the segments' ends, `(2 ends, segments, joints)`, from the mean
                velocity of the segment, over its time.
        """
        return inner_velocities(self.h, times, ends, self.closed)


def motions(
    every: Sequence[Scaled], pieces: Pieces, velocity: Array, segments: Segments | None = None
) -> list[Trajectory]:
    """Return the motions of problems of one shape, each of degree 2 where no piece has a jerk.

    Args:
        every: the problems.
        pieces: of every segment of every problem, `(pieces, problems · segments, joints)`; some may
            have no length.
        velocity: at the segments' starts, `(problems · segments, joints)`.
        segments: what the pieces are to meet. With them the rounding of sums over many pieces is
            corrected, where that is negligible.
    """
    count = len(velocity) // len(every)
    unit = np.repeat([own.unit for own in every], count)
    units = np.repeat([own.units for own in every], count, axis=0)
    j_unit, a_unit, v_unit, q_unit = units.transpose(1, 0, 2)
    lengths = unit[:, None] * pieces.lengths
    own = Pieces(lengths, a_unit * pieces.start, j_unit * pieces.jerk)
    first = v_unit * velocity
    cubics = own.integrated(first)
    if segments is not None:
        speeds, ways = own.passed(first)
        slow = v_unit * segments.w - speeds[-1]
        short = np.concatenate([one.problem.displacements for one in every]) - ways[-1]
        change = segments.negligible(pieces.lengths, slow / v_unit, short / q_unit)
        change = Pieces(lengths, a_unit * change.start, j_unit * change.jerk)
        cubics += change.integrated(0 * slow)
    cubics[-1] += np.concatenate([own.problem.waypoints[:-1] for own in every])
    by_segment = cubics.transpose(2, 0, 1, 3)
    seconds = lengths[..., 0].T
    found = []
    for number in range(0, len(velocity), count):
        some = slice(number, number + count)
        coefficients = by_segment[some] if pieces.jerk[:, some].any() else by_segment[some, 1:]
        found.append(Trajectory.of_segments(zip(seconds[some], coefficients, strict=True)))
    return found


def inner_velocities(h: Array, times: Array, ends: Array, closed: bool) -> Array:
    """Return what `Scaled.velocities` does, of one problem or of several along the first axis."""
    t = times[..., None]
    first, last = h / t + t * ends
    if closed:
        is_briefer = t < np.roll(t, -1, axis=-2)
        return np.where(is_briefer, last, np.roll(first, -1, axis=-2))
    is_briefer = t[..., :-1, :] < t[..., 1:, :]
    return np.where(is_briefer, last[..., :-1, :], first[..., 1:, :])


class Abreast:
    """Problems without units of one shape, one for each start; a problem may be there repeatedly.

    Attributes as of `Scaled`, with an axis for the starts before that of the segments.

    Args:
        every: the problem of each start. All have the same number of segments and joints, and the
            same `closed` and `by_segment`.
    """

    def __init__(self, every: Sequence[Scaled]) -> None:
        first = every[0]
        self.every = every
        self.closed = first.closed
        self.by_segment = first.by_segment
        self.h, self.stop, self.least = (
            np.array([getattr(own, name) for own in every]) for name in _OF_SEGMENTS
        )
        self.v, self.a, self.r, self.waypoint_v, self.waypoint_a, self.end_v, self.end_a = (
            np.stack([getattr(own, name) for own in every], axis=1) for name in _OF_SIDES
        )

    def of(self, some: Bools | Indices) -> Abreast:
        """Return the problems of some of the starts."""
        own = copy(self)
        own.every = [self.every[i] for i in np.arange(len(self.every))[some]]
        for name in _OF_SEGMENTS:
            setattr(own, name, getattr(self, name)[some])
        for name in _OF_SIDES:
            setattr(own, name, getattr(self, name)[:, some])
        return own

    def with_others(self, others: Sequence[Abreast]) -> Abreast:
        """Return the problems of these starts, then of the others."""
        return Abreast([scaled for own in (self, *others) for scaled in own.every])


def leave(scaled: Scaled, share: float) -> None:
    """Make limits tighter by a share, but for those that a state at an end needs whole."""
    velocity, acceleration = scaled.end_v, scaled.end_a
    # those of the first and the last segment
    slowest, steepest = (np.abs(own).min(axis=0)[[0, -1]] for own in (scaled.v, scaled.a))
    ramp = scaled.r.max(axis=0)[[0, -1]] * acceleration**2 / 2
    # the velocity that the acceleration leads to, backwards in time from the end
    towards = np.sign(acceleration) * [[1], [-1]]
    led = towards * velocity + ramp
    most = 1 - 2 * share
    ramps = (led > most * slowest) & (acceleration != 0)
    fast = (np.abs(velocity) > most * slowest) | ramps
    steep = np.abs(acceleration) > most * steepest
    v, a = (np.where(whole.any(axis=0), 1.0, 1 - share) for whole in (fast, steep))
    # the ramp from such a state to the velocity limit needs the jerk of its segment, but for what
    # the judge counts as rounding of the velocity
    v = np.where(ramps.any(axis=0), 1 + _KEPT, v)
    needed = 1 - np.minimum(_KEPT * slowest / np.where(ramps, ramp, np.inf), share)
    r = np.full((len(scaled.h) if ramps.any() else 1, ramps.shape[1]), 1 - share)
    r[0] = np.where(ramps[0], needed[0], r[0])
    r[-1] = np.where(ramps[1], needed[1], r[-1])
    scaled.v, scaled.waypoint_v = scaled.v * v, scaled.waypoint_v * v
    scaled.a, scaled.waypoint_a = scaled.a * a, scaled.waypoint_a * a
    scaled.r = scaled.r / r


def _tighter(limits: Array, others: Array) -> Array:
    """Return the tighter of two limits, low first."""
    return np.array([np.maximum(limits[0], others[0]), np.minimum(limits[1], others[1])])


def _by_side(pairs: Array, rows: int) -> Array:
    """Return limits, `(joints, 2)` or those of each segment, as `(2, rows, joints)`."""
    sides = np.moveaxis(pairs, -1, 0)
    joints = sides.shape[-1]
    return np.array(np.broadcast_to(sides.reshape(2, -1, joints), (2, rows, joints)))
