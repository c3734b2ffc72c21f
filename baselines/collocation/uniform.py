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

from baselines.exact import jerk_reach
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, backend, passing_once
from trajopt.problem import Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

IPOPT: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "tol": 1e-9,
        "constr_viol_tol": 1e-11,
        "bound_relax_factor": 0.0,
        "max_iter": 3000,
    },
}
# Free nodes are never far from their start: a small barrier from the beginning keeps them there.
_WARM = {
    "tol": 1e-8,
    "mu_init": 1e-6,
    "bound_push": 1e-7,
    "bound_frac": 1e-7,
    "max_iter": 400,
}
_TOUCH = 1e-9  # without units: a waypoint so close to a position limit is on it
_LEAST = 1e-3  # of equal intervals: the shortest that free nodes leave


@dataclass(frozen=True)
class Collocation(Planner):
    """Piecewise-constant acceleration or jerk (CasADi/IPOPT); the one with position limits."""

    intervals: int = 20

    requires = ("casadi",)

    def __post_init__(self) -> None:
        if self.intervals < 2:
            raise InvalidInput("intervals", "at least 2 per segment", value=self.intervals)

    def unsupported(self, problem: Problem) -> str | None:
        return jerk_reach.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """A local optimum from the straight-line start, stopping at every waypoint."""
        grid, began = Grid(problem, self.intervals), time.perf_counter()
        solve = transcription(grid)
        setup_time = time.perf_counter() - began
        found = solve(grid, grid.stopping())
        stats = {"ipopt_status": found.status}
        if not found.success:
            message = f"IPOPT: {found.status}"
            return Solution(Status.FAILED, message=message, setup_time=setup_time, stats=stats)
        answer = grid.trajectory(found.nodes)
        return Solution(Status.SOLVED, answer, setup_time=setup_time, stats=stats)


class Nodes(NamedTuple):
    """A transcribed motion of the moving joints, without units; all segments one after another.

    Segment times `(segments,)`, lengths of the intervals `(intervals, joints)`, and the states at
    the nodes `(intervals + 1, joints)`; `a` counts where jerk is limited. Arrays, CasADi's symbols,
    or their shapes.
    """

    times: Any
    lengths: Any
    q: Any
    v: Any
    a: Any


class Found(NamedTuple):
    """IPOPT's status, whether it succeeded, and where it ended."""

    status: str
    success: bool
    nodes: Nodes


class Grid:
    """The moving joints in their own units: mean stop time, acceleration limits of order one.

    Each segment has so many `intervals`; `smooth` joints have a jerk limit.
    """

    def __init__(self, problem: Problem, intervals: int) -> None:
        self.problem, self.intervals, self.moving = problem, intervals, problem.moving
        stop = stop_times(problem)
        self.unit, limits = float(stop.mean()), problem.limits
        self.scale = np.abs(limits.acceleration[self.moving]).min(axis=1) * self.unit**2
        self.origin = problem.waypoints[0, self.moving]
        self.waypoints = (problem.waypoints[:, self.moving] - self.origin) / self.scale
        self.position = (limits.position[self.moving].T - self.origin) / self.scale
        kinds = (limits.velocity, limits.acceleration, limits.jerk)
        self.rates = [
            x[self.moving].T / self.scale * self.unit**order
            for order, x in enumerate(kinds, start=1)
        ]
        self.stop = stop / self.unit
        self.smooth = tuple(np.isfinite(self.rates[2]).any(axis=0).tolist())
        self.boxed = problem.has("position")
        # On a position limit velocity vanishes: fixed, or the NLP would have no interior.
        distance = np.abs(self.waypoints[:, None] - self.position).min(axis=1)
        self.resting = distance <= _TOUCH
        self.resting[[0, -1]] = True

    def stopping(self) -> Nodes:
        """Where IPOPT starts: stopping at every waypoint, in generous time."""
        return self.cubics(2 * self.stop, np.zeros((len(self.stop) - 1, len(self.scale))))

    def cubics(self, times: Array, velocities: Array) -> Nodes:
        """Equal intervals of one cubic per segment, `(segments,)` and `(segments - 1, joints)`."""
        t, h = times[:, None, None], np.diff(self.waypoints, axis=0)[:, None]
        ends = np.pad(velocities, ((1, 1), (0, 0)))[:, None]
        s = (np.arange(self.intervals) / self.intervals)[:, None]
        first, last = ends[:-1] * t, ends[1:] * t
        square, cube = 3 * h - 2 * first - last, first + last - 2 * h
        q = self.waypoints[:-1, None] + s * (first + s * (square + s * cube))
        v = (first + s * (2 * square + 3 * s * cube)) / t
        a = (2 * square + 6 * s * cube) / t**2
        rest = np.zeros_like(self.waypoints[:1])
        states = (
            np.vstack([x.reshape(-1, len(self.scale)), end])
            for x, end in ((q, self.waypoints[-1:]), (v, rest), (a, rest))
        )
        lengths = np.repeat(times / self.intervals, self.intervals)[:, None] + rest
        return Nodes(times, lengths, *states)

    def room(self) -> list[Array]:
        """Lowest and highest position of both inner Bernstein coefficients of every interval.

        `(intervals, joints)` each. Beside a waypoint at rest one of them is that waypoint (of the
        single one without jerk limits, on either side), and free; at both ends, where acceleration
        vanishes too, both are.
        """
        pieces = len(self.stop) * self.intervals
        low, high = (np.tile(side, (pieces, 1)) for side in self.position)
        free = np.zeros((2, pieces, len(self.scale)), dtype=bool)
        free[0, :: self.intervals] = self.resting[:-1]
        free[1, self.intervals - 1 :: self.intervals] = self.resting[1:]
        free[0] |= free[1] & ~np.array(self.smooth)
        free[:, [0, -1]] = True
        wide = [(np.where(own, -np.inf, low), np.where(own, np.inf, high)) for own in free]
        return [table for pair in wide for table in pair]

    def slopes(self, nodes: Nodes) -> tuple[Array, Array]:
        """Acceleration at the start of every interval, and jerk in it."""
        _, lengths, _, v, a = nodes
        steps = (np.diff(x, axis=0) / lengths for x in (v, a))
        slope, jerk = steps
        return np.where(self.smooth, a[:-1], slope), np.where(self.smooth, jerk, 0.0)

    def halved(self, nodes: Nodes) -> Nodes:
        """The same motion with every interval cut in two."""
        half, (slope, jerk) = nodes.lengths / 2, self.slopes(nodes)
        q, v = nodes.q[:-1], nodes.v[:-1]
        middles = (
            q + half * (v + half * (slope / 2 + half * jerk / 6)),
            v + half * (slope + half * jerk / 2),
            np.where(self.smooth, slope + half * jerk, 0.0),
        )
        states = [np.repeat(x, 2, axis=0)[:-1] for x in nodes[2:]]
        for whole, middle in zip(states, middles, strict=True):
            whole[1::2] = middle
        return Nodes(nodes.times, np.repeat(half, 2, axis=0), *states)

    def trajectory(self, nodes: Nodes) -> Trajectory:
        """Pieces from the states at the nodes, every joint on breaks of its own."""
        at = np.r_[0.0, np.cumsum(nodes.times)] * self.unit
        breaks = np.vstack([0 * nodes.lengths[:1], np.cumsum(nodes.lengths, axis=0)]) * self.unit
        breaks[:: self.intervals] = at[:, None]
        slope, jerk = self.slopes(nodes)
        parts = np.stack([jerk / 6, slope / 2, nodes.v[:-1], nodes.q[:-1]])
        parts *= self.scale / self.unit ** np.arange(3, -1, -1)[:, None, None]
        parts[3] += self.origin
        joints = [(at[[0, -1]], np.array([[start]])) for start in self.problem.waypoints[0]]
        for i, joint in enumerate(np.flatnonzero(self.moving)):
            joints[joint] = breaks[:, i], parts[:, :, i]
        return Trajectory.joined(joints, at)


class _Transcription:
    """One IPOPT problem for all problems of a kind; numbers and bounds are parameters."""

    def __init__(
        self, segments: int, intervals: int, smooth: tuple[bool, ...], boxed: bool, free: bool
    ) -> None:
        ca = backend("casadi")
        self.ca, joints, pieces = ca, len(smooth), segments * intervals
        self.joints, self.nodes, self.intervals = joints, pieces + 1, intervals
        self.free = free
        self.shapes = [(segments, 1), (pieces, joints), *3 * [(pieces + 1, joints)]]
        x = Nodes(
            *(ca.MX.sym(name, *shape) for name, shape in zip("tlqva", self.shapes, strict=True))
        )
        equal = ca.vec(ca.repmat(x.times.T / intervals, intervals, 1))
        names = ("velocity", "acceleration", "jerk")
        bounds = {name: ca.MX.sym(name, 2, joints) for name in names}
        room = [ca.MX.sym(f"room{i}", pieces, joints) for i in range(4)]
        total = ca.MX.sym("total")
        motion = x if free else x._replace(lengths=ca.repmat(equal, 1, joints))
        rows = [(total - ca.sum1(x.times), 0.0, np.inf)]
        rows += self._rows(motion, bounds, smooth, room if boxed else [])
        rows += self._lengths(x, equal) if free else []
        g = ca.vertcat(*(ca.vec(e) for e, *_ in rows))
        low, high = (ca.vertcat(*(ca.vec(row[i]) for row in rows)) for i in (1, 2))
        p = ca.vertcat(*map(ca.vec, [*bounds.values(), *room]), total)
        variables = ca.vertcat(*map(ca.vec, self._varied(x)))
        problem = {"x": variables, "p": p, "f": ca.sum1(x.times), "g": g}
        options = IPOPT | {"ipopt": IPOPT["ipopt"] | _WARM} if free else IPOPT
        self.solver = ca.nlpsol("collocation", "ipopt", problem, options)
        self.edges = ca.Function("edges", [p], [low, high])

    def _varied(self, tables: Nodes) -> list[Any]:
        """The tables that IPOPT sees."""
        return [*tables] if self.free else [tables.times, *tables[2:]]

    def _lengths(self, x: Nodes, equal: Any) -> list[tuple[Any, Any, Any]]:
        """Free intervals fill their segment, and none vanishes."""
        ca, rows = self.ca, []
        for j in range(self.joints):
            own = ca.reshape(x.lengths[:, j], self.intervals, -1)
            zero = ca.DM.zeros(own.shape[1])
            rows.append((ca.sum1(own).T - x.times, zero, zero))
            spare, none = x.lengths[:, j] - _LEAST * equal, ca.DM.zeros(self.nodes - 1)
            rows.append((spare, none, none + np.inf))
        return rows

    def _rows(
        self, x: Nodes, bounds: dict[str, Any], smooth: tuple[bool, ...], room: list[Any]
    ) -> list[tuple[Any, Any, Any]]:
        """Constraints as `(expression, low, high)`, one row per interval."""
        ca, rows = self.ca, []
        for j, is_smooth in enumerate(smooth):
            lengths = x.lengths[:, j]
            (q0, q1), (v0, v1), (a0, a1) = ((y[:-1, j], y[1:, j]) for y in x[2:])
            limit = {
                name: [ca.repmat(b[side, j], self.nodes - 1, 1) for side in (0, 1)]
                for name, b in bounds.items()
            }
            zero, free = ca.DM.zeros(self.nodes - 1), ca.DM.inf(self.nodes - 1)
            step, rate = (a1 - a0, "jerk") if is_smooth else (v1 - v0, "acceleration")
            rows += [
                (step - limit[rate][0] * lengths, zero, free),
                (limit[rate][1] * lengths - step, zero, free),
            ]
            if is_smooth:
                rows += [
                    (v1 - v0 - lengths * (a0 + a1) / 2, zero, zero),
                    (q1 - q0 - lengths * v0 - lengths**2 * (2 * a0 + a1) / 6, zero, zero),
                    (v0 + lengths * a0 / 2, *limit["velocity"]),
                ]
                inner = [q0 + lengths * v0 / 3, q1 - lengths * v1 / 3]
            else:
                rows += [(q1 - q0 - lengths * (v0 + v1) / 2, zero, zero)]
                inner = [q0 + lengths * v0 / 2]
            own = [table[:, j] for table in room]
            pairs = zip(own[::2], own[1::2], strict=True)
            rows += [(point, *pair) for point, pair in zip(inner, pairs, strict=False)]
        return rows

    def __call__(self, grid: Grid, start: Nodes) -> Found:
        """The local optimum that IPOPT finds from `start`."""
        low, high = self._box(grid)
        p = np.concatenate(
            [*(x.ravel("F") for x in (*grid.rates, *grid.room())), [1.5 * grid.stop.sum()]]
        )
        lbg, ubg = self.edges(p)
        x0, lbx, ubx = (
            np.concatenate([x.ravel("F") for x in self._varied(table)])
            for table in (start, low, high)
        )
        result = self.solver(x0=x0, lbx=lbx, ubx=ubx, p=p, lbg=lbg, ubg=ubg)
        stats, x = self.solver.stats(), np.asarray(result["x"]).ravel()
        return Found(str(stats["return_status"]), bool(stats["success"]), self._read(x))

    def _read(self, x: Array) -> Nodes:
        shapes = self._varied(Nodes(*self.shapes))
        parts = np.split(x, np.cumsum([np.prod(shape) for shape in shapes])[:-1])
        times, *lengths, q, v, a = (
            part.reshape(shape, order="F") for part, shape in zip(parts, shapes, strict=True)
        )
        equal = np.repeat(times / self.intervals, self.intervals, axis=0)
        own = lengths[0] if lengths else np.tile(equal, (1, self.joints))
        return Nodes(times[:, 0], own, q, v, a)

    def _box(self, grid: Grid) -> tuple[Nodes, Nodes]:
        """Bounds of all variables; waypoints and rest at both ends are bounds that coincide."""
        wide = [
            np.tile(x, (self.nodes, 1)) for x in (*grid.position, *grid.rates[0], *grid.rates[1])
        ]
        h, longest = np.diff(grid.waypoints, axis=0), 1.5 * grid.stop.sum()
        least = np.maximum(h / grid.rates[0][1], h / grid.rates[0][0]).max(axis=1)
        none = np.zeros(self.shapes[1])
        low = Nodes(least, none, wide[0], wide[2], wide[4])
        high = Nodes(np.full(len(h), longest), none + longest, wide[1], wide[3], wide[5])
        for table in (low, high):
            table.q[:: self.intervals] = grid.waypoints
            table.v[:: self.intervals][grid.resting] = 0.0
            table.a[[0, -1]] = 0.0
            table.a[:, ~np.array(grid.smooth)] = 0.0  # unused there
        return low, high


def transcription(grid: Grid, *, free: bool = False) -> _Transcription:
    """The IPOPT problem for a grid, built once for its kind; `free`: with free nodes."""
    return _built(grid.problem.segments, grid.intervals, grid.smooth, grid.boxed, free)


_built = lru_cache(maxsize=32)(_Transcription)
