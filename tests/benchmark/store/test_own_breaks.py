"""Trajectories joint by joint: what continues is left out, and comes back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trajopt import Trajectory
from trajopt.benchmark.store import own_breaks
from trajopt.benchmark.store.own_breaks import SAME_RTOL

# 1 rad from rest to rest at 1 rad/s²; a second joint that stays; a third that starts later.
BANG = (np.array([0.0, 1.0, 2.0]), np.array([[0.5, -0.5], [0.0, 1.0], [0.0, 0.5]]))
REST = (np.array([0.0, 2.0]), np.array([[0.2]]))
LATE = (np.array([0.0, 0.5, 2.0]), np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.3, 0.3]]))
BRIEF = {
    "waypoint_times": [0.0, 2.0],
    "joints": [
        [[0.0, 0.0, 0.5, 0.0, 0.0], [1.0, 0.0, -0.5]],
        [[0.0, 0.0, 0.0, 0.0, 0.2]],
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
    back = own_breaks.trajectory(own_breaks.table(own, SAME_RTOL))
    np.testing.assert_array_equal(back.breaks, own.breaks)
    np.testing.assert_allclose(back.coefficients, own.coefficients, rtol=1e-9, atol=1e-9)
    exact = own_breaks.trajectory(own_breaks.table(own))
    np.testing.assert_array_equal(exact.coefficients, own.coefficients)


def test_what_was_read_is_written_bit_for_bit_in_as_few_numbers():
    """A third of a second is no binary fraction: pieces continue after rounding."""
    stretched = joined().dilated(1 / 3)
    brief = own_breaks.table(stretched, SAME_RTOL)
    own = own_breaks.trajectory(brief)
    again = own_breaks.table(own)
    assert json.dumps(again) == json.dumps(brief)
    back = own_breaks.trajectory(again)
    np.testing.assert_array_equal(back.coefficients, own.coefficients)


def test_a_break_where_nothing_changes_is_left_out():
    refined = joined().refined([0.1, 0.7, 1.3])
    assert own_breaks.table(refined, SAME_RTOL) == BRIEF


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_small_and_large_motions_alike(scale):
    own = joined()
    scaled = Trajectory(own.breaks, own.coefficients * scale, own.waypoint_times)
    brief = own_breaks.table(scaled, SAME_RTOL)
    back = own_breaks.trajectory(brief)
    t = np.linspace(0, 2, 41)
    np.testing.assert_allclose(back(t), scaled(t), rtol=0, atol=1e-12 * scale)
    assert sum(map(len, brief["joints"])) == 5


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
    "said",
    [
        None,
        {"joints": []},
        changed(["joints"], []),
        changed(["joints"], {}),
        changed(["waypoint_times"], [0.0]),
        changed(["waypoint_times"], [0.0, "x"]),
        changed(["waypoint_times"], [0.0, None]),
        changed(["waypoint_times"], [0.0, 10**400]),
        changed(["waypoint_times"], [0.5, 2.0]),
        changed(["joints", 0], []),
        changed(["joints", 0, 0], []),
        changed(["joints", 0, 0], [0.0]),
        changed(["joints", 0, 1], [1.0, *[1.0] * 6]),
        changed(["joints", 0, 1], [1.0, None]),
        changed(["joints", 0, 1], [1.0, "x"]),
        changed(["joints", 0, 1, 0], 0.0),
        changed(["joints", 0, 1, 0], 2.0),
        changed(["joints", 0, 0, 0], 0.1),
        changed(["joints", 1, 0], [0.0] * 200),
        changed(["joints"], [[[0, 1], *[[0.5, 1]] * 40_000]] * 40),
    ],
)
def test_what_is_wrong_is_refused(said):
    with pytest.raises((ValueError, TypeError, LookupError, OverflowError)):
        own_breaks.trajectory(said)
