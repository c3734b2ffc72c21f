"""Anyone's motion as an entry of a comparison, beside the planners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.formats.motion import Motion
from trajopt.judging.passing import waypoint_times
from trajopt.planners.planner import Planner


@dataclass(frozen=True, eq=False)
class GivenMotion(Planner):
    """A motion that is there already: it is judged on every problem, through its own waypoints.

    Its options are what it is: the interpolation, and a digest of the polynomials that are
    executed. So a changed file is another motion, and old trials are not shown for it.
    """

    motion: Motion

    knows = ("velocity", "acceleration", "jerk", "position")

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The motion with the times at which it comes closest to the waypoints, in order."""
        own = self.motion.for_joints(problem.joint_names).trajectory
        times = waypoint_times(own, problem.waypoints)
        passing = Trajectory(own.breaks, own.coefficients, times)
        return Solution(Status.SOLVED, passing)

    def unsupported(self, problem: Problem) -> str | None:
        """Why it is no motion of this problem's robot."""
        joints = self.motion.trajectory.joints
        if joints != problem.joints:
            return f"a motion of {joints} joints; the problem has {problem.joints}"
        try:
            self.motion.for_joints(problem.joint_names).check_units(problem)
        except InvalidInput as error:
            return str(error)
        return None

    def options(self) -> dict[str, Any]:
        return {
            "interpolation": self.motion.interpolation,
            "digest": self.motion.digest(),
        }

    def defaults(self) -> dict[str, Any]:
        return self.options()
