"""How far the numbers of a problem are known: the rounding of its places and states.

A state that was computed from a motion, the state in which a controller replans for example, is
rounded where it was computed. A place is rounded as the largest coordinate on the way, a velocity
as the largest velocity, an acceleration likewise. The problem may know only a part of that way, so
the largest velocity is its limit, and the largest coordinate at least `V²/A`: the way on which the
joint gets there.

A limit that no motion reaches says nothing about a state. So velocities and accelerations count up
to what the joint reaches on a way of `LONGEST` times the largest coordinate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem

# Some units in the last place of the largest number. Of 148 states of optimal motions, cut at
# their first and last millisecond, the worst is known to half of it.
STATE_RTOL = 32 * float(np.finfo(float).eps)
LONGEST = 1e4
# A smaller excess over a limit, relative, is rounding where a motion cannot be dilated.
KEPT_RTOL = 1e-12


class Rounding(NamedTuple):
    """The rounding of places, rad, velocities, rad/s, and accelerations, rad/s², `(joints,)`."""

    position: Array
    velocity: Array
    acceleration: Array


def of_states(problem: Problem) -> Rounding:
    """Return how far the places and states of a problem are known, joint by joint."""
    limits = problem.limits.in_all_segments(tightest=False)
    V, A, J = (
        np.abs(own).max(axis=1) for own in (limits.velocity, limits.acceleration, limits.jerk)
    )
    largest = np.abs(problem.waypoints).max(axis=0)
    way = LONGEST * largest.max()
    reached = np.minimum(V, np.sqrt(A * way))
    steepest = np.minimum(A, np.cbrt(J**2 * way))
    return Rounding(
        STATE_RTOL * np.maximum(largest, reached**2 / A),
        STATE_RTOL * reached,
        STATE_RTOL * steepest,
    )
