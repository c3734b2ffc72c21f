"""The iterative spline parameterisation of MoveIt 1, as `tesseract-robotics` has it.

A cubic spline through given points, at rest at both ends, whose intervals are stretched by one
sixteenth of what is missing until every point keeps velocity and acceleration limits, and then all
at once by the remaining percent (K. Anderson, 2017). By default two points are added, so that the
motion also starts and ends without acceleration; they are left out of the answer, whose first and
last interval are longer for it.

The answer is what a controller executes: quintics through the answer's times, positions, velocities
and accelerations. Without added points these are the cubics themselves.

Choices and their sources (repository tesseract-robotics/tesseract_planning):

- points are added: the constructor's default; all other settings go without, which its description
  calls potentially faster;
- 20 points in every segment of a cubic spline, evenly spaced knots first: as `totg`, since
  Tesseract runs both on its planners' dense paths.

    from baselines.third_party.iterative_spline import IterativeSpline
    solution = IterativeSpline().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from baselines.third_party import Rival, splines_after
from baselines.third_party.tesseract import (
    LANGUAGE,
    TIMING,
    executed,
    limits,
    points,
    program,
    states,
)
from baselines.topp_ra import Ends, Knots
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import backend

_POINTS_PER_SEGMENT = 20
_FIRST: tuple[Any, Any] = ("uniform", "not-a-knot")


@dataclass(frozen=True)
class IterativeSpline(Rival):
    """MoveIt 1's iterative spline (Tesseract's) along a spline; the best of twelve splines.

    - `tries`: number of splines. 1: evenly spaced knots, not-a-knot, two points added.
    """

    requires = (LANGUAGE, TIMING)
    extra = "totg"
    settings = (
        ("points added", *_FIRST),
        *(("no points added", *rule) for rule in splines_after(_FIRST)[1:]),
    )

    def unsupported(self, problem: Problem) -> str | None:
        if problem.has("jerk"):
            return "the iterative spline does not limit jerk: its jerk jumps"
        return None

    def tried(
        self,
        problem: Problem,
        added: Literal["points added", "no points added"],
        knots: Knots,
        ends: Ends,
    ) -> Solution:
        language, timing = [backend(name, self.extra) for name in self.requires]
        positions, waypoints = points(problem, knots, ends, _POINTS_PER_SEGMENT)
        moves = program(positions, language)
        container = timing.InstructionsTrajectory(moves)
        parameterisation = timing.IterativeSplineParameterization(added == "points added")
        with inside_library():
            solved = parameterisation.compute(container, *limits(problem))
        if not solved:
            return Solution(Status.FAILED, message="the iterative spline found no timing")
        return Solution(Status.SOLVED, executed(states(moves, language), waypoints))
