"""Of the motions of minimum time the smoothest: free joints are smooth, the time is the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trajopt import Limits, Problem
from trajopt.benchmark.best_known import records
from trajopt.benchmark.front import smoothest
from trajopt.benchmark.suites import catalogue
from trajopt.core.trajectory import Trajectory
from trajopt.judging.smoothness import smoothness
from trajopt.judging.verification import verify
from trajopt.planners.registry import load


def jerks(problem: Problem, motion: Trajectory) -> list[float]:
    """∫ jerk² of each joint that moves."""
    found = []
    for joint in np.flatnonzero(problem.moving).tolist():
        own = replace(motion, coefficients=motion.coefficients[..., [joint]])
        found.append(smoothness(problem.only([joint]), own).jerk_integral)
    return found


def test_a_joint_with_slack_takes_the_quintic_from_rest_to_rest():
    """The first joint decides: 1 rad with 1 rad/s² takes 2 s. Without limits the least ∫ jerk² of a
    displacement h in the time T is 720 h²/T⁵."""
    problem = Problem([[0.0, 0.0], [1.0, 0.1]], Limits([2.0, 2.0], [1.0, 1.0]))
    optimum = load("exact").solve(problem).trajectory
    found = smoothest(problem, optimum)
    np.testing.assert_array_equal(found.waypoint_times, optimum.waypoint_times)
    first, second = jerks(problem, found)
    assert first == np.inf  # bang-bang: it has one motion only
    assert second == pytest.approx(720 * 0.1**2 / 2.0**5, rel=1e-6)
    assert verify(problem, found).feasible


def test_a_joint_that_starts_in_motion_takes_the_quintic_between_its_states():
    """Of least ∫ jerk² between (0, v, 0) and (h, 0, 0) in the time T is the quintic, whose
    ∫ jerk² is (720 h² − 720 h v T + 192 v² T²) / T⁵."""
    problem = Problem(
        [[0.0, 0.0], [1.0, 0.1]], Limits([2.0, 2.0], [1.0, 1.0]), start_velocity=[0.0, 0.02]
    )
    optimum = load("exact").solve(problem).trajectory
    found = smoothest(problem, optimum)
    h, v, t = 0.1, 0.02, 2.0
    expected = (720 * h**2 - 720 * h * v * t + 192 * v**2 * t**2) / t**5
    assert jerks(problem, found)[1] == pytest.approx(expected, rel=1e-6)
    assert verify(problem, found).feasible


def test_between_segments_that_decide_a_joint_is_smooth():
    """The first joint decides the first segment, the second joint the other one: each keeps its
    motion there, and joins its states smoothly in the other segment."""
    problem = Problem([[0.0, 0.0], [1.0, 0.1], [1.1, 1.1]], Limits([9.0, 0.2], [1.0, 1.0]))
    optimum = load("exact").solve(problem).trajectory
    found = smoothest(problem, optimum)
    assert verify(problem, found).dilation <= 1 + 1e-9
    first, middle, last = found.waypoint_times
    for joint, begins, stops in ((0, first, middle), (1, middle, last)):
        times = np.linspace(begins, stops, 50)[1:-1]
        np.testing.assert_allclose(found(times)[:, joint], optimum(times)[:, joint], atol=1e-12)
    for joint, begins, stops in ((1, first, middle), (0, middle, last)):
        times = np.linspace(begins, stops, 50)[1:-1]
        steps = [np.abs(np.diff(own(times, 2)[:, joint])).max() for own in (found, optimum)]
        assert steps[0] < 0.5 * steps[1]  # the optimum jumps


def test_joints_that_decide_keep_their_motion_and_the_others_stop_jerking():
    problem = catalogue.load("robots-franka-panda-w4-jerk")
    optimum = records.answer(problem).trajectory
    found = smoothest(problem, optimum)
    np.testing.assert_allclose(found.waypoint_times, optimum.waypoint_times, rtol=0, atol=1e-9)
    certificate = verify(problem, found)
    assert certificate.feasible
    assert certificate.dilation <= 1 + 1e-9
    before, after = jerks(problem, optimum), jerks(problem, found)
    assert all(own <= other * (1 + 1e-9) for own, other in zip(after, before, strict=True))
    smoother = [own < other / 100 for own, other in zip(after, before, strict=True)]
    assert sum(smoother) >= 2
    assert not all(smoother)


@pytest.mark.parametrize(
    "change", [{"dwell": [0.0, 0.2, 0.0]}, {"least_times": [3.0, 0.0]}, {"tolerance": 0.01}]
)
def test_a_motion_with_demands_stays_as_it_is(change):
    problem = Problem([[0.0], [1.0], [0.5]], Limits([1.0], [1.0]), **change)
    motion = load("exact").solve(problem.without(*change)).trajectory
    assert smoothest(problem, motion) is motion
