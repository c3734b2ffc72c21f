"""Motions of jerk-limited joints without slivers (mathematics, section 4).

A motion between two extreme profiles has the breaks of both. Some come to lie 1e-9 to 1e-6 s beside
a waypoint or beside each other: what the duration hardly feels, a solver leaves. With the waypoints
passed when they are, every joint is free for itself, so a sliver is removed where it is, with the
segments around it: one of its knots goes and the other pieces share what it did; or, where limits
do not allow that, it grows until it is none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baselines.exact.jerk_stretch import ROW_TOLERANCE, JointLimits, Stretch, refitted
from baselines.exact.rounded import Pieces, accumulated
from baselines.linear_programs import LinearPrograms
from trajopt.problem import Problem
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

_SLIVER_S = 1e-6
_SLIVER_RTOL = 1e-6  # of the segment
_SLIVER_UNIT_RTOL = 1e-3  # of the mean stop time: where that is brief, so are slivers
_GROWN = (3.0, 1.02)  # times as long as the longest sliver is what one grows to, if it can
_AROUND = (1, 0, 3)  # segments on either side that may help
_AROUND_RAMPS = (1, 0)  # the same where nothing is briefer than `_SLIVER_S`
_PATIENCE = 5  # segments in a row whose ramps its limits need: then the joint needs all of them
_DILATIONS = (1e-12, 3e-10)  # that it may cost, the less the better
_CERTIFIED_RTOL = 1e-9  # what the certified duration may cost, rounding included
_MISS_RTOL = 1e-13


@dataclass(frozen=True)
class Task:
    """What one joint has to do.

    Attributes:
        alone: the problem of this joint.
        passages: when the waypoints are passed, s, `(segments + 1,)`.
        waypoints: where the segments start, rad, `(segments,)`.
        unit: the unit of time, s.
        units: of jerk, acceleration, velocity and position, rad/s^power, `(4,)`.
        h: displacements in these units, `(segments,)`.
        limits: likewise.
    """

    alone: Problem
    passages: Array
    waypoints: Array
    unit: float
    units: Array
    h: Array
    limits: JointLimits

    @property
    def shortest(self) -> Array:
        """What is shorter is a sliver, in each segment, s."""
        by_segment = _SLIVER_RTOL * np.diff(self.passages)
        return np.maximum(self.briefest, by_segment)

    @property
    def briefest(self) -> float:
        """What is shorter is one in any segment, s: else it may be a ramp in a segment of hours."""
        return min(_SLIVER_S, _SLIVER_UNIT_RTOL * self.unit)

    def segments(self, knots: Array) -> Indices:
        """Which segment each piece between the knots belongs to."""
        begun = np.searchsorted(self.passages, knots[:-1], side="right")
        return begun - 1

    def slivers(self, knots: Array) -> Bools:
        """Which pieces are slivers; the only piece of a segment is none."""
        segment = self.segments(knots)
        pieces = np.bincount(segment)
        several = pieces > 1
        brief = np.diff(knots) < self.shortest[segment]
        return np.asarray(brief & several[segment])

    def part(self, first: int, last: int) -> Task:
        """The segments from one waypoint to another."""
        segments = slice(first, last)
        return replace(
            self,
            passages=self.passages[first : last + 1],
            waypoints=self.waypoints[segments],
            h=self.h[segments],
        )


def without_slivers(pieces: Pieces, task: Task) -> Pieces:
    """One joint's motion without the slivers that its limits can do without.

    Args:
        pieces: its breaks, s, with the waypoints among them, and cubics, rad/s^power.
        task: what it does.
    """
    knots, _ = pieces
    if not task.slivers(knots).any():
        return pieces
    mended = _mended(pieces, task)
    longest = _certified(pieces, task) * (1 + _CERTIFIED_RTOL)
    return mended if _certified(mended, task) <= longest else pieces


def _certified(pieces: Pieces, task: Task) -> float:
    """The certified duration of the joint alone, s; infinite without."""
    trajectory = Trajectory.joined([pieces], task.passages)
    duration = verify(task.alone, trajectory).certified_duration
    return np.inf if duration is None else duration


def _first_pieces(segment: Indices) -> Indices:
    """Which pieces begin a segment."""
    begins = np.diff(segment, prepend=-1) > 0
    return np.flatnonzero(begins)


def _mended(pieces: Pieces, task: Task) -> Pieces:
    """The motion without slivers, but for those that its limits need."""
    programs = LinearPrograms(ROW_TOLERANCE)
    tried = np.zeros(len(task.h), dtype=bool)
    in_vain = 0
    while True:
        knots, _ = pieces
        segment = task.segments(knots)
        is_sliver = task.slivers(knots)
        left = segment[is_sliver & ~tried[segment]]
        if not left.size:
            return pieces
        first = int(left[0])
        tried[first] = True
        own_lengths = np.diff(knots)[segment == first]
        is_ramp = own_lengths.min() >= task.briefest
        if is_ramp and in_vain == _PATIENCE:
            continue
        around = _AROUND_RAMPS if is_ramp else _AROUND
        mended = _mended_segment(
            programs,
            pieces,
            task,
            first,
            around,
        )
        if mended is not None:
            pieces = mended
            in_vain = 0
        elif is_ramp:
            in_vain += 1


def _mended_segment(
    programs: LinearPrograms,
    pieces: Pieces,
    task: Task,
    segment: int,
    around: Sequence[int],
) -> Pieces | None:
    """The motion without this segment's slivers; None where limits need them."""
    for window in _windows(pieces, task, segment, around):
        for start, shortest in window.starts():
            for dilation in _DILATIONS:
                mended = window.mended(
                    programs,
                    start,
                    shortest,
                    dilation,
                )
                if mended is not None:
                    return mended
    return None


def _windows(
    pieces: Pieces,
    task: Task,
    segment: int,
    around: Sequence[int],
) -> Iterator[_Window]:
    """So many segments on either side of one, and it."""
    tried = set()
    for count in around:
        first = max(segment - count, 0)
        last = min(segment + count + 1, len(task.h))
        if (first, last) in tried:
            continue
        tried.add((first, last))
        yield _Window(
            pieces,
            task,
            first,
            last,
        )


class _Window:
    """The part of a motion from one waypoint to another."""

    def __init__(
        self,
        pieces: Pieces,
        task: Task,
        first: int,
        last: int,
    ) -> None:
        self._task = task.part(first, last)
        knots, cubics = pieces
        start, end = task.passages[[first, last]]
        begin = np.searchsorted(knots, start)
        finish = np.searchsorted(knots, end)
        self._before = (knots[:begin], cubics[:, :begin])
        self._after = (knots[finish + 1 :], cubics[:, finish:])
        inside = slice(begin, finish + 1)
        self._knots = knots[inside]
        # at rest in the end
        at_knots = np.pad(cubics, ((0, 0), (0, 1)))
        _, acceleration, velocity, _ = at_knots[:, inside] / task.units[:, None]
        self._acceleration = 2 * acceleration
        self._velocity = velocity

    def starts(self) -> Iterator[tuple[Stretch, Array]]:
        """Motions to start from, and how long their pieces shall be at least, in units."""
        fewer = self._stretch(self._without_slivers())
        shortest = self._shortest(fewer, min(_GROWN))
        yield fewer, np.minimum(shortest, fewer.lengths)
        same = self._stretch(self._all_knots())
        for grown in _GROWN:
            yield same, self._shortest(same, grown)

    def _all_knots(self) -> Bools:
        """Every knot is kept."""
        return np.ones(len(self._knots), dtype=bool)

    def _without_slivers(self) -> Bools:
        """Which knots are kept: one of each sliver's goes, the briefest first; waypoints stay."""
        kept = self._all_knots()
        is_waypoint = np.isin(self._knots, self._task.passages)
        while True:
            at = np.flatnonzero(kept)
            knots = self._knots[at]
            is_sliver = self._task.slivers(knots)
            if not is_sliver.any():
                return kept
            lengths = np.diff(knots)
            lengths[~is_sliver] = np.inf
            briefest = lengths.argmin()
            left, right = at[briefest : briefest + 2]
            goes = left if is_waypoint[right] else right
            kept[goes] = False

    def mended(
        self,
        programs: LinearPrograms,
        start: Stretch,
        shortest: Array,
        dilation: float,
    ) -> Pieces | None:
        """The whole motion, within limits but for a dilation, with one near `start` inside."""
        limits = self._task.limits
        found = refitted(
            programs,
            start,
            limits.widened(1 + dilation),
            shortest,
            self._rounded,
        )
        if found is None:
            return None
        before = self._stretch(self._all_knots())
        missed = found.missed() > max(_MISS_RTOL, before.missed())
        slow = found.dilation(limits) > 1 + _CERTIFIED_RTOL
        if missed or slow:
            return None
        return self._with(found)

    def _stretch(self, kept: Bools) -> Stretch:
        """The motion between some of the knots."""
        left = self._knots[kept]
        return Stretch(
            np.diff(left) / self._task.unit,
            self._acceleration[kept],
            ends=(self._velocity[0], self._velocity[-1]),
            segment=self._task.segments(left),
            h=self._task.h,
        )

    def _shortest(self, stretch: Stretch, grown: float) -> Array:
        """Times as long as the longest sliver, or half of the mean where there is hardly time."""
        task = self._task
        longest_sliver = task.shortest / task.unit
        by_segment = grown * longest_sliver
        shortest = by_segment[stretch.segment]
        pieces = np.bincount(stretch.segment)
        half = stretch.times / pieces / 2
        return np.asarray(np.minimum(shortest, half[stretch.segment]))

    def _rounded(self, stretch: Stretch) -> Stretch:
        """The same with lengths between stored breaks."""
        breaks = self._breaks(stretch)
        lengths = np.diff(breaks) / self._task.unit
        return replace(stretch, lengths=lengths)

    def _breaks(self, stretch: Stretch) -> Array:
        """When its pieces begin and end, as a trajectory stores it, s."""
        passages = self._task.passages
        ends = np.cumsum(stretch.lengths)
        since_start = np.r_[0.0, ends]
        times: Array = passages[0] + since_start * self._task.unit
        first = _first_pieces(stretch.segment)
        times[first] = passages[:-1]
        times[-1] = passages[-1]
        return times

    def _with(self, stretch: Stretch) -> Pieces:
        """The whole motion with this one inside."""
        earlier, cubics_before = self._before
        later, cubics_after = self._after
        breaks = self._breaks(stretch)
        knots = np.concatenate([earlier, breaks, later])
        cubics = [cubics_before, self._cubics(stretch), cubics_after]
        return knots, np.hstack(cubics)

    def _cubics(self, stretch: Stretch) -> Array:
        """The motion's pieces, rad/s^power."""
        t = stretch.lengths
        a = stretch.acceleration[:-1]
        b = stretch.acceleration[1:]
        v = stretch.velocity[:-1]
        jerk = (b - a) / t
        # x = t (v + t (2a + b)/6), from every waypoint anew
        mean = v + t * (2 * a + b) / 6
        position = accumulated(0.0, t * mean)
        first = _first_pieces(stretch.segment)
        passed = position[first]
        position -= passed[stretch.segment]
        cubic = jerk / 6
        square = a / 2
        cubics = np.stack([cubic, square, v, position])
        cubics *= self._task.units[:, None]
        waypoints = self._task.waypoints[stretch.segment]
        cubics[-1] += waypoints
        return cubics
