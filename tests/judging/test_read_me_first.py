"""Examples of judging: the exact verdict on a motion of any planner."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.passing import waypoint_times
from trajopt.judging.verification import certified, verify

PROBLEM = Problem(waypoints=[[0.0], [1.0]], limits=Limits(velocity=[10.0], acceleration=[1.0]))


def bang_bang(acceleration: float) -> Trajectory:
    """From 0 to 1 rad: accelerate for half of the time, then brake."""
    half = np.sqrt(1.0 / acceleration)
    speed = acceleration * half
    coefficients = np.zeros((3, 2, 1))
    coefficients[:, 0, 0] = [acceleration / 2, 0.0, 0.0]
    coefficients[:, 1, 0] = [-acceleration / 2, speed, 0.5]
    duration = 2 * half
    return Trajectory([0.0, half, duration], coefficients, [0.0, duration])


def test_a_motion_within_its_limits_is_feasible():
    certificate = verify(PROBLEM, bang_bang(1.0))
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(2.0)


def test_a_motion_beyond_a_limit_is_dilated():
    """Four times the acceleration needs twice the time."""
    motion = bang_bang(4.0)
    certificate = verify(PROBLEM, motion)
    assert not certificate.feasible
    assert certificate.acceleration.value == pytest.approx(4.0)
    assert certificate.dilation == pytest.approx(2.0)
    slower = certified(PROBLEM, motion)
    assert slower.duration == pytest.approx(2.0)


def test_a_missed_waypoint_is_a_flaw():
    elsewhere = Problem([[0.0], [1.1]], PROBLEM.limits)
    certificate = verify(elsewhere, bang_bang(1.0))
    assert not certificate.valid
    assert "misses the waypoint" in certificate.flaws[0]


def test_when_a_motion_passes_its_waypoints():
    waypoints = np.array([[0.0], [0.5], [1.0]])
    times = waypoint_times(bang_bang(1.0), waypoints)
    assert times.tolist() == [0.0, 1.0, 2.0]
