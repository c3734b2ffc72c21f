"""From nearly on a bound to on it, against closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from baselines.ipopt import Program, program
from baselines.settled import settled

NONE = np.zeros(0)


def with_constraint(constraint: object, x: ca.MX) -> Program:
    return program("settled", [x], [], ca.sum1(x), [constraint], {})


def test_it_is_the_nearest_point_on_the_bounds_nearby() -> None:
    x = ca.MX.sym("x", 3)
    circle = with_constraint(x[0] ** 2 + x[1] ** 2 + (x[2] - 5) ** 2 - 1, x)
    start = np.array([1 - 1e-6, 1e-5, 5 + 1e-7])
    bounds = (np.array([-9.0, 0.0, -9.0]), np.full(3, 9.0))
    found = settled(circle, start, NONE, bounds, (0.0, 0.0), 1e-4)
    # the second on its bound, the third hardly moved, the first on the circle through them
    np.testing.assert_allclose(found, [1, 0, 5], atol=2e-7)
    assert found is not None
    assert found[1] == 0
    assert found[0] ** 2 + (found[2] - 5) ** 2 == pytest.approx(1, abs=1e-14)


def test_what_is_not_near_stays() -> None:
    x = ca.MX.sym("x", 2)
    line = with_constraint(x[0] + x[1], x)
    start = np.array([0.3, 0.7])
    found = settled(line, start, NONE, (np.zeros(2), np.ones(2)), (0.5, 2.0), 1e-4)
    np.testing.assert_array_equal(found, start)


def test_bounds_that_contradict_each_other_are_no_answer() -> None:
    x = ca.MX.sym("x", 2)
    line = with_constraint(x[0] + x[1] - 1 - 1e-5, x)
    start = np.full(2, 0.500005)
    assert settled(line, start, NONE, (np.zeros(2), np.full(2, 0.5)), (0.0, 0.0), 1e-4) is None
