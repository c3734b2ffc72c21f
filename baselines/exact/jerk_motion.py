"""The jerk-limited motion through given waypoint states, between stored breaks (mathematics, 4).

In each segment a joint takes the convex combination of its two extreme profiles that covers the
displacement. What a trajectory stores are times since its start, rounded, so the breaks are rounded
first; acceleration is straight between them, and the least change of what it is at the inner ones
makes up for what rounding costs. Breaks that are hardly apart are left out where the limits allow
it, and breaks of two joints that are as near are at one place.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.exact.acceleration_motion import covering
from baselines.exact.cells import at_ends
from baselines.exact.jerk_cells import Cells, Point, Rows
from baselines.exact.rounded import (
    NO_PIECES,
    Clock,
    Pieces,
    apart,
    assembled,
    clocks,
    through,
)
from baselines.exact.scaled import Scaled
from trajopt.core import polynomials
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify

Array = NDArray[np.float64]

# Pieces shorter than these shares of a segment are left out where the limits allow it.
_SLIVERS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-9, 1e-12)
_BRIEFEST_S = 2e-10  # and pieces that last no longer in any case
# Or shorter than this share of a segment, where that is less.
_BRIEFEST_RTOL = 1e-3
# In segments shorter than this, relative to the mean stop time, all joints share one grid.
_BRIEF = 1e-3
_BRIEF_PIECES = 4
# Breaks of two joints that are so near each other are at one place, where limits allow it.
_NEAR_S = 1e-6
# Or so near, relative to the mean stop time, where that is less.
_NEAR_UNIT_RTOL = 1e-3
# States are put on a limit that they miss by less than this, in units of the velocity that the
# segment allows: for limits of acceleration by the ramp to them, and for limits of velocity.
_NEAR_LIMIT = 1e-11
_NEAR_TOP = 1e-8
# They also miss it by less than this share of the acceleration.
_NEARBY = 1e-2
# A break is left out where no limit is exceeded by more than this share.
_EXCESS_RTOL = 3e-10
_MISS_RTOL = 1e-13  # of velocities: what the end may be missed by
_ROUNDING_RTOL = 4e-15
# Dilations of the times, beyond 1, among which the shortest certified motion is taken where the
# first is certified later than this.
_SLOWER = (0.0, 1e-9, 1e-8, 1e-7, 1e-6)
_EXACT_RTOL = 1e-9
# A profile with a smaller share is left out.
_ALONE = 1e-8
_TINY = 1e-300  # instead of dividing by 0


class Course(NamedTuple):
    """How acceleration changes in one cell.

    Attributes:
        ends: velocities at the start and at the end.
        h: displacement.
        breaks: from 0 to the segment's time.
        levels: acceleration at the breaks, straight between them.
        velocity: its limits, low and high.
        acceleration: likewise.
        jerk: likewise.
    """

    ends: tuple[float, float]
    h: float
    breaks: Array
    levels: Array
    velocity: Array
    acceleration: Array
    jerk: Array


class Reachable(Scaled):
    """A problem without units, and the motions through given waypoint states."""

    def trajectory(self, times: Array, states: Array) -> Trajectory:
        """The motion of these segment times and inner waypoint states.

        Where a segment is so brief that its breaks' rounding counts, the least slower one that is
        certified the shortest.
        """
        within = self.problem.without("position")
        velocity, acceleration = states
        found: list[tuple[float, Trajectory]] = []
        for slower in _SLOWER:
            k = 1 + slower
            slowed = np.stack([velocity / k, acceleration / k**2])
            own = motion(self, k * times, slowed)
            certified = verify(within, own).certified_duration or np.inf
            found.append((certified, own))
            shortest, best = min(found, key=lambda one: one[0])
            if shortest <= found[0][1].duration * (1 + _EXACT_RTOL):
                break
        return best


def motion(scaled: Scaled, times: Array, states: Array) -> Trajectory:
    """The motion of these segment times and inner waypoint states.

    Args:
        scaled: the problem without units.
        times: of the segments, in its unit, `(segments,)`.
        states: velocities and accelerations, `(2, segments - 1, joints)`.
    """
    passages = np.r_[0.0, np.cumsum(times * scaled.unit)]
    rounded = np.diff(passages) / scaled.unit
    velocity, acceleration = states
    velocity = _in_rounded_times(times, rounded, velocity)
    velocity, acceleration = _at_limits(scaled, rounded, velocity, acceleration)
    courses = _Courses(scaled, rounded, velocity, acceleration)
    segments = []
    for k, clock in enumerate(
        clocks(
            passages,
            scaled.unit,
        )
    ):
        segments.append(_segment(courses, k, clock))
    return assembled(scaled.problem, passages, segments)


def _in_rounded_times(times: Array, rounded: Array, velocity: Array) -> Array:
    """The velocities that pass a brief segment in its rounded time; of two the briefer decides.

    The long neighbours hardly notice.
    """
    given = velocity
    velocity = velocity.copy()
    for k in np.argsort(-times):
        if rounded[k] > 0 and times[k] < _BRIEF:
            around = slice(
                max(k - 1, 0),
                k + 1,
            )
            velocity[around] = times[k] / rounded[k] * given[around]
    return velocity


def _at_limits(
    scaled: Scaled,
    times: Array,
    velocity: Array,
    acceleration: Array,
) -> tuple[Array, Array]:
    """Return the states, those that hardly differ from a limit put on it.

    The velocity that such a ramp gains is the square of the difference.

    So is what acceleration differs from 0 by where a joint cruises through a waypoint.
    """
    briefer = np.minimum(
        times[:-1],
        times[1:],
    )[:, None]
    slowest = np.maximum(
        scaled.r.max(axis=0),
        _TINY,
    )
    a1, a2 = scaled.a
    v1, v2 = scaled.v
    # change of the states that the limits allow in the briefer segment
    room = np.minimum(
        np.minimum(a2, -a1),
        briefer / slowest,
    )
    fast = np.minimum(
        np.minimum(v2, -v1),
        room * briefer,
    )
    # a ramp to the limit gains the velocity (A − a)² r / 2
    near = np.sqrt(_NEAR_LIMIT * fast / slowest)
    near = np.minimum(near, _NEARBY * room)
    acceleration = np.where(
        a2 - acceleration <= near,
        a2,
        acceleration,
    )
    acceleration = np.where(
        acceleration - a1 <= near,
        a1,
        acceleration,
    )
    steady = acceleration**2 * slowest <= _NEAR_TOP * fast
    steady &= np.abs(acceleration) <= _NEARBY * room
    at_high = steady & (v2 - velocity <= _NEAR_TOP * fast)
    at_low = steady & (velocity - v1 <= _NEAR_TOP * fast)
    velocity = np.where(
        at_high,
        v2,
        np.where(at_low, v1, velocity),
    )
    return velocity, np.where(
        at_high | at_low,
        0.0,
        acceleration,
    )


class _Courses:
    """The combinations of extreme profiles in every cell."""

    def __init__(
        self,
        scaled: Scaled,
        times: Array,
        velocity: Array,
        acceleration: Array,
    ) -> None:
        self.scaled = scaled
        self.times = times
        cells = Cells(scaled)
        t = np.where(
            times > 0,
            times,
            1.0,
        )[None]
        mean = scaled.h / t[..., None]
        at_waypoints = at_ends(velocity[None])
        ends = (at_waypoints - mean) / t[..., None]
        with np.errstate(all="ignore"):
            rows = Rows(
                cells,
                Point(
                    np.log(t),
                    ends,
                    velocity[None],
                    acceleration[None],
                ),
            )
        profiles = rows.profiles
        a, b = profiles.acceleration
        rise, fall = profiles.rises
        between = np.clip(0.0, -fall, rise)
        levels = [a, rise, rise, between, between, -fall, -fall, -b]
        up = rows.cells.up / rows.t
        down = rows.cells.down / rows.t
        lengths = [
            up * (rise - a),
            profiles.hold[0],
            down * (rise - between),
            profiles.cruise,
            down * (between + fall),
            profiles.hold[1],
        ]
        knots = np.cumsum(
            np.maximum(lengths, 0.0),
            axis=0,
        )
        whole = np.ones_like(knots[:1])
        knots = np.concatenate(
            [
                0 * whole,
                np.minimum(
                    knots,
                    1.0,
                ),
                whole,
            ]
        )
        # the sides are mirrored
        sides = np.array([1.0, -1.0])[:, None, None]
        high, low = np.maximum(
            rows.reach[:, 0],
            0.0,
        )
        share = low / np.maximum(
            high + low,
            _TINY,
        )
        share = np.where(share < _ALONE, 0.0, share)
        self.share = np.where(
            share > 1 - _ALONE,
            1.0,
            share,
        )
        self.knots = times[:, None] * knots[:, :, 0]
        self.levels = sides * np.array(levels)[:, :, 0]
        self.velocity = at_waypoints[:, 0]
        self.jerky = scaled.r.any(axis=0)
        signs = np.array([[-1.0], [1.0]])
        self.jerk = signs / np.where(
            self.jerky,
            scaled.r,
            1.0,
        )

    def at(self, k: int, i: int) -> Course:
        """The course of one cell."""
        knots = self.knots[:, :, k, i]
        levels = self.levels[:, :, k, i]
        share = self.share[k, i]
        if share in (0.0, 1.0):  # one profile alone
            alone = [int(share == 0)] * 2
            knots = knots[:, alone]
            levels = levels[:, alone]
        breaks = np.unique(knots)
        high, low = (
            np.interp(
                breaks,
                knots[:, side],
                levels[:, side],
            )
            for side in (0, 1)
        )
        u, w = self.velocity[:, k, i]
        return Course(
            (float(u), float(w)),
            float(self.scaled.h[k, i]),
            breaks,
            share * high + (1 - share) * low,
            self.scaled.v[:, i],
            self.scaled.a[:, i],
            self.jerk[:, i],
        )


def _segment(courses: _Courses, k: int, clock: Clock) -> list[Pieces]:
    """Stored breaks (s) and coefficients (rad/s^power) of every joint over one segment."""
    scaled = courses.scaled
    jerky = courses.jerky
    pieces: list[Pieces] = [NO_PIECES] * len(jerky)
    if clock.length == 0:
        return pieces
    places = np.array([clock.start, clock.end])
    # The breaks of joints without a jerk limit are where they are: acceleration may jump there.
    for i in np.argsort(jerky, kind="stable"):
        course = courses.at(k, i)
        if jerky[i]:
            stored, part = _fitted(course, clock, places)
        else:
            ends = np.array(course.ends)
            stored, part = covering(
                course.h,
                ends,
                course.velocity,
                course.acceleration,
                clock,
            )
        places = np.union1d(places, stored)
        powers = len(part)
        pieces[i] = (stored, part * scaled.units[-powers:, i, None])
    return pieces


def _fitted(course: Course, clock: Clock, places: Array) -> Pieces:
    """The motion of fewest breaks that keeps the limits; else the one that breaks them least."""
    t = clock.length
    straight = _straight(course, t)
    if straight is not None:
        return clock.stored(np.array([0.0, t])), straight
    near = min(_NEAR_S, _NEAR_UNIT_RTOL * clock.unit)
    best: tuple[float, Pieces] | None = None
    closest = max(
        clock.resolution,
        min(_BRIEFEST_S, _BRIEFEST_RTOL * t * clock.unit),
    )
    for breaks in _grids(
        course.breaks,
        t,
        closest / clock.unit,
    ):
        levels = np.interp(breaks, course.breaks, course.levels)
        for stored, weights in (
            (clock.stored_at(breaks, places, near), 1.0),
            (clock.stored_at(breaks, places, 0.0), 1.0),
            (
                clock.stored_outwards(
                    breaks,
                    places,
                ),
                np.abs(levels),
            ),
        ):
            lengths = clock.lengths(stored)
            cubics = through(
                lengths,
                levels,
                course.ends,
                course.h,
                weights,
            )
            if cubics is None:
                continue
            excess = _excess(course, lengths, cubics)
            if excess <= _EXCESS_RTOL:
                return stored, cubics
            if best is None or excess < best[0]:
                best = (excess, (stored, cubics))
    if best is None:  # the segment is too brief for three pieces
        return clock.stored(np.array([0.0, t])), _cubic(
            course,
            t,
        )
    return best[1]


def _straight(course: Course, t: float) -> Array | None:
    """Constant jerk, where all that it misses is rounding."""
    u, w = course.ends
    a, b = course.levels[[0, -1]]
    jerk = (b - a) / t
    # w = u + (a + b) T/2, h = u T + a T²/2 + (b − a) T²/6
    slow = w - u - (a + b) * t / 2
    short = course.h - t * (u + t * (2 * a + b) / 6)
    low, high = course.jerk * (1 + _EXCESS_RTOL)
    rounding = _ROUNDING_RTOL * (abs(u) + abs(w))
    if (
        low <= jerk <= high
        and max(
            abs(slow),
            abs(short) / t,
        )
        <= rounding
    ):
        return _cubic(course, t)
    return None


def _cubic(course: Course, t: float) -> Array:
    """Constant jerk between both accelerations."""
    a, b = course.levels[[0, -1]]
    return np.array([[(b - a) / t / 6], [a / 2], [course.ends[0]], [0.0]])


def _grids(breaks: Array, t: float, closest: float) -> Iterator[Array]:
    """Breaks to try, the fewest first; in a brief segment one grid for all joints."""
    if t < _BRIEF:
        yield np.linspace(0.0, t, _BRIEF_PIECES + 1)
    fewest = 0
    for sliver in _SLIVERS:
        kept = apart(
            breaks,
            t,
            max(sliver * t, closest),
        )
        if len(kept) > fewest:
            yield (
                kept
                if len(kept) > 3
                else np.union1d(
                    kept,
                    np.linspace(0.0, t, 4),
                )
            )
        fewest = len(kept)


def _excess(course: Course, lengths: Array, cubics: Array) -> float:
    """The largest share by which a motion passes its limits of jerk, acceleration and velocity."""
    cubic, square, linear, _ = cubics
    w = course.ends[1]
    t = lengths[-1]
    last = cubics[:, -1]
    slow = (
        polynomials.evaluate(
            polynomials.derivative(last),
            t,
        )
        - w
    )
    short = polynomials.evaluate(last, t) - course.h
    fastest = np.abs(linear).max() + abs(w)
    if (
        max(
            abs(slow),
            abs(short) / lengths.sum(),
        )
        > _MISS_RTOL * fastest
    ):
        return np.inf
    jerk = 6 * cubic
    acceleration = 2 * square
    changing = np.where(
        jerk == 0,
        np.inf,
        jerk,
    )
    # velocity where acceleration vanishes in a piece; where it does not, at the nearer end
    when = np.clip(
        -acceleration / changing,
        0.0,
        lengths,
    )
    turning = linear + when * (acceleration + when * jerk / 2)
    worst = 0.0
    for values, limits in (
        (jerk, course.jerk),
        (acceleration, course.acceleration),
        (np.append(linear, turning), course.velocity),
    ):
        low, high = limits
        worst = max(
            worst,
            float(values.max() / high),
            float(values.min() / low),
        )
    return worst - 1
