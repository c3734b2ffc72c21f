"""Who asks for less never waits longer: every demand and limit made wider, alone and in pairs."""

from __future__ import annotations

import pytest

from soaks import mixes


@pytest.mark.parametrize("seed", [2, 26, 3])
def test_wider_never_lengthens(seed):
    """Random problems of two to five demands at once; the last one has jerk limits."""
    problem = mixes.drawn(seed)
    _, duration = mixes.solved(problem)
    for key, own in mixes.wider(problem):
        _, alone = mixes.solved(own)
        assert alone <= duration * (1 + mixes.THEOREM), key
        for other, both in mixes.wider(own):
            if other > key:
                assert mixes.solved(both)[1] <= alone * (1 + mixes.THEOREM), (key, other)
