"""Motions of piecewise linear acceleration."""

from __future__ import annotations

import numpy as np

from baselines.exact.method.pieces import Pieces
from trajopt.core import polynomials


def drawn(seed: int) -> tuple[Pieces, np.ndarray]:
    """Random pieces, some 1e-9 of the others, and velocities to start from."""
    rng = np.random.default_rng(seed)
    lengths = 10 ** rng.uniform(-9, 0, (8, 50))
    start = rng.uniform(-1, 1, lengths.shape)
    bend = rng.uniform(-1, 1, lengths.shape)
    pieces = Pieces(lengths, start, bend / lengths)
    return pieces, rng.uniform(-1, 1, 50)


def test_coefficients_lead_from_each_break_to_the_next() -> None:
    pieces, u = drawn(3)
    velocity, position = pieces.passed(u)
    lengths = pieces.lengths
    coefficients = pieces.integrated(u)
    unit = polynomials.stretched(coefficients, lengths)
    expected = [position[1:], velocity[1:] * lengths, pieces.end * lengths**2]
    for order, values in enumerate(expected):
        ends = polynomials.derivative(unit, order).sum(axis=0)
        np.testing.assert_allclose(ends, values, atol=1e-13)


def test_pieces_of_no_length_change_nothing() -> None:
    pieces, u = drawn(4)
    padded = Pieces(*(np.pad(table, [(0, 1), (0, 0)]) for table in pieces))
    for table in padded.passed(u):
        *_, before, last = table
        np.testing.assert_array_equal(before, last)


def test_two_pieces_become_one() -> None:
    """Lengths 1, 3, 2 become 4, 2; the second joint's acceleration may jump."""
    lengths = [[[1.0]], [[3.0]], [[2.0]]]
    start = [[[0.0, 5.0]], [[1.0, 7.0]], [[7.0, 9.0]]]
    jerk = [[[1.0, 0.0]], [[2.0, 0.0]], [[0.0, 0.0]]]
    pieces = Pieces(*map(np.array, (lengths, start, jerk)))
    jerky = np.array([True, False])
    joined = pieces.joined(np.array([0]), jerky)
    np.testing.assert_array_equal(joined.lengths[:, 0, 0], [4, 2, 0])
    # the first joint's goes from 0 to 7 in 4, the second's is the longer piece's
    first, second, _ = joined.start[:, 0]
    np.testing.assert_array_equal(first, [0, 7])
    np.testing.assert_array_equal(second, [7, 9])
    np.testing.assert_allclose(joined.jerk[0, 0], [7 / 4, 0])
