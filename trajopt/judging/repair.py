"""The exact repair of a trajectory: what is judged passes every waypoint, rests at both ends, does
not jump, and stays within its position limits (docs/mathematics.md, section 7).

A tolerance is a gift, and gifts add up. So nothing is forgiven: positions are integrated anew from
each waypoint, and polynomials that live within segments cancel what then misses the next waypoint,
jumps at a break, or moves at an end. The repaired motion is harder where the given one cheated, and
the limits judge it.

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

from trajopt.core import polynomials
from trajopt.core.problem import LIMIT_ORDERS, Problem
from trajopt.core.trajectory import Trajectory, nearest

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

# Share of every limit: a correction that uses no more is left out, and all of them together change
# the certified duration by no more than this.
NEGLIGIBLE_USE = 1e-12
# The second pass mends what a large correction has rounded.
_PASSES = 2


def repaired(problem: Problem, trajectory: Trajectory) -> Trajectory | None:
    """The trajectory, mended so that it passes every waypoint and does not jump.

    Velocity becomes continuous and zero at both ends; so does acceleration, of joints whose jerk is
    limited. Positions stay within their limits. Duration and waypoint times stay (but for
    rounding).

    Args:
        problem: of as many joints and waypoints as the trajectory has.
        trajectory: whatever a planner returned.

    Returns:
        The mended trajectory; None where there is nothing to mend: two different waypoints at one
        instant, or a number that overflows.
    """
    motion = trajectory
    with np.errstate(
        over="ignore",
        invalid="ignore",
        divide="ignore",
    ):
        for _ in range(_PASSES):
            layout = _layout(problem, motion)
            if layout is None:
                return None
            rebased = _rebased(layout)
            mended = _mended(problem, layout, rebased)
            finite = np.isfinite(mended)
            if not finite.all():
                return None
            motion = _placed(layout, mended)
            if mended is rebased:
                break
    return motion


def _placed(layout: _Layout, coefficients: Array) -> Trajectory:
    """The motion whose positions are since the waypoint where a segment starts."""
    placed = np.array(coefficients)
    placed[-1] += layout.origins
    breaks = layout.breaks
    return Trajectory(
        breaks,
        placed,
        waypoint_times=breaks[layout.waypoint_breaks],
    )


def _mended(
    problem: Problem,
    layout: _Layout,
    coefficients: Array,
) -> Array:
    """The coefficients that miss no waypoint, do not jump and keep the position limits.

    Positions are since the waypoint where a segment starts. The same array where there is nothing
    to mend.
    """
    at_limits = problem.has("position")
    jerk_limited = problem.limits.jerk_limited
    by_order = {1: ~jerk_limited, 2: jerk_limited}
    for order, joints in by_order.items():
        if not joints.any():
            continue
        added = _corrections(layout, joints, order)
        if at_limits or not _is_negligible(added, layout, problem, joints):
            coefficients = _with_added(coefficients, added, joints)
    if at_limits:
        coefficients = _within_position_limits(problem, layout, coefficients)
    return coefficients


@dataclass(frozen=True)
class _Layout:
    """How pieces lie in segments; a segment between waypoints that are one is left out.

    Attributes:
        trajectory: with a break at every waypoint.
        travel: each piece's own displacement, from its velocity alone, rad, `(pieces, joints)`.
        waypoint_breaks: the index of each of the problem's waypoints' break, `(waypoints,)`.
        segment: of each piece, `(pieces,)`.
        first: the first piece of each segment, `(segments,)`.
        after: the first piece after each segment, `(segments,)`.
        start, end: of each segment, s, `(segments,)`.
        waypoints: at the ends of these segments, rad, `(segments + 1, joints)`.
    """

    trajectory: Trajectory
    travel: Array
    waypoint_breaks: Indices
    segment: Indices
    first: Indices
    after: Indices
    start: Array
    end: Array
    waypoints: Array

    @property
    def breaks(self) -> Array:
        """When pieces begin, and the last one ends, s, `(pieces + 1,)`."""
        return self.trajectory.breaks

    @property
    def lengths(self) -> Array:
        """Duration of each segment, s, `(segments, 1)`."""
        length = self.end - self.start
        return np.asarray(length[:, None])

    @property
    def displacements(self) -> Array:
        """Of each joint in each segment, rad, `(segments, joints)`."""
        return np.diff(self.waypoints, axis=0)

    @property
    def origins(self) -> Array:
        """The waypoint where each piece's segment starts, rad, `(pieces, joints)`."""
        starts = self.waypoints[:-1]
        return self.of_pieces(starts)

    def of_pieces(self, of_segments: Array) -> Array:
        """What each piece's segment has."""
        return np.asarray(of_segments[self.segment])


def _layout(problem: Problem, trajectory: Trajectory) -> _Layout | None:
    """The segments that take time; None where two waypoints that differ have one break."""
    merged, index = problem.merged()
    # Of waypoints that are one the first counts, at the end of the motion the last.
    _, counted = np.unique(index, return_index=True)
    counted[-1] = len(index) - 1
    times = trajectory.waypoint_times[counted]
    refined = trajectory.refined(times)
    breaks = refined.breaks
    at = nearest(breaks, times)
    at[0] = 0
    at[-1] = len(breaks) - 1
    first = at[:-1]
    after = at[1:]
    pieces = after - first
    if not pieces.all():
        return None
    segments = np.arange(len(first))
    # The position at a piece's start is not its travel.
    powers = refined.pieces()[:-1]
    return _Layout(
        trajectory=refined,
        travel=powers.sum(axis=0),
        waypoint_breaks=at[index],
        segment=np.repeat(segments, pieces),
        first=first,
        after=after,
        start=breaks[first],
        end=breaks[after],
        waypoints=merged.waypoints,
    )


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
    coefficients = np.array(layout.trajectory.coefficients)
    coefficients[-1] = within
    return coefficients


def _corrections(
    layout: _Layout,
    joints: Bools,
    order: int,
) -> Array:
    """What to add to some joints, `(2 order + 2, pieces, joints)`.

    `order` is the highest derivative that may not jump.
    """
    jumps = []
    for derivative in range(1, order + 1):
        jumps.append(_jumps(layout, joints, derivative))
    missed = _missed(layout)
    return _cancelling(layout, missed[:, joints], jumps)


def _cancelling(
    layout: _Layout,
    missed: Array,
    jumps: list[Array],
) -> Array:
    """What cancels misses `(segments, joints)` and jumps `(breaks, joints)`, of each derivative."""
    order = len(jumps)
    growing, dying = _jump_corrections(layout, jumps)
    blends = missed[..., None] * _BLEND[order]
    slopes = _slopes(layout, missed)
    unbent = [np.zeros_like(missed)] * 2
    curvatures = unbent if order == 2 else []
    ending, starting = _bent(layout, slopes, *curvatures)
    growing += layout.of_pieces(blends + ending)
    dying += layout.of_pieces(starting)
    return _in_time(layout, growing, dying, order + 1)


def _missed(layout: _Layout) -> Array:
    """By how much each segment falls short of its end, rad, `(segments, joints)`."""
    reached = np.add.reduceat(layout.travel, layout.first)
    return np.asarray(layout.displacements - reached)


def _slopes(layout: _Layout, missed: Array) -> Array:
    """The velocity of the correction of misses at each waypoint, rad/s, `(segments + 1, joints)`.

    It is that of the parabola through the misses of both segments, and zero at the ends. So a short
    segment between long ones is passed a little faster or slower, which costs little; to start
    and end there without such a velocity would cost some `6 e / L²`.
    """
    lengths = layout.lengths
    before = lengths[:-1]
    after = lengths[1:]
    rate = missed / lengths
    weighted = rate[:-1] * after + rate[1:] * before
    parabola = weighted / (before + after)
    rest = np.zeros_like(missed[:1])
    return np.concatenate([rest, parabola, rest])


def _bent(
    layout: _Layout,
    slopes: Array,
    *curvatures: Array,
) -> tuple[Array, Array]:
    """The powers of `σ` and of `1 − σ` that change derivatives at waypoints, but no position there.

    Args:
        layout: of the segments.
        slopes: velocities to add at waypoints, `(segments + 1, joints)`.
        curvatures: accelerations to add at the end and at the start of each segment, `(segments,
            joints)` both; none where these may jump.
    """
    lengths = layout.lengths
    # 1 − σ runs backwards in time
    growing = [slopes[1:] * lengths]
    dying = [-slopes[:-1] * lengths]
    if curvatures:
        ending, starting = curvatures
        square = lengths**2
        growing.append(ending * square)
        dying.append(starting * square)
    return _ending(*growing), _ending(*dying)


def _in_time(
    layout: _Layout,
    growing: Array,
    dying: Array,
    lowest_power: int,
) -> Array:
    """Powers of `σ` and `1 − σ`, as powers of the time since each piece's start."""
    start = layout.of_pieces(layout.start)
    end = layout.of_pieces(layout.end)
    begins = layout.breaks[:-1]
    length = end - start
    elapsed = (begins - start) / length  # σ at the piece's start
    left = (end - begins) / length  # 1 − σ there
    grown = polynomials.shifted(
        _rows(growing, lowest_power),
        elapsed[:, None],
    )
    died = polynomials.shifted(
        _rows(dying, lowest_power),
        left[:, None],
    )
    rate = 1 / length
    forwards = polynomials.stretched(grown, rate)
    backwards = polynomials.stretched(died, -rate)
    return forwards + backwards


def _is_negligible(
    added: Array,
    layout: _Layout,
    problem: Problem,
    joints: Bools,
) -> bool:
    """Whether a correction moves no joint by more than rounding and uses next to no limit."""
    limits = problem.limits.by_name()
    lengths = layout.trajectory.lengths
    for name, order in LIMIT_ORDERS.items():
        sizes = np.abs(limits[name])
        allowed = NEGLIGIBLE_USE * sizes.min(axis=1)
        if name == "position":
            allowed = problem.rounding
        derivative = polynomials.derivative(added, order)
        unit = polynomials.stretched(derivative, lengths)
        # A polynomial stays within the range of its Bernstein coefficients.
        controls = polynomials.bernstein(unit)
        small = np.abs(controls) <= allowed[joints]
        if not small.all():
            return False
    return True


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
    """Jumps of a derivative at every break, `(breaks, joints)`.

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
    return np.asarray(after - before)


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


def _rows(factors: Array, lowest_power: int) -> Array:
    """Factors `(…, n)` of n powers of x, the lowest first, in the layout of `Trajectory`."""
    lowest_first = np.moveaxis(factors, -1, 0)
    highest_first = lowest_first[::-1]
    lower_powers = np.zeros((lowest_power, *highest_first.shape[1:]))
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


# --- position limits ---

# A waypoint this near to a position limit lies on it, relative to the joint's largest displacement.
_ON_LIMIT_RTOL = 1e-11
_EXCESS_RTOL = 1e-10
# Twice the share each time, from a rounding unit to the whole.
_MAX_MIXTURES = 64
# From 0 to 1, and there and back to 0, in powers of σ from σ³: both rest at both ends.
_STEP = np.array([10.0, -15.0, 6.0, 0.0])
_BUMP = 64 * np.array([1.0, -3.0, 3.0, -1.0])
_BUMP_CURVATURE = 24.0


def _within_position_limits(
    problem: Problem,
    layout: _Layout,
    coefficients: Array,
) -> Array:
    """The motion, pushed within its position limits; positions are since each segment's waypoint.

    At a waypoint on a limit the joint turns: its velocity is zero, and it does not accelerate
    outwards. Then each joint's motion is mixed with as little as needed of one that is inside and
    rests at every waypoint. Not a number where no mixture is inside.
    """
    side = _sides(problem, layout)
    share = np.zeros(problem.joints)
    joints = np.ones_like(share, dtype=bool)
    turn = _turned_at_limits(layout, coefficients, side)
    coefficients = _with_added(coefficients, turn, joints)
    resting = _resting(problem, layout, side)
    towards_rest = _with_added(resting, -coefficients, joints)
    mixed = coefficients
    for _ in range(_MAX_MIXTURES):
        needed = _needed_share(problem, layout, mixed, resting)
        if not needed.any():
            return mixed
        left = 1 - share
        more = np.maximum(2 * share, share + left * needed)
        share = np.where(needed > 0, more, share)
        share = np.minimum(share, 1.0)
        added = share * towards_rest
        mixed = _with_added(coefficients, added, joints)
    return np.full_like(mixed, np.nan)


def _sides(problem: Problem, layout: _Layout) -> Array:
    """1 for a waypoint on the upper limit, −1 on the lower, else 0, `(segments + 1, joints)`."""
    low, high = problem.limits.position.T
    waypoints = layout.waypoints
    near = _ON_LIMIT_RTOL * problem.largest_displacements
    above = high - waypoints <= near
    below = waypoints - low <= near
    return np.asarray(above.astype(float) - below)


def _allowed_excess(problem: Problem, layout: _Layout) -> Array:
    """The rounding of coordinates in each segment, rad, where it is worth less than 1e-10 of all.

    An excess `e` at a waypoint `g` from a limit is worth some `e / sqrt(2gA)` s; where the joint
    turns on the limit, only in proportion to `e`.
    """
    low, high = problem.limits.position.T
    waypoints = layout.waypoints
    gap = np.minimum(high - waypoints, waypoints - low)
    worthless = _EXCESS_RTOL * np.sqrt(gap * problem.largest_displacements)
    turns = _sides(problem, layout) != 0
    allowed = np.where(turns, np.inf, worthless)
    of_segment = np.minimum(allowed[:-1], allowed[1:])
    return np.minimum(of_segment, problem.rounding)


def _turned_at_limits(
    layout: _Layout,
    coefficients: Array,
    side: Array,
) -> Array:
    """What to add for the motion to turn at every waypoint on a position limit."""
    lengths = layout.trajectory.lengths
    velocity = polynomials.derivative(coefficients)
    acceleration = polynomials.derivative(velocity)
    leaving = velocity[-1, layout.first]
    at_rest = np.zeros_like(leaving[:1])
    velocities = np.concatenate([leaving, at_rest])
    slopes = np.where(side == 0, 0.0, -velocities)
    unit = polynomials.stretched(acceleration, lengths)
    stops = unit.sum(axis=0)
    last = layout.after - 1
    ending = _inwards(stops[last], side[1:])
    starting = _inwards(unit[-1, layout.first], side[:-1])
    growing, dying = _bent(layout, slopes, ending, starting)
    return _in_time(
        layout,
        layout.of_pieces(growing),
        layout.of_pieces(dying),
        lowest_power=3,
    )


def _inwards(acceleration: Array, side: Array) -> Array:
    """What to add to accelerations that lead outwards."""
    outwards = side * acceleration > 0
    return np.where(outwards, -acceleration, 0.0)


def _resting(problem: Problem, layout: _Layout, side: Array) -> Array:
    """A motion within the limits that rests at every waypoint, `(7, pieces, joints)`.

    It is monotone between waypoints; where both are on one limit it makes way inwards and back, as
    far as half the acceleration limit takes it.
    """
    limits = problem.limits
    low, high = limits.position.T
    sizes = np.abs(limits.acceleration)
    half = sizes.min(axis=1) / 2
    reach = half * layout.lengths**2 / _BUMP_CURVATURE
    middle = (high - low) / 2
    depth = np.minimum(reach, middle)
    start = side[:-1]
    end = side[1:]
    stays = np.where(start == end, start, 0.0)
    inwards = -stays * depth
    steps = layout.displacements[..., None] * _STEP
    bumps = inwards[..., None] * _BUMP
    growing = layout.of_pieces(steps + bumps)
    none = np.zeros_like(growing)
    return _in_time(layout, growing, none, lowest_power=3)


def _needed_share(
    problem: Problem,
    layout: _Layout,
    mixed: Array,
    resting: Array,
) -> Array:
    """How much of the resting motion each joint needs where it is outside, `(joints,)`."""
    lengths = layout.trajectory.lengths
    low, high = problem.limits.position.T
    lowest = low - layout.origins
    highest = high - layout.origins
    unit = polynomials.stretched(mixed, lengths)
    # Of the whole segment, since a piece starts where the pieces before it have led.
    of_each = polynomials.evaluation_rounding(unit)
    largest = np.maximum.reduceat(of_each, layout.first)
    # and what the coordinates' rounding allows
    segment_rounding = np.maximum(largest, _allowed_excess(problem, layout))
    rounding = layout.of_pieces(segment_rounding)
    controls = polynomials.bernstein(unit)
    above = controls.max(axis=0) > highest + rounding
    below = controls.min(axis=0) < lowest - rounding
    needed = np.zeros(problem.joints)
    may_leave = above | below
    if not may_leave.any():
        return needed
    where = np.nonzero(may_leave)
    pieces, joints = where
    candidates = unit[:, pieces, joints]
    points = polynomials.critical_points(candidates)
    values = polynomials.evaluate(candidates[:, None], points)
    unit_rest = polynomials.stretched(resting, lengths)
    rest = unit_rest[:, pieces, joints]
    at_rest = polynomials.evaluate(rest[:, None], points)
    inside = np.clip(values, lowest[where], highest[where])
    beyond = values - inside
    outside = np.abs(beyond) > rounding[where]
    # (1 − share) value + share at_rest = inside
    ratio = beyond / (values - at_rest)
    share = np.where(outside, ratio, 0.0)
    np.maximum.at(needed, joints, share.max(axis=0))
    return np.clip(needed, 0.0, 1.0)
