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


def square_rows(
    relaxation: Relaxation,
    given: Sequence[SquareTangent],
    box: Box,
) -> Rows:
    """`Q ≤ (h + 2t) T − (2 h t + t²) + h t² S` for `T ≤ h`, since `(h − T)(T − t)²/T ≥ 0`.

    Args:
        relaxation: Whose variables count.
        given: Where they touch, `t`.
        box: Whose longest times `h` count.
    """
    rows = relaxation.blank(len(given))
    if not given:
        return rows
    table = np.array(given)
    segments = table[:, 0].astype(np.intp)
    t = table[:, 1]
    time = relaxation.time[segments]
    inverse = relaxation.inverse[segments]
    square = relaxation.square[segments]
    h = box.high[time]

    # Q − (h + 2t) T − h t² S ≤ −(2 h t + t²)
    twice = 2 * t
    by_time = h + twice
    by_inverse = h * t**2
    constant = h * twice + t**2
    columns = (time, inverse, square)
    coefficients = (-by_time, -by_inverse, 1.0)
    for entry, column in enumerate(columns):
        rows.columns[:, entry] = column
    for entry, coefficient in enumerate(coefficients):
        rows.coefficients[:, entry] = coefficient
    rows.bounds[:] = -constant
    return rows


def square_tangents(
    relaxation: Relaxation,
    x: Array,
    box: Box,
) -> list[SquareTangent]:
    """Per segment the one that a point meets least, if the point has room for one."""
    time = x[relaxation.time]
    inverse = x[relaxation.inverse]
    longest = box.high[relaxation.time]
    # (h S − 1) t² − 2 (h − T) t is least there
    product = longest * inverse
    curvature = product - 1
    slope = longest - time
    given = []
    curved = np.flatnonzero(curvature > 0)
    for segment in curved.tolist():
        at = slope[segment] / curvature[segment]
        end = longest[segment]
        if 0 < at < end:
            tangent = SquareTangent(segment, float(at))
            given.append(tangent)
    return given


def ramp_row(relaxation: Relaxation, given: Ramp) -> Rows:
    """`a₁ − a₀ ≤ J T` of the accelerations at the segment's ends; downwards `a₀ − a₁ ≤ J T`."""
    segment, joint, side = given
    sign = 1.0 if side else -1.0
    limit = relaxation.j[side, joint]
    accelerations = relaxation.acceleration[:, joint]
    last = relaxation.segments - 1
    row = relaxation.blank(1)
    columns = row.columns[0]
    columns[0] = relaxation.time[segment]
    coefficients = row.coefficients[0]
    coefficients[0] = -limit
    # the motion rests at both ends of the path
    if segment > 0:
        columns[1] = accelerations[segment - 1]
        coefficients[1] = -sign
    if segment < last:
        columns[2] = accelerations[segment]
        coefficients[2] = sign
    return row


def broken_ramps(relaxation: Relaxation, x: Array) -> list[Ramp]:
    """Those that a point's accelerations break."""
    rest = np.zeros((1, relaxation.joints))
    inner = x[relaxation.acceleration]
    states = np.concatenate([rest, inner, rest])
    rises = np.diff(states, axis=0)
    time = x[relaxation.time][:, None]
    given = []
    changes = (-rises, rises)
    for side, change in enumerate(changes):
        allowed = relaxation.j[side] * time
        broken = change > allowed
        broken &= relaxation.jerky
        places = np.argwhere(broken)
        for segment, joint in places.tolist():
            ramp = Ramp(segment, joint, side)
            given.append(ramp)
    return given
