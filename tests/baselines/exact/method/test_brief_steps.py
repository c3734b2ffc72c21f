"""Tiny steps in line on a straight way: the optimum is that of the way, in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from baselines.exact.jerk import planner as jerk
from baselines.exact.method import brief_steps
from baselines.exact.method.interior_point import MAX_ITERATIONS, descended
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites.catalogue import load
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.solution import Solution, Status
from trajopt.judging import verification as certificate
from trajopt.judging.verification import verify
from trajopt.planners.rest_to_rest import end_to_end_bound, stop_times

SCALES = np.array([1.0, 0.7, -0.4])  # of the joints


def straight(first, steps, joints, stiffness, **limits):
    """From 0 to 1 rad in the first joint, with tiny steps from `first` on."""
    ways = np.concatenate([[0.0], np.cumsum(steps)])
    line = np.concatenate([[0.0], first + ways, [1.0]])
    ones = np.ones(joints)
    jerk = None if stiffness is None else stiffness * ones
    return Problem(line[:, None] * SCALES[:joints], Limits(2 * ones, ones, jerk=jerk, **limits))


def certified(planner, problem):
    return verify(problem, planner.solve(problem).trajectory).certified_duration


@pytest.mark.parametrize("size", [1e-3, 1e-5, 1e-6, 1e-8])
@pytest.mark.parametrize(
    ("joints", "stiffness", "count", "first"),
    [
        (1, 1.0, 2, 0.5),
        (3, 10.0, 8, 1 / 3),
        (2, 100.0, 1, 0.5),
        (1, 1.0, 4, 0.0),
        (2, None, 8, 0.5),
    ],
)
def test_tiny_steps_cost_nothing(size, joints, stiffness, count, first):
    planner = Exact() if stiffness is None else ExactJerk()
    problem = straight(first or size, np.full(count, size), joints, stiffness)
    best = end_to_end_bound(problem)
    assert best * (1 - 1e-9) <= certified(planner, problem) <= best * (1 + 1e-6)


def test_the_case_of_the_two_steps_of_a_millionth():
    """Once 5.215 s, 30 % above the optimum of 4 s."""
    limits = Limits([2.0], [1.0], jerk=[1.0])
    problem = Problem([[-1.0], [-1e-6], [0.0], [1e-6], [1.0]], limits)
    assert certified(ExactJerk(), problem) == pytest.approx(4.0, rel=1e-9)


@pytest.mark.parametrize("ratio", [3.0, 10.0])
def test_steps_that_shrink_and_grow_geometrically(ratio):
    sizes = 0.1 / ratio ** np.arange(1, 10)
    steps = np.concatenate([sizes, sizes[::-1]])
    problem = straight((1 - steps.sum()) / 2, steps, 2, 3.0)
    best = end_to_end_bound(problem)
    assert certified(ExactJerk(), problem) == pytest.approx(best, rel=1e-6)


def test_position_limits_and_limits_of_one_side_change_nothing():
    walls = [[0.0, 1.0], [0.0, 0.7]]
    problem = straight(0.5, np.full(3, 1e-7), 2, 1.0, position=walls)
    solution = ExactJerk().solve(problem)
    assert verify(problem, solution.trajectory).certified_duration == pytest.approx(
        end_to_end_bound(problem.without("position")), rel=1e-6
    )
    one_sided = Limits([2.0], [[-1.0, 3.0]], jerk=[[-2.0, 1.0]])
    clear = ExactJerk().solve(Problem([[0.0], [1.0]], one_sided)).trajectory.duration
    dense = Problem([[0.0], [0.5], [0.5 + 1e-6], [0.5 + 2e-6], [1.0]], one_sided)
    assert certified(ExactJerk(), dense) == pytest.approx(clear, rel=1e-6)


@pytest.mark.parametrize("seed", [0, 3, 8])
@pytest.mark.parametrize("spacing", [1e-5, 1e-7])
def test_joints_with_slack_bend_as_waypoints_on_an_optimum_want_it(seed, spacing):
    """Three more waypoints on an arm's own optimum, so many seconds apart."""
    rng = np.random.default_rng(seed)
    joints = 3 + seed % 2
    velocity = rng.uniform(0.5, 2, joints)
    acceleration = velocity * rng.uniform(1, 10, joints)
    limits = Limits(velocity, acceleration, jerk=10 * acceleration)
    clear = Problem(rng.uniform(-2, 2, (3, joints)), limits)
    motion = certificate.certified(clear, ExactJerk().solve(clear).trajectory)
    times = 0.4 * motion.waypoint_times[1] + spacing * np.arange(3)
    dense = Problem(np.insert(clear.waypoints, 1, motion(times), axis=0), limits)
    assert certified(ExactJerk(), dense) == pytest.approx(motion.duration, rel=1e-6)


@pytest.mark.parametrize("stiffness", [None, pytest.param(1.0, marks=pytest.mark.long)])
def test_a_joint_that_moves_in_tiny_steps_alone_rests(stiffness):
    """Its steps are above its rounding, but the waypoint between them may be missed."""
    line = [0.0, 0.5, 0.5 + 1e-6, 0.5 + 2e-6, 1.0]
    points = np.stack([line, 1.0 + np.array([0.0, 0.0, 1e-13, 0.0, 0.0])], axis=1)
    ones = np.ones(2)
    problem = Problem(points, Limits(2 * ones, ones, jerk=stiffness and stiffness * ones))
    assert spared(problem).sum() == 1
    planner = Exact() if stiffness is None else ExactJerk()
    best = end_to_end_bound(problem)
    assert certified(planner, problem) == pytest.approx(best, rel=1e-6)


def around_a_waypoint(seed, spacing, count):
    """An arm's optimal duration, and the problem with points of its motion around a waypoint."""
    rng = np.random.default_rng([41, seed])
    joints, ways = (int(rng.integers(low, high)) for low, high in [(1, 6), (1, 4)])
    waypoints = rng.uniform(-2, 2, (ways + 1, joints))
    velocity = rng.uniform(0.5, 2, joints)
    acceleration = velocity * rng.uniform(1, 10, joints)
    limits = Limits(velocity, acceleration, jerk=acceleration * 10 ** rng.uniform(0, 2))
    clear = Problem(waypoints, limits)
    motion = certificate.certified(clear, ExactJerk().solve(clear).trajectory)
    steps = np.arange(-(count // 2), count - count // 2 + 1)
    points = motion(motion.waypoint_times[1] + spacing * motion.duration * steps)
    points[steps == 0] = waypoints[1]
    dense = Problem(np.concatenate([waypoints[:1], points, waypoints[2:]]), limits)
    return motion.duration, dense


@pytest.mark.long
def test_a_dense_problem_of_the_suites_needs_many_steps_once_waypoints_are_put_back():
    """Once 157 % above its record, as 600 Newton steps did not suffice."""
    problem = load("edges-dense-geometric")
    recorded = records.find(problem).duration
    assert certified(ExactJerk(), problem) == pytest.approx(recorded, rel=1e-6)


@pytest.mark.parametrize(
    ("seed", "spacing", "count"), [(79, 4.2e-6, 2), (99, 1.8e-9, 7), (1, 1.78e-8, 2), (0, 1e-5, 2)]
)
def test_points_around_a_waypoint_of_an_arms_own_optimum(seed, spacing, count):
    """Once 12 %, 5 %, 139 times and 0.001 % above: joints have no slack there, or turn there."""
    best, dense = around_a_waypoint(seed, spacing, count)
    assert certified(ExactJerk(), dense) == pytest.approx(best, rel=1e-6)


@pytest.mark.long
def test_what_stays_beyond_takes_a_bounded_time(monkeypatch):
    """So many Newton steps at most, and no longer than a motion that rests at every waypoint."""
    steps = []

    def counted(*arguments, **keywords):
        found = descended(*arguments, **keywords)
        steps.append(found.steps)
        return found

    monkeypatch.setattr(jerk, "descended", counted)
    _, dense = around_a_waypoint(5, 1.78e-7, 2)
    steps.clear()
    answer = ExactJerk(starts=1).solve(dense)
    assert sum(steps[1:]) <= brief_steps.MAX_ATTEMPTS * MAX_ITERATIONS
    assert verify(dense, answer.trajectory).certified_duration <= 1.05 * stop_times(dense).sum()


def test_the_answer_says_by_how_much_it_is_above_and_why():
    """One joint's waypoint is 5 roundings beside a line: the line misses it by half of that."""
    line = np.array([0.0, 0.5, 0.5 + 1e-6, 0.5 + 2e-6, 1.0])
    points = np.stack([line, line], axis=1)
    problem = Problem(points, Limits([2.0, 2.0], [1.0, 1.0], jerk=[1.0, 1.0]))
    points[2, 1] += 5 * problem.rounding[1]
    problem = replace(problem, waypoints=points)
    straight = ExactJerk().solve(Problem(points[[0, -1]], problem.limits)).trajectory
    halfway = straight.duration / 2

    def known_only_straight(own, _):
        if len(own.waypoints) == 5:
            return Solution(Status.FAILED, message="")
        times = np.array([0.0, halfway, halfway + 2e-6 / straight(halfway, 1)[0], 2 * halfway])
        return Solution(Status.SOLVED, replace(straight, waypoint_times=times))

    answer = brief_steps.solved(problem, problem, known_only_straight, None, jerk._stopping)
    best = end_to_end_bound(problem)
    above = 100 * (1.05 * stop_times(problem).sum() / best - 1)
    assert answer.message == (
        f"{above:.2g} % above {best:.6g} s, the best known without its tiny steps: "
        "that motion misses a waypoint by 2.5 times what rounding allows"
    )
