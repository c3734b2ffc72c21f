"""Which limit of which joint is active, when, and what relaxing it would save."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Indices
from trajopt.core.limits import LIMIT_ORDERS, LimitName, Limits
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
    """An interval of time in which a joint is within 1 % of a limit (of position: of its range).

    Attributes:
        joint: From 0.
        limit: The kind of limit.
        start, end: s. Interruptions shorter than 1 % of the duration are left out.
        saving: The time saved, s, when that limit of that joint is 1 % wider (a position limit: by
            1 % of the range). It is the same in every interval of one limit. None where the relaxed
            problem has no answer.
    """

    joint: int
    limit: LimitName
    start: float
    end: float
    saving: float | None


class Stretch(NamedTuple):
    """A joint (from 0), a limit, and the interval in which it is active, s."""

    joint: int
    limit: LimitName
    start: float
    end: float


def active_limits(
    problem: Problem, trajectory: Trajectory, solver: Planner | None
) -> tuple[ActiveLimit, ...]:
    """Return all intervals at a limit, those of the limits with the largest savings first.

    `solver` solves the problem again with each limit relaxed. Without one the trajectory is dilated
    to the relaxed limits.
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
    """Return whether no optimum can have these savings: a solver's scatter is among them.

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


def _duration(problem: Problem, trajectory: Trajectory, solver: Planner | None) -> float | None:
    """Return the solver's duration, or that of the trajectory dilated to the limits, s."""
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
    joined: float = _JOINED_RTOL,
) -> Iterator[Stretch]:
    """Yield every interval with at least `active` of a limit in use, by limit and joint.

    Interruptions shorter than `joined` times the duration are left out.
    """
    for limit in LIMIT_ORDERS:
        joints, starts, ends = _intervals(problem, trajectory, limit, active)
        slack = joined * trajectory.duration
        for joint in range(problem.joints):
            own = joints == joint
            for start, end in joined_intervals(starts[own], ends[own], slack):
                yield Stretch(joint, limit, start, end)


def relaxed(problem: Problem, joint: int, limit: LimitName, by: float = RELAXED_SHARE) -> Problem:
    """Return the problem with one limit of one joint wider by a fraction (of a position range)."""
    limits = {name: pairs.copy() for name, pairs in problem.limits.by_name().items()}
    pair = limits[limit][joint]
    low, high = pair
    size = np.array([low - high, high - low]) if limit == "position" else pair.copy()
    pair += by * size
    return Problem(problem.waypoints, Limits(**limits), problem.name)


def share_at_limits(
    problem: Problem, trajectory: Trajectory, active: float = ACTIVE_SHARE
) -> float:
    """Return the fraction of time in which a joint is at a velocity, acceleration or jerk limit."""
    found = stretches(problem, trajectory, active, joined=0.0)
    motion = [stretch for stretch in found if stretch.limit != "position"]
    start = np.array([stretch.start for stretch in motion])
    end = np.array([stretch.end for stretch in motion])
    joined = joined_intervals(start, end)
    lengths = [b - a for a, b in joined]
    return sum(lengths) / trajectory.duration


def _intervals(
    problem: Problem, trajectory: Trajectory, limit: LimitName, active: float
) -> tuple[Indices, Array, Array]:
    """Joint, start and end (s) of every part of a piece with more than `active` of a limit in use.

    The use of one side is `(p − zero)/(full − zero)`: 0 at `zero` and 1 at `full`.
    """
    low, high = problem.limits.by_name()[limit].T
    full = np.stack([low, high])
    zero = np.zeros_like(full)
    if limit == "position":
        zero = full[::-1]
    span = full - zero
    limited = np.isfinite(span)[:, None]
    # Polynomials (degree + 1, side, piece, joint), positive where the limit is active.
    unit = trajectory.pieces(LIMIT_ORDERS[limit])[:, None]
    excess = np.repeat(unit, 2, axis=1)
    excess[-1] -= np.where(limited, zero[:, None], 0.0)
    excess /= np.where(limited, span[:, None], 1.0)
    excess[-1] -= active
    excess = np.where(limited, excess, -1.0)
    # Between neighbouring roots the sign is that of the middle.
    flat = excess.reshape(len(excess), -1)
    roots = polynomials.unit_roots(flat).reshape(-1, *excess.shape[1:])
    zeros = np.zeros_like(excess[:1])
    knots = np.concatenate([zeros, np.nan_to_num(roots, nan=1.0), zeros + 1.0])
    knots = np.sort(knots, axis=0)
    left = knots[:-1]
    right = knots[1:]
    middle = 0.5 * (left + right)
    above = polynomials.evaluate(excess[:, None], middle) > 0
    index = np.nonzero(above & (right > left))
    _, _, piece, joint = index
    at = trajectory.breaks[piece]
    length = trajectory.lengths[piece]
    return joint, at + left[index] * length, at + right[index] * length


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
