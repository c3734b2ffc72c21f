"""Announce a planner that will take long, before it begins.

As a warning of the logger `trajopt.sizes`, so that a script sees it and can turn it off.
"""

from __future__ import annotations

from trajopt.core.problem import Problem

# A shorter time is not announced, s.
ANNOUNCED_SECONDS = 30.0


def cells(problem: Problem) -> int:
    """Segments times joints that move: what most planners' time grows with."""
    return problem.segments * int(problem.moving.sum())


def described(problem: Problem) -> str:
    """A problem's size in words."""
    joints = int(problem.moving.sum())
    return f"{problem.segments + 1} waypoints and {joints} moving joints"


def announce(planner: str, problem: Problem, seconds: float) -> None:
    """Log about how long a planner will need, if that is long.

    Args:
        planner: The planner's registered name.
        problem: What it is about to solve.
        seconds: What was measured on smaller problems, carried on.
    """
    if seconds > ANNOUNCED_SECONDS:
        import logging  # late: planners that are only listed need none of it

        size = described(problem)
        logger = logging.getLogger("trajopt.sizes")
        logger.warning("%s: %s will need about %.0f s or more", planner, size, seconds)
