"""The motion of an optimum under jerk limits is certified as claimed, whatever is rounded."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from baselines.exact import jerk_motion
from baselines.exact.jerk import ExactJerk
from experiments.known_optima import line
from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites.catalogue import load

NAMES = {
    "random-huge-j8-w30-jerk-07": 1e-9,  # 16,839 s, dips of 5e-5 s at the velocity limit
    "random-collinear-j8-w50-jerk-06": 1e-9,  # one jerk throughout a segment
    "random-huge-j12-w30-jerk-17": 1e-9,
    "random-tiny-j7-w10-jerk-17": 1e-9,  # segments a thousandth of the others
    # Ramps of 3e-4 s after 25,000 s, where times are stored to 4e-12 s: 1e-8 of a ramp.
    "random-unequal-j8-w50-jerk-11": 5e-8,
}


@pytest.mark.parametrize(("name", "rounding"), NAMES.items())
def test_the_motion_is_certified_as_claimed(name: str, rounding: float) -> None:
    problem = load(name)
    solution = ExactJerk().solve(problem)
    assert solution.trajectory is not None
    assert verify(problem, solution.trajectory).dilation <= 1 + rounding
    assert solution.trajectory.duration <= min(solution.stats["start_duration"]) * (1 + 1e-9)


@pytest.mark.parametrize("seed", [15, 294, 335])
def test_jerk_limits_may_differ_up_and_down(seed: int) -> None:
    """On straight lines most segments have one motion only, here with two jerk limits."""
    problem = line(np.random.default_rng([26, seed]))
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert verify(problem, trajectory).dilation <= 1 + 1e-9


def test_a_turn_is_braked_with_one_jerk() -> None:
    """Forth and back: by symmetry the joint turns at the waypoint, in the middle of the brake."""
    problem = Problem([[0.0], [1.0], [0.0]], Limits([10.0], [100.0], [1.0]))
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    # Jerk 1 for a time of 1, then -1 for s, until the velocity is 0: 1/2 + s - s²/2 = 0. A way of 1
    # instead of 1/6 + s/2 + s²/2 - s³/6 scales the times by its third root.
    s = 1 + np.sqrt(2)
    way = 1 / 6 + s / 2 + s**2 / 2 - s**3 / 6
    half = (1 + s) / np.cbrt(way)
    assert trajectory.duration == pytest.approx(2 * half, rel=1e-9)
    # but for phases of the barrier, as brief as the root of its gap
    lengths = trajectory.lengths
    jerk = np.abs(trajectory(trajectory.breaks[:-1] + lengths / 2, order=3)[:, 0])
    assert lengths[np.abs(jerk - 1) > 1e-6].sum() < 1e-2


def test_breaks_of_a_segment_are_shared() -> None:
    """Between two waypoints no joint has a break that another one has 1e-9 s earlier or later."""
    problem = load("robots-franka-fr3-w8-jerk")
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert trajectory.lengths.min() > 1e-8


def test_a_motion_that_is_never_certified_is_an_answer_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The judge says what is wrong with it, not an exception."""
    uncertain = SimpleNamespace(certified_duration=None)
    monkeypatch.setattr(jerk_motion, "verify", lambda problem, trajectory: uncertain)
    problem = Problem([[0.0], [1.0], [0.0]], Limits([10.0], [100.0], [1.0]))
    assert ExactJerk().solve(problem).trajectory is not None
