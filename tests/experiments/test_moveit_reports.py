"""What quintics through states make of acceleration limits: the bound, and a published message."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.moveit_reports import GOALS, READY, reached, rounded, worst_factor
from trajopt import Trajectory
from trajopt.benchmark.suites import catalogue


def peak(states: list[list[float]], duration: float) -> float:
    """The largest acceleration of the quintic between two (position, velocity, acceleration)."""
    position, velocity, acceleration = np.array(states).T[..., None]
    motion = Trajectory.from_samples(
        [0, duration], position, velocity, acceleration, interpolation="quintic"
    )
    return float(np.abs(motion(np.linspace(0, duration, 2001), 2)).max())


def test_no_motion_exceeds_the_bound_and_the_worst_one_reaches_it() -> None:
    """Accelerations of ±1 that switch where the quintic's kernel changes sign, against random."""
    rng = np.random.default_rng(3)
    most, bound = 0.0, worst_factor()
    t = 0.25575  # where the bound is reached
    s = (np.arange(1000) + 0.5) / 1000
    moved, gained = 60 * t - 180 * t**2 + 120 * t**3, -24 * t + 84 * t**2 - 60 * t**3
    worst = np.sign(moved * (1 - s) + gained)
    for trial in range(60):
        accelerations = worst if trial == 0 else rng.choice([-1.0, 1.0], rng.integers(1, 9))
        ends = (-1.0, 1.0) if trial == 0 else (accelerations[0], accelerations[-1])
        step = 1 / len(accelerations)
        gains = np.cumsum(accelerations) * step
        velocity = np.r_[0, gains]
        position = ((velocity[:-1] + velocity[1:]) / 2 * step).sum()
        own = peak([[0, 0, ends[0]], [position, velocity[-1], ends[1]]], 1.0)
        assert own <= bound + 1e-9
        most = max(most, own)
    assert most == pytest.approx(bound, rel=1e-3)


def test_the_message_of_a_public_thread_exceeds_its_limit_between_two_samples() -> None:
    """ros2_controllers #1298, last joint, from 1.1 to 1.2 s: 8 rad/s² at both, 10.12 between."""
    states = [[-3.33909, -2.14474, -7.99726], [-3.52657, -1.48010, 8.00398]]
    assert peak(states, 0.1) == pytest.approx(10.12, abs=0.01)


def test_a_circle_leaves_its_corner_by_totgs_tolerance() -> None:
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
    path = rounded(corners)
    at = np.linspace(0, path.duration, 4001)
    assert np.linalg.norm(path(at) - corners[1], axis=1).min() == pytest.approx(0.1, rel=1e-4)
    np.testing.assert_allclose(np.linalg.norm(path(at, 1), axis=1), 1, atol=1e-4)


def test_the_goals_are_reached() -> None:
    chain = catalogue.load("robots-franka-panda-w4").chain
    assert chain is not None
    assert chain.forward(READY)[2, 3] > 0
    for goal in GOALS[:4]:
        np.testing.assert_allclose(chain.forward(reached(chain, goal))[:3, 3], goal, atol=1e-5)
