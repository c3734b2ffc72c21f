"""MoveIt's time-optimal trajectory generation (TOTG), as `tesseract-robotics` has it.

Straight lines between given points, rounded by circles, are traversed as fast as velocity and
acceleration limits allow (Kunz and Stilman, RSS 2012). A planner gives it a dense path: here points
of a cubic spline through the waypoints. TOTG returns the time, velocity and acceleration of every
point, and no function; what runs between them is a choice: a controller's cubic or quintic Hermite
piece, or the cubic spline through the points at these times.

    from baselines.third_party.totg import Totg
    solution = Totg().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from baselines.third_party import imported
from baselines.topp_ra import best_of, rules, spline
from trajopt.exceptions import InvalidInput
from trajopt.interpolation import Interpolation
from trajopt.planner import Planner, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

# rad/s³, no limit: the package asks for one and does not use it.
_JERK = 1000.0
# rad: the widest is MoveIt's default; the corners of a finer path need less.
_TOLERANCES = (1e-3, 1e-2, 0.1)


@dataclass(frozen=True)
class Totg(Planner):
    """MoveIt's TOTG (Tesseract's) through points of a spline; by default the best of 108 answers.

    - `knots`: the spline's parameter from waypoint to waypoint grows by 1, by the chord's length,
      by its square root, or by the time from stop to stop;
    - `ends`: the spline's end rule;
    - `points`: of the path, in each segment;
    - `tolerance`: how far the rounded path may leave them, rad; by default the best of 0.001, 0.01
      and 0.1, MoveIt's. The points themselves are passed, at the times of the rounded path;
    - `interpolation`: between the returned points.
    """

    knots: Literal["uniform", "chord", "centripetal", "limit", "best"] = "best"
    ends: Literal["not-a-knot", "natural", "clamped", "best"] = "best"
    points: int = 10
    tolerance: float | None = None
    interpolation: Literal["cubic", "quintic", "spline", "best"] = "best"

    on_request = True
    requires = ("tesseract_robotics",)
    extra = "totg"

    def __post_init__(self) -> None:
        if self.points < 1:
            raise InvalidInput("points", "at least 1", value=self.points)
        for tolerance in self._tolerances:
            if not 0 < tolerance < np.inf:
                raise InvalidInput("tolerance", "a positive number", value=tolerance)

    @property
    def _tolerances(self) -> tuple[float, ...]:
        if self.tolerance is None:
            return _TOLERANCES
        return (self.tolerance,)

    def unsupported(self, problem: Problem) -> str | None:
        if problem.has("jerk"):
            return "TOTG does not limit jerk: its accelerations jump"
        return None

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of its paths' timings. `stats`: the path, and every path's result."""
        module = "tesseract_robotics.tesseract_command_language"
        language, seconds = imported(module, self.extra)
        module = "tesseract_robotics.tesseract_time_parameterization"
        timing, more = imported(module, self.extra)
        solutions: dict[str, Solution] = {}
        for knots, ends in rules(self.knots, self.ends):
            path = spline(problem, knots, ends)
            for tolerance in self._tolerances:
                found = self._along(
                    problem,
                    path,
                    tolerance,
                    language,
                    timing,
                )
                for kind, solution in found.items():
                    solutions[f"{knots}/{ends}/{tolerance:g}/{kind}"] = solution
        return replace(best_of(problem, solutions), setup_time=seconds + more)

    def _along(
        self,
        problem: Problem,
        path: Trajectory,
        tolerance: float,
        language: Any,
        timing: Any,
    ) -> dict[str, Solution]:
        """One path's timing, by what runs between its points."""
        shares = np.arange(self.points) / self.points
        starts = path.breaks[:-1, None]
        inside = starts + path.lengths[:, None] * shares
        positions = path(np.r_[inside.ravel(), path.duration])
        program = _program(positions, language)
        container = timing.InstructionsTrajectory(program)
        generation = timing.TimeOptimalTrajectoryGeneration(tolerance, 1e-9)
        jerk = np.full((problem.joints, 2), [-_JERK, _JERK])
        velocity = _narrowed(problem.limits.velocity)
        acceleration = _narrowed(problem.limits.acceleration)
        if not generation.compute(container, velocity, acceleration, jerk):
            return {"failed": Solution(Status.FAILED, message="TOTG found no timing")}
        times, velocities, accelerations = _states(program, language)
        if (np.diff(times) <= 0).any():
            message = "TOTG passes two points at one instant"
            return {"failed": Solution(Status.FAILED, message=message)}
        kinds: list[Interpolation] = ["cubic", "quintic", "spline"]
        if self.interpolation != "best":
            kinds = [self.interpolation]
        answers = {}
        for kind in kinds:
            answer = Trajectory.from_samples(
                times,
                positions,
                velocities,
                accelerations,
                interpolation=kind,
                waypoint_times=times[:: self.points],
            )
            answers[str(kind)] = Solution(Status.SOLVED, answer)
        return answers


def _narrowed(bounds: Array) -> Array:
    """Limits at their tighter side, both ways: TOTG knows no others."""
    tighter = np.abs(bounds).min(axis=1)
    return np.stack([-tighter, tighter], axis=1)


def _program(positions: Array, language: Any) -> Any:
    """Tesseract's program of one move per point."""
    names = [f"joint{joint}" for joint in range(positions.shape[1])]
    program = language.CompositeInstruction()
    for position in positions:
        state = language.StateWaypoint(names, position)
        waypoint = language.StateWaypointPoly_wrap_StateWaypoint(state)
        move = language.MoveInstruction(waypoint, language.MoveInstructionType_FREESPACE)
        program.appendMoveInstruction(language.MoveInstructionPoly_wrap_MoveInstruction(move))
    return program


def _states(program: Any, language: Any) -> tuple[Array, Array, Array]:
    """Time, velocity and acceleration of every point."""
    times = []
    velocities = []
    accelerations = []
    for i in range(len(program)):
        # each view keeps the one before alive: Tesseract's own do not
        instruction = program[i]
        move = language.InstructionPoly_as_MoveInstructionPoly(instruction)
        waypoint = move.getWaypoint()
        state = language.WaypointPoly_as_StateWaypointPoly(waypoint)
        times.append(state.getTime())
        velocities.append(np.array(state.getVelocity()).ravel())
        accelerations.append(np.array(state.getAcceleration()).ravel())
    return np.array(times), np.array(velocities), np.array(accelerations)
