"""The registered planner: what it answers, what it refuses, and bounds proved again."""

import math
import time

import numpy as np
import pytest

from baselines.lower_bound.planner import Certify
from trajopt import InvalidInput, Limits, Problem
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem
from trajopt.planner import Relation
from trajopt.registry import load as load_planner
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Status

QUICK = Certify(time_limit=10.0)


def test_it_is_the_registered_planner():
    planner = load_planner("certify:family=spline353,joint=2")
    assert planner == Certify(family="spline353", joint=2)


def test_the_trapezoid_has_both_ends():
    solution = QUICK.solve(load("one-joint"))
    # 1.5 rad at most 1 rad/s and 2 rad/s²: 1.5/1 + 1/2
    assert solution.lower_bound <= 2.0
    assert solution.lower_bound == pytest.approx(2.0, rel=2e-4)
    assert solution.trajectory.duration == pytest.approx(2.0, rel=1e-8)
    assert solution.stats["proof"] == "proved"


def test_a_bound_of_splines_is_not_a_bound_of_every_trajectory():
    planner = Certify(family="spline353", within=1e-2, time_limit=20.0)
    # one way with waypoints on it: the trapezoid of 1.5/1 + 1/2 s passes them, a 3-5-3 is slower
    problem = Problem([[0.0], [0.4], [1.0], [1.5]], Limits([1.0], [2.0]))
    solution = planner.solve(problem)
    bound = solution.stats["lower_bound"]
    assert planner.relation(problem) is Relation.RESTRICTION
    assert solution.lower_bound is None
    assert bound > 2.0
    assert planner.recheck_bound(problem, bound) is True
    assert QUICK.recheck_bound(problem, bound) is False


def test_a_joint_alone_bounds_the_whole_and_has_no_trajectory_of_it():
    problem = Problem([[0, 0], [1.5, 1.5]], Limits([1, 3], [2, 9]))
    planner = Certify(joint=2)
    solution = planner.solve(problem)
    alone = 1.5 / 3 + 3 / 9  # its own trapezoid; joint 1 takes 2 s
    assert planner.relation(problem) is Relation.RELAXATION
    assert solution.status is Status.INVALID
    assert solution.trajectory is None
    assert solution.lower_bound == pytest.approx(alone, rel=2e-4)
    assert "of joint 2 alone" in solution.message


@pytest.mark.parametrize(
    ("planner", "word"),
    [
        (Certify(family="spline353"), "4 waypoints"),
        (Certify(joint=9), "from 1 to"),
        (Certify(joint=2), "moves"),
    ],
)
def test_what_it_cannot_answer_is_refused_with_the_reason(planner, word):
    problem = Problem([[0, 5], [1.5, 5]], Limits([1, 1], [2, 2]))
    assert word in planner.unsupported(problem)
    solution = planner.solve(problem)
    assert solution.status is Status.UNSUPPORTED
    assert word in solution.message


# --- bounds proved again ---


@pytest.mark.parametrize(
    ("bound", "verdict"),
    [(0.5, True), (1.999, True), (2.0 * (1 - 1e-6), True), (2.001, False), (1e9, False)],
)
def test_the_trapezoid_decides(bound, verdict):
    assert QUICK.recheck_bound(load("one-joint"), bound) is verdict


def test_every_bound_that_was_proved_is_proved_again():
    for name in ("asymmetric", "reversal"):
        problem = load(name)
        bound = QUICK.solve(problem).lower_bound
        assert QUICK.recheck_bound(problem, bound) is True
        assert QUICK.recheck_bound(problem, bound * 1.001) is False


@pytest.mark.parametrize("seed", range(4))
def test_random_problems_are_proved_again_or_left_open(seed):
    problem = random_problem(seed, waypoints=4, joints=2)
    planner = Certify(within=1e-3, time_limit=5.0)
    solution = planner.solve(problem)
    verdict = planner.recheck_bound(problem, solution.lower_bound)
    assert verdict is not False
    assert verdict is True or solution.stats["proof"] != "proved"
    assert planner.recheck_bound(problem, solution.trajectory.duration * 1.01) is False


def test_what_rests_on_a_lifted_limit_stays_open_until_stopping_is_faster():
    problem = load("jerk-limit")
    relaxed = Certify().solve(problem.without("jerk")).trajectory.duration
    assert QUICK.recheck_bound(problem, relaxed * 0.999) is True
    assert QUICK.recheck_bound(problem, relaxed * 1.01) is None
    assert QUICK.recheck_bound(problem, stop_times(problem).sum() * 1.01) is False


def test_a_bound_that_is_no_number_is_refused():
    with pytest.raises(InvalidInput, match="lower_bound"):
        QUICK.recheck_bound(load("one-joint"), math.nan)


# --- sizes ---


@pytest.mark.parametrize(("waypoints", "joints"), [(1000, 7), (4, 1000)])
def test_the_time_limit_covers_building_the_model(waypoints, joints):
    rng = np.random.default_rng(0)
    steps = rng.uniform(-1, 1, (waypoints, joints))
    problem = Problem(np.cumsum(steps, axis=0), Limits(np.ones(joints), np.full(joints, 2.0)))
    began = time.perf_counter()
    solution = Certify(time_limit=5.0).solve(problem)
    assert time.perf_counter() - began < 5.0
    assert "a proof can begin" in solution.message
    # no segment is faster than its longest way at top speed, and the ends take half a ramp more
    at_top_speed = np.abs(problem.displacements).max(axis=1).sum()
    assert at_top_speed < solution.lower_bound < stop_times(problem).sum()
