"""Inequalities for jerk limits, beside those of costates (docs/mathematics.md, section 7b).

A square tangent bounds `Q = T²` from above by `T` and `S = 1/T`. At its point the bound is exact.
It depends on the longest time of the box. A ramp is the inequality of the costate `p = 1` divided
by `T`, in the accelerations that neighbouring segments share. It holds in every box.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baselines.lower_bound.relaxation import BoundConstraints, Relaxation, VariableBounds
from trajopt.core.arrays import Array


class SquareTangent(NamedTuple):
    """A square tangent of a segment; `at` is the time at which it touches the curve."""

    segment: int
    at: float


class Ramp(NamedTuple):
    """A ramp of a segment and joint, downwards (side 0) or upwards (side 1)."""

    segment: int
    joint: int
    side: int


def square_rows(
    relaxation: Relaxation, given: Sequence[SquareTangent], box: VariableBounds
) -> BoundConstraints:
    """Return the square tangents, `Q ≤ (h + 2t) T − (2 h t + t²) + h t² S` for `T ≤ h`.

    They follow from `(h − T)(T − t)²/T ≥ 0`.

    Args:
        relaxation: Its variables are used.
        given: The tangents; `t` is the time at which one touches the curve.
        box: Its longest times are the `h`.
    """
    rows = relaxation.blank(len(given))
    if not given:
        return rows
    table = np.array(given)
    segments = table[:, 0].astype(np.intp)
    t = table[:, 1]
    h = box.high[relaxation.time[segments]]
    # Q − (h + 2t) T − h t² S ≤ −(2 h t + t²)
    rows.columns[:, 0] = relaxation.time[segments]
    rows.columns[:, 1] = relaxation.inverse[segments]
    rows.columns[:, 2] = relaxation.square[segments]
    rows.coefficients[:, 0] = -(h + 2 * t)
    rows.coefficients[:, 1] = -h * t**2
    rows.coefficients[:, 2] = 1.0
    rows.bounds[:] = -(h * (2 * t) + t**2)
    return rows


def square_tangents(relaxation: Relaxation, x: Array, box: VariableBounds) -> list[SquareTangent]:
    """Return the square tangent that a point violates most, for each segment where there is one."""
    longest = box.high[relaxation.time]
    # (h S − 1) t² − 2 (h − T) t is least at the tangent's place
    curvature = longest * x[relaxation.inverse] - 1
    slope = longest - x[relaxation.time]
    given = []
    for segment in np.flatnonzero(curvature > 0).tolist():
        at = float(slope[segment] / curvature[segment])
        if 0 < at < longest[segment]:
            given.append(SquareTangent(segment, at))
    return given


def ramp_row(relaxation: Relaxation, given: Ramp) -> BoundConstraints:
    """Return a ramp, `a₁ − a₀ ≤ J T` of the accelerations at the ends; downwards `a₀ − a₁`."""
    segment, joint, side = given
    sign = 1.0 if side else -1.0
    row = relaxation.blank(1)
    row.columns[0, 0] = relaxation.time[segment]
    row.coefficients[0, 0] = -relaxation.j[side, segment, joint]
    row.columns[0, 1:3] = relaxation.acceleration_at[:, segment, joint]
    row.coefficients[0, 1:3] = -sign, sign
    return row


def violated_ramps(relaxation: Relaxation, x: Array) -> list[Ramp]:
    """Return the ramps that a point's accelerations violate."""
    before, after = x[relaxation.acceleration_at]
    rises = after - before
    time = x[relaxation.time][:, None]
    given = []
    for side, change in enumerate((-rises, rises)):
        violated = (change > relaxation.j[side] * time) & relaxation.jerky
        given += [Ramp(segment, joint, side) for segment, joint in np.argwhere(violated).tolist()]
    return given
