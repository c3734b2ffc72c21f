"""Limits that pieces use, and pieces that use as little of them as any can."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike

from baselines.exact.mending import Pieces
from baselines.exact.segments import Segments


def one_joint(lengths: ArrayLike, start: ArrayLike, jerk: ArrayLike) -> Pieces:
    """Pieces of one segment and one joint."""
    tables = np.array([lengths, start, jerk])
    return Pieces(*tables[..., None, None])


def sides(limit: float) -> np.ndarray:
    return np.array([[-limit], [limit]])


def ending(
    pieces: Pieces,
    u: float,
    jerk: float,
) -> Segments:
    """The segment that these pieces pass, with limits of 9, 9 and this jerk."""
    at_start = np.array([[u]])
    velocity, position = pieces.passed(at_start)
    *_, w = velocity
    *_, h = position
    wide = sides(9.0)
    limits = wide, wide, sides(jerk)
    return Segments(at_start, w, h, limits)


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
    changed, keeps = segments.kept(given, ONLY)
    assert keeps.all()
    mended = segments.mended(changed)
    assert segments.use(mended) <= 1 + 3e-10
    *ends, _ = segments
    missed = mended.missing(*ends)
    np.testing.assert_allclose(missed, 0.0, atol=1e-14)


def test_what_no_pieces_can_do_is_not_kept() -> None:
    """Nine times the displacement that limits allow."""
    none = np.zeros(4)
    pieces = one_joint(np.ones(4), none, none)
    near = ending(pieces, 0.0, jerk=9.0)
    far = near._replace(h=near.h + 9 * 36)
    _, keeps = far.kept(pieces, ONLY)
    assert not keeps.any()
