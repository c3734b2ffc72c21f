"""The general transcription, by CasADi/IPOPT: acceleration, or jerk where limited, in steps.

Each segment is cut into equal intervals. A joint's acceleration (its jerk, where that is limited)
is constant over an interval; states at the nodes and segment times are the variables. Limits
between nodes are imposed on Bernstein coefficients, so they hold at every instant. This restricts
the problem: the optimum approaches the exact one from above as `intervals` grows. Every kind of
limit is supported. With `free` nodes each joint chooses the lengths of its own intervals, which
`baselines.collocation.refined` uses.

    from baselines.collocation.uniform import Collocation
    solution = Collocation(intervals=40).solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from baselines.collocation import asked
from baselines.collocation.asked import Curves
from baselines.exact.acceleration import gaps
from baselines.exact.jerk import one_sided
from baselines.exact.method.scaled import Scaled
from baselines.ipopt import Options, flat, program, unflat
from baselines.sizes import announce, cells
from trajopt.core.arrays import Array, Bools
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Planner, backend
from trajopt.planners.reductions import EQUAL_WAYPOINTS, RESTING_UNCOUPLED, reduced

# Every kind of limit that has rows, and every demand but waits: at these the route is split first.
KNOWN = ("rows", "segment", *(key for key, demand in DEMANDS.items() if not demand.splits))
# An expression of constraints with its lowest and highest values.
Constraints = tuple[Any, Any, Any]

_OPTIONS: Options = {
    "tol": 1e-9,
    "constr_viol_tol": 1e-11,
    "bound_relax_factor": 0.0,
    "max_iter": 3000,
}
# Free nodes start near the optimum: a small initial barrier keeps them there.
_WARM_OPTIONS: Options = {
    **_OPTIONS,
    "tol": 1e-8,
    "mu_init": 1e-6,
    "bound_push": 1e-7,
    "bound_frac": 1e-7,
    "max_iter": 400,
}
# IPOPT's time, s per interval of all joints (measured up to 7000).
_SECONDS_PER_INTERVAL = 2e-3
# Jerk, in the grid's units, where a row bends the acceleration and nothing limits its jerk.
_STEEPEST = 1e5
# Added to a point's variables, so that none of them is 0.
_SOMEWHERE = 0.1
# A waypoint this close to a position limit is on it, in the grid's units.
_TOUCH_DISTANCE = 1e-9
# Shortest free interval, relative to equal intervals of the shortest segment time.
_SHORTEST_SHARE = 1e-3
# Weight, in the objective, of the mean squared change of free intervals from their initial lengths.
# It makes the solution unique where several lengths give one motion.
_DRIFT_WEIGHT = 1e-4
# Longest motion, relative to the time of stopping at every waypoint; and the largest dilation of
# that time with limits that `exact` does not know.
_LONGEST = 1.5
# With rows of several joints, or with acceleration, for which `stopping` takes twice that time.
_LONGEST_CURVED = 3.0
_SLOWEST = 1e3
# Longest time that a joint which begins or ends in motion may take more, in times of stopping.
_RETURNS = 6.0


@dataclass(frozen=True)
class Collocation(Planner):
    """Piecewise-constant acceleration or jerk (CasADi/IPOPT), under every kind of limit."""

    intervals: int = 20

    requires = ("casadi",)
    knows = KNOWN

    def __post_init__(self) -> None:
        if self.intervals < 2:
            raise InvalidInput("intervals", "at least 2 per segment", value=self.intervals)

    def unsupported(self, problem: Problem) -> str | None:
        return unsupported(problem)

    @reduced(EQUAL_WAYPOINTS, RESTING_UNCOUPLED)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return a local optimum from a straight-line start that stops at every waypoint.

        With velocities at the ends the possible times of the first and the last segment have gaps.
        Then it is the shortest local optimum of this initial guess and of one in every interval
        between gaps (`baselines.exact.acceleration.gaps`).
        """
        intervals = self.intervals * cells(problem)
        announce("collocation", problem, _SECONDS_PER_INTERVAL * intervals)
        grid = CollocationGrid(problem, self.intervals)
        began = time.perf_counter()
        solve = transcription(grid)
        setup_time = time.perf_counter() - began
        optimum = min((solve(grid, start) for start in grid.starts()), key=_rank)
        stats = {"ipopt_status": optimum.status}
        if not optimum.success:
            message = f"IPOPT: {optimum.status}"
            return Solution(Status.FAILED, message=message, setup_time=setup_time, stats=stats)
        answer = grid.trajectory(optimum.nodes)
        return Solution(Status.SOLVED, answer, setup_time=setup_time, stats=stats)


def unsupported(problem: Problem) -> str | None:
    """Return why no transcription has an optimum; None if it may."""
    limits = problem.limits
    if (problem.moving & (limits.smooth > 1) & ~limits.jerk_limited).any():
        return "a joint whose acceleration must be continuous has no jerk limit"
    return one_sided.unsupported(problem)


class Nodes(NamedTuple):
    """A transcribed motion of the moving joints, without units; all segments one after another.

    Arrays, CasADi's symbols, or their shapes.

    Attributes:
        times: Segment times `(segments,)`.
        lengths: Lengths of the intervals, `(intervals, joints)`.
        q: Position at the nodes, `(intervals + 1, joints)`.
        v: Velocity at the nodes.
        a: Acceleration at the nodes; used where jerk is limited.
    """

    times: Any
    lengths: Any
    q: Any
    v: Any
    a: Any


class CollocationOptimum(NamedTuple):
    """IPOPT's status, its success, and its last nodes."""

    status: str
    success: bool
    nodes: Nodes


def _rank(optimum: CollocationOptimum) -> tuple[bool, float]:
    return not optimum.success, float(optimum.nodes.times.sum())


class CollocationGrid:
    """Joints, which all move, in their own units: mean stop time, acceleration limits of order one.

    Attributes:
        intervals: Number of intervals per segment.
        bent: Which joints' accelerations rows of limits bend.
        smooth: Which joints have a continuous acceleration: those with a jerk limit.
        ends: Velocity and acceleration at both ends, `(2 ends, 2, joints)`.
        free: The waypoints whose states are variables: the inner ones, and the last one of a closed
            motion.
        held: Waypoints and joints whose velocity is fixed: both ends, and waypoints on a position
            limit, where it is 0, or the NLP would have no interior. A closed motion's ends are
            free.
        resting: Those of them without velocity.
        still: Joints that begin, and end, without velocity and acceleration, `(2 ends, joints)`.
        tolerance: How far waypoints may be missed, `(waypoints, joints)`.
    """

    def __init__(self, problem: Problem, intervals: int, *, bends: bool = False) -> None:
        """Prepare the numbers of a grid.

        Args:
            problem: its joints all move.
            intervals: of each segment.
            bends: whether acceleration is linear in an interval, not constant, where rows of limits
                bend it. With free intervals it may still jump, nearly: an interval may be brief.
        """
        limits = problem.limits
        waypoints = problem.waypoints
        scaled = Scaled(problem)
        unit = scaled.unit
        ask = asked.of(problem, intervals)
        scale = np.abs(ask.boxes[2]).min(axis=(0, 1)) * unit**2

        self.problem = problem
        self.intervals = intervals
        self.unit = unit
        self.scale = scale
        self.origin = waypoints[0]
        self.stop = scaled.stop
        self.waypoints = (waypoints - self.origin) / scale
        self.asked = ask
        # (2, intervals, joints): lowest and highest
        self.position = (ask.boxes[0] - self.origin) / scale
        self.velocity, self.acceleration, self.jerk, self.leaving = (
            own / scale * unit**order
            for own, order in zip((*ask.boxes[1:], ask.leaving), (1, 2, 3, 1), strict=True)
        )
        self.bent = asked.bent(problem)
        bent = self.bent & bends
        self.jerk = np.where(bent & np.isinf(self.jerk), np.sign(self.jerk) * _STEEPEST, self.jerk)
        self.smooth = tuple((bent | (limits.smooth > 1)).tolist())
        self.boxed = bool(np.isfinite(self.position).any())
        # the same at the nodes
        self.reach = np.array([_at_nodes(own, side) for side, own in enumerate(self.position)])
        route = problem.route
        self.closed = scaled.closed
        self.tolerance = route.demand("tolerance") / scale
        self.least = scaled.least
        self.given = "given_times" in problem.demands
        self.ends = np.array([route.start, route.end]) / scale
        self.ends *= np.array([unit, unit**2])[:, None]
        self.free = slice(1, None if self.closed else -1)
        self.still = ~self.ends.any(axis=1) & (not self.closed)
        distances = np.abs(self.waypoints[:, None] - self.position[:, 0])
        self.held = (distances.min(axis=1) <= _TOUCH_DISTANCE) & (self.tolerance == 0)
        self.resting = self.held.copy()
        if not self.closed:
            self.held[[0, -1]] = True
            self.resting[[0, -1]] = self.ends[:, 0] == 0
        self.slower = 1.0
        self.slower = max(1.0, self.dilation(self.trajectory(self.stopping())))

    @property
    def longest(self) -> float:
        """Longest total time."""
        velocity, acceleration = np.abs(self.ends).max(axis=0)
        weakest, gentlest = (np.abs(own).min(axis=(0, 1)) for own in (self.acceleration, self.jerk))
        # of a joint in motion: to end its acceleration and its velocity
        ends = velocity / weakest + acceleration / gentlest + np.sqrt(velocity / gentlest)
        returning = _RETURNS * ends.max()
        slow = self.asked.together or self.bent.any()
        longest = _LONGEST_CURVED if slow else _LONGEST
        return float(longest * self.slower * (self.stop.sum() + returning))

    def dilation(self, motion: Trajectory) -> float:
        """Return the least dilation that keeps the limits that `exact` does not know.

        It is at most the largest one tried, and 0 without such limits.
        """
        kinds = self.problem.limits.kinds
        others = (kinds[key] for key in self.problem.limits.beyond_rates if kinds[key].is_ratio)
        found = (own.dilation(own.worst(motion), motion) for own in others)
        return min(max(found, default=0.0), _SLOWEST)

    def stopping(self) -> Nodes:
        """Return the initial guess: stops at every waypoint, in at least twice the stop times."""
        times = 2 * self.slower * self.stop
        return self.cubics(times, np.zeros_like(self.waypoints[self.free]))

    def starts(self) -> Iterator[Nodes]:
        """Yield `stopping`, and with velocities at the ends one in every interval between gaps."""
        yield self.stopping()
        if self.problem.route.at_rest:
            return
        scaled = Scaled(self.problem, jerk=False)
        speed = scaled.units[2] * self.unit / self.scale
        for times, velocities in gaps.starts(scaled):
            yield self.cubics(times * scaled.unit / self.unit, velocities * speed)

    def cubics(self, times: Array, velocities: Array) -> Nodes:
        """Return equal intervals of one cubic per segment.

        Args:
            times: Segment times, `(segments,)`.
            velocities: At the `free` waypoints, rows of `(joints,)`.
        """
        t = times[:, None, None]
        h = np.diff(self.waypoints, axis=0)[:, None]
        start = self.waypoints[:-1, None]
        before, after = self.ends[:, 0]
        rows = [velocities[-1:], velocities] if self.closed else [before, velocities, after]
        ends = np.vstack(rows)[:, None]
        s = np.arange(self.intervals)[:, None] / self.intervals

        # q(s) = q0 + u t s + (3h − 2ut − wt) s² + (ut + wt − 2h) s³, with s = time/t
        first = ends[:-1] * t
        last = ends[1:] * t
        square = 3 * h - 2 * first - last
        cube = first + last - 2 * h
        curve = square + s * cube
        slope = 2 * square + 3 * s * cube
        bend = 2 * square + 6 * s * cube
        q = start + s * (first + s * curve)
        v = (first + s * slope) / t
        a = bend / t**2
        equal = np.repeat(times / self.intervals, self.intervals)
        return Nodes(
            times,
            np.tile(equal[:, None], len(self.scale)),
            self._joined(q, self.waypoints[-1:]),
            self._joined(v, ends[-1]),
            self._joined(a, self.ends[1:, 1]),
        )

    def _joined(self, states: Array, end: Array) -> Array:
        """Join states `(segments, intervals, joints)` and the last node's."""
        return np.vstack([states.reshape(-1, len(self.scale)), end])

    def position_bounds(self) -> list[Array]:
        """Return bounds of both inner Bernstein coefficients of position in every interval.

        `(intervals, joints)` each: lowest and highest of the first, then of the second. Beside a
        waypoint at rest one coefficient is that waypoint and needs no bound (the single one without
        jerk limits, on either side). Where acceleration vanishes at an end too, both are free.
        """
        size = self.intervals
        low, high = self.position
        first = np.zeros(low.shape, dtype=bool)
        second = np.zeros(low.shape, dtype=bool)
        first[::size] = self.resting[:-1]
        second[size - 1 :: size] = self.resting[1:]
        single = ~np.array(self.smooth)
        first |= second & single
        tables = []
        for free in (first, second):
            free[[0, -1]] |= self.still
            tables += [np.where(free, -np.inf, low), np.where(free, np.inf, high)]
        return tables

    def velocity_bounds(self) -> list[Array]:
        """Return the lowest and highest velocity of every interval, `(intervals, joints)` each."""
        low, high = self.leaving
        return [np.maximum(self.velocity[0], low), np.minimum(self.velocity[1], high)]

    def slopes(self, nodes: Nodes) -> tuple[Array, Array]:
        """Return the acceleration at the start of every interval, and the jerk in it."""
        slope = np.diff(nodes.v, axis=0) / nodes.lengths
        jerk = np.diff(nodes.a, axis=0) / nodes.lengths
        acceleration = np.where(self.smooth, nodes.a[:-1], slope)
        return acceleration, np.where(self.smooth, jerk, 0.0)

    def halved(self, nodes: Nodes) -> Nodes:
        """Cut every interval in two, without changing the motion."""
        half = nodes.lengths / 2
        slope, jerk = self.slopes(nodes)
        q = nodes.q[:-1]
        v = nodes.v[:-1]
        # Taylor's formula at half the interval
        middle_q = q + half * (v + half * (slope / 2 + half * jerk / 6))
        middle_v = v + half * (slope + half * jerk / 2)
        middle_a = np.where(self.smooth, slope + half * jerk, 0.0)
        return Nodes(
            nodes.times,
            np.repeat(half, 2, axis=0),
            _interleaved(nodes.q, middle_q),
            _interleaved(nodes.v, middle_v),
            _interleaved(nodes.a, middle_a),
        )

    def trajectory(self, nodes: Nodes) -> Trajectory:
        """Return the pieces between the nodes as a trajectory, every joint on its own breaks."""
        at = _from_zero(nodes.times) * self.unit
        breaks = _from_zero(nodes.lengths) * self.unit
        breaks[:: self.intervals] = at[:, None]

        # q + v t + a/2 t² + j/6 t³, back in rad and s
        slope, jerk = self.slopes(nodes)
        parts = np.stack([jerk / 6, slope / 2, nodes.v[:-1], nodes.q[:-1]])
        powers = np.array([3, 2, 1, 0])[:, None, None]
        parts *= self.scale / self.unit**powers
        parts[3] += self.origin
        joints = [(breaks[:, i], parts[:, :, i]) for i in range(len(self.scale))]
        return Trajectory.joined(joints, at)


def _from_zero(lengths: Array) -> Array:
    """Return the ends of intervals of these lengths, from 0, along the first axis."""
    ends = np.cumsum(lengths, axis=0)
    return np.concatenate([np.zeros_like(ends[:1]), ends])


def _interleaved(states: Array, middles: Array) -> Array:
    """Insert the states at the intervals' middles between those at the nodes."""
    doubled = np.repeat(states, 2, axis=0)[:-1]
    doubled[1::2] = middles
    return doubled


class Transcription:
    """One NLP for all problems of one size; numbers and bounds are parameters."""

    def __init__(
        self,
        segments: int,
        intervals: int,
        smooth: tuple[bool, ...],
        boxed: bool,
        closed: bool,
        free: bool,
        curves: Curves,
    ) -> None:
        ca = backend("casadi")
        joints = len(smooth)
        pieces = segments * intervals
        states = (pieces + 1, joints)
        self.ca = ca
        self.joints = joints
        self.nodes = pieces + 1
        self.intervals = intervals
        self.free = free
        self.curves = curves
        own = 1 if curves.together else joints  # columns of lengths
        self.shapes = Nodes(
            times=(segments, 1), lengths=(pieces, own), q=states, v=states, a=states
        )

        x = Nodes(
            times=ca.MX.sym("t", segments),
            lengths=ca.MX.sym("l", pieces, own),
            q=ca.MX.sym("q", *states),
            v=ca.MX.sym("v", *states),
            a=ca.MX.sym("a", *states),
        )
        equal = ca.vec(ca.repmat(x.times.T / intervals, intervals, 1))
        limits = {
            kind: [ca.MX.sym(f"{kind}{side}", pieces, joints) for side in range(2)]
            for kind in ("acceleration", "jerk")
        }
        self.velocities = [ca.MX.sym(f"velocity{i}", pieces, joints) for i in range(2)]
        positions = [ca.MX.sym(f"position{i}", pieces, joints) for i in range(4)]
        longest = ca.MX.sym("longest")
        start_lengths = ca.MX.sym("start", pieces, joints)
        lengths = x.lengths if free else equal
        motion = x._replace(lengths=ca.repmat(lengths, 1, joints // lengths.shape[1]))
        duration = ca.sum1(x.times)
        constraints: list[Constraints] = [(longest - duration, 0.0, np.inf)]
        for joint, is_smooth in enumerate(smooth):
            constraints += self._joint(motion, joint, limits, is_smooth, positions if boxed else [])
        if closed:
            zero = ca.DM.zeros(1, joints)
            constraints += [(own[0, :] - own[-1, :], zero, zero) for own in (x.v, x.a)]
        options = _OPTIONS
        objective = duration
        if free:
            options = _WARM_OPTIONS
            constraints += self._filling(x)
            drift = intervals * (motion.lengths - start_lengths)
            objective += _DRIFT_WEIGHT * ca.sumsqr(drift) / drift.numel()
        rows = curves.constraints(motion, smooth)
        constraints += rows  # the last ones

        parameters = [
            *limits["acceleration"],
            *limits["jerk"],
            *self.velocities,
            *positions,
            longest,
            start_lengths,
            *(bound for _, *both in rows for bound in both),
        ]
        expressions, lows, highs = zip(*constraints, strict=True)
        self.solver = program(
            "collocation",
            variables=self._varied(x),
            parameters=parameters,
            objective=objective,
            constraints=expressions,
            options=options,
        )
        low = ca.vertcat(*map(ca.vec, lows))
        high = ca.vertcat(*map(ca.vec, highs))
        self.edges = ca.Function("edges", parameters, [low, high])

    def _varied(self, tables: Nodes) -> list[Any]:
        """Return the tables that are variables of the NLP."""
        if self.free:
            return list(tables)
        return [tables.times, tables.q, tables.v, tables.a]

    def _filling(self, x: Nodes) -> list[Constraints]:
        """Constrain free intervals to fill their segment."""
        ca = self.ca
        constraints: list[Constraints] = []
        for joint in range(x.lengths.shape[1]):
            by_segment = ca.reshape(x.lengths[:, joint], self.intervals, -1)
            excess = ca.sum1(by_segment).T - x.times
            zero = ca.DM.zeros(excess.shape)
            constraints.append((excess, zero, zero))
        return constraints

    def _joint(
        self, x: Nodes, joint: int, limits: dict[str, Any], smooth: bool, position_bounds: list[Any]
    ) -> list[Constraints]:
        """Return one joint's constraints, each with a value per interval."""
        ca = self.ca
        pieces = self.nodes - 1
        zero = ca.DM.zeros(pieces)
        infinite = ca.DM.inf(pieces)
        lengths = x.lengths[:, joint]
        (q, _), (v, _), (a, _), _ = asked.polynomials(x, joint, smooth)

        def limit(kind: str, side: int) -> Any:
            return limits[kind][side][:, joint]

        # low l ≤ change over the interval ≤ high l
        kind, limited = ("jerk", a) if smooth else ("acceleration", v)
        change = limited[-1] - limited[0]
        constraints: list[Constraints] = [
            (change - limit(kind, 0) * lengths, zero, infinite),
            (limit(kind, 1) * lengths - change, zero, infinite),
        ]
        if smooth:
            # v1 = v0 + l (a0 + a1)/2
            missing_v = v[-1] - v[0] - lengths * (a[0] + a[1]) / 2
            # q1 = q0 + l v0 + l² (2 a0 + a1)/6
            missing_q = q[-1] - q[0] - lengths * v[0] - lengths**2 * (2 * a[0] + a[1]) / 6
            constraints += [
                (missing_v, zero, zero),
                (missing_q, zero, zero),
                (v[1], *(bound[:, joint] for bound in self.velocities)),
            ]
        else:
            # q1 = q0 + l (v0 + v1)/2
            missing_q = q[-1] - q[0] - lengths * (v[0] + v[1]) / 2
            constraints.append((missing_q, zero, zero))
        # inner Bernstein coefficients of position, where positions are limited
        for own, low, high in zip(
            q[1:-1], position_bounds[::2], position_bounds[1::2], strict=False
        ):
            constraints.append((own, low[:, joint], high[:, joint]))
        return constraints

    def __call__(self, grid: CollocationGrid, start: Nodes) -> CollocationOptimum:
        """Return the local optimum that IPOPT finds from `start`."""
        low, high = (flat(*self._varied(own)) for own in self._bounds(grid))
        begin = flat(*self._varied(self._chosen(start)))
        parameters = [
            *grid.acceleration,
            *grid.jerk,
            *grid.velocity_bounds(),
            *grid.position_bounds(),
            np.array([grid.longest]),
            start.lengths,
        ]
        bounds = self.curves.bounds(grid.asked.curved)
        if bounds:
            fixed = self._fixed(begin, low, high, flat(*parameters, *bounds))
            bounds = self.curves.bounds(grid.asked.curved, fixed)
        parameters += bounds
        run = self.solver(
            start=begin,
            parameters=flat(*parameters),
            bounds=(low, high),
            constraint_bounds=self.edges(*parameters),
        )
        return CollocationOptimum(run.status, run.success, self._read(run.x))

    def _fixed(self, start: Array, low: Array, high: Array, parameters: Array) -> Bools:
        """Return which of all constraints depend on fixed variables only.

        Their derivatives by all others vanish at any point, so one that nothing is special about
        tells.
        """
        free = low < high
        random = np.random.default_rng(0).uniform(0.5, 1.5, len(start))
        anywhere = np.where(free, start * random + _SOMEWHERE * random, low)
        return ~self.solver.depends(anywhere, parameters, free)

    def _chosen(self, nodes: Nodes) -> Nodes:
        """Return nodes whose joints have their lengths together, where these are one variable."""
        return nodes._replace(lengths=nodes.lengths[:, : self.shapes.lengths[1]])

    def _read(self, x: Array) -> Nodes:
        """Return the variables as nodes."""
        column, *tables = unflat(x, self._varied(self.shapes))
        times = column[:, 0]
        if self.free:
            lengths, *states = tables
            return Nodes(times, np.tile(lengths, (1, self.joints // lengths.shape[1])), *states)
        equal = np.repeat(column / self.intervals, self.intervals, axis=0)
        return Nodes(times, np.tile(equal, (1, self.joints)), *tables)

    def _bounds(self, grid: CollocationGrid) -> tuple[Nodes, Nodes]:
        """Return lower and upper bounds of all variables.

        The least time of a segment is that of its displacement at top speed. At waypoints, and
        where the motion rests, both bounds of a state are equal.
        """
        h = np.diff(grid.waypoints, axis=0)
        h = np.sign(h) * np.maximum(np.abs(h) - grid.tolerance[1:] - grid.tolerance[:-1], 0)
        slowest, fastest = grid.velocity[:, :: self.intervals]
        shortest = np.maximum(h / fastest, h / slowest).max(axis=1)
        shortest = np.maximum(shortest, grid.least)
        longest = np.full_like(shortest, grid.longest)
        interval = np.repeat(_SHORTEST_SHARE * shortest / self.intervals, self.intervals)
        times = (shortest, grid.least if grid.given else longest)
        lengths = (
            np.tile(interval[:, None], (1, self.shapes.lengths[1])),
            np.full(self.shapes.lengths, grid.longest),
        )
        bounds = []
        for side in (0, 1):
            q = np.array(grid.reach[side])
            v = _at_nodes(grid.velocity_bounds()[side], side)
            a = _at_nodes(grid.acceleration[side], side)
            missed = grid.tolerance if side else -grid.tolerance
            within = np.clip(grid.waypoints + missed, *grid.reach[:, :: self.intervals])
            q[:: self.intervals] = np.where(missed, within, grid.waypoints)
            v[:: self.intervals][grid.held] = 0.0
            if not grid.closed:
                v[[0, -1]], a[[0, -1]] = grid.ends[:, 0], grid.ends[:, 1]
            a[:, ~np.array(grid.smooth)] = 0.0
            bounds.append(Nodes(times[side], lengths[side], q, v, a))
        low, high = bounds
        return low, high


def _at_nodes(of_intervals: Array, side: int) -> Array:
    """Return the tighter limits, low or high, of the intervals on both sides of each node."""
    tighter = np.minimum if side else np.maximum
    before = np.concatenate([of_intervals[:1], of_intervals])
    after = np.concatenate([of_intervals, of_intervals[-1:]])
    return np.asarray(tighter(before, after))


def transcription(grid: CollocationGrid, *, free: bool = False) -> Transcription:
    """Return the NLP of a grid, built once for its size; `free`: with free nodes."""
    size = (grid.problem.segments, grid.intervals)
    to_end = not grid.closed and bool(grid.tolerance[-1].any())
    curves = Curves(grid.asked, grid.unit, grid.scale, grid.origin, to_end)
    return _built(*size, grid.smooth, grid.boxed, grid.closed, free, curves)


_built = lru_cache(maxsize=32)(Transcription)
