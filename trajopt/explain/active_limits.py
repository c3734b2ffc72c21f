"""Which limit of which joint is active, when, and what relaxing it would save."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.limits import KINDS, Interval
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import certified, verify
from trajopt.planners.planner import Planner

# Fraction of a limit from which on it is active.
ACTIVE_SHARE = 0.99
# Fraction by which a limit is widened to measure the saving.
RELAXED_SHARE = 0.01
# Intervals closer than this are joined, relative to the duration.
_JOINED_RTOL = 0.01
# Precision of a saving, relative to the duration.
_SAVING_RTOL = 1e-6


@dataclass(frozen=True)
class ActiveLimit:
    """An interval of time in which a joint is within 1 % of a limit, for a position of its range.

    Attributes:
        joint: From 0; None where the limit is not one joint's.
        limit: The kind of limit, by its key.
        start, end: s. Interruptions shorter than 1 % of the duration are left out.
        saving: The time saved, s, if that limit of that joint is 1 % wider (a position limit: by
            1 % of the range). All intervals of one limit have the same saving. None where the
            relaxed problem has no answer.
        segment: Index of the segment with this limit; None where all segments have the same.
    """

    joint: int | None
    limit: str
    start: float
    end: float
    saving: float | None
    segment: int | None = None


class Stretch(NamedTuple):
    """An interval in which a limit is active: joint (from 0) or None, limit, start and end, s."""

    joint: int | None
    limit: str
    start: float
    end: float


def active_limits(
    problem: Problem, trajectory: Trajectory, solver: Planner | None
) -> tuple[ActiveLimit, ...]:
    """Return all intervals at a limit, those of the limits with the largest savings first.

    `solver` solves the problem again with each limit relaxed. Without one the trajectory is dilated
    to the relaxed limits; where a demand forbids that, as a velocity at an end, no saving is known.
    """
    found = list(stretches(problem, trajectory))
    if not found:
        return ()
    before = _duration(problem, trajectory, solver)
    savings: dict[tuple[int | None, str, int | None], float | None] = {}
    rows = []
    for stretch in found:
        joint, limit, start, end = stretch
        segment = _segment(problem, trajectory, limit, start, end)
        own = (joint, limit, segment)
        if own not in savings:
            wider = relaxed(problem, joint, limit, segment=segment)
            after = _duration(wider, trajectory, solver)
            savings[own] = None if before is None or after is None else before - after
        rows.append(ActiveLimit(*stretch, savings[own], segment))
    return tuple(sorted(rows, key=_largest_saving_first))


def _largest_saving_first(row: ActiveLimit) -> tuple[float, int, float]:
    return (-(row.saving or 0.0), -1 if row.joint is None else row.joint, row.start)


def scattered(rows: tuple[ActiveLimit, ...], duration: float, *, dilatable: bool = True) -> bool:
    """Return whether the savings contradict each other, so that they are a solver's scatter.

    A wider limit cannot cost time. If all limits of degree `n` are multiplied by `c ** n`, an
    optimum is divided by `c`, so a single limit cannot save more than that, if the problem is
    `dilatable`. Between given velocities it can: it may open a time before a gap.
    """
    slack = _SAVING_RTOL * duration
    for row in rows:
        if row.saving is None:
            continue
        highest = duration
        if dilatable:
            highest *= _highest_saving(row.limit)
        if not -slack <= row.saving <= highest + slack:
            return True
    return False


def _highest_saving(limit: str) -> float:
    """Return the largest share of the duration that one relaxed limit can save (section 6)."""
    degree = KINDS[limit].degree
    if degree is None:
        return 1.0
    c = float((1 + RELAXED_SHARE) ** (1 / degree))
    return 1 - 1 / c


def _duration(problem: Problem, trajectory: Trajectory, solver: Planner | None) -> float | None:
    """Return the solver's duration, or that of the trajectory dilated to the limits, s.

    None where there is neither: no motion, or one that may not be dilated.
    """
    if solver is None:
        if not problem.route.dilatable:
            return None
        return verify(problem, trajectory).dilation * trajectory.duration
    answer = solver.solve(problem).trajectory
    if answer is None:
        return None
    judged = certified(problem, answer)
    if judged is None:
        return None
    return judged.duration


def stretches(
    problem: Problem,
    trajectory: Trajectory,
    active: float = ACTIVE_SHARE,
    joined: float = _JOINED_RTOL,
) -> Iterator[Stretch]:
    """Yield every interval with at least `active` of a limit in use, by limit, joint and segment.

    Interruptions shorter than `joined` times the duration are left out.
    """
    slack = joined * trajectory.duration
    for key, limit in problem.limits.kinds.items():
        found: dict[tuple[int, int], list[Interval]] = {}
        for interval in limit.active(trajectory, active):
            segment = _segment(problem, trajectory, key, interval.start, interval.end)
            own = (_number(interval.joint), _number(segment))
            found.setdefault(own, []).append(interval)
        for own in sorted(found):
            starts = np.array([interval.start for interval in found[own]])
            ends = np.array([interval.end for interval in found[own]])
            for start, end in joined_intervals(starts, ends, slack):
                yield Stretch(found[own][0].joint, key, start, end)


class Hold(NamedTuple):
    """A limit that a motion is at: its longest interval there, and the share of all time."""

    longest: Stretch
    share: float


def holds(problem: Problem, trajectory: Trajectory) -> list[Hold]:
    """Return the limits of a motion that it is at, those that it is at for longest first."""
    found: dict[tuple[str, int | None], list[Stretch]] = {}
    for stretch in stretches(problem, trajectory):
        found.setdefault((stretch.limit, stretch.joint), []).append(stretch)
    every = []
    for own in found.values():
        total = sum(stretch.end - stretch.start for stretch in own)
        longest = max(own, key=lambda stretch: stretch.end - stretch.start)
        every.append(Hold(longest, total / trajectory.duration))
    return sorted(every, key=lambda own: -own.share)


def _number(place: int | None) -> int:
    """Return a joint or segment as a number to sort by; None comes first."""
    return -1 if place is None else place


def _segment(
    problem: Problem, trajectory: Trajectory, limit: str, start: float, end: float
) -> int | None:
    """Return the segment (from 0) whose limit is active; None where all segments have the same."""
    if problem.limits.kinds[limit].segments is None:
        return None
    return int(trajectory.segments_at((start + end) / 2))


def relaxed(
    problem: Problem,
    joint: int | None,
    limit: str,
    by: float = RELAXED_SHARE,
    segment: int | None = None,
) -> Problem:
    """Return the problem with one limit of one joint wider by a fraction (of a position range).

    `segment` (from 0) widens it in one segment only, where segments differ.
    """
    wider = problem.limits.widened(limit, joint, by, segment)
    return replace(problem, limits=wider)


def share_at_limits(
    problem: Problem, trajectory: Trajectory, active: float = ACTIVE_SHARE
) -> float:
    """Return the fraction of time in which a joint is at a limit of its motion (not position)."""
    found = stretches(problem, trajectory, active, joined=0.0)
    motion = [stretch for stretch in found if KINDS[stretch.limit].is_ratio]
    start = np.array([stretch.start for stretch in motion])
    end = np.array([stretch.end for stretch in motion])
    joined = joined_intervals(start, end)
    lengths = [b - a for a, b in joined]
    return sum(lengths) / trajectory.duration


def joined_intervals(start: Array, end: Array, slack: float = 0.0) -> Iterator[tuple[float, float]]:
    """Yield intervals in order; those that overlap or are at most `slack` apart are joined."""
    if len(start) == 0:
        return
    order = np.argsort(start)
    start = start[order]
    furthest = np.maximum.accumulate(end[order])
    apart = start[1:] > furthest[:-1] + slack
    begins = np.concatenate([[True], apart])
    ends = np.concatenate([apart, [True]])
    first = np.flatnonzero(begins)
    last = np.flatnonzero(ends)
    for a, b in zip(first, last, strict=True):
        yield float(start[a]), float(furthest[b])
