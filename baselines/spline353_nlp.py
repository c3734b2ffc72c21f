"""The best 3-5-3 spline with shared segment times, by a search over both ratios of the times.

A dilation meets all limits but those of position, so only the ratios of the times matter
(docs/mathematics.md, section 2), and the shortest dilated duration is a function of two variables.
It has kinks where two limits are active, so no derivative is used. The search begins at the local
minima of a grid. Around each it draws random candidates, keeps the shortest ones, and draws the
next candidates with their spread, until they are equally short. Each candidate's peaks are exact,
so each limit holds at every instant.

    from baselines.spline353_nlp import Spline353NLP
    solution = Spline353NLP().solve(problem)
    print(solution.trajectory.duration, solution.stats["segment_times"])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import LIMIT_NAMES, Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners import spline353
from trajopt.planners.planner import Planner
from trajopt.planners.reductions import SIMPLEST, reduced
from trajopt.planners.rest_to_rest import stop_times

# The grid: logarithms of the outer segment times over the middle one, each in its stop time.
_LOG_RATIOS = np.linspace(-10.0, 10.0, 61)
# Number of candidates of a round, and of the shortest ones around which the next round is drawn.
_CANDIDATES = 150
_KEPT = 16
# Factor on their spread. Without it the region would shrink before it reaches the optimum.
_SPREAD = 1.4
_MAX_ROUNDS = 300
# The search ends when their durations differ by less, relative.
_EQUAL_RTOL = 1e-12


@dataclass(frozen=True)
class Spline353NLP(Planner):
    """The best 3-5-3 spline with shared times (a search of both ratios, exact peaks)."""

    starts: int = 4

    knows = LIMIT_NAMES

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InvalidInput("starts", "at least 1", value=self.starts)

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    @reduced(SIMPLEST)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best of several local optima. `stats`: segment times, each start's duration.

        The answer does not depend on the seed.
        """
        reason = spline353.infeasible(problem)
        if reason is not None:
            return Solution(Status.INFEASIBLE, message=reason)
        spline = MovingSpline.of(problem)
        unit = stop_times(problem)
        optima = _local_optima(spline, unit, self.starts)
        durations = np.array([times.sum() for times in optima])
        times = optima[int(durations.argmin())]
        stats: dict[str, Any] = {"start_duration": durations, "segment_times": times}
        return Solution(Status.SOLVED, spline353.trajectory(problem, times), stats=stats)


@dataclass(frozen=True, eq=False)
class MovingSpline:
    """The 3-5-3 spline of the joints that move, as a function of the segment times.

    Attributes:
        displacements: Of each joint over the three segments, `(joints, 3)`, rad.
        limits: Of these joints.
        room: The position limits, seen from the second waypoint, `(joints, 2)`; None without any.
    """

    displacements: Array
    limits: Limits
    room: Array | None

    @classmethod
    def of(cls, problem: Problem) -> MovingSpline:
        """Return the spline of a problem with four waypoints that differ from their neighbours."""
        return cls(
            displacements=problem.displacements.T,
            limits=problem.limits,
            room=spline353.position_room(problem),
        )

    def dilation(self, times: Array) -> Array:
        """Return the least dilation of segment times `(…, 3)`, exactly, `(…)`."""
        return spline353.dilation(self.displacements, times[..., None, :], self.limits)

    def keeps_positions(self, times: Array) -> Bools:
        """Return whether every joint keeps its position limits at segment times `(…, 3)`."""
        if self.room is None:
            return np.ones(times.shape[:-1], dtype=bool)
        own_times = times[..., None, :]
        excess = spline353.position_excess(self.displacements, own_times, self.room)
        return np.equal(excess.max(axis=-1), 0)

    def dilated(self, times: Array) -> tuple[Array, Array]:
        """Return segment times `(…, 3)` dilated to the limits, and their sums, s.

        The sum is infinite where a position limit is broken.
        """
        kept = times * self.dilation(times)[..., None]
        total = np.where(self.keeps_positions(times), kept.sum(axis=-1), np.inf)
        return kept, total


def _local_optima(spline: MovingSpline, unit: Array, count: int) -> list[Array]:
    """Return segment times `(3,)`, s, of at most `count` feasible local optima, the best first.

    Args:
        spline: The spline.
        unit: Time from rest to rest of each segment, s.
        count: How many.
    """
    outer = np.meshgrid(_LOG_RATIOS, _LOG_RATIOS, indexing="ij")
    points = np.stack(outer, axis=-1)
    _, total = spline.dilated(_times(points, unit))
    if spline.room is not None and not np.isfinite(total).any():
        times = spline353.keeping_times(
            spline.displacements, spline.limits, spline.room, unit.max()
        )
        return [times]
    padded = np.pad(total, 1, mode="edge")
    neighbours = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    lowest = (total <= neighbours.min(axis=(2, 3))) & np.isfinite(total)
    by_duration = np.argsort(total[lowest])
    return [_narrowed(spline, unit, start) for start in points[lowest][by_duration[:count]]]


def _narrowed(spline: MovingSpline, unit: Array, start: Array) -> Array:
    """Return feasible segment times, s, of the local optimum near a point of the grid."""
    rng = np.random.default_rng(0)
    best = start
    apart = (_LOG_RATIOS[1] - _LOG_RATIOS[0]) * np.eye(2)
    for _ in range(_MAX_ROUNDS):
        drawn = best + rng.standard_normal((_CANDIDATES, len(apart))) @ apart
        points = np.vstack([best, drawn])
        times, total = spline.dilated(_times(points, unit))
        kept = np.argsort(total)[:_KEPT]
        best = points[kept[0]]
        if total[kept[-1]] <= total[kept[0]] * (1 + _EQUAL_RTOL):
            break
        apart = _SPREAD * (points[kept] - best) / np.sqrt(_KEPT)
    return np.asarray(times[kept[0]])


def _times(points: Array, unit: Array) -> Array:
    """Return segment times `(…, 3)`, s, of logarithms of both ratios `(…, 2)`."""
    return unit * np.exp(np.insert(points, 1, 0.0, axis=-1))
