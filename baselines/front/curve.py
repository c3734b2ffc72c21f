"""The front of a problem: the smoothest motion of each duration, with a proved lower bound."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from baselines.front.bound import FrontBound, chosen_waypoints, prove
from baselines.front.least import Least, Measure, least, without_limits
from baselines.lower_bound.incumbent import incumbent
from trajopt.core.arrays import Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.judging.smoothness import FrontPoint
from trajopt.planners.reductions import EQUAL_WAYPOINTS

# Relative gaps between bounds and best motions at which to stop.
_FREE_WITHIN = 2e-3
LIMITS_WITHIN = 5e-3
# A waypoint is left out if the best integrals with and without it differ by less, relative.
_SAME_RTOL = 1e-3
_ORDERS: dict[Measure, int] = {"jerk": 3, "acceleration": 2}
_REFERENCE_SECONDS = 10.0
# Durations where none are asked for, relative to the shortest known one.
_FACTORS = (1.05, 1.1, 1.2, 1.35, 1.5, 2.0, 3.0)


def front(
    problem: Problem,
    measure: Measure,
    durations: Sequence[float] | None,
    time_limit: float,
    tell: Callable[[str], None],
) -> list[FrontPoint]:
    """Return a point for each duration, in order.

    Args:
        problem: All its limits are kept.
        measure: `jerk` or `acceleration`, whose square is integrated.
        durations: s; by default from 1.05 to 3 times the shortest known.
        time_limit: CPU time of the bound of each point, s.
        tell: Called with what is done next, and at first with how long all may take.

    Raises:
        InvalidInput: No motion of a duration is found, or no motion at all.
    """
    merged = EQUAL_WAYPOINTS.apply(problem)
    power = 2 * _ORDERS[measure] - 1
    known = incumbent(merged, _REFERENCE_SECONDS)
    if durations is None:
        if known is None:
            raise InvalidInput("durations", "given: no motion that keeps every limit is known")
        durations = [factor * known.duration for factor in _FACTORS]
    most = (len(durations) + 1) * time_limit
    proofs = f"proofs take up to {most:.0f} CPU s" if most else "nothing is proved"
    tell(f"{len(durations)} durations, {proofs}")
    free = None
    if time_limit > 0:
        free = free_bound(merged, measure, time_limit)
    points = []
    for number, duration in enumerate(durations, start=1):
        tell(f"{duration:.4g} s, {number} of {len(durations)}")
        start = None if known is None else known.trajectory
        found = least(merged, measure, duration, start)
        if found is None:
            right = "durations of motions that keep every limit"
            if known is not None:
                right += f", the shortest known takes {known.duration:.6g} s"
            raise InvalidInput("durations", right, value=duration)
        lower = free.lower / duration**power if free is not None else 0.0
        if found.limits_act and time_limit > 0 and lower < found.value * (1 - LIMITS_WITHIN):
            bound = bound_with_limits(merged, measure, found, time_limit)
            lower = max(lower, bound.lower)
        trajectory = EQUAL_WAYPOINTS.restored(problem, found.trajectory)
        points.append(FrontPoint(duration, found.value, lower or None, trajectory))
    return points


def free_bound(problem: Problem, measure: Measure, time_limit: float) -> FrontBound:
    """Prove a bound for 1 s without limits; divided by a power of a duration it holds for that one.

    If there are more than three segments, four waypoints are kept. If a segment is so short that
    its time may be almost 0, the bound without one of its waypoints is better.
    """
    deadline = time.process_time() + time_limit
    kept = chosen_waypoints(problem, _ORDERS[measure])
    best = _free_bound(problem, measure, kept, deadline if len(kept) == 2 else _halfway(deadline))
    if best.closed:
        return best
    for dropped in range(1, len(kept) - 1):
        fewer = np.delete(kept, dropped)
        if len(_of(problem, fewer).merged()[1]) > _of(problem, fewer).merged()[1].max() + 1:
            continue  # its neighbours are equal: without it the bound is weak
        other = _free_bound(problem, measure, fewer, deadline)
        if other.lower > best.lower:
            best = other
    return best


def bound_with_limits(
    problem: Problem, measure: Measure, found: Least, time_limit: float
) -> FrontBound:
    """Prove a bound for the duration of a motion, with the limits that are active in it."""
    deadline = time.process_time() + time_limit
    kept, own = _kept(problem, measure, found)
    times = np.diff(own.trajectory.waypoint_times)
    if len(times) > len(kept) - 1:
        times = np.diff(own.trajectory.waypoint_times[kept])
    return prove(
        problem,
        _ORDERS[measure],
        found.duration,
        own.value,
        within=LIMITS_WITHIN,
        deadline=deadline,
        times=times,
        kept=kept,
    )


def _kept(problem: Problem, measure: Measure, found: Least) -> tuple[Indices, Least]:
    """Return the waypoints that a bound with limits keeps, and the best motion through these.

    A waypoint that the best motion passes also without being asked to is left out: the bound is the
    same, with fewer segment times. An example are the inner waypoints of a single joint that never
    turns.
    """
    most = chosen_waypoints(problem, _ORDERS[measure])
    inner = most[1:-1].tolist()
    for count in range(len(inner) + 1):
        for some in combinations(inner, count):
            kept = np.array([most[0], *some, most[-1]])
            if len(kept) == len(problem.waypoints):
                return kept, found
            if not np.diff(problem.waypoints[kept], axis=0).any(axis=1).all():
                continue  # its neighbours are equal
            guess = found.trajectory_of(kept)
            own = least(_of(problem, kept), measure, found.duration, guess)
            if own is None or not own.limits_act:
                continue
            if kept.size == most.size or own.value >= found.value * (1 - _SAME_RTOL):
                return kept, own
    return most, found


def _free_bound(problem: Problem, measure: Measure, kept: Indices, deadline: float) -> FrontBound:
    value = without_limits(_of(problem, kept), measure) or 0.0
    return prove(
        problem,
        _ORDERS[measure],
        None,
        value,
        within=_FREE_WITHIN,
        deadline=deadline,
        kept=kept,
    )


def _halfway(deadline: float) -> float:
    now = time.process_time()
    return now + 0.5 * (deadline - now)


def _of(problem: Problem, kept: Indices) -> Problem:
    """Return the problem of some waypoints, a relaxation."""
    chosen = np.zeros(len(problem.waypoints), dtype=bool)
    chosen[kept] = True
    return problem.at(chosen)
