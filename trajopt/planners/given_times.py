"""Prove in closed form that a segment cannot take the time that is given for it.

Each joint alone: it covers its displacement, less what tolerances take off, at its velocity limit
at most. In the first segment of a motion from rest it has to speed up before, in the last one to
brake after. From rest to rest over one segment the optimum of a joint is known.
"""

from __future__ import annotations

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.planners.rest_to_rest import trapezoidal

# A smaller excess of the least time over the given one, relative, is rounding.
GIVEN_RTOL = 1e-9


def impossible(problem: Problem) -> str | None:
    """Return a sentence if no motion passes a segment in its given time; else None.

    The sentence states a proof: segment, joint, and the least time. After None it is open whether
    there is a motion.
    """
    given = problem.route.demand("given_times")
    if not given.any():
        return None
    needed = _least_times(problem)
    excess = needed / given[:, None]
    segment, joint = np.unravel_index(int(excess.argmax()), excess.shape)
    if not excess[segment, joint] > 1 + GIVEN_RTOL:
        return None
    return (
        f"segment {segment + 1} is given {given[segment]:.6g} s, and "
        f"{problem.joint_labels[joint]} takes {needed[segment, joint]:.6g} s at least: "
        f"{needed[segment, joint] - given[segment]:.2g} s too little"
    )


def _least_times(problem: Problem) -> Array:
    """Return a lower bound on each joint's time of each segment, s, `(segments, joints)`."""
    r = problem.route.demand("tolerance")
    h = problem.displacements
    # a waypoint may be missed by the rounding of its coordinates
    way = np.maximum(np.abs(h) - r[:-1] - r[1:] - 2 * problem.rounding, 0.0)
    upwards = h >= 0
    size = (problem.segments, problem.joints, 2)
    velocity, acceleration = (
        np.broadcast_to(own, size) for own in (problem.limits.velocity, problem.limits.acceleration)
    )
    top = np.where(upwards, velocity[..., 1], -velocity[..., 0])
    speeding = np.where(upwards, acceleration[..., 1], -acceleration[..., 0])
    braking = np.where(upwards, -acceleration[..., 0], acceleration[..., 1])
    needed = way / top
    if problem.route.demand("closed"):
        return needed
    (u, _), (w, _) = problem.route.start, problem.route.end
    for segment, state, rate in ((0, u, speeding), (-1, w, braking)):
        peak = np.minimum(top[segment], np.sqrt(2 * rate[segment] * way[segment]))
        # it covers peak²/(2 A) while it speeds up to the peak, then cruises
        own = peak / rate[segment] + (way[segment] - peak**2 / (2 * rate[segment])) / top[segment]
        still = np.where(state == 0, own, 0.0)
        needed[segment] = np.maximum(needed[segment], still)
    if problem.segments == 1:
        alone = trapezoidal(np.sign(h) * way, velocity, acceleration)
        needed = np.where((u == 0) & (w == 0), np.maximum(needed, alone), needed)
    return needed
