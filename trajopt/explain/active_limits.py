"""Which limit of which joint holds a planner back, when, and what relaxing it would save."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.planner import Planner
from trajopt.problem import LimitName, Limits, Problem
from trajopt.trajectory import Trajectory
from trajopt.verification import certified, verify

Array = NDArray[np.float64]

NEAR = 0.99  # of a limit: from there on it counts as reached
RELAXED = 0.01  # by which a limit is widened to see what it is worth
_ORDERS: tuple[tuple[LimitName, int], ...] = (
    ("position", 0), ("velocity", 1), ("acceleration", 2), ("jerk", 3),
)  # fmt: skip
_JOINED = 0.01  # of the duration: stretches closer than this are one


@dataclass(frozen=True)
class Binding:
    """A stretch of time in which a joint is within 1 % of a limit (of position: of its range).

    `joint` counts from 0; `start` and `end` in seconds, interruptions shorter than 1 % of the
    duration passed over. `worth` is what relaxing that limit of that joint by 1 % (a position
    limit: by 1 % of the range) saves in all, s, so it is the same in every stretch of one limit;
    None where there is no answer to the relaxed problem.
    """

    joint: int
    limit: LimitName
    start: float
    end: float
    worth: float | None


def binding(
    problem: Problem, trajectory: Trajectory, solver: Planner | None
) -> tuple[Binding, ...]:
    """All stretches at a limit, those of the limits worth most first.

    `solver` solves the problem again with each limit relaxed; without one, the trajectory keeps its
    path and its timing but for one factor, and is dilated to the relaxed limits.
    """
    found = list(stretches(problem, trajectory))
    before = _duration(problem, trajectory, solver) if found else None
    worths: dict[tuple[int, LimitName], float | None] = {}
    for joint, limit in dict.fromkeys(row[:2] for row in found):
        after = _duration(relaxed(problem, joint, limit), trajectory, solver)
        worths[joint, limit] = None if before is None or after is None else before - after
    rows = [Binding(*row, worths[row[:2]]) for row in found]
    return tuple(sorted(rows, key=lambda b: (-(b.worth or 0.0), b.joint, b.start)))


def scattered(found: tuple[Binding, ...], duration: float) -> bool:
    """Whether some worth is none that an optimum can have: it is the solver's own scatter.

    Wider limits cannot cost time; and as velocity limits times `c`, acceleration limits times `c²`
    and jerk limits times `c³` divide an optimum by `c`, one of them alone cannot save more.
    """
    orders = dict(_ORDERS)
    most = {k: 1 - (1 + RELAXED) ** (-1 / o) if o else 1.0 for k, o in orders.items()}
    slack = 1e-6 * duration
    return any(
        b.worth is not None and not -slack <= b.worth <= most[b.limit] * duration + slack
        for b in found
    )


def _duration(problem: Problem, trajectory: Trajectory, solver: Planner | None) -> float | None:
    """What the solver takes, or the trajectory dilated (or sped up) to the limits, s."""
    if solver is None:
        return verify(problem, trajectory).dilation * trajectory.duration
    answer = solver.solve(problem).trajectory
    answer = answer and certified(problem, answer)
    return None if answer is None else answer.duration


def stretches(
    problem: Problem, trajectory: Trajectory, near: float = NEAR, joined: float = _JOINED
) -> Iterator[tuple[int, LimitName, float, float]]:
    """`(joint, limit, start, end)` of every stretch with at least `near` of a limit in use.

    Times in seconds; interruptions shorter than `joined` times the duration are passed over.
    """
    for limit, order in _ORDERS:
        piece, joint, start, end = _within(problem, trajectory, limit, order, near)
        for own in range(problem.joints):
            at = trajectory.breaks[piece[joint == own]]
            length = np.diff(trajectory.breaks)[piece[joint == own]]
            spans = at + start[joint == own] * length, at + end[joint == own] * length
            for a, b in _merged(*spans, joined * trajectory.duration):
                yield own, limit, a, b


def relaxed(problem: Problem, joint: int, limit: LimitName, by: float = RELAXED) -> Problem:
    """The problem with one limit of one joint wider by a share; a position limit by its range."""
    pairs = np.array(getattr(problem.limits, limit))
    low, high = pairs[joint]
    wider = by * np.array([low - high, high - low]) if limit == "position" else by * pairs[joint]
    pairs[joint] += wider
    kept = {name: getattr(problem.limits, name) for name, _ in _ORDERS}
    return Problem(problem.waypoints, Limits(**(kept | {limit: pairs})), problem.name)


def busy(problem: Problem, trajectory: Trajectory, near: float = NEAR) -> float:
    """The share of its time in which at least one joint is at a limit of motion."""
    found = stretches(problem, trajectory, near, joined=0.0)
    rows = [(a, b) for _, limit, a, b in found if limit != "position"]
    start, end = np.array(rows).reshape(-1, 2).T
    return sum(b - a for a, b in _merged(start, end, 0.0)) / trajectory.duration


def _within(
    problem: Problem, trajectory: Trajectory, limit: LimitName, order: int, near: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
    """Piece, joint, start and end (0 to 1 within the piece) wherever a limit is in use."""
    derivative = polynomials.derivative(trajectory.coefficients, order)
    unit = polynomials.stretched(derivative, np.diff(trajectory.breaks))
    excess = np.stack([_use(unit, pair, limit, near) for pair in _sides(problem, limit)], axis=1)
    roots = polynomials.unit_roots(excess.reshape(len(excess), -1))
    roots = roots.reshape(-1, *excess.shape[1:])
    ends = np.zeros_like(excess[:1])
    knots = np.sort(np.concatenate([ends, np.nan_to_num(roots, nan=1.0), ends + 1.0]), axis=0)
    middle = 0.5 * (knots[:-1] + knots[1:])
    above = polynomials.evaluate(excess[:, None], middle) > 0
    row, side, piece, joint = np.nonzero(above & (knots[1:] > knots[:-1]))
    return piece, joint, knots[row, side, piece, joint], knots[row + 1, side, piece, joint]


def _sides(problem: Problem, limit: LimitName) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Each side of a limit, `(zero, full)`: where its use is counted from, and where it is 1."""
    low, high = getattr(problem.limits, limit).T
    if limit != "position":
        return (np.zeros_like(low), low), (np.zeros_like(high), high)
    return (high, low), (low, high)


def _use(unit: Array, side: tuple[Array, Array], limit: LimitName, near: float) -> Array:
    """Polynomials that are positive where more than `near` of a side is in use."""
    zero, full = side
    endless = ~np.isfinite(full - zero)
    scale = np.where(endless, 1.0, full - zero)
    shifted = np.array(unit)
    shifted[-1] -= np.where(endless, 0.0, zero)
    use = shifted / scale
    use[-1] -= near
    use[:, :, endless] = 0.0
    use[-1][:, endless] = -near
    return use


def _merged(start: Array, end: Array, slack: float) -> Iterator[tuple[float, float]]:
    """Intervals in order, those that touch or overlap as one."""
    order = np.argsort(start)
    start, end = start[order], np.maximum.accumulate(end[order])
    first = np.flatnonzero(np.r_[True, start[1:] > end[:-1] + slack][: len(start)])
    last = np.r_[first[1:] - 1, len(start) - 1][: len(first)]
    yield from zip(start[first].tolist(), end[last].tolist(), strict=True)
