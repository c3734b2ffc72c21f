"""The reference optimum under every kind of limit, by collocation with free nodes, refined.

The optimum's acceleration (its jerk, where that is limited) is piecewise constant, and each joint
switches at instants of its own. So each joint chooses the lengths of its intervals: then a handful
of them per segment is not an approximation but the optimum itself, where equal intervals converge
at first order. Intervals are halved until two refinements in a row agree. IPOPT starts from several
points, and the answer is the best known, not a proof.

    from baselines.collocation.refined import CollocationRefined
    solution = CollocationRefined().solve(problem)
    print(solution.trajectory.duration, solution.stats["error_estimate"])
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.collocation.uniform import Grid, Nodes, transcription
from baselines.exact import jerk_reach
from baselines.exact.acceleration import Exact, Scaled, starting_points
from baselines.exact.jerk import ExactJerk
from baselines.ipopt import optima
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Array = NDArray[np.float64]

_COARSE, _COARSE_JERK = 6, 10  # intervals per segment to begin with
_LARGEST = 3000  # intervals of all joints and segments: no refinement beyond it but the first
_PATIENCE = 4  # times as many starts where all have failed so far
_SLOWER = 1.3  # than the relaxation: a start
_SWITCH = 1e-6  # of the largest: the least jump of acceleration or jerk that is a switch


@dataclass(frozen=True)
class CollocationRefined(Planner):
    """Collocation with free nodes, refined until its own error is below `error` (CasADi/IPOPT).

    `error` is relative, the difference that halving every interval made; there are at most
    `refinements` halvings (fewer for large problems). It does not cover better local optima, for
    which there are `starts`.
    """

    error: float = 1e-4
    starts: int = 4
    refinements: int = 3

    on_request = True
    requires = ("casadi",)

    def __post_init__(self) -> None:
        if not 0 < self.error < np.inf:
            raise InvalidInput("error", "a positive number", value=self.error)
        for name in ("starts", "refinements"):
            if getattr(self, name) < 1:
                raise InvalidInput(name, "at least 1", value=getattr(self, name))

    def unsupported(self, problem: Problem) -> str | None:
        return jerk_reach.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of several local optima, refined.

        `stats`: IPOPT's status and duration (s, infinite where it failed) of each start, then of
        the best of them and its refinements with their intervals per segment; `error_estimate`,
        relative.
        """
        coarse = _COARSE_JERK if problem.has("jerk") else _COARSE
        grid, began = Grid(problem, coarse), time.perf_counter()
        transcription(grid, free=True)
        setup_time = time.perf_counter() - began
        starts = _starts(grid, _PATIENCE * self.starts)
        started = optima(lambda nodes: _solved(grid, nodes), starts, self.starts)
        levels = self._refined(min(started, key=lambda level: level.duration))
        best = min(levels, key=lambda level: level.duration)
        estimate = _estimate(levels)
        stats = _stats("start", started) | _stats("refinement", levels)
        stats |= {
            "refinement_intervals": np.array([level.grid.intervals for level in levels]),
            "error_estimate": estimate,
        }
        if not best.duration < np.inf:
            statuses = ", ".join(sorted({level.status for level in started}))
            message = f"no start succeeded: {statuses}"
            return Solution(Status.FAILED, message=message, setup_time=setup_time, stats=stats)
        answer, message = best.grid.trajectory(best.nodes), self._message(estimate)
        return Solution(Status.SOLVED, answer, message, setup_time=setup_time, stats=stats)

    def _message(self, estimate: float) -> str:
        if estimate <= self.error:
            return ""
        reached = f"is {estimate:.1e}" if estimate < np.inf else "is unknown"
        return f"the error {reached} after the last refinement; {self.error:.1e} was wanted"

    def _refined(self, level: _Level) -> list[_Level]:
        """Halved until two agree, or the cap; where a refinement fails, the next one may not."""
        levels, nodes = [level], level.nodes
        while level.duration < np.inf and len(levels) <= self.refinements:
            if len(levels) > 1 and 2 * nodes.lengths.size > _LARGEST:
                break
            grid, nodes = levels[-1].grid, levels[-1].grid.halved(nodes)
            levels.append(_solved(Grid(grid.problem, 2 * grid.intervals), nodes))
            if _estimate(levels) <= self.error:
                break
            nodes = levels[-1].nodes if levels[-1].duration < np.inf else nodes
        return levels


class _Level(NamedTuple):
    """A local optimum on a grid; infinite duration (s) if there is none."""

    grid: Grid
    nodes: Nodes
    duration: float
    status: str


def _stats(kind: str, levels: list[_Level]) -> dict[str, Any]:
    return {
        f"{kind}_status": [level.status for level in levels],
        f"{kind}_duration": np.array([level.duration for level in levels]),
    }


def _estimate(levels: list[_Level]) -> float:
    """The relative difference of the last two durations found; infinite without two."""
    durations = [level.duration for level in levels if level.duration < np.inf][-2:]
    return (max(durations) / min(durations) - 1) if len(durations) == 2 else np.inf


def _solved(grid: Grid, start: Nodes) -> _Level:
    """IPOPT's local optimum from `start`, if the verifier accepts it."""
    found = transcription(grid, free=True)(grid, start)
    duration = np.inf
    if found.success and verify(grid.problem, grid.trajectory(found.nodes)).feasible:
        duration = float(found.nodes.times.sum()) * grid.unit
    return _Level(grid, found.nodes, duration, found.status)


def _starts(grid: Grid, count: int) -> Iterator[Nodes]:
    """Without position limits, as it is and slower; stopping at every waypoint; random ones."""
    relaxed = _relaxed(grid.problem)
    if relaxed:
        yield _placed(grid, relaxed)
    yield grid.stopping()
    if relaxed:
        times = np.diff(relaxed.waypoint_times) / grid.unit
        velocities = relaxed(relaxed.waypoint_times, order=1)[1:-1, grid.moving]
        yield grid.cubics(_SLOWER * times, velocities * grid.unit / grid.scale / _SLOWER)
    scaled = Scaled(grid.problem.without("jerk", "position"))
    for times, velocities in list(starting_points(scaled, count))[1:]:
        units = scaled.units[1] * grid.unit / grid.scale / _SLOWER
        yield grid.cubics(_SLOWER * times * scaled.unit / grid.unit, velocities * units)


def _relaxed(problem: Problem) -> Trajectory | None:
    """The optimum without position limits."""
    exact = problem.without("position")
    planner = ExactJerk(starts=2) if problem.has("jerk") else Exact(starts=4)
    solution: Solution = planner.solve(exact)
    return solution.trajectory


def _placed(grid: Grid, trajectory: Trajectory) -> Nodes:
    """A trajectory with each joint's nodes where it switches, positions within their limits."""
    at, joints = trajectory.waypoint_times, np.flatnonzero(grid.moving)
    cuts = np.stack([_cuts(grid, trajectory, i, int(j)) for i, j in enumerate(joints)], axis=1)
    q, v, a = (
        np.stack([trajectory(cut, order)[:, j] for cut, j in zip(cuts.T, joints, strict=True)], 1)
        / grid.scale
        * grid.unit**order
        for order in range(3)
    )
    q = np.clip(q - grid.origin / grid.scale, *grid.position)
    return Nodes(np.diff(at) / grid.unit, np.diff(cuts, axis=0) / grid.unit, q, v, a)


def _cuts(grid: Grid, trajectory: Trajectory, i: int, joint: int) -> Array:
    """The nodes of one joint: its largest switches in each segment, the longest rests halved."""
    order = 3 if grid.smooth[i] else 2
    breaks, at = trajectory.breaks, trajectory.waypoint_times
    rate = trajectory(0.5 * (breaks[:-1] + breaks[1:]), order)[:, joint]
    jumps = np.abs(np.diff(rate))
    nodes = [at[:1]]
    for start, end in pairwise(at):
        inside = (breaks[1:-1] > start) & (breaks[1:-1] < end)
        where = np.flatnonzero(inside & (jumps > _SWITCH * np.abs(rate).max()))
        where = where[np.argsort(-jumps[where], kind="stable")[: grid.intervals - 1]]
        cuts = [start, *np.sort(breaks[1:-1][where]), end]
        while len(cuts) <= grid.intervals:
            longest = int(np.argmax(np.diff(cuts)))
            cuts.insert(longest + 1, 0.5 * (cuts[longest] + cuts[longest + 1]))
        nodes.append(np.array(cuts[1:]))
    return np.concatenate(nodes)
