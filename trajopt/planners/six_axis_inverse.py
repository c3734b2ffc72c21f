"""All eight inverses of a six-axis arm with a spherical wrist, in closed form.

The method of Ma et al. 2024, eq. 4 to 26, for every arm whose twists are those of its Table 1. Its
equations hold for the wrist centre, which lies d₆ behind the hand; two signs of θ1, two of θ3 and
two of θ5 give eight solutions. Lengths are in m, angles in rad.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from trajopt.core.arrays import Array, Bools

TWISTS = np.radians([0.0, -90.0, 0.0, -90.0, 90.0, -90.0])
# All eight pairs of signs: of the shoulder (θ1), of the elbow (θ3), of the wrist (θ5).
SHOULDER, ELBOW, WRIST = np.array(list(product([1, -1], repeat=3))).T
# A smaller |sin θ5|, or a smaller distance from an axis over the arm's size, is singular.
_SINGULAR_RTOL = 1e-10


def is_solved(a: Array, alpha: Array, d: Array) -> bool:
    """Return whether a modified D-H table is one that `eight_branches` inverts."""
    if len(a) != 6 or a[2] == 0 or a[4] or a[5] or d[4]:
        return False
    return bool(np.hypot(a[3], d[3]) > 0 and np.abs(alpha - TWISTS).max() < 1e-12)


def eight_branches(a: Array, d: Array, poses: Array, posture: Array) -> tuple[Array, Bools]:
    """Return all inverses of poses; the link lengths `a` and offsets `d` have one row per joint.

    Args:
        a: a_{i−1}, m, `(6,)`.
        d: d_i, m, `(6,)`.
        poses: Poses of the hand in the base, m, `(…, 4, 4)`.
        posture: Angles to stay near to where a singularity leaves some free, rad, `(6,)`.

    Returns:
        Angles in [−π, π] rad, `(…, 8, 6)`, by the signs `SHOULDER`, `ELBOW` and `WRIST`. They have
        the orientation of the pose. Where its place is out of reach the arm is stretched or folded
        towards it. And where axes 4 and 6 are one, `(…, 8)`: the pose fixes θ4 + θ6 or θ4 − θ6
        alone, and both are as near to the posture as that allows.
    """
    size = np.abs([a, d]).sum()
    rotation = poses[..., None, :3, :3]
    hand = poses[..., None, :3, 3]
    # The wrist centre, from the frame of joint 1 (which does not turn with it).
    x, y, z = np.moveaxis(hand - d[5] * rotation[..., 2] - [a[0], 0.0, d[0]], -1, 0)
    offset = d[1] + d[2]  # axes 2 and 3 are parallel

    # eq. 5, 6: −s1 x + c1 y = offset
    out = SHOULDER * _root(x**2 + y**2 - offset**2)
    q1 = np.arctan2(y, x) - np.arctan2(offset, out)
    on_axis = np.hypot(np.hypot(x, y), offset) < _SINGULAR_RTOL * size
    q1 = np.where(on_axis, posture[0], q1)

    # eq. 7 to 9: along the arm's plane, from axis 2; a3 c3 − d4 s3 = k
    ahead = out - a[1]
    k = (ahead**2 + z**2 - a[2] ** 2 - a[3] ** 2 - d[3] ** 2) / (2 * a[2])
    q3 = np.arctan2(a[3], d[3]) - np.arctan2(k, ELBOW * _root(a[3] ** 2 + d[3] ** 2 - k**2))

    # eq. 11 to 15: the wrist centre, seen from axis 2, is (u, v) turned by θ2 + θ3
    u = a[3] + a[2] * np.cos(q3)
    v = d[3] - a[2] * np.sin(q3)
    q23 = np.arctan2(-z, ahead) - np.arctan2(v, u)
    on_axis = np.hypot(ahead, z) < _SINGULAR_RTOL * size
    q23 = np.where(on_axis, posture[1] + q3, q23)

    # eq. 10: R_36, row by row, from the columns of R_03
    c1, s1, c23, s23 = np.cos(q1), np.sin(q1), np.cos(q23), np.sin(q23)
    axes = [[c1 * c23, s1 * c23, -s23], [-c1 * s23, -s1 * s23, -c23], [-s1, c1, 0 * q1]]
    row1, row2, row3 = (
        np.einsum("...i,...ij->...j", np.stack(axis, axis=-1), rotation) for axis in axes
    )

    # eq. 16 to 22: row 1 ends with −c4 s5, row 2 with c5, row 3 with s4 s5
    s5 = np.hypot(row1[..., 2], row3[..., 2])
    c5 = row2[..., 2]
    q4 = np.arctan2(WRIST * row3[..., 2], -WRIST * row1[..., 2])
    q5 = np.arctan2(WRIST * s5, c5)
    singular = s5 < _SINGULAR_RTOL
    q4 = np.where(singular, posture[3], q4)

    # eq. 23 to 26: −(s4 row 1 + c4 row 3) = (s6, c6, 0)
    last = -(np.sin(q4)[..., None] * row1 + np.cos(q4)[..., None] * row3)
    q6 = np.arctan2(last[..., 0], last[..., 1])

    # At a singular wrist both joints take half of the turn: θ4 ± θ6 is fixed, as cos θ5 = ±1.
    half = np.where(singular, _wrapped(q6 - posture[5]) / 2, 0.0)
    q4 = q4 + np.sign(c5) * half
    q6 = q6 - half

    return _wrapped(np.stack([q1, q23 - q3, q3, q4, q5, q6], axis=-1)), singular


def _root(square: Array) -> Array:
    """Return the square root, 0 of what is negative: as near as the arm comes."""
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


def _wrapped(angle: Array) -> Array:
    """Return the angle in [−π, π] rad that differs by whole turns."""
    return np.asarray(angle - 2 * np.pi * np.round(angle / (2 * np.pi)))
