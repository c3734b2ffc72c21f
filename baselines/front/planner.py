"""The registered planner of the smoothest motion of a duration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import LIMIT_NAMES
from trajopt.core.numerals import is_number
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.smoothness import FrontPoint
from trajopt.planners.planner import Planner
from trajopt.planners.reductions import EQUAL_WAYPOINTS, reduced
from trajopt.planners.rest_to_rest import end_to_end_bound

if TYPE_CHECKING:
    from baselines.front.least import Least

# The duration where neither a duration nor a budget is given, relative to the shortest known one.
_DEFAULT_FACTOR = 1.2
_REFERENCE_SECONDS = 10.0


@dataclass(frozen=True)
class Smooth(Planner):
    """Least ∫ jerk² for a duration, or least duration for an ∫ jerk² (CasADi/IPOPT).

    Every kind of limit is kept at every instant.

    - `measure`: `jerk` or `acceleration`, whose square is integrated; with `acceleration` it may
      jump, unless jerk is limited;
    - `duration`: s, of the motion; by default 1.2 times the shortest known;
    - `budget`: upper limit of the integral, as `trajopt judge` states it. The answer is then the
      shortest motion within it.
    """

    measure: Literal["jerk", "acceleration"] = "jerk"
    duration: float | None = None
    budget: float | None = None

    on_request = True
    requires = ("casadi",)
    knows = LIMIT_NAMES

    def unsupported(self, problem: Problem) -> str | None:
        if problem.limits.segments is not None:
            return "it does not know limits of one segment"
        return None

    def __post_init__(self) -> None:
        if self.measure not in ("jerk", "acceleration"):
            raise InvalidInput("measure", "'jerk' or 'acceleration'", value=self.measure)
        for name in ("duration", "budget"):
            value = getattr(self, name)
            if value is not None and not (is_number(value) and 0 < value < np.inf):
                raise InvalidInput(name, "a positive number", value=value)
        if self.duration is not None and self.budget is not None:
            raise InvalidInput("budget", "a duration or a budget, not both", value=self.budget)

    def front(
        self,
        problem: Problem,
        durations: Sequence[float] | None,
        time_limit: float,
        tell: Callable[[str], None],
    ) -> list[FrontPoint]:
        """Return the front of this measure, as `baselines.front.curve.front` does."""
        from baselines.front.curve import front

        return front(problem, self.measure, durations, time_limit, tell)

    def smoothed(self, problem: Problem, motion: Trajectory) -> Trajectory:
        """Return the smoothest motion of the same waypoint times (`baselines.front.least`)."""
        from baselines.front.least import smoothed

        return smoothed(problem, motion)

    # Joints that rest stay: the units of all joints are part of the measure.
    @reduced(EQUAL_WAYPOINTS)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best local optimum. `stats`: `value`, the integral; `limits_act`.

        `limits_act` is 1 where some limit is active. Otherwise a dilation of the motion is the
        answer for another duration.
        """
        # late: planners that are only listed need none of it
        from baselines.front.least import free, least, shortest
        from baselines.lower_bound.incumbent import incumbent

        if self.duration is not None:
            unhindered = free(problem, self.measure, self.duration)
            if unhindered is not None:
                return _solved(unhindered)
        known = incumbent(problem, _REFERENCE_SECONDS)
        start = None if known is None else known.trajectory
        duration = self.duration
        if self.budget is not None:
            found = shortest(problem, self.measure, self.budget, start)
            asked = f"an integral of {self.budget:g}"
        else:
            if duration is None:
                if known is None:
                    message = "no motion keeps every limit; give a duration or a budget"
                    return Solution(Status.FAILED, message=message)
                duration = _DEFAULT_FACTOR * known.duration
            if duration < end_to_end_bound(problem):
                message = f"no motion takes {duration:.6g} s: every one takes longer"
                return Solution(Status.INFEASIBLE, message=message)
            found = least(problem, self.measure, duration, start)
            asked = f"{duration:.6g} s"
        if found is None:
            shortest_known = (
                "" if known is None else f"; the shortest known: {known.duration:.6g} s"
            )
            message = f"no motion found with {asked}{shortest_known}"
            return Solution(Status.FAILED, message=message)
        return _solved(found)


def _solved(found: Least) -> Solution:
    stats = {"value": found.value, "limits_act": int(found.limits_act)}
    return Solution(Status.SOLVED, found.trajectory, stats=stats)
