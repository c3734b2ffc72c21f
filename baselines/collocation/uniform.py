"""The general transcription, by CasADi/IPOPT: acceleration, or jerk where limited, in steps.

Each segment is cut into equal intervals over which a joint's acceleration (its jerk, where that is
limited) is constant; states at the nodes and segment times are variables. Limits between nodes are
imposed on Bernstein coefficients, so they hold at every instant. A restriction of the true problem:
its optimum approaches the exact one from above as `intervals` grows. It knows every kind of limit,
position limits too. With `free` nodes each joint chooses the lengths of its own intervals, which
`baselines.collocation.refined` uses.

    from baselines.collocation.uniform import Collocation
    solution = Collocation(intervals=40).solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.exact import one_sided_jerk
from baselines.ipopt import Options, flat, program, unflat
from baselines.sizes import announce, cells
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import LIMIT_NAMES, Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Planner, backend, passing_once
from trajopt.planners.rest_to_rest import stop_times

Array = NDArray[np.float64]
# A constraint's expression with its lowest and highest values.
Row = tuple[Any, Any, Any]

_OPTIONS: Options = {
    "tol": 1e-9,
    "constr_viol_tol": 1e-11,
    "bound_relax_factor": 0.0,
    "max_iter": 3000,
}
# Free nodes are never far from their start: a small barrier from the beginning keeps them there.
_WARM_OPTIONS: Options = {
    **_OPTIONS,
    "tol": 1e-8,
    "mu_init": 1e-6,
    "bound_push": 1e-7,
    "bound_frac": 1e-7,
    "max_iter": 400,
}
# Measured up to 7000 intervals of all joints: IPOPT's time, in proportion.
_SECONDS_PER_INTERVAL = 2e-3
# No units: a waypoint this close to a position limit is on it.
_TOUCH_DISTANCE = 1e-9
# Of equal intervals in the least time: the shortest that free nodes leave.
_SHORTEST_SHARE = 1e-3
# Of the mean squared drift of free intervals from their start, beside the duration: where several
# lengths give one motion, IPOPT would wander among them.
_DRIFT_WEIGHT = 1e-4
# Times the time of stopping at every waypoint: the longest motion that is looked at.
_LONGEST = 1.5


@dataclass(frozen=True)
class Collocation(Planner):
    """Piecewise-constant acceleration or jerk (CasADi/IPOPT); the one with position limits."""

    intervals: int = 20

    requires = ("casadi",)
    knows = LIMIT_NAMES

    def __post_init__(self) -> None:
        if self.intervals < 2:
            raise InvalidInput("intervals", "at least 2 per segment", value=self.intervals)

    def unsupported(self, problem: Problem) -> str | None:
        return one_sided_jerk.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """A local optimum from the straight-line start, stopping at every waypoint."""
        intervals = self.intervals * cells(problem)
        announce("collocation", problem, _SECONDS_PER_INTERVAL * intervals)
        grid = Grid(problem, self.intervals)
        began = time.perf_counter()
        solve = transcription(grid)
        setup_time = time.perf_counter() - began
        optimum = solve(grid, grid.stopping())
        stats = {"ipopt_status": optimum.status}
        if not optimum.success:
            message = f"IPOPT: {optimum.status}"
            return Solution(Status.FAILED, message=message, setup_time=setup_time, stats=stats)
        answer = grid.trajectory(optimum.nodes)
        return Solution(Status.SOLVED, answer, setup_time=setup_time, stats=stats)


class Nodes(NamedTuple):
    """A transcribed motion of the moving joints, without units; all segments one after another.

    Arrays, CasADi's symbols, or their shapes.

    Attributes:
        times: Segment times `(segments,)`.
        lengths: Of the intervals, `(intervals, joints)`.
        q: Position at the nodes, `(intervals + 1, joints)`.
        v: Velocity at the nodes.
        a: Acceleration at the nodes; it counts where jerk is limited.
    """

    times: Any
    lengths: Any
    q: Any
    v: Any
    a: Any


class Optimum(NamedTuple):
    """IPOPT's status, whether it succeeded, and where it ended."""

    status: str
    success: bool
    nodes: Nodes


class Grid:
    """The moving joints in their own units: mean stop time, acceleration limits of order one.

    Each segment has so many `intervals`; `smooth` joints have a jerk limit.
    """

    def __init__(self, problem: Problem, intervals: int) -> None:
        limits = problem.limits
        moving = problem.moving
        stop = stop_times(problem)
        unit = float(stop.mean())
        tighter = np.abs(limits.acceleration[moving]).min(axis=1)
        scale = tighter * unit**2
        origin = problem.waypoints[0, moving]
        waypoints = problem.waypoints[:, moving]
        position = limits.position[moving].T

        self.problem = problem
        self.intervals = intervals
        self.moving = moving
        self.unit = unit
        self.scale = scale
        self.origin = origin
        self.stop = stop / unit
        self.waypoints = (waypoints - origin) / scale
        self.position = (position - origin) / scale
        # (2, joints): lowest and highest
        velocity = limits.velocity[moving].T
        acceleration = limits.acceleration[moving].T
        jerk = limits.jerk[moving].T
        self.velocity = velocity / scale * unit
        self.acceleration = acceleration / scale * unit**2
        self.jerk = jerk / scale * unit**3
        jerk_limited = np.isfinite(self.jerk).any(axis=0)
        self.smooth = tuple(bool(one) for one in jerk_limited)
        self.boxed = problem.has("position")

        # On a position limit velocity vanishes: fixed, or the NLP would have no interior.
        distances = np.abs(self.waypoints[:, None] - self.position)
        self.resting = distances.min(axis=1) <= _TOUCH_DISTANCE
        self.resting[[0, -1]] = True

    @property
    def longest(self) -> float:
        """The longest total time that is looked at."""
        return float(_LONGEST * self.stop.sum())

    def stopping(self) -> Nodes:
        """Where IPOPT starts: stopping at every waypoint, in generous time."""
        inner_waypoints = self.waypoints[1:-1]
        rest = np.zeros_like(inner_waypoints)
        return self.cubics(2 * self.stop, rest)

    def cubics(self, times: Array, velocities: Array) -> Nodes:
        """Equal intervals of one cubic per segment, `(segments,)` and `(segments - 1, joints)`."""
        t = times[:, None, None]
        h = np.diff(self.waypoints, axis=0)[:, None]
        start = self.waypoints[:-1, None]
        rest = np.zeros_like(self.waypoints[:1])
        ends = np.vstack([rest, velocities, rest])[:, None]
        number = np.arange(self.intervals)[:, None]
        s = number / self.intervals

        # q(s) = q0 + u t s + (3h − 2ut − wt) s² + (ut + wt − 2h) s³, with s = time/t
        first = ends[:-1] * t
        last = ends[1:] * t
        square = 3 * h - 2 * first - last
        cube = first + last - 2 * h
        curve = square + s * cube
        slope = 2 * square + 3 * s * cube
        bend = 2 * square + 6 * s * cube
        travelled = s * (first + s * curve)
        q = start + travelled
        v = (first + s * slope) / t
        a = bend / t**2

        brief = times / self.intervals
        equal = np.repeat(brief, self.intervals)
        return Nodes(
            times,
            equal[:, None] + rest,
            self._joined(q, self.waypoints[-1:]),
            self._joined(v, rest),
            self._joined(a, rest),
        )

    def _joined(self, states: Array, end: Array) -> Array:
        """States `(segments, intervals, joints)` one after another, and the last node's."""
        table = states.reshape(-1, len(self.scale))
        return np.vstack([table, end])

    def room(self) -> list[Array]:
        """Lowest and highest position of both inner Bernstein coefficients of every interval.

        `(intervals, joints)` each: lowest and highest of the first, then of the second. Beside a
        waypoint at rest one of them is that waypoint (of the single one without jerk limits, on
        either side), and free; at both ends, where acceleration vanishes too, both are.
        """
        size = self.intervals
        pieces = len(self.stop) * size
        low, high = np.repeat(self.position[:, None], pieces, axis=1)
        first = np.zeros(low.shape, dtype=bool)
        second = np.zeros(low.shape, dtype=bool)
        first[::size] = self.resting[:-1]
        second[size - 1 :: size] = self.resting[1:]
        single = ~np.array(self.smooth)
        first |= second & single
        tables = []
        for free in (first, second):
            free[[0, -1]] = True
            lowest = np.where(free, -np.inf, low)
            highest = np.where(free, np.inf, high)
            tables += [lowest, highest]
        return tables

    def slopes(self, nodes: Nodes) -> tuple[Array, Array]:
        """Acceleration at the start of every interval, and jerk in it."""
        slope = np.diff(nodes.v, axis=0) / nodes.lengths
        jerk = np.diff(nodes.a, axis=0) / nodes.lengths
        acceleration = np.where(self.smooth, nodes.a[:-1], slope)
        return acceleration, np.where(self.smooth, jerk, 0.0)

    def halved(self, nodes: Nodes) -> Nodes:
        """The same motion with every interval cut in two."""
        half = nodes.lengths / 2
        slope, jerk = self.slopes(nodes)
        q = nodes.q[:-1]
        v = nodes.v[:-1]
        # Taylor's formula at half the interval
        bend = slope / 2 + half * jerk / 6
        mean_v = v + half * bend
        mean_slope = slope + half * jerk / 2
        middle_slope = slope + half * jerk
        middle_q = q + half * mean_v
        middle_v = v + half * mean_slope
        middle_a = np.where(self.smooth, middle_slope, 0.0)
        return Nodes(
            nodes.times,
            np.repeat(half, 2, axis=0),
            _interleaved(nodes.q, middle_q),
            _interleaved(nodes.v, middle_v),
            _interleaved(nodes.a, middle_a),
        )

    def trajectory(self, nodes: Nodes) -> Trajectory:
        """Pieces from the states at the nodes, every joint on breaks of its own."""
        at = _from_zero(nodes.times) * self.unit
        breaks = _from_zero(nodes.lengths) * self.unit
        breaks[:: self.intervals] = at[:, None]

        # q + v t + a/2 t² + j/6 t³, back in rad and s
        slope, jerk = self.slopes(nodes)
        q = nodes.q[:-1]
        v = nodes.v[:-1]
        parts = np.stack([jerk / 6, slope / 2, v, q])
        powers = np.array([3, 2, 1, 0])[:, None, None]
        parts *= self.scale / self.unit**powers
        parts[3] += self.origin
        joints = []
        for i in range(len(self.scale)):
            joints.append((breaks[:, i], parts[:, :, i]))
        return Trajectory.of_moving(
            self.problem.waypoints[0],
            self.moving,
            joints,
            at,
        )


def _from_zero(lengths: Array) -> Array:
    """Where intervals of these lengths begin and end, from 0, along the first axis."""
    ends = np.cumsum(lengths, axis=0)
    return np.concatenate([np.zeros_like(ends[:1]), ends])


def _interleaved(states: Array, middles: Array) -> Array:
    """States at the nodes with those at the intervals' middles between them."""
    doubled = np.repeat(states, 2, axis=0)[:-1]
    doubled[1::2] = middles
    return doubled


class Transcription:
    """One IPOPT problem for all problems of a kind; numbers and bounds are parameters."""

    def __init__(
        self,
        segments: int,
        intervals: int,
        smooth: tuple[bool, ...],
        boxed: bool,
        free: bool,
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
        self.shapes = Nodes(
            times=(segments, 1),
            lengths=(pieces, joints),
            q=states,
            v=states,
            a=states,
        )

        x = Nodes(
            times=ca.MX.sym("t", segments),
            lengths=ca.MX.sym("l", pieces, joints),
            q=ca.MX.sym("q", *states),
            v=ca.MX.sym("v", *states),
            a=ca.MX.sym("a", *states),
        )
        brief = x.times.T / intervals
        equal = ca.vec(ca.repmat(brief, intervals, 1))
        limits = {
            "velocity": ca.MX.sym("velocity", 2, joints),
            "acceleration": ca.MX.sym("acceleration", 2, joints),
            "jerk": ca.MX.sym("jerk", 2, joints),
        }
        room = [ca.MX.sym(f"room{i}", pieces, joints) for i in range(4)]
        longest = ca.MX.sym("longest")
        start_lengths = ca.MX.sym("start", pieces, joints)
        motion = x
        if not free:
            motion = x._replace(lengths=ca.repmat(equal, 1, joints))
        walls = room if boxed else []

        duration = ca.sum1(x.times)
        spare_time = longest - duration
        rows: list[Row] = [(spare_time, 0.0, np.inf)]
        for j, is_smooth in enumerate(smooth):
            rows += self._joint(
                motion,
                j,
                limits,
                is_smooth,
                walls,
            )
        options = _OPTIONS
        objective = duration
        if free:
            options = _WARM_OPTIONS
            rows += self._filling(x)
            drift = intervals * (x.lengths - start_lengths)
            objective += _DRIFT_WEIGHT * ca.sumsqr(drift) / drift.numel()

        parameters = [*limits.values(), *room, longest, start_lengths]
        expressions, lows, highs = zip(*rows, strict=True)
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
        """The tables that IPOPT sees."""
        if self.free:
            return list(tables)
        return [tables.times, tables.q, tables.v, tables.a]

    def _filling(self, x: Nodes) -> list[Row]:
        """Free intervals fill their segment."""
        ca = self.ca
        rows: list[Row] = []
        for j in range(self.joints):
            by_segment = ca.reshape(x.lengths[:, j], self.intervals, -1)
            excess = ca.sum1(by_segment).T - x.times
            zero = ca.DM.zeros(by_segment.shape[1])
            rows.append((excess, zero, zero))
        return rows

    def _joint(
        self,
        x: Nodes,
        j: int,
        limits: dict[str, Any],
        smooth: bool,
        room: list[Any],
    ) -> list[Row]:
        """One joint's constraints, each a row per interval."""
        ca = self.ca
        pieces = self.nodes - 1
        zero = ca.DM.zeros(pieces)
        free = ca.DM.inf(pieces)
        lengths = x.lengths[:, j]
        q0 = x.q[:-1, j]
        q1 = x.q[1:, j]
        v0 = x.v[:-1, j]
        v1 = x.v[1:, j]
        a0 = x.a[:-1, j]
        a1 = x.a[1:, j]

        def limit(kind: str, side: int) -> Any:
            own = limits[kind][side, j]
            return ca.repmat(own, pieces, 1)

        if smooth:
            slowest = limit("jerk", 0) * lengths
            fastest = limit("jerk", 1) * lengths
            step_a = a1 - a0
            step_v = v1 - v0
            step_q = q1 - q0
            mean_a = lengths * (a0 + a1) / 2
            weighted = 2 * a0 + a1
            way = lengths**2 * weighted / 6
            middle_v = v0 + lengths * a0 / 2
            slowest_v = limit("velocity", 0)
            fastest_v = limit("velocity", 1)
            rows = [
                # J1 l ≤ a1 − a0 ≤ J2 l
                (step_a - slowest, zero, free),
                (fastest - step_a, zero, free),
                # v1 = v0 + l (a0 + a1)/2
                (step_v - mean_a, zero, zero),
                # q1 = q0 + l v0 + l² (2 a0 + a1)/6
                (step_q - lengths * v0 - way, zero, zero),
                # the velocity's inner Bernstein coefficient
                (middle_v, slowest_v, fastest_v),
            ]
            early_q = q0 + lengths * v0 / 3
            late_q = q1 - lengths * v1 / 3
            inner = [early_q, late_q]
        else:
            slowest = limit("acceleration", 0) * lengths
            fastest = limit("acceleration", 1) * lengths
            step_v = v1 - v0
            step_q = q1 - q0
            mean_v = lengths * (v0 + v1) / 2
            rows = [
                # A1 l ≤ v1 − v0 ≤ A2 l
                (step_v - slowest, zero, free),
                (fastest - step_v, zero, free),
                # q1 = q0 + l (v0 + v1)/2
                (step_q - mean_v, zero, zero),
            ]
            middle_q = q0 + lengths * v0 / 2
            inner = [middle_q]

        # the position's inner Bernstein coefficients, where positions are limited
        lowest = room[::2]
        highest = room[1::2]
        for coefficient, low, high in zip(inner, lowest, highest, strict=False):
            rows.append((coefficient, low[:, j], high[:, j]))
        return rows

    def __call__(self, grid: Grid, start: Nodes) -> Optimum:
        """The local optimum that IPOPT finds from `start`."""
        low = self._lowest(grid)
        high = self._highest(grid)
        parameters = [
            grid.velocity,
            grid.acceleration,
            grid.jerk,
            *grid.room(),
            np.array([grid.longest]),
            start.lengths,
        ]
        lowest = flat(*self._varied(low))
        highest = flat(*self._varied(high))
        run = self.solver(
            start=flat(*self._varied(start)),
            parameters=flat(*parameters),
            bounds=(lowest, highest),
            constraint_bounds=self.edges(*parameters),
        )
        nodes = self._read(run.x)
        return Optimum(run.status, run.success, nodes)

    def _read(self, x: Array) -> Nodes:
        shapes = self._varied(self.shapes)
        column, *tables = unflat(x, shapes)
        times = column[:, 0]
        if self.free:
            return Nodes(times, *tables)
        brief = column / self.intervals
        equal = np.repeat(brief, self.intervals, axis=0)
        lengths = np.tile(equal, (1, self.joints))
        return Nodes(times, lengths, *tables)

    def _lowest(self, grid: Grid) -> Nodes:
        """Lower bounds of all variables; no segment is briefer than its way at top speed."""
        h = np.diff(grid.waypoints, axis=0)
        forwards = h / grid.velocity[1]
        backwards = h / grid.velocity[0]
        by_joint = np.maximum(forwards, backwards)
        times = by_joint.max(axis=1)
        shortest = _SHORTEST_SHARE * times / self.intervals
        by_interval = np.repeat(shortest, self.intervals)
        lengths = np.tile(by_interval[:, None], (1, self.joints))
        return self._bounds(
            grid,
            side=0,
            times=times,
            lengths=lengths,
        )

    def _highest(self, grid: Grid) -> Nodes:
        """Upper bounds of all variables."""
        times = np.full_like(grid.stop, grid.longest)
        lengths = np.full(self.shapes.lengths, grid.longest)
        return self._bounds(
            grid,
            side=1,
            times=times,
            lengths=lengths,
        )

    def _bounds(
        self,
        grid: Grid,
        side: int,
        times: Array,
        lengths: Array,
    ) -> Nodes:
        """Bounds of the states; at waypoints and where the motion rests both coincide."""
        every_node = (self.nodes, 1)
        q = np.tile(grid.position[side], every_node)
        v = np.tile(grid.velocity[side], every_node)
        a = np.tile(grid.acceleration[side], every_node)
        q[:: self.intervals] = grid.waypoints
        at_waypoints = v[:: self.intervals]
        at_waypoints[grid.resting] = 0.0
        a[[0, -1]] = 0.0
        unused = ~np.array(grid.smooth)
        a[:, unused] = 0.0
        return Nodes(times, lengths, q, v, a)


def transcription(grid: Grid, *, free: bool = False) -> Transcription:
    """The IPOPT problem for a grid, built once for its kind; `free`: with free nodes."""
    return _built(
        grid.problem.segments,
        grid.intervals,
        grid.smooth,
        grid.boxed,
        free,
    )


_built = lru_cache(maxsize=32)(Transcription)
