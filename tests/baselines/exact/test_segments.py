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


@pytest.mark.parametrize("seed", range(5))
def test_squeezed_pieces_keep_limits_that_some_pieces_keep(seed: int) -> None:
    """A motion at full jerk in most pieces, changed at random: no smooth change leads back."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.2, 1.0, 8)
    jerk = rng.choice([-1.0, 1.0, 0.3], 8)
    steps = lengths * jerk
    levels = np.append(0.0, np.cumsum(steps))
    kept = one_joint(lengths, levels[:-1], jerk)
    segments = ending(kept, 0.5, jerk=1.0)
    assert segments.use(kept) == pytest.approx(1.0)
    levels[1:-1] += rng.uniform(-0.1, 0.1, 7)
    slopes = np.diff(levels) / lengths
    given = one_joint(lengths, levels[:-1], slopes)
    smooth = segments.mended(given)
    assert segments.use(smooth) > 1.01
    squeezed = segments.squeezed(given)
    assert segments.use(squeezed) <= 1 + 1e-8
    *ends, _ = segments
    missed = squeezed.missing(*ends)
    np.testing.assert_allclose(missed, 0.0, atol=1e-8)


def test_what_no_pieces_can_do_is_left_as_it_is() -> None:
    """Two accelerations cannot meet a velocity and a displacement far away."""
    none = [0.0, 0.0]
    pieces = one_joint([1.0, 1.0], none, none)
    near = ending(pieces, 0.0, jerk=9.0)
    far = near._replace(w=near.w + 1, h=near.h + 9)
    squeezed = far.squeezed(pieces)
    np.testing.assert_array_equal(squeezed.start, pieces.start)
