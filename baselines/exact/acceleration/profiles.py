"""The extreme profiles of one joint without a jerk limit (mathematics, section 4).

Between two velocities, which motion of time `t` covers most displacement, and which least? Both
speed up or brake to a peak, cruise, and go on to the other velocity at full acceleration. What lies
between both displacements is covered in the same way at less acceleration; or at full acceleration,
with a cruise in between that is longer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array


class Extremes(NamedTuple):
    """Peak velocities and displacements of the upper and lower profiles, arrays of one shape."""

    p_up: Array
    d_up: Array
    p_lo: Array
    d_lo: Array


def extremes(u: Array, w: Array, t: Array, v: Array, a: Array) -> Extremes:
    """Return the profiles of most and of least displacement (mathematics, section 4).

    Meaningful where `|w − u|` is within the acceleration limits. All arguments broadcast.

    Args:
        u: velocity at the start.
        w: velocity at the end.
        t: time of the segment.
        v: velocity limits, low and high.
        a: acceleration limits, low and high.
    """
    v1 = -v[0]
    v2 = v[1]
    a1 = -a[0]
    a2 = a[1]

    # the peak where both ramps fill the segment: (A1 A2 T + A1 u + A2 w) / (A1 + A2)
    sum_a = a1 + a2
    gained = a1 * a2 * t
    weighted = gained + a1 * u + a2 * w
    p_up = np.minimum(v2, weighted / sum_a)
    # D_up(p) = p T − (p − u)² / (2 A2) − (p − w)² / (2 A1)
    first = (p_up - u) ** 2 / (2 * a2)
    last = (p_up - w) ** 2 / (2 * a1)
    d_up = p_up * t - first - last

    # downwards: (A2 u + A1 w − A1 A2 T) / (A1 + A2)
    weighted = a2 * u + a1 * w - gained
    p_lo = np.maximum(-v1, weighted / sum_a)
    # D_lo(p) = p T + (p − u)² / (2 A1) + (p − w)² / (2 A2)
    first = (p_lo - u) ** 2 / (2 * a1)
    last = (p_lo - w) ** 2 / (2 * a2)
    d_lo = p_lo * t + first + last
    return Extremes(p_up, d_up, p_lo, d_lo)


class Ramps(NamedTuple):
    """A ramp from the first velocity to the peak, a cruise, and a ramp to the last velocity.

    Attributes:
        peak: velocity of the cruise.
        first: time of the first ramp.
        last: time of the last ramp; the rest of the segment is the cruise.
        share: share of the acceleration limits that both ramps use; 1 where the segment cannot be
            shorter.
    """

    peak: Array
    first: Array
    last: Array
    share: Array


def gentlest(u: Array, w: Array, t: Array, h: Array, v: Array, a: Array) -> Ramps:
    """Return the profile of least acceleration that covers a displacement (mathematics, section 4).

    It is the extreme profile under `s` times the acceleration limits, with the least `s` possible:
    two ramps, with a cruise between them if the velocity limit requires one. All arguments
    broadcast.

    Args:
        u: velocity at the start.
        w: velocity at the end.
        t: time of the segment.
        h: displacement, between `D_lo` and `D_up`.
        v: velocity limits, low and high.
        a: acceleration limits, low and high.
    """
    # Mirrored where the displacement is less than that of constant acceleration from u to w.
    beyond = h - (u + w) / 2 * t
    is_up = beyond >= 0
    side = np.where(is_up, 1.0, -1.0)
    beyond = side * beyond
    u = side * u
    w = side * w
    h = side * h
    step = w - u
    top = np.where(is_up, v[1], -v[0])
    a1 = np.where(is_up, -a[0], a[1])
    a2 = np.where(is_up, a[1], -a[0])

    # (A2 T s − d)(A1 T s + d) = 2 s (A1 + A2)(h − (u + w) T/2), d = w − u
    sum_a = a1 + a2
    square = a1 * a2 * t**2
    linear = (a2 - a1) * t * step / 2
    linear -= sum_a * beyond
    root = np.sqrt(linear**2 + square * step**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(linear > 0, step**2 / (linear + root), (root - linear) / square)
        # the peak where both ramps fill the segment
        gained = share * a1 * a2 * t
        peak = (gained + a1 * u + a2 * w) / sum_a
        # s (V T − h) = (V − u)² / (2 A2) + (V − w)² / (2 A1)
        first = (top - u) ** 2 / (2 * a2)
        last = (top - w) ** 2 / (2 * a1)
        cruising = (first + last) / (top * t - h)
        cruises = peak > top
        share = np.where(cruises, cruising, share)
        peak = np.minimum(peak, top)
        first = (peak - u) / (share * a2)
        last = (peak - w) / (share * a1)
    # Without a change of velocity and without a displacement to add there is no ramp.
    first = np.clip(np.nan_to_num(first), 0.0, t)
    rest = t - first
    last = np.clip(np.nan_to_num(last), 0.0, rest)
    last = np.where(cruises, last, rest)
    return Ramps(side * peak, first, last, np.nan_to_num(share))


def straightest(u: Array, w: Array, t: Array, h: Array, a: Array) -> tuple[Array, Array, Array]:
    """Return the profile of full acceleration to a cruise, and from it, over a displacement.

    It has the least overshoot of all motions between these velocities: `u²/(2 A)` beyond its start
    and `w²/(2 A)` beyond its end, where it cannot stop earlier, and it is monotone between these.
    All arguments broadcast.

    Args:
        u: velocity at the start.
        w: velocity at the end.
        t: time of the segment.
        h: displacement, between `D_lo` and `D_up`.
        a: acceleration limits, low and high.

    Returns:
        The cruise's velocity, the time of the ramp to it, and that of the ramp from it.
    """
    a1 = -a[0]
    a2 = a[1]
    # Velocities are counted from the mean one, so the displacement is 0.
    mean = h / np.where(t > 0, t, 1.0)
    u = u - mean
    w = w - mean
    with np.errstate(divide="ignore", invalid="ignore"):
        # A cruise at p between u and w: p (A T − d) + d (u + w)/2 = 0, with d = |w − u|.
        step = np.abs(w - u)
        limit = np.where(w > u, a2, a1)
        spare = limit * t - step
        between = -step * (u + w) / 2 / spare
    above = _cruise_above(u, w, t, a1, a2)
    below = -_cruise_above(-u, -w, t, a2, a1)
    highest = np.maximum(u, w)
    lowest = np.minimum(u, w)
    cruise = np.where(between > highest, above, between)
    cruise = np.where(between < lowest, below, cruise)
    cruise = np.nan_to_num(cruise)

    limit = np.where(cruise > u, a2, a1)
    first = np.abs(cruise - u) / limit
    limit = np.where(w > cruise, a2, a1)
    last = np.abs(w - cruise) / limit
    first = np.minimum(first, t)
    rest = t - first
    return mean + cruise, first, np.minimum(last, rest)


def _cruise_above(u: Array, w: Array, t: Array, a1: Array, a2: Array) -> Array:
    """Return the cruise velocity `p` above `u` and `w` at which the displacement is 0.

    The smaller root of `p T = (p − u)²/(2 A2) + (p − w)²/(2 A1)`.
    """
    square = (1 / a1 + 1 / a2) / 2
    linear = t + u / a2 + w / a1
    rise = u**2 / (2 * a2)
    fall = w**2 / (2 * a1)
    below_root = linear**2 - 4 * square * (rise + fall)
    root = np.sqrt(np.maximum(below_root, 0.0))
    return (linear - root) / (2 * square)
