"""Stopping at every waypoint, against profiles derived anew, Ruckig and numerical integration."""

from __future__ import annotations

from math import cbrt, inf, sqrt

import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st

from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.planners.rest_to_rest import end_to_end_bound, seven_phase, stop_times, trapezoidal

reproducible = settings(deadline=None, derandomize=True, max_examples=150)
positive = st.floats(1e-3, 1e3)


def one(h: float, limits: Limits) -> float:
    """Stop-to-stop time of one segment of one joint."""
    problem = Problem([[0.0], [h]], limits)
    return float(stop_times(problem)[0])


def seven(h: float, v: float, a: float, j: float) -> float:
    """Stop-to-stop time of one joint with symmetric limits and a jerk limit."""
    return one(h, Limits([v], [a], [j]))


@pytest.mark.parametrize(
    ("h", "v", "a", "time"),
    [
        (1.5, 1, 2, 2.0),  # cruises: h/v + v/a
        (0.5, 1, 2, 1.0),  # just reaches v
        (0.125, 1, 2, 0.5),  # triangle: 2 sqrt(h/a)
        (-1.5, 1, 2, 2.0),
        (8, 1e9, 2, 4.0),
        (8, 2, 1e12, 4 + 2e-12),
        (1e-12, 1, 1, 2e-6),
        (1e12, 1, 1, 1e12 + 1),
        (1e-300, 1, 1, 2e-150),
    ],
)
def test_trapezoids_by_hand(h, v, a, time):
    assert one(h, Limits([v], [a])) == pytest.approx(time, rel=1e-15)


@pytest.mark.parametrize(
    ("h", "velocity", "acceleration", "time"),
    [
        # Up at 1 for 2 s, down at 2 for 1 s: 2 + 1 rad, peak 2.
        (3, (-9, 9), (-2, 1), 3.0),
        (3, (-9, 2), (-2, 1), 3.0),
        (5, (-9, 2), (-2, 1), 4.0),  # and a second of cruise
        (-5, (-2, 9), (-2, 1), 4.0),  # backwards the phases swap, their sum does not
        (-5, (-1, 9), (-2, 1), 5.75),
        (5, (-1, 9), (-2, 1), sqrt(15)),
    ],
)
def test_asymmetric_trapezoids_by_hand(h, velocity, acceleration, time):
    limits = Limits([velocity], [acceleration])
    assert one(h, limits) == pytest.approx(time, rel=1e-15)


@reproducible
@given(st.floats(-1e3, 1e3).filter(bool), positive, positive, positive, positive)
def test_the_trapezoid_covers_the_distance_at_its_limits(h, v1, v2, a1, a2):
    """Integrated anew: the fastest profile of that duration covers exactly that distance."""
    time = one(h, Limits([[-v1, v2]], [[-a1, a2]]))
    top, up, down = (v2, a2, a1) if h > 0 else (v1, a1, a2)
    peak = min(top, time * up * down / (up + down))  # the two ramps would meet here
    ramps = peak / up + peak / down
    assert time >= ramps * (1 - 1e-12)
    assert peak * (time - ramps / 2) == pytest.approx(abs(h), rel=1e-9)


def by_phases(h: float, v: float, a: float, j: float) -> float:
    """The seven-phase minimum anew: bisect the peak velocity, each ramp from its own formula."""

    def ramp(peak):
        if peak <= a * a / j:
            return 2 * sqrt(peak / j)
        return peak / a + a / j

    if v * ramp(v) <= h:  # two ramps of mean velocity v/2
        return h / v + ramp(v)
    low = 0.0
    high = v
    for _ in range(200):
        peak = 0.5 * (low + high)
        if peak * ramp(peak) < h:
            low = peak
        else:
            high = peak
    return 2 * ramp(high)


@reproducible
@given(st.floats(1e-6, 1e6), positive, positive, positive)
def test_seven_phases_by_bisection(h, v, a, j):
    expected = by_phases(h, v, a, j)
    assert seven(h, v, a, j) == pytest.approx(expected, rel=1e-9)
    assert seven(-h, v, a, j) == pytest.approx(expected, rel=1e-9)


@reproducible
@given(st.floats(1e-2, 1e2), *[st.floats(0.05, 20)] * 3)
def test_seven_phases_are_ruckigs(h, v, a, j):
    given_ = ruckig.InputParameter(1)
    found = ruckig.Trajectory(1)
    given_.current_position = [0.0]
    given_.target_position = [h]
    given_.max_velocity = [v]
    given_.max_acceleration = [a]
    given_.max_jerk = [j]
    assert ruckig.Ruckig(1).calculate(given_, found) == ruckig.Result.Working
    assert seven(h, v, a, j) == pytest.approx(found.duration, rel=1e-9)


@pytest.mark.parametrize(
    ("h", "v", "a", "j", "time"),
    [
        (2, 10, 10, 1, 4.0),  # four phases of 1 s: h = 2 j t³
        (2e-9, 10, 10, 1, 4e-3),
        (2e-300, 10, 10, 1, 4e-100),  # h² is nothing in floating point
        (2e-30, 10, 10, 1e300, 4e-110),
        (6, 9, 1, 1, 6.0),  # full acceleration for 1 s: ramps of 3 s, peak 2
        (2, 1, 1, 1, 4.0),  # ramps of 2 s to peak 1 = v, no cruise
        (5, 1, 1, 1, 7.0),  # and 3 s of cruise
        (5, 1, 9, 1, 7.0),  # full acceleration never reached
        (1e12, 1, 1, 1, 1e12 + 2),
    ],
)
def test_seven_phases_by_hand(h, v, a, j, time):
    assert seven(h, v, a, j) == pytest.approx(time, rel=1e-12)


@reproducible
@given(st.floats(1e-3, 1e3), positive, positive)
def test_ever_stiffer_jerk_tends_to_the_trapezoid_from_above(h, v, a):
    trapezoid = one(h, Limits([v], [a]))
    before = inf
    for exponent in range(0, 15, 2):
        time = seven(h, v, a, 10.0**exponent)
        assert trapezoid * (1 - 1e-12) <= time <= before * (1 + 1e-12)
        before = time
    assert seven(h, v, a, 1e60) == pytest.approx(trapezoid, rel=1e-9)


@reproducible
@given(st.floats(1e-3, 1e3), positive, positive, positive, st.floats(1e-3, 1e3))
def test_limits_and_times_scale(h, v, a, j, c):
    slow = seven(h, v, a, j)
    fast = seven(h, v * c, a * c**2, j * c**3)
    assert fast == pytest.approx(slow / c, rel=1e-9)
    longer = seven(h * c, v * c, a * c, j * c)
    assert longer == pytest.approx(slow, rel=1e-9)


def test_asymmetric_limits_with_jerk_count_at_their_tighter_side():
    limits = Limits([[-3, 2]], [[-1, 4]], [[-5, 9]])
    assert one(7, limits) == pytest.approx(by_phases(7, 2, 1, 5), rel=1e-9)
    assert one(-7, limits) == pytest.approx(by_phases(7, 2, 1, 5), rel=1e-9)
    one_sided = Limits([1.0], [1.0], [[-inf, 1]])
    assert one(5, one_sided) == pytest.approx(7.0, rel=1e-12)


def test_every_segment_takes_its_slowest_joint_with_or_without_jerk():
    limits = Limits([1, 1, 1], [2, 1, 1], [inf, 1, inf])
    problem = Problem([[0, 0, 0], [1.5, 0, 0], [1.5, 2, 0], [3, 4, 8], [3, 4, 8]], limits)
    # 1.5/1 + 1/2; 4 by jerk; max(2, 4, 8 + 1); and nothing at all.
    np.testing.assert_allclose(stop_times(problem), [2, 4, 9, 0], rtol=1e-12)


def test_no_distance_takes_no_time():
    for limits in (Limits([2.0], [3.0]), Limits([2.0], [3.0], [4.0])):
        problem = Problem([[1.0], [1.0], [2.0]], limits)
        assert stop_times(problem)[0] == 0
    zero = np.zeros(1)
    assert seven_phase(zero, *np.ones((3, 1))).tolist() == [0]
    assert trapezoidal(zero, np.array([[-1.0, 1]]), np.array([[-1.0, 1]])).tolist() == [0]


def test_batches_of_segments_give_each_its_own():
    h = np.array([[2.0, -1], [0, 5], [1e-3, 300]])
    times = seven_phase(np.abs(h), np.array([1.0, 2]), np.array([3.0, 4]), np.array([5.0, 6]))
    expected = np.zeros_like(h)
    for segment, joint in np.argwhere(h != 0):
        own = [(1, 3, 5), (2, 4, 6)][joint]
        expected[segment, joint] = by_phases(abs(h[segment, joint]), *own)
    np.testing.assert_allclose(times, expected, rtol=1e-9)


def test_the_cubic_root_law_of_small_steps():
    """Far from the other limits, eight times the distance takes twice the time."""
    times = [seven(h, 1e6, 1e6, 2.0) for h in (1e-3, 8e-3, 64e-3)]
    np.testing.assert_allclose(times, 4 * cbrt(1e-3 / 4) * np.array([1, 2, 4]), rtol=1e-12)


def test_the_end_to_end_bound_of_two_waypoints_is_the_stopping_time() -> None:
    limits = Limits([2.0, 3.0], [1.0, [-2.0, 4.0]], jerk=[5.0, np.inf])
    problem = Problem([[0.0, 1.0], [4.0, -2.0]], limits)
    assert end_to_end_bound(problem) == pytest.approx(stop_times(problem).sum(), rel=1e-9)


def test_the_end_to_end_bound_never_exceeds_stopping_and_counts_full_velocity() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        pairs = rng.uniform(0.5, 3.0, (3, 2, 2)) * [-1, 1]
        limits = Limits(*pairs)
        problem = Problem(rng.normal(size=(5, 2)), limits)
        assert end_to_end_bound(problem) <= stop_times(problem).sum()
    # there and back: the ends say nothing, 2 · 10/2 s at full velocity do
    back = Problem([[0.0], [10.0], [0.0]], Limits([2.0], [100.0]))
    assert end_to_end_bound(back) == pytest.approx(10.0, rel=1e-9)
    # backwards the velocity limit is another
    one_way = Problem([[0.0], [10.0], [0.0]], Limits([[-1.0, 2.0]], [100.0]))
    assert end_to_end_bound(one_way) == pytest.approx(15.0, rel=1e-9)
