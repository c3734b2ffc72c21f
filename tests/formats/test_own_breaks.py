"""Trajectories joint by joint: what continues is left out, and comes back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trajopt import Trajectory
from trajopt.core.exceptions import InvalidInput
from trajopt.formats import own_breaks
from trajopt.formats.motion import motion

# 1 rad from rest to rest at 1 rad/s²; a second joint that stays; a third that starts later.
BANG = (
    np.array([0.0, 1.0, 2.0]),
    np.array(
        [
            [0.5, -0.5],
            [0.0, 1.0],
            [0.0, 0.5],
        ]
    ),
)
REST = (np.array([0.0, 2.0]), np.array([[0.2]]))
LATE = (
    np.array([0.0, 0.5, 2.0]),
    np.array(
        [
            [0.0, 1.0],
            [0.0, 0.0],
            [0.0, 0.0],
            [0.3, 0.3],
        ]
    ),
)
BRIEF = {
    "waypoint_times": [0.0, 2.0],
    "joints": [
        [[0.0, 0.5, 0.0, 0.0], [1.0, -0.5]],
        [[0.0, 0.2]],
        [[0.0, 0.0, 0.0, 0.0, 0.3], [0.5, 1.0]],
    ],
}


def joined():
    return Trajectory.joined([BANG, REST, LATE], [0.0, 2.0])


def wild(seed, degree=5):
    """Polynomials that jump at every break."""
    rng = np.random.default_rng(seed)
    sums = np.cumsum(rng.exponential(size=6))
    breaks = np.append(0.0, sums)
    coefficients = rng.normal(size=(degree + 1, 6, 3))
    return Trajectory(breaks, coefficients, breaks[[0, 2, 6]])


def test_a_piece_says_only_what_changes():
    assert own_breaks.table(joined()) == BRIEF


def test_what_is_said_is_the_motion():
    back = own_breaks.trajectory(json.loads(json.dumps(BRIEF)))
    t = np.linspace(0, 2, 41)
    for order in range(4):
        expected = joined()(t, order)
        np.testing.assert_allclose(back(t, order), expected, rtol=0, atol=1e-15)
    assert back.waypoint_times.tolist() == [0, 2]


@pytest.mark.parametrize("degree", [0, 1, 3, 7])
def test_any_polynomials_come_back(degree):
    own = wild(degree, degree)
    back = own_breaks.trajectory(own_breaks.table(own))
    np.testing.assert_array_equal(back.breaks, own.breaks)
    np.testing.assert_allclose(back.coefficients, own.coefficients, rtol=1e-9, atol=1e-9)
    whole = own_breaks.trajectory(own_breaks.table(own, 0.0))
    np.testing.assert_array_equal(whole.coefficients, own.coefficients)


def test_a_break_where_nothing_changes_is_left_out():
    refined = joined().refined([0.1, 0.7, 1.3])
    assert own_breaks.table(refined) == BRIEF


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_small_and_large_motions_alike(scale):
    own = joined()
    scaled = Trajectory(own.breaks, own.coefficients * scale, own.waypoint_times)
    back = own_breaks.trajectory(own_breaks.table(scaled))
    t = np.linspace(0, 2, 41)
    np.testing.assert_allclose(back(t), scaled(t), rtol=0, atol=1e-12 * scale)
    found = sum(map(len, own_breaks.table(scaled)["joints"]))
    assert found == 5


def test_a_file_with_such_a_trajectory_is_a_motion(tmp_path):
    file = tmp_path / "m.json"
    file.write_text(json.dumps({"trajectory": BRIEF, "joint_names": ["a", "b", "c"]}))
    found = motion(file)
    assert found.interpolation == "polynomial"
    assert found.joint_names == ("a", "b", "c")
    assert found.trajectory(1.0)[0] == 0.5


def changed(path, value):
    """The table with one part replaced."""
    said = json.loads(json.dumps(BRIEF))
    *places, last = path
    part = said
    for place in places:
        part = part[place]
    part[last] = value
    return said


@pytest.mark.parametrize(
    ("said", "named"),
    [
        (None, "trajectory: expected an object with joints and waypoint_times"),
        ({"joints": []}, "trajectory: expected an object"),
        (changed(["joints"], []), "one or more joints"),
        (changed(["joints"], {}), "one or more joints"),
        (changed(["waypoint_times"], [0.0]), "two or more waypoint times"),
        (changed(["waypoint_times"], [0.0, "2"]), "waypoint_times is '2'"),
        (changed(["waypoint_times"], [0.0, float("nan")]), "waypoint_times is nan"),
        (changed(["waypoint_times"], [0.0, 10**400]), "waypoint_times"),
        (changed(["waypoint_times"], [0.5, 2.0]), "increasing times from 0"),
        (changed(["joints", 0], []), "joint 1: expected a list"),
        (changed(["joints", 0, 0], [0.0]), "piece 1, joint 1 is 0: expected from 1 to"),
        (changed(["joints", 0, 1], [1.0, 1.0, 1.0, 1.0, 1.0]), "piece 2, joint 1 is 4"),
        (changed(["joints", 0, 1], [1.0, True]), "piece 2, joint 1 is True"),
        (changed(["joints", 0, 1, 0], 0.0), "joints, joint 1: expected starts that rise"),
        (changed(["joints", 0, 1, 0], 2.0), "joints, joint 1: expected starts that rise"),
        (changed(["joints", 0, 0, 0], 0.1), "joints, joint 1: expected starts that rise"),
        (changed(["joints", 1, 0], [0.0] * 200), "at most degree 100"),
    ],
)
def test_what_is_wrong_is_named(said, named):
    with pytest.raises(InvalidInput) as error:
        own_breaks.trajectory(said)
    assert named in str(error.value)
