"""Problems with tiny steps in line: solved without the waypoints that rounding may miss.

Without the waypoints that may be spared (`trajopt.core.resolution`; mathematics, section 7) a
problem is a relaxation. Where its motion passes them all, within the rounding of coordinates, it is
the answer to the whole problem. Of those that it misses the worst one between two others is put
back, and so on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.solution import Solution
from trajopt.core.trajectory import Trajectory
from trajopt.judging.passing import misses
from trajopt.judging.verification import verify

MAX_ATTEMPTS = 4  # before the whole problem is solved
# An answer that is so close to the relaxation's, relative, is as good; so close, it is good enough.
SAME_RTOL = 1e-9
NEAR_RTOL = 1e-6
MISS = 0.25  # roundings of coordinates; a waypoint that is missed by more may be put back
NEWTON_STEPS = 8


Solve = Callable[[Problem, Array | None], Solution]


def solved(problem: Problem, known: Problem, solve: Solve) -> Solution:
    """Solve a problem, first without the waypoints that it may miss by rounding.

    Args:
        problem: Without consecutive identical waypoints.
        known: The problem without the limits that the answers ignore.
        solve: Answers a problem all of whose waypoints are exact. Its second argument is a waypoint
            that was left out of each segment, rad, `(segments, joints)`, not a number where none
            was; or None.

    Returns:
        The answer of the shortest certified duration. Its message says by how much that is above
        the relaxation's, and why the relaxation's motion is not the answer.
    """
    missing = spared(problem)
    if not missing.any():
        return solve(problem, None)
    relaxed = np.nan
    worst = 0.0  # by how many roundings the relaxation's motion misses a waypoint
    least = np.inf
    best = None
    for _ in range(MAX_ATTEMPTS):
        thinned = problem.at(~missing)
        solution = solve(thinned, _middles(problem, missing))
        if solution.trajectory is None:
            break
        motion = _timed(problem, solution.trajectory, ~missing)
        missed = np.where(missing, misses(problem, motion), 0.0)
        if best is None:
            relaxed = motion.duration
            worst = missed.max()
        duration = _certified(known, motion)
        if duration < least or best is None:
            least = duration
            best = replace(solution, trajectory=motion)
        is_missed = missed > MISS
        if least <= relaxed * (1 + SAME_RTOL) or not is_missed.any():
            break
        gap = np.cumsum(~missing)
        for number in np.unique(gap[is_missed]):
            own = np.flatnonzero(gap == number)
            missing[own[missed[own].argmax()]] = False
    if best is not None and least <= relaxed * (1 + NEAR_RTOL):
        return best
    whole = solve(problem, None)
    if best is None or whole.trajectory is None:
        return best or whole
    duration = _certified(known, whole.trajectory)
    if duration < least:
        least = duration
        best = whole
    if least <= relaxed * (1 + NEAR_RTOL):
        return best
    above = 100 * (least / relaxed - 1)
    said = f"{above:.2g} % above {relaxed:.6g} s, the best known without its tiny steps"
    if worst > 1:
        said += f": that motion misses a waypoint by {worst:.2g} times what rounding allows"
    return replace(best, message="; ".join(filter(None, [best.message, said])))


def _middles(problem: Problem, missing: Bools) -> Array:
    """The middle one of the waypoints that are missing in each segment, `(segments, joints)`."""
    at = np.flatnonzero(~missing)
    middles = (at[:-1] + at[1:]) // 2
    is_missing = missing[middles]
    return np.where(is_missing[:, None], problem.waypoints[middles], np.nan)


def _certified(known: Problem, motion: Trajectory) -> float:
    return verify(known, motion).certified_duration or np.inf


def _timed(problem: Problem, motion: Trajectory, kept: Bools) -> Trajectory:
    """The motion through some waypoints, with the times at which it comes nearest to the others.

    Between two waypoints the speed hardly changes: Newton's method finds them.
    """
    numbers = np.arange(len(kept))
    at = np.flatnonzero(kept)
    places = np.cumsum(kept) - 1
    passed = motion.waypoint_times
    early = passed[places]
    late = passed[np.minimum(places + 1, len(at) - 1)]
    times = np.interp(numbers, at, passed)
    for _ in range(NEWTON_STEPS):
        step = _ahead(problem, motion, times)
        times = np.where(kept, times, np.clip(times - step, early, late))
    return replace(motion, waypoint_times=np.maximum.accumulate(times))


def _ahead(problem: Problem, motion: Trajectory, times: Array) -> Array:
    """How much later than nearest to each waypoint these times are, s, `(waypoints,)`."""
    rounding = np.maximum(problem.rounding, np.finfo(float).tiny)
    away = (motion(times) - problem.waypoints) / rounding
    velocity = motion(times, 1) / rounding
    speed = np.square(velocity).sum(axis=1)
    return np.asarray((away * velocity).sum(axis=1) / np.where(speed > 0, speed, np.inf))
