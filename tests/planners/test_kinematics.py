"""Forward kinematics against Pinocchio, the inverse by round trip, and every way to fail."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import RigidTransform

from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.planners.kinematics import Robot, cartesian_problem

DATA = Path(__file__).parents[2] / "data"
SIX = Robot.from_toml(DATA / "kinematics/six-axis.toml")
TABLE2 = Problem.from_toml(DATA / "problems/six-axis.toml")
FREE = np.tile([-np.inf, np.inf], (6, 1))
INF = np.inf
PI = np.pi
QUARTER = np.pi / 2
AXIS_OFFSET = 0.0944


def robot(a, alpha, d, theta=(0, 0, 0, 0, 0, 0)) -> Robot:
    """A robot of unlimited joints; `alpha` and `theta` in quarter turns."""
    twists = np.array(alpha) * QUARTER
    offsets = np.array(theta) * QUARTER
    return Robot(a, twists, d, offsets, FREE)


PUMA = robot(  # Craig's textbook; shoulder offset
    a=[0, 0, 0.4318, 0.0203, 0, 0], alpha=[0, -1, 0, -1, 1, -1], d=[0, 0, 0.1244, 0.4318, 0, 0]
)
OTHER_SIGNS = robot(
    a=[0.1, 0.15, 0.6, 0.12, 0, 0], alpha=[0.4, 1, 2, 1, -1, 3], d=[0.3, 0.05, -0.02, -0.5, 0, 0.1]
)
BACKWARDS = robot(
    a=[0, -0.2, -0.5, -0.1, 0, 0],
    alpha=[2, 1, 0, -1, -1, 1],
    d=[0, 0.1, 0, 0.4, 0, -0.2],
    theta=[1, 2, 3, 1, 2, 3],
)
EQUAL_LINKS = robot(a=[0, 0, 0.5, 0.3, 0, 0], alpha=[0, -1, 0, -1, 1, -1], d=[0, 0, 0, 0.4, 0, 0.1])
ROBOTS = {
    "six-axis": SIX,
    "puma-560": PUMA,
    "other signs": OTHER_SIGNS,
    "backwards": BACKWARDS,
    "equal links": EQUAL_LINKS,
}
every_robot = pytest.mark.parametrize("arm", ROBOTS.values(), ids=ROBOTS)


def angles(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-PI, PI, (count, 6))


def miss(arm: Robot, joints, pose):
    """Largest entry by which the hand misses a pose."""
    error = arm.forward(joints) - pose
    return np.abs(error).max(axis=(-1, -2))


def pinocchio_model(arm: Robot) -> pinocchio.Model:
    """Each joint turns about z where `Rx(α) Tx(a) Tz(d) Rz(θ)` put it."""
    model = pinocchio.Model()
    parent = 0
    origin = np.zeros(3)
    for row in np.stack([arm.a, arm.alpha, arm.d, arm.theta], axis=1):
        a, alpha, d, theta = row
        about_x = pinocchio.exp3(np.array([alpha, 0.0, 0.0]))
        about_z = pinocchio.exp3(np.array([0.0, 0.0, theta]))
        twist = pinocchio.SE3(about_x, origin)
        shift = pinocchio.SE3(np.eye(3), np.array([a, 0.0, d]))
        turn = pinocchio.SE3(about_z, origin)
        placement = twist * shift * turn
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"after {parent}")
    return model


@every_robot
def test_forward_agrees_with_pinocchio(arm):
    model = pinocchio_model(arm)
    data = model.createData()
    for posture in angles(50):
        pinocchio.forwardKinematics(model, data, posture)
        *_, hand = data.oMi
        np.testing.assert_allclose(arm.forward(posture), hand.homogeneous, atol=1e-13)


def test_the_zero_pose_of_table_1():
    pose = SIX.forward(np.zeros(6))
    assert pose[:3, 3] == pytest.approx([0.2 + 0.7156 + 0.256, -0.0944, -0.8455 - 0.0838])
    np.testing.assert_allclose(pose[:3, :3], np.diag([1, -1, -1]), atol=1e-15)


def test_a_robot_of_two_joints():
    two = Robot([0, 1.0], [0, 0], [0, 0], [0, 0], [[-2, 2], [-1, 1]])
    pose = two.forward([QUARTER, 0.0])
    np.testing.assert_allclose(pose[:3, 3], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(two.nearest(pose), [QUARTER, 0.0], atol=1e-9)


@every_robot
def test_an_angle_nearby_comes_back(arm):
    free = replace(arm, joint_range=FREE)
    for q in angles(20):
        np.testing.assert_allclose(free.nearest(arm.forward(q), q + 0.01), q, atol=1e-6)


@every_robot
def test_a_pose_is_reached_from_any_posture(arm):
    for q, posture in zip(angles(4), angles(4, seed=1), strict=True):
        found = replace(arm, joint_range=FREE).nearest(arm.forward(q), posture)
        assert miss(arm, found, arm.forward(q)) < 1e-9


def test_no_farther_than_a_solution_that_is_known():
    rng = np.random.default_rng(3)
    for _ in range(6):
        q, posture = rng.uniform(*SIX.joint_range.T, (2, 6))
        found = SIX.nearest(SIX.forward(q), posture)
        assert miss(SIX, found, SIX.forward(q)) < 1e-9
        assert np.linalg.norm(found - posture) <= np.linalg.norm(q - posture) + 1e-9


@pytest.mark.parametrize("q5", [0.0, 1e-9, 1e-6, 1e-4])
def test_a_singular_wrist_is_found_within_the_ranges(q5):
    """Half of the turn can be more than an axis may take: then the other takes the rest."""
    for q, posture in np.random.default_rng(5).uniform(*SIX.joint_range.T, (12, 2, 6)):
        q[4] = q5
        found = SIX.nearest(SIX.forward(q), posture)
        assert miss(SIX, found, SIX.forward(q)) < 1e-9
        assert np.linalg.norm(found - posture) <= np.linalg.norm(q - posture) + 1e-5


@pytest.mark.parametrize("kept", [0.0, 0.5, -1.2])
def test_a_singular_wrist_turns_both_of_its_axes_as_little_as_it_can(kept):
    """Axes 4 and 6 are one: the pose fixes the sum of their angles, 0.4 rad."""
    pose = SIX.forward([0.1, 0.2, 0.3, 0.4, 0.0, 0.0])
    found = SIX.nearest(pose, [0.1, 0.2, 0.3, kept, 0.0, 0.0])
    half = (0.4 - kept) / 2
    np.testing.assert_allclose(found, [0.1, 0.2, 0.3, kept + half, 0.0, half], atol=1e-9)


def test_out_of_reach_says_how_far():
    above_shoulder = np.hypot(AXIS_OFFSET, 0.2)
    pose = SIX.forward(np.zeros(6))
    pose[:3, 3] = [above_shoulder, 0.0, 30.0]
    with pytest.raises(InvalidInput, match=r"metres outside of the robot.s reach is 2\d"):
        SIX.nearest(pose)


# --- all eight branches, in closed form ---

ARMS = {name: arm for name, arm in ROBOTS.items() if arm.has_branches}
every_arm = pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)


def turned_apart(left, right) -> np.ndarray:
    """The largest angle between postures, whole turns taken off."""
    return np.abs(np.remainder(left - right + PI, 2 * PI) - PI).max(axis=-1)


def test_which_arms_have_branches():
    assert set(ARMS) == {"six-axis", "puma-560", "equal links"}
    with pytest.raises(InvalidInput, match=r"^robot is .*: expected six joints with alpha 0, -90"):
        BACKWARDS.branches(np.eye(4))


@every_arm
def test_eight_branches_of_a_thousand_poses_by_round_trip(arm):
    q = angles(1000)
    shifted = replace(arm, theta=np.linspace(-1, 1, 6), d=np.add(arm.d, [0.3, 0.05, 0, 0, 0, 0.02]))
    for own in (arm, shifted):
        poses = own.forward(q)
        found = own.branches(poses)
        missed = miss(own, found.q, poses[:, None])
        reached = found.miss < 1e-9
        assert missed[reached].max() < 1e-12
        assert set(reached.sum(axis=1)) <= {4, 8}  # the elbow of one shoulder may be out of reach
        assert turned_apart(found.q, q[:, None]).min(axis=1).max() < 1e-7
        pairs = turned_apart(found.q[:, :, None], found.q[:, None])
        both = reached[:, :, None] & reached[:, None] & ~np.eye(8, dtype=bool)
        assert pairs[both].min() > 1e-4  # none of them twice


def test_newtons_method_finds_no_ninth_and_none_that_is_nearer():
    other = replace(SIX, joint_range=FREE, alpha=np.add(SIX.alpha, [0, 1e-11, 0, 0, 0, 0]))
    assert not other.has_branches  # the same arm: searched with Newton's method
    arm = replace(SIX, joint_range=FREE)
    for q, apart in zip(angles(8), [0.3] * 7 + [2.0], strict=True):
        pose = arm.forward(q)
        posture = q + np.array([1, -1, 1, -1, 1, -1]) * apart
        newton = other.nearest(pose, posture)
        branches = arm.branches(pose, posture)
        reached = branches.q[branches.miss < 1e-9]
        assert turned_apart(reached, newton).min() < 1e-7
        nearest = np.linalg.norm(reached - posture, axis=1).min()
        assert np.linalg.norm(arm.nearest(pose, posture) - posture) == pytest.approx(nearest)
        assert nearest <= np.linalg.norm(newton - posture) + 1e-9


def test_out_of_reach_a_branch_says_how_far():
    pose = SIX.forward(np.zeros(6))
    arm = 0.7156 + np.hypot(0.256, 0.8455)
    # Above axis 2, which lies 0.2 m off; the offset of 94.4 mm lies across the arm's plane.
    pose[:3, 3] = [np.hypot(0.2, AXIS_OFFSET), 0.0, arm + 3.0 - 0.0838]
    found = SIX.branches(pose)
    np.testing.assert_allclose(found.miss[:4], 3.0, atol=1e-12)
    assert (found.miss[4:] > 3.0).all()
    rotations = SIX.forward(found.q)[:, :3, :3]
    np.testing.assert_allclose(rotations, np.tile(pose[:3, :3], (8, 1, 1)), atol=1e-12)
    # Nearer to axis 1 than the offset of axes 2 and 3: no angle of joint 1 gets there.
    pose[:3, 3] = [0.01, 0.0, 0.5]
    np.testing.assert_allclose(SIX.branches(pose).miss.min(), AXIS_OFFSET - 0.01, atol=1e-12)


@pytest.mark.parametrize("q5", [0.0, PI])
def test_singular_wrists_are_said_and_stay_near_the_posture(q5):
    q = np.array([0.1, 0.2, 0.3, 0.4, q5, 0.5])
    pose = SIX.forward(q)
    posture = np.array([0.1, 0.2, 0.3, -0.6, q5, 1.1])
    found = replace(SIX, joint_range=FREE).branches(pose, posture)
    assert miss(SIX, found.q, pose)[found.miss < 1e-9].max() < 1e-12
    here = turned_apart(found.q[:, :3], q[:3]) < 1e-9
    assert found.singular[here].all()
    sign = np.cos(q5)
    turn = (0.4 + sign * 0.5) - (-0.6 + sign * 1.1)
    expected = np.add(posture, [0, 0, 0, turn / 2, 0, sign * turn / 2])
    assert turned_apart(found.q[here], expected).max() < 1e-9
    assert not SIX.branches(SIX.forward([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])).singular.any()


def test_axes_through_the_wrist_centre_leave_an_angle_as_it_was():
    """The arm points straight up, or the wrist lies on axis 2 of an arm with equal links."""
    up = EQUAL_LINKS.forward([0.7, -QUARTER, np.arctan2(0.3, 0.4) - QUARTER, 0.1, 0.2, 0.3])
    found = EQUAL_LINKS.branches(up, [0.7, 0, 0, 0, 0, 0])
    assert miss(EQUAL_LINKS, found.q, up)[found.miss < 1e-9].max() < 1e-9
    folded = EQUAL_LINKS.forward([0.7, 0.4, np.arctan2(0.3, 0.4) + QUARTER, 0.1, 0.2, 0.3])
    assert np.abs(folded[:3, 3] - 0.1 * folded[:3, 2]).max() < 1e-12  # on axes 1 and 2
    found = EQUAL_LINKS.branches(folded, [0.7, 0.4, 0, 0, 0, 0])
    assert miss(EQUAL_LINKS, found.q, folded).max() < 1e-9
    np.testing.assert_allclose(found.q[:, :2], np.tile([0.7, 0.4], (8, 1)), atol=1e-7)


def test_ranges_mark_the_branches_that_a_robot_can_take():
    q = np.random.default_rng(0).uniform(*SIX.joint_range.T, (50, 6))
    found = SIX.branches(SIX.forward(q))
    low, high = SIX.joint_range.T
    inside = ((found.q > low - 1e-9) & (found.q < high + 1e-9)).all(axis=-1)
    np.testing.assert_array_equal(found.within, inside)
    assert found.within.any(axis=1).all()


def test_a_pose_with_seven_printed_digits_is_reached():
    q = np.array([0.1, -0.2, 0.3, 0.4, 0.5, 0.6])
    printed = SIX.forward(q).round(7)
    np.testing.assert_allclose(SIX.nearest(printed, q), q, atol=1e-5)


# --- joint ranges ---


def test_of_angles_a_turn_apart_the_one_in_range_nearest_to_the_previous_is_taken():
    wide = replace(SIX, joint_range=np.tile([-10.0, 10.0], (6, 1)))
    turned = np.array([0.2, -0.3, 0.4, 0.5, 0.6, 0.7 + 2 * PI])
    pose = wide.forward(turned)
    np.testing.assert_allclose(wide.nearest(pose, turned + 0.1), turned, atol=1e-9)


def test_a_joint_out_of_its_range_is_named():
    q = [0.2, -0.3, 0.4, 0.5, 0.6, 0.7]
    tight = SIX.joint_range.copy()
    tight[0] = [1.0, 1.1]
    narrow = replace(SIX, joint_range=tight)
    with pytest.raises(InvalidInput, match=r"best branch, joint 1 is .*joint_range \[1, 1.1\] rad"):
        narrow.nearest(SIX.forward(q))


# --- from a Cartesian path to a problem ---


def test_table_2_comes_back_from_its_own_poses():
    for q in TABLE2.waypoints:
        again = SIX.nearest(SIX.forward(q), q)
        assert np.degrees(np.abs(again - q).max()) < 0.5e-3


def test_following_the_nearest_solution_shares_the_turn_of_a_singular_wrist():
    """Point 2 has a singular wrist: its pose fixes θ4 + θ6 = 30° alone."""
    poses = SIX.forward(TABLE2.waypoints)
    problem = cartesian_problem(SIX, poses, TABLE2.limits)
    expected = np.degrees(TABLE2.waypoints)
    expected[1, [3, 5]] = 15.0
    np.testing.assert_allclose(np.degrees(problem.waypoints), expected, atol=1e-8)
    assert problem.name == "six-axis"


def test_a_path_is_followed_without_jumps():
    rng = np.random.default_rng(7)
    start, *knots = rng.uniform(*SIX.joint_range.T * 0.6, (4, 6))
    legs = zip([start, *knots], knots, strict=False)
    line = np.concatenate([np.linspace(a, b, 50)[1:] for a, b in legs])
    transforms = RigidTransform.from_matrix(SIX.forward(line))
    problem = cartesian_problem(SIX, transforms, TABLE2.limits, start, name="line")
    np.testing.assert_allclose(problem.waypoints, line, atol=1e-7)
    assert problem.name == "line"


def test_a_path_that_cannot_be_followed_names_its_pose():
    good = SIX.forward(TABLE2.waypoints)
    far = np.concatenate([good[:2], good[2:3] + np.eye(4, k=3) * 5.0])
    with pytest.raises(InvalidInput, match="pose 3, metres outside"):
        cartesian_problem(SIX, far, TABLE2.limits)
    with pytest.raises(InvalidInput, match="start, joint 2 is nan"):
        cartesian_problem(SIX, good, TABLE2.limits, [0, np.nan, 0, 0, 0, 0])
    with pytest.raises(InvalidInput, match="at least two rows"):
        cartesian_problem(SIX, good[:1], TABLE2.limits)
    with pytest.raises(InvalidInput, match="6 values"):
        cartesian_problem(SIX, good, Limits([1.0], [1.0]))


# --- bad input ---


WRONG_POSES = {
    "mirrored": np.diag([1.0, 1, -1, 1]),
    "scaled": np.diag([1.001, 1, 1, 1]),
    "zero": np.zeros((4, 4)),
    "huge": np.diag([1e300, 1, 1, 1]),
    "NaN": np.diag([np.nan, 1, 1, 1]),
    "3 x 3": np.eye(3),
    "text": "up",
    "ragged": [[1, 2], [3]],
    "none": None,
}


@pytest.mark.parametrize("wrong", WRONG_POSES.values(), ids=WRONG_POSES)
def test_a_wrong_pose_is_refused(wrong):
    with pytest.raises(InvalidInput, match=r"^pose.*: expected a finite 4 x 4") as caught:
        SIX.nearest(wrong)
    assert "\n" not in str(caught.value)


def test_a_wrong_pose_among_many_is_named():
    with pytest.raises(InvalidInput, match=r"^pose 2 is"):
        cartesian_problem(SIX, np.stack([np.eye(4), np.zeros((4, 4))]), TABLE2.limits)


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([0] * 5, "q is .*expected 6 finite angles"),
        (0.0, "q is 0.0: expected 6"),
        ("home", "q is 'home'"),
        ([[0, 0, 0, 0, 0, np.nan]], "q, joint 6 is nan"),
        ([True] * 6, "q is "),
    ],
)
def test_wrong_angles_are_refused(q, message):
    with pytest.raises(InvalidInput, match=message):
        SIX.forward(q)


# --- robot files ---

PLAIN = {
    "name": '"r"',
    "source": '"s"',
    "angle_unit": '"deg"',
    "convention": '"modified-dh"',
    "a": "[0, 1.5]",
    "alpha": "[0.0, -90.0]",
    "d": "[0.25, 0.5]",
    "theta": "[0.0, 180.0]",
    "joint_range": "[[-90.0, 180.0], [-inf, inf]]",
}


def read(folder: Path, **changes: str | None) -> Robot:
    file = folder / "given.toml"
    table = PLAIN | changes
    lines = [f"{key} = {value}" for key, value in table.items() if value is not None]
    file.write_text("\n".join(lines))
    return Robot.from_toml(file)


def test_a_robot_file_is_read_in_radians_and_frozen(tmp_path):
    arm = read(tmp_path, name=None, source=None)
    assert arm.name == "given"
    assert arm.joints == 2
    np.testing.assert_allclose(arm.alpha, [0, -QUARTER])
    np.testing.assert_allclose(arm.theta, [0, PI])
    np.testing.assert_allclose(arm.joint_range, [[-QUARTER, PI], [-INF, INF]])
    np.testing.assert_array_equal(read(tmp_path, angle_unit='"rad"').alpha, [0, -90])
    with pytest.raises(ValueError, match="read-only"):
        arm.a[0] = 1.0


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("colour", "1", "colour is 1: expected one of"),
        ("theta", None, "theta: expected this key"),
        ("convention", '"dh"', "convention is 'dh': expected \"modified-dh\""),
        ("angle_unit", '"degrees"', 'angle_unit is \'degrees\': expected "deg" or "rad"'),
        ("name", "5", "name is 5: expected a string"),
        ("a", "[]", "a is []: expected one finite number per joint"),
        ("a", "1.5", "a is 1.5: expected one finite number per joint"),
        ("a", '"long"', "a is 'long': expected one finite number"),
        ("a", "[0.0, '1.5']", "a is [0.0, '1.5']: expected one finite number"),
        ("a", "[0.0, nan]", "a, joint 2 is nan: expected one finite number"),
        ("d", "[0.0]", "d is [0.0]: expected one finite number per joint of a"),
        ("d", "[0.0, [1.0]]", "d is [0.0, [1.0]]: expected one finite number"),
        ("theta", "[0.0, true]", "theta is [0.0, True]: expected one finite number"),
        ("joint_range", "[90, 90]", "joint_range is [90.0, 90.0]: expected one [low, high]"),
        ("joint_range", "[[-90, 90], [9, -9]]", "joint_range, joint 2 is [9.0, -9.0]"),
        ("joint_range", "[[5, 6], [0, 1, 2]]", "joint_range is [[5, 6], [0, 1, 2]]"),
    ],
)
def test_a_bad_file_is_refused_in_words_that_mend_it(tmp_path, key, value, message):
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, **{key: value})
    assert f"given.toml: {message}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_or_broken_file_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match=r"nowhere\.toml: it does not exist"):
        Robot.from_toml(tmp_path / "nowhere.toml")
    with pytest.raises(InvalidInput, match="expected a readable TOML file"):
        read(tmp_path, a="[0, 1")
