"""Problems with tiny steps: solved without the waypoints that a motion may miss by rounding.

Such a waypoint lies between two short steps in one line (`trajopt.core.resolution`; mathematics,
section 9). Without these waypoints the problem is a relaxation. If its motion passes all of them
within the rounding of coordinates, it is the answer to the whole problem. Otherwise, between each
two remaining waypoints, the one that is missed most is put back, and the problem is solved again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.passing import misses
from trajopt.judging.verification import verify
from trajopt.planners.reductions import RESTING_JOINTS

# Attempts before the whole problem is solved. Fewer: it is solved more often, with times of 1e-6 of
# the others. More: CPU time for waypoints that are missed whatever is put back.
MAX_ATTEMPTS = 4
# Excess over the relaxation's duration, relative. Below the first no further attempt is made, below
# the second the whole problem is not solved. Larger: the answer may be too long by as much.
# Smaller: more problems are solved for an answer that is as short.
SAME_RTOL = 1e-9
NEAR_RTOL = 1e-6
# In roundings of coordinates: a waypoint that is missed by more may be put back. The judge allows
# 1; the rest is for the rounding of the motion itself.
MISS = 0.25
NEWTON_STEPS = 8  # to the time of the nearest point: quadratic, so 8 end at rounding


Solve = Callable[[Problem, Array | None], Solution]


def solved(
    problem: Problem,
    known: Problem,
    solve: Solve,
    briefly: Solve | None = None,
    stopping: Solve | None = None,
) -> Solution:
    """Solve a problem, first without the waypoints that it may miss by rounding.

    Args:
        problem: Without consecutive identical waypoints.
        known: The problem without the limits that the answers ignore.
        solve: Solves a problem whose waypoints are all exact. Its second argument has one of the
            waypoints left out of each segment, rad, `(segments, joints)`, NaN where there is none;
            or it is None.
        briefly: Likewise, in a bounded time: for waypoints that are put back. By default `solve`.
        stopping: Likewise, at rest at every waypoint, for where nothing else is certified in less.

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
    attempt = solve
    for _ in range(MAX_ATTEMPTS):
        thinned = problem.at(~missing)
        # a joint may move past those steps alone
        middles = _middles(problem, missing)[:, thinned.moving]
        solution = attempt(RESTING_JOINTS.apply(thinned), middles)
        solution = RESTING_JOINTS.invert(thinned, solution)
        attempt = briefly or solve
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
    for other in filter(None, (attempt, stopping)):
        whole = other(problem, None)
        duration = np.inf
        if whole.trajectory is not None:
            duration = _certified(known, whole.trajectory)
        if best is None or duration < least:
            least = duration
            best = whole
    assert best is not None
    if best.trajectory is not None and not np.isfinite(least):
        said = "no motion found that keeps the limits and passes the tiny steps"
        return replace(best, status=Status.FAILED, message=said)
    if not least > relaxed * (1 + NEAR_RTOL):
        return best
    above = 100 * (least / relaxed - 1)
    said = f"{above:.2g} % above {relaxed:.6g} s, the best known without its tiny steps"
    if worst > 1:
        said += f": that motion misses a waypoint by {worst:.2g} times what rounding allows"
    return replace(best, message="; ".join(filter(None, [best.message, said])))


def _middles(problem: Problem, missing: Bools) -> Array:
    """Return the middle waypoint of those left out of each segment, `(segments, joints)`."""
    at = np.flatnonzero(~missing)
    middles = (at[:-1] + at[1:]) // 2
    is_missing = missing[middles]
    return np.where(is_missing[:, None], problem.waypoints[middles], np.nan)


def _certified(known: Problem, motion: Trajectory) -> float:
    """Return the certified duration, s; infinite where there is none."""
    return verify(known, motion).certified_duration or np.inf


def _timed(problem: Problem, motion: Trajectory, kept: Bools) -> Trajectory:
    """Return the motion with a time for every waypoint: where it is nearest to those left out.

    Newton's method finds these times. It converges since the speed hardly changes in between.
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
    """Return Newton's step to the nearest point to each waypoint, s, `(waypoints,)`."""
    rounding = np.maximum(problem.rounding, np.finfo(float).tiny)
    away = (motion(times) - problem.waypoints) / rounding
    velocity = motion(times, 1) / rounding
    speed = np.square(velocity).sum(axis=1)
    return np.asarray((away * velocity).sum(axis=1) / np.where(speed > 0, speed, np.inf))
