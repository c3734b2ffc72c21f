"""Waypoints from files of every kind, under the limits of robots of every kind."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest

from trajopt.core.exceptions import InvalidInput, UnitWarning, UnknownName
from trajopt.core.problem import Problem
from trajopt.formats import arms, urdf, waypoints
from trajopt.formats.robot_limits import RobotLimits

TWO = RobotLimits(
    joints={
        "one": {"velocity": (-1, 1), "acceleration": (-2, 2), "position": (-3, 3)},
        "two": {"velocity": (-4, 4), "acceleration": (-5, 5)},
    },
    source="two",
)
ROWS = [[0.0, 0.0], [1.0, -0.5], [0.25, 2.0]]


def written(tmp_path, name, content):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "0,0\n1,-0.5\n0.25,2\n"),
        ("a.csv", "\ufeffone,two\r\n0,0\r\n1,-0.5\r\n0.25,2"),
        ("a.csv", "# poses\none [rad]; two [rad]\n\n0;0\n1;-.5\n2.5e-1;2\n"),
        ("a.txt", "one\ttwo\n0\t0\n1\t-0.5\n0.25\t2\n"),
        ("a.txt", "0 0\n1   -0.5\n0.25 2\n"),
        ("a.json", json.dumps(ROWS)),
        ("a.json", json.dumps({"waypoints": ROWS, "unit": "rad", "joint_names": ["one", "two"]})),
    ],
)
def test_rows_of_every_kind_of_file(tmp_path, name, text):
    problem = waypoints.problem(written(tmp_path, name, text), TWO)
    assert problem.waypoints.tolist() == ROWS
    assert problem.joint_names == ("one", "two")
    assert problem.name == "a"
    assert problem.limits.velocity.tolist() == [[-1, 1], [-4, 4]]


def test_numpy(tmp_path):
    values = np.array(ROWS, dtype=np.float32)
    np.save(tmp_path / "a.npy", values)
    found = waypoints.problem(tmp_path / "a.npy", TWO).waypoints.tolist()
    assert found == ROWS
    np.save(tmp_path / "b.npy", np.array([None]), allow_pickle=True)
    with pytest.raises(InvalidInput, match="a readable"):
        waypoints.problem(tmp_path / "b.npy", TWO)
    np.save(tmp_path / "c.npy", np.zeros(3))
    with pytest.raises(InvalidInput, match=r"\(waypoints, joints\)"):
        waypoints.problem(tmp_path / "c.npy", TWO)


def test_names_choose_the_joints_and_their_order(tmp_path):
    path = written(tmp_path, "a.csv", "two [deg], one [°]\n0, 0\n90, 45\n")
    problem = waypoints.problem(path, TWO)
    assert problem.joint_names == ("two", "one")
    assert np.allclose(problem.waypoints[1], [np.pi / 2, np.pi / 4])
    found = problem.limits.acceleration[:, 1].tolist()
    assert found == [5, 2]
    only = waypoints.problem(written(tmp_path, "b.csv", "two\n0\n1\n"), TWO)
    assert only.joints == 1


def test_degrees_by_flag_and_a_prismatic_joint_in_metres(tmp_path):
    path = written(tmp_path, "a.csv", "one,two\n0,0\n90,45\n")
    problem = waypoints.problem(path, TWO, "deg")
    assert np.allclose(problem.waypoints[1], np.deg2rad([90, 45]))
    mixed = written(tmp_path, "b.csv", "one [m],two [deg]\n0,0\n1,90\n")
    assert np.allclose(waypoints.problem(mixed, TWO).waypoints[1], [1, np.pi / 2])


def test_degrees_taken_for_radians_are_warned_of(tmp_path):
    robot = arms.named("ur5e")
    path = written(tmp_path, "a.csv", "0,0,0,0,0,0\n90,0,0,0,0,0\n")
    said = pytest.warns(UnitWarning, match=r"a\.csv: .*degrees beside radians; say unit=deg")
    with said, pytest.raises(InvalidInput, match=r"inside limits\.position"):
        waypoints.problem(path, robot)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        waypoints.problem(path, robot, "deg")


def test_degrees_in_dense_samples_are_warned_of(tmp_path):
    rows = "\n".join(f"{angle},0" for angle in range(0, 40, 2))  # 2 s for a segment at 1 per s
    robot = RobotLimits(dict.fromkeys(("a", "b"), CELL.joints["rail"]), "cell.urdf")
    robot = RobotLimits({n: b | {"position": (-99, 99)} for n, b in robot.joints.items()}, "r")
    with pytest.warns(UnitWarning, match="degrees beside radians"):
        waypoints.problem(written(tmp_path, "a.csv", f"a,b\n{rows}\n"), robot)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "", ["lines of numbers; there are none"]),
        ("a.csv", "one,two\n", ["at least two rows"]),
        ("a.csv", "0,0\n1,x\n", ["line 2, column 2 is 'x'"]),
        ("a.csv", "0,0\n1,nan\n", ["line 2, column 2 is 'nan'"]),
        ("a.csv", "0,0\n1\n", ["line 2 is 1: expected 2 cells"]),
        ("a.csv", "one,two\n0,0\n1\n", ["line 3 is 1: expected 2 cells"]),
        ("a.csv", "one,two\n0,0\n4,1\n", ["waypoint 2, joint 1 is 4.0", "[-3, 3]"]),
        ("a.csv", "0,0\n0,0\n", ["never move"]),
        ("a.csv", "0,0,0\n1,1,1\n", ["columns is 3", "one, two"]),
        ("a.csv", "one,tow\n0,0\n1,1\n", ["joint is 'tow'", "perhaps two"]),
        ("a.csv", "one,one\n0,0\n1,1\n", ["names that differ"]),
        ("a.csv", "one,\n0,0\n1,1\n", ["column 2", "the name of a joint"]),
        ("a.csv", "time [s],one [rad]\n0,0\n1,1\n", ["without times", "trajopt judge"]),
        ("a.csv", "one [turn],two [turn]\n0,0\n1,1\n", ["unit, joint 1 is 'turn'"]),
        ("a.csv", "0;0\n1,5,0;2\n", ["line 2, column 1 is '1.5.0'"]),
        ("a.csv", b"\xff\x00o\x00", ["a readable .csv file", "save it as UTF-8"]),
        ("a.json", "{", ["a readable JSON file"]),
        ("a.json", "[[0, 0], [1, null]]", ["waypoint 2, joint 2"]),
        ("a.json", '{"points": []}', ["points is []: expected the key waypoints"]),
        ("a.json", "[" * 100_000, ["a readable JSON file"]),
        ("a.xml", "", ["a file ending in .csv, .txt, .npy, .json"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path, name, text, words):
    path = written(tmp_path, name, text)
    with pytest.raises(InvalidInput) as caught:
        waypoints.problem(path, TWO)
    for word in [str(path), *words]:
        assert word in str(caught.value)


def test_a_unit_said_twice_must_be_the_same(tmp_path):
    path = written(tmp_path, "a.csv", "one [deg],two [deg]\n0,0\n1,1\n")
    problem = waypoints.problem(path, TWO, "deg")
    assert problem.waypoints[1, 0] == pytest.approx(np.pi / 180)
    with pytest.raises(InvalidInput, match="unit= is 'rad'"):
        waypoints.problem(path, TWO, "rad")


def test_every_built_in_arm_has_names_and_limits():
    for name in ("ur5e", "franka-fr3", "puma-560"):
        robot = arms.named(name)
        limits = robot.limits(robot.joint_names)
        assert limits.joints == len(robot.joint_names)
        assert robot.ordered
    with pytest.raises(UnknownName, match="did you mean 'ur5e'"):
        arms.named("ur5")


# --- URDF ---

URDF = """<?xml version="1.0"?>
<robot name="r">
  <link name="l0"/><link name="l1"><visual><geometry>
    <mesh filename="package://x/y.stl"/></geometry></visual></link>
  <link name="l2"/><link name="l3"/><link name="l4"/><link name="l5"/>
  <joint name="one" type="revolute"><parent link="l0"/><child link="l1"/>
    <limit lower="-1" upper="2" velocity="3" effort="1"/>
    <safety_controller k_velocity="1" soft_lower_limit="-0.5" soft_upper_limit="9"/></joint>
  <joint name="turning" type="continuous"><parent link="l1"/><child link="l2"/>
    <limit velocity="4" effort="1"/></joint>
  <joint name="mount" type="fixed"><parent link="l2"/><child link="l3"/></joint>
  <joint name="sliding" type="prismatic"><parent link="l3"/><child link="l4"/>
    <limit lower="0" upper="0.2" velocity="0" effort="1"/></joint>
  <joint name="finger" type="prismatic"><parent link="l4"/><child link="l5"/>
    <mimic joint="sliding"/><limit lower="0" upper="0.2" velocity="1" effort="1"/></joint>
  <gazebo/><ros2_control name="x" type="system"/>
</robot>
"""


FRANKA = '<position_based_velocity_limits velocity_offset="0.3" deceleration_limit="6.0"/>'


def test_a_urdf_has_names_positions_and_velocities(tmp_path, capsys):
    robot = urdf.read(written(tmp_path, "r.urdf", URDF))
    assert robot.joint_names == ("one", "turning", "sliding")
    assert robot.joints["one"] == {"velocity": (-3, 3), "position": (-0.5, 2)}
    expected = {"velocity": (-4, 4), "position": (-np.inf, np.inf)}
    assert robot.joints["turning"] == expected
    assert robot.joints["sliding"] == {"position": (0, 0.2)}
    with pytest.raises(InvalidInput, match=r"this URDF has none.*max_acceleration"):
        robot.limits(["one"])
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot", "expected a URDF"),
        ("<sdf/>", "expected a URDF, whose first tag is robot"),
        ('<!DOCTYPE robot [<!ENTITY a "b">]><robot/>', "a URDF without entities"),
        ('<robot name="r"/>', "at least one joint that moves"),
        (URDF.replace('velocity="4"', 'velocity="fast"'), "turning: limit velocity is 'fast'"),
        (URDF.replace('velocity="4"', 'velocity="-4"'), "turning: limit velocity is -4.0"),
        (URDF.replace('lower="-1" upper="2"', 'lower="3" upper="2"'), "one: limit is [3.0, 2.0]"),
        (URDF.replace("turning", "one"), "names that differ"),
        (URDF.replace("<gazebo/>", "<xacro:arm/>"), "make one: xacro r.urdf > robot.urdf"),
        (URDF.replace("<gazebo/>", '<x:arm xmlns:x="http://ros.org/wiki/xacro"/>'), "make one"),
        (URDF.replace("</joint>", FRANKA.replace("6.0", "0") + "</joint>", 1), "one: decel"),
        (URDF.replace('<limit velocity="4" effort="1"/>', FRANKA), "turning: position_based"),
        (URDF.replace("lower=", "lowr="), "one: limit lowr is '-1': expected the key lower"),
        (URDF.replace("soft_lower", "sof_lower"), "expected the key soft_lower_limit"),
        (URDF.replace("<limit", "<limits"), "one: limits: expected the key limit"),
        (URDF.replace("</joint>", '<limit velocity="9"/></joint>', 1), "one: limit: expected this"),
    ],
)
def test_what_is_wrong_with_a_urdf_is_named(tmp_path, text, words):
    path = written(tmp_path, "r.urdf", text)
    with pytest.raises(InvalidInput) as caught:
        urdf.read(path).limits(["one", "turning"])
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    with pytest.raises(InvalidInput, match="does not exist"):
        urdf.read(tmp_path / "absent.urdf")


def test_only_the_joints_that_waypoints_name_must_be_sound(tmp_path):
    text = URDF.replace('velocity="4"', 'velocity="fast"').replace(
        "<gazebo/>", "<!-- <xacro:arm/> --><transmission name='t'><type/></transmission>"
    )
    robot = urdf.read(written(tmp_path, "r.urdf", text))
    assert robot.joint_names == ("one", "turning", "sliding")
    own = RobotLimits({"one": {"acceleration": (-1, 1)}}, source="own")
    found = robot.updated(own).limits(["one"]).velocity.tolist()
    assert found == [[-3, 3]]


def test_a_urdf_s_falling_velocity_limit_belongs_to_its_range_not_to_soft_limits(tmp_path):
    path = written(tmp_path, "r.urdf", URDF.replace("</joint>", FRANKA + "</joint>", 1))
    robot = urdf.read(path)
    assert robot.joints["one"]["position"] == (-0.5, 2)
    whole = robot.with_acceleration(1.0)
    numbers = whole.limits(["turning", "one"]).kinds["falling_velocity"].numbers
    assert numbers[1].tolist() == [0.3, 6.0, -1.0, 2.0]
    assert np.isnan(numbers[0]).all()
    assert "falling_velocity" not in whole.limits(["turning"]).kinds


# --- metres are no degrees ---

CELL = RobotLimits(
    joints={
        "rail": {"velocity": (-1, 1), "acceleration": (-2, 2), "position": (0, 0.5)},
        "elbow": {"velocity": (-4, 4), "acceleration": (-5, 5)},
    },
    source="cell.urdf",
    units={"rail": "m", "elbow": "rad"},
)


@pytest.mark.parametrize(
    ("name", "text", "unit"),
    [
        ("a.csv", "rail,elbow\n0,0\n0.2,90\n", "deg"),
        ("a.csv", "rail [m],elbow [deg]\n0,0\n0.2,90\n", None),
        ("a.csv", "rail [mm],elbow [deg]\n0,0\n200,90\n", "deg"),
        ("a.json", '{"waypoints": [[0, 0], [0.2, 90]], "unit": "deg"}', None),
        ("a.json", '{"waypoints": [[0, 0], [200, 90]], "unit": ["mm", "deg"]}', None),
    ],
)
def test_a_rail_is_in_metres_whatever_the_unit_of_angles(tmp_path, name, text, unit):
    problem = waypoints.problem(written(tmp_path, name, text), CELL, unit)
    assert np.allclose(problem.waypoints[1], [0.2, np.pi / 2], rtol=1e-15)
    assert problem.joint_units == ("m", "rad")
    assert problem.unit(0, 2) == "m/s²"
    assert problem.only([1]).joint_units == ("rad",)
    back = Problem.from_toml(written(tmp_path, "back.toml", problem.to_toml()))
    assert back.digest() == problem.digest()
    assert back.joint_units == problem.joint_units


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rail [deg],elbow [deg]\n0,0\n1,1\n", ["joint 1 is 'deg'", "m or mm: rail slides"]),
        ("rail [m],elbow [m]\n0,0\n0.1,1\n", ["joint 2 is 'm'", "deg or rad: elbow turns"]),
        ("rail,elbow\n0,0\n0.6,1\n", ["[0, 0.5] m"]),
    ],
)
def test_units_that_contradict_the_robot_s_joints_are_refused(tmp_path, text, words):
    with pytest.raises(InvalidInput) as caught:
        waypoints.problem(written(tmp_path, "a.csv", text), CELL)
    for word in words:
        assert word in str(caught.value)


def test_metres_beside_radians_are_not_taken_for_degrees(tmp_path):
    gantry = {**CELL.joints, "rail": {**TWO.joints["one"], "position": (0, 99)}}
    robot = RobotLimits(gantry, "gantry.urdf", units=CELL.units)
    path = written(tmp_path, "a.csv", "rail,elbow\n0,0\n60,1\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        problem = waypoints.problem(path, robot)
        assert problem.waypoints[1, 0] == 60
