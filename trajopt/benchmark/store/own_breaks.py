"""A trajectory as JSON, joint by joint: each joint has its own breaks, and only what changes there.

    {"waypoint_times": [0, 0.5, 1],
     "joints": [[[0, 2, 0, 0.3], [0.5, -2]], [[0, 0.2]]]}

A piece is its start, s, then its coefficients in the time since then, highest power first
(rad/s^power). Coefficients that are left out at its end continue those of the piece before without
a jump. So a minimum-time motion takes two numbers a piece: a tenth of the coefficients of all
joints on the breaks of all joints. Best known answers are kept like this.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.trajectory import Trajectory
from trajopt.formats.motion import check_work

Row = list[float]

SAME_RTOL = 1e-12
"""Difference up to which a coefficient continues the piece before, relative.

To the joint's largest position, over the mean time of a segment to the power of the derivative.
"""


def table(trajectory: Trajectory, rtol: float = 0.0) -> dict[str, Any]:
    """Return the trajectory for JSON.

    Args:
        trajectory: Any.
        rtol: `SAME_RTOL`, or 0: only coefficients that continue to the last bit are left out.
    """
    unit = trajectory.duration / (len(trajectory.waypoint_times) - 1)
    powers = np.arange(len(trajectory.coefficients) - 1, -1, -1)
    joints = []
    for coefficients in np.moveaxis(trajectory.coefficients, 2, 0):
        largest = np.abs(coefficients[-1]).max()
        rows = _rows(trajectory.breaks, coefficients, rtol * largest / unit**powers)
        joints.append(rows)
    return {"waypoint_times": trajectory.waypoint_times.tolist(), "joints": joints}


def trajectory(said: Mapping[str, Any]) -> Trajectory:
    """Return the trajectory of a table.

    Raises:
        ValueError, TypeError, LookupError: It is not a trajectory's table.
    """
    times = np.array(said["waypoint_times"], dtype=float)
    joints = said["joints"]
    pieces = len(times) + sum(map(len, joints))
    highest = max(len(rows[0]) - 1 for rows in joints)  # no later piece has more coefficients
    check_work(highest, pieces, len(joints))
    parts = [_joint(rows, times[-1]) for rows in joints]
    return Trajectory.joined(parts, times)


def _rows(breaks: Array, coefficients: Array, allowed: Array) -> list[Row]:
    """Return the rows of one joint's pieces, without coefficients that continue the last piece."""
    current = coefficients[:, 0]
    start = float(breaks[0])
    rows = [[start, *current.tolist()]]
    for piece in range(1, coefficients.shape[1]):
        wanted = coefficients[:, piece]
        arriving = _moved(current, breaks[piece] - start)
        difference = np.abs(wanted - arriving)
        changed = np.flatnonzero(difference > allowed)
        if not len(changed):
            continue
        count = changed[-1] + 1
        stated = wanted[:count]
        going_on = arriving[count:]
        current = np.concatenate([stated, going_on])
        start = float(breaks[piece])
        rows.append([start, *stated.tolist()])
    return rows


def _joint(rows: Sequence[Row], end: float) -> tuple[Array, Array]:
    """Breaks and coefficients `(degree + 1, pieces)` of one joint."""
    starts: list[float] = []
    pieces: list[Array] = []
    for start, *stated in rows:
        going_on = np.zeros(0)
        if pieces:
            arriving = _moved(pieces[-1], start - starts[-1])
            going_on = arriving[len(stated) :]
        starts.append(start)
        pieces.append(np.concatenate([stated, going_on]))
    breaks = np.array([*starts, end])
    lengths = np.diff(breaks)
    if starts[0] != 0 or lengths.min() <= 0:
        raise ValueError("starts that do not rise from 0 to below the last waypoint time")
    return breaks, np.stack(pieces, axis=1)


def _moved(coefficients: Array, offset: float) -> Array:
    """Return a polynomial in the time since a later instant."""
    return polynomials.shifted(coefficients, np.array(offset))
