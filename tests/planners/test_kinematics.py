"""Forward kinematics against Pinocchio, the inverse by round trip, and every way to fail."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Limits, Problem
from trajopt.planners.kinematics import BRANCHES, Robot, cartesian_problem

DATA = Path(__file__).parents[2] / "data"
SIX = Robot.from_toml(DATA / "kinematics/six-axis.toml")
TABLE2 = Problem.from_toml(DATA / "problems/six-axis.toml")
FREE = np.tile([-np.inf, np.inf], (6, 1))
INF = np.inf
PI = np.pi
QUARTER = np.pi / 2
UPPER_ARM = 0.7156
FOREARM = np.hypot(0.256, 0.8455)
AXIS_OFFSET = 0.0944
STRAIGHT_ELBOW = -np.arctan2(0.8455, 0.256)


def robot(a, alpha, d, theta=(0, 0, 0, 0, 0, 0)) -> Robot:
    """A robot of unlimited joints; `alpha` and `theta` in quarter turns."""
    twists = np.array(alpha) * QUARTER
    offsets = np.array(theta) * QUARTER
    return Robot(a, twists, d, offsets, FREE)


PUMA = robot(  # Craig's textbook; shoulder offset
    a=[0, 0, 0.4318, 0.0203, 0, 0],
    alpha=[0, -1, 0, -1, 1, -1],
    d=[0, 0, 0.1244, 0.4318, 0, 0],
)
OTHER_SIGNS = robot(
    a=[0.1, 0.15, 0.6, 0.12, 0, 0],
    alpha=[0.4, 1, 2, 1, -1, 3],
    d=[0.3, 0.05, -0.02, -0.5, 0, 0.1],
)
BACKWARDS = robot(
    a=[0, -0.2, -0.5, -0.1, 0, 0],
    alpha=[2, 1, 0, -1, -1, 1],
    d=[0, 0.1, 0, 0.4, 0, -0.2],
    theta=[1, 2, 3, 1, 2, 3],
)
EQUAL_LINKS = robot(
    a=[0, 0, 0.5, 0.3, 0, 0],
    alpha=[0, -1, 0, -1, 1, -1],
    d=[0, 0, 0, 0.4, 0, 0.1],
)
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


def difference(x, y):
    """Largest difference of angles modulo 2π."""
    turned = (np.asarray(x) - y + PI) % (2 * PI)
    return np.abs(turned - PI).max(axis=-1)


def miss(arm: Robot, joints, pose):
    """Largest entry by which the hand misses a pose."""
    error = arm.forward(joints) - pose
    return np.abs(error).max(axis=(-1, -2))


def at(x: float, y: float, z: float) -> np.ndarray:
    """A pose of the six-axis arm whose wrist centre is there; the hand's turn does not matter."""
    turn = Rotation.from_euler("xyz", [0.3, -1.1, 2.0])
    approach = turn.as_matrix()[:, 2]
    hand = np.array([x, y, z]) + 0.0838 * approach
    return RigidTransform.from_components(hand, turn).as_matrix()


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
    assert pose[:3, 3] == pytest.approx(
        [
            0.2 + 0.7156 + 0.256,
            -0.0944,
            -0.8455 - 0.0838,
        ]
    )
    np.testing.assert_allclose(
        pose[:3, :3],
        np.diag([1, -1, -1]),
        atol=1e-15,
    )


def test_a_robot_of_another_size_goes_forwards_only():
    two = Robot(
        [0, 1.0],
        [0, 0],
        [0, 0],
        [0, 0],
        [[-1, 1], [-1, 1]],
    )
    np.testing.assert_allclose(
        two.forward([QUARTER, 0.0])[:3, 3],
        [0, 1, 0],
        atol=1e-15,
    )
    with pytest.raises(InvalidInput, match="a is 2: expected six joints"):
        two.inverse(np.eye(4))


@every_robot
def test_round_trip_of_random_poses(arm):
    q = angles(1_000)
    poses = arm.forward(q)
    inverse = arm.inverse(poses)
    misses = miss(arm, inverse.joints, poses[:, None])
    assert misses[inverse.exists].max() < 1e-9
    own = difference(inverse.joints, q[:, None])
    assert np.where(inverse.exists, own, INF).min(axis=1).max() < 1e-7
    assert set(inverse.exists.sum(axis=-1)) <= {4, 8}
    assert not inverse.distance.any()


def test_the_branches_have_the_signs_they_are_named_by():
    q = SIX.inverse(SIX.forward(angles(1000))).joints
    assert (
        np.where(
            np.sin(q[..., 4]) >= 0,
            1,
            -1,
        )
        == BRANCHES[:, 2]
    ).all()


def test_any_batch_shape():
    poses = SIX.forward(angles(6).reshape(2, 3, 6))
    inverse = SIX.inverse(poses)
    alone = SIX.inverse(poses[1, 2])
    assert inverse.joints.shape == (2, 3, 8, 6)
    np.testing.assert_array_equal(inverse.joints[1, 2], alone.joints)
    assert alone.distance.shape == ()
    nothing = SIX.inverse(np.zeros((0, 4, 4)))
    assert nothing.joints.shape == (0, 8, 6)


# --- singularities ---


@pytest.mark.parametrize("kept", [0.0, 0.5, -1.2])
@pytest.mark.parametrize("q5", [0.0, 1e-12, PI])
def test_a_singular_wrist_keeps_the_previous_angle(kept, q5):
    q = np.array([0.4, -0.5, 0.3, 0.9, q5, -0.4])
    pose = SIX.forward(q)
    inverse = replace(SIX, joint_range=FREE).inverse(pose, [0, 0, 0, kept, 0, 0])
    own = np.abs(inverse.joints[:, :3] - q[:3]).max(axis=1) < 1e-9
    assert np.abs(inverse.joints[own, 3] - kept).min() < 1e-12
    assert miss(SIX, inverse.joints[inverse.exists], pose).max() < 1e-9


@pytest.mark.parametrize("away", [1e-4, 1e-8, 1e-10, 1e-13, 1e-15])
@every_robot
def test_near_a_singularity_every_branch_still_reaches(arm, away):
    q = angles(300, seed=1)
    straight = -np.arctan2(arm.d[3] * np.cos(arm.alpha[3] + QUARTER), arm.a[3])
    q[:200, 4] = away - arm.theta[4]
    q[100:, 2] = straight + away - arm.theta[2]
    poses = arm.forward(q)
    inverse = arm.inverse(poses, q)
    assert inverse.exists.any(axis=-1).all()
    assert np.isfinite(inverse.joints).all()
    assert (
        miss(
            arm,
            inverse.joints,
            poses[:, None],
        )[inverse.exists].max()
        < 1e-9
    )


@pytest.mark.parametrize("edge", [0.0, PI])
def test_a_stretched_or_folded_elbow_has_one_solution_twice(edge):
    q = [0.3, -0.4, edge + STRAIGHT_ELBOW, 0.7, 0.9, -0.8]
    inverse = SIX.inverse(SIX.forward(q))
    np.testing.assert_allclose(
        inverse.joints[:2],
        inverse.joints[2:4],
        atol=1e-12,
    )
    assert difference(inverse.joints[:4], q).min() < 1e-9


def test_a_wrist_centre_as_near_to_axis_1_as_it_gets():
    pose = at(AXIS_OFFSET, 0.0, 0.8)
    inverse = SIX.inverse(pose)
    np.testing.assert_allclose(
        inverse.joints[:4],
        inverse.joints[4:],
        atol=1e-9,
    )
    assert miss(SIX, inverse.joints, pose).max() < 1e-9


def test_a_wrist_centre_on_axis_1_keeps_the_previous_angle():
    arm = replace(
        SIX,
        d=SIX.d * [1, 1, 0, 1, 1, 1],
        joint_range=FREE,
    )
    pose = at(0.0, 0.0, 0.8)
    inverse = arm.inverse(pose, [0.6, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(inverse.joints[:4, 0], 0.6)
    assert miss(arm, inverse.joints, pose).max() < 1e-9


def test_a_wrist_centre_on_axis_2_keeps_the_previous_angle():
    folded = PI - np.arctan2(0.4, 0.3)
    q = [0.0, 0.7, folded, 0.3, 0.4, 0.5]
    pose = EQUAL_LINKS.forward(q)
    inverse = EQUAL_LINKS.inverse(pose, [0.0, 0.7, 0, 0, 0, 0])
    assert difference(inverse.joints, q).min() < 1e-9
    assert miss(EQUAL_LINKS, inverse.joints, pose).max() < 1e-9


# --- out of reach ---


@pytest.mark.parametrize("beyond", [1e-9, 1e-3, 1.0, 1e6, 1e100])
def test_too_far_says_how_far(beyond):
    above_shoulder = np.hypot(AXIS_OFFSET, 0.2)
    inverse = SIX.inverse(at(above_shoulder, 0.0, UPPER_ARM + FOREARM + beyond))
    assert not inverse.exists.any()
    assert not inverse.in_range.any()
    assert inverse.distance == pytest.approx(beyond, rel=1e-6)
    assert np.isfinite(inverse.joints).all()


@pytest.mark.parametrize("r", [0.0, 0.03, 0.0943])
def test_too_near_to_axis_1_says_how_far(r):
    inverse = SIX.inverse(at(r, 0.0, 1.0))
    assert not inverse.exists.any()
    assert inverse.distance == pytest.approx(AXIS_OFFSET - r)


def test_a_pose_too_near_forwards_is_reached_over_the_back():
    pose = at(np.hypot(AXIS_OFFSET, 0.2), 0.0, 0.1)
    inverse = SIX.inverse(pose)
    np.testing.assert_array_equal(inverse.exists, [False] * 4 + [True] * 4)
    assert inverse.distance == 0
    assert miss(SIX, inverse.joints[4:], pose).max() < 1e-9


# --- joint ranges ---


def test_of_angles_a_turn_apart_the_one_in_range_nearest_to_the_previous_is_taken():
    wide = replace(SIX, joint_range=np.tile([-10.0, 10.0], (6, 1)))
    turned = np.array(
        [
            0.2,
            -0.3,
            0.4,
            0.5,
            0.6,
            0.7 + 2 * PI,
        ]
    )
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
    poses = SIX.forward(TABLE2.waypoints)
    again = SIX.nearest(poses, TABLE2.waypoints)
    assert np.degrees(np.abs(again - TABLE2.waypoints).max()) < 0.5e-3


def test_following_the_nearest_branch_keeps_joint_4_where_the_paper_turned_it():
    """Point 2 has a singular wrist: its pose fixes θ4 + θ6 = 30° alone."""
    poses = SIX.forward(TABLE2.waypoints)
    problem = cartesian_problem(SIX, poses, TABLE2.limits)
    expected = np.degrees(TABLE2.waypoints)
    expected[1, 3] = 0.0
    expected[1, 5] = 30.0
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
    far = np.concatenate(
        [
            good[:2],
            at(5.0, 0, 0)[None],
        ]
    )
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
        SIX.inverse(wrong)
    assert "\n" not in str(caught.value)


def test_a_wrong_pose_among_many_is_named():
    with pytest.raises(InvalidInput, match=r"^pose 2 is"):
        SIX.inverse(
            np.stack(
                [
                    np.eye(4),
                    np.zeros((4, 4)),
                ]
            )
        )


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


@pytest.mark.parametrize(
    ("key", "joint", "value", "message"),
    [
        ("alpha", 1, 0.0, "alpha, joint 2 is 0.0: expected ±pi/2"),
        ("alpha", 2, QUARTER, "alpha, joint 3 is 1.57.*: expected 0 or ±pi"),
        ("a", 4, 0.01, "a, joint 5 is 0.01: expected 0, as the last three axes meet"),
        ("d", 4, -0.01, "d, joint 5 is -0.01"),
        ("a", 2, 0.0, "a, joint 3 is 0.0: expected not 0"),
    ],
)
def test_an_arm_of_another_family_has_no_analytic_inverse(key, joint, value, message):
    column = getattr(SIX, key).copy()
    column[joint] = value
    arm = replace(SIX, **{key: column})
    assert arm.forward(np.zeros(6)).shape == (4, 4)
    with pytest.raises(InvalidInput, match=message):
        arm.inverse(np.eye(4))


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
    with pytest.raises(InvalidInput, match=r"nowhere\.toml: robot is 'No such file"):
        Robot.from_toml(tmp_path / "nowhere.toml")
    with pytest.raises(InvalidInput, match="expected a readable TOML file"):
        read(tmp_path, a="[0, 1")
