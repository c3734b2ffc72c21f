"""Files of robots in the shapes that MoveIt and xacro write, and what must be read of them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trajopt import cli
from trajopt.core.exceptions import InvalidInput
from trajopt.formats import joint_limits, urdf

OWN = "j1: {has_velocity_limits: true, max_velocity: 2.0, max_acceleration: 4.0}"
SCALED = f"""
default_velocity_scaling_factor: 0.1
default_acceleration_scaling_factor: 0.5
joint_limits:
  {OWN}
"""
WRAPPED = {
    "MoveIt's node": "move_group:\n  ros__parameters:\n    robot_description_planning:\n",
    "any node": "/**:\n  ros__parameters:\n    robot_description_planning:\n",
    "a node in a namespace": "/arm:\n  servo_node:\n    ros__parameters:\n",
    "a launch file's table": "robot_description_planning:\n",
    "the file alone": "",
}
# xacro copies comments, and the user's file may hold what only a simulator or a viewer needs.
URDF = """<?xml version="1.0" ?>
<!-- generated from arm.xacro: <xacro:include filename="x"/> <xacro:arm prefix="${prefix}"/> -->
<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <material name="grey"><texture filename="package://none/x.png"/></material>
  <link name="base"><visual><geometry><mesh filename="none.dae" scale="bad"/></geometry></visual>
  </link><link name="l1"/><link name="l2"/><link name="l3"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2.0" effort="10"/>
    <safety_controller soft_lower_limit="-2" soft_upper_limit="2.5" k_velocity="1"/></joint>
  <joint name="locked" type="revolute"><parent link="l1"/><child link="l2"/>
    <limit lower="0" upper="0" velocity="1" effort="1"/></joint>
  <joint name="free" type="continuous"><parent link="l2"/><child link="l3"/></joint>
  <transmission name="t" type="SimpleTransmission"><actuator name="m"/><joint name="j1"/>
    <mechanicalReduction>bad</mechanicalReduction></transmission>
</robot>
"""


def test_scaling_factors_are_no_limits_of_the_robot(tmp_path):
    (tmp_path / "l.yaml").write_text(SCALED, encoding="utf-8")
    robot = joint_limits.read(tmp_path / "l.yaml")
    assert robot.limits(["j1"]).velocity.tolist() == [[-2, 2]]
    assert robot.scaled().limits(["j1"]).velocity.tolist() == [[-0.2, 0.2]]
    assert robot.scaled().limits(["j1"]).acceleration.tolist() == [[-2, 2]]


@pytest.mark.parametrize("head", WRAPPED.values(), ids=WRAPPED)
def test_limits_within_the_names_of_nodes(tmp_path, head):
    indent = "  " * head.count("\n")
    text = f"{head}{indent}joint_limits:\n{indent}  {OWN}\n"
    (tmp_path / "l.yaml").write_text(text, encoding="utf-8")
    robot = joint_limits.read(tmp_path / "l.yaml")
    assert robot.limits(["j1"]).acceleration.tolist() == [[-4, 4]]


def test_only_the_joints_that_are_named_must_be_sound(tmp_path):
    (tmp_path / "r.urdf").write_text(URDF, encoding="utf-8")
    robot = urdf.read(tmp_path / "r.urdf").with_acceleration(4)
    assert robot.joint_names == ("j1", "locked", "free")
    limits = robot.limits(["j1"])
    assert limits.velocity.tolist() == [[-2, 2]]
    assert limits.position.tolist() == [[-2, 2.5]]  # the soft limits, within the hard ones
    with pytest.raises(InvalidInput, match=r"r\.urdf: locked: limit is \[0\.0, 0\.0\]: expected"):
        robot.limits(["j1", "locked"])


@pytest.mark.parametrize(
    ("limits", "share"),
    [
        ("--limits scaled.yaml", 1.5),
        ("--urdf r.urdf --limits scaled.yaml", 1.5),
        ("--urdf r.urdf --acceleration 4", 1.5),
        ("--limits velocity.yaml --acceleration 2", 3.0),
    ],
)
def test_a_motion_is_verified_by_the_limits_themselves(
    tmp_path, monkeypatch, capsys, limits, share
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "scaled.yaml").write_text(SCALED, encoding="utf-8")
    (tmp_path / "velocity.yaml").write_text("joint_limits: {j1: {max_velocity: 2}}")
    (tmp_path / "m.csv").write_text("time [s],j1 [rad],j1 [rad/s]\n0,0,0\n1,1,0\n")
    with pytest.raises(SystemExit):
        cli.main(["verify", "m.csv", *limits.split(), "--json"])
    out, _ = capsys.readouterr()
    # A cubic of 1 rad in 1 s has 6 rad/s² at both ends, over the limit.
    assert json.loads(out)["dilation"] == pytest.approx(np.sqrt(share))


@pytest.mark.parametrize(
    ("limits", "dilation", "flaw"),
    [
        ("--limits velocity.yaml", 0.75, ""),
        ("--limits slow.yaml", 1.5, ""),
        ("--limits brisk.yaml", 1.0, ""),
        ("--limits jerk.yaml", 2.0, ""),
        ("--urdf r.urdf", 0.75, ""),
        ("--urdf r.urdf --limits narrow.yaml", 0.75, "leaves its position limits by 0.1 rad"),
    ],
)
def test_without_accelerations_velocities_alone_are_judged(
    tmp_path, monkeypatch, capsys, limits, dilation, flaw
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.urdf").write_text(URDF, encoding="utf-8")
    for name, own in {
        "velocity": "max_velocity: 2",
        "slow": "max_velocity: 1",
        "brisk": "max_velocity: 1.5",
        "jerk": "max_velocity: 2, max_jerk: 1.5",
        "narrow": "max_position: 0.9",
    }.items():
        (tmp_path / f"{name}.yaml").write_text(f"joint_limits: {{j1: {{{own}}}}}")
    # q = 3 t² - 2 t³: at most 1.5 rad/s, in the middle; the jerk is 12 rad/s³ everywhere.
    (tmp_path / "m.csv").write_text("time [s],j1 [rad],j1 [rad/s]\n0,0,0\n1,1,0\n")
    with pytest.raises(SystemExit) as ended:
        cli.main(["verify", "m.csv", *limits.split(), "--json"])
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert ended.value.code == (dilation > 1 or bool(flaw))
    assert found["feasible"] is (dilation <= 1 and not flaw)
    assert found["dilation"] == pytest.approx(dilation, rel=1e-9)
    assert found["certificate"]["acceleration"] is None
    assert "accelerations are not judged; --acceleration 2.0" in " ".join(err.split())
    with pytest.raises(SystemExit):
        cli.main(["verify", "m.csv", *limits.split()])
    out = " ".join(capsys.readouterr().out.split())
    assert "accelerations not judged" in out
    assert flaw in out
    assert "acceleration 0" not in out


def test_a_joint_without_an_acceleration_limit_does_not_stop_the_others(
    tmp_path, monkeypatch, capsys
):
    """FT4-21. Cubics of 1 rad in 1 s: 1.5 rad/s, 6 rad/s²."""
    monkeypatch.chdir(tmp_path)
    text = "joint_limits: {a: {max_velocity: 2, max_acceleration: 4}, b: {max_velocity: 1, "
    (tmp_path / "l.yaml").write_text(text + "has_acceleration_limits: false}}")
    header = "time [s],a [rad],b [rad],a [rad/s],b [rad/s]"
    (tmp_path / "m.csv").write_text(f"{header}\n0,0,0,0,0\n1,1,1,0,0\n")
    with pytest.raises(SystemExit) as ended:
        cli.main(["verify", "m.csv", "--limits", "l.yaml", "--json"])
    out, err = capsys.readouterr()
    found = json.loads(out)["certificate"]
    assert ended.value.code == 1
    assert found["acceleration"]["ratio"] == pytest.approx(1.5)
    assert found["acceleration"]["joint"] == 1
    assert found["velocity"]["ratio"] == pytest.approx(1.5)
    assert found["velocity"]["joint"] == 2
    assert "no acceleration limits, so accelerations of b are not judged" in " ".join(err.split())
