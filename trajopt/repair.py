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
    with np.errstate(
        over="ignore",
        invalid="ignore",
        divide="ignore",
    ):
        layout = _layout(problem, trajectory)
        if layout is None:
            return None
        coefficients = _rebased(layout)
        jerk_limited = problem.limits.jerk_limited
        by_order = {1: ~jerk_limited, 2: jerk_limited}
        for order, joints in by_order.items():
            if not joints.any():
                continue
            added = _corrections(layout, joints, order)
            if added is not None:
                coefficients = _with_added(coefficients, added, joints)
    finite = np.isfinite(coefficients)
    if not finite.all():
        return None
    breaks = layout.breaks
    return Trajectory(
        breaks,
        coefficients,
        waypoint_times=breaks[layout.waypoint_breaks],
    )


@dataclass(frozen=True)
class _Layout:
    """How pieces lie in segments; segments that take no time and go nowhere are left out.

    Attributes:
        trajectory: with a break at every waypoint.
        travel: each piece's own displacement, from its velocity alone, rad, `(pieces, joints)`.
        waypoint_breaks: the index of each waypoint's break, `(waypoints,)`.
        segment: of each piece, `(pieces,)`.
        first: the first piece of each segment, `(segments,)`.
        after: the first piece after each segment, `(segments,)`.
        start, end: of each segment, s, `(segments,)`.
        displacements: of each joint in each segment, rad, `(segments, joints)`.
        origins: the waypoint where each segment starts, rad, `(segments, joints)`.
    """

    trajectory: Trajectory
    travel: Array
    waypoint_breaks: Indices
    segment: Indices
    first: Indices
    after: Indices
    start: Array
    end: Array
    displacements: Array
    origins: Array

    @property
    def breaks(self) -> Array:
        """When pieces begin, and the last one ends, s, `(pieces + 1,)`."""
        return self.trajectory.breaks

    @property
    def fly_by_time(self) -> float:
        """What rounding in one segment may be worth, s."""
        segments = len(self.first)
        return _fly_by_time(self.trajectory, segments)

    def of_pieces(self, of_segments: Array) -> Array:
        """What each piece's segment has."""
        return np.asarray(of_segments[self.segment])


def _layout(problem: Problem, trajectory: Trajectory) -> _Layout | None:
    """The segments that take time; None where one without time is not just flown by."""
    waypoint_times = trajectory.waypoint_times
    refined = trajectory.refined(waypoint_times)
    breaks = refined.breaks
    last_break = len(breaks) - 1
    at = nearest(breaks, waypoint_times)
    at[0] = 0
    at[-1] = last_break
    if not _flown_by(problem, refined, at):
        return None
    # Of the waypoints at one break the first counts, at the end of the motion the last.
    last_waypoint = len(at) - 1
    _, counted = np.unique(at, return_index=True)
    counted[-1] = last_waypoint
    waypoints = problem.waypoints[counted]
    own_breaks = at[counted]
    first = own_breaks[:-1]
    after = own_breaks[1:]
    segments = np.arange(len(first))
    pieces = after - first
    # The position at a piece's start is not its travel.
    powers = refined.pieces()[:-1]
    return _Layout(
        trajectory=refined,
        travel=powers.sum(axis=0),
        waypoint_breaks=at,
        segment=np.repeat(segments, pieces),
        first=first,
        after=after,
        start=breaks[first],
        end=breaks[after],
        displacements=np.diff(waypoints, axis=0),
        origins=waypoints[:-1],
    )


def _flown_by(
    problem: Problem,
    refined: Trajectory,
    at: Indices,
) -> bool:
    """Whether what lies between waypoints at one break is worth next to nothing.

    So it is where every joint flies by in the direction of its displacement: a segment of one unit
    in the last place takes less time than times can say.
    """
    instant = np.diff(at) == 0
    displacements = problem.displacements[instant]
    if not displacements.any():
        return True
    ends = at[1:]
    here = ends[instant]
    velocity = refined.pieces(1)
    starts = velocity[-1]
    stops = velocity.sum(axis=0)
    last_piece = len(starts) - 1
    piece_before = np.maximum(here - 1, 0)
    piece_after = np.minimum(here, last_piece)
    arriving = stops[piece_before]
    leaving = starts[piece_after]
    # |h| ≤ v t, with the slower of both velocities towards the waypoint
    sign = np.sign(displacements)
    towards = sign * arriving
    onwards = sign * leaving
    speed = np.minimum(towards, onwards)
    segments = len(ends)
    reach = speed * _fly_by_time(refined, segments)
    reach = np.where(sign == 0, 0.0, reach)
    distance = np.abs(displacements)
    within = distance <= reach
    return bool(within.all())


def _fly_by_time(trajectory: Trajectory, segments: int) -> float:
    """What rounding in one segment may be worth, s."""
    whole = FLY_BY_RTOL * trajectory.duration
    return whole / segments


def _rebased(layout: _Layout) -> Array:
    """The coefficients, each segment's positions integrated anew from its waypoint.

    So positions do not jump within a segment; the misses of its end are left.
    """
    # The travel before each piece: since the motion's start, less that before its segment.
    travel = layout.travel
    ended = np.cumsum(travel, axis=0)
    before = ended - travel
    before_segment = before[layout.first]
    within = before - layout.of_pieces(before_segment)
    origin = layout.of_pieces(layout.origins)
    coefficients = np.array(layout.trajectory.coefficients)
    coefficients[-1] = origin + within
    return coefficients


def _corrections(
    layout: _Layout,
    joints: Bools,
    order: int,
) -> Array | None:
    """What to add to some joints, `(2 order + 2, pieces, joints)`; None where nothing is amiss.

    `order` is the highest derivative that may not jump.
    """
    missed = _missed(layout)[:, joints]
    amiss = missed.any()
    jumps = []
    for derivative in range(1, order + 1):
        jump = _jumps(layout, joints, derivative)
        amiss |= jump.any()
        jumps.append(jump)
    if not amiss:
        return None
    growing, dying = _jump_corrections(layout, jumps)
    blends = missed[..., None] * _BLEND[order]
    growing += layout.of_pieces(blends)
    # From powers of σ and 1 − σ to powers of the time since the piece's start.
    start = layout.of_pieces(layout.start)
    end = layout.of_pieces(layout.end)
    length = end - start
    begins = layout.breaks[:-1]
    elapsed = (begins - start) / length  # σ at the piece's start
    left = (end - begins) / length  # 1 − σ there
    grown = polynomials.shifted(
        _rows(growing),
        elapsed[:, None],
    )
    died = polynomials.shifted(
        _rows(dying),
        left[:, None],
    )
    rate = 1 / length
    forwards = polynomials.stretched(grown, rate)
    backwards = polynomials.stretched(died, -rate)
    return forwards + backwards


def _missed(layout: _Layout) -> Array:
    """By how much each segment falls short of its end, rad, `(segments, joints)`.

    What is rounding of the way travelled is no miss. Nor is rounding of the coordinates, where the
    joint flies by so fast that it is worth next to nothing: mended within a segment of 1e-7 s, the
    last digit of a coordinate would cost a tenth of the acceleration limit.
    """
    travel = layout.travel
    displacements = layout.displacements
    reached = np.add.reduceat(travel, layout.first)
    short = displacements - reached
    size = np.abs(short)
    distances = np.abs(travel)
    way = np.add.reduceat(distances, layout.first)
    of_travel = size <= TRAVEL_RTOL * way
    if of_travel.all():
        return np.zeros_like(short)
    origins = layout.origins
    destinations = origins + displacements
    ends = np.stack([origins, destinations])
    coordinates = np.abs(ends).max(axis=0)
    of_coordinates = size <= COORDINATE_RTOL * coordinates
    worth = size / _slowest(layout)  # s
    flies_by = worth <= layout.fly_by_time
    rounding = of_travel | (of_coordinates & flies_by)
    return np.where(rounding, 0.0, short)


def _slowest(layout: _Layout) -> Array:
    """A speed that each joint never falls below on its way, rad/s, `(segments, joints)`.

    Zero where it does not move in the direction of its displacement all the time.
    """
    # A polynomial is between the least and the largest of its Bernstein coefficients.
    powers = layout.trajectory.pieces(1)
    velocity = polynomials.bernstein(powers)
    lowest = velocity.min(axis=0)
    highest = velocity.max(axis=0)
    first = layout.first
    forwards = np.minimum.reduceat(lowest, first)
    backwards = -np.maximum.reduceat(highest, first)
    displacements = layout.displacements
    is_forwards = displacements > 0
    speed = np.where(is_forwards, forwards, backwards)
    towards = speed > 0
    moves = (displacements != 0) & towards
    return np.where(moves, speed, 0.0)


def _jump_corrections(
    layout: _Layout,
    jumps: list[Array],
) -> tuple[Array, Array]:
    """The powers of `σ` and of `1 − σ` that cancel all jumps, `(pieces, joints, order + 1)`.

    `jumps` has those of velocity, and of acceleration if it may not jump, `(breaks, joints)` each.
    """
    order = len(jumps)
    breaks = layout.breaks
    # The room on both sides of each break, within its segment; none before and after the motion.
    start = layout.of_pieces(layout.start)
    end = layout.of_pieces(layout.end)
    none = np.array([-1.0])
    since_start = breaks[1:] - start
    until_end = end - breaks[:-1]
    room_before = np.concatenate([none, since_start])
    room_after = np.concatenate([until_end, none])
    dies = room_after > room_before
    room = np.where(dies, room_after, room_before)
    # and as a share of the segment
    length = end - start
    outside = np.array([np.inf])
    length_before = np.concatenate([outside, length])
    length_after = np.concatenate([length, outside])
    segment_length = np.where(dies, length_after, length_before)
    share = room / segment_length

    # What the correction's derivatives must be at the break, in units of its room; what dies out
    # runs backwards in time and takes the jump away after the break instead of before it.
    sign = np.where(dies, -1.0, 1.0)[:, None]
    unit = sign * room[:, None]
    slopes = []
    for derivative, jump in enumerate(jumps, start=1):
        cancelled = sign * jump
        slope = cancelled * unit**derivative
        slopes.append(slope)
    # x^(r+1) … x^(2r+1), in x = σ / share.
    lowest_power = order + 1
    powers = np.arange(lowest_power, lowest_power + order + 1)
    scale = share[:, None, None] ** -powers
    coefficients = _ending(*slopes) * scale
    by_coefficient = dies[:, None, None]
    dying = np.where(by_coefficient, coefficients, 0.0)
    growing = coefficients - dying

    # A piece has what died out from breaks at or before its start, and what grows to later breaks,
    # of its own segment: differences of sums over all breaks.
    died = np.cumsum(dying, axis=0)
    grown = np.cumsum(growing, axis=0)
    before = died - dying
    before_segment = before[layout.first]
    to_segment_end = grown[layout.after]
    still_growing = layout.of_pieces(to_segment_end) - grown[:-1]
    still_dying = died[:-1] - layout.of_pieces(before_segment)
    return still_growing, still_dying


def _jumps(
    layout: _Layout,
    joints: Bools,
    order: int,
) -> Array:
    """Jumps of a derivative at every break, `(breaks, joints)`, those of rounding left out.

    Before and after the motion the robot rests.
    """
    trajectory = layout.trajectory
    pieces = trajectory.pieces(order)
    unit = pieces[..., joints]
    starts = unit[-1]
    stops = unit.sum(axis=0)
    rest = np.zeros_like(starts[:1])
    before = np.vstack([rest, stops])
    after = np.vstack([starts, rest])
    jumps = after - before
    values = np.stack([before, after])
    sizes = np.abs(values)
    largest = sizes.max(axis=(0, 1))
    # A break's time is rounded too, which moves the value by as much as it changes meanwhile.
    derivatives = trajectory.pieces(order + 1)
    changes = derivatives[-1, :, joints]
    steepest = np.abs(changes).max(axis=1)
    in_time = np.outer(layout.breaks, steepest)
    size = np.abs(jumps)
    rounding = size <= JUMP_RTOL * (largest + in_time)
    forgiven = np.where(rounding, size, 0.0)
    total = forgiven.sum(axis=0)
    few = total <= JUMPS_SUM_RTOL * largest
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
        # s (x³ − x²)
        factors = [-slope, slope]
        return np.stack(factors, axis=-1)
    # x³ (s (x − 1) + c (x − 1)²), whose curvature at 1 is 6 s + 2 c.
    c = curvature / 2 - 3 * slope
    cubic = c - slope
    quartic = slope - 2 * c
    factors = [cubic, quartic, c]
    return np.stack(factors, axis=-1)


def _rows(factors: Array) -> Array:
    """Factors `(…, order + 1)` of x^(r+1) … x^(2r+1), in the layout of `Trajectory`."""
    lowest_first = np.moveaxis(factors, -1, 0)
    highest_first = lowest_first[::-1]
    lower_powers = np.zeros_like(highest_first)
    return np.concatenate([highest_first, lower_powers])


def _with_added(
    coefficients: Array,
    added: Array,
    joints: Bools,
) -> Array:
    """The sum for some joints, of the higher degree of both."""
    rows = len(added)
    own_rows, *shape = coefficients.shape
    missing_rows = max(0, rows - own_rows)
    padding = np.zeros((missing_rows, *shape))
    total = np.concatenate([padding, coefficients])
    lowest = total[-rows:]
    lowest[..., joints] += added
    return total
