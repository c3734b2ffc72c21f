"""Which limit of which joint is active, when, and what relaxing it would save."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.problem import LIMIT_ORDERS, LimitName, Limits, Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import certified, verify
from trajopt.planners.planner import Planner

Array = NDArray[np.float64]

ACTIVE_SHARE = 0.99  # of a limit: from there on it counts as reached
RELAXED_SHARE = 0.01  # by which a limit is widened to see what that saves
_JOINED_SHARE = 0.01  # of the duration: stretches closer than this are one
_SAVING_RTOL = 1e-6  # of the duration: how precisely two answers of one planner compare


@dataclass(frozen=True)
class ActiveLimit:
    """A stretch of time in which a joint is within 1 % of a limit (of position: of its range).

    `joint` counts from 0; `start` and `end` in seconds, interruptions shorter than 1 % of the
    duration passed over. `saving` is the limit's sensitivity: what relaxing that limit of that
    joint by 1 % (a position limit: by 1 % of the range) saves in all, s, so it is the same in every
    stretch of one limit; None where there is no answer to the relaxed problem.
    """

    joint: int
    limit: LimitName
    start: float
    end: float
    saving: float | None


class Stretch(NamedTuple):
    """A joint (from 0), a limit, and from when to when it is active, s."""

    joint: int
    limit: LimitName
    start: float
    end: float


def active_limits(
    problem: Problem,
    trajectory: Trajectory,
    solver: Planner | None,
) -> tuple[ActiveLimit, ...]:
    """All stretches at a limit, those of the limits with the largest savings first.

    `solver` solves the problem again with each limit relaxed; without one, the trajectory keeps its
    path and its timing but for one factor, and is dilated to the relaxed limits.
    """
    found = list(stretches(problem, trajectory))
    if not found:
        return ()
    before = _duration(problem, trajectory, solver)
    savings: dict[tuple[int, LimitName], float | None] = {}
    for joint, limit, _, _ in found:
        if (joint, limit) in savings:
            continue
        after = _duration(relaxed(problem, joint, limit), trajectory, solver)
        if before is None or after is None:
            savings[joint, limit] = None
        else:
            savings[joint, limit] = before - after
    rows = [ActiveLimit(*stretch, savings[stretch[:2]]) for stretch in found]
    return tuple(sorted(rows, key=_largest_saving_first))


def _largest_saving_first(row: ActiveLimit) -> tuple[float, int, float]:
    return (-(row.saving or 0.0), row.joint, row.start)


def scattered(rows: tuple[ActiveLimit, ...], duration: float) -> bool:
    """Whether some saving is none that an optimum can have: it is the solver's own scatter.

    Wider limits cannot cost time; and as velocity limits times `c`, acceleration limits times `c²`
    and jerk limits times `c³` divide an optimum by `c`, one of them alone cannot save more.
    """
    slack = _SAVING_RTOL * duration
    for row in rows:
        if row.saving is None:
            continue
        highest = _highest_saving(row.limit) * duration
        if not -slack <= row.saving <= highest + slack:
            return True
    return False


def _highest_saving(limit: LimitName) -> float:
    """The share of an optimum's duration that one relaxed limit can save (section 6)."""
    order = LIMIT_ORDERS[limit]
    if order == 0:
        return 1.0
    c = float((1 + RELAXED_SHARE) ** (1 / order))
    return 1 - 1 / c


def _duration(
    problem: Problem,
    trajectory: Trajectory,
    solver: Planner | None,
) -> float | None:
    """What the solver takes, or the trajectory dilated (or sped up) to the limits, s."""
    if solver is None:
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
    joined: float = _JOINED_SHARE,
) -> Iterator[Stretch]:
    """Every stretch with at least `active` of a limit in use, by limit and joint.

    Interruptions shorter than `joined` times the duration are passed over.
    """
    for limit in LIMIT_ORDERS:
        crossings = _crossings(problem, trajectory, limit, active)
        for joint in range(problem.joints):
            own = crossings.joint == joint
            intervals = joined_intervals(
                crossings.start[own],
                crossings.end[own],
                slack=joined * trajectory.duration,
            )
            for start, end in intervals:
                yield Stretch(joint, limit, start, end)


def relaxed(
    problem: Problem,
    joint: int,
    limit: LimitName,
    by: float = RELAXED_SHARE,
) -> Problem:
    """The problem with one limit of one joint wider by a share; a position limit by its range."""
    limits = {name: pairs.copy() for name, pairs in problem.limits.by_name().items()}
    pair = limits[limit][joint]
    low, high = pair
    size = pair.copy()
    if limit == "position":
        size = np.array([low - high, high - low])
    pair += by * size
    return Problem(problem.waypoints, Limits(**limits), problem.name)


def share_at_limits(
    problem: Problem,
    trajectory: Trajectory,
    active: float = ACTIVE_SHARE,
) -> float:
    """The share of its time in which at least one joint is at a limit of motion."""
    found = stretches(problem, trajectory, active, joined=0.0)
    motion = [stretch for stretch in found if stretch.limit != "position"]
    start = np.array([stretch.start for stretch in motion])
    end = np.array([stretch.end for stretch in motion])
    joined = joined_intervals(start, end)
    lengths = [b - a for a, b in joined]
    return sum(lengths) / trajectory.duration


class _Crossings(NamedTuple):
    """Per interval at a limit: the joint, start and end, s."""

    joint: NDArray[np.intp]
    start: Array
    end: Array


def _crossings(
    problem: Problem,
    trajectory: Trajectory,
    limit: LimitName,
    active: float,
) -> _Crossings:
    """Where a limit is in use, piece by piece."""
    unit = trajectory.pieces(LIMIT_ORDERS[limit])
    sides = [_excess(unit, side, active) for side in _sides(problem, limit)]
    # Polynomials (degree + 1, side, piece, joint), positive where the limit is in use.
    excess = np.stack(sides, axis=1)
    # Between neighbouring roots the sign is the middle's.
    flat = excess.reshape(len(excess), -1)
    roots = polynomials.unit_roots(flat)
    roots = roots.reshape(-1, *excess.shape[1:])
    zero = np.zeros_like(excess[:1])
    knots = np.concatenate([zero, np.nan_to_num(roots, nan=1.0), zero + 1.0])
    knots = np.sort(knots, axis=0)
    left = knots[:-1]
    right = knots[1:]
    middle = 0.5 * (left + right)
    above = polynomials.evaluate(excess[:, None], middle) > 0
    index = np.nonzero(above & (right > left))
    _, _, piece, joint = index
    at = trajectory.breaks[piece]
    length = trajectory.lengths[piece]
    return _Crossings(
        joint,
        start=at + left[index] * length,
        end=at + right[index] * length,
    )


class _Side(NamedTuple):
    """One side of a limit, `(joints,)`: where its use is counted from, and where it is 1."""

    zero: Array
    full: Array


def _sides(problem: Problem, limit: LimitName) -> tuple[_Side, _Side]:
    low, high = problem.limits.by_name()[limit].T
    if limit == "position":
        return _Side(zero=high, full=low), _Side(zero=low, full=high)
    nothing = np.zeros_like(low)
    return _Side(nothing, low), _Side(nothing, high)


def _excess(unit: Array, side: _Side, active: float) -> Array:
    """Polynomials that are positive where more than `active` of a side is in use."""
    zero, full = side
    endless = ~np.isfinite(full - zero)
    origin = np.where(endless, 0.0, zero)
    scale = np.where(endless, 1.0, full - zero)
    # (p − zero) / (full − zero) − active
    shifted = np.array(unit)
    shifted[-1] -= origin
    excess = shifted / scale
    excess[-1] -= active
    # What has no limit is never there.
    excess[:, :, endless] = 0.0
    excess[-1][:, endless] = -active
    return excess


def joined_intervals(
    start: Array,
    end: Array,
    slack: float = 0.0,
) -> Iterator[tuple[float, float]]:
    """Intervals in order, those that overlap or are at most `slack` apart as one."""
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
