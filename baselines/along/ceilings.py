"""The highest speed along a path that each limit allows: the maximum velocity curve of the field.

At a point of a path a limit allows a speed `w` if there is an acceleration `x` of the parameter
with which its rows hold (Bobrow et al. 1985). Rows of jerk have no such curve: the jerk of the
parameter is free too.
"""

from __future__ import annotations

import numpy as np

from baselines.along.law import law
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

_HALVINGS = 60
_HIGHEST = 1e6  # of the motion's own speed


def ceilings(problem: Problem, motion: Trajectory, times: Array) -> dict[str, Array]:
    """Return for each limit how many times as fast as a motion its path could be passed.

    Args:
        problem: the limits.
        motion: its path is the path.
        times: where, s, `(points,)`.
    """
    states = np.stack([motion(times, order) for order in range(4)])
    found = law(problem.limits, states, motion.segments_at(times), 1.0)
    keys = np.array(found.keys[: found.slow.shape[2]])
    return {str(key): fastest(found.slow[..., keys == key]) for key in dict.fromkeys(keys)}


def fastest(rows: Array) -> Array:
    """Return the highest speed at which rows hold with some acceleration, `(points,)`."""
    low, high = np.full(rows.shape[1], -20.0), np.full(rows.shape[1], np.log10(_HIGHEST))
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        below, above = room(rows, 10.0**middle)
        kept = below <= above
        low, high = np.where(kept, middle, low), np.where(kept, high, middle)
    return np.asarray(10.0**low)


def room(rows: Array, w: Array) -> tuple[Array, Array]:
    """Return the lowest and highest acceleration of the parameter at a speed; crossed if none."""
    c0, cv, c2, ca = rows[:4]
    rest = c0 + cv * w[:, None] + c2 * w[:, None] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = -rest / ca
    below = np.where(ca < 0, bound, -np.inf).max(axis=1, initial=-np.inf)
    above = np.where(ca > 0, bound, np.inf).min(axis=1, initial=np.inf)
    broken = ((ca == 0) & (rest > 0)).any(axis=1)
    return np.where(broken, np.inf, below), np.where(broken, -np.inf, above)
