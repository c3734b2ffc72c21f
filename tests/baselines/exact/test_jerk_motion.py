"""Phases that take no time at the optimum are not left by the barrier: the motion is its own."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.jerk import ExactJerk
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load

NAMES = [
    "random-huge-j8-w30-jerk-07",  # 16,839 s, dips of 5e-5 s at the velocity limit
    "random-collinear-j8-w50-jerk-06",  # one jerk throughout a segment
    "random-unequal-j8-w50-jerk-11",  # ramps of 3e-4 s after 25,000 s
    "random-huge-j12-w30-jerk-17",
    "random-tiny-j7-w10-jerk-17",  # segments a thousandth of the others
]


def briefest(trajectory: Trajectory) -> float:
    """The shortest time, s, between two changes of some joint's jerk."""
    shortest = np.inf
    for jerk in trajectory.coefficients[0].T:
        changes = np.flatnonzero(np.diff(jerk)) + 1
        times = trajectory.breaks[np.r_[0, changes, -1]]
        shortest = min(shortest, np.diff(times).min())
    return shortest


@pytest.mark.parametrize("name", NAMES)
def test_the_motion_is_certified_as_claimed_without_pieces_of_the_barrier(name: str) -> None:
    problem = load(name)
    solution = ExactJerk().solve(problem)
    assert solution.trajectory is not None
    assert verify(problem, solution.trajectory).dilation <= 1 + 1e-9
    assert solution.trajectory.duration <= min(solution.stats["start_duration"]) * (1 + 1e-11)
    assert briefest(solution.trajectory) > 1e-6


def test_a_turn_has_one_jerk_on_either_side() -> None:
    """Forth and back: by symmetry the joint turns at the waypoint, in the middle of the brake."""
    problem = Problem([[0.0], [1.0], [0.0]], Limits([10.0], [100.0], [1.0]))
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    # Jerk 1 for a time of 1, then -1 for s, until the velocity is 0: 1/2 + s - s²/2 = 0. A way of 1
    # instead of 1/6 + s/2 + s²/2 - s³/6 scales the times by its third root.
    s = 1 + np.sqrt(2)
    way = 1 / 6 + s / 2 + s**2 / 2 - s**3 / 6
    half = (1 + s) / np.cbrt(way)
    assert trajectory.duration == pytest.approx(2 * half, rel=1e-10)
    assert briefest(trajectory) > 0.1
