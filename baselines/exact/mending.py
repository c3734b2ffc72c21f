"""Motions of piecewise linear acceleration, and what makes them meet their end.

Accelerations are tables `(2, pieces + 1, …)`: before and after each break. They differ where
acceleration jumps, which it may without a jerk limit.
"""

from __future__ import annotations

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array

_MENDINGS = 2  # the second one mends the rounding of the first
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
    _, reached, travelled = integrated(lengths, after[:-1], before[1:], u)
    missed = np.array([w - reached, h - travelled])
    sizes = np.array([np.abs(u) + np.abs(w), np.abs(h)])
    return np.where(np.abs(missed) > _ROUNDING_RTOL * sizes, missed, 0.0)


def mended(lengths: Array, acceleration: Array, u: Array, w: Array, h: Array) -> Array:
    """Accelerations with which nothing is missing, of at least three pieces.

    They change by a multiple of `x (1 - x)` and one of `x (1 - x) (1 - 2 x)`, where `x` is the
    share of the time that has passed. The arguments are those of `missing`.
    """
    none = np.zeros_like(lengths[0])
    passed = _from(none, lengths / lengths.sum(axis=0))
    even = passed * (1 - passed)
    odd = even * (1 - 2 * passed)
    _, even_gain, even_way = integrated(lengths, even[:-1], even[1:], none)
    _, odd_gain, odd_way = integrated(lengths, odd[:-1], odd[1:], none)
    # both equations by Cramer's rule
    size = even_gain * odd_way - odd_gain * even_way
    for _ in range(_MENDINGS):
        slow, short = missing(lengths, acceleration, u, w, h)
        evenly = slow * odd_way - odd_gain * short
        oddly = even_gain * short - even_way * slow
        acceleration = acceleration + (evenly * even + oddly * odd) / size
    return acceleration


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
    jerk = np.divide(last - first, lengths, out=np.zeros_like(first), where=lengths > 0)
    cubic = jerk / 6
    square = first / 2
    # as the verifier evaluates a piece's end: between its pieces the motion does not jump
    derivative = np.array([3.0 * cubic, 2.0 * square, 0.0 * first])
    gains = polynomials.stretched(derivative, lengths).sum(axis=0)
    velocity = _from(u, gains)
    ways = lengths * (velocity[:-1] + lengths * (square + cubic * lengths))
    position = _from(np.zeros_like(u), ways)
    coefficients = np.array([cubic, square, velocity[:-1], position[:-1]])
    return coefficients, velocity[-1], position[-1]


def _from(start: Array, steps: Array) -> Array:
    """The value before the first step and after each, along the first axis."""
    first = np.broadcast_to(start, steps[:1].shape)
    return np.cumsum(np.concatenate([first, steps]), axis=0)
