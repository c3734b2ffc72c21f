"""Ruckig, the open edition, on this machine only (Berscheid & Kröger 2021): point to point.

Offline it takes no intermediate waypoints, so every segment is a section of its own, from one state
(position, velocity, acceleration) to the next with all joints arriving together. `RuckigStop` rests
at every waypoint; `RuckigVia` starts there and improves the states at the waypoints between.

Ruckig knows one jerk limit for both sides: an asymmetric one counts at its tighter side. It ignores
position limits; here every section is checked against them. With jerk unlimited it ignores
accelerations. Its tolerances are absolute, so it is given moderate numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its parts are imported when they are used: listing needs none
from numpy.typing import NDArray

from baselines.own_units import in_own_units
from trajopt import polynomials
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, backend, passing_once
from trajopt.problem import Limits, Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

_LOPSIDED = "Ruckig's jerk limit is symmetric: the tighter side was used"
_INSIDE = 1e-9  # relative: how far inside its limits a state at a waypoint is kept
_PROBE = 0.1  # of the trust region: how far differences reach
_FACTORS = (0.0, 1.0, 0.5, 1.5)  # starts: parts of the mean velocity about a waypoint
_KICKS = (0.1, 0.5, 0.02)  # of the limits: how far random starts lie from the best
_PROGRESS = 1e-7  # relative: the least gain worth a step
_INWARDS = 1 - 1e-14  # times an end state: exactly opposite states at one place crash Ruckig 0.19
_SMALLEST = 1e-5  # of the limits: the search's last step


@dataclass(frozen=True)
class RuckigStop(Planner):
    """Ruckig from waypoint to waypoint, stopping at each."""

    requires = ("ruckig",)

    @passing_once
    @in_own_units
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        sections = Sections(problem)
        return _solution(problem, sections, sections.at_rest, [])


@dataclass(frozen=True)
class RuckigVia(RuckigStop):
    """Ruckig through the waypoints, their velocities (and accelerations) improved from stopping."""

    evaluations: int = 8000  # Ruckig's sections, about 0.1 ms each with the search around them

    def __post_init__(self) -> None:
        if self.evaluations < 1:
            raise InvalidInput("evaluations", "at least 1", value=self.evaluations)

    @passing_once
    @in_own_units
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        sections = Sections(problem)
        return _solution(problem, sections, *improved(sections, self.evaluations))


class Sections:
    """Ruckig on the segments of a problem (no two consecutive waypoints alike), moving joints only.

    `states` are `(2, waypoints, moving joints)`: velocity, rad/s, and acceleration, rad/s² (unused
    for joints without a jerk limit); `evaluations` counts the sections computed.
    """

    def __init__(self, problem: Problem) -> None:
        ruckig = backend("ruckig")
        self.moving = np.flatnonzero(problem.moving)
        self.waypoints = problem.waypoints[:, self.moving]
        self.limits = problem.limits.only(self.moving)
        joints = len(self.moving)
        self._solver, self._trajectory = ruckig.Ruckig(joints), ruckig.Trajectory(joints)
        self._input = _input(ruckig, self.limits)
        self._success = (ruckig.Result.Working, ruckig.Result.Finished)
        self._error = ruckig.RuckigError
        self.evaluations = 0

    @property
    def at_rest(self) -> Array:
        return np.zeros((2, *self.waypoints.shape))

    def minima(self, k: int, start: Array, end: Array) -> Array:
        """Each joint's own least time for segment `k`, NaN where Ruckig refuses, `(joints,)`, s."""
        if not self._calculate(k, start, end):
            return np.full(len(self.moving), np.nan)
        return np.array(self._trajectory.independent_min_durations)

    def duration(self, k: int, start: Array, end: Array) -> float:
        """Time of segment `k` with all joints together; infinite if the states break a limit, s."""
        if not self._calculate(k, start, end, checked=True):
            return np.inf
        time = float(self._trajectory.duration)
        return time if self._inside() else np.inf

    def profiles(self, k: int, start: Array, end: Array) -> tuple[float, list[tuple[Array, Array]]]:
        """The duration of segment `k` and every joint's `(breaks, coefficients)`, cubics."""
        if not self._calculate(k, start, end):
            raise ArithmeticError(f"Ruckig gave up on segment {k + 1}")
        return self._trajectory.duration, self._rebuilt()

    def _rebuilt(self) -> list[tuple[Array, Array]]:
        return [_cubics(p, self._trajectory.duration) for p in self._trajectory.profiles[0]]

    def _calculate(self, k: int, start: Array, end: Array, *, checked: bool = False) -> bool:
        """Whether Ruckig solves segment `k`; `checked`, from states that keep their limits."""
        given = self._input
        given.current_position, given.target_position = self.waypoints[k : k + 2].tolist()
        given.current_velocity, given.current_acceleration = start.tolist()
        given.target_velocity, given.target_acceleration = (end * _INWARDS).tolist()
        self.evaluations += 1
        try:
            valid = not checked or self._solver.validate_input(given, True, True)
            return valid and self._solver.calculate(given, self._trajectory) in self._success
        except (self._error, ValueError):  # a result code that its own enumeration lacks
            return False

    def _inside(self) -> bool:
        if not np.isfinite(self.limits.position).any():
            return True
        slack = 1e-12 * np.maximum(np.abs(self.waypoints).max(axis=0), 1)
        wide = self.limits.position + slack[:, None] * [-1, 1]
        return all(
            _within(*joint, *pair) for joint, pair in zip(self._rebuilt(), wide, strict=True)
        )


def section(
    limits: Limits, start: tuple[Array, Array, Array], end: tuple[Array, Array, Array]
) -> tuple[float, Array]:
    """One section between two states (position, velocity, acceleration; each `(joints,)`).

    Returns its duration with all joints arriving together, and the least time of each joint that
    moves, s. Infinite and NaN where Ruckig refuses. Raises `InvalidInput` where no joint moves.
    """
    sections = Sections(Problem(np.array([start[0], end[0]]), limits))
    states = np.array([start[1:], end[1:]])[:, :, sections.moving]
    minima = sections.minima(0, *states)
    return sections.duration(0, *states), minima


def improved(sections: Sections, evaluations: int) -> tuple[Array, list[tuple[int, float]]]:
    """Better states at the waypoints than rest, and the best total by evaluations spent.

    Descends from rest, from the waypoints' mean velocities, and then from random steps away from
    the best so far (always the same ones), while the budget lasts.
    """
    best = sections.at_rest
    least = _total(sections, best)
    history = [(sections.evaluations, least)]
    if not np.isfinite(least) or not best[:, 1:-1].size:  # refused, or nothing to choose
        return best, history
    generator = np.random.default_rng(0)
    guesses = _guesses(sections)
    while sections.evaluations < evaluations:
        kicked = generator.uniform(*_bounds(sections, best, generator.choice(_KICKS)))
        start = guesses.pop(0) if guesses else kicked
        states, total = _descended(sections, start, evaluations)
        if total < least:
            best, least = states, total
            history.append((sections.evaluations, least))
    return best, history


def _guesses(sections: Sections) -> list[Array]:
    """Rest, and shares of the mean velocity about each waypoint if one stops at its neighbours."""
    rest = sections.at_rest
    times = [np.nanmax(sections.minima(k, *_ends(rest, k))) for k in range(rest.shape[1] - 1)]
    means = sections.at_rest
    spans = np.add(times[1:], times[:-1])[:, None]
    means[0, 1:-1] = (sections.waypoints[2:] - sections.waypoints[:-2]) / spans
    lower, upper = _bounds(sections, rest, 1.0)
    return [np.clip(factor * means, lower, upper) for factor in _FACTORS]


def _descended(sections: Sections, states: Array, evaluations: int) -> tuple[Array, float]:
    """A local optimum and its total, by a sequential linear programme.

    The total is `Σ_k max_j τ_kj`, and a joint's own least time `τ_kj` depends on its own states at
    the segment's ends only, so one section gives the differences of all joints. The linear model's
    steps count only where the measured total falls; elsewhere the trust region shrinks, and the
    differences with it.
    """
    best, radius = _total(sections, states), 0.5
    while radius > _SMALLEST and sections.evaluations < evaluations:
        trial = _proposed(sections, states, radius)
        total = _total(sections, trial)
        if total < best * (1 - _PROGRESS):
            states, best, radius = trial, total, min(2 * radius, 1.0)
        else:
            radius /= 3
    return states, best


def _total(sections: Sections, states: Array) -> float:
    """The duration of all segments, s."""
    return sum(sections.duration(k, *_ends(states, k)) for k in range(states.shape[1] - 1))


def _bounds(sections: Sections, states: Array, radius: float) -> tuple[Array, Array]:
    """The trust region around the states, inside their limits; ends, and no idle acceleration."""
    boxes = np.stack([sections.limits.velocity, sections.limits.acceleration]) * (1 - _INSIDE)
    boxes[1, ~np.isfinite(sections.limits.jerk).any(axis=1)] = 0
    low, high = np.moveaxis(boxes, -1, 0)[:, :, None]
    reach = radius * np.minimum(high, -low)
    lower, upper = np.maximum(states - reach, low), np.minimum(states + reach, high)
    lower[:, [0, -1]], upper[:, [0, -1]] = 0, 0
    return lower, upper


def _proposed(sections: Sections, states: Array, radius: float) -> Array:
    """The states that minimise the linear model within the trust region."""
    lower, upper = _bounds(sections, states, radius)
    times, up, down = _model(sections, states, upper - states, states - lower)
    segments, joints = times.shape
    # Rows: times + up·rise − down·fall ≤ τ, one per segment and joint; columns: rise, fall, τ.
    matrix = np.concatenate(
        [
            up.reshape(len(up), -1),
            -down.reshape(len(up), -1),
            -np.repeat(np.eye(segments), joints, 0),
        ],
        axis=1,
    )
    cost = np.r_[np.zeros(2 * states.size), np.ones(segments)]
    most = np.r_[(upper - states).ravel(), (states - lower).ravel(), np.full(segments, np.inf)]
    # milp without integers: linprog spends longer checking its arguments than solving.
    rows = scipy.sparse.csc_array(matrix)
    answer = scipy.optimize.milp(
        cost,
        constraints=scipy.optimize.LinearConstraint(rows, ub=-times.ravel()),
        bounds=scipy.optimize.Bounds(0, most),
        options={"presolve": False},
    )
    if answer.x is None:
        return states
    rise, fall = answer.x[: 2 * states.size].reshape(2, *states.shape)
    return np.asarray(np.clip(states + rise - fall, lower, upper))


def _model(
    sections: Sections, states: Array, above: Array, below: Array
) -> tuple[Array, Array, Array]:
    """Least times `(segments, joints)`, and their slopes upwards and downwards, a row for each.

    Where the slope upwards is the smaller one (a dent), both are their mean.
    """
    _, count, joints = states.shape
    times = np.array([sections.minima(k, *_ends(states, k)) for k in range(count - 1)])
    slopes = np.zeros((2, count - 1, joints, *states.shape))
    own = np.arange(joints)
    for side, room in enumerate((above, -below)):
        for order, waypoint in np.argwhere(room.any(axis=2)):
            step = _PROBE * room[order, waypoint]
            moved = states.copy()
            moved[order, waypoint] += step
            for k in (waypoint - 1, waypoint):
                change = sections.minima(k, *_ends(moved, k)) - times[k]
                slope = np.divide(change, step, out=np.zeros(joints), where=step != 0)
                slopes[side, k, own, order, waypoint, own] = np.nan_to_num(slope)
    up, down = slopes.reshape(2, (count - 1) * joints, *states.shape)
    mean = 0.5 * (up + down)
    return np.nan_to_num(times), np.where(up < down, mean, up), np.where(up < down, mean, down)


def _ends(states: Array, k: int) -> Array:
    """The states where segment `k` starts and ends: `(2, 2, joints)`."""
    return states[:, k : k + 2].swapaxes(0, 1)


def _input(ruckig: Any, limits: Limits) -> Any:
    given = ruckig.InputParameter(limits.joints)
    given.min_velocity, given.max_velocity = limits.velocity.T.tolist()
    given.min_acceleration, given.max_acceleration = limits.acceleration.T.tolist()
    given.max_jerk = np.abs(limits.jerk).min(axis=1).tolist()
    return given


def _phases(profile: Any) -> Iterator[tuple[float, list[float]]]:
    """Every phase that takes time: its duration and its cubic."""
    for part in (profile.brake, profile, profile.accel):
        for t, j, a, v, p in zip(part.t, part.j, part.a, part.v, part.p, strict=False):
            if t > 0:
                yield t, [j / 6, a / 2, v, p]


def _cubics(profile: Any, time: float) -> tuple[Array, Array]:
    """One joint's `(breaks, coefficients)` over a section of that time."""
    phases = list(_phases(profile)) or [(time, [0.0, 0.0, profile.vf, profile.pf])]
    breaks = np.r_[0.0, np.cumsum([t for t, _ in phases])]
    breaks[-1] = time
    return breaks, np.array([c for _, c in phases]).T


def _within(breaks: Array, coefficients: Array, low: float, high: float) -> bool:
    """Whether one joint's positions lie in `[low, high]`: by their bounds, or by their extremes."""
    unit = polynomials.stretched(coefficients, np.diff(breaks))
    bounds = polynomials.bernstein(unit)
    if not (low <= bounds.min() and bounds.max() <= high):  # else certainly inside
        bounds = polynomials.evaluate(unit[:, None], polynomials.critical_points(unit))
    return bool(low <= bounds.min() and bounds.max() <= high)


def _solution(
    problem: Problem, sections: Sections, states: Array, history: list[tuple[int, float]]
) -> Solution:
    try:
        parts = [sections.profiles(k, *_ends(states, k)) for k in range(problem.segments)]
    except ArithmeticError as error:
        return Solution(Status.FAILED, message=str(error))
    low, high = problem.limits.jerk.T
    return Solution(
        Status.SOLVED,
        _assembled(problem, sections.moving, parts),
        _LOPSIDED if (-low != high).any() else "",
        evaluations=sections.evaluations,
        history=np.array(history) if history else None,
    )


def _assembled(
    problem: Problem, moving: NDArray[np.intp], parts: list[tuple[float, list[tuple[Array, Array]]]]
) -> Trajectory:
    """All sections one after another, every joint on common breaks, resting joints put back."""
    at = np.r_[0.0, np.cumsum([time for time, _ in parts])]
    rest = [(at[[0, -1]], np.array([[q]])) for q in problem.waypoints[0]]
    for column, joint in enumerate(moving):
        own = [section[column] for _, section in parts]
        later = (start + breaks[1:] for start, (breaks, _) in zip(at, own, strict=False))
        rest[joint] = np.r_[0.0, *later], np.concatenate([c for _, c in own], axis=1)
    return Trajectory.joined(rest, at)
