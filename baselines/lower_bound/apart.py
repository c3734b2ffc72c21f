"""The waypoints that a lower bound counts.

Those that rounding may miss are left out (`trajopt.core.resolution`). So is a waypoint within
tolerance whose box does not leave the box before it, or the next point at which the motion waits or
ends: between them a segment may take no time, whose inverse has no upper bound, unless a
least time is between them. Without a waypoint a problem is a relaxation.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from trajopt.core.arrays import Bools
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared, thinned

# Boxes are apart where their centres are, in some joint, this many times both half widths.
APART = 1025 / 1024


def counted(problem: Problem) -> Bools:
    """Return the waypoints that a lower bound counts, `(waypoints,)`.

    Args:
        problem: Without consecutive identical waypoints.
    """
    found = ~spared(problem)
    if "tolerance" not in problem.demands:
        return found
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


def relaxed(problem: Problem) -> Problem:
    """Return the problem through the waypoints that a lower bound counts.

    Raises:
        InvalidInput: Within tolerance a segment between them takes no time.
    """
    if "tolerance" not in problem.demands:
        return thinned(problem)
    kept = counted(problem)
    found = problem if kept.all() else replace(problem.at(kept), limits=_widest(problem, kept))
    r = found.route.demand("tolerance")
    times = found.route.demand("least_times") + found.route.demand("given_times")
    ways = np.abs(found.displacements) > r[:-1] + r[1:]
    if not (ways.any(axis=1) | (times > 0)).all():
        raise InvalidInput("tolerance", "waypoints that no instant passes together")
    return found


def _widest(problem: Problem, kept: Bools) -> Limits:
    """The limits of the segments between these waypoints: the widest of all that each consists of.

    Which of them a motion has passed at an instant is not known.
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
