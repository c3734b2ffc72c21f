"""Read me first: two transcriptions that turn a problem into a nonlinear program for IPOPT."""

from __future__ import annotations

import pytest

from baselines.collocation.refined import CollocationRefined
from baselines.collocation.uniform import Collocation
from trajopt import Limits, Problem, Trajectory, verify

# forth and back between position limits: two stops, each 1.2/2 + 1/1.2 s
LIMITS = Limits([1.2], [2.0], position=[[0.0, 1.0]])
PROBLEM = Problem([[0.0], [1.0], [0.0]], LIMITS)
OPTIMUM = 2 * (1.2 / 2 + 1 / 1.2)


def certified(trajectory: Trajectory | None) -> float:
    """Return the certified duration of a trajectory that keeps every limit."""
    assert trajectory is not None
    certificate = verify(PROBLEM, trajectory)
    assert certificate.feasible
    return certificate.certified_duration


def test_equal_intervals_approach_the_optimum_from_above() -> None:
    coarse = Collocation(intervals=10).solve(PROBLEM).trajectory
    fine = Collocation(intervals=40).solve(PROBLEM).trajectory
    assert OPTIMUM * (1 - 1e-9) <= certified(fine) <= certified(coarse)


def test_free_intervals_reach_it_and_estimate_their_own_error() -> None:
    solution = CollocationRefined(starts=1).solve(PROBLEM)
    assert certified(solution.trajectory) == pytest.approx(OPTIMUM, rel=1e-6)
    assert solution.stats["error_estimate"] <= 1e-4
