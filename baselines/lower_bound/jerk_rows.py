"""Rows that jerk limits need beside those of costates (docs/mathematics.md, section 5b).

A square tangent bounds `Q = T²` by `T` and `S = 1/T` together: where `S` is met, `Q` is. It depends
on the longest time of the box. A ramp is the row of `p = 1` divided by `T`, in the accelerations
that neighbouring segments share; it holds everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound.relaxation import Box, Relaxation, Rows

Array = NDArray[np.float64]


class SquareTangent(NamedTuple):
    """Of a segment: the time at which it touches the curve."""

    segment: int
    at: float


class Ramp(NamedTuple):
    """Of a segment and joint, downwards (side 0) or upwards (1)."""

    segment: int
    joint: int
    side: int


def square_rows(relaxation: Relaxation, given: Sequence[SquareTangent], box: Box) -> Rows:
    """`Q ≤ (h + 2t) T − (2 h t + t²) + h t² S` for `T ≤ h`, since `(h − T)(T − t)²/T ≥ 0`.

    Args:
        relaxation: Whose variables count.
        given: Where they touch, `t`.
        box: Whose longest times `h` count.
    """
    rows = relaxation.blank(len(given))
    if not given:
        return rows
    segments, touched = zip(*given, strict=True)
    numbers = list(segments)
    times = relaxation.time[numbers]
    t = np.array(touched)
    h = box.high[times]
    rows.columns[:, 0] = times
    rows.columns[:, 1] = relaxation.inverse[numbers]
    rows.columns[:, 2] = relaxation.square[numbers]
    rows.coefficients[:, 0] = -(h + 2 * t)
    rows.coefficients[:, 1] = -h * t**2
    rows.coefficients[:, 2] = 1.0
    rows.bounds[:] = -(2 * h + t) * t
    return rows


def square_tangents(relaxation: Relaxation, x: Array, box: Box) -> list[SquareTangent]:
    """Per segment the one that a point meets least, if the point has room for one."""
    time = x[relaxation.time]
    inverse = x[relaxation.inverse]
    longest = box.high[relaxation.time]
    # (h S − 1) t² − 2 (h − T) t is least there
    curvature = longest * inverse - 1
    slope = longest - time
    given = []
    for segment in np.flatnonzero(curvature > 0).tolist():
        at = float(slope[segment] / curvature[segment])
        if 0 < at < longest[segment]:
            given.append(SquareTangent(segment, at))
    return given


def ramp_row(relaxation: Relaxation, given: Ramp) -> Rows:
    """`a₁ − a₀ ≤ J T` of the accelerations at the segment's ends; downwards `a₀ − a₁ ≤ J T`."""
    segment, joint, side = given
    sign = 1.0 if side else -1.0
    row = relaxation.blank(1)
    row.columns[0, 0] = relaxation.time[segment]
    row.coefficients[0, 0] = -relaxation.j[side, joint]
    # the motion rests at both ends of the path
    if segment > 0:
        row.columns[0, 1] = relaxation.acceleration[segment - 1, joint]
        row.coefficients[0, 1] = -sign
    if segment < relaxation.segments - 1:
        row.columns[0, 2] = relaxation.acceleration[segment, joint]
        row.coefficients[0, 2] = sign
    return row


def broken_ramps(relaxation: Relaxation, x: Array) -> list[Ramp]:
    """Those that a point's accelerations break."""
    rest = np.zeros((1, relaxation.joints))
    inner = x[relaxation.acceleration]
    states = np.concatenate([rest, inner, rest])
    rises = np.diff(states, axis=0)
    time = x[relaxation.time][:, None]
    given = []
    for side, change in enumerate((-rises, rises)):
        broken = change > relaxation.j[side] * time
        broken &= relaxation.jerky
        for segment, joint in np.argwhere(broken).tolist():
            given.append(Ramp(segment, joint, side))
    return given
