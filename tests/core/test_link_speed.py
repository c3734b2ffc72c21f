"""Speed of named links: closed forms of two links, files, URDFs, chords, planners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.along.planner import Along
from baselines.lower_bound.planner import Prove
from soaks import arms
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import LinkSpeed
from trajopt.formats import urdf
from trajopt.planners.testing_limits import check_limit

# Two links, 0.6 m and 0.4 m: the elbow moves at 0.6 m times the first joint's velocity.
TWO_LINKS = """name = "two links"
angle_unit = "rad"
joint_names = ["shoulder", "elbow"]
waypoints = [[0, 0.3], [0.7, 1], [1.6, 0.5]]
limits.velocity = [3, 3]
limits.acceleration = [10, 10]
limits.link_speed.elbow = 0.3
chain.xyz = [[0, 0, 0], [0.6, 0, 0]]
chain.rpy = [[0, 0, 0], [0, 0, 0]]
chain.axis = [[0, 0, 1], [0, 0, 1]]
chain.tool_xyz = [0.4, 0, 0]
"""
MOTION = Trajectory([0.0, 2.0], [[[0.5, -0.25]], [[0.0, 1.0]]], [0.0, 2.0])


def read(folder, text=TWO_LINKS):
    file = folder / "links.toml"
    file.write_text(text, encoding="utf-8")
    return Problem.from_toml(file)


def chain(**links):
    origins = np.tile(np.eye(4), (2, 1, 1))
    origins[1, 0, 3] = 0.6
    tool = np.eye(4)
    tool[0, 3] = 0.4
    axes = np.tile([0.0, 0.0, 1.0], (2, 1))
    return LinkChain(origins, axes, np.zeros(2, dtype=bool), tool, None, links)


def limits(**asked):
    return Limits([3, 3], [10, 10], **asked)


def two_links(demands=None, **asked):
    rows = [[0, 0.3], [0.7, 1], [1.6, 0.5]]
    return Problem(rows, limits(**asked), chain=chain(), demands=demands or {})


def test_inf_on_the_command_line_is_no_limit():
    stated = ("joint 1=inf,joint 2=0.3", "joint 2=0.3")
    one, other = (two_links(link_speed=own).digest() for own in stated)
    assert one == other


def test_an_elbow_is_as_fast_as_its_link_is_long(tmp_path):
    problem = read(tmp_path)
    use = problem.limits.worst("link_speed", MOTION)
    assert use.value == pytest.approx(0.6 * 0.5 / 0.3, rel=2e-8)
    assert use.joint == 1
    own = problem.limits.kinds["link_speed"]
    assert own.of_joint(1, problem) == "0.3 m/s"
    assert own.of_joint(0, problem) == "–"
    check_limit(own)


def test_the_end_of_the_last_link_is_the_tool():
    tip = two_links(link_speed={"joint 2": {"speed": 0.5, "xyz": [0.4, 0, 0]}})
    tool = two_links(tool_speed=0.5)
    worst = [
        own.limits.worst(key, MOTION).value
        for own, key in ((tip, "link_speed"), (tool, "tool_speed"))
    ]
    assert worst[0] == worst[1]
    times = [
        own.limits.kinds[key].least_times(own)
        for own, key in ((tip, "link_speed"), (tool, "tool_speed"))
    ]
    np.testing.assert_array_equal(*times)


@pytest.mark.parametrize("seed", range(3))
def test_points_of_random_arms_move_as_in_pinocchio(seed):
    apart, above = arms.tried_links(seed)
    assert apart < 1e-13
    assert -1e-12 <= above < 1e-6


def test_a_limit_of_an_elbow_is_one_of_the_first_joint():
    """0.3 m/s at 0.6 m are 0.5 rad/s: planned, proved and dilated as that."""
    problem = two_links(link_speed=[np.inf, 0.3])
    other = Problem(problem.waypoints, Limits([0.5, 3], [10, 10]))
    planner = Along(knots="chord", ends="not-a-knot")
    durations = [
        verify(own, planner.solve(own).trajectory).certified_duration for own in (problem, other)
    ]
    assert durations[0] == pytest.approx(durations[1], rel=3e-4)
    # the chords of the elbow are those of its circle
    chords = 2 * 0.6 * np.sin(np.array([0.7, 0.9]) / 2) / 0.3
    assert problem.limits.kinds["link_speed"].least_times(problem) == pytest.approx(chords)
    found = Prove().solve(problem)
    assert chords.sum() * (1 - 2e-4) <= found.lower_bound <= durations[0]
    assert Prove().stored_bound(problem, found.stats) == pytest.approx(found.lower_bound, rel=1e-9)
    slow = verify(problem, planner.solve(two_links()).trajectory)
    assert slow.dilation > 1
    assert slow.certified_duration >= durations[0]


def test_a_file_says_links_by_name_in_a_segment_too(tmp_path):
    text = (
        TWO_LINKS
        + """[[limits.segment]]
number = 2
link_speed = {elbow = 0.2, shoulder = {speed = 0.5, xyz = [0.3, 0, 0]}}
"""
    )
    problem = read(tmp_path, text)
    own = problem.limits.kinds["link_speed"]
    np.testing.assert_array_equal(own.column("speed"), [[np.nan, 0.3], [0.5, 0.2]])
    np.testing.assert_array_equal(own.column("place"), [[0.3, 0, 0], [0, 0, 0]])
    (tmp_path / "again.toml").write_text(problem.to_toml(), encoding="utf-8")
    again = Problem.from_toml(tmp_path / "again.toml")
    assert again.digest() == problem.digest()
    by_list = two_links(link_speed=[[np.inf, 0.3], [np.inf, 0.2]])
    by_name = two_links(link_speed=[{"joint 2": 0.3}, {"joint 2": 0.2}])
    assert by_list.digest() == by_name.digest()
    assert two_links(link_speed={"joint 2": 0.3}) == two_links(link_speed=[np.inf, 0.3])


ARM = """<robot name="r"><link name="base"/><link name="upper"/><link name="lower"/>
<link name="hand"/><link name="finger"/>
<joint name="one" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" acceleration="2"/></joint>
<joint name="two" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 0 1"/>
<origin xyz="0.6 0 0"/><limit lower="-3" upper="3" velocity="2" acceleration="2"/></joint>
<joint name="fixed" type="fixed"><parent link="lower"/><child link="hand"/>
<origin xyz="0.4 0 0" rpy="0 0 1.5707963267948966"/></joint>
<joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="1 0 0"/>
<origin xyz="0.1 0 0"/><limit lower="0" upper="0.1" velocity="1" acceleration="1"/></joint>
</robot>"""


def test_a_urdf_names_links_also_those_that_are_fixed_or_rest(tmp_path):
    """The finger rests at 0.1 m along the hand's x, which is the lower link's y."""
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    robot = urdf.read(tmp_path / "arm.urdf")
    asked = {"upper": 1.0, "finger": {"speed": 0.5, "xyz": [0.2, 0, 0]}}
    found = replace(robot, stated={"link_speed": asked}).limits(["one", "two"])
    own = found.kinds["link_speed"]
    np.testing.assert_allclose(own.column("place"), [[0, 0, 0], [0.4, 0.3, 0]], atol=1e-15)
    np.testing.assert_array_equal(own.column("speed"), [1.0, 0.5])
    with pytest.raises(InvalidInput, match="upper, lower, hand, finger"):
        replace(robot, stated={"link_speed": {"wrist": 1}}).limits(["one", "two"])
    with pytest.raises(InvalidInput, match="one point that moves with a joint; hand does so, too"):
        replace(robot, stated={"link_speed": "hand=1,lower=1"}).limits(["one", "two"])


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("elbow = 0", "limits.link_speed.elbow is 0: expected a positive number, m/s, or inf"),
        (
            "wrist = 1",
            "limits.link_speed is 'wrist': expected a link or joint of the arm: shoulder",
        ),
        (
            "elbow = {xyz = [0, 0, 0]}",
            "limits.link_speed.elbow.speed: expected this key; it is missing",
        ),
        ("elbow = {speed = 1, xyz = [0, 0]}", "limits.link_speed.elbow.xyz is [0, 0]"),
        ("elbow = {speed = 1, at = 2}", "limits.link_speed.elbow.at"),
    ],
)
def test_a_table_that_is_wrong_gets_a_line(tmp_path, value, message):
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, TWO_LINKS.replace("elbow = 0.3", value))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([0.3], "a table of links' names and speeds, m/s, or 2 numbers, one per joint"),
        ([0.3, -1], "a positive number, m/s, or inf"),
        ({}, "a table of links' names"),
        (0.3, "a table of links' names"),
        ("elbow", "links, each once, as in forearm_link=0.5,flange=0.25"),
        ("elbow=fast", "a positive number, m/s, or inf"),
        ([{"joint 2": x} for x in (1, 2, 3)], "2 segments, as the waypoints have"),
        ([{"joint 2": 0.3}, {"joint 2": {"speed": 1, "xyz": [1, 0, 0]}}], "one point that moves"),
    ],
)
def test_a_value_that_is_wrong_gets_a_line(value, message):
    with pytest.raises(InvalidInput) as caught:
        two_links(link_speed=value)
    assert message in str(caught.value)


def test_links_without_frames_get_a_line():
    with pytest.raises(InvalidInput, match="the link frames of all joints"):
        Problem([[0, 0], [1, 1]], limits(link_speed={"joint 2": 0.3}))
    whole = two_links(link_speed=[np.inf, 0.3]).limits.kinds["link_speed"]
    assert LinkSpeed.read(whole.table(), 2).table() == whole.table()
