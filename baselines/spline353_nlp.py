"""The best 3-5-3 spline with shared segment times, by CasADi/IPOPT.

Three variables (the logarithms of the segment times) and limits that hold at every instant: they
are imposed at a few instants of each joint, the true worst instants of the answer replace the idle
ones among them, and the solver runs again until no limit is broken in between (the exchange method
of semi-infinite programming). The answer is dilated by its exact factor, which by then is 1 to
rounding. Only the ratios of the times matter (docs/mathematics.md, section 2), so the starts are
the local minima of a grid over both ratios. Position limits no dilation mends: what leaves them
between the instants is moved back towards times that keep them.

    from baselines.spline353_nlp import Spline353NLP
    solution = Spline353NLP().solve(problem)
    print(solution.trajectory.duration, solution.stats["segment_times"])
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.ipopt import Bounds, Options, Program, Run, flat, no_start_succeeded, program
from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import LIMIT_NAMES, Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners import spline353
from trajopt.planners.planner import Planner, backend, passing_once
from trajopt.planners.rest_to_rest import stop_times

Array = NDArray[np.float64]

_OPTIONS: Options = {
    "tol": 1e-11,
    "acceptable_tol": 1e-8,
    "max_iter": 300,
    "bound_relax_factor": 0.0,  # else every limit is passed by 1e-8, and no round is the last
    # With three variables, and rows that are scaled already, reordering, scaling and refining cost
    # more than the solution itself, which stays the same.
    "mumps_pivot_order": 0,
    "mumps_permuting_scaling": 0,
    "mumps_scaling": 0,
    "fast_step_computation": "yes",
    "min_refinement_steps": 0,
}
# Per joint and limit; evenly spread at first.
_INSTANTS = 11
_MOST_ROUNDS = 20
# Excess dilation at which the exchange has converged.
_DILATION_TOLERANCE = 1e-10
# The same of positions, over the largest displacement.
_POSITION_TOLERANCE = 1e-10
# Shares of the way back to times that keep the position limits.
_SHARES = np.exp2(np.arange(-40.0, 1.0))
# Logarithms of the outer segment times over the middle one, where the starts are looked for.
_LOG_RATIOS = np.linspace(-10.0, 10.0, 61)
# Logarithms: how much briefer or longer than at its start a segment may become in one round.
_MOST_BRIEFER = 12
_MOST_LONGER = 5


@dataclass(frozen=True)
class Spline353NLP(Planner):
    """The best 3-5-3 spline with shared times (CasADi/IPOPT, limits at every instant)."""

    starts: int = 4

    requires = ("casadi",)
    knows = LIMIT_NAMES

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InvalidInput("starts", "at least 1", value=self.starts)

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of several local optima. `stats`: segment times; each start's outcome (s)."""
        reason = spline353.infeasible(problem)
        if reason is not None:
            return Solution(Status.INFEASIBLE, message=reason)
        spline = Spline(problem)
        began = time.perf_counter()
        solver = _solver(spline.joints, spline.orders, spline.room is not None)
        setup_time = time.perf_counter() - began

        starts = _starts(spline, problem, self.starts)
        optima = [_exchange(solver, spline, start) for start in starts]
        statuses = [status for _, status in optima]
        totals = [times.sum() for times, _ in optima]
        durations = np.array(totals)
        stats: dict[str, Any] = {
            "start_status": statuses,
            "start_duration": durations,
        }
        if not np.isfinite(durations).any():
            return Solution(
                Status.FAILED,
                message=no_start_succeeded(statuses),
                setup_time=setup_time,
                stats=stats,
            )
        best = int(np.nanargmin(durations))
        times, _ = optima[best]
        stats["segment_times"] = times
        return Solution(
            Status.SOLVED,
            spline353.trajectory(problem, times),
            setup_time=setup_time,
            stats=stats,
        )


class Spline:
    """The moving joints of a problem.

    Attributes:
        limits: Of the moving joints.
        displacements: Of each joint over the three segments, `(joints, 3)`, rad.
        orders: Up to which derivative there are limits: 2, or 3 with jerk.
        bounds: The limits of each such derivative, `(joints, 2)`.
        room: The position limits, seen from the second waypoint, `(joints, 2)`; None without any.
        sizes: The largest displacement of each joint, `(joints,)`, rad.
    """

    def __init__(self, problem: Problem) -> None:
        self.limits = problem.limits.only(problem.moving)
        self.displacements = problem.displacements.T[problem.moving]
        self.joints = len(self.displacements)
        self.orders = 3 if problem.has("jerk") else 2
        limits = self.limits
        rates = (limits.velocity, limits.acceleration, limits.jerk)
        self.bounds = rates[: self.orders]
        self.room = spline353.position_room(problem)
        self.sizes = np.abs(self.displacements).max(axis=1)

    def dilation(self, times: Array) -> float:
        """The exact cheapest dilation of these segment times."""
        k = spline353.dilation(self.displacements, times, self.limits)
        return float(k)

    def excess(self, times: Array) -> float:
        """How far any joint leaves its position limits, over its largest displacement; or 0."""
        excess = self.excesses(times)
        return float(excess)

    def excesses(self, times: Array) -> Array:
        """The same of many segment times `(…, 3)`, `(…)`."""
        if self.room is None:
            return np.zeros(times.shape[:-1])
        own_times = times[..., None, :]
        excess = spline353.position_excess(self.displacements, own_times, self.room)
        return np.asarray(excess.max(axis=-1))

    def kept(self, times: Array, inside: Array) -> Array:
        """These times, or near ones on the way to those `inside` that keep the position limits."""
        if self.excess(times) == 0:
            return times
        way = np.log(inside / times)
        shares = _SHARES
        for _ in range(2):
            between = times * np.exp(shares[:, None] * way)
            keeps = self.excesses(between) == 0
            # those `inside` keep them, but for rounding
            keeps[-1] = True
            first = int(keeps.argmax())
            mended = between[first]
            before = shares[first - 1] if first > 0 else 0.0
            shares = np.linspace(before, shares[first], len(_SHARES))
        return np.asarray(mended)

    def position(self, times: Array) -> Array:
        """The quintic from the second waypoint on, on the unit interval of time."""
        t2 = times[1]
        _, quintic, _ = spline353.coefficients(self.displacements, times)
        return polynomials.stretched(quintic.T, t2)

    def rates(self, times: Array) -> list[Array]:
        """Velocity, acceleration (and jerk) over the quintic, on the unit interval of time."""
        t2 = times[1]
        unit = self.position(times)
        rates = []
        for order in range(1, self.orders + 1):
            # d^k q/dt^k = d^k q/ds^k / t2^k
            rate = polynomials.derivative(unit, order)
            rates.append(rate / t2**order)
        return rates

    def exchanged(self, times: Array, instants: list[Array]) -> list[Array]:
        """The instants `(k, joints)` of each limit, the idlest replaced by the true worst one.

        Those of the position limits, if there are any, come last.
        """
        rates = self.rates(times)
        exchanged = []
        for rate, bounds, old in zip(rates, self.bounds, instants, strict=False):
            new = _replace_idlest(rate, bounds.T, old)
            exchanged.append(new)
        if self.room is not None:
            new = _nearest_walls(self.position(times), self.room.T, instants[-1])
            exchanged.append(new)
        return exchanged


def _replace_idlest(rate: Array, bounds: Array, instants: Array) -> Array:
    """Both ends stay; `bounds` is `(2, joints)`."""

    low, high = bounds

    def utilisation(points: Array) -> Array:
        values = polynomials.evaluate(rate[:, None], points)
        return np.asarray(np.maximum(values / high, values / low))

    joints = np.arange(rate.shape[1])
    points = polynomials.critical_points(rate)
    worst = utilisation(points).argmax(axis=0)
    inner = utilisation(instants)[1:-1]
    idlest = 1 + inner.argmin(axis=0)
    new = instants.copy()
    new[idlest, joints] = points[worst, joints]
    return new


def _nearest_walls(position: Array, room: Array, instants: Array) -> Array:
    """The idlest instant replaced by that of the extreme nearest to a limit or farthest beyond.

    Both ends of the quintic are waypoints, and need no instant.
    """
    low, high = room

    def excess(points: Array) -> Array:
        values = polynomials.evaluate(position[:, None], points)
        return np.asarray(np.maximum(values - high, low - values))

    joints = np.arange(position.shape[1])
    turns = polynomials.unit_roots(polynomials.derivative(position))
    inner = (turns > 0) & (turns < 1)
    points = np.where(inner, turns, 0.5)
    worst = excess(points).argmax(axis=0)
    idlest = excess(instants).argmin(axis=0)
    new = instants.copy()
    new[idlest, joints] = points[worst, joints]
    return new


def _starts(spline: Spline, problem: Problem, count: int) -> list[Array]:
    """Feasible segment times to start from: the best local minima of a grid over their ratios."""
    first, last = np.meshgrid(_LOG_RATIOS, _LOG_RATIOS, indexing="ij")
    middle = np.zeros_like(first)
    ratios = np.stack([first, middle, last], axis=-1)
    times = np.exp(ratios)
    times *= stop_times(problem)
    dilations = spline353.dilation(
        spline.displacements,
        times[..., None, :],
        spline.limits,
    )
    times *= dilations[..., None]
    total = times.sum(axis=-1)
    if spline.room is not None:
        kept = spline.excesses(times) == 0
        total = np.where(kept, total, np.inf)
        if not kept.any():
            longest = float(stop_times(problem).max())
            times = spline353.keeping_times(
                spline.displacements,
                spline.limits,
                spline.room,
                unit=longest,
            )
            return [times]
    padded = np.pad(total, 1, mode="edge")
    neighbours = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    lowest = (total <= neighbours.min(axis=(2, 3))) & np.isfinite(total)
    by_duration = np.argsort(total[lowest])
    minima = times[lowest]
    return list(minima[by_duration[:count]])


def _exchange(
    solver: Program,
    spline: Spline,
    times: Array,
) -> tuple[Array, str]:
    """Feasible segment times (NaN if none) and IPOPT's last status, from one start."""
    best = np.full(3, np.nan)
    status = ""
    even = np.linspace(0.0, 1.0, _INSTANTS)[:, None]
    every_joint = even + np.zeros(spline.joints)
    instants = [every_joint for _ in spline.bounds]
    if spline.room is not None:
        between = np.linspace(0.0, 1.0, _INSTANTS + 2)[1:-1, None]
        instants.append(between + np.zeros(spline.joints))
    inside = times
    for _ in range(_MOST_ROUNDS):
        instants = spline.exchanged(times, instants)
        run, times = _solve_at(solver, spline, times, instants)
        status = run.status
        if not run.success:
            break
        inside = spline.kept(times, inside)
        k = spline.dilation(inside)
        duration = k * inside.sum()
        # a NaN is no duration yet
        if not duration >= best.sum():
            best = k * inside
        if k - 1 < _DILATION_TOLERANCE and spline.excess(times) < _POSITION_TOLERANCE:
            break
    return best, status


def _solve_at(
    solver: Program,
    spline: Spline,
    times: Array,
    instants: list[Array],
) -> tuple[Run, Array]:
    """One NLP from `times`, its limits imposed at these instants; and the times it ends at."""
    unit = float(times.mean())
    reciprocals = []
    for order, bounds in enumerate(spline.bounds, start=1):
        limit = _tighter(bounds) * unit**order
        reciprocals.append(1 / limit)
    y = np.log(times / unit)
    parameters = [spline.displacements, *reciprocals]
    if spline.room is not None:
        parameters.append(1 / spline.sizes[:, None])
    run = solver(
        start=y,
        parameters=flat(*parameters, *instants),
        bounds=(y - _MOST_BRIEFER, y + _MOST_LONGER),
        constraint_bounds=_constraint_bounds(spline),
    )
    return run, np.exp(run.x) * unit


def _constraint_bounds(spline: Spline) -> Bounds:
    """Both limits over the tighter one; positions over the displacements come last, if limited."""
    tables = []
    for bounds in spline.bounds:
        tighter = _tighter(bounds)
        unit = np.where(np.isinf(tighter), 1.0, tighter)
        share = bounds / unit
        tables.append(np.repeat(share, _INSTANTS, axis=0))
    if spline.orders == 3:
        # jerk over both cubics
        tables += [share, share]
    if spline.room is not None:
        room = spline.room / spline.sizes[:, None]
        tables.append(np.repeat(room, _INSTANTS, axis=0))
    # instants of one joint after those of another
    low, high = np.concatenate(tables).T
    return low, high


def _tighter(bounds: Array) -> Array:
    """The tighter side of limits `(joints, 2)`, `(joints, 1)`."""
    return np.asarray(np.abs(bounds).min(axis=1, keepdims=True))


@cache
def _solver(joints: int, orders: int, walled: bool) -> Program:
    """IPOPT for this many joints, limited up to this derivative; built once for all problems.

    Every constraint is a value over the tighter side of its limit, between both sides over it
    (`_constraint_bounds`); an infinite limit has a reciprocal of zero. Where joints are `walled` by
    position limits, their positions over their sizes follow.
    """
    ca = backend("casadi")
    d = ca.MX.sym("d", joints, 3)
    y = ca.MX.sym("y", 3)
    reciprocals = []
    instants = []
    for order in range(1, orders + 1):
        reciprocal = ca.MX.sym(f"limit{order}", joints)
        s = ca.MX.sym(f"s{order}", _INSTANTS, joints)
        reciprocals.append(reciprocal)
        instants.append(s)
    t = ca.exp(y)

    utilisations = []
    displacements = ca.horzsplit(d)
    times = ca.vertsplit(t)
    quintic = spline353.Quintic.between(displacements, times)
    controls = (quintic.velocity(), quintic.acceleration(), quintic.jerk())
    for own, reciprocal, s in zip(controls, reciprocals, instants, strict=False):
        # a row per instant, a column per joint
        tables = [ca.repmat(control.T, _INSTANTS, 1) for control in own]
        limit = ca.repmat(reciprocal.T, _INSTANTS, 1)
        utilisations.append(_bernstein(tables, s) * limit)
    if orders == 3:
        # the cubics' constant jerk, 6 d/t³
        for segment in (0, 2):
            cubic = displacements[segment] / times[segment] ** 3
            utilisations.append(6 * cubic * reciprocals[2])

    constraints = utilisations
    if walled:
        reciprocal = ca.MX.sym("size", joints)
        s = ca.MX.sym("s0", _INSTANTS, joints)
        reciprocals.append(reciprocal)
        instants.append(s)
        own = spline353.position_coefficients(displacements, times)
        tables = [ca.repmat(control.T, _INSTANTS, 1) for control in own]
        positions = _bernstein(tables, s)
        per_size = ca.repmat(reciprocal.T, _INSTANTS, 1)
        constraints = [*utilisations, positions * per_size]

    return program(
        "spline353",
        variables=[y],
        parameters=[d, *reciprocals, *instants],
        objective=ca.sum1(t),
        constraints=constraints,
        options=_OPTIONS,
    )


def _bernstein(controls: Sequence[Any], s: Any) -> Any:
    """Values of Bernstein polynomials with these coefficients at `s`."""
    n = len(controls) - 1
    value = 0
    for i, control in enumerate(controls):
        basis = s**i * (1 - s) ** (n - i)
        value += comb(n, i) * control * basis
    return value
