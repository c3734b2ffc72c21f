"""MoveIt's joint_limits.yaml: what it says, what it leaves unsaid, and slips of the pen."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.formats import joint_limits
from trajopt.formats.robot_limits import RobotLimits

pytestmark = pytest.mark.filterwarnings("ignore::trajopt.core.exceptions.FileNote")
WHOLE = """
default_velocity_scaling_factor: 0.5
default_acceleration_scaling_factor: 0.25
joint_limits:
  b_joint:
    has_velocity_limits: true
    max_velocity: 2.0
    has_acceleration_limits: true
    max_acceleration: 4.0
    max_effort: 150.0
  a_joint:
    max_velocity: !degrees 180
    max_acceleration: 1e1      # YAML 1.1 takes it for a text
    has_jerk_limits: true
    max_jerk: 50
    min_position: -1
    max_position: !radians 2
"""


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "joint_limits.yaml"
    path.write_text(text, encoding=encoding)
    return path


def test_limits_by_name_scaled(tmp_path):
    read = joint_limits.read(written(tmp_path, WHOLE))
    whole = read.limits(["a_joint", "b_joint"])
    assert np.allclose(whole.velocity[:, 1], [np.pi, 2.0])
    assert np.allclose(whole.acceleration[:, 1], [10, 4])
    limits = read.scaled().limits(["a_joint", "b_joint"])
    assert np.allclose(limits.velocity[:, 1], [np.pi / 2, 1.0])
    assert np.allclose(limits.acceleration, [[-2.5, 2.5], [-1, 1]])
    expected = [[-50, 50], [-np.inf, np.inf]]
    assert limits.jerk.tolist() == expected  # no factor scales jerk
    expected = [[-1, 2], [-np.inf, np.inf]]
    assert limits.position.tolist() == expected


def test_efforts_are_torques_where_they_are_asked_for(tmp_path):
    text = """joint_limits:
  a: {max_effort: 9, min_effort: -7}
  b: {max_effort: 5, has_effort_limits: false}
  c: {max_effort: 0}
  d: {max_effort: "4.5"}
"""
    with pytest.warns(FileNote, match="where a limit of torque asks for them .* of a, d$"):
        found = joint_limits.read(written(tmp_path, text))
    assert found.efforts == {"a": 7, "b": np.inf, "d": 4.5}


@pytest.mark.parametrize(
    "wrappers",
    [
        ["/**", "ros__parameters", "robot_description_planning"],
        ["move_group", "ros__parameters", "robot_description_planning"],
        ["left", "planner_node", "ros__parameters", "robot_description_planning"],
        ["robot_description_planning"],
    ],
)
def test_a_file_with_a_byte_order_mark_and_wrappers(tmp_path, wrappers):
    text = WHOLE
    for wrapper in reversed(wrappers):
        inner = "".join(f"  {line}\n" for line in text.splitlines())
        text = f"{wrapper}:\n{inner}"
    read = joint_limits.read(written(tmp_path, text, encoding="utf-8-sig"))
    assert read.joint_names == ("b_joint", "a_joint")
    assert read.velocity_scaling == 0.5


def test_two_nodes_with_limits_are_refused(tmp_path):
    node = "\n  ros__parameters: {joint_limits: {a: {max_velocity: 1}}}\n"
    with pytest.raises(InvalidInput, match="joint_limits: expected this key once"):
        joint_limits.read(written(tmp_path, f"one:{node}two:{node}"))


def test_accelerations_that_nobody_says_can_be_said_once(tmp_path):
    text = "joint_limits: {a: {max_velocity: 1, max_acceleration: 3}, b: {max_velocity: 2}}"
    read = joint_limits.read(written(tmp_path, text))
    with pytest.raises(InvalidInput, match=r"one for b; .*, or --acceleration with a number"):
        read.limits(["a", "b"])
    limits = read.with_acceleration(2.0).limits(["a", "b"])
    found = limits.acceleration[:, 1].tolist()
    assert found == [3, 2]


def test_flags_lift_what_another_source_says_and_silence_keeps_it(tmp_path):
    robot = RobotLimits(
        joints={
            "one": {"velocity": (-1, 1), "acceleration": (-2, 2), "jerk": (-3, 3)},
            "two": {"velocity": (-1, 1), "acceleration": (-2, 2), "position": (-4, 4)},
        },
        source="robot",
    )
    text = """
joint_limits:
  two: {has_position_limits: false, has_velocity_limits: true}
  one: {has_jerk_limits: false, max_jerk: 7, has_acceleration_limits: true, max_acceleration: 9}
  gripper: {max_velocity: 1}
"""
    own = robot.updated(joint_limits.read(written(tmp_path, text)))
    limits = own.limits(own.joint_names)
    assert own.joint_names == ("one", "two")
    assert own.ordered
    assert limits.velocity.tolist() == [[-1, 1], [-1, 1]]
    assert limits.acceleration.tolist() == [[-9, 9], [-2, 2]]
    assert not np.isfinite(limits.jerk).any()
    assert not np.isfinite(limits.position).any()


def test_the_smaller_of_acceleration_and_deceleration(tmp_path):
    text = "joint_limits: {a: {max_velocity: 1, max_acceleration: 3, max_deceleration: -2}}"
    limits = joint_limits.read(written(tmp_path, text)).limits(["a"])
    assert limits.acceleration.tolist() == [[-2, 2]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("joint_limits: {a: {max_velocity: -1}}", ["joint_limits.a.max_velocity is -1", "positiv"]),
        ("joint_limits: {a: {max_velocity: fast}}", ["joint_limits.a.max_velocity is 'fast'"]),
        ("joint_limits: {a: {max_velocity: .nan}}", ["joint_limits.a.max_velocity"]),
        ("joint_limits: {a: {max_velocity: .inf}}", ["joint_limits.a.max_velocity"]),
        ("joint_limits: {a: {max_accelleration: 1}}", ["expected the key max_acceleration"]),
        ("joint_limits: {a: {has_jerk_limits: 7}}", ["has_jerk_limits is 7", "true or false"]),
        ("joint_limits: {a: {max_velocity: 1, max_velocity: 2}}", ["max_velocity", "twice"]),
        ("joint_limits: {a: {max_velocity: 1}, a: {}}", ["the key a is there twice"]),
        ("joint_limits: {a: {min_position: 1, max_position: 1}}", ["min_position is 1.0", "below"]),
        ("joint_limits: {a: 3}", ["joint_limits.a is 3"]),
        ("joint_limits: {}", ["at least one joint"]),
        ("joint_limits: [1]", ["a mapping joint_limits"]),
        ("", ["a mapping joint_limits"]),
        ("a: [", ["a readable YAML file"]),
        ("default_velocity_scaling_factor: 1.5\njoint_limits: {a: {}}", ["at most 1"]),
        ("joint_limits: !!python/object/apply:os.getcwd []", ["a readable YAML file"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, words):
    path = written(tmp_path, text)
    with pytest.raises(InvalidInput) as caught:
        joint_limits.read(path)
    for word in [str(path), *words]:
        assert word in str(caught.value)


def test_not_text_and_not_there(tmp_path):
    path = tmp_path / "joint_limits.yaml"
    path.write_bytes(b"\xff\x00\xfejoint")
    with pytest.raises(InvalidInput, match="a readable YAML file"):
        joint_limits.read(path)
    with pytest.raises(InvalidInput, match="does not exist"):
        joint_limits.read(tmp_path / "absent.yaml")


def test_what_to_add_where_a_limit_is_missing(tmp_path):
    read = joint_limits.read(written(tmp_path, "joint_limits: {elbow: {max_velocity: 1}}"))
    with pytest.raises(InvalidInput) as caught:
        read.limits(["elbow"])
    for words in ("acceleration limit is missing", "one for elbow", "max_acceleration"):
        assert words in str(caught.value)
    with pytest.raises(InvalidInput, match="perhaps elbow"):
        read.limits(["elbw"])


def test_columns_without_names_need_an_order(tmp_path):
    read = joint_limits.read(written(tmp_path, WHOLE))
    with pytest.raises(InvalidInput, match="a header with the joints' names"):
        read.names_of(2)
    with pytest.raises(InvalidInput, match="2 columns"):
        read.names_of(3)


@pytest.mark.parametrize(("unit", "said"), [("", True), ("!degrees ", False)])
def test_ranges_in_degrees_are_said(tmp_path, unit, said):
    joint = f"{{min_position: {unit}-170, max_position: {unit}170, max_velocity: {unit}85}}"
    path = written(tmp_path, f"joint_limits:\n  A1: {joint}\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        joint_limits.read(path)
    notes = [str(own.message) for own in caught]
    assert len(notes) == said
    assert all("beyond 25 rad" in note and "`!degrees 170`: A1" in note for note in notes)
