"""The best spline of a family through the waypoints, by CasADi/IPOPT.

Variables are the times of the pieces and their Bernstein coefficients. Continuity between pieces,
and rest at both ends, are linear constraints on these (`trajopt.planners.spline_family`).

Limits are imposed at a few instants of each piece and joint. After each run the least active
instants are replaced by the exact maximisers, and the solver runs again until no limit is broken in
between (an exchange method). Finally the answer is dilated by its exact factor, which is then 1 up
to rounding. A dilation does not change positions, so answers that break a position limit are
rejected.

    from baselines.spline import Spline
    solution = Spline(shape="4-3-4").solve(problem)
    print(solution.trajectory.duration, solution.stats["piece_times"])
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache
from math import comb
from typing import Any, Literal

import numpy as np

from baselines.ipopt import Program, flat, program, unflat
from baselines.several_starts import no_start_succeeded
from baselines.sizes import announce, cells
from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import LIMIT_NAMES
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners import spline_family
from trajopt.planners.planner import Planner, backend
from trajopt.planners.reductions import SIMPLEST, reduced
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.spline_family import SplineFamily

_OPTIONS = {
    "tol": 1e-11,
    "acceptable_tol": 1e-8,
    "max_iter": 300,
    "bound_relax_factor": 0.0,  # otherwise limits are exceeded by 1e-8, and the rounds never end
}
# Statuses with which IPOPT is close enough to an optimum; the exact dilation corrects the rest.
_ENDED = ("Solve_Succeeded", "Solved_To_Acceptable_Level", "Search_Direction_Becomes_Too_Small")
# Instants per piece, joint and limit: evenly spread ones that stay, and those that are replaced.
_STAY = 7
_MOVE = 9
_INSTANTS = _STAY + _MOVE
# The exchange stops after this many consecutive rounds without a gain.
_MAX_ROUNDS_WITHOUT_GAIN = 3
# Factor on an instant's use of a limit that is kept from one round to the next.
_MEMORY = 0.8
# Excess dilation at which the exchange has converged.
_DILATION_TOLERANCE = 1e-10
# Excess over a position limit at which it has converged, relative to the joint's span.
_POSITION_TOLERANCE = 1e-10
# A start is given up if it cannot shorten the best duration by more than this, relative.
_GAIN_RTOL = 1e-8
# Largest change of the logarithm of a piece's time in one round.
_MAX_LOG_DECREASE = 12
_MAX_LOG_INCREASE = 5
# Number of ratios of times among which the initial guesses are chosen, and standard deviations of
# their logarithms: most optima are near the stop times, some far away.
_CANDIDATES = 1000
_LOG_SPREADS = (0.6, 2.0)
# An initial guess is shorter than this many nearest other candidates.
_NEIGHBOURS = 8
# Number of instants of each piece from which a candidate's dilation is estimated.
_CANDIDATE_INSTANTS = 17
# Largest number of matrix entries for candidates whose splines are computed in one call (memory).
_MAX_NUMBERS = 4_000_000
# Measured on up to 36 segments times moving joints, in proportion to them.
_SECONDS_PER_CELL = 0.3


@dataclass(frozen=True)
class Spline(Planner):
    """The best spline of any degrees with free times and knot derivatives (CasADi/IPOPT).

    - `degree`: of every piece;
    - `shape`: of the pieces one by one, if they differ: `4-3-4`, `3-5-3`; with more than three
      segments the middle one is repeated;
    - `ends`: at both ends zero velocity and acceleration (`rest`), or zero velocity only
      (`standstill`; acceleration then jumps, so not with jerk limits);
    - `starts`: number of local optima, of which the best is returned;
    - `rounds`: largest number of rounds of the exchange. It ends earlier when no limit is broken.
      With fewer rounds the answer is feasible too, but longer.

    Velocity and acceleration are continuous; jerk may jump. Degrees too low for zero acceleration
    at the ends, such as cubics, have zero velocity only. With jerk limits their first and last
    segment have one more knot each.
    """

    degree: Literal[3, 5, 7] = 5
    shape: str = ""
    ends: Literal["rest", "standstill"] = "rest"
    starts: int = 4
    rounds: int = 20

    on_request = True
    requires = ("casadi",)
    knows = LIMIT_NAMES

    def __post_init__(self) -> None:
        for name in ("starts", "rounds"):
            if getattr(self, name) < 1:
                raise InvalidInput(name, "at least 1", value=getattr(self, name))
        if self.shape:
            spline_family.degrees(self.shape)

    def unsupported(self, problem: Problem) -> str | None:
        if self.ends == "standstill" and problem.has("jerk"):
            return "without rest at its ends acceleration jumps there, and jerk is limited"
        try:
            self._family(SIMPLEST.apply(problem))
        except InvalidInput as error:
            return str(error)
        return None

    def _family(self, problem: Problem) -> SplineFamily:
        shape = self.shape or str(self.degree)
        return spline_family.family(
            shape, problem.segments, self.ends, jerk_limited=problem.has("jerk")
        )

    @reduced(SIMPLEST)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best of several local optima.

        `stats`: times of the pieces, s; status and duration, s, of each start. The answer does not
        depend on the seed.
        """
        announce("spline", problem, _SECONDS_PER_CELL * cells(problem))
        motion = _MovingJoints(problem, self._family(problem))
        began = time.perf_counter()
        position_limited = motion.room is not None
        solver = _solver(motion.family, motion.joints, motion.orders, position_limited)
        setup_time = time.perf_counter() - began

        optima: list[_ExchangeOptimum] = []
        for start in _starts(motion, self.starts):
            shortest = min((optimum.duration for optimum in optima), default=np.inf)
            optimum = _exchange(solver, motion, start, shortest, self.rounds)
            optima.append(optimum)
        statuses = [optimum.status for optimum in optima]
        durations = [optimum.duration for optimum in optima]
        stats: dict[str, Any] = {"start_status": statuses, "start_duration": np.array(durations)}
        best = optima[int(np.argmin(durations))]
        if not best.duration < np.inf:
            return Solution(
                Status.FAILED,
                message=no_start_succeeded(statuses),
                setup_time=setup_time,
                stats=stats,
            )
        stats["piece_times"] = best.times
        return Solution(Status.SOLVED, motion.trajectory(best), setup_time=setup_time, stats=stats)


@dataclass(frozen=True, eq=False)
class _ExchangeOptimum:
    """The result of the exchange from one initial guess: feasible, or of infinite duration.

    `controls` are the Bernstein coefficients of all pieces, `(controls, joints)`, in units of each
    joint's span.
    """

    times: Array
    controls: Array
    status: str

    @property
    def duration(self) -> float:
        return float(self.times.sum())


@dataclass(frozen=True, eq=False)
class _SampleTimes:
    """The instants at which a limit is imposed on each piece, on the unit interval.

    Attributes:
        at: `(instants, pieces, joints)`; the first `_STAY` of them, evenly spread, never change.
        worth: use of the limit at each, or the part kept from earlier rounds if that is larger.
    """

    at: Array
    worth: Array

    @classmethod
    def spread(cls, pieces: int, joints: int, stay: Array) -> _SampleTimes:
        """Return the same instants on every piece: `stay`, `(_STAY,)`, and others in between."""
        between = (np.arange(_MOVE) + 0.5) / _MOVE
        one = np.concatenate([stay, between])[:, None, None]
        at = np.tile(one, (1, pieces, joints))
        return cls(at, np.zeros_like(at))

    def refined(self, used: Array, worst: Array, broken: Bools) -> _SampleTimes:
        """Return the instants with the least active ones replaced by the worst and its neighbours.

        So where a limit is active the distance between instants falls to a quarter in each round,
        and the excess in between to a sixteenth. An active instant is kept for some rounds after
        it has become inactive, since two instants may be active in turn.

        Args:
            used: use of the limit at each instant.
            worst: the instant of the exact maximum, `(pieces, joints)`.
            broken: whether the limit is broken there.
        """
        below = np.where(self.at <= worst, self.at, 0.0).max(axis=0)
        above = np.where(self.at >= worst, self.at, 1.0).min(axis=0)
        added = np.stack([worst, (below + worst) / 2, (above + worst) / 2])
        worth = np.maximum(used, _MEMORY * self.worth)
        least = _STAY + np.argsort(worth[_STAY:], axis=0)[: len(added)]
        # without a broken limit no instant changes
        new = np.where(broken, added, np.take_along_axis(self.at, least, axis=0))
        at = self.at.copy()
        np.put_along_axis(at, least, new, axis=0)
        renewed = np.where(broken, 1.0, np.take_along_axis(worth, least, axis=0))
        np.put_along_axis(worth, least, renewed, axis=0)
        return _SampleTimes(at, worth)


class _MovingJoints:
    """A problem whose joints all move, in units of the span between each joint's waypoints.

    Attributes:
        bounds: the limits of each derivative, from velocity on, `(joints, 2)`.
        orders: the highest derivative with limits: 2, or 3 with jerk.
        sizes: sizes of the limits of each derivative, `(joints,)`: the wider finite side, or 1.
        room: the position limits from the start of each piece's segment, `(pieces, joints, 2)`, in
            spans; None without any.
    """

    def __init__(self, problem: Problem, family: SplineFamily) -> None:
        self.problem = problem
        self.family = family
        self.span = np.ptp(problem.waypoints, axis=0)
        self.displacements = problem.displacements / self.span
        self.joints = len(self.span)
        limits = problem.limits
        pairs = [limits.velocity, limits.acceleration]
        if problem.has("jerk"):
            pairs.append(limits.jerk)
        self.bounds = [pair / self.span[:, None] for pair in pairs]
        self.orders = len(pairs)
        self.sizes = [_sizes(bounds) for bounds in self.bounds]
        self.room: Array | None = None
        if problem.has("position"):
            starts = problem.waypoints[list(family.segments), :, None]
            self.room = (limits.position - starts) / self.span[:, None]

    def stop_times(self) -> Array:
        """Return the time of each piece if all joints stop at every waypoint, s, `(pieces,)`."""
        stop = stop_times(self.problem)
        of_segments = stop / self.family.parts
        return of_segments[list(self.family.segments)]

    def exchanged(
        self, times: Array, controls: Array, instants: list[_SampleTimes]
    ) -> tuple[float, float, list[_SampleTimes]]:
        """Return the exact dilation, the excess over position limits, and each limit's instants.

        The exact maximisers are among these instants. Those of position limits come last.
        """
        unit = self.family.powers(controls)
        dilation = 0.0
        exchanged = []
        for order, (bounds, old) in enumerate(zip(self.bounds, instants, strict=False), start=1):
            worst, highest = spline_family.peaks(unit, times, order, bounds)
            # dilating by k divides a derivative of order r by k^r
            factor = float(highest.max()) ** (1 / order)
            dilation = max(dilation, factor)
            rate = polynomials.derivative(unit, order)
            used = spline_family.utilisation(rate, old.at, times, order, bounds)
            new = old.refined(used, worst, highest > 1)
            exchanged.append(new)
        if self.room is None:
            return dilation, 0.0, exchanged
        *_, old = instants
        worst, beyond = spline_family.farthest(unit, self.room)
        used = 1 + spline_family.excess(unit[:, None], old.at, self.room)
        exchanged.append(old.refined(used, worst, beyond > _POSITION_TOLERANCE / 10))
        return dilation, float(beyond.max()), exchanged

    def control_bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds of all controls, `(controls, joints)`, in spans.

        They are equal for controls that waypoints and rest determine. At a waypoint on a position
        limit the joint has no velocity and accelerates inwards only. So the control beside it is
        fixed too, and the next one is bounded by the limit.
        """
        is_fixed, fixed = self.family.fixed(self.displacements)
        held = is_fixed[:, None]
        low = np.where(held, fixed, -np.inf)
        high = np.where(held, fixed, np.inf)
        if self.room is None:
            return low, high
        firsts = np.cumsum([0, *self.family.lengths])
        for piece in range(self.family.pieces):
            own = slice(firsts[piece], firsts[piece + 1])
            for order in (slice(None), slice(None, None, -1)):
                # views: from the piece's start, and from its end
                lows = low[own][order]
                highs = high[own][order]
                limits = self.room[piece].T
                held_on_limit = (lows[0] == limits) & (lows[0] == highs[0])
                touching = held_on_limit.any(axis=0)
                on_limit = lows[0, touching]
                lows[1, touching] = on_limit
                highs[1, touching] = on_limit
                lowest, highest = limits[:, touching]
                lows[2, touching] = np.maximum(lows[2, touching], lowest)
                highs[2, touching] = np.minimum(highs[2, touching], highest)
        return low, high

    def estimated(self, times: Array, controls: Array) -> Array:
        """Return an estimate of the dilation of candidates, from a few instants of each piece."""
        unit = self.family.powers(np.moveaxis(controls, 0, 1))
        points = np.linspace(0.0, 1.0, _CANDIDATE_INSTANTS)
        dilation = np.zeros(len(times))
        for order, bounds in enumerate(self.bounds, start=1):
            rate = polynomials.derivative(unit, order)
            low, high = bounds.T
            scale = times.T[:, :, None] ** order
            for s in points:
                values = polynomials.evaluate(rate, np.array(s)) / scale
                used = np.maximum(values / high, values / low)
                highest = used.max(axis=(0, 2))
                dilation = np.maximum(dilation, highest ** (1 / order))
        return dilation

    def trajectory(self, optimum: _ExchangeOptimum) -> Trajectory:
        """Return the spline as a trajectory, in s and rad."""
        unit = self.family.powers(optimum.controls)
        coefficients = unit * self.span
        coefficients[-1] += self.problem.waypoints[list(self.family.segments)]
        coefficients = polynomials.stretched(coefficients, 1 / optimum.times)
        passed = np.cumsum(optimum.times)
        breaks = np.concatenate([[0.0], passed])
        ends = np.cumsum([0, *self.family.parts])
        return Trajectory(breaks, coefficients, breaks[ends])


def _sizes(bounds: Array) -> Array:
    finite = np.where(np.isfinite(bounds), np.abs(bounds), 0.0)
    widest = finite.max(axis=1)
    return np.where(widest > 0, widest, 1.0)


def _starts(motion: _MovingJoints, count: int) -> list[tuple[Array, Array]]:
    """Yield initial times and controls: local minima among splines of many ratios of times."""
    pieces = motion.family.pieces
    size = (sum(motion.family.lengths) + 3 * pieces) ** 2
    candidates = min(_CANDIDATES, _MAX_NUMBERS // size)
    rng = np.random.default_rng(pieces)
    spreads = np.resize(_LOG_SPREADS, max(candidates, count))
    logs = spreads[:, None] * rng.standard_normal((len(spreads), pieces))
    logs[0] = 0.0
    if pieces == 1:
        logs = logs[:1]
    times = motion.stop_times() * np.exp(logs)
    controls = motion.family.smoothest(motion.displacements, times)
    times *= motion.estimated(times, controls)[:, None]
    # a common factor of all times makes no difference
    ratios = logs - logs.mean(axis=1, keepdims=True)
    chosen = _local_minima(ratios, times.sum(axis=1))[:count]
    return [(times[i], controls[i]) for i in chosen]


def _local_minima(points: Array, values: Array) -> Indices:
    """Return the points that are lower than their nearest neighbours, the lowest first."""
    import scipy  # late: planners that are only listed need none of it

    neighbours = min(_NEIGHBOURS, len(points) - 1)
    tree = scipy.spatial.KDTree(points)
    _, nearest = tree.query(points, k=np.arange(1, neighbours + 2))
    around = values[nearest].min(axis=1)
    lowest = np.flatnonzero(values <= around)
    return lowest[np.argsort(values[lowest])]


def _exchange(
    solver: Program,
    motion: _MovingJoints,
    start: tuple[Array, Array],
    shortest: float,
    most_rounds: int,
) -> _ExchangeOptimum:
    """Return the local optimum from one initial guess, with its limits kept at every instant.

    The search ends early if it cannot become shorter than `shortest`: with limits at a few instants
    only, the duration is a lower bound of its result.
    """
    times, controls = start
    family = motion.family
    best = _ExchangeOptimum(np.full(family.pieces, np.inf), controls, "")
    rounds_without_gain = 0
    instants = []
    for order in range(1, motion.orders + 1):
        stay = np.linspace(0.0, 1.0, _STAY)
        if order in spline_family.SMOOTH_ORDERS:
            # a continuous rate is limited at the end of a piece, not at its start
            stay = np.linspace(0.0, 1.0, 1 + _STAY)[1:]
        instants.append(_SampleTimes.spread(family.pieces, motion.joints, stay))
    if motion.room is not None:
        # without the ends of pieces, which mostly are waypoints
        inner = np.linspace(0.0, 1.0, 2 + _STAY)[1:-1]
        instants.append(_SampleTimes.spread(family.pieces, motion.joints, inner))
    status = ""
    _, _, instants = motion.exchanged(times, controls, instants)
    for _ in range(most_rounds):
        status, answer = _solve_at(solver, motion, times, controls, instants)
        if answer is None:
            break
        times, controls = answer
        dilation, excess, instants = motion.exchanged(times, controls, instants)
        feasible = dilation * times
        kept = excess < _POSITION_TOLERANCE
        if best.duration < np.inf:
            rounds_without_gain += 1
        if kept and feasible.sum() < best.duration:
            best = _ExchangeOptimum(feasible, controls, status)
            rounds_without_gain = 0
        converged = kept and dilation - 1 < _DILATION_TOLERANCE
        if converged or times.sum() > shortest * (1 - _GAIN_RTOL):
            break
        if rounds_without_gain == _MAX_ROUNDS_WITHOUT_GAIN:
            break
    if answer is not None and not best.duration < np.inf:
        status = f"leaves a position limit after {most_rounds} rounds"
    return _ExchangeOptimum(best.times, best.controls, status)


def _solve_at(
    solver: Program,
    motion: _MovingJoints,
    times: Array,
    controls: Array,
    instants: list[_SampleTimes],
) -> tuple[str, tuple[Array, Array] | None]:
    """Solve the program from these times and controls, with limits at these instants.

    Returns:
        IPOPT's status, and the new times and controls; None where it failed.
    """
    family = motion.family
    unit = float(times.mean())
    sizes = []
    for order, size in enumerate(motion.sizes, start=1):
        sizes.append(size * unit**order)
    y = np.log(times / unit)
    low, high = motion.control_bounds()
    # IPOPT's controls are in units of each piece's displacement: those of short pieces are then of
    # order one too
    reach = times / unit
    of_controls = np.repeat(reach, family.lengths)[:, None]
    per_piece = [own.at[:, k] for own in instants for k in range(family.pieces)]
    run = solver(
        start=flat(y, controls / of_controls),
        parameters=flat(reach, *sizes, *per_piece),
        bounds=(
            flat(y - _MAX_LOG_DECREASE, low / of_controls),
            flat(y + _MAX_LOG_INCREASE, high / of_controls),
        ),
        constraint_bounds=_constraint_bounds(motion),
    )
    if run.status not in _ENDED or not np.isfinite(run.x).all():
        return run.status, None
    logs, moved = unflat(run.x, [y.shape, controls.shape])
    new_times = np.exp(logs) * unit
    joined = family.joined(moved * of_controls, new_times)
    return run.status, (new_times, joined)


def _constraint_bounds(motion: _MovingJoints) -> tuple[Array, Array]:
    """Return bounds of the constraints of `_solver`: continuity, then derivatives and positions."""
    family = motion.family
    joining = np.zeros(family.joins_count * motion.joints)
    lows = [joining]
    highs = [joining]
    for bounds, size in zip(motion.bounds, motion.sizes, strict=True):
        low, high = bounds.T / size
        of_piece = np.repeat(low, _INSTANTS)
        lows.append(np.tile(of_piece, family.pieces))
        of_piece = np.repeat(high, _INSTANTS)
        highs.append(np.tile(of_piece, family.pieces))
    if motion.room is not None:
        sides = motion.room.reshape(-1, 2).T
        low, high = np.repeat(sides, _INSTANTS, axis=1)
        lows.append(low)
        highs.append(high)
    return np.concatenate(lows), np.concatenate(highs)


@cache
def _solver(family: SplineFamily, joints: int, orders: int, position_limited: bool) -> Program:
    """Return IPOPT's program for a family, a number of joints and the highest limited derivative.

    It is built once for all problems of this size.

    Constraints: differences where pieces join; then every derivative over the size of its limits,
    at the instants of every piece; then the positions, where these are limited.
    """
    ca = backend("casadi")
    y = ca.SX.sym("y", family.pieces)
    b = ca.SX.sym("b", sum(family.lengths), joints)
    reach = ca.SX.sym("reach", family.pieces)
    times = ca.vertsplit(ca.exp(y))
    controls = []
    begin = 0
    for piece, length in enumerate(family.lengths):
        own = b[begin : begin + length, :] * reach[piece]
        controls.append(ca.vertsplit(own))
        begin += length

    sizes = []
    instants = []
    used = []
    for order in range(1, orders + 1):
        size = ca.SX.sym(f"size{order}", joints)
        sizes.append(size)
        for own, duration in zip(controls, times, strict=True):
            s = ca.SX.sym("s", _INSTANTS, joints)
            instants.append(s)
            # d^r q/dt^r = d^r q/ds^r / T^r
            rate = spline_family.derivative(own, order)
            limit = ca.repmat(size.T, _INSTANTS, 1) * duration**order
            used.append(_bernstein(rate, s) / limit)
    if position_limited:
        for own in controls:
            s = ca.SX.sym("s", _INSTANTS, joints)
            instants.append(s)
            used.append(_bernstein(own, s))

    return program(
        "spline",
        variables=[y, b],
        parameters=[reach, *sizes, *instants],
        objective=ca.sum1(ca.exp(y)),
        constraints=[*family.joins(controls, times), *used],
        options=_OPTIONS,
    )


def _bernstein(controls: list[Any], s: Any) -> Any:
    """Return values of Bernstein polynomials at `s`, `(instants, joints)`; controls are rows."""
    n = len(controls) - 1
    value = 0
    for i, control in enumerate(controls):
        basis = comb(n, i) * s**i * (1 - s) ** (n - i)
        value += basis * backend("casadi").repmat(control, s.shape[0], 1)
    return value
