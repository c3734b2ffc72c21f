"""Problems made simpler, and answers brought back: each reduction alone, and all together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from trajopt import Limits, Planner, Problem, Relation, Solution, Status, Trajectory, verify
from trajopt.planners.reductions import (
    EQUAL_WAYPOINTS,
    OWN_UNITS,
    RESTING_JOINTS,
    SIMPLEST,
    reduced,
)
from trajopt.planners.registry import load
from trajopt.planners.rest_to_rest import stop_times

ALL = (EQUAL_WAYPOINTS, RESTING_JOINTS, OWN_UNITS)
PROBLEM = Problem(
    [[0.0, 2.0, 1.0], [30.0, 2.0, 1.5], [30.0, 2.0, 1.5], [10.0, 2.0, -4.0]],
    Limits([4.0, 1.0, 2.0], [8.0, 1.0, 3.0], jerk=[90.0, 1.0, np.inf], position=[40.0, 3.0, 5.0]),
    joint_names=["a", "b", "c"],
)


def cubics(problem: Problem) -> Solution:
    """From waypoint to waypoint at rest, q = h (3 s² − 2 s³), in twice the time of stopping."""
    times = 2 * stop_times(problem)
    h = problem.displacements
    zero = np.zeros_like(h)
    starts = problem.waypoints[:-1]
    powers = [-2 * h / times[:, None] ** 3, 3 * h / times[:, None] ** 2, zero, starts]
    breaks = np.concatenate([[0.0], np.cumsum(times)])
    return Solution(Status.SOLVED, Trajectory(breaks, np.stack(powers), breaks))


@dataclass(frozen=True)
class Seeing(Planner):
    """Notes the problem that it sees."""

    @reduced(*ALL)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        SEEN.append(problem)
        return cubics(problem)


SEEN: list[Problem] = []


def test_equal_waypoints_are_passed_at_one_instant():
    simpler = EQUAL_WAYPOINTS.apply(PROBLEM)
    assert EQUAL_WAYPOINTS.accepts(PROBLEM)
    assert not EQUAL_WAYPOINTS.accepts(simpler)
    assert len(simpler.waypoints) == 3
    back = EQUAL_WAYPOINTS.invert(PROBLEM, cubics(simpler)).trajectory
    assert back.waypoint_times[1] == back.waypoint_times[2]
    np.testing.assert_allclose(back(back.waypoint_times), PROBLEM.waypoints, atol=1e-12)


def test_joints_that_rest_are_left_out_and_stay_where_they_are():
    simpler = RESTING_JOINTS.apply(PROBLEM)
    assert simpler.joint_names == ("a", "c")
    assert simpler.limits == PROBLEM.limits.only([0, 2])
    assert not RESTING_JOINTS.accepts(simpler)
    motion = cubics(EQUAL_WAYPOINTS.apply(simpler))
    back = RESTING_JOINTS.invert(PROBLEM, motion).trajectory
    times = np.linspace(0, back.duration, 99)
    assert (back(times)[:, 1] == 2).all()
    np.testing.assert_array_equal(back(times)[:, [0, 2]], motion.trajectory(times))


def test_own_units_make_the_stop_last_one_and_the_longest_way_one():
    whole = EQUAL_WAYPOINTS.apply(PROBLEM)
    simpler = OWN_UNITS.apply(whole)
    assert stop_times(simpler).sum() == pytest.approx(1, rel=1e-12)
    assert np.abs(simpler.displacements).max() == pytest.approx(1, rel=1e-15)
    back = OWN_UNITS.invert(whole, cubics(simpler)).trajectory
    own = cubics(whole).trajectory
    np.testing.assert_allclose(back.waypoint_times, own.waypoint_times, rtol=1e-12)
    times = np.linspace(0, own.duration, 99)
    np.testing.assert_allclose(back(times), own(times), atol=1e-12)


def test_a_planner_sees_the_simplest_problem_and_answers_the_whole():
    solution = Seeing().solve(PROBLEM)
    (seen,) = SEEN
    assert seen.waypoints.shape == (3, 2)
    assert np.abs(seen.displacements).max() == pytest.approx(1)
    certificate = verify(PROBLEM.without("jerk"), solution.trajectory)
    assert certificate.feasible
    assert solution.trajectory.joints == 3
    assert len(solution.trajectory.waypoint_times) == 4


def test_reductions_one_by_one_are_one_reduction():
    simpler = SIMPLEST.apply(PROBLEM)
    assert SIMPLEST.accepts(PROBLEM)
    assert not SIMPLEST.accepts(simpler)
    assert simpler == RESTING_JOINTS.apply(EQUAL_WAYPOINTS.apply(PROBLEM))
    back = SIMPLEST.invert(PROBLEM, cubics(simpler)).trajectory
    np.testing.assert_array_equal(back(back.waypoint_times)[:, 1], PROBLEM.waypoints[:, 1])
    np.testing.assert_allclose(back(back.waypoint_times), PROBLEM.waypoints, atol=1e-12)


def test_a_joint_that_starts_in_motion_moves_although_its_waypoints_are_the_same():
    waypoints = [[0.0, 1.0], [1.0, 1.0]]
    problem = Problem(waypoints, Limits([2.0, 2.0], [4.0, 4.0]), start_velocity=[0.0, 0.5])
    assert not RESTING_JOINTS.accepts(problem)
    assert SIMPLEST.apply(problem) is problem


@pytest.mark.parametrize("name", ["exact", "exact-jerk"])
def test_a_limit_of_a_joint_that_rests_relaxes_nothing(name):
    limits = Limits([1.0, 1.0], [2.0, 2.0], position=[[-np.inf, np.inf], [0.0, 2.0]])
    problem = Problem([[0.0, 1.0], [1.5, 1.0]], limits)
    planner = load(name)
    solution = planner.solve(problem)
    assert planner.relation(problem) is Relation.SAME
    assert (solution.status, solution.message) == (Status.SOLVED, "")
    assert solution.trajectory.duration == pytest.approx(2.0, rel=1e-12)  # 1.5/1 + 1/2
    assert verify(problem, solution.trajectory).feasible


def test_an_answer_without_a_motion_stays_as_it_is():
    failed = Solution(Status.FAILED, message="no")
    for reduction in ALL:
        assert reduction.invert(PROBLEM, failed) is failed
