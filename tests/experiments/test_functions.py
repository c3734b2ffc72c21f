"""The standard functions are 0 at their optimum, as published and moved, and above it elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.functions import DIMENSIONS, FUNCTIONS, median_error


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_least_value_is_0_at_its_place(name: str) -> None:
    function = FUNCTIONS[name]
    optimum = np.full(DIMENSIONS, function.at)
    assert function.value(optimum) == pytest.approx(0, abs=1e-14)
    rng = np.random.default_rng(1)
    others = optimum + rng.uniform(-0.3, 0.3, (50, DIMENSIONS))
    assert (function.value(others) > 0).all()


def test_a_moved_optimum_is_harder_for_a_search_that_shrinks_towards_0() -> None:
    at_0, elsewhere = (median_error("sphere", "ssa", moved, 2, 2000) for moved in (False, True))
    assert at_0 < 1e-6 < elsewhere
