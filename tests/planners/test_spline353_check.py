"""Whether limits are kept: against the exact uses, the dilation to them, and the verifier."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt import Limits, Problem
from trajopt.judging.verification import verify
from trajopt.planners import spline353
from trajopt.planners.spline353_check import LimitCheck

JERK = [False, True]


def arm(seed, jerk):
    """Displacements and limits of up to seven joints, of any size, some segments at rest."""
    random = np.random.default_rng(seed)
    joints = random.integers(1, 8)
    d = random.normal(size=(joints, 3)) * 10 ** random.uniform(-3, 3)
    d[:, 1:] *= random.random((joints, 2)) > 0.2
    sides = [-1, 1] * random.uniform(0.2, 4.0, (3, joints, 2))
    velocity, acceleration, own_jerk = sides * 10 ** random.uniform(-1, 2, (3, 1, 1))
    return d, Limits(velocity, acceleration, own_jerk if jerk else None)


def any_times(seed, count=300):
    """Segment times with any ratio up to a thousand."""
    random = np.random.default_rng(seed)
    return 10 ** random.uniform(-1.5, 1.5, (count, 3))


@pytest.mark.parametrize("jerk", JERK)
@pytest.mark.parametrize("seed", range(12))
def test_times_dilated_to_the_limits_keep_them_and_anything_shorter_does_not(seed, jerk):
    d, limits = arm(seed, jerk)
    times = any_times(seed)
    at_limit = times * spline353.dilation(d, times[:, None], limits)[:, None]
    check = LimitCheck.of(d, limits)
    assert check(at_limit * (1 + 1e-10)).all()
    assert check(at_limit * 100).all()
    assert not check(at_limit * (1 - 1e-10)).any()
    assert not check(at_limit * 0.9).any()


@pytest.mark.parametrize("jerk", JERK)
@pytest.mark.parametrize("seed", range(12))
def test_on_the_limit_the_last_digit_is_that_of_the_exact_use(seed, jerk):
    d, limits = arm(seed, jerk)
    times = any_times(seed)
    factor = spline353.dilation(d, times[:, None], limits)[:, None]
    nudge = 1 + np.random.default_rng(seed).integers(-40, 41, factor.shape) * 1e-16
    times = times * factor * nudge
    uses = spline353.limit_use(d, times[:, None], limits, exact_above=1.0)
    keeps = np.max(uses, axis=(0, 2)) <= 1
    assert 0.05 < keeps.mean() < 0.95
    np.testing.assert_array_equal(LimitCheck.of(d, limits)(times), keeps)


def test_the_verifier_agrees():
    d, limits = arm(3, jerk=True)
    waypoints = np.vstack([np.zeros(len(d)), np.cumsum(d.T, axis=0)])
    problem = Problem(waypoints, limits)
    check = LimitCheck.of(d, limits)
    times = any_times(1, count=20)
    factor = spline353.dilation(d, times[:, None], limits)[:, None]
    for scale in (1.001, 0.999):
        scaled = times * factor * scale
        verified = [verify(problem, spline353.trajectory(problem, t)).feasible for t in scaled]
        assert verified == check(scaled).tolist() == [scale > 1] * len(times)


def test_known_peaks_on_one_side_of_one_joint():
    """4 rad in 1 s between cubics of 1 rad in 1 s: the quintic is 3 s + 3 s² − 2 s³.

    Its velocity is at most 4.5, its acceleration falls from 6 to −6, its jerk is −12; the cubics'
    is 6.
    """
    d = np.array([[1.0, 4.0, 1.0], [0.1, 0.4, 0.1]])
    unlimited = [-np.inf, np.inf]
    peaks = {"velocity": (-9.0, 4.5), "acceleration": (-6.0, 99.0), "jerk": (-np.inf, 6.0)}
    roomy = {"velocity": [9.0, 9.0], "acceleration": [99.0, 99.0]}
    for name, (low, high) in peaks.items():
        for slack, kept in ((1.001, True), (0.999, False)):
            own = [[slack * low, slack * high], unlimited if name == "jerk" else [-9.0, 9.0]]
            check = LimitCheck.of(d, Limits(**{**roomy, name: own}))
            assert check(np.ones((1, 3))).tolist() == [kept]


def test_none_of_no_candidates_and_no_warning_where_ratios_overflow():
    d, limits = arm(0, jerk=True)
    check = LimitCheck.of(d, limits)
    assert check(np.empty((0, 3))).shape == (0,)
    assert not check(np.array([[1e-9, 1e9, 1e-9]])).any()
