"""The exact repair of a trajectory (docs/mathematics.md, section 9).

The repaired motion passes every waypoint, begins and ends in the states that are asked (by default
at rest), does not jump, and stays within its position limits. The limits then judge the repaired
motion. A repair costs velocity and acceleration where the given motion missed or jumped.

The steps, each of them a function:

1. `_layout`: a break at every waypoint, and which pieces belong to which segment.
2. `_rebased`: positions are integrated anew from each segment's first waypoint. They no longer jump
   within a segment; only the segment's end may miss its waypoint.
3. `_cancelling`: polynomials within one segment each cancel that miss, the jumps at breaks, and
   wrong states at both ends of the motion.
4. `_within_position_limits`: the motion is mixed with as little as needed of one that is inside.

The polynomials of step 3: the correction of a break lives on the longer side of its segment, for
the time `ρ` there. It *grows* from the segment's start to the break, or it *dies* from the break to
the segment's end. All corrections of one joint in one segment of duration `L` add up to

    Σ_m growing_m σ^m + Σ_m dying_m (1 − σ)^m,    m = r + 1 … 2r + 1,    σ = (t − t_{k−1}) / L.

Here `r` is the highest derivative that may not jump: 1, or 2 where jerk is limited. Section 9 has a
worked example.

Two exceptions keep a repair cheap where times are tiny. A waypoint that may be missed by its
rounding (`trajopt.core.resolution`) bounds no segment, as long as the repaired motion misses it by
no more. A brief segment, beside two long ones, is integrated anew whole (`_smoothed`): its jumps
are then at its ends, where the long segments take them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.limits import LIMIT_ORDERS
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.trajectory import Trajectory, nearest
from trajopt.judging.passing import misses

# A correction that uses a smaller share of every limit is left out. All corrections that are left
# out change the certified duration by no more than this share.
NEGLIGIBLE_USE = 1e-12
SURE = 0.9  # of what is negligible: a bound below it is no matter of rounding
UNEVEN = 1e4  # most times that a segment takes another's time, for that bound
MAX_PASSES = 2  # the second pass repairs the rounding of large corrections
# Attempts to miss some waypoints by no more than rounding; then the motion is to meet all of them.
MAX_ATTEMPTS = 8
_MOST_CELLS = 200_000  # pieces times joints; a longer motion is corrected joint by joint,
_BLOCK = 20_000  # so many pieces at once
# A segment is brief if it takes less than this share of the time of both its neighbours.
BRIEF_RTOL = 1e-3


def repaired(problem: Problem, trajectory: Trajectory) -> Trajectory | None:
    """Return the motion, changed so that it passes every waypoint and does not jump.

    Velocity becomes continuous, and equal to the route's velocities at both ends. So does the
    acceleration of joints whose jerk is limited. Positions stay within their limits. Duration and
    waypoint times stay the same, up to rounding.

    Args:
        problem: of as many joints and waypoints as the trajectory has.
        trajectory: whatever a planner returned.

    Returns:
        The repaired trajectory; None where repair is impossible: two different waypoints at one
        instant, or a number that overflows.
    """
    merged, index, motion = _merged(problem, trajectory)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        found = _without_spared(merged, motion)
    if found is None or merged is problem:
        return found
    return replace(found, waypoint_times=found.waypoint_times[index])


def is_repairable(problem: Problem, trajectory: Trajectory) -> bool:
    """Return whether no two different waypoints are at one instant.

    A motion without position limits can then be repaired, unless its numbers overflow.
    """
    merged, _, motion = _merged(problem, trajectory)
    return _layout(merged, motion, ~spared(merged)) is not None


def _merged(problem: Problem, trajectory: Trajectory) -> tuple[Problem, Indices, Trajectory]:
    """Return both without equal neighbours among the waypoints, and where each waypoint went."""
    merged, index = problem.merged()
    if merged is problem:
        return problem, index, trajectory
    # The first of equal waypoints counts; at the end of the motion, the last.
    _, counted = np.unique(index, return_index=True)
    counted[-1] = len(index) - 1
    motion = replace(trajectory, waypoint_times=trajectory.waypoint_times[counted])
    return merged, index, motion


def _without_spared(problem: Problem, trajectory: Trajectory) -> Trajectory | None:
    """Return the repaired motion; it may miss some waypoints by no more than their rounding."""
    missed = spared(problem)
    for _ in range(MAX_ATTEMPTS):
        motion = _repaired(problem, trajectory, ~missed)
        if motion is None or not missed.any():
            return motion
        passes = misses(problem, motion) <= 1
        if passes[missed].all():
            return motion
        missed &= passes
    return _repaired(problem, trajectory, np.full_like(missed, True))


def _repaired(problem: Problem, trajectory: Trajectory, met: Bools) -> Trajectory | None:
    """Return the repaired motion that meets the chosen waypoints, `(waypoints,)`."""
    motion = trajectory
    for _ in range(MAX_PASSES):
        layout = _layout(problem, motion, met)
        if layout is None:
            return None
        rebased, missed = _rebased(layout, anew=motion is trajectory)
        coefficients, changed = _corrected(problem, layout, rebased, missed)
        del rebased
        if not all(np.isfinite(row).all() for row in coefficients):
            return None
        motion = _placed(layout, coefficients)
        if not changed:
            break
    return motion


def _placed(layout: _Layout, coefficients: Array) -> Trajectory:
    """Return the motion of coefficients whose positions count from the segment's first waypoint.

    The array becomes that of the motion.
    """
    for some in _parts(layout):
        coefficients[-1, :, some] += layout.of_pieces(layout.waypoints[:-1, some])
    motion = layout.trajectory
    times = motion.breaks[layout.waypoint_breaks]
    return motion.with_coefficients(coefficients, times)


def _corrected(
    problem: Problem, layout: _Layout, coefficients: Array, missed: Array
) -> tuple[Array, bool]:
    """Return the coefficients of a motion without miss, jump, or excess over a position limit.

    Positions are relative to the segment's first waypoint. The array is changed, or replaced where
    it has too few rows.

    Args:
        problem: Its limits and end states.
        layout: of the segments.
        coefficients: as `_rebased` returns them.
        missed: of the segments' ends, rad, `(segments, joints)`.

    Returns:
        The coefficients, and whether a correction was needed.
    """
    changed = False
    at_limits = problem.has("position")
    accelerations_too = problem.limits.smooth >= 2
    by_order = {1: ~accelerations_too, 2: accelerations_too}
    every = slice(0, problem.joints)
    for order, joints in by_order.items():
        if not joints.any():
            continue
        parts = _parts(layout, joints)
        if len(parts) == 1:
            jumps = _jumps_up_to(order, problem, layout, every)
            if not at_limits and _surely_negligible(problem, layout, joints, missed, jumps):
                continue
            added = _added(layout, joints, missed, jumps)
            if at_limits or not _is_negligible(added, layout, problem, every):
                coefficients = polynomials.plus(coefficients, added)
                changed = True
            continue
        # Made twice, to be judged and to be added: kept, they would be as large as the motion.
        if at_limits or not all(
            _is_negligible(added, layout, problem, some, pieces)
            for some, pieces, added in _added_in_parts(order, problem, layout, parts, missed)
        ):
            changed = True
            rows = 2 * order + 2
            if len(coefficients) < rows:
                coefficients = polynomials.plus(coefficients, np.zeros((rows, 1, 1)))
            for some, pieces, added in _added_in_parts(order, problem, layout, parts, missed):
                coefficients[-rows:, pieces, some] += added
    if at_limits:
        before = coefficients
        coefficients = _within_position_limits(problem, layout, coefficients)
        changed |= coefficients is not before
    return coefficients, changed


@dataclass(frozen=True)
class _Layout:
    """The pieces of each segment; a segment between equal waypoints is left out.

    Attributes:
        trajectory: with a break at every waypoint.
        waypoint_breaks: the index of each of the problem's waypoints' break, `(waypoints,)`.
        segment: of each piece, `(pieces,)`.
        first: the first piece of each segment, `(segments,)`.
        after: the first piece after each segment, `(segments,)`.
        waypoints: at the ends of these segments, rad, `(segments + 1, joints)`.
    """

    trajectory: Trajectory
    waypoint_breaks: Indices
    segment: Indices
    first: Indices
    after: Indices
    waypoints: Array

    def travel(self, some: slice = slice(None)) -> Array:
        """Each piece's own displacement, from its velocity alone, rad, `(pieces, joints)`.

        Args:
            some: Which joints.
        """
        # the position at a piece's start is not its travel
        motion = _of_joints(self.trajectory, some)
        units = (motion.pieces(0, block) for block in motion.blocks())
        return np.concatenate([unit[:-1].sum(axis=0) for unit in units])

    @cached_property
    def since_start(self) -> Array:
        """Time from the start of its segment to the end of each piece, s, `(pieces,)`.

        Breaks round it: they count from the start of the motion.
        """
        lengths = self.trajectory.lengths
        segments = zip(self.first, self.after, strict=True)
        return np.concatenate([np.cumsum(lengths[first:after]) for first, after in segments])

    @property
    def lengths(self) -> Array:
        """Duration of each segment, s, `(segments, 1)`."""
        return self.since_start[self.after - 1, None]

    @cached_property
    def brief(self) -> Bools:
        """Segments that are brief beside both their neighbours, `(segments,)`."""
        lengths = self.lengths[:, 0]
        found = np.zeros(len(lengths), dtype=bool)
        neighbours = np.minimum(lengths[:-2], lengths[2:])
        found[1:-1] = lengths[1:-1] <= BRIEF_RTOL * neighbours
        return found

    @cached_property
    def within_brief(self) -> Bools:
        """Breaks within these segments, but for their ends, `(breaks,)`."""
        found = np.append(self.brief[self.segment], False)
        found[self.first] = False
        return found

    def times_of(self, some: slice) -> tuple[Array, Array]:
        """Return the duration of each piece's segment, and the time from its start to that end, s.

        Args:
            some: Which pieces.
        """
        whole = self.of_pieces(self.lengths[:, 0], some)
        return whole, whole - self.since_start[some] + self.trajectory.lengths[some]

    @property
    def displacements(self) -> Array:
        """Displacement of each joint in each segment, rad, `(segments, joints)`."""
        return np.diff(self.waypoints, axis=0)

    def blocks(self) -> Iterator[slice]:
        """Yield the pieces in blocks, in order; of a short motion all at once."""
        count = len(self.segment)
        is_long = count * self.trajectory.joints > _MOST_CELLS
        size = _BLOCK if is_long else count
        for first in range(0, count, size):
            yield slice(first, min(first + size, count))

    def of_pieces(self, of_segments: Array, some: slice = slice(None)) -> Array:
        """Repeat values of the segments for each of their pieces, or for some pieces."""
        return of_segments[self.segment[some]]


def _layout(problem: Problem, trajectory: Trajectory, met: Bools) -> _Layout | None:
    """Return the segments between the waypoints to meet; None if two of these share a break."""
    times = trajectory.waypoint_times
    refined = trajectory.refined(times)
    breaks = refined.breaks
    at = nearest(breaks, times)
    at[0] = 0
    at[-1] = len(breaks) - 1
    ends = at[met]
    first = ends[:-1]
    after = ends[1:]
    pieces = after - first
    if not pieces.all():
        return None
    segments = np.arange(len(first))
    layout = _Layout(
        trajectory=refined,
        waypoint_breaks=at,
        segment=np.repeat(segments, pieces),
        first=first,
        after=after,
        waypoints=problem.waypoints[met],
    )
    return _smoothed(layout, problem.limits.jerk_limited)


def _smoothed(layout: _Layout, jerk_limited: Bools) -> _Layout:
    """Return the layout whose brief segments jump at their ends only.

    In a brief segment velocity is integrated anew from the segment's start (and acceleration, where
    jerk is limited). A constant velocity is then added that leads to the next waypoint. Corrections
    within the segment would cost `δ/L` of acceleration or `6 δ/L²` of jerk, with a tiny `L`.
    """
    if not layout.brief.any():
        return layout
    chosen = layout.brief[layout.segment, None]
    if jerk_limited.any():
        layout = _integrated(layout, 2, chosen & jerk_limited)
    layout = _integrated(layout, 1, chosen)
    rate = layout.of_pieces(_missed(layout, layout.travel()) / layout.lengths)
    return _with_added(layout, 1, np.where(chosen, rate, 0.0))


def _integrated(layout: _Layout, order: int, chosen: Bools) -> _Layout:
    """Return the layout with a derivative integrated anew where chosen, `(pieces, joints)`."""
    unit = layout.trajectory.pieces(order)
    start = unit[-1]
    gained = unit[:-1].sum(axis=0)
    ended = np.cumsum(gained, axis=0)
    before = ended - gained
    within = before - layout.of_pieces(before[layout.first])
    anew = layout.of_pieces(start[layout.first]) + within
    return _with_added(layout, order, np.where(chosen, anew - start, 0.0))


def _with_added(layout: _Layout, order: int, added: Array) -> _Layout:
    """Return the layout with a constant added to a derivative of each piece, `(pieces, joints)`."""
    coefficients = np.zeros_like(added, shape=(order + 1, *added.shape))
    coefficients[0] = added / math.factorial(order)
    own = polynomials.plus(layout.trajectory.coefficients, coefficients)
    return replace(layout, trajectory=replace(layout.trajectory, coefficients=own))


def _rebased(layout: _Layout, *, anew: bool) -> tuple[Array, Array]:
    """Return the coefficients with positions integrated anew from each segment's first waypoint.

    Positions then do not jump within a segment; only its end may miss the waypoint.

    Args:
        layout: of the segments.
        anew: Whether they are a new array; else the motion's is changed, which is then no motion.

    Returns:
        The coefficients, and the miss of each segment's last waypoint, rad, `(segments, joints)`.
    """
    missed = np.empty_like(layout.displacements)
    coefficients = layout.trajectory.coefficients
    if anew:
        coefficients = np.array(coefficients)
    else:
        coefficients.setflags(write=True)
    for some in _parts(layout):
        travel = layout.travel(some)
        missed[:, some] = _missed(layout, travel, some)
        # A piece starts where the pieces before it in its segment end.
        within = np.cumsum(travel, axis=0)
        within -= travel
        del travel
        within -= layout.of_pieces(within[layout.first])
        coefficients[-1, :, some] = within
    return coefficients, missed


def _cancelling(
    layout: _Layout, missed: Array, jumps: list[Array]
) -> Iterator[tuple[slice, Array]]:
    """Yield the polynomials that cancel misses and jumps, `(2 order + 2, pieces, joints)`.

    A long motion's in blocks of pieces, each with the slice that it is.

    Args:
        layout: of the segments.
        missed: of the segments' ends, rad, `(segments, joints)`.
        jumps: of velocity, and of acceleration if it may not jump, `(breaks, joints)` each. Their
            number is the order.
    """
    order = len(jumps)
    slopes = _slopes(layout, missed)
    unbent = [np.zeros_like(missed)] * 2
    curvatures = unbent if order == 2 else []
    ending, starting = _bent(layout, slopes, *curvatures)
    of_segments = missed[..., None] * _BLEND[order] + ending
    for some, growing, dying in _jump_corrections(layout, jumps):
        growing += layout.of_pieces(of_segments, some)
        dying += layout.of_pieces(starting, some)
        yield some, _in_time(layout, growing, dying, order + 1, some)


def _missed(layout: _Layout, travel: Array, some: slice = slice(None)) -> Array:
    """Return the miss of each segment's last waypoint, rad, `(segments, joints)`.

    `travel` is that of the pieces, of some joints.
    """
    reached = np.add.reduceat(travel, layout.first)
    return layout.displacements[:, some] - reached


def _slopes(layout: _Layout, missed: Array) -> Array:
    """Return the velocity at each waypoint of the correction of misses, `(segments + 1, joints)`.

    In rad/s. It is that of the parabola through the misses of both segments, and zero at both ends
    of the motion. A short segment between long ones is then passed a little faster or slower, which
    costs little. Without velocity at its ends the correction of a miss `e` would cost an
    acceleration of `6 e / L²`. In a brief segment both ends have the same velocity.
    """
    lengths = layout.lengths
    before = lengths[:-1]
    after = lengths[1:]
    rate = missed / lengths
    weighted = rate[:-1] * after + rate[1:] * before
    parabola = weighted / (before + after)
    rest = np.zeros_like(missed[:1])
    slopes = np.concatenate([rest, parabola, rest])
    (brief,) = np.nonzero(layout.brief)
    slopes[brief] = slopes[brief + 1] = rate[brief]
    return slopes


def _bent(layout: _Layout, slopes: Array, *curvatures: Array) -> tuple[Array, Array]:
    """Return powers of `σ` and `1 − σ` that change derivatives at waypoints, but no position there.

    Args:
        layout: of the segments.
        slopes: velocities to add at waypoints, `(segments + 1, joints)`.
        curvatures: accelerations to add at the end and at the start of each segment, `(segments,
            joints)` both; none where these may jump.
    """
    lengths = layout.lengths
    # 1 − σ runs backwards in time: a velocity changes its sign.
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
    some: slice = slice(None),
) -> Array:
    """Return powers of `σ` and `1 − σ` as powers of the time since each piece's start, s.

    Args:
        layout: of the segments.
        growing, dying: `(pieces, joints, order + 1)`.
        lowest_power: of both.
        some: Which pieces these are.
    """
    length, until_end = layout.times_of(some)
    left = until_end / length  # 1 − σ at the piece's start
    elapsed = 1 - left  # σ there
    rate = 1 / length
    of_elapsed = _rows(growing, lowest_power)
    grown = polynomials.shifted(of_elapsed, elapsed[:, None])
    forwards = polynomials.stretched(grown, rate)
    of_left = _rows(dying, lowest_power)
    died = polynomials.shifted(of_left, left[:, None])
    backwards = polynomials.stretched(died, -rate)
    return forwards + backwards


def _added(layout: _Layout, corrected: Bools, missed: Array, jumps: list[Array]) -> Array:
    """Return the corrections of all joints, 0 of those that are not corrected."""
    added = np.zeros((2 * len(jumps) + 2, len(layout.segment), len(corrected)))
    of_joints = [jump[:, corrected] for jump in jumps]
    for pieces, own in _cancelling(layout, missed[:, corrected], of_joints):
        added[:, pieces, corrected] = own
    return added


def _added_in_parts(
    order: int, problem: Problem, layout: _Layout, parts: Sequence[slice], missed: Array
) -> Iterator[tuple[slice, slice, Array]]:
    """Yield the corrections of a long motion: which joints, which pieces, and the polynomials."""
    for some in parts:
        jumps = _jumps_up_to(order, problem, layout, some)
        for pieces, added in _cancelling(layout, missed[:, some], jumps):
            yield some, pieces, added


def _parts(layout: _Layout, chosen: Bools | None = None) -> list[slice]:
    """Return all joints at once, or the chosen ones one by one in a long motion, for memory."""
    joints = layout.trajectory.joints
    if len(layout.segment) * joints <= _MOST_CELLS:
        return [slice(0, joints)]
    every = range(joints) if chosen is None else np.flatnonzero(chosen).tolist()
    return [slice(joint, joint + 1) for joint in every]


def _of_joints(motion: Trajectory, some: slice) -> Trajectory:
    """Return the motion of some joints."""
    if some.stop is None or some == slice(0, motion.joints):
        return motion
    return motion.with_coefficients(motion.coefficients[..., some], motion.waypoint_times)


def _is_negligible(
    added: Array,
    layout: _Layout,
    problem: Problem,
    joints: slice,
    pieces: slice = slice(None),
) -> bool:
    """Return whether a correction uses no limit, and moves by rounding at most.

    It is that of some joints in some pieces.
    """
    limits = problem.limits.in_all_segments().by_name()
    for name, order in LIMIT_ORDERS.items():
        sizes = np.abs(limits[name][joints])
        allowed = NEGLIGIBLE_USE * sizes.min(axis=1)
        if name == "position":
            allowed = problem.rounding[joints]
        derivative = polynomials.derivative(added, order)
        unit = polynomials.stretched(derivative, layout.trajectory.lengths[pieces])
        # A polynomial stays within the range of its Bernstein coefficients.
        controls = np.abs(polynomials.bernstein(unit))
        if not (controls <= allowed).all():
            return False
    return True


def _surely_negligible(
    problem: Problem, layout: _Layout, joints: Bools, missed: Array, jumps: list[Array]
) -> bool:
    """Return whether a bound shows that a correction is negligible, without computing it."""
    limits = problem.limits.in_all_segments().by_name()
    sides = [np.abs(limits[name]).min(axis=1) for name in ("velocity", "acceleration", "jerk")]
    allowed = [problem.rounding, *(NEGLIGIBLE_USE * own for own in sides)]
    bound = Corrections(
        first=layout.first,
        lengths=layout.lengths,
        longest=layout.lengths.max(),
        until_end=layout.times_of(slice(None))[1][:, None],
        rate=np.abs(missed / layout.lengths).max(axis=0)[joints],
        missed=missed[:, joints],
        starting=[own[:-1, joints] for own in jumps],
        ending=[own[layout.after][:, joints] for own in jumps],
    )
    return bool(bound.negligible([own[joints] for own in allowed]).all())


@dataclass(frozen=True)
class Corrections:
    """What corrections of segments cancel: enough to say that they are negligible.

    Attributes:
        first: The first piece of each segment, `(segments,)`.
        lengths: Of the segments, s, `(segments, 1)`.
        longest: That of the motion's longest segment.
        until_end: From the start of a piece to the end of its segment, s, `(pieces, 1)`.
        rate: Largest missed displacement over time in a segment of the motion, rad/s, `(joints,)`,
            or of each segment.
        missed: Displacements, rad, `(segments, joints)`.
        starting: The jump at the start of each piece, of velocity, and of acceleration where jerk
            is limited, `(pieces, joints)` each.
        ending: Those at the end of each segment, `(segments, joints)`.
    """

    first: Indices
    lengths: Array
    longest: Array
    until_end: Array
    rate: Array
    missed: Array
    starting: Sequence[Array]
    ending: Sequence[Array]

    def negligible(self, allowed: Sequence[Array]) -> Bools:
        """Return whether a bound shows that corrections are negligible, `(segments,)`.

        A correction is a sum of polynomials on [0, 1], of which a piece is a part: its Bernstein
        coefficients lie within those of the whole. Where segments of a motion differ in time by
        more than `UNEVEN`, rounding of the long ones' corrections counts in the short ones.

        Args:
            allowed: Of position … jerk, `(joints,)` each, or `(segments, joints)`.
        """
        lengths = self.lengths
        whole = np.diff(self.first, append=len(self.until_end))
        passed = np.repeat(lengths, whole, axis=0) - self.until_end
        time = np.maximum(passed, self.until_end)  # the longer side has the correction
        of_blend, *of_jumps = _control_sizes(len(self.starting))
        kept = (lengths * UNEVEN > self.longest)[:, 0]
        for order, most in enumerate(allowed):
            bound = of_blend[order] * np.abs(self.missed) / lengths**order
            # slopes at both ends that lead from one miss to the next
            bound += 2 * of_jumps[0][order] * self.rate * lengths ** (1 - order)
            jumps = zip(of_jumps, self.starting, self.ending, strict=True)
            for power, (size, starting, ending) in enumerate(jumps, start=1 - order):
                within = np.add.reduceat(np.abs(starting) * time**power, self.first)
                bound += size[order] * (within + np.abs(ending) * lengths**power)
            kept &= (bound <= SURE * most).all(axis=1)
        return kept


@cache
def _control_sizes(order: int) -> list[list[float]]:
    """Return the largest Bernstein coefficients of position … jerk of parts of a correction.

    Of the blend from 0 to 1, of a slope of 1 at the end, and of a curvature of 1 there, each in the
    time 1.
    """
    ends = [[1.0]] if order == 1 else [[1.0, 0.0], [0.0, 1.0]]
    parts = [_BLEND[order], *(_ending(*map(np.array, own)) for own in ends)]
    found = []
    for part in parts:
        whole = _rows(part, order + 1)[:, None]
        each = (polynomials.bernstein(polynomials.derivative(whole, k)) for k in range(4))
        found.append([float(np.abs(own).max()) for own in each])
    return found


def _jump_corrections(layout: _Layout, jumps: list[Array]) -> Iterator[tuple[slice, Array, Array]]:
    """Yield the powers of `σ` and `1 − σ` that cancel all jumps, `(pieces, joints, order + 1)`.

    A long motion's in blocks of pieces. `jumps` has those of velocity, and of acceleration if it
    may not jump, `(breaks, joints)` each.

    A piece has the dying corrections of the breaks at or before its start, and the growing ones of
    the breaks after its start, in its own segment: differences of sums over all breaks.
    """
    first, after = layout.first, layout.after
    pieces = list(layout.blocks())
    breaks = [*pieces[:-1], slice(pieces[-1].start, pieces[-1].stop + 1)]
    shape = (len(first), jumps[0].shape[1], len(jumps) + 1)
    before_segment, to_segment_end = np.empty(shape), np.empty(shape)
    sums = np.zeros((2, *shape[1:]))
    for some in breaks:
        each = _at_breaks(layout, jumps, some)
        starts, ends = (
            slice(*np.searchsorted(own, (some.start, some.stop))) for own in (first, after)
        )
        starting = each[1][first[starts] - some.start]
        sums = _summed(each, sums)
        before_segment[starts] = each[1][first[starts] - some.start] - starting
        to_segment_end[ends] = each[0][after[ends] - some.start]
    sums = np.zeros_like(sums)
    for some, own in zip(breaks, pieces, strict=True):
        if len(breaks) > 1:
            each = _at_breaks(layout, jumps, some)
            sums = _summed(each, sums)
        growing, dying = (summed[: own.stop - own.start] for summed in each)
        still_growing = layout.of_pieces(to_segment_end, own)
        still_growing -= growing
        dying -= layout.of_pieces(before_segment, own)
        yield own, still_growing, dying


def _summed(each: tuple[Array, Array], before: Array) -> Array:
    """Sum up corrections in place, from the sums before on; return the last sums."""
    for values, sums in zip(each, before, strict=True):
        values[0] += sums
        np.cumsum(values, axis=0, out=values)
    return np.stack([values[-1] for values in each])


def _at_breaks(layout: _Layout, jumps: list[Array], some: slice) -> tuple[Array, Array]:
    """Return the growing and the dying corrections of some breaks; of each break one is 0.

    As powers of `σ` and of `1 − σ`, `(breaks, joints, order + 1)` each.
    """
    order = len(jumps)
    last = len(layout.segment)
    # A correction lives on the longer side of its break: there it costs least acceleration. The
    # time on both sides is that within the break's segment; there is none outside the motion.
    after = slice(some.start, min(some.stop, last))
    before = slice(max(some.start - 1, 0), some.stop - 1)
    length_after, time_after = layout.times_of(after)
    length_before = layout.of_pieces(layout.lengths[:, 0], before)
    time_before = layout.since_start[before]
    if some.start == 0:
        time_before, length_before = np.append(-1.0, time_before), np.append(np.inf, length_before)
    if some.stop > last:
        time_after, length_after = np.append(time_after, -1.0), np.append(length_after, np.inf)
    dies = time_after > time_before
    time = np.where(dies, time_after, time_before)
    # The longer side's time as a share of the segment.
    share = time / np.where(dies, length_after, length_before)

    # The derivatives that the correction has at the break, in units of its time. A growing one adds
    # the jump before the break, a dying one subtracts it after the break.
    sign = np.where(dies, -1.0, 1.0)[:, None]
    unit = sign * time[:, None]
    slopes = []
    for derivative, jump in enumerate(jumps, start=1):
        cancelled = sign * jump[some]
        slope = cancelled * unit**derivative
        slopes.append(slope)
    # x^(r+1) … x^(2r+1), in x = σ / share.
    lowest_power = order + 1
    powers = np.arange(lowest_power, lowest_power + order + 1)
    growing = _ending(*slopes) * share[:, None, None] ** -powers
    dying = np.where(dies[:, None, None], growing, 0.0)
    growing -= dying
    return growing, dying


def _jumps_up_to(order: int, problem: Problem, layout: _Layout, some: slice) -> list[Array]:
    """Return the jumps of the derivatives from 1 to an order, of some joints."""
    return [_jumps(problem, layout, own, some) for own in range(1, order + 1)]


def _jumps(problem: Problem, layout: _Layout, order: int, some: slice) -> Array:
    """Return the jumps of a derivative of some joints at every break, `(breaks, joints)`.

    Before and after the motion the robot is in the states that are asked. Before a closed motion it
    is in the state of the motion's end. Jumps within brief segments are rounding of the integration
    and count as zero.
    """
    motion = _of_joints(layout.trajectory, some)
    route = problem.route
    before = route.start[order - 1][some]
    blocks = list(motion.blocks())
    if "closed" in route.demands:  # the start takes the state of the end
        before = motion.pieces(order, blocks[-1]).sum(axis=0)[-1]
    jumps = np.empty((len(motion.breaks), motion.joints))
    for pieces in blocks:
        unit = motion.pieces(order, pieces)
        own = jumps[pieces]
        own[...] = unit[-1]
        stops = unit.sum(axis=0)
        own[0] -= before
        own[1:] -= stops[:-1]
        before = stops[-1]
    jumps[-1] = 0.0 if "closed" in route.demands else route.end[order - 1][some] - before
    jumps[layout.within_brief] = 0.0
    return jumps


# From 0 to 1 with one, or two, derivatives zero at both ends: 3x² − 2x³, 10x³ − 15x⁴ + 6x⁵.
_BLEND = {1: np.array([3.0, -2.0]), 2: np.array([10.0, -15.0, 6.0])}


def _ending(slope: Array, curvature: Array | None = None) -> Array:
    """Return the polynomial that is zero at 0 and 1, with these derivatives at 1 and none at 0.

    Returns:
        The coefficients of x², x³ for a slope; of x³, x⁴, x⁵ for a slope and a curvature, last.
    """
    if curvature is None:
        # s (x³ − x²)
        return np.stack([-slope, slope], axis=-1)
    # x³ (s (x − 1) + c (x − 1)²), whose curvature at 1 is 6 s + 2 c.
    c = curvature / 2 - 3 * slope
    cubic = c - slope
    quartic = slope - 2 * c
    return np.stack([cubic, quartic, c], axis=-1)


def _rows(factors: Array, lowest_power: int) -> Array:
    """Return factors `(…, n)` of powers of x, lowest first, in the order of `Trajectory`."""
    lowest_first = np.moveaxis(factors, -1, 0)
    highest_first = lowest_first[::-1]
    lower_powers = np.zeros((lowest_power, *highest_first.shape[1:]))
    return np.concatenate([highest_first, lower_powers])


# --- position limits ---

# A waypoint closer to a limit than this, relative to the joint's largest displacement, is on it.
ON_LIMIT_RTOL = 1e-11
EXCESS_RTOL = 1e-10  # largest gain of duration by an excess over a position limit, relative
MAX_MIXTURES = 64  # the share at least doubles each time, from a unit in the last place to 1
# Polynomials from 0 to 1, and from 0 to 1 and back, in powers of σ from σ³; both begin and end at
# rest.
_STEP = np.array([10.0, -15.0, 6.0, 0.0])
_BUMP = 64 * np.array([1.0, -3.0, 3.0, -1.0])
_BUMP_CURVATURE = 24.0


def _within_position_limits(problem: Problem, layout: _Layout, coefficients: Array) -> Array:
    """Return the coefficients of a motion within its position limits; NaN where there is none.

    First, at a waypoint on a limit the joint turns: its velocity becomes zero, and it does not
    accelerate outwards. An end at which the joint is to move stays as it is. Then the motion `q` of
    each joint is mixed with a motion `r` that is inside and rests at every inner waypoint, to
    `(1 − λ) q + λ r`, with about the least `λ` that brings all of it inside.
    """
    side = _sides(problem, layout)
    share = np.zeros(problem.joints)
    turning = np.where(_given(problem, layout), 0.0, side)
    if turning.any():
        turn = _turned_at_limits(layout, coefficients, turning)
        coefficients = polynomials.plus(coefficients, turn)
    mixed = coefficients
    excess = _allowed_excess(problem, layout, side)
    for _ in range(MAX_MIXTURES):
        needed = _needed_share(problem, layout, mixed, side, excess)
        if not needed.any():
            return mixed
        resting = _resting(problem, layout, side)
        towards_rest = polynomials.plus(resting, -coefficients)
        left = 1 - share
        more = np.maximum(2 * share, share + left * needed)
        share = np.where(needed > 0, more, share)
        share = np.minimum(share, 1.0)
        added = share * towards_rest
        mixed = polynomials.plus(coefficients, added)
    return np.full_like(mixed, np.nan)


def _sides(problem: Problem, layout: _Layout) -> Array:
    """Return 1 for a waypoint on the upper limit, −1 on the lower, else 0.

    `(segments + 1, joints)`.
    """
    low, high = problem.limits.position.T
    waypoints = layout.waypoints
    near = ON_LIMIT_RTOL * problem.largest_displacements
    above = high - waypoints <= near
    below = waypoints - low <= near
    return above.astype(float) - below


def _given(problem: Problem, layout: _Layout) -> Bools:
    """Return where a joint is to move at an end of the motion, `(segments + 1, joints)`."""
    found = np.zeros(layout.waypoints.shape, dtype=bool)
    for row, state in ((0, problem.route.start), (-1, problem.route.end)):
        found[row] = np.any(state, axis=0)
    return found


def _allowed_excess(problem: Problem, layout: _Layout, side: Array) -> Array:
    """Return the excess over a position limit that counts as rounding, rad, `(segments, joints)`.

    It gains less than `EXCESS_RTOL` of the duration. Beside a waypoint at the distance `g` from a
    limit an excess `e` gains some `e / sqrt(2 g A)` s. Where the joint turns on the limit, the gain
    is proportional to `e`.
    """
    low, high = problem.limits.position.T
    waypoints = layout.waypoints
    gap = np.minimum(high - waypoints, waypoints - low)
    gainless = EXCESS_RTOL * np.sqrt(gap * problem.largest_displacements)
    allowed = np.where(side != 0, np.inf, gainless)
    of_segment = np.minimum(allowed[:-1], allowed[1:])
    return np.minimum(of_segment, problem.rounding)


def _turned_at_limits(layout: _Layout, coefficients: Array, side: Array) -> Array:
    """Return the polynomials that make the motion turn at every waypoint on a position limit."""
    velocity = polynomials.derivative(coefficients)
    acceleration = polynomials.derivative(velocity)
    leaving = velocity[-1, layout.first]
    at_end = np.zeros_like(leaving[:1])
    velocities = np.concatenate([leaving, at_end])
    slopes = np.where(side == 0, 0.0, -velocities)
    unit = polynomials.stretched(acceleration, layout.trajectory.lengths)
    stops = unit.sum(axis=0)
    last = layout.after - 1
    starts = unit[-1]
    ending = _inwards(stops[last], side[1:])
    starting = _inwards(starts[layout.first], side[:-1])
    growing, dying = _bent(layout, slopes, ending, starting)
    of_pieces = layout.of_pieces
    return _in_time(layout, of_pieces(growing), of_pieces(dying), lowest_power=3)


def _inwards(acceleration: Array, side: Array) -> Array:
    """Return the changes that make an acceleration zero where it leads over the limit."""
    outwards = side * acceleration > 0
    return np.where(outwards, -acceleration, 0.0)


def _resting(problem: Problem, layout: _Layout, side: Array) -> Array:
    """Return a motion within the limits that rests at every waypoint, `(7, pieces, joints)`.

    It is monotone between waypoints. Where two neighbours are on one limit it moves inwards and
    back, as far as half the acceleration limit allows. An end state in motion adds a quintic, which
    may leave the limits.
    """
    limits = problem.limits.in_all_segments()
    low, high = limits.position.T
    sizes = np.abs(limits.acceleration)
    half = sizes.min(axis=1) / 2
    farthest = half * layout.lengths**2 / _BUMP_CURVATURE
    depth = np.minimum(farthest, (high - low) / 2)
    start = side[:-1]
    stays = np.where(start == side[1:], start, 0.0)
    inwards = -stays * depth
    steps = layout.displacements[..., None] * _STEP
    bumps = inwards[..., None] * _BUMP
    growing = layout.of_pieces(steps + bumps)
    dying = np.zeros_like(growing)
    if not problem.route.at_rest:
        ending, starting = _to_ends(problem, layout)
        growing[..., :-1] += layout.of_pieces(ending)
        dying[..., :-1] += layout.of_pieces(starting)
    return _in_time(layout, growing, dying, lowest_power=3)


def _to_ends(problem: Problem, layout: _Layout) -> tuple[Array, Array]:
    """Return powers of `σ` and `1 − σ` that lead from rest to the end states that are asked."""
    start, end = problem.route.start, problem.route.end
    slopes = np.zeros_like(layout.waypoints)
    slopes[0], slopes[-1] = start.velocity, end.velocity
    ending = np.zeros_like(layout.displacements)
    starting = np.zeros_like(layout.displacements)
    starting[0], ending[-1] = start.acceleration, end.acceleration
    return _bent(layout, slopes, ending, starting)


def _needed_share(
    problem: Problem, layout: _Layout, mixed: Array, side: Array, allowed_excess: Array
) -> Array:
    """Return the share `λ` of the resting motion that each joint still needs, `(joints,)`."""
    needed = np.zeros(problem.joints)
    for some in _parts(layout):
        needed[some] = _needed_by(some, problem, layout, mixed[..., some], side, allowed_excess)
    return np.clip(needed, 0.0, 1.0)


def _needed_by(
    some: slice,
    problem: Problem,
    layout: _Layout,
    mixed: Array,
    side: Array,
    allowed_excess: Array,
) -> Array:
    """Return the share that some joints need, whose motion is `mixed`."""
    lengths = layout.trajectory.lengths
    low, high = problem.limits.position[some].T
    first = layout.waypoints[:-1, some]
    blocks = list(layout.blocks())
    units = (polynomials.stretched(mixed[:, own], lengths[own]) for own in blocks)
    # The rounding of the whole segment counts: a piece starts where the pieces before it end.
    of_each = np.concatenate([polynomials.evaluation_rounding(unit) for unit in units])
    largest = np.maximum.reduceat(of_each, layout.first)
    rounding = np.maximum(largest, allowed_excess[:, some])
    may_leave = np.empty(mixed.shape[1:], dtype=bool)
    for own in blocks:
        controls = polynomials.bernstein(polynomials.stretched(mixed[:, own], lengths[own]))
        beyond = layout.of_pieces(rounding, own)
        origins = layout.of_pieces(first, own)
        above = controls.max(axis=0) > high - origins + beyond
        below = controls.min(axis=0) < low - origins - beyond
        may_leave[own] = above | below
    needed = np.zeros(mixed.shape[2])
    if not may_leave.any():
        return needed
    where = np.nonzero(may_leave)
    pieces, joints = where
    origins = layout.of_pieces(first)[where]
    lowest, highest = low[joints] - origins, high[joints] - origins
    allowed = layout.of_pieces(rounding)[where]
    unit = polynomials.stretched(mixed, lengths)
    candidates = unit[:, pieces, joints]
    points = polynomials.critical_points(candidates)
    values = polynomials.evaluate(candidates[:, None], points)
    resting = _resting(problem, layout, side)
    unit_rest = polynomials.stretched(resting, lengths)
    rest = unit_rest[:, pieces, some.start + joints]
    at_rest = polynomials.evaluate(rest[:, None], points)
    inside = np.clip(values, lowest, highest)
    beyond = values - inside
    outside = np.abs(beyond) > allowed
    # (1 − share) value + share at_rest = inside
    ratio = beyond / (values - at_rest)
    share = np.where(outside, ratio, 0.0)
    np.maximum.at(needed, joints, share.max(axis=0))
    return needed
