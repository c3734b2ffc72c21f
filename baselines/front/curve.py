"""The front of a problem: the smoothest motion of each duration, and what is proved below it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from baselines.front.bound import prove
from baselines.front.least import Measure, least, without_limits
from baselines.lower_bound.incumbent import incumbent
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.judging.smoothness import FrontPoint

# Relative distances of the bounds from the best motions that are close enough.
_FREE_WITHIN = 2e-3
_LIMITS_WITHIN = 5e-3
_REFERENCE_SECONDS = 10.0
# Times the shortest known duration, where no durations are asked for.
_FACTORS = (1.05, 1.1, 1.2, 1.35, 1.5, 2.0, 3.0)


def front(
    problem: Problem, measure: Measure, durations: Sequence[float] | None, time_limit: float
) -> list[FrontPoint]:
    """Return a point for each duration, in order.

    Args:
        problem: All its limits are kept.
        measure: Whose square is integrated.
        durations: s; by default from 1.05 to 3 times the shortest known.
        time_limit: Of the bound of each point, s.

    Raises:
        InvalidInput: No motion of a duration is found, or no motion at all.
    """
    merged, index = problem.merged()
    order = 3 if measure == "jerk" else 2
    power = 2 * order - 1
    known = incumbent(merged, _REFERENCE_SECONDS)
    if durations is None:
        if known is None:
            raise InvalidInput("durations", "given: no motion that keeps every limit is known")
        durations = [factor * known.duration for factor in _FACTORS]
    free = without_limits(merged, measure)
    free_lower = 0.0
    if free is not None and time_limit > 0:
        deadline = time.perf_counter() + time_limit
        free_lower = prove(merged, order, None, free, within=_FREE_WITHIN, deadline=deadline).lower
    points = []
    for duration in durations:
        start = None if known is None else known.trajectory
        found = least(merged, measure, duration, start)
        if found is None:
            right = "durations of motions that keep every limit"
            if known is not None:
                right += f", the shortest known takes {known.duration:.6g} s"
            raise InvalidInput("durations", right, value=duration)
        lower = free_lower / duration**power
        if found.limits_act and time_limit > 0 and lower < found.value * (1 - _LIMITS_WITHIN):
            bound = prove(
                merged,
                order,
                duration,
                found.value,
                within=_LIMITS_WITHIN,
                deadline=time.perf_counter() + time_limit,
                times=np.diff(found.trajectory.waypoint_times),
            )
            lower = max(lower, bound.lower)
        passed = found.trajectory.waypoint_times[index]
        trajectory = replace(found.trajectory, waypoint_times=passed)
        points.append(FrontPoint(duration, found.value, lower or None, trajectory))
    return points
