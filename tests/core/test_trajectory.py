"""Piecewise polynomials of time, against SciPy's."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.trajectory import Trajectory

reproducible = settings(deadline=None, derandomize=True, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


def random_trajectory(seed: int) -> Trajectory:
    """1–5 pieces of lengths 1e-3 to 1e2, degree 0–7, 1–4 joints."""
    rng = np.random.default_rng(seed)
    pieces = rng.integers(1, 6)
    degree = rng.integers(0, 8)
    joints = rng.integers(1, 5)
    lengths = 10.0 ** rng.uniform(-3, 2, pieces)
    steps = np.arange(degree, -1, -1)
    powers = steps[:, None]
    sizes = lengths**-powers  # so that every term counts
    drawn = rng.normal(size=(degree + 1, pieces, joints))
    coefficients = drawn * sizes[..., None]
    breaks = np.r_[0.0, np.cumsum(lengths)]
    return Trajectory(breaks, coefficients, breaks[[0, -1]])


@reproducible
@given(seeds)
def test_every_derivative_is_scipys(seed):
    trajectory = random_trajectory(seed)
    reference = PPoly(trajectory.coefficients, trajectory.breaks)
    rng = np.random.default_rng(seed)
    times = rng.uniform(0, trajectory.duration, (3, 4))
    times = np.append(times.ravel(), trajectory.breaks)
    for order in range(len(trajectory.coefficients) + 2):
        expected = reference(times, nu=order)
        found = trajectory(times, order)
        assert found.shape == (len(times), trajectory.joints)
        scale = np.abs(expected).max() + 1e-300
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * scale)


def ramp() -> Trajectory:
    """q = t on [0, 1], then 1 + 2 (t − 1) on [1, 3]."""
    return Trajectory([0, 1, 3], [[[1.0], [2.0]], [[0.0], [1.0]]], [0, 1, 3])


@pytest.mark.parametrize(
    ("time", "order", "value"),
    [(0.5, 0, 0.5), (2, 0, 3), (-7, 0, 0), (99, 0, 5), (1, 1, 2), (3, 1, 2), (-1, 1, 1), (2, 2, 0)],
)
def test_values_by_hand_with_times_outside_moved_to_the_ends(time, order, value):
    assert ramp()(time, order).tolist() == [value]
    found = ramp()([[time]], order).tolist()
    assert found == [[[value]]]


def test_duration_and_joints():
    assert (ramp().duration, ramp().joints) == (3.0, 1)


@reproducible
@given(seeds, st.floats(1e-3, 1e3))
def test_dilation_divides_the_nth_derivative_by_the_factors_nth_power(seed, factor):
    trajectory = random_trajectory(seed)
    slower = trajectory.dilated(factor)
    assert slower.duration == trajectory.duration * factor
    assert np.array_equal(slower.waypoint_times, trajectory.waypoint_times * factor)
    middle = 0.5 * (trajectory.breaks[1:] + trajectory.breaks[:-1])
    for order in range(4):
        expected = trajectory(middle, order) / factor**order
        scale = np.abs(expected).max() + 1e-300
        found = slower(middle * factor, order)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * scale)


@pytest.mark.parametrize("factor", [0, 0.0, -1, np.inf, np.nan])
def test_only_positive_dilations(factor):
    with pytest.raises(InvalidTrajectory, match="positive"):
        ramp().dilated(factor)


def part(seed: int, breaks, degree: int):
    """One joint: breaks and random coefficients `(degree + 1, pieces)`."""
    breaks = np.asarray(breaks, dtype=float)
    rng = np.random.default_rng(seed)
    return breaks, rng.normal(size=(degree + 1, len(breaks) - 1))


def alone(joint) -> Trajectory:
    breaks, coefficients = joint
    return Trajectory(breaks, coefficients[..., None], breaks[[0, -1]])


def test_joints_with_breaks_of_their_own_keep_their_values():
    own = part(1, [0, 0.5, 2.5, 4], 5)
    parts = [part(0, [0, 1, 4], 3), own, part(2, [0, 4], 0)]
    joined = Trajectory.joined(parts, [0, 2, 4])
    assert joined.breaks.tolist() == [0, 0.5, 1, 2, 2.5, 4]
    assert joined.coefficients.shape == (6, 5, 3)
    times = np.linspace(0, 4, 401)
    for order in range(6):
        expected = np.hstack([alone(p)(times, order) for p in parts])
        np.testing.assert_allclose(joined(times, order), expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("epsilon", [1e-16, -1e-16, 3e-16, -6e-15, 1.2e-14])
def test_breaks_that_rounding_split_are_one_break(epsilon):
    """The waypoint's own time counts; no piece as short as a rounding error remains."""
    own = part(0, [0, 1 + epsilon, 4 - epsilon], 3)
    parts = [own, part(1, [0, 1 - epsilon, 4], 3)]
    joined = Trajectory.joined(parts, [0, 1, 4])
    assert joined.breaks.tolist() == [0, 1, 4]
    times = np.array([0.3, 0.9999, 1.0001, 3.9])
    expected = np.hstack([alone(p)(times) for p in parts])
    np.testing.assert_allclose(joined(times), expected, rtol=0, atol=1e-11)


def test_breaks_farther_apart_than_rounding_stay_apart():
    own = part(0, [0, 1 + 1e-9, 4], 2)
    joined = Trajectory.joined([own, part(1, [0, 1, 4], 2)], [0, 4])
    expected = [0, 1, 1 + 1e-9, 4]
    assert joined.breaks.tolist() == expected
    middle = 1 + 0.5e-9
    expected = alone(part(0, [0, 1 + 1e-9, 4], 2))(middle)[0]
    found = joined(middle)[0]
    np.testing.assert_allclose(found, expected)


def test_a_short_piece_that_moves_is_kept():
    """Braking at 1e6 rad/s² for 1e-13 s: dropped, it would be a jump of velocity."""
    brake = 1e-13
    own = np.array([0.0, 1.0, 1.0 + brake, 2.0])
    v = 1e6 * brake
    coefficients = np.array([[0.0, -5e5, 0.0], [v, v, 0.0], [0.0, v, v + v * brake / 2]])
    joined = Trajectory.joined([(own, coefficients), part(1, [0, 1, 2], 2)], [0, 2])
    before = joined(1.0 - 1e-9, 1)[0]
    after = joined(1.0 + 1e-9, 1)[0]
    assert before == pytest.approx(v)
    assert after == 0
    assert joined(1.0 + brake / 2, 2)[0] == -1e6


def test_a_waypoint_passed_twice_in_no_time_joins():
    own = part(0, [0, 1, 2], 2)
    joined = Trajectory.joined([own], [0, 1, 1, 2])
    assert joined.breaks.tolist() == [0, 1, 2]
    assert joined.waypoint_times.tolist() == [0, 1, 1, 2]


@reproducible
@given(seeds)
def test_joining_random_joints_changes_no_value(seed):
    rng = np.random.default_rng(seed)
    duration = 10.0 ** rng.uniform(-2, 2)
    parts = []
    for joint in range(rng.integers(1, 5)):
        steps = np.arange(1, 100)
        inner = np.sort(rng.choice(steps, rng.integers(0, 6), replace=False))
        shares = np.r_[0, inner, 100] / 100 * duration
        degree = int(rng.integers(0, 6))
        breaks, coefficients = part(seed % 1000 + joint, shares, degree)
        parts.append((breaks, coefficients * duration ** -np.arange(degree, -1, -1.0)[:, None]))
    joined = Trajectory.joined(parts, [0, 0.123 * duration, duration])
    drawn = rng.integers(0, 100, 50)
    times = (drawn + 0.5) / 100 * duration
    expected = np.hstack([alone(p)(times) for p in parts])
    np.testing.assert_allclose(joined(times), expected, rtol=0, atol=1e-10)


ONE = np.zeros((2, 2, 3))


@pytest.mark.parametrize(
    ("breaks", "coefficients", "waypoint_times", "message"),
    [
        ([0, 1, np.nan], ONE, [0, 2], "breaks"),
        ([0, 1, np.inf], ONE, [0, 2], "breaks"),
        ([0, 1, 2], ONE * np.nan, [0, 2], "coefficients"),
        ([0, 1, 2], np.full_like(ONE, -np.inf), [0, 2], "coefficients"),
        ([0, 1, 2], ONE, [0, np.nan, 2], "waypoint_times"),
        ([0, 1, 1], ONE, [0, 1], "increasing"),
        ([0, 2, 1], ONE, [0, 1], "increasing"),
        ([1, 2, 3], ONE, [1, 3], "from 0"),
        ([0], ONE, [0, 1], "breaks"),
        (0.0, ONE, [0, 1], "breaks"),
        ([[0, 1, 2]], ONE, [0, 2], "breaks"),
        ([0, 1], ONE, [0, 1], "coefficients"),
        ([0, 1, 2], ONE[0], [0, 2], "coefficients"),
        ([0, 1, 2], ONE[:0], [0, 2], "coefficients"),
        ([0, 1, 2], ONE[..., :0], [0, 2], "coefficients"),
        ([0, 1, 2], ONE, [0, 1], "waypoint_times"),
        ([0, 1, 2], ONE, [0.1, 2], "waypoint_times"),
        ([0, 1, 2], ONE, [0, 1.5, 1, 2], "waypoint_times"),
        ([0, 1, 2], ONE, [2], "waypoint_times"),
        ([0, 1, 2], ONE, [], "waypoint_times"),
        ([0, 1, 2], ONE, 2.0, "waypoint_times"),
        ([0, 1, 2], ONE, [[0, 2], [0, 2]], "waypoint_times"),
        ([0, 1, 2], ONE, [[0, 1, 2], [0, 1, 2]], "waypoint_times"),
    ],
)
def test_arrays_that_do_not_fit_together(breaks, coefficients, waypoint_times, message):
    with pytest.raises(InvalidTrajectory, match=message):
        Trajectory(breaks, coefficients, waypoint_times)


@pytest.mark.parametrize("name", ["breaks", "coefficients", "waypoint_times"])
def test_nothing_can_be_changed(name):
    trajectory = ramp()
    with pytest.raises(ValueError, match="read-only"):
        getattr(trajectory, name)[0] = 5
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(trajectory, name, np.zeros(3))


def test_a_trajectory_keeps_copies():
    breaks = np.array([0.0, 1.0])
    times = np.array([0.0, 1.0])
    coefficients = np.ones((2, 1, 1))
    trajectory = Trajectory(breaks, coefficients, times)
    breaks[1] = 7
    times[1] = 7
    coefficients[:] = 7
    assert trajectory.duration == 1.0
    assert trajectory.waypoint_times[1] == 1.0
    assert trajectory(0.0).tolist() == [1.0]
    assert breaks.flags.writeable


@reproducible
@given(seeds)
def test_refining_changes_no_value(seed):
    trajectory = random_trajectory(seed)
    rng = np.random.default_rng(seed)
    times = rng.uniform(0, trajectory.duration, 3)
    refined = trajectory.refined([*times, 0.0, trajectory.duration, trajectory.breaks[-2]])
    assert set(refined.breaks) == {*trajectory.breaks, *times}
    probes = rng.uniform(0, trajectory.duration, 20)
    for order in range(3):
        expected = trajectory(probes, order)
        scale = np.abs(expected).max() + 1e-300
        np.testing.assert_allclose(refined(probes, order), expected, rtol=0, atol=1e-9 * scale)


def test_refining_within_rounding_of_a_break_adds_none():
    found = ramp().refined([1.0 + 2e-16, 3.0 - 4e-16, 0.0])
    assert found is not None
    found = ramp().refined([1.0 + 2e-16, 3.0 - 4e-16, 0.0]).breaks.tolist()
    assert found == [0, 1, 3]


def test_pieces_on_the_unit_interval():
    """Their derivatives are those by time: 1 rad/s, then 2 rad/s over 2 s."""
    assert ramp().pieces().tolist() == [[[1.0], [4.0]], [[0.0], [1.0]]]
    assert ramp().pieces(1).tolist() == [[[1.0], [2.0]]]
    assert ramp().pieces(2).tolist() == [[[0.0], [0.0]]]


LATE = Trajectory(
    breaks=[0.0, 1000.0, 1000.0 + 1e-9, 1000.5],
    coefficients=np.arange(1.0, 7.0).reshape(2, 3, 1),
    waypoint_times=[0.0, 1000.0, 1000.5],
    lengths=[1000.0, 1.00001e-9, 0.5 - 1.00001e-9],
)


def test_lengths_are_exact_where_breaks_round_them():
    """After 1000 s breaks are 1.1e-13 s apart: 1e-9 s is known to a ten-thousandth."""
    first, brief, last = LATE.lengths
    assert brief == 1.00001e-9
    unit = LATE.pieces()
    np.testing.assert_array_equal(unit[0, :, 0], [1.0 * first, 2.0 * brief, 3.0 * last])
    by_breaks = Trajectory(LATE.breaks, LATE.coefficients, LATE.waypoint_times)
    np.testing.assert_array_equal(by_breaks.lengths, np.diff(LATE.breaks))
    assert by_breaks.lengths[1] != brief


def test_lengths_stay_exact_in_whatever_is_made_of_a_trajectory():
    _, brief, _ = LATE.lengths
    assert LATE.dilated(3.0).lengths[1] == 3.0 * brief
    assert pickle.loads(pickle.dumps(LATE)).lengths[1] == brief
    # cut the first piece and the last one
    refined = LATE.refined([500.0, 1000.25])
    np.testing.assert_array_equal(refined.lengths[:3], [500.0, 500.0, brief])
    assert refined.lengths.sum() == pytest.approx(1000.5, rel=1e-15)
    beside = LATE.beside(np.array([7.0, 8.0]), np.array([False, True]))
    assert beside.lengths[1] == brief
    np.testing.assert_array_equal(beside(1000.3)[0], 7.0)
    np.testing.assert_array_equal(beside(1000.3)[1], LATE(1000.3)[0])


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        ([1.0], "2 times"),
        ([0.5, -0.5], "2 times above 0"),
        ([0.5, np.nan], "lengths"),
        (None, "lengths"),
        (0.5, "2 times"),
        # a piece would take time that the duration does not show
        ([0.5 + 1e-14, 0.5], "but for rounding"),
        ([0.5, 0.6], "but for rounding"),
    ],
)
def test_lengths_that_breaks_do_not_show(lengths, message):
    with pytest.raises(InvalidTrajectory, match=message):
        Trajectory([0.0, 0.5, 1.0], np.zeros((1, 2, 1)), [0.0, 1.0], lengths)


@pytest.mark.parametrize("shorter", [0.0, 7.9])
def test_a_piece_that_is_cut_close_to_its_end_has_two_parts(shorter):
    """Its length is less than its breaks say by as much as they may round."""
    eps = np.finfo(float).eps
    lengths = [0.5 - shorter * eps, 0.5]
    motion = Trajectory([0.0, 0.5, 1.0], np.ones((1, 2, 1)), [0.0, 1.0], lengths)
    parts = motion.refined([0.5 - 17 * eps]).lengths
    assert len(parts) == 3
    assert (parts > 0).all()


def test_rounding_of_many_lengths_adds_up_to_no_more_than_the_ends():
    """A thousand lengths, each longer than its breaks by a rounding unit of the duration."""
    breaks = np.arange(1001) / 1000
    lengths = np.diff(breaks) + 3e-15
    with pytest.raises(InvalidTrajectory, match="but for rounding"):
        Trajectory(breaks, np.zeros((1, 1000, 1)), [0.0, 1.0], lengths)


def test_segments_follow_one_another_and_keep_their_lengths():
    late = [1e-9, 2e-9]
    segments = [
        (np.array([1000.0]), np.array([[[1e-3]], [[0.0]]])),
        (np.array(late), np.array([[[2.0], [3.0]], [[1.0], [1.0 + 2e-9]]])),
        # too short to change the time: left out
        (np.array([1e-20, 1.0]), np.array([[[9.0], [0.0]], [[9.0], [4.0]]])),
    ]
    motion = Trajectory.of_segments(segments)
    np.testing.assert_array_equal(motion.lengths, [1000.0, *late, 1.0])
    np.testing.assert_allclose(motion.waypoint_times, [0, 1000, 1000, 1001], rtol=1e-11)
    assert set(motion.waypoint_times) <= set(motion.breaks)
    np.testing.assert_array_equal(motion.coefficients[0, :, 0], [1e-3, 2.0, 3.0, 0.0])
