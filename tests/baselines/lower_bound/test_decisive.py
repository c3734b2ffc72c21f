"""Bounds of many waypoints within tolerance, by the few waypoints and joints that decide."""

from dataclasses import replace

import numpy as np
import pytest

from baselines.exact.jerk import ExactJerk
from baselines.lower_bound import decisive
from baselines.lower_bound.bound import prove
from baselines.lower_bound.dual_check import proved_bound
from baselines.lower_bound.planner import Prove
from trajopt import Limits, Problem
from trajopt.core.exceptions import InvalidInput

V, A, TOLERANCE, FAR = 1.0, 4.0, 0.01, 1.0
# there and back, the turn on the near side of its box: two trapezoids
OPTIMUM = 2 * ((FAR - TOLERANCE) / V + V / A)


def there_and_back() -> Problem:
    """Twelve waypoints of three joints: the second one decides, the first one rests."""
    s = np.append(np.linspace(0, 1, 7), np.linspace(1, 0, 7)[1:-1])
    way = np.column_stack([np.full(12, 0.3), FAR * np.append(s, 0)[:12], 0.1 * np.arange(12) / 11])
    way[-1, 1] = 0.0
    return Problem(way, Limits([V] * 3, [A] * 3), tolerance=TOLERANCE)


def test_a_few_waypoints_and_one_joint_prove_the_closed_form():
    found = Prove(within=1e-3, time_limit=20).solve(there_and_back())
    assert OPTIMUM * (1 - 1e-3) <= found.lower_bound <= OPTIMUM
    assert "the bound counts waypoints: 3 of 12, moving joints: 1 of 2" in found.message
    assert Prove().stored_bound(there_and_back(), found.stats) == found.lower_bound


def test_a_proof_says_which_joints_it_counts():
    problem = there_and_back()
    bound = prove(problem, within=1e-3, time_limit=20)
    assert bound.proof.joints.tolist() == [1]
    assert proved_bound(problem, bound.proof) == bound.lower_bound
    idle = replace(bound.proof, joints=np.array([2.0]))
    assert proved_bound(problem, idle) < 0.5 * OPTIMUM
    for numbers in ([1.0, 1.0], [2.0, 1.0], [3.0], [-1.0], [0.5], [1.0, 2.0]):
        with pytest.raises(InvalidInput, match=r"proof (joints|units)"):
            proved_bound(problem, replace(bound.proof, joints=np.array(numbers)))


def test_parts_of_smaller_losses_count_more():
    problem = there_and_back().only([1, 2])
    ended = replace(problem, waypoints=np.vstack([problem.waypoints[:-1], [[0.1, 0.1]]]))
    optimum = OPTIMUM - 0.1 / V
    fine, coarse = decisive.parts(ended, optimum, [2e-4, 0.9], lambda: False)
    assert fine.waypoints.tolist() == [0, 6, 11]
    assert fine.known.duration == pytest.approx(optimum, rel=1e-4)
    assert coarse.waypoints.tolist() == [0, 11]
    assert coarse.known.duration == pytest.approx(2 * np.sqrt(0.1 / A), rel=1e-4)
    assert not decisive.parts(ended, optimum, [2e-4], lambda: True)


def test_jerk_limits_count_in_a_part():
    problem = there_and_back()
    limits = Limits([V] * 3, [A] * 3, [20.0] * 3)
    jerky = Problem(problem.waypoints, limits, tolerance=TOLERANCE)
    near_side = Problem([[0.0], [FAR - TOLERANCE], [0.0]], limits.only([1]))
    optimum = ExactJerk().solve(near_side).trajectory.duration
    found = Prove(within=2e-3, time_limit=20).solve(jerky)
    assert optimum * (1 - 2e-3) <= found.lower_bound <= optimum * (1 + 1e-9)
    assert "moving joints: 1 of 2" in found.message
    assert Prove().stored_bound(jerky, found.stats) == found.lower_bound


def test_a_motion_of_equal_waypoints_is_the_target_too():
    problem = there_and_back()
    every = [0, *range(6), *range(5, 12)]
    twice = Problem(problem.waypoints[every], problem.limits, tolerance=TOLERANCE)
    motion = Prove(within=1e-3, time_limit=20).solve(problem).trajectory
    known = replace(motion, waypoint_times=motion.waypoint_times[every])
    bound = prove(twice, within=1e-3, time_limit=20, known=known)
    assert bound.upper_bound == pytest.approx(motion.duration, rel=1e-12)
    assert OPTIMUM * (1 - 1e-3) <= bound.lower_bound <= OPTIMUM
