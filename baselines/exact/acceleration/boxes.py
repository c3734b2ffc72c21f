"""Merge neighbouring waypoints whose tolerances overlap.

A tolerance makes a box around each waypoint. Where the boxes of two neighbours overlap in every
joint, the optimum may pass both at one instant. The segment's time is then 0, which its logarithm
does not reach. So further problems are solved, in which such neighbours are one waypoint in the
intersection of their boxes. The limits of the segment between them still count there, for what
does not jump: velocity, and acceleration where jerk is limited.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import NamedTuple, TypeVar

import numpy as np

from baselines.exact.method import free_pieces
from baselines.exact.method.planner import SeveralStarts, certified
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.end_states import impossible
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.joint_limit import UNLIMITED
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution

# Up to this many pairs of neighbours are also merged one pair at a time. More: a problem for each.
# Fewer: an optimum that passes one of several pairs at once is missed.
MAX_PAIRS = 8

PlannerT = TypeVar("PlannerT", bound=SeveralStarts)
Solve = Callable[[Problem, Array | None, PlannerT, bool], Solution]
Freely = Callable[..., Solution]  # as `Solve`, and `below`, s, by name


class Merged(NamedTuple):
    """A problem in which some neighbouring waypoints are merged.

    Attributes:
        problem: The problem with fewer waypoints.
        places: Index of each original waypoint among these, `(waypoints,)`.
        passing: Limits of velocity and acceleration at the waypoints, from the segments that were
            removed, in the form that `Scaled` takes; None where all segments have the same limits.
    """

    problem: Problem
    places: Indices
    passing: Array | None


def merged(problem: Problem) -> Iterator[Merged]:
    """Yield the problem itself, then the problems with merged neighbours."""
    count = len(problem.waypoints)
    yield Merged(problem, np.arange(count), None)
    pairs = np.flatnonzero(_overlapping(problem))
    choices = [_chain(problem, pairs)]
    if 1 < len(pairs) <= MAX_PAIRS:
        choices += [np.isin(np.arange(count - 1), pair) for pair in pairs]
    for joined in choices if len(pairs) else ():
        found = _joined(problem, joined)
        if found is not None:
            yield found


def or_freely(
    planner: PlannerT, problem: Problem, known: Problem, found: Solution, freely: Freely
) -> Solution:
    """Return an answer, or that of the second method where a bound leaves room and it is shorter.

    Args:
        planner: As `best` takes it.
        problem: The problem.
        known: The problem with the limits that the planner knows.
        found: The answer of the first method.
        freely: The second method, as `best` takes a planner's; `below`, s, ends what is no shorter.
    """
    if planner.is_near(known, found):
        return found
    below = certified(known, found)
    solve = partial(freely, below=below)
    other = best(planner, problem, solve, planner, free_pieces.choices(problem))
    return other if certified(known, other) < below else found


def best(
    planner: PlannerT,
    problem: Problem,
    solve: Solve[PlannerT],
    several: PlannerT,
    choices: int | None = None,
) -> Solution:
    """Return the shortest answer to the problem and to those with merged neighbours.

    Args:
        planner: Finds local optima from several initial guesses.
        problem: With a tolerance.
        solve: Returns the planner's answer to a problem with further limits at its waypoints, see
            `Merged.passing`. Its last argument tells whether more initial guesses are tried where
            all of the planner's have failed.
        several: The planner for each problem where there are several.
        choices: How many of these problems are solved; None: all.
    """
    whole, *others = islice(merged(problem), choices)
    if others:
        planner = several
    found: list[Solution] = []
    for own, index, passing in [*others, whole]:
        patient = all(known.trajectory is None for known in found)
        solution = solve(own, passing, planner, patient)
        motion = solution.trajectory
        if motion is not None:
            motion = replace(motion, waypoint_times=motion.waypoint_times[index])
        found.append(replace(solution, trajectory=motion))
    return min(found, key=lambda own: getattr(own.trajectory, "duration", np.inf))


def _box(problem: Problem) -> tuple[Array, Array]:
    r = problem.route.demand("tolerance")
    return problem.waypoints - r, problem.waypoints + r


def _overlapping(problem: Problem) -> Bools:
    """Return which segments may take no time, `(segments,)`."""
    low, high = _box(problem)
    # boxes that miss each other by the rounding of their coordinates touch
    touching = np.minimum(high[:-1], high[1:]) + problem.rounding
    overlaps = np.maximum(low[:-1], low[1:]) <= touching
    times = problem.route.demand("least_times") + problem.route.demand("given_times")
    return np.asarray(overlaps.all(axis=1) & (times == 0))


def _chain(problem: Problem, pairs: Indices) -> Bools:
    """Return a choice of segments that take no time: each where the boxes so far still overlap."""
    low, high = _box(problem)
    found = np.zeros(problem.segments, dtype=bool)
    least, most = low[0], high[0]
    for k in range(problem.segments):
        both = np.maximum(least, low[k + 1]), np.minimum(most, high[k + 1])
        found[k] = k in pairs and bool((both[0] <= both[1] + problem.rounding).all())
        least, most = both if found[k] else (low[k + 1], high[k + 1])
    return found


def _joined(problem: Problem, joined: Bools) -> Merged | None:
    """Return the problem in which these segments take no time; None if no motion is left."""
    index = np.append(0, np.cumsum(~joined))
    first = np.flatnonzero(np.diff(index, prepend=-1))
    low, high = _box(problem)
    low = np.maximum.reduceat(low, first)
    high = np.minimum.reduceat(high, first)
    # The last waypoint is kept whatever overlaps it: of a closed motion it is the first one again.
    kept = np.isin(np.arange(len(index)), [*first[:-1], len(index) - 1])
    route = problem.without("tolerance").route.at(kept)
    demands = {**route.demands, "tolerance": np.maximum(high - low, 0.0) / 2}
    limits = problem.limits.of_segments(np.flatnonzero(~joined))
    try:
        own = replace(problem, waypoints=(low + high) / 2, demands=demands, limits=limits)
    except InvalidInput:
        return None
    if impossible(own):  # a state at an end exceeds the limits of what is now the end segment
        return None
    return Merged(own, index, _passing(problem, index))


def _passing(problem: Problem, index: Indices) -> Array | None:
    """Return the limits at each waypoint, from the segments that were removed there."""
    limits = problem.limits
    if limits.segments is None:
        return None
    shape = (problem.segments, problem.joints, 2)
    pairs = np.stack(
        [np.broadcast_to(own, shape) for own in (limits.velocity, limits.acceleration)]
    )
    found = np.tile(UNLIMITED, (2, index[-1] + 1, problem.joints, 1))
    for segment in np.flatnonzero(np.diff(index) == 0):
        place = index[segment]
        found[:, place] = _tighter(found[:, place], pairs[:, segment])
    if problem.route.demand("closed"):
        # the first waypoint and the last one are passed in the same state
        found[:, 0] = found[:, -1] = _tighter(found[:, 0], found[:, -1])
    return found


def _tighter(pairs: Array, others: Array) -> Array:
    low, high = np.maximum(pairs, others)[..., 0], np.minimum(pairs, others)[..., 1]
    return np.stack([low, high], axis=-1)
