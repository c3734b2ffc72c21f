"""Announce a planner that will take long, before it begins.

The announcement is a warning of the logger `trajopt.sizes`, so that scripts can turn it off.
"""

from __future__ import annotations

from trajopt.core.problem import Problem

# A shorter time is not announced, s.
ANNOUNCED_SECONDS = 30.0


def cells(problem: Problem) -> int:
    """Return segments times joints that move; the time of most planners grows with it."""
    return problem.segments * int(problem.moving.sum())


def described(problem: Problem) -> str:
    """Return a problem's size in words."""
    joints = int(problem.moving.sum())
    return f"{problem.segments + 1} waypoints and {joints} moving joints"


def announce(planner: str, problem: Problem, seconds: float) -> None:
    """Log an estimate of a planner's time, if it is long.

    Args:
        planner: The planner's registered name.
        problem: The problem that it is about to solve.
        seconds: The estimate, extrapolated from smaller problems, s.
    """
    if seconds > ANNOUNCED_SECONDS:
        import logging  # late: planners that are only listed need none of it

        size = described(problem)
        logger = logging.getLogger("trajopt.sizes")
        logger.warning("%s: %s will need about %.0f s or more", planner, size, seconds)
