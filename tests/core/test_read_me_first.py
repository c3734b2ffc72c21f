"""Examples of core: a problem, a trajectory, and errors that help."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

WAYPOINTS = [[0.0, 0.0], [1.0, -0.5]]
LIMITS = Limits(
    velocity=[2.0, 2.0],  # rad/s, one number per joint
    acceleration=[4.0, [-3.0, 4.0]],  # rad/s², or a [low, high] pair
)


def test_a_problem_is_waypoints_within_limits():
    problem = Problem(WAYPOINTS, LIMITS)
    assert problem.joints == 2
    assert problem.segments == 1
    assert problem.has("velocity")
    assert not problem.has("jerk")


def test_a_problem_goes_to_a_file_and_back(tmp_path):
    problem = Problem(WAYPOINTS, LIMITS, name="example")
    file = tmp_path / "example.toml"
    file.write_text(problem.to_toml(), encoding="utf-8")
    back = Problem.from_toml(file)
    assert back.name == "example"
    assert back.digest() == problem.digest()


def test_an_error_names_the_key_the_joint_and_the_value():
    message = r"limits\.velocity, joint 2 is -1\.0: expected a positive number"
    with pytest.raises(InvalidInput, match=message):
        Limits([1.0, -1.0], [1.0, 1.0])


def test_a_trajectory_is_a_polynomial_of_time_on_each_piece():
    """One joint moves by `t²` for 1 s, then at 2 rad/s for 1 s."""
    coefficients = np.zeros((3, 2, 1))
    coefficients[:, 0, 0] = [1.0, 0.0, 0.0]
    coefficients[:, 1, 0] = [0.0, 2.0, 1.0]
    trajectory = Trajectory([0.0, 1.0, 2.0], coefficients, [0.0, 2.0])
    assert trajectory.duration == 2.0
    assert trajectory(0.5).tolist() == [0.25]
    assert trajectory(1.5, order=1).tolist() == [2.0]
    slower = trajectory.dilated(2.0)
    assert slower(2.0, order=1).tolist() == [1.0]
