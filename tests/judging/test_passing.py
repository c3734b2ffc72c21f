"""When a motion passes its waypoints, and by how much it misses them: closed forms, brute force."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest

from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging import passing

LINE = Trajectory([0.0, 1.0], np.array([1.0, 0.0])[:, None, None], [0.0, 1.0])


@pytest.mark.parametrize("joint", [0, 1])
def test_the_joint_that_is_farthest_away_counts(joint):
    waypoints = np.array([[0.0, 0.0], [1.0, 1.0]])
    problem = Problem(waypoints, Limits([9.0, 9.0], [9.0, 9.0]))
    ends = waypoints.copy()
    ends[1, joint] += 5 * problem.rounding[joint]
    standing = Trajectory([0.0, 1.0], ends[1][None, None], [0.0, 1.0])
    assert passing.misses(problem, standing)[1] == pytest.approx(5, rel=0.3)


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6])
def test_a_waypoint_is_passed_at_the_very_time(offset):
    """`x = offset + t²` is at `offset + 1/4` after half a second."""
    motion = Trajectory([0.0, 1.0], np.array([1.0, 0.0, offset])[:, None, None], [0.0, 1.0])
    times = passing.waypoint_times(motion, np.array([[0.0], [0.25], [1.0]]) + offset)
    assert times[1] == pytest.approx(0.5, abs=4 * np.spacing(offset + 1.0))


@pytest.mark.parametrize("apart", [0, 1, 3])
@pytest.mark.parametrize("seed", range(10))
def test_candidates_in_order_have_the_least_sum_of_all(seed, apart):
    """Against every choice that does not decrease and keeps the second segment's least time."""
    misses = np.random.default_rng(seed).random((4, 5))
    chosen = passing._in_order(misses, np.arange(5.0), np.array([0.0, apart, 0.0]))
    assert chosen[0] == 0
    assert chosen[-1] == 4
    assert (np.diff(chosen) >= 0).all()
    assert chosen[2] - chosen[1] >= apart
    least = min(
        misses[0, 0] + misses[1, i] + misses[2, j] + misses[3, 4]
        for i, j in combinations_with_replacement(range(5), 2)
        if j - i >= apart
    )
    assert misses[range(4), chosen].sum() == pytest.approx(least, rel=1e-12)
