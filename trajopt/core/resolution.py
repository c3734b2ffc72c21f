"""The waypoints that may be missed by their rounding (docs/mathematics.md, section 7).

A waypoint between brief steps is passed at speed. To move it by its rounding (`Problem.rounding`)
can then take more acceleration and jerk than limits allow, so the minimum time of the waypoints as
written depends on digits that no file holds. Hence the definition: an inner waypoint between brief
steps, passed in line, is passed if the motion misses it by no more than its rounding. All other
waypoints are exact.

    from trajopt.core.resolution import thinned
    relaxation = thinned(problem)
"""

from __future__ import annotations

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.demand import DEMANDS
from trajopt.core.problem import Problem

# Where a joint covers `D` in its largest step in `T`, a step of `h` takes about `h T / D`. To
# move its end by the rounding `ρ` takes about `60 ρ (D / h)³ / D` of the jerk that covers `D` in
# `T`. A step is brief where this is more than the share below.
BLEND_JERK = 60.0
BRIEF_USE = 1e-5
# A waypoint is passed in line where the directions of its two steps differ by no more. A step
# counts in the joints' largest displacements, its direction in its own largest one of these.
IN_LINE = 1e-2
# A joint that hardly moves counts in this share of the largest displacement of all, at least.
LEAST_SHARE = 1e-3


def spared(problem: Problem) -> Bools:
    """Return the waypoints that may be missed by their rounding, `(waypoints,)`.

    They lie between two brief steps, and are passed in line. The answer is one of the waypoints
    alone; no limit counts, but where limits change at a waypoint, it is exact. So is every one
    where more is asked at waypoints or in segments.

    Args:
        problem: without consecutive identical waypoints (`Problem.merged`).
    """
    steps = problem.displacements
    largest = problem.largest_displacements
    rounding = problem.rounding
    briefest = np.cbrt(BLEND_JERK / BRIEF_USE * rounding * largest**2)
    brief = np.all(np.abs(steps) <= briefest, axis=1)
    found = np.zeros(len(problem.waypoints), dtype=bool)
    if any({"waypoints", "segments"} & set(DEMANDS[key].axes) for key in problem.demands):
        return found
    inner = brief[:-1] & brief[1:]
    if inner.any():
        unit = np.maximum(largest, LEAST_SHARE * largest.max())
        found[1:-1] = inner & _in_line(steps / unit, rounding / unit)
        found[1:-1] &= ~problem.limits.changes
    return found


def thinned(problem: Problem) -> Problem:
    """Return the problem without the waypoints that may be missed by rounding: a relaxation.

    Args:
        problem: without consecutive identical waypoints (`Problem.merged`).
    """
    missing = spared(problem)
    if not missing.any():
        return problem
    return problem.at(~missing)


def _in_line(steps: Array, rounding: Array) -> Bools:
    """Whether the direction turns by `IN_LINE` at most from step to step, `(segments - 1,)`.

    A turn that the rounding of the waypoints explains does not count.
    """
    sizes = np.abs(steps).max(axis=1, keepdims=True)
    sizes = np.maximum(sizes, np.finfo(float).tiny)
    turned = np.abs(np.diff(steps / sizes, axis=0))
    blurred = rounding * (1 / sizes[:-1] + 1 / sizes[1:])
    return np.asarray((turned <= IN_LINE + blurred).all(axis=1))
