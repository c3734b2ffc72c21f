"""Motions of piecewise linear acceleration meet their end, and what is rounding is left alone."""

from __future__ import annotations

import numpy as np

from baselines.exact.mending import integrated, mended, missing, passed
from trajopt.core import polynomials


def test_mended_accelerations_end_with_their_velocity_where_they_should() -> None:
    """Random accelerations at random breaks, some of them 1e-9 of the others, with jumps."""
    rng = np.random.default_rng(2)
    lengths = 10 ** rng.uniform(-9, 0, (8, 50))
    t = lengths.sum(axis=0)
    u, w, h = rng.uniform(-1, 1, (3, 50))
    given = rng.uniform(-1, 1, (2, 9, 50))
    once = mended(lengths, given, u, w, h)
    before, after = mended(lengths, once, u, w, h)
    first = after[:-1]
    last = before[1:]
    velocity, position = passed(lengths, first, last, u)
    np.testing.assert_allclose(velocity[-1], w, atol=1e-13)
    np.testing.assert_allclose(position[-1], h, atol=1e-13 * t.max())
    # each piece leads to the next one
    cubics = integrated(lengths, first, last, u)
    unit = polynomials.stretched(cubics, lengths)
    np.testing.assert_allclose(unit.sum(axis=0), position[1:], atol=1e-12)
    slopes = polynomials.derivative(unit).sum(axis=0)
    np.testing.assert_allclose(slopes, velocity[1:] * lengths, atol=1e-12)


def test_pieces_of_no_length_change_nothing() -> None:
    rng = np.random.default_rng(3)
    lengths = np.array([0.3, 0.0, 0.7, 0.0])
    first, last = rng.uniform(-1, 1, (2, 4))
    u = np.array(0.5)
    whole = integrated(lengths, first, last, u)
    used = lengths > 0
    fewer = integrated(lengths[used], first[used], last[used], u)
    np.testing.assert_allclose(whole[:, used], fewer, rtol=1e-14)


def test_what_is_missing_is_not_rounding() -> None:
    lengths = np.array([[0.25], [0.5], [0.25]])
    none = np.zeros((2, 4, 1))
    one = np.ones(1)
    rounded = one + 1e-15
    missed = missing(lengths, none, one, rounded, one)
    np.testing.assert_array_equal(missed, 0)
    faster = 1.5 * one
    farther = 1.25 * one
    slow, short = missing(lengths, none, one, faster, farther)
    assert (slow, short) == (0.5, 0.25)
