"""Motions through many targets within a tolerance, of which few are planned for.

A motion through the targets at which a joint turns passes most of the others within the tolerance.
`passing` says which it misses; those are added. Under jerk limits a program through a dozen points
takes some hundredths of a second, and one through fifty within their tolerances some seconds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Planner

_LOOKED_AT = 200  # times between two waypoints at which a motion may pass others
_WITHOUT_JERK, _THROUGH_POINTS = "exact:within=1e-3", "exact-jerk:starts=1"
_MOST_ROUNDS = 12  # of adding what is missed; chunks of 50 targets need two to five
# Of the tolerance, in which the points lie: the rest is room for the way between them.
_SHARE = 0.8


def turning(problem: Problem) -> Bools:
    """Return the ends, and where a joint turns back beyond the tolerance, `(waypoints,)`."""
    places, r = problem.waypoints, problem.route.demand("tolerance")
    kept = np.zeros(len(places), dtype=bool)
    kept[[0, -1]] = True
    for x, far in zip(places.T, 2 * r.max(axis=0), strict=True):
        low = high = 0
        sign = 0  # of the direction since the last turn
        for i in range(1, len(x)):
            high = i if x[i] > x[high] else high
            low = i if x[i] < x[low] else low
            if sign >= 0 and x[high] - x[i] > far:
                kept[high], sign, low, high = True, -1, i, i
            elif sign <= 0 and x[i] - x[low] > far:
                kept[low], sign, low, high = True, 1, i, i
    return kept


class Passed(NamedTuple):
    """How a motion through some waypoints passes all.

    Attributes:
        times: at which it is nearest, in their order, s, `(waypoints,)`.
        missed: of the waypoints between two through which it goes, the one that it misses most;
            one for each such two, none where it misses none.
    """

    times: Array
    missed: list[int]


def passing(problem: Problem, kept: Bools, motion: Trajectory) -> Passed:
    """Return when a motion through some waypoints passes the others, and which it misses.

    Args:
        problem: all waypoints, and their tolerances.
        kept: through which the motion goes, `(waypoints,)`.
        motion: its waypoint times are those of these.
    """
    places, r = problem.waypoints, problem.route.demand("tolerance")
    times = np.zeros(len(places))
    times[kept] = motion.waypoint_times
    missed = []
    for first, last in pairwise(np.flatnonzero(kept).tolist()):
        at = np.linspace(times[first], times[last], _LOOKED_AT)
        way = motion(at)
        farthest, worst, after = 0.0, None, 0
        for i in range(first + 1, last):
            away = (np.abs(way[after:] - places[i]) - r[i]).max(axis=1)
            nearest = int(away.argmin())
            after += nearest
            times[i] = at[after]
            if away[nearest] > farthest:
                farthest, worst = float(away[nearest]), i
        if worst is not None:
            missed.append(worst)
    return Passed(times, missed)


@dataclass(frozen=True)
class FewTargets(Planner):
    """Quick motions under jerk limits: through a few points near the targets, exactly.

    The points are those of the fastest motion without jerk limits, within a share of the tolerance.
    For 50 targets of 7 joints that takes some tenths of a second, and 1 to 4 % more time than the
    full search of `exact-jerk` finds. From rest to rest only.
    """

    knows = ("velocity", "acceleration", "jerk", "tolerance")

    def unsupported(self, problem: Problem) -> str | None:
        if not problem.has("jerk"):
            return "it is for jerk limits"
        if "tolerance" not in problem.demands:
            return "it is for targets within a tolerance"
        return None

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        from trajopt.planners.registry import load  # late: the registry imports planners

        narrow = {**problem.demands, "tolerance": _SHARE * problem.route.demand("tolerance")}
        faster = replace(problem.without("jerk"), demands=narrow)
        near = load(_WITHOUT_JERK).solve(faster).trajectory
        if near is None:
            return Solution(Status.FAILED, message="no motion without jerk limits is found")
        points = near(near.waypoint_times)
        points[[0, -1]] = problem.waypoints[[0, -1]]
        exactly = replace(problem.without("tolerance"), waypoints=points)
        kept = turning(problem)
        through = load(_THROUGH_POINTS)
        for _ in range(_MOST_ROUNDS):
            motion = through.solve(exactly.at(kept)).trajectory
            if motion is None:
                return Solution(Status.FAILED, message="no motion through the points is found")
            passed = passing(problem, kept, motion)
            if not passed.missed:
                return Solution(Status.SOLVED, replace(motion, waypoint_times=passed.times))
            kept[passed.missed] = True
        return Solution(Status.FAILED, message="it misses targets")
