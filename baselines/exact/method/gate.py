"""The gate after `exact` and `exact-jerk`: an answer that the judge certifies, or one that says no.

Where the planner's own answer is not certified, easier problems follow, whose motions are motions
of the whole problem too: smaller tolerances, exact points, a stop at every waypoint. The first that
the judge certifies is the answer, and its message names it. It is possible, not the fastest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from baselines.exact.method import bounds
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.judging.verification import flaws

# Shares of the tolerances. The first is for an optimum at an edge that no start reaches from
# inside; the last are the exact points. Smaller shares: a longer motion. More of them: more CPU
# time where all fail.
LADDER = (0.999, 0.9, 0.5, 0.0)
_NO_TIME = 1e-300  # a wait at which a motion stops, and which adds no time; 0 is no wait

Answer = Callable[[Problem], Solution]


def certified(problem: Problem, answer: Answer, in_parts: Answer) -> Solution:
    """Return the answer if the judge certifies it, else that of an easier problem.

    Args:
        problem: What is planned. Only its demands become easier.
        answer: Plans it, or an easier one.
        in_parts: Plans an easier one with waits: the parts between them one by one.

    Returns:
        A `relaxed` answer or a refusal as it is. Else `solved` with a certified motion, or
        `invalid` with the judge's flaw, or `failed`; `infeasible` where a bound proves that no
        motion has the given times.
    """
    found = answer(problem)
    if found.status not in (Status.SOLVED, Status.FAILED):
        return found
    if found.trajectory is not None:
        against = flaws(problem, found.trajectory)
        if not against:
            return found
        message = "; ".join(filter(None, [found.message, *against]))
        found = replace(found, status=Status.INVALID, message=message)
    if "given_times" in problem.demands:
        proved = bounds.impossible_times(problem) if found.trajectory is None else ""
        return Solution(Status.INFEASIBLE, message=proved, stats=found.stats) if proved else found
    for said, easier, plan in _easier(problem, answer, in_parts):
        other = plan(easier)
        motion = other.trajectory
        if motion is not None and not flaws(problem, motion):
            message = f"{said}, as its own answer is not certified ({found.message})"
            return replace(other, status=Status.SOLVED, message=message)
    return found


def _easier(
    problem: Problem, answer: Answer, in_parts: Answer
) -> Iterator[tuple[str, Problem, Answer]]:
    """Yield easier problems, what they are in words, and what plans them."""
    exact = problem.without("tolerance")
    if "tolerance" in problem.demands:
        for share in LADDER:
            said = f"planned within {share:g} of the tolerances" if share else "through the points"
            tolerance = share * problem.demands["tolerance"]
            easier = replace(problem, demands={**problem.demands, "tolerance": tolerance})
            yield said, easier if share else exact, answer
    if problem.segments > 1 and not problem.route.demand("closed"):
        waits = np.where(np.arange(len(problem.waypoints)) % problem.segments == 0, 0.0, _NO_TIME)
        still = replace(exact, demands={**exact.demands, "dwell": waits})
        yield "stops at every waypoint", still, in_parts
