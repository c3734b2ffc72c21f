"""MoveIt's default chain, TOTG and then Ruckig's smoothing, as `tesseract-robotics` has it.

TOTG times a path's points (`baselines/third_party/totg.py`). The smoothing asks Ruckig, point by
point, whether the next point is reached under the jerk limits within the mean interval; while one
is not, it stretches all intervals by a tenth and sets each acceleration to the difference of
velocities over the mean interval. The answer is what a controller executes: quintics through the
answer's times, positions, velocities and accelerations. The last acceleration alone is set to zero:
the smoothing leaves a difference of velocities, and a motion that ends with it breaks every jerk
limit. The positions are the path's points, since the smoothing moves none.

The smoothing keeps one mean interval: the more points, the shorter it is against the longest that
Ruckig needs, and the longer the motion becomes.

Choices and their sources (repositories moveit/moveit2 and tesseract-robotics/tesseract_planning):

- a circle may leave its corner by 0.1 rad: `DEFAULT_PATH_TOLERANCE`, the default of both;
- jerk is limited to 1000 rad/s³ where the problem states no limit: MoveIt's `DEFAULT_MAX_JERK`;
- intervals are stretched by a tenth, at most tenfold: defaults of `RuckigTrajectorySmoothing`;
- five points in every segment, evenly spaced knots first: about one in 0.1 s on the six-axis
  problem, MoveIt's `resample_dt`. Our other eleven tries: the waypoints alone, and two or three
  points in every segment of five splines.

    from baselines.third_party.totg_ruckig import TotgRuckig
    solution = TotgRuckig().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass

from baselines.third_party import Rival
from baselines.third_party.tesseract import (
    LANGUAGE,
    TIMING,
    executed,
    limits,
    points,
    program,
    states,
)
from baselines.third_party.totg import SAME_POINT, TOLERANCE
from baselines.topp_ra import Ends, Knots
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import backend

_SPLINES = (
    ("uniform", "clamped"),
    ("chord", "clamped"),
    ("centripetal", "clamped"),
    ("limit", "clamped"),
    ("uniform", "natural"),
)


@dataclass(frozen=True)
class TotgRuckig(Rival):
    """MoveIt's TOTG and Ruckig smoothing (Tesseract's); the best of twelve sets of points.

    - `tries`: number of sets. 1: five points in every segment, evenly spaced knots, not-a-knot.
    """

    requires = (LANGUAGE, TIMING)
    extra = "totg"
    knows = ("velocity", "acceleration", "jerk")
    settings = (
        (5, "uniform", "not-a-knot"),
        (1, "the waypoints", "alone"),
        *((count, *rule) for count in (2, 3) for rule in _SPLINES),
    )

    def tried(self, problem: Problem, count: int, knots: Knots, ends: Ends) -> Solution:
        language, timing = [backend(name, self.extra) for name in self.requires]
        positions, waypoints = points(problem, knots, ends, count)
        moves = program(positions, language)
        container = timing.InstructionsTrajectory(moves)
        bounds = limits(problem)
        with inside_library():
            generation = timing.TimeOptimalTrajectoryGeneration(TOLERANCE, SAME_POINT)
            solved = generation.compute(container, *bounds)
            if not solved:
                return Solution(Status.FAILED, message="TOTG found no timing")
            solved = timing.RuckigTrajectorySmoothing().compute(container, *bounds)
        if not solved:
            return Solution(Status.FAILED, message="Ruckig's smoothing found no timing")
        timed = states(moves, language)
        timed.accelerations[-1] = 0
        return Solution(Status.SOLVED, executed(timed, waypoints))
