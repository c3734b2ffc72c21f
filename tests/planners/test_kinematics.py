"""Forward kinematics against Pinocchio, the inverse by round trip, and every way to fail."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from time import perf_counter

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
INF, PI, H = np.inf, np.pi, np.pi / 2
UPPER, FORE = 0.7156, np.hypot(0.256, 0.8455)
SHOULDER, ELBOW, WRIST = range(3)  # columns of `singular`


def robot(a, alpha, d, theta=(0, 0, 0, 0, 0, 0), joint_range=FREE) -> Robot:
    return Robot(a, np.array(alpha) * H, d, np.array(theta) * H, joint_range)


ROBOTS = {
    "six-axis": SIX,
    "puma-560": robot(  # Craig's textbook; shoulder offset
        [0, 0, 0.4318, 0.0203, 0, 0], [0, -1, 0, -1, 1, -1], [0, 0, 0.1244, 0.4318, 0, 0]
    ),
    "irb-120": robot(
        [0, 0, 0.27, 0.07, 0, 0],
        [0, -1, 0, -1, 1, -1],
        [0.29, 0, 0, 0.302, 0, 0.072],
        [0, -1, 0, 0, 0, 2],
        np.radians([[-165, 165], [-110, 110], [-110, 70], [-160, 160], [-120, 120], [-400, 400]]),
    ),
    "other signs": robot(
        [0.1, 0.15, 0.6, 0.12, 0, 0], [0.4, 1, 2, 1, -1, 3], [0.3, 0.05, -0.02, -0.5, 0, 0.1]
    ),
    "backwards": robot(
        [0, -0.2, -0.5, -0.1, 0, 0], [2, 1, 0, -1, -1, 1], [0, 0.1, 0, 0.4, 0, -0.2], [1, 2, 3] * 2
    ),
    "equal links": robot([0, 0, 0.5, 0.3, 0, 0], [0, -1, 0, -1, 1, -1], [0, 0, 0, 0.4, 0, 0.1]),
}
every_robot = pytest.mark.parametrize("arm", ROBOTS.values(), ids=ROBOTS)


def angles(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-PI, PI, (count, 6))


def apart(x, y):
    """Largest difference of angles modulo 2π."""
    return np.abs((np.asarray(x) - y + PI) % (2 * PI) - PI).max(axis=-1)


def miss(arm: Robot, joints, pose):
    return np.abs(arm.forward(joints) - pose).max(axis=(-1, -2))


def at(x: float, y: float, z: float) -> np.ndarray:
    """A pose of the six-axis arm whose wrist centre is there, the hand turned anyhow."""
    turn = Rotation.from_euler("xyz", [0.3, -1.1, 2.0])
    hand = np.array([x, y, z]) + 0.0838 * turn.as_matrix()[:, 2]
    return RigidTransform.from_components(hand, turn).as_matrix()


def pinocchio_model(arm: Robot) -> pinocchio.Model:
    """Each joint turns about z where `Rx(α) Tx(a) Tz(d) Rz(θ)` put it."""
    model, parent = pinocchio.Model(), 0
    for i, (a, alpha, d, theta) in enumerate(zip(arm.a, arm.alpha, arm.d, arm.theta, strict=True)):
        twist = pinocchio.SE3(pinocchio.exp3(np.array([alpha, 0.0, 0.0])), np.zeros(3))
        shift = pinocchio.SE3(np.eye(3), np.array([a, 0.0, d]))
        turn = pinocchio.SE3(pinocchio.exp3(np.array([0.0, 0.0, theta])), np.zeros(3))
        placement = twist * shift * turn
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"joint {i + 1}")
    return model


@every_robot
def test_forward_and_jacobian_agree_with_pinocchio(arm):
    model = pinocchio_model(arm)
    data, frame = model.createData(), pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    q = angles(100)
    for posture, frames, jacobian in zip(q, arm.frames(q), arm.jacobian(q), strict=True):
        pinocchio.computeJointJacobians(model, data, posture)
        links = np.array([link.homogeneous for link in data.oMi])
        np.testing.assert_allclose(frames, links, atol=1e-13)
        expected = pinocchio.getJointJacobian(model, data, 6, frame)
        np.testing.assert_allclose(jacobian, expected, atol=1e-13)


def test_the_zero_pose_of_table_1():
    pose = SIX.forward(np.zeros(6))
    assert pose[:3, 3] == pytest.approx([0.2 + 0.7156 + 0.256, -0.0944, -0.8455 - 0.0838])
    np.testing.assert_allclose(pose[:3, :3], np.diag([1, -1, -1]), atol=1e-15)


def test_jacobian_is_the_derivative_of_forward():
    q, step = angles(200), 1e-6
    poses, jacobian = SIX.forward(q), SIX.jacobian(q)
    for joint, e in enumerate(np.eye(6) * step):
        slope = (SIX.forward(q + e) - SIX.forward(q - e)) / (2 * step)
        spin = slope[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2)
        np.testing.assert_allclose(jacobian[:, :3, joint], slope[:, :3, 3], atol=1e-9)
        turning = spin[:, [2, 0, 1], [1, 2, 0]]
        np.testing.assert_allclose(jacobian[:, 3:, joint], turning, atol=1e-9)


def test_a_robot_of_another_size_goes_forwards_only():
    two = Robot([0, 1.0], [0, 0], [0, 0], [0, 0], [[-1, 1], [-1, 1]])
    assert two.frames([H, 0.0]).shape == (3, 4, 4)
    np.testing.assert_allclose(two.forward([H, 0.0])[:3, 3], [0, 1, 0], atol=1e-15)
    assert two.jacobian(np.zeros((4, 3, 2))).shape == (4, 3, 6, 2)
    with pytest.raises(InvalidInput, match="a is 2: expected six joints"):
        two.inverse(np.eye(4))


@every_robot
def test_round_trip_of_2_000_random_poses(arm):
    q = angles(2_000)
    poses = arm.forward(q)
    inverse = arm.inverse(poses)
    assert inverse.exists.any(axis=-1).all()
    assert not inverse.distance.any()
    assert miss(arm, inverse.joints, poses[:, None])[inverse.exists].max() < 1e-9
    assert np.where(inverse.exists, apart(inverse.joints, q[:, None]), INF).min(1).max() < 1e-7
    assert set(inverse.exists.sum(axis=-1)) <= {4, 8}
    for i in range(8):
        for j in range(i):
            both = inverse.exists[:, i] & inverse.exists[:, j]
            assert apart(inverse.joints[both, i], inverse.joints[both, j]).min() > 1e-6
    assert not inverse.singular.any()


def test_most_poses_of_an_arm_without_a_base_offset_have_eight_branches():
    puma = ROBOTS["puma-560"]
    assert puma.inverse(puma.forward(angles(100))).exists.all()


def test_branches_come_in_their_order():
    q = SIX.inverse(SIX.forward(angles(1000))).joints
    wrist_sign = np.sign(np.sin(q[..., 4]))
    assert (wrist_sign == BRANCHES[:, 2]).all()
    bend = np.sin(q[..., 2] + np.arctan2(0.8455, 0.256))
    assert (np.sign(bend) == BRANCHES[:, 1])[np.abs(bend) > 1e-9].all()


def test_10_000_inverse_solutions_in_well_under_a_second():
    poses = SIX.forward(angles(10_000))
    start = perf_counter()
    SIX.inverse(poses)
    assert perf_counter() - start < 1.0


def test_any_batch_shape():
    poses = SIX.forward(angles(6).reshape(2, 3, 6))
    inverse, alone = SIX.inverse(poses), SIX.inverse(poses[1, 2])
    assert inverse.joints.shape == (2, 3, 8, 6)
    assert inverse.singular.shape == (2, 3, 8, 3)
    np.testing.assert_array_equal(inverse.joints[1, 2], alone.joints)
    assert alone.distance.shape == ()
    nothing = SIX.inverse(np.zeros((0, 4, 4)))
    assert (nothing.joints.shape, nothing.exists.shape) == ((0, 8, 6), (0, 8))
    postures = np.zeros((5, 6))
    many = replace(SIX, joint_range=FREE).nearest(poses[1, 2], postures)
    assert many.shape == (5, 6)
    assert SIX.inverse(poses[1, 2], postures).exists.shape == (5, 8)


# Singularities


@pytest.mark.parametrize("kept", [0.0, 0.5, -1.2])
@pytest.mark.parametrize("q5", [0.0, 1e-12, PI])
def test_a_singular_wrist_keeps_the_previous_angle(kept, q5):
    q = np.array([0.4, -0.5, 0.3, 0.9, q5, -0.4])
    inverse = replace(SIX, joint_range=FREE).inverse(SIX.forward(q), [0, 0, 0, kept, 0, 0])
    assert inverse.singular[..., WRIST].any()
    own = np.abs(inverse.joints[:, :3] - q[:3]).max(axis=1) < 1e-9
    assert inverse.singular[own, WRIST].all()
    assert np.abs(inverse.joints[own, 3] - kept).min() < 1e-12
    turned = 0.9 - 0.4 if q5 < 1 else 0.9 + 0.4  # what a singular wrist's pose tells: θ4 ± θ6
    found = inverse.joints[own, 3] + inverse.joints[own, 5] * (1 if q5 < 1 else -1)
    assert apart(found[:, None], turned).max() < 1e-9
    assert miss(SIX, inverse.joints[inverse.exists], SIX.forward(q)).max() < 1e-9


@pytest.mark.parametrize("away", [1e-4, 1e-6, 1e-8, 1e-9, 1e-10, 1e-11, 1e-13, 1e-15])
@every_robot
def test_near_a_singularity_every_branch_still_reaches(arm, away):
    q = angles(300, seed=1)
    straight = -np.arctan2(arm.d[3] * np.cos(arm.alpha[3] + H), arm.a[3])
    q[:100, 4] = away - arm.theta[4]
    q[100:200, 2] = straight + away - arm.theta[2]
    q[200:, 4], q[200:, 2] = away - arm.theta[4], straight + away - arm.theta[2]
    poses = arm.forward(q)
    inverse = arm.inverse(poses, q)
    assert inverse.exists.any(axis=-1).all()
    assert np.isfinite(inverse.joints).all()
    assert miss(arm, inverse.joints, poses[:, None])[inverse.exists].max() < 1e-9


def test_near_a_singularity_angles_lose_only_what_they_must():
    for away in (1e-2, 1e-4, 1e-5):
        for joint, value in ((4, away), (2, away - np.arctan2(0.8455, 0.256))):
            q = np.array([0.3, -0.4, 0.2, 0.7, 0.9, -0.8])
            q[joint] = value
            inverse = SIX.inverse(SIX.forward(q))
            assert np.abs(inverse.joints - q).max(axis=-1).min() < 1e-14 / away


@pytest.mark.parametrize(("edge", "reach"), [(0.0, UPPER + FORE), (PI, FORE - UPPER)])
def test_a_stretched_or_folded_elbow_has_one_solution_twice(edge, reach):
    q = [0.3, -0.4, edge - np.arctan2(0.8455, 0.256), 0.7, 0.9, -0.8]
    inverse = SIX.inverse(pose := SIX.forward(q))
    x, z = pose[:3, 3] @ [np.cos(0.3), np.sin(0.3), 0], pose[2, 3]
    towards = pose[:3, 2] @ [np.cos(0.3), np.sin(0.3), 0]
    rho = np.hypot(x - 0.0838 * towards - 0.2, z - 0.0838 * pose[2, 2])
    assert rho == pytest.approx(reach, abs=1e-12)
    found = inverse.singular[..., ELBOW]
    np.testing.assert_array_equal(found, [True] * 4 + [False] * 4)
    np.testing.assert_allclose(inverse.joints[:2], inverse.joints[2:4], atol=1e-12)
    assert apart(inverse.joints[:4], q).min() < 1e-9


def test_a_wrist_centre_as_near_to_axis_1_as_it_gets():
    inverse = SIX.inverse(pose := at(0.0944, 0.0, 0.8))
    found = inverse.exists & inverse.singular[..., SHOULDER]
    assert found.all()
    np.testing.assert_allclose(inverse.joints[:4], inverse.joints[4:], atol=1e-9)
    assert miss(SIX, inverse.joints, pose).max() < 1e-9


def test_a_wrist_centre_on_axis_1_keeps_the_previous_angle():
    arm = replace(SIX, d=SIX.d * [1, 1, 0, 1, 1, 1], joint_range=FREE)
    inverse = arm.inverse(pose := at(0.0, 0.0, 0.8), [0.6, 0, 0, 0, 0, 0])
    assert inverse.singular[..., SHOULDER].all()
    np.testing.assert_allclose(inverse.joints[:4, 0], 0.6)
    assert apart(inverse.joints[4:, :1], 0.6 + PI).max() < 1e-12
    assert miss(arm, inverse.joints, pose).max() < 1e-9


def test_a_wrist_centre_on_axis_2_keeps_the_previous_angle():
    arm = ROBOTS["equal links"]
    q = [0.0, 0.7, PI - np.arctan2(0.4, 0.3), 0.3, 0.4, 0.5]
    inverse = arm.inverse(pose := arm.forward(q), [0.0, 0.7, 0, 0, 0, 0])
    assert inverse.exists.all()
    assert inverse.singular[..., :2].all()
    assert apart(inverse.joints, q).min() < 1e-9
    assert miss(arm, inverse.joints, pose).max() < 1e-9


# Unreachable


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e6, 1e100])
def test_too_far_says_how_far(scale):
    straight_up = np.hypot(0.0944, 0.2)  # over the base's own circle: past the arm by `scale`
    inverse = SIX.inverse(at(straight_up, 0.0, UPPER + FORE + scale))
    assert not inverse.exists.any()
    assert not inverse.in_range.any()
    assert inverse.distance == pytest.approx(scale, rel=1e-6)
    assert np.isfinite(inverse.joints).all()


@pytest.mark.parametrize("inside", [1e-6, 0.01, FORE - UPPER])
def test_too_near_to_the_elbow_says_how_far(inside):
    arm = replace(SIX, a=SIX.a * [1, 0, 1, 1, 1, 1])  # shoulder at the axis: no way round the back
    inverse = arm.inverse(at(0.0944, 0.0, FORE - UPPER - inside))
    assert not inverse.exists.any()
    assert inverse.distance == pytest.approx(inside, rel=1e-6)


def test_what_is_too_near_forwards_is_reached_over_the_back():
    inverse = SIX.inverse(pose := at(np.hypot(0.0944, 0.2), 0.0, 0.1))
    np.testing.assert_array_equal(inverse.exists, [False] * 4 + [True] * 4)
    assert inverse.distance == 0
    assert miss(SIX, inverse.joints[4:], pose).max() < 1e-9


@pytest.mark.parametrize("r", [0.0, 0.03, 0.0943])
def test_too_near_to_axis_1_says_how_far(r):
    inverse = SIX.inverse(at(r, 0.0, 1.0))
    assert not inverse.exists.any()
    assert inverse.distance == pytest.approx(0.0944 - r)


def test_the_distance_bounds_the_way_to_the_nearest_wrist_centre():
    rng = np.random.default_rng(3)
    centres = rng.uniform(-3, 3, (100, 3))
    inverse = SIX.inverse(np.array([at(*c) for c in centres]))
    turn = np.linspace(0, 2 * PI, 50_001)
    for c, exists, distance in zip(centres, inverse.exists, inverse.distance, strict=True):
        outer = [0.2 + (UPPER + FORE) * np.cos(turn), -0.0944, (UPPER + FORE) * np.sin(turn)]
        r = np.hypot(outer[0], outer[1])
        nearest = np.hypot(r - np.hypot(*c[:2]), outer[2] - c[2]).min()
        if not exists.any() and np.linalg.norm(c) > 1:
            assert nearest - 1e-5 <= distance <= nearest * 1.002 + 1e-5


# Ranges


def test_angles_take_the_turn_in_range_nearest_to_the_previous():
    wide = replace(SIX, joint_range=np.array([[-10, 10]] * 5 + [[2.0, 2.0 + 2 * PI]]))
    q = np.array([0.3, -0.4, 0.2, 0.7, 0.9, -0.8])
    pose = SIX.forward(q)
    turned = q + 2 * PI * np.array([1, -1, 1, 0, -1, 1])
    np.testing.assert_allclose(wide.nearest(pose, turned + 0.1), turned, atol=1e-9)
    assert np.abs(wide.inverse(pose).joints[..., :5]).max() <= PI
    narrow = replace(SIX, joint_range=np.tile([3.5, 3.6], (6, 1)))
    inverse = narrow.inverse(pose)
    assert not inverse.in_range.any()
    off = np.maximum(3.5 - inverse.joints, inverse.joints - 3.6)
    assert off.max() < PI


def test_in_range_is_what_it_says():
    q = angles(2000)
    inverse = SIX.inverse(SIX.forward(q))
    low, high = SIX.joint_range.T
    inside = ((inverse.joints >= low) & (inverse.joints <= high)).all(axis=-1)
    np.testing.assert_array_equal(inverse.in_range, inverse.exists & inside)
    assert 0 < inverse.in_range.sum() < 2000
    own = np.random.default_rng(0).uniform(low, high, (2000, 6))
    inverse = SIX.inverse(SIX.forward(own), own)
    hit = inverse.in_range & (np.abs(inverse.joints - own[:, None]).max(axis=-1) < 1e-8)
    assert hit.any(axis=-1).all()


def test_the_ends_of_the_range_are_in_it():
    low, high = SIX.joint_range.T
    rng = np.random.default_rng(4)
    inner = rng.uniform(low, high, (200, 6))
    q = np.where(rng.uniform(size=(200, 6)) < 0.3, np.where(inner < 0, low, high), inner)
    found = SIX.nearest(SIX.forward(q), q)
    np.testing.assert_allclose(found, q, atol=1e-9)
    assert ((low <= found) & (found <= high)).all()  # exactly, so that `Problem` takes them


def test_nearest_is_the_nearest_in_range():
    rng = np.random.default_rng(2)
    own, posture = rng.uniform(*SIX.joint_range.T, (2, 500, 6))
    chosen = SIX.nearest(poses := SIX.forward(own), posture)
    assert miss(SIX, chosen, poses).max() < 1e-9
    inverse = SIX.inverse(poses, posture)
    for pose in range(500):
        lengths = [
            np.linalg.norm(q - posture[pose])
            for q, fits in zip(inverse.joints[pose], inverse.in_range[pose], strict=True)
            if fits
        ]
        assert np.linalg.norm(chosen[pose] - posture[pose]) == pytest.approx(min(lengths))
    np.testing.assert_allclose(SIX.nearest(poses, own), own, atol=1e-7)


def test_nearest_says_what_is_out_of_reach_or_range():
    poses = np.stack([SIX.forward(np.zeros(6)), at(9.0, 0, 0), at(8.0, 0, 0)])
    with pytest.raises(InvalidInput, match=r"pose 2, metres outside of .* reach is 7\.2") as caught:
        SIX.nearest(poses)
    assert caught.value.value == pytest.approx(
        np.sqrt(81 - 0.0944**2) - 0.2 - UPPER - FORE, rel=1e-3
    )
    rest = np.array([0, 0, 0, 1.0, 0])  # all but joint 1 tightly around one branch
    around = np.c_[rest - 0.01, rest + 0.01]
    arm = replace(SIX, joint_range=np.vstack([[-2.6, 3.0], around]))
    with pytest.raises(
        InvalidInput, match=r"pose, .* joint 1 is -2\.9.* \[-2\.6, 3\] rad"
    ) as caught:
        arm.nearest(SIX.forward([-2.9, *rest]), [-2.6, *rest])
    assert (caught.value.joint, caught.value.value) == (0, pytest.approx(-2.9))


# From a Cartesian path to a problem


def test_table_2_comes_back_from_its_own_poses():
    poses = SIX.forward(TABLE2.waypoints)
    again = SIX.nearest(poses, TABLE2.waypoints)
    assert np.degrees(np.abs(again - TABLE2.waypoints).max()) < 0.5e-3
    inverse = SIX.inverse(poses, TABLE2.waypoints)
    assert inverse.singular[..., WRIST].any(axis=-1).tolist() == [
        True,
        True,
        False,
        False,
    ]


def test_following_the_nearest_branch_keeps_joint_4_where_the_paper_turned_it():
    """Point 2 has a singular wrist, so its pose says θ4 + θ6 = 30° and nothing of either."""
    poses = SIX.forward(TABLE2.waypoints)
    problem = cartesian_problem(SIX, poses, TABLE2.limits)
    expected = np.degrees(TABLE2.waypoints)
    expected[1, 3], expected[1, 5] = 0.0, 30.0
    np.testing.assert_allclose(np.degrees(problem.waypoints), expected, atol=1e-8)
    assert problem.name == "six-axis"
    assert problem.limits is TABLE2.limits


def test_a_path_is_followed_without_jumps():
    rng = np.random.default_rng(7)
    start, *knots = rng.uniform(*SIX.joint_range.T * 0.6, (4, 6))
    line = np.concatenate(
        [np.linspace(a, b, 50)[1:] for a, b in zip([start, *knots], knots, strict=False)]
    )
    transforms = RigidTransform.from_matrix(SIX.forward(line))
    problem = cartesian_problem(SIX, transforms, TABLE2.limits, start, name="line")
    np.testing.assert_allclose(problem.waypoints, line, atol=1e-7)
    assert problem.name == "line"


def test_a_path_that_cannot_be_followed_names_its_pose():
    good = SIX.forward(TABLE2.waypoints)
    far = np.concatenate([good[:2], at(5.0, 0, 0)[None]])
    with pytest.raises(InvalidInput, match="pose 3, metres outside"):
        cartesian_problem(SIX, far, TABLE2.limits)
    with pytest.raises(InvalidInput, match="start, joint 2 is nan"):
        cartesian_problem(SIX, good, TABLE2.limits, [0, np.nan, 0, 0, 0, 0])
    with pytest.raises(InvalidInput, match="at least two rows"):
        cartesian_problem(SIX, good[:1], TABLE2.limits)
    with pytest.raises(InvalidInput, match="6 values"):
        cartesian_problem(SIX, good, Limits([1.0], [1.0]))


# Misuse


WRONG_POSES = {
    "mirrored": np.diag([1.0, 1, -1, 1]),
    "scaled": np.diag([1.001, 1, 1, 1]),
    "zero": np.zeros((4, 4)),
    "huge": np.diag([1e300, 1, 1, 1]),
    "NaN": np.diag([np.nan, 1, 1, 1]),
    "at infinity": np.eye(4) + np.array([[0, 0, 0, INF], *np.zeros((3, 4))]),
    "projective": np.eye(4) + np.array([*np.zeros((3, 4)), [0, 0, 1, 0]]),
    "3 x 3": np.eye(3),
    "text": "up",
    "ragged": [[1, 2], [3]],
    "none": None,
}


@pytest.mark.parametrize("wrong", WRONG_POSES.values(), ids=WRONG_POSES)
def test_what_is_no_pose_is_refused(wrong):
    with pytest.raises(InvalidInput, match=r"^pose.*: expected a finite 4 x 4") as caught:
        SIX.inverse(wrong)
    assert "\n" not in str(caught.value)


def test_a_wrong_pose_among_many_is_named():
    with pytest.raises(InvalidInput, match=r"^pose 2 is"):
        SIX.inverse(np.stack([np.eye(4), np.zeros((4, 4))]))


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([0] * 5, "q is .*expected 6 finite angles"),
        (0.0, "q is 0.0: expected 6"),
        ("home", "q is 'home'"),
        ([[0, 0, 0, 0, 0, np.nan]], "q, joint 6 is nan"),
        ([0, INF, 0, 0, 0, 0], "q, joint 2 is inf"),
        ([True] * 6, "q is "),
    ],
)
def test_wrong_angles_are_refused(q, message):
    with pytest.raises(InvalidInput, match=message):
        SIX.forward(q)


FAMILY = [
    ("alpha", 1, 0.0, "alpha, joint 2 is 0.0: expected ±pi/2"),
    ("alpha", 2, H, "alpha, joint 3 is 1.57.*: expected 0 or ±pi"),
    ("alpha", 4, 1.5708, "alpha, joint 5 is 1.5708: expected ±pi/2"),
    ("a", 4, 0.01, "a, joint 5 is 0.01: expected 0, as the last three axes meet"),
    ("a", 5, 0.01, "a, joint 6 is 0.01"),
    ("d", 4, -0.01, "d, joint 5 is -0.01"),
    ("a", 2, 0.0, "a, joint 3 is 0.0: expected not 0"),
]


@pytest.mark.parametrize(("key", "joint", "value", "message"), FAMILY)
def test_an_arm_of_another_family_has_no_analytic_inverse(key, joint, value, message):
    column = getattr(SIX, key).copy()
    column[joint] = value
    arm = replace(SIX, **{key: column})
    assert arm.forward(np.zeros(6)).shape == (4, 4)
    with pytest.raises(InvalidInput, match=message):
        arm.inverse(np.eye(4))


def test_an_elbow_without_a_forearm_is_refused():
    arm = replace(SIX, a=SIX.a * [1, 1, 1, 0, 1, 1], d=SIX.d * [1, 1, 1, 0, 1, 1])
    with pytest.raises(InvalidInput, match=r"d, joint 4 is 0\.0: expected not 0"):
        arm.inverse(np.eye(4))


# Robot files

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


def read(tmp_path: Path, **changes: str | None) -> Robot:
    file = tmp_path / "given.toml"
    lines = [f"{key} = {value}" for key, value in (PLAIN | changes).items() if value is not None]
    file.write_text("\n".join(lines))
    return Robot.from_toml(file)


def test_a_robot_file_is_read_in_radians_and_frozen(tmp_path):
    arm = read(tmp_path, name=None, source=None)
    assert (arm.name, arm.source, arm.joints) == ("given", "", 2)
    np.testing.assert_allclose(arm.alpha, [0, -H])
    np.testing.assert_allclose(arm.theta, [0, PI])
    np.testing.assert_allclose(arm.joint_range, [[-H, PI], [-INF, INF]])
    np.testing.assert_array_equal(arm.d, [0.25, 0.5])
    np.testing.assert_array_equal(read(tmp_path, angle_unit='"rad"').alpha, [0, -90])
    with pytest.raises(ValueError, match="read-only"):
        arm.a[0] = 1.0
    given = np.zeros(2)
    Robot(given, given, given, given, [[-1, 1], [-1, 1]])
    given[0] = 1.0  # the caller's array is not taken over


REFUSED = [
    ({"speed": "1"}, "speed is 1: expected one of"),
    ({"theta": None}, "theta: expected this key"),
    ({"convention": None}, "convention: expected this key"),
    ({"convention": '"dh"'}, "convention is 'dh': expected \"modified-dh\""),
    ({"angle_unit": '"degrees"'}, 'angle_unit is \'degrees\': expected "deg" or "rad"'),
    ({"angle_unit": '["deg"]'}, "angle_unit is ['deg']"),
    ({"name": "5"}, "name is 5: expected a string"),
    ({"source": "[]"}, "source is []: expected a string"),
    ({"a": "[]"}, "a is []: expected one finite number per joint"),
    ({"a": "1.5"}, "a is 1.5: expected one finite number per joint"),
    ({"a": '"long"'}, "a is 'long': expected one finite number"),
    ({"a": "[0.0, '1.5']"}, "a, joint 2 is '1.5': expected one finite number"),
    ({"a": "[0.0, {}]"}, "a, joint 2 is {}: expected one finite number"),
    ({"a": f"[0, 1{'0' * 350}]"}, "a is [0, 1000"),
    ({"a": "[0.0, nan]"}, "a, joint 2 is nan: expected one finite number"),
    ({"alpha": "[-90.0, inf]"}, "alpha, joint 2 is inf: expected one finite number"),
    ({"alpha": "[[0], [-90]]"}, "alpha is [[0.0], [-90.0]]: expected one finite number"),
    ({"d": "[0.0]"}, "d is [0.0]: expected one finite number per joint of a"),
    ({"d": "[0.0, [1.0]]"}, "d is [0.0, [1.0]]: expected one finite number"),
    ({"d": "[0, 1979-05-27]"}, "d, joint 2 is datetime.date"),
    ({"theta": "[true, false]"}, "theta, joint 1 is True: expected one finite number"),
    ({"joint_range": "[[-90, 90]]"}, "joint_range is [[-90.0, 90.0]]: expected one [low, high]"),
    ({"joint_range": "[90, 90]"}, "joint_range is [90.0, 90.0]: expected one [low, high]"),
    ({"joint_range": "[[-90, 90], [9, -9]]"}, "joint_range, joint 2 is [9.0, -9.0]: expected one"),
    ({"joint_range": "[[-90, 90], [0, nan]]"}, "joint_range, joint 2 is [0.0, nan]"),
    ({"joint_range": "[[5, 5], [0, 1]]"}, "joint_range, joint 1 is [5.0, 5.0]"),
    ({"theta": "[0.0, true]"}, "theta, joint 2 is True"),
    ({"joint_range": "[[-90, 90], [0, '9']]"}, "joint_range, joint 2 is [0, '9']: expected one"),
    ({"joint_range": "[[5, 6], [0, 1, 2]]"}, "joint_range is [[5, 6], [0, 1, 2]]"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED)
def test_a_bad_file_is_refused_in_words_that_mend_it(tmp_path, changes, message):
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, **changes)
    assert f"given.toml: {message}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_none_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match=r"nowhere\.toml: robot is 'No such file"):
        Robot.from_toml(tmp_path / "nowhere.toml")
    with pytest.raises(InvalidInput, match="expected a readable TOML file"):
        read(tmp_path, a="[0, 1")
