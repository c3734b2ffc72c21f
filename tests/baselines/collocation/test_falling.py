"""Falling velocity limits in both transcriptions, against closed forms and dense samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from baselines.collocation.refined import CollocationRefined
from baselines.collocation.uniform import Collocation
from baselines.exact.acceleration.planner import Exact
from trajopt import Limits, Problem, Status, verify
from trajopt.best_planner import best

# Joint 1 of the Franka FR3: nothing is allowed in the last 7.5 mrad.
V, A, OFFSET, DEC, END = 2.62, 10.0, 0.3, 6.0, 2.7501
FALLING = {"offset": [OFFSET], "deceleration": [DEC], "position": [[-END, END]]}
ERROR = 1e-4


def one_joint(*waypoints, **limits):
    limits = {"velocity": [V], "acceleration": [A], "falling_velocity": FALLING, **limits}
    return Problem([[q] for q in waypoints], Limits(**limits))


def to_rest_near_the_end(goal: float) -> float:
    """Return the least time from rest at 0 to rest near the end, s.

    Full acceleration, full velocity, the parabola, full braking. On the parabola
    `dv/dt = -DEC v / (v + OFFSET)`, and `w = (v + OFFSET)² / (2 DEC)`.
    """
    near = END - goal
    last = brentq(lambda v: (v + OFFSET) ** 2 / (2 * DEC) - v**2 / (2 * A) - near, 1e-9, V)
    arc = (V - last) / DEC + OFFSET / DEC * np.log(V / last)
    cruise = (END - (V + OFFSET) ** 2 / (2 * DEC) - V**2 / (2 * A)) / V
    return float(V / A + cruise + arc + last / A)


def duration(problem: Problem) -> float:
    solution = CollocationRefined(starts=2).solve(problem)
    assert solution.status is Status.SOLVED, solution.message
    certificate = verify(problem, solution.trajectory)
    assert certificate.feasible, certificate.flaws
    return certificate.certified_duration


@pytest.mark.parametrize("goal", [2.45, 2.7, -2.7])
def test_it_follows_the_parabola_to_rest_near_the_end(goal):
    optimum = to_rest_near_the_end(abs(goal))
    assert optimum * (1 - 1e-9) <= duration(one_joint(0.0, goal)) <= optimum * (1 + 2 * ERROR)


def test_a_wide_jerk_limit_costs_little():
    jerky = duration(one_joint(0.0, 2.7, jerk=[5000.0]))
    assert to_rest_near_the_end(2.7) < jerky < to_rest_near_the_end(2.7) * 1.003


def test_an_end_that_is_left_costs_nothing():
    inside = one_joint(END - 0.003, 0.5, 1.5)  # begins in the last 7.5 mrad
    free = Exact().solve(inside.without("falling_velocity")).trajectory.duration
    assert duration(inside) == pytest.approx(free, rel=ERROR)
    assert duration(one_joint(END - 0.003, 0.5, 1.5, jerk=[5000.0])) < free * 1.01


def test_fast_leaving_near_the_end_is_no_breach():
    """At −V the square of `v + o` is larger than at 0: only motion towards the end counts."""
    leaving = one_joint(2.6, 0.0)
    free = Exact().solve(leaving.without("falling_velocity")).trajectory.duration
    assert duration(leaving) == pytest.approx(free, rel=ERROR)


def test_equal_intervals_keep_it_too():
    problem = one_joint(0.0, 2.7)
    found = Collocation(intervals=30).solve(problem)
    certificate = verify(problem, found.trajectory)
    assert certificate.feasible
    optimum = to_rest_near_the_end(2.7)
    assert optimum < certificate.certified_duration < optimum * 1.03


@pytest.mark.parametrize("jerk", [None, 200.0])
def test_random_problems_keep_it_at_dense_samples(jerk):
    rng = np.random.default_rng(5)
    for _ in range(3):
        low, high = np.array([-2.0, -1.0]), np.array([2.0, 1.5])
        o, d = rng.uniform(0, 0.4, 2), rng.uniform(1, 12, 2)
        near = o**2 / (2 * d) + 2e-3
        waypoints = rng.uniform(low + near, high - near, (3, 2))
        law = {"offset": o, "deceleration": d, "position": np.column_stack([low, high])}
        limits = Limits([3.0, 3.0], [8.0, 8.0], jerk and [jerk] * 2, falling_velocity=law)
        problem = Problem(waypoints, limits)
        motion = Collocation(intervals=8).solve(problem).trajectory
        t = np.linspace(0, motion.duration, 20_001)
        q, v = motion(t), motion(t, 1)
        assert (v <= np.maximum(0, np.sqrt(2 * d * (high - q)) - o) + 1e-7).all()
        assert (-v <= np.maximum(0, np.sqrt(2 * d * (q - low)) - o) + 1e-7).all()
        free = Exact().solve(problem.without("jerk", "falling_velocity")).trajectory.duration
        assert motion.duration >= free * (1 - 1e-6)


@pytest.mark.parametrize("waypoints", [(0.0, 2.7475), (0.0, 1.0, -2.7475, 0.0)])
def test_a_waypoint_where_no_motion_arrives_is_proved_infeasible(waypoints):
    problem = one_joint(*waypoints)
    for planner in (CollocationRefined(), Collocation()):
        found = planner.solve(problem)
        assert found.status is Status.INFEASIBLE
        place = 1 + np.abs(waypoints).argmax()
        assert f"waypoint {place} of joint 1" in found.message
        assert "in the last 0.0075 rad" in found.message
    assert best(problem, 0).trial.status is Status.INFEASIBLE
    assert Exact().solve(problem).status is Status.RELAXED


def test_the_best_planner_keeps_it():
    problem = one_joint(0.0, 2.7)
    found = best(problem, 0)
    assert found.trial.planner == "collocation-refined"
    assert found.trial.feasible
    assert found.left_out == ()
    # the lower bound that `exact` is
    assert found.relaxed == pytest.approx(V / A + 2.7 / V, rel=1e-9)
    joint = replace(problem, limits=problem.limits.without("falling_velocity"))
    assert best(joint, 0).trial.planner == "exact"


def test_a_joint_that_leaves_may_turn_before_the_next_waypoint():
    """Its limit counts as soon as it has left: the way back is not forbidden."""
    problem = one_joint(END - 0.003, 2.5, 2.6)
    turning = duration(problem)
    rests = duration(one_joint(END - 0.003, 2.5)) + duration(one_joint(2.5, 2.6))
    assert turning <= rests * (1 + 1e-6)
