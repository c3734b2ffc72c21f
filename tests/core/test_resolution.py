"""Which waypoints may be missed by their rounding: those passed in line between brief steps."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared, thinned

ULP = np.finfo(float).eps


def problem(waypoints):
    table = np.array(waypoints, dtype=float)
    ones = np.ones(table.shape[1])
    return Problem(table, Limits(ones, ones, jerk=ones))


def between(*steps):
    """From −1 to 0, by these steps, and on by 1 in each joint."""
    ways = np.cumsum(steps, axis=0)
    first = np.zeros_like(ways[:1])
    return np.concatenate([first - 1, first, ways, ways[-1:] + 1])


@pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("joints", [1, 2, 3])
def test_steps_in_line_spare_all_between_them(size, joints):
    waypoints = between(*np.full((4, joints), size))
    assert spared(problem(waypoints)).tolist() == [False, False, True, True, True, False, False]
    assert thinned(problem(waypoints)).waypoints.tolist() == waypoints[[0, 1, 5, 6]].tolist()


def test_differences_that_no_double_states_are_none():
    size = 2.0**-46
    steps = [[size, size + 4 * ULP * turn] for turn in (0, 1, 0, 1)]
    assert spared(problem(between(*steps))).sum() == 3


@pytest.mark.parametrize(
    "steps",
    [
        [[1e-6, 0.0], [0.0, 1e-6]],
        [[1e-6, 1e-6], [-1e-6, -1e-6]],
        [[1e-6, 1e-6], [1e-6, 0.97e-6]],
        [[1e-12, 1e-12], [1e-12, -1e-12]],
        [[0.1, 0.1], [0.1, 0.1]],
        [[1e-6, 1e-6], [0.1, 0.1]],
    ],
    ids=["corner", "back", "bent", "turn", "long", "one long"],
)
def test_waypoints_that_turn_or_lie_beside_long_steps_are_exact(steps):
    asked = problem(between(*steps))
    assert not spared(asked).any()
    assert thinned(asked) is asked


@pytest.mark.parametrize("drift", [1e-15, 1e-13, 1e-9])
def test_a_joint_that_hardly_moves_hides_no_turn(drift):
    """Its step is its largest, but not that of the motion."""
    turning = between([1e-6], [-1e-6])
    drifting = drift * np.arange(len(turning))[:, None]
    assert not spared(problem(np.hstack([turning, drifting]))).any()


def test_it_depends_on_no_unit():
    steps = [[1e-5, 2e-5], [1e-5, 2.001e-5], [1e-5, 1.999e-5], [2e-5, 1e-5]]
    waypoints = between(*steps)
    found = spared(problem(waypoints))
    assert found.tolist() == [False, False, True, True, False, False, False]
    for unit in (2.0**-30, 2.0**20):
        assert spared(problem(unit * waypoints)).tolist() == found.tolist()
    assert spared(problem(waypoints[::-1]))[::-1].tolist() == found.tolist()
