"""The waypoints that a lower bound counts: without a waypoint a problem is a relaxation.

Those that rounding may miss are left out (`trajopt.core.resolution`). Where many boxes of waypoints
within tolerance overlap, the segments between may take no time, each a case of the proof. A proof
without those whose boxes do not leave the box before them, or the next point at which the motion
waits or ends, has fewer cases.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from baselines.lower_bound.relaxation import APART
from trajopt.core.arrays import Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared, thinned


def counted(problem: Problem) -> Bools:
    """Return which waypoints are enough for most of a bound, `(waypoints,)`.

    Args:
        problem: Without consecutive identical waypoints.
    """
    if "tolerance" not in problem.demands:
        return ~spared(problem)
    r = problem.route.demand("tolerance")

    demand = problem.route.demand
    times = demand("least_times") + demand("given_times")

    def are_apart(one: int, other: int) -> bool:
        if times[one:other].any():
            return True
        distance = np.abs(problem.waypoints[one] - problem.waypoints[other])
        return bool((distance > APART * (r[one] + r[other])).any())

    stays = problem.route.demand("dwell") > 0
    stays[[0, -1]] = True
    kept = [0]
    for k in range(1, len(stays)):
        while stays[k] and not stays[kept[-1]] and not are_apart(kept[-1], k):
            kept.pop()
        if stays[k] or are_apart(kept[-1], k):
            kept.append(k)
    return np.isin(np.arange(len(stays)), kept)


def relaxed(problem: Problem, waypoints: Indices | None = None) -> Problem:
    """Return the problem through some of its waypoints, of which it is a relaxation.

    Args:
        problem: Without consecutive identical waypoints.
        waypoints: Numbers from 0, rising; by default all but those that rounding may miss.

    Raises:
        InvalidInput: An end is not among them, or a waypoint at which the motion waits.
    """
    if waypoints is None:
        return thinned(problem)
    stays = problem.route.demand("dwell") > 0
    stays[[0, -1]] = True
    rising = len(waypoints) > 1 and bool((np.diff(waypoints) > 0).all())
    inside = rising and waypoints[0] == 0 and waypoints[-1] == len(stays) - 1
    kept = np.isin(np.arange(len(stays)), waypoints)
    if not inside or not kept[stays].all():
        right = "numbers that rise from the first waypoint to the last, through all with a wait"
        raise InvalidInput("waypoints", right, value=waypoints.tolist())
    return problem if kept.all() else replace(problem.at(kept), limits=_widest(problem, kept))


def _widest(problem: Problem, kept: Bools) -> Limits:
    """Return the limits of the segments between these waypoints.

    A segment may consist of several original ones. Their widest limits hold throughout, since a
    motion may pass a waypoint that was left out at any time.
    """
    limits = problem.limits
    if limits.segments is None:
        return limits
    groups = pairwise(np.flatnonzero(kept).tolist())
    widest = [
        limits.of_segments(np.arange(*ends)).in_all_segments(tightest=False).by_name()
        for ends in groups
    ]
    pairs: dict[str, Any] = {}
    for name, own in limits.by_name().items():
        pairs[name] = own if own.ndim == 2 else np.stack([each[name] for each in widest])
    return Limits(**pairs, others=limits.others)
