"""Motions whose ramps are brief beside their segments: claimed and certified durations agree."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines.exact.jerk_reach import Scaled, repaired
from trajopt import Limits, Problem, verify

Array = NDArray[np.float64]


def rest_to_rest(h: Array, velocity: float, acceleration: float, jerk: float) -> Array:
    """The least times from rest to rest that cruise at the velocity limit, s."""
    ramp = velocity / acceleration + acceleration / jerk
    if velocity * jerk < acceleration**2:
        ramp = 2 * np.sqrt(velocity / jerk)
    return h / velocity + ramp


@pytest.mark.parametrize(
    ("velocity", "acceleration", "jerk"),
    [
        # ramps of 4e-4 s, and with a hold of the acceleration limit, in segments of 500 to 1000 s
        (1.9e-6, 1.0, 41.0),
        (0.077, 1.0, 430.0),
        (1e-3, 1.0, 1e3),
        # of 6e-4 s, whose highest acceleration is 3e-5 of its limit
        (1e-8, 1.0, 0.1),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ramps_of_a_millisecond_in_segments_of_minutes(
    velocity: float,
    acceleration: float,
    jerk: float,
    sign: float,
) -> None:
    """The segments take their closed-form times, at rest at every waypoint.

    A trajectory of hours stores times to 4e-12 s. Left as they are rounded, the ramps jump by 1e-8
    of their acceleration; mended over a cruise of minutes, that is worth up to 5e-3 of the speed.
    """
    rng = np.random.default_rng(0)
    distances = velocity * rng.uniform(500.0, 1000.0, 20)
    waypoints = sign * np.r_[0.0, np.cumsum(distances)]
    problem = Problem(waypoints[:, None], Limits([velocity], [acceleration], [jerk]))
    times = rest_to_rest(distances, velocity, acceleration, jerk)
    scaled = Scaled(problem)
    at_rest = np.zeros((2, 21, 1))
    motion = scaled.motion(times / scaled.unit, at_rest)
    certificate = verify(problem, motion)
    assert certificate.certified_duration == pytest.approx(times.sum(), rel=1e-9)


@pytest.mark.parametrize("excess", [1e-9, 1e-8, 1e-7, 1e-6])
def test_breaks_of_two_joints_that_are_nearly_one(excess: float) -> None:
    """Jerk limits that differ a little: ramps end 1e-13 to 1e-10 s apart, and are stored as one."""
    velocity, jerk = 1.9e-6, 41.0
    rng = np.random.default_rng(0)
    distances = velocity * rng.uniform(500.0, 1000.0, 20)
    waypoints = np.r_[0.0, np.cumsum(distances)]
    jerks = jerk * (1 + excess * np.arange(3))
    limits = Limits(np.full(3, velocity), np.ones(3), jerks)
    problem = Problem(np.tile(waypoints[:, None], 3), limits)
    times = rest_to_rest(distances, velocity, 1.0, jerk)
    scaled = Scaled(problem)
    at_rest = np.zeros((2, 21, 3))
    motion = scaled.motion(times / scaled.unit, at_rest)
    certificate = verify(problem, motion)
    assert certificate.certified_duration == pytest.approx(times.sum(), rel=1e-9)


@pytest.mark.parametrize("excess", [1e-7, 1e-6, 5e-6])
def test_breaks_that_another_joint_can_do_without(excess: float) -> None:
    """The second joint has less to do and a little more jerk: it can change with the first."""
    velocity, acceleration, jerk = 1.0, 10.0, 50.0
    distances = np.array([3.0, 5.0])
    jerks = jerk * np.array([1.0, 1 + excess])
    limits = Limits(np.full(2, velocity), np.full(2, acceleration), jerks)
    waypoints = np.r_[0.0, np.cumsum(distances)]
    problem = Problem(np.outer(waypoints, [1.0, 0.9]), limits)
    times = rest_to_rest(distances, velocity, acceleration, jerk)
    scaled = Scaled(problem)
    motion = scaled.motion(times / scaled.unit, np.zeros((2, 3, 2)))
    certificate = verify(problem, motion)
    assert certificate.certified_duration == pytest.approx(times.sum(), rel=1e-9)
    assert np.diff(motion.breaks).min() > 1e-6


def test_waypoints_within_ramps() -> None:
    """One way at the velocity limit, through waypoints in both ramps: the closed-form time.

    Pieces of 1e-12 s, which rounding leaves beside the waypoints, are too brief to be stored.
    """
    velocity, jerk = 2e-6, 40.0
    distance = 2000.0 * velocity
    (duration,) = rest_to_rest(np.array([distance]), velocity, 1.0, jerk)
    # where jerk changes its sign: at half of the speed, after j t³/6
    half_ramp = np.sqrt(velocity / jerk)
    inside = jerk * half_ramp**3 / 6
    waypoints = np.array([0.0, inside, distance - inside, distance])
    problem = Problem(waypoints[:, None], Limits([velocity], [1.0], [jerk]))
    scaled = Scaled(problem)
    times = np.array([half_ramp, duration - 2 * half_ramp, half_ramp])
    states = np.zeros((2, 4, 1))
    states[0, 1:3, 0] = velocity / 2
    states[1, 1:3, 0] = [jerk * half_ramp, -jerk * half_ramp]
    _, a_unit, v_unit, _ = scaled.units
    k, reached, unitless = repaired(
        times / scaled.unit,
        states / np.stack([v_unit, a_unit])[:, None],
        scaled,
    )
    # rounded coordinates take 2e-9 more
    assert k == pytest.approx(1, abs=1e-8)
    dilated = unitless / np.array([k, k**2])[:, None, None]
    motion = scaled.motion(k * reached, dilated)
    certificate = verify(problem, motion)
    assert certificate.certified_duration == pytest.approx(duration, rel=1e-8)
