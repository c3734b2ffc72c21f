"""The best 3-5-3 spline with shared segment times, by SciPy's SLSQP.

The variables are the logarithms of the three segment times. The inequalities are the exact peaks of
every joint, so each limit holds at every instant. Only the ratios of the times matter
(docs/mathematics.md, section 2): the initial guesses are the local minima of a grid over both
ratios. The answer is dilated by its exact factor, which is 1 to rounding.

    from baselines.spline353_nlp import Spline353NLP
    solution = Spline353NLP().solve(problem)
    print(solution.trajectory.duration, solution.stats["segment_times"])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import LIMIT_NAMES, Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners import spline353
from trajopt.planners.planner import Planner, passing_once
from trajopt.planners.rest_to_rest import stop_times

_SLSQP_OPTIONS = {"ftol": 1e-15, "maxiter": 300}
# Logarithms: how much shorter or longer than its initial guess a segment may become.
_MAX_LOG_DECREASE = 12
_MAX_LOG_INCREASE = 5
# Step of the complex-step derivative: its error is of the order of the square.
_COMPLEX_STEP = 1e-30
# Fractions of the way back to times that keep the position limits.
_FRACTIONS = np.exp2(np.arange(-40.0, 1.0))
# Logarithms of the outer segment times over the middle one: the grid of initial guesses.
_LOG_RATIOS = np.linspace(-10.0, 10.0, 61)


@dataclass(frozen=True)
class Spline353NLP(Planner):
    """The best 3-5-3 spline with shared times (SLSQP, limits at every instant)."""

    starts: int = 4

    knows = LIMIT_NAMES

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InvalidInput("starts", "at least 1", value=self.starts)

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best of several local optima. `stats`: segment times, each guess's result."""
        reason = spline353.infeasible(problem)
        if reason is not None:
            return Solution(Status.INFEASIBLE, message=reason)
        spline = MovingSpline(problem)
        guesses = initial_guesses(spline, self.starts)
        optima = [_local_optimum(spline, guess) for guess in guesses]
        durations = np.array([times.sum() for times, _ in optima])
        best = int(durations.argmin())
        times, _ = optima[best]
        stats: dict[str, Any] = {
            "start_status": [status for _, status in optima],
            "start_duration": durations,
            "segment_times": times,
        }
        return Solution(Status.SOLVED, spline353.trajectory(problem, times), stats=stats)


class MovingSpline:
    """The 3-5-3 spline of the joints that move, as a function of the segment times.

    Attributes:
        limits: Of the moving joints.
        displacements: Of each joint over the three segments, `(joints, 3)`, rad.
        orders: Highest derivative that is limited: 2, or 3 with jerk.
        bounds: The limits of each derivative from velocity on, `(joints, 2)`.
        room: The position limits, seen from the second waypoint, `(joints, 2)`; None without any.
        sizes: The largest displacement of each joint, `(joints,)`, rad.
        stop_times: Of each segment, from rest to rest, `(3,)`, s.
    """

    def __init__(self, problem: Problem) -> None:
        self.limits = problem.limits.only(problem.moving)
        self.displacements = problem.displacements.T[problem.moving]
        self.orders = 3 if problem.has("jerk") else 2
        rates = (self.limits.velocity, self.limits.acceleration, self.limits.jerk)
        self.bounds = rates[: self.orders]
        self.room = spline353.position_room(problem)
        self.sizes = np.abs(self.displacements).max(axis=1)
        self.stop_times = stop_times(problem)

    def dilation(self, times: Array) -> Array:
        """The exact cheapest dilation of segment times `(…, 3)`, `(…)`."""
        return spline353.dilation(self.displacements, times[..., None, :], self.limits)

    def excesses(self, times: Array) -> Array:
        """Return how far any joint leaves its position limits, over its largest displacement.

        For segment times `(…, 3)`: `(…)`, 0 within the limits.
        """
        if self.room is None:
            return np.zeros(times.shape[:-1])
        own_times = times[..., None, :]
        excess = spline353.position_excess(self.displacements, own_times, self.room)
        return excess.max(axis=-1)

    def position(self, times: Array) -> Array:
        """The quintic from the second waypoint on, on the unit interval, highest power first."""
        controls = spline353.position_coefficients(self.displacements.T, times)
        return polynomials.from_bernstein(np.array(controls))

    def rates(self, times: Array) -> list[Array]:
        """Velocity, acceleration (and jerk) over the quintic, on the unit interval."""
        quintic = spline353.Quintic.between(self.displacements.T, times)
        controls = (quintic.velocity(), quintic.acceleration(), quintic.jerk())
        return [polynomials.from_bernstein(np.array(own)) for own in controls[: self.orders]]

    def instants(self, times: Array) -> list[Array]:
        """Possible peaks of each rate, and last of the position: `(instants, joints)` each."""
        curves = [*self.rates(times), self.position(times)]
        return [polynomials.critical_points(curve) for curve in curves]

    def slack(self, times: Array, instants: list[Array]) -> Array:
        """Return the slack of every limit at the instants, relative to it; 0 is at the limit.

        Times may be complex: the imaginary part is then a derivative.
        """
        tables = []
        for rate, bounds, at in zip(self.rates(times), self.bounds, instants, strict=False):
            values = polynomials.evaluate(rate[:, None], at)
            for side in bounds.T:
                tables.append(1 - values / side)
        if self.orders == 3:
            # The cubics have the constant jerk 6 d/t³.
            jerk = 6 * self.displacements / times**3
            for side in self.limits.jerk.T:
                share = jerk[:, ::2] / side[:, None]
                tables.append(1 - share)
        if self.room is not None:
            curve = self.position(times)
            position = polynomials.evaluate(curve[:, None], instants[-1])
            for side, sign in zip(self.room.T, (-1, 1), strict=True):
                limited = np.isfinite(side)
                distance = side - position
                inwards = sign * distance[:, limited]
                tables.append(inwards / self.sizes[limited])
        return np.concatenate([table.ravel() for table in tables])

    def within(self, times: Array, inside: Array) -> Array:
        """Move times towards those `inside` until they keep the position limits."""
        if self.excesses(times) == 0:
            return times
        way = np.log(inside / times)
        between = times * np.exp(_FRACTIONS[:, None] * way)
        keeps = self.excesses(between) == 0
        keeps[-1] = True
        return between[keeps.argmax()]


def initial_guesses(spline: MovingSpline, count: int) -> list[Array]:
    """Return feasible segment times: the best local minima of a grid over both ratios."""
    first, last = np.meshgrid(_LOG_RATIOS, _LOG_RATIOS, indexing="ij")
    logarithms = np.stack([first, np.zeros_like(first), last], axis=-1)
    times = spline.stop_times * np.exp(logarithms)
    times *= spline.dilation(times)[..., None]
    total = times.sum(axis=-1)
    if spline.room is not None:
        kept = spline.excesses(times) == 0
        total = np.where(kept, total, np.inf)
        if not kept.any():
            longest = spline.stop_times.max()
            times = spline353.keeping_times(
                spline.displacements, spline.limits, spline.room, longest
            )
            return [times]
    padded = np.pad(total, 1, mode="edge")
    neighbours = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    lowest = (total <= neighbours.min(axis=(2, 3))) & np.isfinite(total)
    by_duration = np.argsort(total[lowest])
    return list(times[lowest][by_duration[:count]])


def _local_optimum(spline: MovingSpline, guess: Array) -> tuple[Array, str]:
    """Feasible segment times near a local optimum, and how SLSQP ended, from one initial guess."""
    import scipy  # late: planners that are only listed need none of it

    unit = guess.mean()
    start = np.log(guess / unit)
    low = start - _MAX_LOG_DECREASE
    high = start + _MAX_LOG_INCREASE

    def duration(y: Array) -> float:
        return float(np.exp(y).sum())

    def slack(y: Array) -> Array:
        times = unit * np.exp(y)
        instants = spline.instants(times)
        return spline.slack(times, instants)

    def slope(y: Array) -> Array:
        # A peak's instant changes its value by the square only: the instants stay.
        times = unit * np.exp(y)
        instants = spline.instants(times)
        columns = []
        for step in _COMPLEX_STEP * np.eye(3):
            moved = times * np.exp(1j * step)
            changed = spline.slack(moved, instants)
            columns.append(changed.imag / _COMPLEX_STEP)
        return np.stack(columns, axis=1)

    with np.errstate(all="ignore"):
        found = scipy.optimize.minimize(
            duration,
            start,
            jac=np.exp,
            method="SLSQP",
            bounds=list(zip(low, high, strict=True)),
            constraints={"type": "ineq", "fun": slack, "jac": slope},
            options=_SLSQP_OPTIONS,
        )
    times = unit * np.exp(found.x)
    if not np.isfinite(times).all():
        return guess, str(found.message)
    times = spline.within(times, guess)
    times = times * spline.dilation(times)
    if times.sum() > guess.sum():
        times = guess
    return times, str(found.message)
