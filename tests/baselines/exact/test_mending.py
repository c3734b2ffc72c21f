"""Motions of piecewise linear acceleration meet their end, and what is rounding is left alone."""

from __future__ import annotations

import numpy as np

from baselines.exact.mending import integrated, mended, missing


def test_mended_accelerations_end_with_their_velocity_where_they_should() -> None:
    """Random accelerations at random breaks, some of them 1e-9 of the others, with jumps."""
    rng = np.random.default_rng(2)
    lengths = 10 ** rng.uniform(-9, 0, (8, 50))
    t = lengths.sum(axis=0)
    u, w, h = rng.uniform(-1, 1, (3, 50))
    before, after = mended(lengths, rng.uniform(-1, 1, (2, 9, 50)), u, w, h)
    cubics, velocity, displacement = integrated(lengths, after[:-1], before[1:], u)
    np.testing.assert_allclose(velocity, w, atol=1e-13)
    np.testing.assert_allclose(displacement, h, atol=1e-13 * t.max())
    # each piece's jerk and acceleration lead to its end, and its velocity to the next piece
    cubic, square, speed, _ = cubics
    sizes = np.abs(before).max(axis=0)
    ends = 2 * square + 6 * cubic * lengths
    np.testing.assert_allclose(ends / sizes, before[1:] / sizes, atol=1e-12)
    reached = speed + lengths * (2 * square + 3 * cubic * lengths)
    np.testing.assert_allclose(reached[:-1], speed[1:], atol=1e-12)


def test_pieces_of_no_length_change_nothing() -> None:
    rng = np.random.default_rng(3)
    lengths = np.array([0.3, 0.0, 0.7, 0.0])
    first, last = rng.uniform(-1, 1, (2, 4))
    whole = integrated(lengths, first, last, np.array(0.5))
    used = lengths > 0
    fewer = integrated(lengths[used], first[used], last[used], np.array(0.5))
    np.testing.assert_allclose(whole[1:], fewer[1:], rtol=1e-15)


def test_what_is_missing_is_not_rounding() -> None:
    lengths = np.array([[0.25], [0.5], [0.25]])
    none = np.zeros((2, 4, 1))
    slow, short = missing(lengths, none, np.array([1.0]), np.array([1.0 + 1e-15]), np.array([1.0]))
    assert (slow, short) == (0, 0)
    slow, short = missing(lengths, none, np.array([1.0]), np.array([1.5]), np.array([1.25]))
    assert (slow, short) == (0.5, 0.25)
