"""Link frames against Pinocchio, against published Denavit–Hartenberg tables, and from URDFs."""

from __future__ import annotations

import tomllib

import numpy as np
import pinocchio
import pytest

from trajopt.core import arm_file
from trajopt.core.chain import LinkChain, chain_of
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.formats import arms, urdf, waypoints

ARMS = [name for name in arm_file.arm_files() if arm_file.read(name).chain is not None]
HALF = np.pi / 2
# A fixed joint and one that follows another lie on the way; a gripper and a camera branch off it.
BRANCHED = """<robot name="r"><link name="world"/><link name="base"/><link name="rail"/>
<link name="l1"/><link name="l2"/><link name="l3"/><link name="flange"/><link name="tool"/>
<link name="camera"/><link name="finger"/>
<joint name="mount" type="fixed"><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>
  <parent link="world"/><child link="base"/></joint>
<joint name="slide" type="prismatic"><origin xyz="1 0 0" rpy="0 0 0.2"/><axis xyz="0 2 0"/>
  <parent link="base"/><child link="rail"/>
  <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="turn" type="revolute"><origin xyz="0 0 0.5" rpy="0.3 0 0"/><axis xyz="1 1 0"/>
  <parent link="rail"/><child link="l1"/>
  <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="follower" type="revolute"><origin xyz="0 0.1 0" rpy="0 0.7 0"/><axis xyz="0 0 1"/>
  <parent link="l1"/><child link="l2"/><limit lower="-2" upper="2" velocity="1" effort="1"/>
  <mimic joint="turn" multiplier="0"/></joint>
<joint name="endless" type="continuous"><origin rpy="0 0 1"/>
  <parent link="l2"/><child link="l3"/><limit velocity="1" effort="1"/></joint>
<joint name="camera_mount" type="fixed"><parent link="l1"/><child link="camera"/></joint>
<joint name="finger_joint" type="prismatic"><parent link="l1"/><child link="finger"/>
  <limit lower="0" upper="1" velocity="1" effort="1"/></joint>
<joint name="a" type="fixed"><origin xyz="0 0 0.2"/>
  <parent link="l3"/><child link="flange"/></joint>
<joint name="b" type="fixed"><origin rpy="0 1.5 0"/>
  <parent link="flange"/><child link="tool"/></joint>
</robot>"""


def pinocchio_poses(text: str, link: str, postures: np.ndarray) -> np.ndarray:
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()
    frame = model.getFrameId(link)
    found = []
    for q in postures:
        own = pinocchio.neutral(model)
        for joint, value in enumerate(q, start=1):
            at = model.joints[joint].idx_q
            turns = model.joints[joint].nq == 2
            own[at : at + 1 + turns] = [np.cos(value), np.sin(value)] if turns else [value]
        pinocchio.framesForwardKinematics(model, data, own)
        found.append(data.oMf[frame].homogeneous.copy())
    return np.array(found)


def as_urdf(table: dict) -> str:
    """The URDF of a robot file's origins and axes."""

    def attributes(xyz, rpy) -> str:
        return f'xyz="{" ".join(map(repr, xyz))}" rpy="{" ".join(map(repr, rpy))}"'

    joints = []
    rows = zip(table["xyz"], table["rpy"], table["axis"], strict=True)
    for joint, (xyz, rpy, axis) in enumerate(rows):
        joints.append(
            f'<link name="l{joint + 1}"/><joint name="j{joint}" type="revolute">'
            f'<origin {attributes(xyz, rpy)}/><axis xyz="{" ".join(map(repr, axis))}"/>'
            f'<parent link="l{joint}"/><child link="l{joint + 1}"/>'
            '<limit lower="-7" upper="7" velocity="1" effort="1"/></joint>'
        )
    zero = [0, 0, 0]
    tool = attributes(table.get("tool_xyz", zero), table.get("tool_rpy", zero))
    end = f'<link name="tool"/><joint name="t" type="fixed"><origin {tool}/>'
    end += f'<parent link="l{len(joints)}"/><child link="tool"/></joint>'
    return f'<robot name="r"><link name="l0"/>{"".join(joints)}{end}</robot>'


@pytest.mark.parametrize("name", ARMS)
def test_every_built_in_arm_stands_where_pinocchio_puts_it(name):
    table = tomllib.loads(arm_file.arm_files()[name].read_text(encoding="utf-8"))["chain"]
    chain = arm_file.read(name).chain
    postures = np.random.default_rng(0).uniform(-3, 3, (20, chain.joints))
    expected = pinocchio_poses(as_urdf(table), "tool", postures)
    np.testing.assert_allclose(chain.forward(postures), expected, atol=1e-12)
    assert chain.frames(postures).shape == (20, chain.joints + 1, 4, 4)
    # a derivative by a complex step is the finite difference
    step = 1e-6 * np.eye(chain.joints)
    slope = chain.forward(postures[0] + 1e-30j * step / 1e-6).imag / 1e-30
    difference = (chain.forward(postures[0] + step) - chain.forward(postures[0] - step)) / 2e-6
    np.testing.assert_allclose(slope, difference, atol=1e-8)


def test_only_the_arm_whose_frames_nobody_publishes_and_those_of_policies_have_none():
    policies = {"so-100", "so-101", "xarm-6", "xarm-7", "viperx-300s", "aloha"}
    assert set(arm_file.arm_files()) - set(ARMS) == {"crs-a255"} | policies
    assert all(arm_file.read(name).chain_origin.source for name in ARMS)


def test_franka_s_and_universal_robots_published_tables():
    """Modified parameters of the FCI documentation; standard ones of the UR5e's page."""
    franka = LinkChain.modified_dh(
        np.array([0, 0, 0, 0.0825, -0.0825, 0, 0.088]),
        HALF * np.array([0, -1, 1, 1, -1, 1, 1]),
        np.array([0.333, 0, 0.316, 0, 0.384, 0, 0]),
        np.zeros(7),
    )
    postures = np.random.default_rng(1).uniform(-3, 3, (20, 7))
    for name in ("franka-panda", "franka-fr3"):
        chain = arm_file.read(name).chain
        expected = franka.forward(postures) @ chain.tool
        np.testing.assert_allclose(chain.forward(postures), expected, atol=1e-12)
    a, d = [0, -0.425, -0.3922, 0, 0, 0], [0.1625, 0, 0, 0.1333, 0.0997, 0.0996]
    expected = np.eye(4)
    alphas = HALF * np.array([1, 0, 0, 1, -1, 0])
    for q, own_a, own_d, alpha in zip(postures[0, :6], a, d, alphas, strict=True):
        c, s, ca, sa = np.cos(q), np.sin(q), np.cos(alpha), np.sin(alpha)
        expected = expected @ [
            [c, -s * ca, s * sa, own_a * c],
            [s, c * ca, -c * sa, own_a * s],
            [0, sa, ca, own_d],
            [0, 0, 0, 1],
        ]
    # ROS rounds π/2 to ten digits there
    found = arm_file.read("ur5e").chain.forward(postures[0, :6])
    np.testing.assert_allclose(found, expected, atol=2e-9)


def test_a_urdf_brings_its_own_frames(tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(BRANCHED, encoding="utf-8")
    robot = urdf.read(file)
    assert robot.joint_names == ("slide", "turn", "endless", "finger_joint")
    chain = chain_of(robot.frames, ("slide", "turn", "endless"))
    postures = np.random.default_rng(2).uniform(-3, 3, (20, 3))
    assert chain.slides.tolist() == [True, False, False]
    # Pinocchio's joints: slide, turn, finger, follower, endless
    wide = np.zeros((20, 5))
    model = pinocchio.buildModelFromXML(BRANCHED)
    order = [list(model.names).index(name) - 1 for name in ("slide", "turn", "endless")]
    wide[:, order] = postures
    expected = pinocchio_poses(BRANCHED, "tool", wide)
    np.testing.assert_allclose(chain.forward(postures), expected, atol=1e-12)
    # the others stay at 0; an order that the links do not have is no chain
    part = chain_of(robot.frames, ("turn", "endless"))
    moved = postures * [0, 1, 1]
    np.testing.assert_allclose(part.forward(postures[:, 1:]), chain.forward(moved), atol=1e-12)
    assert chain_of(robot.frames, ("endless", "turn")) is None
    assert chain_of(robot.frames, ("endless", "finger_joint")) is None
    rows = tmp_path / "w.csv"
    rows.write_text("turn,endless\n0,0\n1,1\n", encoding="utf-8")
    planned = waypoints.problem(rows, robot.with_acceleration(1))
    np.testing.assert_array_equal(planned.chain.forward([1, 2]), part.forward([1, 2]))


@pytest.mark.parametrize(
    "wrong",
    [
        'xyz="1 0"',
        'xyz="1 0 ${x}"',
        'xyz="nan 0 0"',
        'xyz=""',
    ],
)
def test_a_faulty_origin_costs_the_frames_behind_it_and_nothing_else(tmp_path, wrong):
    file = tmp_path / "r.urdf"
    file.write_text(BRANCHED.replace('xyz="0 0 0.5"', wrong, 1), encoding="utf-8")
    robot = urdf.read(file)
    assert robot.joint_names == ("slide", "turn", "endless", "finger_joint")
    assert chain_of(robot.frames, ("slide",)) is not None
    assert chain_of(robot.frames, ("slide", "turn")) is None
    assert robot.with_acceleration(1).limits(("slide", "turn")).joints == 2


def test_a_loop_of_links_has_no_frames(tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(BRANCHED.replace('parent link="world"', 'parent link="l3"'), encoding="utf-8")
    robot = urdf.read(file)
    assert chain_of(robot.frames, ("slide", "turn", "endless")) is None


def test_a_problem_has_the_frames_of_its_robot(tmp_path):
    rows = [[0, -90, 90, -90, -90, 0], [40, -70, 80, -100, -90, 20]]
    names = [*arms.named("ur5e").joint_names]
    file = tmp_path / "p.toml"
    file.write_text(f'robot = "ur5e"\nwaypoints = {rows}\nunits.waypoints = "deg"')
    whole = Problem.from_toml(file)
    tip = whole.chain.forward(whole.waypoints)
    np.testing.assert_array_equal(tip, arm_file.read("ur5e").chain.forward(whole.waypoints))
    assert whole.without("position").chain is whole.chain
    assert whole.at(np.array([True, True])).chain is whole.chain
    part = [row[1:3] for row in rows]
    file.write_text(
        f'robot = "ur5e"\nwaypoints = {part}\njoint_names = {names[1:3]}\nunits.waypoints = "deg"'
    )
    assert Problem.from_toml(file).chain.joints == 2
    with pytest.raises(InvalidInput, match="chain is 2: expected 6 joints"):
        Problem(whole.waypoints, whole.limits, chain=Problem.from_toml(file).chain)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("xyz", [[0, 0, 0]], "chain.xyz is .*three finite numbers per joint of 6"),
        ("axis", [[0, 0, 0]] * 6, "chain.axis, joint 1 is .*a direction"),
        ("rpy", "up", "chain.rpy is 'up'"),
        ("tool_xyz", [0, 0], "tool_xyz is"),
    ],
)
def test_a_wrong_chain_is_refused(key, value, message):
    table = tomllib.loads(arm_file.arm_files()["ur5e"].read_text(encoding="utf-8"))["chain"]
    with pytest.raises(InvalidInput, match=message):
        LinkChain.read(table | {key: value}, 6)
