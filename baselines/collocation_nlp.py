"""The general transcription, by CasADi/IPOPT: acceleration, or jerk where limited, in steps.

Each segment is cut into equal intervals over which a joint's acceleration (its jerk, where that is
limited) is constant; states at the nodes and segment times are variables. Limits between nodes are
imposed on Bernstein coefficients, so they hold at every instant. A restriction of the true problem:
its optimum approaches the exact one from above as `intervals` grows. It knows every kind of limit,
position limits too.

    from baselines.collocation_nlp import Collocation
    solution = Collocation(intervals=40).solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from trajopt.exceptions import InvalidInput
from trajopt.planner import Relation, backend, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status
from trajopt.stopping import stop_times
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

IPOPT = {
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


@dataclass(frozen=True)
class Collocation:
    """Piecewise-constant acceleration or jerk (CasADi/IPOPT); the one with position limits."""

    intervals: int = 20

    requires: ClassVar[tuple[str, ...]] = ("casadi",)

    def __post_init__(self) -> None:
        if self.intervals < 2:
            raise InvalidInput("intervals", "at least 2 per segment", value=self.intervals)

    def relation(self, problem: Problem) -> Relation:
        return Relation.RESTRICTION

    def unsupported(self, problem: Problem) -> str | None:
        return None

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """A local optimum from the straight-line start, stopping at every waypoint."""
        grid, began = _Grid(problem, self.intervals), time.perf_counter()
        transcription = _transcription(problem.segments, self.intervals, grid.smooth, grid.boxed)
        setup_time = time.perf_counter() - began
        status, success, times, states = transcription.solve(grid)
        stats = {"ipopt_status": status}
        if not success:
            message = f"IPOPT: {status}"
            return Solution(Status.FAILED, message=message, setup_time=setup_time, stats=stats)
        answer = grid.trajectory(times, *states)
        return Solution(Status.SOLVED, answer, setup_time=setup_time, stats=stats)


class _Grid:
    """The moving joints in their own units: mean stop time, acceleration limits of order one."""

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

    def start(self) -> list[Array]:
        """Segment times; states `q, v, a` at the nodes, of one cubic per segment."""
        times, h = 2 * self.stop, np.diff(self.waypoints, axis=0)
        s = np.arange(self.intervals)[:, None] / self.intervals
        rows = [
            (
                self.waypoints[k] + h[k] * s**2 * (3 - 2 * s),
                h[k] / t * 6 * s * (1 - s),
                h[k] / t**2 * (6 - 12 * s),
            )
            for k, t in enumerate(times)
        ]
        ends = (self.waypoints[-1:], np.zeros_like(h[:1]), np.zeros_like(h[:1]))
        return [
            times,
            *(np.vstack([*x, end]) for x, end in zip(zip(*rows, strict=True), ends, strict=True)),
        ]

    def trajectory(self, times: Array, q: Array, v: Array, a: Array) -> Trajectory:
        """Pieces from the states at the nodes; `a` counts where jerk is limited."""
        lengths = np.repeat(times / self.intervals, self.intervals)[:, None]
        slope = np.where(self.smooth, a[:-1], np.diff(v, axis=0) / lengths)
        jerk = np.where(self.smooth, np.diff(a, axis=0) / lengths, 0.0)
        scaled = [
            x * self.scale / self.unit**order
            for x, order in ((jerk / 6, 3), (slope / 2, 2), (v[:-1], 1), (q[:-1], 0))
        ]
        coefficients = np.zeros((4, len(lengths), self.problem.joints))
        coefficients[3] = self.problem.waypoints[0]
        coefficients[:, :, self.moving] = scaled
        coefficients[3][:, self.moving] += self.origin
        breaks = np.r_[0.0, np.cumsum(lengths)] * self.unit
        return Trajectory(breaks, coefficients, breaks[:: self.intervals])


class _Transcription:
    """One IPOPT problem for all problems of a kind; numbers and bounds are parameters."""

    def __init__(
        self, segments: int, intervals: int, smooth: tuple[bool, ...], boxed: bool
    ) -> None:
        ca = backend("casadi")
        self.ca, joints, nodes = ca, len(smooth), segments * intervals + 1
        self.shapes = [(segments, 1), (nodes, joints), (nodes, joints), (nodes, joints)]
        self.joints, self.nodes, self.intervals = joints, nodes, intervals
        x = [ca.MX.sym(name, *shape) for name, shape in zip("tqva", self.shapes, strict=True)]
        names = ("velocity", "acceleration", "jerk", "position")
        bounds = {name: ca.MX.sym(name, 2, joints) for name in names}
        total = ca.MX.sym("total")
        rows = self._rows(x, bounds, smooth, boxed)
        g = ca.vertcat(*(ca.vec(e) for e, *_ in rows), total - ca.sum1(x[0]))
        low, high = (
            ca.vertcat(*(ca.vec(r[i]) for r in rows), [0.0, np.inf][i - 1]) for i in (1, 2)
        )
        p = ca.vertcat(*map(ca.vec, bounds.values()), total)
        problem = {"x": ca.vertcat(*map(ca.vec, x)), "p": p, "f": ca.sum1(x[0]), "g": g}
        self.solver = ca.nlpsol("collocation", "ipopt", problem, IPOPT)
        self.edges = ca.Function("edges", [p], [low, high])

    def _rows(
        self, x: list[Any], bounds: dict[str, Any], smooth: tuple[bool, ...], boxed: bool
    ) -> list[tuple[Any, Any, Any]]:
        """Constraints as `(expression, low, high)`, one row per interval."""
        ca, (t, q, v, a), rows = self.ca, x, []
        lengths = ca.vec(ca.repmat(t.T / self.intervals, self.intervals, 1))
        for j, is_smooth in enumerate(smooth):
            (q0, q1), (v0, v1), (a0, a1) = ((x[:-1, j], x[1:, j]) for x in (q, v, a))
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
            rows += [(point, *limit["position"]) for point in inner] if boxed else []
        return rows

    def solve(self, grid: _Grid) -> tuple[str, bool, Array, list[Array]]:
        """IPOPT's status, its success, segment times, and `[q, v, a]` at the nodes."""
        start = grid.start()
        low, high = self._box(grid)
        p = np.concatenate(
            [*(x.ravel("F") for x in (*grid.rates, grid.position)), [1.5 * grid.stop.sum()]]
        )
        lbg, ubg = self.edges(p)
        flat = [np.concatenate([x.ravel("F") for x in table]) for table in (start, low, high)]
        result = self.solver(x0=flat[0], lbx=flat[1], ubx=flat[2], p=p, lbg=lbg, ubg=ubg)
        ends = np.cumsum([np.prod(shape) for shape in self.shapes])[:-1]
        parts = np.split(np.asarray(result["x"]).ravel(), ends)
        t, *states = (
            x.reshape(shape, order="F") for x, shape in zip(parts, self.shapes, strict=True)
        )
        stats = self.solver.stats()
        return str(stats["return_status"]), bool(stats["success"]), t[:, 0], states

    def _box(self, grid: _Grid) -> tuple[list[Array], list[Array]]:
        """Bounds of all variables; waypoints and rest at both ends are bounds that coincide."""
        wide = [
            np.tile(x, (self.nodes, 1)) for x in (*grid.position, *grid.rates[0], *grid.rates[1])
        ]
        h = np.diff(grid.waypoints, axis=0)
        least = np.maximum(h / grid.rates[0][1], h / grid.rates[0][0]).max(axis=1)
        low = [least, wide[0], wide[2], wide[4]]
        high = [np.full(len(h), 1.5 * grid.stop.sum()), wide[1], wide[3], wide[5]]
        for table in (low, high):
            table[1][:: self.intervals] = grid.waypoints
            table[2][[0, -1]] = 0.0
            table[3][[0, -1]] = 0.0
            table[3][:, ~np.array(grid.smooth)] = 0.0  # unused there
        return low, high


_transcription = lru_cache(maxsize=16)(_Transcription)
