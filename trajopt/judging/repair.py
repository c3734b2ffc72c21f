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

A long motion, such as a log's, is repaired joint by joint (`_each_joint`), and may be judged so
(`by_joint`): the repaired motion, as large as the given one, is then never whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, reduce
from operator import or_
from typing import TypeVar

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.trajectory import Trajectory, nearest
from trajopt.judging.passing import misses

T = TypeVar("T")

# A correction that uses a smaller share of every limit is left out. All corrections that are left
# out change the certified duration by no more than this share.
NEGLIGIBLE_USE = 1e-12
SURE = 0.9  # of what is negligible: a bound below it is no matter of rounding
UNEVEN = 1e4  # most times that a segment takes another's time, for that bound
MAX_PASSES = 2  # the second pass repairs the rounding of large corrections
# Attempts to miss some waypoints by no more than rounding; then the motion is to meet all of them.
MAX_ATTEMPTS = 8
_MOST_CELLS = 200_000  # pieces times joints; a longer motion is repaired joint by joint,
_BLOCK = 20_000  # and corrected so many pieces at once
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


def _is_long(trajectory: Trajectory) -> bool:
    """Return whether a motion is repaired joint by joint."""
    return len(trajectory.lengths) * trajectory.joints > _MOST_CELLS


def is_by_joint(problem: Problem, trajectory: Trajectory) -> bool:
    """Return whether `by_joint` repairs a motion: it is long, and meets every waypoint."""
    return _is_long(trajectory) and not spared(problem.merged()[0]).any()


def by_joint(
    problem: Problem, trajectory: Trajectory, judge: Callable[[int, Trajectory], T]
) -> list[T] | None:
    """Repair the joints one after the other, and return what `judge` says of each.

    Each joint moves as in the motion that `repaired` returns, of which never more is in memory.

    Args:
        problem: of as many joints and waypoints as the trajectory has.
        trajectory: one for which `is_by_joint` is true.
        judge: takes the joint's number and its motion. It may be asked twice of a joint; then the
            second answer counts.

    Returns:
        The judgements; None where repair is impossible.
    """
    merged, index, motion = _merged(problem, trajectory)

    def judged(joint: int, own: Trajectory) -> T:
        return judge(joint, own.with_coefficients(own.coefficients, own.waypoint_times[index]))

    met = np.full(len(merged.waypoints), True)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _each_joint(_Asked.of(merged), motion, met, judged)


def is_repairable(problem: Problem, trajectory: Trajectory) -> bool:
    """Return whether no two different waypoints are at one instant.

    A motion without position limits can then be repaired, unless its numbers overflow.
    """
    merged, _, motion = _merged(problem, trajectory)
    return _between(merged.waypoints, motion, ~spared(merged)) is not None


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
    asked, missed = _Asked.of(problem), spared(problem)
    for _ in range(MAX_ATTEMPTS):
        motion = _of_all_joints(asked, trajectory, ~missed)
        if motion is None or not missed.any():
            return motion
        passes = misses(problem, motion) <= 1
        if passes[missed].all():
            return motion
        missed &= passes
    return _of_all_joints(asked, trajectory, np.full_like(missed, True))


def _of_all_joints(asked: _Asked, trajectory: Trajectory, met: Bools) -> Trajectory | None:
    """Return the repaired motion that meets the chosen waypoints, `(waypoints,)`."""
    if not _is_long(trajectory):
        found = _repaired(asked, trajectory, met)
        return None if found is None else found[0]
    joints = trajectory.joints
    whole = np.zeros((0, 0, joints))

    def keep(joint: int, motion: Trajectory) -> Trajectory:
        nonlocal whole
        rows, pieces, _ = motion.coefficients.shape
        if len(whole) < rows:
            more = np.zeros((rows - len(whole), pieces, joints))
            whole = np.concatenate([more, whole]) if len(whole) else more
        whole[-rows:, :, joint] = motion.coefficients[..., 0]
        return motion.with_coefficients(np.zeros((rows, pieces, 0)), motion.waypoint_times)

    motions = _each_joint(asked, trajectory, met, keep)
    return motions[0].with_coefficients(whole, motions[0].waypoint_times) if motions else None


@dataclass(frozen=True)
class _Common:
    """What is the same for all joints of a repaired motion.

    Attributes:
        rows: number of a polynomial's coefficients.
        corrected: the corrections that are made in each pass, by the highest derivative that they
            make continuous. If one joint needs such a correction, all joints of this order get one.
    """

    rows: int = 0
    corrected: tuple[frozenset[int], ...] = (frozenset(),) * MAX_PASSES

    def __or__(self, other: _Common) -> _Common:
        passes = zip(self.corrected, other.corrected, strict=True)
        corrected = tuple(ours | theirs for ours, theirs in passes)
        return _Common(max(self.rows, other.rows), corrected)

    def of_order(self, order: int) -> _Common:
        """Return what of it concerns a joint whose corrections are of this order."""
        return replace(self, corrected=tuple(own & {order} for own in self.corrected))


def _each_joint(
    asked: _Asked, trajectory: Trajectory, met: Bools, judge: Callable[[int, Trajectory], T]
) -> list[T] | None:
    """Return what `judge` says of each joint of the repaired motion; None where there is none.

    A joint's repair depends on the other joints in two ways (`_Common`). So each joint is first
    repaired as if it were alone. If another joint then needed more corrections, or a higher degree,
    this one is repaired with as many, and judged again.
    """
    orders = np.where(asked.smooth >= 2, 2, 1).tolist()
    found: dict[int, T] = {}
    made: dict[int, _Common] = {}
    common = _Common()
    while True:
        left = [
            joint for joint, order in enumerate(orders) if made.get(joint) != common.of_order(order)
        ]
        if not left:
            return [found[joint] for joint in range(trajectory.joints)]
        for joint in left:
            some = slice(joint, joint + 1)
            given = trajectory.with_coefficients(
                trajectory.coefficients[..., some], trajectory.waypoint_times
            )
            repair = _repaired(asked.only(some), given, met, common)
            if repair is None:
                return None
            motion, made[joint] = repair
            found[joint] = judge(joint, motion)
        common = reduce(or_, made.values())


def _repaired(
    asked: _Asked, trajectory: Trajectory, met: Bools, common: _Common = _Common()
) -> tuple[Trajectory, _Common] | None:
    """Return the repaired motion of these joints, and the corrections and the degree that it has.

    These are at least those of `common`.
    """
    motion = trajectory
    corrected = []
    for least in common.corrected:
        layout = _layout(asked, motion, met)
        if layout is None:
            return None
        rebased, missed = _rebased(layout, anew=motion is trajectory)
        coefficients, orders = _corrected(asked, layout, rebased, missed, least)
        del rebased
        if not all(np.isfinite(row).all() for row in coefficients):
            return None
        # positions counted from the segment's first waypoint
        coefficients[-1] += layout.of_pieces(layout.waypoints[:-1])
        times = layout.trajectory.breaks[layout.waypoint_breaks]
        motion = layout.trajectory.with_coefficients(coefficients, times)
        corrected.append(orders)
        if not orders:
            break
    missing = common.rows - len(motion.coefficients)
    if missing > 0:
        zeros = np.zeros((missing, *motion.coefficients.shape[1:]))
        coefficients = np.concatenate([zeros, motion.coefficients])
        motion = motion.with_coefficients(coefficients, motion.waypoint_times)
    corrected += [frozenset()] * (MAX_PASSES - len(corrected))
    return motion, _Common(len(motion.coefficients), tuple(corrected))


def _corrected(
    asked: _Asked,
    layout: _Layout,
    coefficients: Array,
    missed: Array,
    least: Collection[int],
) -> tuple[Array, frozenset[int]]:
    """Return the coefficients of a motion without miss, jump, or excess over a position limit.

    Positions are relative to the segment's first waypoint. The array is changed, or replaced where
    it has too few rows.

    Args:
        asked: Its limits and end states.
        layout: of the segments.
        coefficients: as `_rebased` returns them.
        missed: of the segments' ends, rad, `(segments, joints)`.
        least: orders of corrections that are made even if they are negligible.

    Returns:
        The coefficients, and the orders of the corrections that were made.
    """
    made = set()
    bends = asked.smooth >= 2
    for order, joints in ((1, np.flatnonzero(~bends)), (2, np.flatnonzero(bends))):
        if not len(joints):
            continue
        own = asked.only(joints)
        jumps = [_jumps(own, layout, rate, joints) for rate in range(1, order + 1)]
        of_joints = missed[:, joints]
        needed = asked.bounded or order in least
        if not needed and _surely_negligible(own, layout, of_joints, jumps):
            continue
        added = np.zeros((2 * order + 2, *coefficients.shape[1:]))
        for pieces, some in _cancelling(layout, of_joints, jumps):
            needed = needed or not _is_negligible(own, layout, some, pieces)
            added[:, pieces, joints] = some
        if needed:
            made.add(order)
            if len(coefficients) < len(added):
                coefficients = polynomials.plus(coefficients, added)
            else:
                coefficients[-len(added) :] += added
    if asked.bounded:
        coefficients = _within_position_limits(asked, layout, coefficients)
    return coefficients, frozenset(made)


@dataclass(frozen=True)
class _Asked:
    """What a repair must know of the problem. The last axis of every array is that of the joints.

    Attributes:
        waypoints: rad, `(waypoints, joints)`.
        rounding: of a waypoint's coordinate, rad.
        largest: displacement in a segment, rad.
        starts, ends: velocity and acceleration at the start and the end, `(2, joints)`.
        smooth: the highest derivative that may not jump.
        jerk_limited: which joints' jerk is limited.
        low, high: the position limits, rad.
        acceleration: the smaller side of its limit, rad/s².
        negligible: corrections of position … jerk, `(4, joints)`.
        bounded: whether the position of any joint is limited, of the whole problem.
        closed: whether the motion ends in the state in which it begins.
        at_rest: whether it begins and ends at rest.
    """

    waypoints: Array
    rounding: Array
    largest: Array
    starts: Array
    ends: Array
    smooth: Indices
    jerk_limited: Bools
    low: Array
    high: Array
    acceleration: Array
    negligible: Array
    bounded: bool
    closed: bool
    at_rest: bool

    @classmethod
    def of(cls, problem: Problem) -> _Asked:
        route, limits = problem.route, problem.limits.in_all_segments()
        rates = limits.velocity, limits.acceleration, limits.jerk
        sizes = np.array([np.abs(pairs).min(axis=1) for pairs in rates])
        low, high = limits.position.T
        return cls(
            waypoints=problem.waypoints,
            rounding=problem.rounding,
            largest=problem.largest_displacements,
            starts=np.array(route.start),
            ends=np.array(route.end),
            smooth=problem.limits.smooth,
            jerk_limited=problem.limits.jerk_limited,
            low=low,
            high=high,
            acceleration=sizes[1],
            negligible=np.concatenate([problem.rounding[None], NEGLIGIBLE_USE * sizes]),
            bounded=problem.has("position"),
            closed="closed" in route.demands,
            at_rest=route.at_rest,
        )

    def only(self, joints: slice | Indices) -> _Asked:
        """Return the same for some of the joints."""
        found = {key: own[..., joints] for key, own in vars(self).items() if np.ndim(own)}
        return replace(self, **found)


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

    def travel(self) -> Array:
        """Each piece's own displacement, from its velocity alone, rad, `(pieces, joints)`."""
        # the position at a piece's start is not its travel
        motion = self.trajectory
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
        for first in range(0, count, _BLOCK):
            yield slice(first, min(first + _BLOCK, count))

    def of_pieces(self, of_segments: Array, some: slice = slice(None)) -> Array:
        """Repeat values of the segments for each of their pieces, or for some pieces."""
        return of_segments[self.segment[some]]


def _layout(asked: _Asked, trajectory: Trajectory, met: Bools) -> _Layout | None:
    """Return the segments between the waypoints to meet; None if two of these share a break.

    Brief segments are integrated anew.
    """
    layout = _between(asked.waypoints, trajectory, met)
    return layout and _smoothed(layout, asked.jerk_limited)


def _between(waypoints: Array, trajectory: Trajectory, met: Bools) -> _Layout | None:
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
    return _Layout(
        trajectory=refined,
        waypoint_breaks=at,
        segment=np.repeat(segments, pieces),
        first=first,
        after=after,
        waypoints=waypoints[met],
    )


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
    coefficients = layout.trajectory.coefficients
    if anew:
        coefficients = np.array(coefficients)
    else:
        coefficients.setflags(write=True)
    travel = layout.travel()
    missed = _missed(layout, travel)
    # A piece starts where the pieces before it in its segment end.
    within = np.cumsum(travel, axis=0)
    within -= travel
    del travel
    within -= layout.of_pieces(within[layout.first])
    coefficients[-1] = within
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


def _missed(layout: _Layout, travel: Array) -> Array:
    """Return the miss of each segment's last waypoint, rad, `(segments, joints)`.

    `travel` is that of the pieces.
    """
    reached = np.add.reduceat(travel, layout.first)
    return layout.displacements - reached


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


def _is_negligible(asked: _Asked, layout: _Layout, added: Array, pieces: slice) -> bool:
    """Return whether a correction uses no limit, and moves by rounding at most, in some pieces."""
    for order, allowed in enumerate(asked.negligible):
        derivative = polynomials.derivative(added, order)
        unit = polynomials.stretched(derivative, layout.trajectory.lengths[pieces])
        # A polynomial stays within the range of its Bernstein coefficients.
        controls = np.abs(polynomials.bernstein(unit))
        if not (controls <= allowed).all():
            return False
    return True


def _surely_negligible(asked: _Asked, layout: _Layout, missed: Array, jumps: list[Array]) -> bool:
    """Return whether a bound shows that a correction is negligible, without computing it."""
    bound = Corrections(
        first=layout.first,
        lengths=layout.lengths,
        longest=layout.lengths.max(),
        until_end=layout.times_of(slice(None))[1][:, None],
        rate=np.abs(missed / layout.lengths).max(axis=0),
        missed=missed,
        starting=[own[:-1] for own in jumps],
        ending=[own[layout.after] for own in jumps],
    )
    return bool(bound.negligible([*asked.negligible]).all())


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


def _jumps(asked: _Asked, layout: _Layout, order: int, joints: Indices) -> Array:
    """Return the jumps of a derivative of some joints at every break, `(breaks, joints)`.

    Before and after the motion the robot is in the states that are asked. Before a closed motion it
    is in the state of the motion's end. Jumps within brief segments are rounding of the integration
    and count as zero.
    """
    motion = layout.trajectory
    before = asked.starts[order - 1]
    blocks = list(motion.blocks())
    if asked.closed:  # the start takes the state of the end
        before = motion.pieces(order, blocks[-1])[..., joints].sum(axis=0)[-1]
    jumps = np.empty((len(motion.breaks), len(joints)))
    for pieces in blocks:
        unit = motion.pieces(order, pieces)[..., joints]
        own = jumps[pieces]
        own[...] = unit[-1]
        stops = unit.sum(axis=0)
        own[0] -= before
        own[1:] -= stops[:-1]
        before = stops[-1]
    jumps[-1] = 0.0 if asked.closed else asked.ends[order - 1] - before
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


def _within_position_limits(asked: _Asked, layout: _Layout, coefficients: Array) -> Array:
    """Return the coefficients of a motion within its position limits; NaN where there is none.

    First, at a waypoint on a limit the joint turns: its velocity becomes zero, and it does not
    accelerate outwards. An end at which the joint is to move stays as it is. Then the motion `q` of
    each joint is mixed with a motion `r` that is inside and rests at every inner waypoint, to
    `(1 − λ) q + λ r`, with about the least `λ` that brings all of it inside.
    """
    side = _sides(asked, layout)
    share = np.zeros(side.shape[1])
    turning = np.where(_given(asked, layout), 0.0, side)
    if turning.any():
        turn = _turned_at_limits(layout, coefficients, turning)
        coefficients = polynomials.plus(coefficients, turn)
    mixed = coefficients
    excess = _allowed_excess(asked, layout, side)
    for _ in range(MAX_MIXTURES):
        needed = _needed_share(asked, layout, mixed, side, excess)
        if not needed.any():
            return mixed
        resting = _resting(asked, layout, side)
        towards_rest = polynomials.plus(resting, -coefficients)
        left = 1 - share
        more = np.maximum(2 * share, share + left * needed)
        share = np.where(needed > 0, more, share)
        share = np.minimum(share, 1.0)
        added = share * towards_rest
        mixed = polynomials.plus(coefficients, added)
    return np.full_like(mixed, np.nan)


def _sides(asked: _Asked, layout: _Layout) -> Array:
    """Return 1 for a waypoint on the upper limit, −1 on the lower, else 0.

    `(segments + 1, joints)`.
    """
    waypoints = layout.waypoints
    near = ON_LIMIT_RTOL * asked.largest
    above = asked.high - waypoints <= near
    below = waypoints - asked.low <= near
    return above.astype(float) - below


def _given(asked: _Asked, layout: _Layout) -> Bools:
    """Return where a joint is to move at an end of the motion, `(segments + 1, joints)`."""
    found = np.zeros(layout.waypoints.shape, dtype=bool)
    for row, state in ((0, asked.starts), (-1, asked.ends)):
        found[row] = np.any(state, axis=0)
    return found


def _allowed_excess(asked: _Asked, layout: _Layout, side: Array) -> Array:
    """Return the excess over a position limit that counts as rounding, rad, `(segments, joints)`.

    It gains less than `EXCESS_RTOL` of the duration. Beside a waypoint at the distance `g` from a
    limit an excess `e` gains some `e / sqrt(2 g A)` s. Where the joint turns on the limit, the gain
    is proportional to `e`.
    """
    waypoints = layout.waypoints
    gap = np.minimum(asked.high - waypoints, waypoints - asked.low)
    gainless = EXCESS_RTOL * np.sqrt(gap * asked.largest)
    allowed = np.where(side != 0, np.inf, gainless)
    of_segment = np.minimum(allowed[:-1], allowed[1:])
    return np.minimum(of_segment, asked.rounding)


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


def _resting(asked: _Asked, layout: _Layout, side: Array) -> Array:
    """Return a motion within the limits that rests at every waypoint, `(7, pieces, joints)`.

    It is monotone between waypoints. Where two neighbours are on one limit it moves inwards and
    back, as far as half the acceleration limit allows. An end state in motion adds a quintic, which
    may leave the limits.
    """
    half = asked.acceleration / 2
    farthest = half * layout.lengths**2 / _BUMP_CURVATURE
    depth = np.minimum(farthest, (asked.high - asked.low) / 2)
    start = side[:-1]
    stays = np.where(start == side[1:], start, 0.0)
    inwards = -stays * depth
    steps = layout.displacements[..., None] * _STEP
    bumps = inwards[..., None] * _BUMP
    growing = layout.of_pieces(steps + bumps)
    dying = np.zeros_like(growing)
    if not asked.at_rest:
        ending, starting = _to_ends(asked, layout)
        growing[..., :-1] += layout.of_pieces(ending)
        dying[..., :-1] += layout.of_pieces(starting)
    return _in_time(layout, growing, dying, lowest_power=3)


def _to_ends(asked: _Asked, layout: _Layout) -> tuple[Array, Array]:
    """Return powers of `σ` and `1 − σ` that lead from rest to the end states that are asked."""
    slopes = np.zeros_like(layout.waypoints)
    slopes[0], slopes[-1] = asked.starts[0], asked.ends[0]
    ending = np.zeros_like(layout.displacements)
    starting = np.zeros_like(layout.displacements)
    starting[0], ending[-1] = asked.starts[1], asked.ends[1]
    return _bent(layout, slopes, ending, starting)


def _needed_share(
    asked: _Asked, layout: _Layout, mixed: Array, side: Array, allowed_excess: Array
) -> Array:
    """Return the share `λ` of the resting motion that each joint still needs, `(joints,)`."""
    lengths = layout.trajectory.lengths
    first = layout.waypoints[:-1]
    blocks = list(layout.blocks())
    units = (polynomials.stretched(mixed[:, own], lengths[own]) for own in blocks)
    # The rounding of the whole segment counts: a piece starts where the pieces before it end.
    of_each = np.concatenate([polynomials.evaluation_rounding(unit) for unit in units])
    largest = np.maximum.reduceat(of_each, layout.first)
    rounding = np.maximum(largest, allowed_excess)
    may_leave = np.empty(mixed.shape[1:], dtype=bool)
    for own in blocks:
        controls = polynomials.bernstein(polynomials.stretched(mixed[:, own], lengths[own]))
        beyond = layout.of_pieces(rounding, own)
        origins = layout.of_pieces(first, own)
        above = controls.max(axis=0) > asked.high - origins + beyond
        below = controls.min(axis=0) < asked.low - origins - beyond
        may_leave[own] = above | below
    needed = np.zeros(mixed.shape[2])
    if not may_leave.any():
        return needed
    where = np.nonzero(may_leave)
    pieces, joints = where
    origins = layout.of_pieces(first)[where]
    lowest, highest = asked.low[joints] - origins, asked.high[joints] - origins
    allowed = layout.of_pieces(rounding)[where]
    unit = polynomials.stretched(mixed, lengths)
    candidates = unit[:, pieces, joints]
    points = polynomials.critical_points(candidates)
    values = polynomials.evaluate(candidates[:, None], points)
    resting = _resting(asked, layout, side)
    unit_rest = polynomials.stretched(resting, lengths)
    rest = unit_rest[:, pieces, joints]
    at_rest = polynomials.evaluate(rest[:, None], points)
    inside = np.clip(values, lowest, highest)
    beyond = values - inside
    outside = np.abs(beyond) > allowed
    # (1 − share) value + share at_rest = inside
    ratio = beyond / (values - at_rest)
    share = np.where(outside, ratio, 0.0)
    np.maximum.at(needed, joints, share.max(axis=0))
    return np.clip(needed, 0.0, 1.0)
