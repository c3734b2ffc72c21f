"""What `baselines.exact` is for: minimum times through waypoints, without discretisation."""

from __future__ import annotations

import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from trajopt import Limits, Problem, verify

WAYPOINTS = [[0.0], [0.4], [1.5]]


def test_the_minimum_time_under_velocity_and_acceleration_limits() -> None:
    problem = Problem(WAYPOINTS, Limits([1.0], [2.0]))
    trajectory = Exact().solve(problem).trajectory
    assert trajectory is not None
    # h/V + V/A
    assert trajectory.duration == pytest.approx(1.5 + 1 / 2, rel=1e-9)


def test_the_minimum_time_under_a_jerk_limit_too() -> None:
    problem = Problem(WAYPOINTS, Limits([1.0], [2.0], [5.0]))
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    # h/V + V/A + A/J
    assert trajectory.duration == pytest.approx(1.5 + 1 / 2 + 2 / 5, rel=1e-9)


def test_the_motion_keeps_every_limit_without_repair() -> None:
    problem = Problem(WAYPOINTS, Limits([1.0], [2.0], [5.0]))
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert verify(problem, trajectory).dilation <= 1 + 1e-10


def test_ipopt_finds_the_same_optimum_by_another_program() -> None:
    problem = Problem(WAYPOINTS, Limits([1.0], [2.0]))
    own = Exact().solve(problem).trajectory
    checked = Exact(solver="ipopt").solve(problem).trajectory
    assert own is not None
    assert checked is not None
    assert checked.duration == pytest.approx(own.duration, rel=1e-8)
