"""The reference optimum under every kind of limit, by collocation with free nodes, refined.

The optimum's acceleration (its jerk, where that is limited) is piecewise constant, and each joint
has its own switching times. Where a row of a limit bends the acceleration it is piecewise linear.
So the lengths of each joint's intervals are variables. Then a few intervals per segment reproduce
the optimum itself; equal intervals would converge at first order only. Intervals are halved until
two consecutive refinements agree. IPOPT starts from several initial guesses. The answer is the best
local optimum found, which is not proved.

    from baselines.collocation.refined import CollocationRefined
    solution = CollocationRefined().solve(problem)
    print(solution.trajectory.duration, solution.stats["error_estimate"])
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baselines.collocation.uniform import KNOWN, CollocationGrid, Nodes, transcription, unsupported
from baselines.exact.acceleration.planner import Exact, starting_points
from baselines.exact.jerk import ExactJerk
from baselines.exact.method.scaled import Scaled
from baselines.several_starts import no_start_succeeded, optima_together
from baselines.sizes import announce, cells
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import certified, verify
from trajopt.planners.planner import Planner
from trajopt.planners.reductions import EQUAL_WAYPOINTS, RESTING_UNCOUPLED, reduced

# First number of intervals per segment, without and with jerk limits.
_START_INTERVALS = 6
_START_INTERVALS_JERK = 8
# Time of a segment and moving joint, s, without and with jerk limits, and the power of their number
# that the time grows with (measured with position limits, from 14 to 133).
_CELL_SECONDS = 0.004
_CELL_SECONDS_JERK = 0.02
_CELLS_POWER = 1.37
# Only the first refinement may have more intervals than this, in all joints and segments together.
_MAX_INTERVALS = 3000
# The search ends when this many starts have led to the best duration.
_AGREEING_STARTS = 2
# Durations that differ by less, relative to the error asked for, count as equal.
_AGREEMENT_SHARE = 0.1
# Further halvings with rows that are no boxes: along a curve each reduces the error to a quarter
# only.
_MORE_REFINEMENTS = 2
# Along rows that jump, a difference of durations over the one before: at first order, with a
# margin, and at most.
_FIRST_ORDER = 0.55
_SLOWEST_FALL = 0.9
# Factor on the number of starts if all have failed.
_MORE_STARTS = 4
# Least time of a segment in an initial guess, in mean stop times; within tolerance it may be 0.
_BRIEFEST = 1e-6
# Least duration of the slower initial guess, relative to the optimum without limits of position.
_SLOWER = 1.3


@dataclass(frozen=True)
class CollocationRefined(Planner):
    """Collocation with free nodes, refined until its own error is below `error` (CasADi/IPOPT).

    `error` is the relative change of the duration by halving every interval. There are at most
    `refinements` halvings (fewer for large problems, two more with limits that are no boxes). With
    more `starts` it may find better local optima.
    """

    error: float = 1e-4
    starts: int = 4
    refinements: int = 3

    on_request = True
    requires = ("casadi",)
    knows = KNOWN

    def __post_init__(self) -> None:
        if not 0 < self.error < np.inf:
            raise InvalidInput("error", "a positive number", value=self.error)
        for name in ("starts", "refinements"):
            if getattr(self, name) < 1:
                raise InvalidInput(name, "at least 1", value=getattr(self, name))

    def unsupported(self, problem: Problem) -> str | None:
        return unsupported(problem)

    @reduced(EQUAL_WAYPOINTS, RESTING_UNCOUPLED)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best of several local optima, refined.

        `stats`: IPOPT's status and duration (s, infinite where it failed) of each start, then of
        the best start and its refinements, with their intervals per segment; `error_estimate`,
        relative.
        """
        intervals = _START_INTERVALS
        cell_seconds = _CELL_SECONDS
        if problem.has("jerk"):
            intervals = _START_INTERVALS_JERK
            cell_seconds = _CELL_SECONDS_JERK
        seconds = cell_seconds * cells(problem) ** _CELLS_POWER
        announce("collocation-refined", problem, seconds)
        grid = CollocationGrid(problem, intervals, bends=True)
        began = time.perf_counter()
        transcription(grid, free=True)
        setup_time = time.perf_counter() - began

        starts = _starts(grid, _MORE_STARTS * self.starts)
        started = optima_together(
            lambda some: [_solved(grid, nodes) for nodes in some],
            starts,
            self.starts,
            agreeing=_AGREEING_STARTS,
            rtol=_AGREEMENT_SHARE * self.error,
        )
        incumbent = min(started, key=lambda level: level.duration)
        levels = self._refined(incumbent)
        best = min(levels, key=lambda level: level.duration)
        estimate = _estimate(levels)

        intervals_used = [level.grid.intervals for level in levels]
        stats = {
            **_stats("start", started),
            **_stats("refinement", levels),
            "refinement_intervals": np.array(intervals_used),
            "error_estimate": estimate,
        }
        if not best.duration < np.inf:
            return Solution(
                Status.FAILED,
                message=no_start_succeeded(level.status for level in started),
                setup_time=setup_time,
                stats=stats,
            )
        return Solution(
            Status.SOLVED,
            best.motion,
            self._message(estimate),
            setup_time=setup_time,
            stats=stats,
        )

    def _message(self, estimate: float) -> str:
        if estimate <= self.error:
            return ""
        reached = f"{estimate:.1e}" if estimate < np.inf else "unknown"
        return f"the error is {reached} after the last refinement; {self.error:.1e} was wanted"

    def _refined(self, incumbent: _Level) -> list[_Level]:
        """Halve intervals until two durations agree; a failed refinement may be refined again."""
        levels = [incumbent]
        nodes = incumbent.nodes
        most = self.refinements
        if incumbent.grid.asked.curved:
            most += _MORE_REFINEMENTS
        while incumbent.duration < np.inf and len(levels) <= most:
            too_many = 2 * nodes.lengths.size > _MAX_INTERVALS
            if len(levels) > 1 and too_many:
                break
            grid = levels[-1].grid
            nodes = grid.halved(nodes)
            finer = CollocationGrid(grid.problem, 2 * grid.intervals, bends=True)
            level = _solved(finer, nodes)
            levels.append(level)
            if _estimate(levels) <= self.error:
                break
            if level.duration < np.inf:
                nodes = level.nodes
        return levels


class _Level(NamedTuple):
    """A local optimum on a grid, with its duration, s; infinite if IPOPT failed.

    `motion` is dilated into rows of limits that hold at instants only.
    """

    grid: CollocationGrid
    nodes: Nodes
    motion: Trajectory | None
    duration: float
    status: str


def _stats(kind: str, levels: list[_Level]) -> dict[str, Any]:
    statuses = [level.status for level in levels]
    durations = [level.duration for level in levels]
    return {f"{kind}_status": statuses, f"{kind}_duration": np.array(durations)}


def _estimate(levels: list[_Level]) -> float:
    """Return the relative error that the last finite durations tell; infinite without two.

    It is their difference. Along rows of limits that jump between intervals the error falls no
    faster than the lengths of intervals. Then it is the sum of all differences that would follow.
    """
    durations = [level.duration for level in levels if level.duration < np.inf]
    if len(durations) < 2:
        return np.inf
    change = max(durations[-2:]) / min(durations[-2:]) - 1
    if not transcription(levels[-1].grid, free=True).curves.jumps:
        return change
    fall = _FIRST_ORDER
    if len(durations) > 2 and durations[-3] > durations[-2] > durations[-1]:
        first, second = -np.diff(durations[-3:])
        fall = min(max(second / first, _FIRST_ORDER), _SLOWEST_FALL)
    return change * fall / (1 - fall)


def _solved(grid: CollocationGrid, start: Nodes) -> _Level:
    """Return IPOPT's local optimum from `start`, if the verifier accepts it.

    Where rows are imposed at instants only, it dilates the motion into them.
    """
    solve = transcription(grid, free=True)
    optimum = solve(grid, start)
    duration = np.inf
    motion = grid.trajectory(optimum.nodes) if optimum.success else None
    if motion is not None:
        certificate = verify(grid.problem, motion)
        if certificate.feasible:
            duration = float(optimum.nodes.times.sum()) * grid.unit
        elif solve.curves.sampled:
            motion = certified(grid.problem, motion)
            duration = np.inf if motion is None else motion.duration
    return _Level(grid, optimum.nodes, motion, duration, optimum.status)


def _starts(grid: CollocationGrid, count: int) -> Iterator[Nodes]:
    """Yield `exact`'s motion, stopping, the first one slower, random ones.

    Rows of several joints, or with acceleration, lead far away from `exact`'s motion. Then the
    optimum on equal intervals is the first one.
    """
    if grid.asked.together or grid.bent.any():
        equal = transcription(grid)(grid, grid.stopping())
        if equal.success:
            yield equal.nodes
    relaxed = _relaxed(grid.problem)
    if relaxed:
        yield _placed(grid, relaxed)
    yield grid.stopping()
    if relaxed:
        at = relaxed.waypoint_times
        times = np.maximum(np.diff(at) / grid.unit, _BRIEFEST)
        velocities = relaxed(at, order=1)
        inner = velocities[grid.free] * grid.unit / grid.scale
        factor = max(_SLOWER, grid.dilation(relaxed))
        yield grid.cubics(factor * times, inner / factor)
    scaled = Scaled(grid.problem.without("jerk", *grid.problem.limits.beyond_rates))
    random = list(starting_points(scaled, count))[1:]
    # from the units of `exact` to the grid's
    speed = scaled.units[1] * grid.unit / grid.scale / _SLOWER
    for times, velocities, _ in random:
        slower = _SLOWER * times * scaled.unit / grid.unit
        yield grid.cubics(slower, velocities * speed)


def _relaxed(problem: Problem) -> Trajectory | None:
    """Return the optimum under the limits that `exact` knows."""
    planner = ExactJerk(starts=2) if problem.has("jerk") else Exact(starts=4)
    return planner.solve(problem.without(*problem.limits.beyond_rates)).trajectory


def _placed(grid: CollocationGrid, trajectory: Trajectory) -> Nodes:
    """Put equal intervals on a trajectory, and positions within their limits."""
    passed = trajectory.waypoint_times
    lengths = np.repeat(np.diff(passed) / grid.intervals, grid.intervals)
    times = np.append(0.0, np.cumsum(lengths))
    rates = [trajectory(times, order) for order in range(3)]
    # in the grid's units
    q, v, a = np.array(rates) / grid.scale
    moved = q - grid.origin / grid.scale
    unit = grid.unit
    return Nodes(
        times=np.diff(passed) / unit,
        lengths=np.tile(lengths[:, None] / unit, len(grid.scale)),
        q=np.clip(moved, *grid.reach),
        v=v * unit,
        a=a * unit**2,
    )
