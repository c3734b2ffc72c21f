"""Whole turns of a continuous joint: its position is written between −π and π, and steps by 2π."""

from __future__ import annotations

from collections.abc import Sequence
from math import tau

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.limits import Limits

_MOST_TURNS = 1000.0  # beyond, the rounding of a position is no small part of a turn


def unwrapped(
    times: Array, positions: Array, half: Array, limits: Limits, turns: Sequence[bool] = ()
) -> tuple[Array, list[list[int]]]:
    """Return the positions without steps of whole turns, and the rows before these steps.

    A step is one if it is a whole turn, up to what the joint may move at twice its velocity limit,
    and larger than that. Only joints without position limits are continuous.

    Args:
        times: Increasing, s, `(samples,)`.
        positions: rad, `(samples, joints)`.
        half: Half width of each joint's positions, `(joints,)`.
        limits: Of the joints.
        turns: Whether each joint turns; by default all do.

    Returns:
        The positions, and for each joint the indices of the samples before its steps.
    """
    limits = limits.in_all_segments(tightest=False)
    continuous = np.isinf(limits.position).all(axis=1)
    if turns:
        continuous &= np.array(turns)
    velocity = np.abs(limits.velocity).max(axis=1)
    reach = 2 * velocity * np.diff(times)[:, None] + 2 * half
    step = np.diff(positions, axis=0)
    whole = np.round(step / tau)
    wrapped = (np.abs(step - tau * whole) <= reach) & (np.abs(step) > reach) & continuous
    wrapped &= (np.abs(whole) > 0) & (np.abs(whole) <= _MOST_TURNS)
    shift = np.cumsum(np.where(wrapped, whole, 0.0), axis=0)
    found = positions.copy()
    found[1:] -= tau * shift
    return found, [np.flatnonzero(own).tolist() for own in wrapped.T]
