"""Examples of formats: robots, waypoints and motions from files of other programs."""

from __future__ import annotations

import pytest

from trajopt.core.exceptions import InvalidInput
from trajopt.formats import arms, joint_limits, samples_csv, waypoints
from trajopt.formats.motion import motion

LIMITS = """
joint_limits:
  elbow_joint:
    has_velocity_limits: true
    max_velocity: 1.5
"""
WAYPOINTS = """elbow_joint [deg], wrist_3_joint [deg]
0, 0
90, -45
"""
SAMPLES = """time [s],elbow_joint [rad],elbow_joint [rad/s]
0,0,0
1,0.5,1
2,1,0
"""


def written(tmp_path, name, content):
    path = tmp_path / name
    path.write_text(content, encoding="utf-8")
    return path


def test_a_file_of_limits_replaces_those_of_the_robot(tmp_path):
    robot = arms.named("ur5e")
    own = joint_limits.read(written(tmp_path, "joint_limits.yaml", LIMITS))
    limits = robot.updated(own).limits(["elbow_joint"])
    assert limits.velocity.tolist() == [[-1.5, 1.5]]


def test_waypoints_of_some_joints_make_a_problem(tmp_path):
    path = written(tmp_path, "waypoints.csv", WAYPOINTS)
    problem = waypoints.problem(path, arms.named("ur5e"))
    assert problem.joint_names == ("elbow_joint", "wrist_3_joint")
    assert problem.waypoints[1, 0] == pytest.approx(1.5708, abs=1e-4)


def test_samples_are_joined_as_a_controller_does(tmp_path):
    path = written(tmp_path, "motion.csv", SAMPLES)
    executed = motion(path)
    assert executed.interpolation == "cubic"
    assert executed.trajectory(1.0).tolist() == [0.5]
    assert samples_csv.read(path).joint_names == ("elbow_joint",)


def test_an_error_names_the_file_the_line_and_the_column(tmp_path):
    path = written(tmp_path, "motion.csv", SAMPLES.replace("0.5", "half"))
    with pytest.raises(InvalidInput, match=r"motion\.csv: line 3, column 2, elbow_joint \[rad\]"):
        motion(path)
