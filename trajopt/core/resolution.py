"""Waypoints that a motion may miss by their rounding (docs/mathematics.md, section 9).

A motion passes a waypoint between two brief steps at speed. A shift of this waypoint by its
rounding (`Problem.rounding`) can then need more acceleration and jerk than the limits allow. So the
minimum time would depend on digits that no file holds. Therefore an inner waypoint between two
brief steps in one line counts as passed if the motion misses it by no more than its rounding. All
other waypoints are exact.

    from trajopt.core.resolution import thinned
    relaxation = thinned(problem)
"""

from __future__ import annotations

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.demand import DEMANDS
from trajopt.core.problem import Problem

# A joint covers its largest step `D` in the time `T`, so a step of `h` takes about `h T / D`. To
# move the end of this step by the rounding `ρ` takes about `60 ρ (D / h)³ / D` of the jerk that
# covers `D` in `T`. A step is brief where this share exceeds `BRIEF_USE`.
BLEND_JERK = 60.0
BRIEF_USE = 1e-5
# Largest difference between the directions of two steps in one line. A step is measured in units of
# each joint's largest displacement, and its direction is the step over its largest component.
IN_LINE = 1e-2
# Least unit of a joint, as a share of the largest displacement of all joints.
LEAST_SHARE = 1e-3


def spared(problem: Problem) -> Bools:
    """Return which waypoints may be missed by their rounding, `(waypoints,)`.

    They lie between two brief steps in one line. This depends on the waypoints only, not on the
    limits. But a waypoint at which limits change is exact. So are all waypoints if the route has
    demands at waypoints or in segments.

    Args:
        problem: without consecutive identical waypoints (`Problem.merged`).
    """
    steps = problem.displacements
    largest = problem.largest_displacements
    rounding = problem.rounding
    brief = is_brief(steps, rounding, largest)
    found = np.zeros(len(problem.waypoints), dtype=bool)
    if any({"waypoints", "segments"} & set(DEMANDS[key].axes) for key in problem.demands):
        return found
    inner = brief[:-1] & brief[1:]
    if inner.any():
        unit = np.maximum(largest, LEAST_SHARE * largest.max())
        found[1:-1] = inner & _in_line(steps / unit, rounding / unit)
        found[1:-1] &= ~problem.limits.changes
    return found


def is_brief(steps: Array, rounding: Array, largest: Array) -> Bools:
    """Return which steps are brief, `(…, steps)`.

    Args:
        steps: rad, `(…, steps, joints)`.
        rounding: Of waypoints, rad, `(joints,)` or of each step.
        largest: Displacement of a joint, rad, likewise.
    """
    briefest = np.cbrt(BLEND_JERK / BRIEF_USE * rounding * largest**2)
    return np.all(np.abs(steps) <= briefest, axis=-1)


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
    """Return where the direction turns by at most `IN_LINE`, `(segments - 1,)`.

    The part of a turn that the rounding of the waypoints explains is not counted.
    """
    sizes = np.abs(steps).max(axis=1, keepdims=True)
    sizes = np.maximum(sizes, np.finfo(float).tiny)
    turned = np.abs(np.diff(steps / sizes, axis=0))
    blurred = rounding * (1 / sizes[:-1] + 1 / sizes[1:])
    return np.asarray((turned <= IN_LINE + blurred).all(axis=1))
