"""The best spline of a family through the waypoints, by CasADi/IPOPT.

Variables are the times of the pieces and their Bernstein coefficients; where the pieces join, and
rest at both ends, are linear constraints on these (`trajopt.planners.spline_family`). Limits hold
at every instant: they are imposed at a few instants of each piece and joint, the true worst ones of
the answer replace the least active ones, and the solver runs again until no limit is broken in
between.
The answer is dilated by its exact factor, which by then is 1 to rounding. No dilation mends a
position: only answers that keep those limits count.

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
    "bound_relax_factor": 0.0,  # else every limit is passed by 1e-8, and no round is the last
}
# IPOPT stops close enough to an optimum: the exact dilation mends the rest.
_ENDED = ("Solve_Succeeded", "Solved_To_Acceptable_Level", "Search_Direction_Becomes_Too_Small")
# Instants per piece, joint and limit: evenly spread ones that stay, and those that move.
_STAY = 7
_MOVE = 9
_INSTANTS = _STAY + _MOVE
# Rounds of the exchange without a gain, one after another, after which it stops.
_MAX_ROUNDS_WITHOUT_GAIN = 3
# Fraction of an instant's utilisation that is remembered from round to round.
_MEMORY = 0.8
# Excess dilation at which the exchange has converged.
_DILATION_TOLERANCE = 1e-10
# Excess over a position limit at which it has converged, relative to the joint's span.
_POSITION_TOLERANCE = 1e-10
# Smallest relative gain for which another local optimum is looked for.
_GAIN_RTOL = 1e-8
# Logarithms: the largest change of a piece's time in one round.
_MAX_LOG_DECREASE = 12
_MAX_LOG_INCREASE = 5
# Ratios of times among which the starts are looked for, and the spread of their logarithms: most
# optima lie near the stop times, some far away.
_CANDIDATES = 1000
_LOG_SPREADS = (0.6, 2.0)
# Nearest other candidates that an initial guess has to be shorter than.
_NEIGHBOURS = 8
# Instants of each piece at which a candidate is dilated.
_CANDIDATE_INSTANTS = 17
# Candidates whose splines are computed at once: memory, numbers in their matrices.
_MAX_NUMBERS = 4_000_000
# Measured on up to 36 segments times moving joints, in proportion to them.
_SECONDS_PER_CELL = 0.3


@dataclass(frozen=True)
class Spline(Planner):
    """The best spline of any degrees with free times and knot derivatives (CasADi/IPOPT).

    - `degree`: of every piece;
    - `shape`: of the pieces one by one, if they differ: `4-3-4`, `3-5-3`; with more than three
      segments the middle one is repeated;
    - `ends`: at both ends without velocity and acceleration (`rest`), or without velocity alone
      (`standstill`; acceleration then jumps, so not where jerk is limited);
    - `starts`: local optima, of which the best is returned;
    - `rounds`: of the exchange at most. It ends by itself when no limit is broken any more; fewer
      leave an answer that is feasible too, but longer.

    Velocity and acceleration are continuous, jerk is only bounded. Degrees too low for rest at the
    ends, as cubics are, stand still there instead; where jerk is limited the first and the last
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
        """The best of several local optima. `stats`: times of the pieces, s; each start's outcome.

        The same answer whatever the seed.
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

    `controls` are all pieces' Bernstein coefficients, `(controls, joints)`, in the joints' spans.
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
        at: `(instants, pieces, joints)`; the first ones, evenly spread over all, stay.
        worth: the utilisation at each, or the remembered part of that of earlier rounds.
    """

    at: Array
    worth: Array

    @classmethod
    def spread(cls, pieces: int, joints: int, stay: Array) -> _SampleTimes:
        """The same on every piece: those that `stay` `(_STAY,)`, and others evenly spread."""
        between = (np.arange(_MOVE) + 0.5) / _MOVE
        one = np.concatenate([stay, between])[:, None, None]
        at = np.tile(one, (1, pieces, joints))
        return cls(at, np.zeros_like(at))

    def refined(self, used: Array, worst: Array, broken: Bools) -> _SampleTimes:
        """Replace the least active instants by the worst ones and points beside these.

        So where a limit is reached the distance between instants shrinks to a quarter, and what is
        broken in between to a sixteenth. An instant that mattered is kept for some rounds: where
        two matter in turn each would else be dropped when it is needed next.

        Args:
            used: the utilisation at each instant.
            worst: the worst of all instants, `(pieces, joints)`.
            broken: whether the limit is broken there.
        """
        below = np.where(self.at <= worst, self.at, 0.0).max(axis=0)
        above = np.where(self.at >= worst, self.at, 1.0).min(axis=0)
        added = np.stack([worst, (below + worst) / 2, (above + worst) / 2])
        worth = np.maximum(used, _MEMORY * self.worth)
        least = _STAY + np.argsort(worth[_STAY:], axis=0)[: len(added)]
        # all stay if no limit is broken
        new = np.where(broken, added, np.take_along_axis(self.at, least, axis=0))
        at = self.at.copy()
        np.put_along_axis(at, least, new, axis=0)
        renewed = np.where(broken, 1.0, np.take_along_axis(worth, least, axis=0))
        np.put_along_axis(worth, least, renewed, axis=0)
        return _SampleTimes(at, worth)


class _MovingJoints:
    """A problem whose joints all move, each in the span between its extreme waypoints.

    Attributes:
        bounds: the limits of each derivative, from velocity on, `(joints, 2)`.
        orders: up to which derivative there are limits: 2, or 3 with jerk.
        sizes: of the limits of each derivative, `(joints,)`: the wider finite side, or 1.
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
        """Time of each piece, if all stop at every waypoint, `(pieces,)`, s."""
        stop = stop_times(self.problem)
        of_segments = stop / self.family.parts
        return of_segments[list(self.family.segments)]

    def exchanged(
        self, times: Array, controls: Array, instants: list[_SampleTimes]
    ) -> tuple[float, float, list[_SampleTimes]]:
        """The exact dilation, how far a position leaves its limits, and each limit's instants.

        The true worst ones are among these; those of the position limits, if any, come last.
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
        """Lowest and highest of all controls, `(controls, joints)`, in spans.

        What waypoints and rest fix has equal ones. On a position limit a joint stands still and may
        only bend back: one control beside such a waypoint is fixed too, the next is on its side.
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
        """The dilation of candidates `(candidates, …)`, from instants of each piece only."""
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
        """The spline in s and rad."""
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
    """Times and controls to start from: local minima among splines of many ratios of times."""
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
    # a common factor of all times is no difference
    ratios = logs - logs.mean(axis=1, keepdims=True)
    chosen = _local_minima(ratios, times.sum(axis=1))[:count]
    return [(times[i], controls[i]) for i in chosen]


def _local_minima(points: Array, values: Array) -> Indices:
    """Which points have the lowest value among their neighbours, the lowest of all first."""
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
    """The local optimum from one start, its limits kept at every instant.

    It ends early where it cannot become shorter than `shortest`: with limits at a few instants a
    duration is a lower one.
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
    """One NLP from these times and controls, its limits imposed at these instants.

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
    # IPOPT's controls count in what a piece travels, for the briefest to be of order one too
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
    """In the order of `_solver`: pieces join, and all derivatives and positions keep limits."""
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
    """IPOPT for a family, with so many joints, limited up to this derivative; built once for all.

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
    """Values at `s` `(instants, joints)` of Bernstein polynomials, a row of joints a control."""
    n = len(controls) - 1
    value = 0
    for i, control in enumerate(controls):
        basis = comb(n, i) * s**i * (1 - s) ** (n - i)
        value += basis * backend("casadi").repmat(control, s.shape[0], 1)
    return value
