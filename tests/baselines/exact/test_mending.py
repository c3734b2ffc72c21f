"""Motions of piecewise linear acceleration meet their end, and what is rounding is left alone."""

from __future__ import annotations

import numpy as np

from baselines.exact.mending import Pieces
from trajopt.core import polynomials


def drawn(seed: int) -> tuple[Pieces, np.ndarray]:
    """Random pieces, some 1e-9 of the others, and two velocities and a displacement to meet."""
    rng = np.random.default_rng(seed)
    lengths = 10 ** rng.uniform(-9, 0, (8, 50))
    start = rng.uniform(-1, 1, lengths.shape)
    bend = rng.uniform(-1, 1, lengths.shape)
    pieces = Pieces(lengths, start, bend / lengths)
    return pieces, rng.uniform(-1, 1, (3, 50))


def test_mended_pieces_end_with_their_velocity_where_they_should() -> None:
    given, (u, w, h) = drawn(2)
    pieces = given.mended(u, w, h).mended(u, w, h)
    velocity, position = pieces.passed(u)
    np.testing.assert_allclose(velocity[-1], w, atol=1e-13)
    np.testing.assert_allclose(position[-1], h, atol=1e-12)


def test_coefficients_lead_from_each_break_to_the_next() -> None:
    pieces, (u, _, _) = drawn(3)
    velocity, position = pieces.passed(u)
    lengths = pieces.lengths
    coefficients = pieces.integrated(u)
    unit = polynomials.stretched(coefficients, lengths)
    expected = [
        position[1:],
        velocity[1:] * lengths,
        pieces.end * lengths**2,
    ]
    for order, values in enumerate(expected):
        ends = polynomials.derivative(unit, order).sum(axis=0)
        np.testing.assert_allclose(ends, values, atol=1e-13)


def test_pieces_of_no_length_change_nothing() -> None:
    pieces, (u, w, h) = drawn(4)
    padded = Pieces(*(np.pad(table, [(0, 1), (0, 0)]) for table in pieces))
    mended = pieces.mended(u, w, h)
    of_padded = padded.mended(u, w, h)
    np.testing.assert_allclose(of_padded.start[:-1], mended.start, rtol=1e-9)
    for table in padded.passed(u):
        *_, before, last = table
        np.testing.assert_array_equal(before, last)


def test_what_is_missing_is_not_rounding() -> None:
    none = np.zeros((3, 1))
    lengths = np.array([[0.25], [0.5], [0.25]])
    pieces = Pieces(lengths, none, none)
    one = np.ones(1)
    rounded = one + 1e-15
    missed = pieces.missing(one, rounded, one)
    np.testing.assert_array_equal(missed, 0)
    faster = 1.5 * one
    farther = 1.25 * one
    slow, short = pieces.missing(one, faster, farther)
    assert (slow, short) == (0.5, 0.25)


def test_two_pieces_become_one() -> None:
    """Lengths 1, 3, 2 become 4, 2; the second joint's acceleration may jump."""
    lengths = [
        [[1.0]],
        [[3.0]],
        [[2.0]],
    ]
    start = [
        [[0.0, 5.0]],
        [[1.0, 7.0]],
        [[7.0, 9.0]],
    ]
    jerk = [
        [[1.0, 0.0]],
        [[2.0, 0.0]],
        [[0.0, 0.0]],
    ]
    pieces = Pieces(*map(np.array, (lengths, start, jerk)))
    jerky = np.array([True, False])
    joined = pieces.joined(np.array([0]), jerky)
    np.testing.assert_array_equal(joined.lengths[:, 0, 0], [4, 2, 0])
    # the first joint's goes from 0 to 7 in 4, the second's is the longer piece's
    first, second, _ = joined.start[:, 0]
    np.testing.assert_array_equal(first, [0, 7])
    np.testing.assert_array_equal(second, [7, 9])
    np.testing.assert_allclose(joined.jerk[0, 0], [7 / 4, 0])
