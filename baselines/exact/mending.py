"""Motions of piecewise linear acceleration, and what makes them meet their end."""

from __future__ import annotations

import numpy as np

from trajopt.core.arrays import Array

_ROUNDING_RTOL = 4e-15  # relative to the numbers that a residual comes from


def integrated(lengths: Array, first: Array, last: Array, u: Array) -> Array:
    """Position coefficients of motions from position 0, `(4, pieces, …)`.

    Args:
        lengths: of the pieces, `(pieces, …)`.
        first: acceleration at the start of each piece, likewise.
        last: and at its end.
        u: velocities at the start of the motion, `(…)`.
    """
    velocity, position = passed(lengths, first, last, u)
    # a piece of no length, as after the last break of a table, changes nothing
    jerk = np.divide(
        last - first,
        lengths,
        out=np.zeros_like(first),
        where=lengths > 0,
    )
    cubic = jerk / 6
    square = first / 2
    return np.array([cubic, square, velocity[:-1], position[:-1]])


def passed(lengths: Array, first: Array, last: Array, u: Array) -> tuple[Array, Array]:
    """Velocities and positions at the breaks of the same motions, `(pieces + 1, …)`."""
    mean = (first + last) / 2
    velocity = _from(u, lengths * mean)
    early = (2 * first + last) / 6
    speed = velocity[:-1] + lengths * early
    none = np.zeros_like(u)
    position = _from(none, lengths * speed)
    return velocity, position


def missing(lengths: Array, acceleration: Array, u: Array, w: Array, h: Array) -> Array:
    """The velocity and the displacement that motions miss at their end; 0 where that is rounding.

    Args:
        lengths: of the pieces, `(pieces, …)`.
        acceleration: before and after the breaks, `(2, pieces + 1, …)`. Both differ where it jumps,
            which it may without a jerk limit.
        u: velocities at the start, `(…)`.
        w: and at the end.
        h: displacements.

    Returns:
        Both, `(2, …)`.
    """
    before, after = acceleration
    first = after[:-1]
    last = before[1:]
    gained, travelled = _at_end(lengths, first, last, u)
    slow = w - gained
    short = h - travelled
    speeds = np.abs(u) + np.abs(w)
    is_slow = np.abs(slow) > _ROUNDING_RTOL * speeds
    is_short = np.abs(short) > _ROUNDING_RTOL * np.abs(h)
    return np.where([is_slow, is_short], [slow, short], 0.0)


def mended(lengths: Array, acceleration: Array, u: Array, w: Array, h: Array) -> Array:
    """Accelerations with which nothing is missing, of at least three pieces.

    They change by a multiple of `x (1 - x)` and one of `x (1 - x) (1 - 2 x)`, where `x` is the
    share of the time that has passed: a large change leaves some rounding. The arguments are those
    of `missing`.
    """
    shares = lengths / lengths.sum(axis=0)
    none = np.zeros_like(shares[0])
    x = _from(none, shares)
    left = 1 - x
    even = x * left
    odd = even * (left - x)
    even_gain, even_way = _at_end(lengths, even[:-1], even[1:], none)
    odd_gain, odd_way = _at_end(lengths, odd[:-1], odd[1:], none)
    slow, short = missing(lengths, acceleration, u, w, h)
    # both equations by Cramer's rule
    size = even_gain * odd_way - odd_gain * even_way
    evenly = slow * odd_way - odd_gain * short
    oddly = even_gain * short - even_way * slow
    change = evenly * even
    change += oddly * odd
    return acceleration + change / size


def _at_end(lengths: Array, first: Array, last: Array, u: Array) -> tuple[Array, Array]:
    """Velocity and position at the end, `(…)`."""
    velocity, position = passed(lengths, first, last, u)
    return velocity[-1], position[-1]


def _from(start: Array, steps: Array) -> Array:
    """The value before the first step and after each, along the first axis."""
    first = np.broadcast_to(start, steps[:1].shape)
    parts = np.concatenate([first, steps])
    return np.cumsum(parts, axis=0)
