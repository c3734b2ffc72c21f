"""The soak of paths, in small."""

from __future__ import annotations

import pytest

from soaks.paths import judged


@pytest.mark.parametrize("seed", [8, 25])  # a spline; one joint that turns back, under jerk limits
def test_a_random_path_has_a_certified_answer_above_its_bound(seed):
    assert judged(seed).wrong == ""
