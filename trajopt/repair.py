"""The exact repair of a trajectory: what is judged passes every waypoint, rests at both ends and
does not jump (docs/mathematics.md, section 7).

A tolerance is a gift, and gifts add up. So nothing is forgiven: positions are integrated anew from
each waypoint, and what then misses the next waypoint, jumps at a break, or moves at an end is
cancelled by polynomials that live within one segment. The repaired motion is harder where the given
one cheated, and the limits judge it.

A break's correction lives on the longer side of its segment, of duration `ρ` there: it grows from
the segment's start to the break, or has died out from the break to the segment's end. The sum of
all corrections of one joint in one segment of duration `L` is, with `σ = (t − t_{k−1}) / L`,

    Σ_m growing_m σ^m + Σ_m dying_m (1 − σ)^m,    m = r + 1 … 2r + 1,

where `r` is the highest derivative that may not jump: 1, or 2 where jerk is limited.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.problem import Problem
from trajopt.trajectory import EPS, Trajectory, nearest

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

# Rounding that is not mended, and what it can be worth. A jump of a derivative: relative to the
# joint's largest value of it, and to what it changes by while the break's time is rounded; all of
# them together are worth no more than the second number of the duration, since peak velocity is at
# most A T / 2.
# Beyond it rounded times are charged for: a trajectory stores its breaks as times since the start,
# so after hours a phase of stiff jerk is some 1e-12 s off, and mending the jump that this leaves
# can cost some 1e-6 of the duration. Such a certificate is above the claim, never below the truth.
JUMP_RTOL = 4 * EPS
JUMPS_SUM_RTOL = 1e-11
# A miss: relative to the way travelled in the segment.
TRAVEL_RTOL = 1e-13
# A miss that is rounding of the coordinates, where the joint flies by: relative to the coordinate;
# all of them together may be worth so much of the duration.
COORDINATE_RTOL = 4 * EPS
FLY_BY_RTOL = 1e-10


def repaired(problem: Problem, trajectory: Trajectory) -> Trajectory | None:
    """The trajectory, mended so that it passes every waypoint and does not jump.

    Velocity becomes continuous and zero at both ends; so does acceleration, of joints whose jerk is
    limited. Duration and waypoint times stay (but for rounding).

    Args:
        problem: of as many joints and waypoints as the trajectory has.
        trajectory: whatever a planner returned.

    Returns:
        The mended trajectory; None where there is nothing to mend: two different waypoints at one
        instant, or a number that overflows.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        layout = _layout(problem, trajectory)
        if layout is None:
            return None
        coefficients = _rebased(layout)
        jerk_limited = problem.limits.jerk_limited
        by_order = {1: ~jerk_limited, 2: jerk_limited}
        for order, joints in by_order.items():
            if joints.any():
                added = _corrections(layout, joints, order)
                coefficients = _with_added(coefficients, added, joints)
    if not np.isfinite(coefficients).all():
        return None
    breaks = layout.trajectory.breaks
    return Trajectory(breaks, coefficients, breaks[layout.waypoint_breaks])


@dataclass(frozen=True)
class _Layout:
    """How pieces lie in segments; segments that take no time and go nowhere are left out.

    Attributes:
        trajectory: with a break at every waypoint.
        travel: each piece's own displacement, from its velocity alone, rad, `(pieces, joints)`.
        waypoint_breaks: the index of each waypoint's break, `(waypoints,)`.
        segment: of each piece, `(pieces,)`.
        first: the first piece of each segment, `(segments,)`.
        start, end: of each segment, s, `(segments,)`.
        displacements: of each joint in each segment, rad, `(segments, joints)`.
        origins: the waypoint where each segment starts, rad, `(segments, joints)`.
    """

    trajectory: Trajectory
    travel: Array
    waypoint_breaks: Indices
    segment: Indices
    first: Indices
    start: Array
    end: Array
    displacements: Array
    origins: Array


def _layout(problem: Problem, trajectory: Trajectory) -> _Layout | None:
    """The segments that take time; None where one without time is not just flown by."""
    refined = trajectory.refined(trajectory.waypoint_times)
    breaks = refined.breaks
    at = nearest(breaks, trajectory.waypoint_times)
    at[0] = 0
    at[-1] = len(breaks) - 1
    if not _flown_by(problem, refined, at):
        return None
    # Of the waypoints at one break the first counts, at the end of the motion the last.
    _, counted = np.unique(at, return_index=True)
    counted[-1] = len(at) - 1
    waypoints = problem.waypoints[counted]
    own_breaks = at[counted]
    first = own_breaks[:-1]
    after = own_breaks[1:]
    segments = np.arange(len(first))
    return _Layout(
        trajectory=refined,
        travel=refined.pieces()[:-1].sum(axis=0),
        waypoint_breaks=at,
        segment=np.repeat(segments, after - first),
        first=first,
        start=breaks[first],
        end=breaks[after],
        displacements=np.diff(waypoints, axis=0),
        origins=waypoints[:-1],
    )


def _flown_by(problem: Problem, refined: Trajectory, at: Indices) -> bool:
    """Whether what lies between waypoints at one break is worth next to nothing.

    So it is where every joint flies by in the direction of its displacement: a segment of one unit
    in the last place takes less time than times can say.
    """
    instant = np.diff(at) == 0
    displacements = problem.displacements[instant]
    if not displacements.any():
        return True
    here = at[1:][instant]
    velocity = refined.pieces(1)
    last_piece = len(velocity[0]) - 1
    arriving = velocity.sum(axis=0)[np.maximum(here - 1, 0)]
    leaving = velocity[-1][np.minimum(here, last_piece)]
    sign = np.sign(displacements)
    speed = np.minimum(sign * arriving, sign * leaving)
    reach = speed * _fly_by_time(refined, len(at) - 1)
    return bool((np.abs(displacements) <= np.where(sign == 0, 0.0, reach)).all())


def _fly_by_time(trajectory: Trajectory, segments: int) -> float:
    """What rounding in one segment may be worth, s."""
    return FLY_BY_RTOL * trajectory.duration / segments


def _rebased(layout: _Layout) -> Array:
    """The coefficients, each segment's positions integrated anew from its waypoint.

    So positions do not jump within a segment; the misses of its end are left.
    """
    # The travel before each piece: since the motion's start, less that before its segment.
    before = np.cumsum(layout.travel, axis=0) - layout.travel
    within = before - before[layout.first][layout.segment]
    coefficients = np.array(layout.trajectory.coefficients)
    origin = layout.origins[layout.segment]
    coefficients[-1] = origin + within
    return coefficients


def _corrections(layout: _Layout, joints: Bools, order: int) -> Array | None:
    """What to add to some joints, `(2 order + 2, pieces, joints)`; None where nothing is amiss.

    `order` is the highest derivative that may not jump.
    """
    missed = _missed(layout)[:, joints]
    jumps = []
    for derivative in range(1, order + 1):
        jumps.append(_jumps(layout, joints, derivative))
    if not any(amiss.any() for amiss in (missed, *jumps)):
        return None
    growing, dying = _jump_corrections(layout, jumps)
    blends = missed[..., None] * _BLEND[order]
    growing += blends[layout.segment]
    # From powers of σ and 1 − σ to powers of the time since the piece's start.
    start = layout.start[layout.segment]
    end = layout.end[layout.segment]
    length = end - start
    breaks = layout.trajectory.breaks[:-1]
    elapsed = (breaks - start) / length  # σ at the piece's start
    left = (end - breaks) / length  # 1 − σ there
    grown = polynomials.shifted(_rows(growing), elapsed[:, None])
    died = polynomials.shifted(_rows(dying), left[:, None])
    rate = 1 / length
    return polynomials.stretched(grown, rate) + polynomials.stretched(died, -rate)


def _missed(layout: _Layout) -> Array:
    """By how much each segment falls short of its end, rad, `(segments, joints)`.

    What is rounding of the way travelled is no miss. Nor is rounding of the coordinates, where the
    joint flies by so fast that it is worth next to nothing: mended within a segment of 1e-7 s, the
    last digit of a coordinate would cost a tenth of the acceleration limit.
    """
    reached = np.add.reduceat(layout.travel, layout.first)
    short = layout.displacements - reached
    size = np.abs(short)
    distances = np.abs(layout.travel)
    way = np.add.reduceat(distances, layout.first)
    of_travel = size <= TRAVEL_RTOL * way
    if of_travel.all():
        return np.zeros_like(short)
    destinations = layout.origins + layout.displacements
    ends = np.stack([layout.origins, destinations])
    coordinates = np.abs(ends).max(axis=0)
    of_coordinates = size <= COORDINATE_RTOL * coordinates
    worth = size / _slowest(layout)  # s
    flies_by = worth <= _fly_by_time(layout.trajectory, len(layout.first))
    rounding = of_travel | (of_coordinates & flies_by)
    return np.where(rounding, 0.0, short)


def _slowest(layout: _Layout) -> Array:
    """A speed that each joint never falls below on its way, rad/s, `(segments, joints)`.

    Zero where it does not move in the direction of its displacement all the time.
    """
    velocity = polynomials.bernstein(layout.trajectory.pieces(1))
    lowest = velocity.min(axis=0)
    highest = velocity.max(axis=0)
    forwards = np.minimum.reduceat(lowest, layout.first)
    backwards = -np.maximum.reduceat(highest, layout.first)
    speed = np.where(layout.displacements > 0, forwards, backwards)
    moves = (layout.displacements != 0) & (speed > 0)
    return np.where(moves, speed, 0.0)


def _jump_corrections(layout: _Layout, jumps: list[Array]) -> tuple[Array, Array]:
    """The powers of `σ` and of `1 − σ` that cancel all jumps, `(pieces, joints, order + 1)`.

    `jumps` has those of velocity, and of acceleration if it may not jump, `(breaks, joints)` each.
    """
    order = len(jumps)
    breaks = layout.trajectory.breaks
    # The room on both sides of each break, within its segment; none before and after the motion.
    start = layout.start[layout.segment]
    end = layout.end[layout.segment]
    room_before = np.full(len(breaks), -1.0)
    room_after = np.full(len(breaks), -1.0)
    room_before[1:] = breaks[1:] - start
    room_after[:-1] = end - breaks[:-1]
    dies = room_after > room_before
    room = np.where(dies, room_after, room_before)
    length_before = np.r_[np.inf, end - start]
    length_after = np.r_[end - start, np.inf]
    share = room / np.where(dies, length_after, length_before)

    # What the correction's derivatives must be at the break, in units of its room; what dies out
    # runs backwards in time and takes the jump away after the break instead of before it.
    sign = np.where(dies, -1.0, 1.0)
    unit = (sign * room)[:, None]
    slopes = []
    for derivative, jump in enumerate(jumps, start=1):
        cancelled = sign[:, None] * jump
        slopes.append(cancelled * unit**derivative)
    # x^(r+1) … x^(2r+1), in x = σ / share.
    powers = np.arange(order + 1, 2 * order + 2)
    scale = share[:, None, None] ** -powers
    coefficients = _ending(*slopes) * scale
    dying = np.where(dies[:, None, None], coefficients, 0.0)
    growing = coefficients - dying

    # A piece has what died out from breaks at or before its start, and what grows to later breaks,
    # of its own segment: differences of sums over all breaks.
    died = np.cumsum(dying, axis=0)
    grown = np.cumsum(growing, axis=0)
    before = died - dying
    before_segment = before[layout.first]
    last_break = len(breaks) - 1
    segment_ends = np.r_[layout.first[1:], last_break]
    to_segment_end = grown[segment_ends]
    still_growing = to_segment_end[layout.segment] - grown[:-1]
    still_dying = died[:-1] - before_segment[layout.segment]
    return still_growing, still_dying


def _jumps(layout: _Layout, joints: Bools, order: int) -> Array:
    """Jumps of a derivative at every break, `(breaks, joints)`, those of rounding left out.

    Before and after the motion the robot rests.
    """
    pieces = layout.trajectory.pieces(order)
    unit = pieces[..., joints]
    starts = unit[-1]
    stops = unit.sum(axis=0)
    rest = np.zeros_like(starts[:1])
    before = np.vstack([rest, stops])
    after = np.vstack([starts, rest])
    jumps = after - before
    values = np.stack([before, after])
    largest = np.abs(values).max(axis=(0, 1))
    size = np.abs(jumps)
    # A break's time is rounded too, which moves the value by as much as it changes meanwhile.
    changes = layout.trajectory.pieces(order + 1)[-1, :, joints]
    steepest = np.abs(changes).max(axis=1)
    in_time = np.outer(layout.trajectory.breaks, steepest)
    rounding = size <= JUMP_RTOL * (largest + in_time)
    forgiven = np.where(rounding, size, 0.0)
    few = forgiven.sum(axis=0) <= JUMPS_SUM_RTOL * largest
    return np.where(rounding & few, 0.0, jumps)


# From 0 to 1 with as many derivatives zero at both ends: 3x² − 2x³, 10x³ − 15x⁴ + 6x⁵.
_BLEND = {
    1: np.array([3.0, -2.0]),
    2: np.array([10.0, -15.0, 6.0]),
}


def _ending(slope: Array, curvature: Array | None = None) -> Array:
    """The polynomial that is zero at 0 and 1, with these derivatives at 1 and none at 0.

    Returns:
        The coefficients of x², x³ for a slope; of x³, x⁴, x⁵ for a slope and a curvature, last.
    """
    if curvature is None:
        return np.stack([-slope, slope], axis=-1)  # s (x³ − x²)
    # x³ (s (x − 1) + c (x − 1)²), whose curvature at 1 is 6 s + 2 c.
    c = curvature / 2 - 3 * slope
    cubic = c - slope
    quartic = slope - 2 * c
    return np.stack([cubic, quartic, c], axis=-1)


def _rows(factors: Array) -> Array:
    """Factors `(…, order + 1)` of x^(r+1) … x^(2r+1), in the layout of `Trajectory`."""
    lowest_first = np.moveaxis(factors, -1, 0)
    highest_first = lowest_first[::-1]
    lower_powers = np.zeros_like(highest_first)
    return np.concatenate([highest_first, lower_powers])


def _with_added(coefficients: Array, added: Array | None, joints: Bools) -> Array:
    """The sum, of the higher degree of both."""
    if added is None:
        return coefficients
    rows = len(added)
    missing_rows = max(0, rows - len(coefficients))
    padding = np.zeros((missing_rows, *coefficients.shape[1:]))
    total = np.concatenate([padding, coefficients])
    total[-rows:, :, joints] += added
    return total
