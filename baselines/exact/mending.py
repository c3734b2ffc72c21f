"""Motions of piecewise linear acceleration, and what makes them meet their end.

Accelerations are tables `(2, pieces + 1, …)`: before and after each break. They differ where
acceleration jumps, which it may without a jerk limit.
"""

from __future__ import annotations

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array

_ROUNDING_RTOL = 4e-15  # relative to the numbers that a residual comes from


def missing(lengths: Array, acceleration: Array, u: Array, w: Array, h: Array) -> Array:
    """The velocity and the displacement that motions miss at their end; 0 where that is rounding.

    Args:
        lengths: of the pieces, `(pieces, …)`.
        acceleration: before and after the breaks, straight in between, `(2, pieces + 1, …)`.
        u: velocities at the start, `(…)`.
        w: and at the end.
        h: displacements.

    Returns:
        Both, `(2, …)`.
    """
    before, after = acceleration
    first = after[:-1]
    last = before[1:]
    _, reached, travelled = integrated(lengths, first, last, u)
    slow = w - reached
    short = h - travelled
    is_fast = np.abs(slow) > _ROUNDING_RTOL * (np.abs(u) + np.abs(w))
    is_far = np.abs(short) > _ROUNDING_RTOL * np.abs(h)
    return np.where([is_fast, is_far], [slow, short], 0.0)


def mended(lengths: Array, acceleration: Array, u: Array, w: Array, h: Array) -> Array:
    """Accelerations with which nothing is missing, of at least three pieces.

    They change by a multiple of `x (1 - x)` and one of `x (1 - x) (1 - 2 x)`, where `x` is the
    share of the time that has passed: a large change leaves some rounding. The arguments are those
    of `missing`.
    """
    shares = lengths / lengths.sum(axis=0)
    passed = _from(np.zeros_like(shares[0]), shares)
    even = passed * (1 - passed)
    odd = even * (1 - 2 * passed)
    even_gain, even_way = _gained(lengths, even)
    odd_gain, odd_way = _gained(lengths, odd)
    # both equations by Cramer's rule
    size = even_gain * odd_way - odd_gain * even_way
    slow, short = missing(lengths, acceleration, u, w, h)
    evenly = slow * odd_way - odd_gain * short
    oddly = even_gain * short - even_way * slow
    change = evenly * even + oddly * odd
    return acceleration + change / size


def integrated(lengths: Array, first: Array, last: Array, u: Array) -> tuple[Array, Array, Array]:
    """The motions of piecewise linear acceleration, and their velocities and displacements.

    Args:
        lengths: of the pieces, `(pieces, …)`.
        first: acceleration at the start of each piece, likewise.
        last: and at its end.
        u: velocities at the start, `(…)`.

    Returns:
        Position coefficients `(4, pieces, …)`, velocity and displacement at the end, `(…)`.
    """
    # a piece of no length, as after the last break of a table, changes nothing
    jerk = np.divide(
        last - first,
        lengths,
        out=np.zeros_like(first),
        where=lengths > 0,
    )
    cubic = jerk / 6
    square = first / 2
    # as the verifier evaluates a piece's end: between its pieces the motion does not jump
    derivative = np.array([3.0 * cubic, 2.0 * square, 0.0 * first])
    gains = polynomials.stretched(derivative, lengths).sum(axis=0)
    velocity = _from(u, gains)
    speeds = velocity[:-1]
    bends = square + cubic * lengths
    ways = lengths * (speeds + lengths * bends)
    position = _from(np.zeros_like(u), ways)
    coefficients = np.array([cubic, square, speeds, position[:-1]])
    return coefficients, velocity[-1], position[-1]


def _gained(lengths: Array, acceleration: Array) -> tuple[Array, Array]:
    """Velocity and displacement, from rest, at the end of accelerations without a jump."""
    first = acceleration[:-1]
    last = acceleration[1:]
    mean = (first + last) / 2
    gains = lengths * mean
    velocity = np.cumsum(gains, axis=0)
    before = velocity - gains
    early = (2 * first + last) / 6
    ways = lengths * (before + lengths * early)
    return velocity[-1], ways.sum(axis=0)


def _from(start: Array, steps: Array) -> Array:
    """The value before the first step and after each, along the first axis."""
    first = np.broadcast_to(start, steps[:1].shape)
    parts = np.concatenate([first, steps])
    return np.cumsum(parts, axis=0)
