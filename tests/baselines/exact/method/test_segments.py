"""Limits that pieces use, and pieces that use as little of them as any can."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike

from baselines.exact.method.pieces import Pieces
from baselines.exact.method.segments import Segments


def one_joint(lengths: ArrayLike, start: ArrayLike, jerk: ArrayLike) -> Pieces:
    """Pieces of one segment and one joint."""
    tables = np.array([lengths, start, jerk])
    return Pieces(*tables[..., None, None])


def sides(limit: float) -> np.ndarray:
    return np.array([[[-limit]], [[limit]]])


def ending(pieces: Pieces, u: float, jerk: float) -> Segments:
    """The segment that these pieces pass, with limits of 9, 9 and this jerk."""
    at_start = np.array([[u]])
    velocity, position = pieces.passed(at_start)
    *_, w = velocity
    *_, h = position
    wide = sides(9.0)
    limits = wide, wide, sides(jerk)
    return Segments(at_start, w, h, limits)


def missed(segments: Segments, pieces: Pieces) -> np.ndarray:
    """Velocity and displacement that are missing, beyond rounding."""
    passed = pieces.passed(segments.u)
    return segments.missing(pieces.lengths, passed, 4e-15)


def several(seed: int, jerk: float) -> tuple[Pieces, Segments]:
    """Random pieces of 50 joints, some 1e-9 of the others, and ends that they miss."""
    rng = np.random.default_rng(seed)
    lengths = 10 ** rng.uniform(-9, 0, (8, 1, 1))
    start = rng.uniform(-1, 1, (8, 1, 50))
    bend = rng.uniform(-1, 1, start.shape)
    pieces = Pieces(lengths, start, bend / lengths)
    ends = rng.uniform(-1, 1, (3, 1, 50))
    wide = np.full((2, 1, 50), 9.0)
    steep = np.full((2, 1, 50), jerk)
    limits = wide, wide, steep
    return pieces, Segments(*ends, limits)


@pytest.mark.parametrize("jerk", [9.0, np.inf])
def test_mended_pieces_end_with_their_velocity_where_they_should(jerk: float) -> None:
    given, segments = several(2, jerk)
    mended = segments.mended(segments.mended(given))
    velocity, position = mended.passed(segments.u)
    np.testing.assert_allclose(velocity[-1], segments.w, atol=1e-13)
    np.testing.assert_allclose(position[-1], segments.h, atol=1e-12)


def test_pieces_of_no_length_change_nothing_in_how_others_are_mended() -> None:
    pieces, segments = several(4, 9.0)
    padded = Pieces(*(np.pad(table, [(0, 1), (0, 0), (0, 0)]) for table in pieces))
    mended = segments.mended(padded)
    expected = segments.mended(pieces)
    np.testing.assert_allclose(mended.start[:-1], expected.start, rtol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_without_a_jerk_limit_accelerations_stay_constant(count: int) -> None:
    """Two constant ones lead to any end, one to its velocity: it passes the mean of both."""
    none = np.zeros(count)
    pieces = one_joint(np.ones(count), none, none)
    segments = ending(pieces, 0.5, jerk=np.inf)._replace(w=np.array([[1.5]]))
    mended = segments.mended(pieces)
    np.testing.assert_array_equal(mended.jerk, 0)
    velocity, position = mended.passed(segments.u)
    assert velocity[-1] == pytest.approx(1.5)
    expected = 1.0 if count == 1 else count * 0.5
    assert position[-1] == pytest.approx(expected)
    assert np.isinf(segments.use(mended)) == (count == 1)


def test_what_is_missing_is_not_rounding() -> None:
    none = np.zeros(3)
    pieces = one_joint([0.25, 0.5, 0.25], none, none)
    met = ending(pieces, 1.0, jerk=9.0)
    rounded = met._replace(w=met.w + 1e-15, h=met.h - 1e-15)
    np.testing.assert_array_equal(missed(rounded, pieces), 0)
    farther = met._replace(w=1.5 * met.w, h=1.25 * met.h)
    slow, short = missed(farther, pieces)
    assert (slow, short) == (0.5, 0.25)


def test_a_break_goes_where_another_joint_can_do_without_it() -> None:
    """The first joint needs its break; that of the second, with time to spare, is 1e-8 later."""
    lengths = np.array([1.0, 1e-8, 1.0 - 1e-8])
    first = [1.0, -1.0, -1.0]
    second = [0.5, 0.5, -0.5]
    start = np.transpose([first, second])[:, None]
    pieces = Pieces(lengths[:, None, None], start, np.zeros_like(start))
    one = np.array([[[-1.0, -1.0]], [[1.0, 1.0]]])
    rest = np.zeros((1, 2))
    velocity, position = pieces.passed(rest)
    *_, w = velocity
    *_, h = position
    limits = 2 * one, one, np.inf * one
    segments = Segments(rest, w, h, limits)
    close = np.array([1e-6])
    fewer = segments.thinned(pieces, close, brief=0.0)
    np.testing.assert_array_equal(fewer.lengths[:, 0, 0], [1, 1, 0])
    assert segments.use(fewer).max() == pytest.approx(1, abs=1e-15)


def test_use_is_the_largest_share_of_all_limits() -> None:
    # from 1 at acceleration 6 and jerk -12: at the peak after 0.5 it is 1 + 6²/(2 12) = 2.5
    pieces = one_joint([1.0], [6.0], [-12.0])
    segments = ending(pieces, 1.0, jerk=24.0)
    assert segments.use(pieces) == pytest.approx(6 / 9)
    _, *others = segments.limits
    slow = segments._replace(limits=(sides(2.0), *others))
    assert slow.use(pieces) == pytest.approx(2.5 / 2)
    stiff = ending(pieces, 1.0, jerk=8.0)
    assert stiff.use(pieces) == pytest.approx(12 / 8)


def test_pieces_of_no_length_use_nothing() -> None:
    pieces = one_joint([1.0, 0.0], [6.0, 1e9], [-12.0, 1e9])
    assert ending(pieces, 1.0, jerk=24.0).use(pieces) == pytest.approx(6 / 9)


ONLY = np.array([True])


@pytest.mark.parametrize("seed", range(5))
def test_a_linear_program_keeps_limits_that_some_pieces_keep(seed: int) -> None:
    """A motion at full jerk in most pieces, changed at random: no smooth change leads back."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.2, 1.0, 8)
    jerk = rng.choice([-1.0, 1.0, 0.3], 8)
    steps = lengths * jerk
    levels = np.append(0.0, np.cumsum(steps))
    optimal = one_joint(lengths, levels[:-1], jerk)
    segments = ending(optimal, 0.5, jerk=1.0)
    assert segments.use(optimal) == pytest.approx(1.0)
    levels[1:-1] += rng.uniform(-0.1, 0.1, 7)
    slopes = np.diff(levels) / lengths
    given = one_joint(lengths, levels[:-1], slopes)
    check(segments, given)


@pytest.mark.parametrize("seed", range(5))
def test_without_a_jerk_limit_acceleration_may_jump(seed: int) -> None:
    """A motion at full acceleration in each piece, changed at random."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.05, 0.2, 6)
    levels = rng.choice([-9.0, 9.0], 6)
    optimal = one_joint(lengths, levels, np.zeros(6))
    segments = ending(optimal, 0.5, jerk=np.inf)
    assert segments.use(optimal) == pytest.approx(1.0)
    levels += rng.uniform(-1.0, 1.0, 6)
    check(segments, one_joint(lengths, levels, np.zeros(6)))


def check(segments: Segments, given: Pieces) -> None:
    """Mended smoothly these pieces exceed limits; a linear program makes them keep them."""
    smooth = segments.mended(given)
    assert segments.use(smooth) > 1.01
    _, keeps = segments.kept(given, ~ONLY)
    assert not keeps.any()
    mended, keeps = segments.kept(given, ONLY)
    assert keeps.all()
    assert segments.use(mended) <= 1 + 3e-10
    np.testing.assert_allclose(missed(segments, mended), 0.0, atol=1e-14)


def test_what_no_pieces_can_do_is_not_kept() -> None:
    """Nine times the displacement that limits allow."""
    none = np.zeros(4)
    pieces = one_joint(np.ones(4), none, none)
    near = ending(pieces, 0.0, jerk=9.0)
    far = near._replace(h=near.h + 9 * 36)
    _, keeps = far.kept(pieces, ONLY)
    assert not keeps.any()
