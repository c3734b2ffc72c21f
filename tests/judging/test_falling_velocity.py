"""Velocity limits that fall towards a position limit, against closed forms and sampling."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.benchmark.suites import catalogue
from trajopt.core import arm_file
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import FallingVelocity
from trajopt.core.trajectory import Trajectory
from trajopt.judging.falling_velocity import EXCESS_ATOL, Excess, caveats, excess


def pieces(breaks, *rows):
    """One joint: a row of coefficients per piece, highest power first."""
    coefficients = np.array(rows, dtype=float).T[..., None]
    return Trajectory(breaks, coefficients, np.array(breaks)[[0, -1]])


def mirrored(limit, trajectory):
    own = FallingVelocity(limit.offset, limit.deceleration, -limit.high, -limit.low)
    return own, Trajectory(trajectory.breaks, -trajectory.coefficients, trajectory.waypoint_times)


def both_ways(limit, trajectory):
    """The excess, after the mirrored motion was found to have the mirrored one."""
    found = excess([limit], trajectory)
    other = excess(*([one] if n == 0 else one for n, one in enumerate(mirrored(limit, trajectory))))
    expected = Excess(**{**vars(found), "velocity": other.velocity})
    assert other == expected
    assert other.velocity == -found.velocity
    return found


def test_constant_velocity_is_too_fast_from_where_the_root_falls_below_it():
    limit = FallingVelocity(offset=0.2, deceleration=2.0, low=-100, high=2.5)
    # sqrt(4 (2.5 - q)) - 0.2 < 1 from q = 2.14 on; at 2.4 it is sqrt(0.4) - 0.2
    found = both_ways(limit, pieces([0, 2.4], [1, 0]))
    expected = 1.2 - np.sqrt(0.4)
    assert found.value == pytest.approx(expected, rel=1e-12)
    expected = np.sqrt(0.4) - 0.2
    assert found.allowed == pytest.approx(expected, rel=1e-12)
    assert (found.time, found.velocity, found.joint) == (2.4, 1, 0)
    assert found.share == pytest.approx(0.26 / 2.4, rel=1e-9)
    motion = pieces([0, 2.13], [1, 0])
    assert both_ways(limit, motion) == Excess()


def test_braking_is_worst_inside_the_piece():
    # v² = v0² - 2 b q, so w = W + v²/(2 b) with W = high - v0²/(2 b); de/dt = 0 where
    # b² 2 d w = d² v², which is v² = 2 b² W / (d - b)
    v0 = 2.0
    b = 1.0
    d = 1.5
    o = 0.5
    room = 0.1
    high = v0**2 / (2 * b) + room
    v = np.sqrt(2 * b**2 * room / (d - b))
    w = room + v**2 / (2 * b)
    limit = FallingVelocity(o, d, -100, high)
    found = both_ways(limit, pieces([0, 2], [-b / 2, v0, 0]))
    expected = v + o - np.sqrt(2 * d * w)
    assert found.value == pytest.approx(expected, rel=1e-12)
    expected = (v0 - v) / b
    assert found.time == pytest.approx(expected, rel=1e-9)
    # it begins and ends at the roots of (v + o)² = 2 d w, a quadratic in v
    ends = np.roots([1 - d / b, 2 * o, o**2 - 2 * d * room])
    expected = abs(np.diff(ends)[0]) / b / 2
    assert found.share == pytest.approx(expected, rel=1e-9)
    # touched in one instant: the same motion with the offset that makes the worst excess 0
    touching = FallingVelocity(np.sqrt(2 * d * w) - v, d, -100, high)
    motion = pieces([0, 2], [-b / 2, v0, 0])
    assert both_ways(touching, motion) == Excess()
    nearer = FallingVelocity(np.sqrt(2 * d * w) - v + 1e-3, d, -100, high)
    found = both_ways(nearer, pieces([0, 2], [-b / 2, v0, 0]))
    assert found.value == pytest.approx(1e-3, rel=1e-6)


def test_the_limit_s_own_arc_is_kept():
    # with offset 0 the limit's arc is a parabola: v = d (T - t), w = (d/2) (T - t)²
    d = 1.7
    arc = pieces([0, 2], [-d / 2, 2 * d, -2 * d])  # q = -(d/2) (2 - t)²
    limit = FallingVelocity(0.0, d, -100, 0.0)
    assert both_ways(limit, arc) == Excess()
    found = both_ways(FallingVelocity(1e-4, d, -100, 0.0), arc)
    assert found.value == pytest.approx(1e-4, rel=1e-6)
    assert found.share == pytest.approx(1, abs=1e-9)


def test_rest_near_the_end_and_leaving_it_break_nothing():
    limit = FallingVelocity(0.3, 6.0, -2.7501, 2.7501)  # nothing is allowed in the last 7.5 mrad
    still = pieces([0, 1], [0, 0, 2.745])
    leaving = pieces([0, 1], [0, -0.1, 2.745])  # v > -offset, but not towards the end
    entering = pieces([0, 1], [0, 0.001, 2.744])
    beyond = pieces([0, 1], [0, 0.001, 2.8])
    assert both_ways(limit, still) == Excess()
    assert both_ways(limit, leaving) == Excess()
    for motion in (entering, beyond):
        found = both_ways(limit, motion)
        expected = (pytest.approx(0.001), 0.0)
        assert (found.value, found.allowed) == expected
        assert found.share == pytest.approx(1)


def test_time_that_two_joints_break_together_counts_once():
    limit = FallingVelocity(0.2, 2.0, -100, 2.5)
    one = pieces([0, 2.4], [1, 0])
    twice = Trajectory(one.breaks, np.repeat(one.coefficients, 2, axis=2), one.waypoint_times)
    expected = excess([limit], one)
    assert excess([limit, limit], twice) == expected
    expected = Excess(**{**vars(excess([limit], one)), "joint": 1})
    assert excess([None, limit], twice) == expected
    assert excess([None, None], twice) == Excess()


def sampled(limit, trajectory, count=400_001):
    times = np.linspace(0, trajectory.duration, count)
    q = trajectory(times)[:, 0]
    v = trajectory(times, 1)[:, 0]
    up, down = [
        np.maximum(0, np.sqrt(2 * limit.deceleration * np.maximum(0, w)) - limit.offset)
        for w in (limit.high - q, q - limit.low)
    ]
    over = np.maximum(v - up, -v - down)
    return over.max(), np.mean(over > EXCESS_ATOL)


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 6, 7])
def test_any_degree_against_sampling(degree):
    rng = np.random.default_rng(degree)
    broken = 0
    for _ in range(4):
        rows = rng.normal(size=(3, degree + 1))
        motion = pieces([0, 0.7, 1.1, 2.0], *rows)
        times = np.linspace(0, 2, 999)
        low, high = np.quantile(motion(times), [0.05, 0.9])
        drawn = rng.uniform(0, 0.4)
        limit = FallingVelocity(drawn, rng.uniform(0.2, 8), low, high)
        found = both_ways(limit, motion)
        value, share = sampled(limit, motion)
        broken += not found.kept
        assert value <= found.value + 1e-12
        assert found.value == pytest.approx(value, abs=2e-4)
        assert found.share == pytest.approx(share, abs=2e-5)
    assert broken == 4


def test_the_fr3_s_own_numbers_are_libfranka_s():
    limits = arm_file.read("franka-fr3").falling_velocity
    # rate_limiting.h: -0.20 + sqrt(5.17 (1.79180 - q)), 0.35 - sqrt(11 (-0.54092 + q))
    assert 2 * limits[1].deceleration == 5.17
    assert (limits[1].offset, limits[1].high) == (0.20, 1.79180)
    assert (limits[5].offset, limits[5].low, 2 * limits[5].deceleration) == (0.35, 0.54092, 11)
    assert len(limits) == 7
    assert arm_file.read("franka-panda").falling_velocity == ()


def test_problems_whose_limits_are_not_the_arm_s_are_named():
    problems = [catalogue.load(f"robots-{arm}-w4") for arm in ("ur5e", "franka-fr3")]
    (said,) = caveats(problems)
    assert said == (
        "robots-franka-fr3-w4: constant velocity limits; the arm allows less near its position "
        "limits."
    )
    assert "constant velocity limits" in problems[1].source
    assert list(caveats(problems[:1])) == []
    (said,) = caveats([problems[1]] * 8)
    assert "and 2 more: constant" in said


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"offset": -1}, "velocity_offset is -1"),
        ({"deceleration": 0}, "deceleration_limit is 0"),
        ({"deceleration": np.nan}, "deceleration_limit is nan"),
        ({"high": -2}, "lower below upper"),
        ({"low": -np.inf}, "a finite range"),
    ],
)
def test_what_is_no_such_limit_is_refused(changes, words):
    with pytest.raises(InvalidInput, match=words):
        FallingVelocity(**{"offset": 0.1, "deceleration": 1, "low": -1, "high": 1, **changes})
