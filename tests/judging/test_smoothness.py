"""Integrals of squared jerk and acceleration: closed forms, jumps, units, and cheats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.trial import trials_of
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.smoothness import smoothness
from trajopt.planners.registry import named

PROBLEM = Problem([[0.0], [1.0]], Limits(velocity=[10.0], acceleration=[10.0]))


def quintic(duration: float = 1.0, joints: int = 1) -> Trajectory:
    """Minimum jerk from 0 to 1 rad: 10 s³ − 15 s⁴ + 6 s⁵."""
    powers = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
    scaled = powers / duration ** np.arange(5, -1, -1)
    coefficients = np.repeat(scaled[:, None, None], joints, axis=2)
    return Trajectory([0.0, duration], coefficients, [0.0, duration])


@pytest.mark.parametrize("duration", [1e-3, 1.0, 2.0, 1e4])
def test_the_least_jerk_from_rest_to_rest_is_720(duration):
    """Flash and Hogan 1985: 720 h²/D⁵; of acceleration the same motion has 120/7 h²/D³."""
    found = smoothness(PROBLEM, quintic(duration))
    assert found.jerk_integral == pytest.approx(720 / duration**5, rel=1e-12)
    assert found.acceleration_integral == pytest.approx(120 / 7 / duration**3, rel=1e-12)
    assert found.jerk_rms_sum == pytest.approx(np.sqrt(720) / duration**3, rel=1e-12)
    assert found.jump is None


def test_joints_are_summed_and_rms_values_too():
    two = Problem([[0.0, 0.0], [1.0, 1.0]], Limits([10.0, 10.0], [10.0, 10.0]))
    found = smoothness(two, quintic(joints=2))
    assert found.jerk_integral == pytest.approx(1440)
    assert found.jerk_rms_sum == pytest.approx(2 * np.sqrt(720))


def test_mixed_units_are_weighted_by_the_acceleration_limit():
    limits = Limits([10.0, 10.0], [10.0, [-4.0, 2.0]])
    mixed = Problem([[0.0, 0.0], [1.0, 1.0]], limits, joint_units=["rad", "m"])
    found = smoothness(mixed, quintic(joints=2))
    assert found.jerk_integral == pytest.approx(720 / 100 + 720 / 4)
    metres = replace(mixed, joint_units=["m", "m"])
    assert smoothness(metres, quintic(joints=2)).jerk_integral == pytest.approx(1440)


def test_a_dilated_motion_has_the_dilated_integrals():
    motion = quintic()
    expected = smoothness(PROBLEM, motion.dilated(3.0))
    found = smoothness(PROBLEM, motion).dilated(3.0)
    assert found.jerk_integral == pytest.approx(expected.jerk_integral)
    assert found.acceleration_integral == pytest.approx(expected.acceleration_integral)
    assert found.jerk_rms_sum == pytest.approx(expected.jerk_rms_sum)


def test_cutting_pieces_changes_nothing():
    whole = smoothness(PROBLEM, quintic())
    cut = smoothness(PROBLEM, quintic().refined(np.linspace(0, 1, 50)))
    assert cut.jerk_integral == pytest.approx(whole.jerk_integral)
    assert cut.jump is None


@pytest.mark.parametrize(
    ("name", "jump"), [("exact", True), ("collocation", True), ("spline353-nlp", False)]
)
def test_bang_bang_is_infinite_and_a_spline_is_not(name, jump):
    """Between its jumps the exact optimum has no jerk at all."""
    trial = trials_of(named(name)[1], load("six-axis"), [0], name)[0]
    assert np.isinf(trial.jerk_integral) == jump
    assert (trial.smoothness.jump is not None) == jump
    assert np.isfinite(trial.acceleration_integral)
    assert (trial.as_dict()["smoothness"]["jerk_integral"] is None) == jump


def test_the_best_353_has_the_trials_own_integral():
    trial = trials_of(named("spline353-nlp")[1], load("six-axis"), [0], "spline353-nlp")[0]
    t = np.linspace(0, trial.certified_duration, 200_001)
    jerk = trial.certified_trajectory(t, 3)
    assert trial.jerk_integral == pytest.approx(np.trapezoid((jerk**2).sum(axis=1), t), rel=1e-4)
    assert trial.jerk_integral == pytest.approx(1043.66, rel=1e-5)


def test_a_jump_at_an_end_counts():
    """Half of a quintic from -1 to 1 starts with its highest velocity."""
    bang = np.zeros((3, 2, 1))
    bang[:, 0, 0] = [1.0, 0.0, 0.0]
    bang[:, 1, 0] = [-1.0, 1.0, 0.25]
    motion = Trajectory([0.0, 0.5, 1.0], bang, [0.0, 1.0])
    problem = Problem([[0.0], [0.5]], PROBLEM.limits)
    found = smoothness(problem, motion)
    assert np.isinf(found.jerk_integral)
    assert np.isinf(found.jerk_rms_sum)
    assert found.acceleration_integral == pytest.approx(4.0)
    assert found.jump.order == 2
    assert found.jump.value == pytest.approx(4.0)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_staircase_of_tiny_jumps_is_no_way_around(order):
    """Each step is within the verifier's tolerance; together they are the whole motion."""
    pieces = 2_000_000
    middles = (np.arange(pieces) + 0.5) / pieces
    smooth = quintic()
    value = smooth(middles, order)[:, 0]
    coefficients = np.zeros((order + 1, pieces, 1))
    coefficients[0, :, 0] = value / max(1, order)
    breaks = np.linspace(0, 1, pieces + 1)
    lengths = np.diff(breaks)
    state = [smooth(breaks[:-1], k)[:, 0] for k in range(order)]
    for k in range(order):
        coefficients[order - k, :, 0] = state[k]
    motion = Trajectory(breaks, coefficients, [0.0, 1.0], lengths)
    assert np.isinf(smoothness(PROBLEM, motion).jerk_integral)


def test_rounding_is_no_jump():
    """The same motion far from zero, in a resting robot's company, very slowly."""
    slow = quintic(1e5)
    table = np.array(slow.coefficients)
    noise = 1e-9 * np.random.default_rng(0).normal(size=table.shape)
    table = np.concatenate([table, noise * table], axis=2)
    table[-1] += 1e3
    two = Problem([[1e3, 1e3], [1e3 + 1, 1e3]], Limits([1.0, 1.0], [1.0, 1.0]))
    motion = Trajectory(slow.breaks, table, slow.waypoint_times).refined([1e4, 5e4])
    assert smoothness(two, motion).jerk_integral < np.inf


@pytest.mark.parametrize("pieces", [[[0.0, 0.0], [0.0, 1.0]], [[1.0, 1.0], [0.0, 0.5]]])
def test_one_jump_of_position_or_velocity_makes_both_integrals_infinite(pieces):
    """Standing at 0 and then at 1 rad; or at constant speed from 0 to 1 rad."""
    coefficients = np.array(pieces)[:, :, None]
    motion = Trajectory([0.0, 0.5, 1.0], coefficients, [0.0, 1.0])
    found = smoothness(PROBLEM, motion)
    assert found.jerk_integral == found.acceleration_integral == np.inf
    assert found.jump is not None


def test_a_jump_is_measured_by_the_limit_of_its_own_derivative():
    """Two joints at constant speed: the first at half of its velocity limit, the other far below.

    Of the acceleration limits the second is by far the tighter one.
    """
    speeds = np.array([0.5, 0.6])
    coefficients = np.stack([speeds, [0.0, 0.0]])[:, None, :]
    motion = Trajectory([0.0, 1.0], coefficients, [0.0, 1.0])
    limits = Limits(velocity=[1.0, 100.0], acceleration=[100.0, 1.0])
    found = smoothness(Problem([[0.0, 0.0], speeds], limits), motion)
    assert (found.jump.order, found.jump.joint, found.jump.value) == (1, 0, 0.5)
