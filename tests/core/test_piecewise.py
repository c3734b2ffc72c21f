"""Motions from SciPy's piecewise polynomials, and composed ones, against closed forms and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicSpline, PPoly, make_interp_spline

from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.trajectory import Trajectory

RNG = np.random.default_rng(3)


def check_same(trajectory, function, start, orders=(0, 1, 2), atol=1e-10):
    times = np.linspace(0, trajectory.duration, 401)[1:-1]
    for order in orders:
        expected = np.asarray(function(start + times, order)).reshape(len(times), -1)
        np.testing.assert_allclose(trajectory(times, order), expected, rtol=0, atol=atol)


def test_a_ppoly_is_taken_as_it_is_and_moved_to_time_zero():
    spline = CubicSpline([3.0, 4.5, 5.0, 7.0], RNG.normal(size=(4, 2)), bc_type="clamped")
    trajectory = Trajectory.from_ppoly(spline, waypoint_times=[0, 1.5, 2, 4])
    assert trajectory.breaks.tolist() == [0, 1.5, 2, 4]
    assert trajectory.waypoint_times.tolist() == [0, 1.5, 2, 4]
    assert np.array_equal(trajectory.coefficients, spline.c)
    check_same(trajectory, spline, 3.0)


def test_one_joint_needs_no_axis_of_its_own():
    spline = PPoly([[1.0, -1.0], [0.0, 1.0]], [0.0, 1.0, 2.0])
    trajectory = Trajectory.from_ppoly(spline)
    assert trajectory.joints == 1
    found = trajectory([0, 1, 2])[:, 0].tolist()
    assert found == [0, 1, 0]
    found = Trajectory.from_spline(BSpline([0, 0, 1, 1], [2.0, 3.0], 1))(1).tolist()
    assert found == [3]


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_a_b_spline_with_clamped_and_with_repeated_knots(degree):
    sums = np.cumsum(RNG.uniform(0.1, 1, 9))
    times = np.r_[1.0, 1.0 + sums]
    spline = make_interp_spline(times, RNG.normal(size=(10, 3)), k=degree)
    check_same(Trajectory.from_spline(spline), spline, 1.0, range(degree + 1), atol=1e-7)
    knots = np.r_[[0.0] * (degree + 1), 0.5, 0.5, [2.0] * (degree + 1)]
    repeated = BSpline(knots, RNG.normal(size=(len(knots) - degree - 1, 2)), degree)
    trajectory = Trajectory.from_spline(repeated)
    assert trajectory.breaks.tolist() == [0, 0.5, 2]
    check_same(trajectory, repeated, 0.0)


def test_a_b_spline_whose_points_lie_along_another_axis():
    values = np.array([[0.0, 1.0, 3.0], [2.0, 2.0, 0.0]])
    spline = BSpline([0, 0, 0, 1, 1, 1], values, 2, axis=1)
    trajectory = Trajectory.from_spline(spline)
    found = trajectory([0.0, 1.0])
    np.testing.assert_allclose(found, [[0, 2], [3, 0]], atol=1e-15)


def test_a_straight_line_timed_with_constant_acceleration_by_hand():
    """q = (s, −2 s) on [0, 4], s = t²: q = (t², −2 t²)."""
    line = PPoly([[[1.0, -2.0]], [[0.0, 0.0]]], [0.0, 4.0])
    square = PPoly([[1.0], [0.0], [0.0]], [0.0, 2.0])
    trajectory = Trajectory.composed(line, square)
    assert trajectory.breaks.tolist() == [0, 2]
    found = trajectory.coefficients[:, 0].tolist()
    assert found == [[1, -2], [0, 0], [0, 0]]


def test_a_composition_is_broken_where_either_is_and_exact_in_between():
    knots = [0.0, 0.7, 1.1, 2.0]
    path = CubicSpline(knots, RNG.normal(size=(4, 3)))
    # there and back: s = 2 sin-like, from 0 up to 2 at t = 1 and back to 0.5
    parameter = PPoly([[-2.0, -1.5], [4.0, 0.0], [0.0, 2.0]], [0.0, 1.0, 2.0])
    trajectory = Trajectory.composed(path, parameter)
    times = np.linspace(0, 2, 1001)
    expected = path(parameter(times))
    np.testing.assert_allclose(trajectory(times), expected, rtol=0, atol=1e-12)
    # s(t) = 4 t − 2 t² = level  ⟺  t = 1 − sqrt(1 − level / 2);  2 − 1.5 (t − 1)² likewise
    up = [1 - np.sqrt(1 - level / 2) for level in (0.7, 1.1)]
    down = [1 + np.sqrt((2 - level) / 1.5) for level in (1.1, 0.7)]
    np.testing.assert_allclose(trajectory.breaks, [0, *up, 1, *down, 2], atol=1e-12)
    # the chain rule
    speed = parameter(times, 1)[:, None]
    first = path(parameter(times), 1) * speed
    np.testing.assert_allclose(trajectory(times, 1), first, rtol=0, atol=1e-10)


def test_a_parameter_may_stand_on_a_break_and_start_and_end_there():
    path = Trajectory([0, 1, 2], [[[1.0], [3.0]], [[0.0], [1.0]]], [0, 2])
    standing = PPoly([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]], [0.0, 1.0, 3.0, 4.0])
    trajectory = Trajectory.composed(path, standing)
    assert trajectory.breaks.tolist() == [0, 1, 3, 4]
    found = trajectory([0.5, 2, 3.5, 4])[:, 0].tolist()
    assert found == [0.5, 1, 2.5, 4]
    assert trajectory(3.5, 1).tolist() == [3]


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Trajectory.from_ppoly(PPoly(np.ones((2, 1, 2, 2)), [0, 1])), "one row of joints"),
        (lambda: Trajectory.from_ppoly(PPoly([[1j], [0]], [0, 1])), "must be real"),
        (lambda: Trajectory.from_ppoly(PPoly([[1.0], [0]], [1, 0])), "must increase"),
        (lambda: Trajectory.from_ppoly(PPoly([[np.nan], [0]], [0, 1])), "not finite"),
        (lambda: Trajectory.composed(LINE, PPoly([[3.0], [0]], [0, 1])), "runs from 0 to 3; the"),
        (lambda: Trajectory.composed(LINE, PPoly([[-1.0], [0]], [0, 1])), "runs from -1 to 0"),
        (lambda: Trajectory.composed(LINE, PPoly([[np.nan], [0]], [0, 1])), "not finite"),
        (lambda: Trajectory.composed(LINE, PPoly(np.ones((1, 1, 2)), [0, 1])), "one function"),
        (lambda: Trajectory.composed(LINE, np.sin), "PPoly or BSpline is needed, not ufunc"),
    ],
)
def test_what_is_no_motion_is_refused(make, said):
    with pytest.raises(InvalidTrajectory, match=said):
        make()


LINE = PPoly([[1.0], [0.0]], [0.0, 2.0])
