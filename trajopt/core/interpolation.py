"""The polynomials between samples, as a robot's controller runs them.

A robot does not execute a planner's function. Its controller interpolates the points that it was
sent (docs/mathematics.md, section 11). `joint_trajectory_controller` of ros2_control joins them
with straight lines, with cubic Hermite pieces where the points have velocities, and with quintic
ones where they have accelerations too. These are polynomials, so the executed motion is known
exactly.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput

Interpolation = Literal["auto", "linear", "cubic", "quintic", "spline"]
"""What runs between two samples:

- `linear`: straight lines, as the controller does with positions only. Velocity jumps;
- `cubic`: the Hermite piece from positions and velocities. Acceleration jumps;
- `quintic`: the Hermite piece from positions, velocities and accelerations. Jerk jumps;
- `spline`: the cubic spline through the positions with continuous velocity and acceleration, at
  rest at both ends. Many programs interpolate like this, controllers do not;
- `auto`: the one that `joint_trajectory_controller` uses for these samples.
"""


# The number of tables used: positions, then velocities, then accelerations.
_TABLES_USED = {"linear": 1, "cubic": 2, "quintic": 3, "spline": 1}


def chosen(
    interpolation: Interpolation, velocities: Array | None, accelerations: Array | None
) -> Interpolation:
    """The interpolation that is meant, `auto` resolved.

    Raises:
        InvalidInput: The interpolation is unknown, or the samples lack what it needs.
    """
    if interpolation not in get_args(Interpolation):
        names = ", ".join(get_args(Interpolation))
        raise InvalidInput("interpolation", f"one of {names}", value=interpolation)
    if interpolation == "auto":
        if velocities is None and accelerations is not None:
            right = "velocities beside them: without, the controller's motion is not defined"
            raise InvalidInput("accelerations", right)
        if velocities is None:
            return "linear"
        return "cubic" if accelerations is None else "quintic"
    used = _TABLES_USED[interpolation]
    if used > 1 and velocities is None:
        right = "linear or spline: the samples have no velocities"
        raise InvalidInput("interpolation", right, value=interpolation)
    if used > 2 and accelerations is None:
        right = "linear, cubic or spline: the samples have no accelerations"
        raise InvalidInput("interpolation", right, value=interpolation)
    return interpolation


def pieces(
    interpolation: Interpolation,
    times: Array,
    positions: Array,
    velocities: Array | None = None,
    accelerations: Array | None = None,
) -> Array:
    """The polynomial between each two samples.

    Args:
        interpolation: which; samples must have what it needs (`chosen` checks).
        times: strictly increasing, s, `(samples,)`.
        positions: rad, `(samples, joints)`; the derivatives likewise, rad/s and rad/s².
        velocities: used by `cubic` and `quintic`.
        accelerations: used by `quintic`.

    Returns:
        Coefficients `(degree + 1, samples − 1, joints)`, highest power first, in the time since
        the piece's start, rad/s^power.
    """
    kind = chosen(interpolation, velocities, accelerations)
    if kind == "spline":
        from scipy.interpolate import CubicSpline  # slow to import, and seldom needed

        spline = CubicSpline(times, positions, bc_type="clamped")
        return spline.c
    lengths = np.diff(times)
    tables = [table for table in (positions, velocities, accelerations) if table is not None]
    with np.errstate(over="ignore", invalid="ignore"):  # a Trajectory refuses what is not finite
        used = _TABLES_USED[kind]
        unit = _hermite(tables[:used], lengths[:, None])
        return polynomials.stretched(unit, 1 / lengths)


def _hermite(derivatives: list[Array], lengths: Array) -> Array:
    """The pieces on the unit interval that have these derivatives at both ends."""
    q0 = derivatives[0][:-1]
    h = np.diff(derivatives[0], axis=0)
    if len(derivatives) == 1:
        return np.stack([h, q0])

    v0 = derivatives[1][:-1] * lengths
    v1 = derivatives[1][1:] * lengths
    if len(derivatives) == 2:
        c3 = v0 + v1 - 2 * h
        c2 = 3 * h - 2 * v0 - v1
        return np.stack([c3, c2, v0, q0])

    a0 = derivatives[2][:-1] * lengths**2
    a1 = derivatives[2][1:] * lengths**2
    c5 = 6 * h - 3 * (v0 + v1)
    c4 = -15 * h + 8 * v0 + 7 * v1
    c3 = 10 * h - 6 * v0 - 4 * v1
    c5 += (a1 - a0) / 2
    c4 += (3 * a0 - 2 * a1) / 2
    c3 -= (3 * a0 - a1) / 2
    return np.stack([c5, c4, c3, a0 / 2, v0, q0])


def check(
    times: Array, positions: Array, velocities: Array | None, accelerations: Array | None
) -> None:
    """Refuse samples that are no motion; samples and joints count from 1 in the message.

    Raises:
        InvalidInput: Fewer than two samples, arrays that do not fit together, a value that is not
            finite, times that do not increase.
    """
    if positions.ndim != 2 or len(positions) < 2 or positions.shape[1] == 0:
        right = "at least two samples, as an array (samples, joints)"
        raise InvalidInput("positions", right, value=positions.shape)
    if times.shape != positions.shape[:1]:
        raise InvalidInput("times", f"{len(positions)}, one per sample", value=times.shape)
    tables = {
        "times": times,
        "positions": positions,
        "velocities": velocities,
        "accelerations": accelerations,
    }
    for name, table in tables.items():
        if table is None:
            continue
        if name != "times" and table.shape != positions.shape:
            right = f"an array {positions.shape}, as the positions"
            raise InvalidInput(name, right, value=table.shape)
        for sample, *joints in np.argwhere(~np.isfinite(table)):
            raise InvalidInput(
                f"{name}, sample {sample + 1}",
                "a finite number",
                value=float(table[sample, *joints]),
                joint=int(joints[0]) if joints else None,
            )
    for sample in np.flatnonzero(np.diff(times) <= 0):
        right = f"a time after {times[sample]:.9g} s, that of the sample before"
        key = f"times, sample {sample + 2}"
        raise InvalidInput(key, right, value=float(times[sample + 1]))
