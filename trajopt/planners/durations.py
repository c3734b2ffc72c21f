"""Give a motion the time that a problem asks of the whole of it: at least, or exactly.

A planner answers the problem without that demand. A faster motion is then slowed down, and no
motion of the problem is faster than the result: its time is the one that is asked for. From rest to
rest a dilation does that, which keeps every limit; waits keep their time. A route that begins or
ends in motion cannot be dilated: there the planner plans again, with a least time for each segment,
in the proportion of its fastest motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trajopt.core import dwell
from trajopt.core.demand import DEMANDS
from trajopt.core.numerals import rounded_down
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.given_times import GIVEN_RTOL
from trajopt.planners.rest_to_rest import end_to_end_bound


def timed(problem: Problem, answer: Solution, solve: Callable[[Problem], Solution]) -> Solution:
    """Return the answer to a problem with a time of the whole motion.

    Args:
        problem: With `least_duration` or `duration`.
        answer: The planner's answer to the problem without it.
        solve: The planner, for another problem of the same route.

    Returns:
        The answer with that time. Without a motion that has it, a status that says why:
        `infeasible` where a lower bound proves it.
    """
    demand = problem.route.demand
    asked = float(demand("least_duration") + demand("duration"))
    free = problem.without(*(key for key in problem.demands if DEMANDS[key].whole))
    bound = max(answer.lower_bound or 0.0, end_to_end_bound(free))
    if "duration" in problem.demands and bound > asked * (1 + GIVEN_RTOL):
        least = rounded_down(bound, ".6g")
        reason = f"every motion takes {least} s at least, {asked:.6g} s are asked for"
        return Solution(Status.INFEASIBLE, message=reason, lower_bound=bound)
    if answer.lower_bound is not None:
        answer = replace(answer, lower_bound=max(bound, asked))
    motion = answer.trajectory
    if motion is None or _has(problem, motion, asked):
        return answer
    if motion.duration > asked:
        return _without(answer, f"its fastest motion takes {motion.duration:.6g} s")
    answer = replace(answer, evaluations=None, history=None, stats=_unlike(answer))
    if free.route.dilatable:
        return replace(answer, trajectory=_slowed(free, motion, asked))
    again = solve(_as_slow(free, motion, asked))
    if again.trajectory is None or not _has(problem, again.trajectory, asked):
        found = again.trajectory.duration if again.trajectory else motion.duration
        return _without(again, f"{again.message or f'a motion takes {found:.6g} s'}")
    return replace(again, lower_bound=answer.lower_bound, stats=_unlike(again))


def _has(problem: Problem, motion: Trajectory, asked: float) -> bool:
    """Return whether a motion takes the time that is asked for, or longer if that is allowed."""
    ratio = motion.duration / asked
    return ratio >= 1 - GIVEN_RTOL and (
        "duration" not in problem.demands or ratio <= 1 + GIVEN_RTOL
    )


def _slowed(problem: Problem, motion: Trajectory, asked: float) -> Trajectory:
    """Return the motion dilated to a time, s; only the parts between waits are slowed down."""
    waits = float(problem.route.demand("dwell").sum())
    parts = dwell.cut(problem, motion) if waits else None
    if parts is None:
        return motion.dilated(asked / motion.duration)
    factor = (asked - waits) / (motion.duration - waits)
    return dwell.joined(problem, [part.motion.dilated(factor) for part in parts])


def _as_slow(problem: Problem, motion: Trajectory, asked: float) -> Problem:
    """Return the problem whose segments take at least their share of a time, s."""
    waits = np.array(problem.route.demand("dwell"))
    moving = np.diff(motion.waypoint_times) - waits[:-1]
    moving[-1] -= waits[-1]
    least = moving * (asked - waits.sum()) / moving.sum()
    demands = {**problem.demands, "least_times": np.maximum(least, 0.0)}
    return replace(problem, demands=demands)


def _without(answer: Solution, reason: str) -> Solution:
    """Return the answer without a motion: none of the time asked for was found."""
    message = f"no motion of the time asked for was found: {reason}"
    status = answer.status if answer.trajectory is None else Status.FAILED
    return replace(answer, status=status, trajectory=None, message=message, history=None)


def _unlike(answer: Solution) -> dict[str, object]:
    """Return the statistics that hold for a slower motion too: not the durations of its starts."""
    return {key: value for key, value in answer.stats.items() if key != "start_duration"}
