"""Leave out waypoints that would make a lower bound's proof impossible.

Without a waypoint a problem is a relaxation, so the bound stays valid. Waypoints that a motion may
miss by rounding are left out (`trajopt.core.resolution`). A tolerance makes a box around each
waypoint. A segment between two boxes that overlap may take no time, and its inverse time, a
variable of the proof, has no upper bound. So a waypoint is left out if its box overlaps the box of
the waypoint before it, or that of the next one at which the motion waits or ends. It stays if there
is a least time between the two.
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

# Two boxes count as apart if their centres differ, in some joint, by more than this factor times
# the sum of both half widths.
APART = 1025 / 1024


def counted(problem: Problem) -> Bools:
    """Return which waypoints the relaxation keeps, `(waypoints,)`.

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
    """Return the problem through the waypoints that the relaxation keeps.

    Raises:
        InvalidInput: Even so, a segment could take no time within the tolerance.
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
