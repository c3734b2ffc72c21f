"""The best 3-5-3 spline against a global search over both ratios of its times."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from baselines.spline353_nlp import Spline353NLP
from trajopt import Limits, Problem, Status, spline353, verify
from trajopt.benchmark.suites.catalogue import load, problem_files
from trajopt.benchmark.suites.random import random_problem

FOUR = [name for name in problem_files() if spline353.unsupported(load(name)) is None]


def global_search(problem: Problem) -> float:
    """Uniform time scaling: only two ratios matter. Random ratios, the best ones polished."""
    merged = problem.merged()[0]
    h = merged.displacements.T

    def duration(log_ratios: np.ndarray) -> np.ndarray:
        times = np.exp(np.insert(log_ratios, 1, 0.0, axis=-1))
        k = spline353.dilation(h, times[..., None, :], merged.limits)
        return k * times.sum(axis=-1)

    rng = np.random.default_rng(1)
    points = rng.normal(scale=2.5, size=(20000, 2))
    best = points[np.argsort(duration(points))[:3]]
    options = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 2000, "maxfev": 4000}
    found = [minimize(duration, x, method="Nelder-Mead", options=options).fun for x in best]
    return float(min(found))


@pytest.mark.parametrize("name", FOUR)
def test_shipped_problems_reach_the_global_search(name: str) -> None:
    problem = load(name)
    solution = Spline353NLP().solve(problem)
    assert solution.status is Status.SOLVED
    assert solution.trajectory is not None
    assert verify(problem.without("position"), solution.trajectory).feasible
    assert solution.trajectory.duration <= global_search(problem) * (1 + 1e-8)


@pytest.mark.parametrize("seed", range(8))
def test_random_problems_reach_the_global_search(seed: int) -> None:
    problem = random_problem(seed, waypoints=4, jerk=seed % 2 == 0)
    if spline353.unsupported(problem):
        pytest.fail("the generator promised four waypoints")
    solution = Spline353NLP().solve(problem)
    assert solution.trajectory is not None
    assert verify(problem, solution.trajectory).feasible
    assert solution.trajectory.duration <= global_search(problem) * (1 + 1e-6)


def test_the_limits_hold_at_every_instant_not_on_a_grid() -> None:
    problem = load("six-axis")
    trajectory = Spline353NLP().solve(problem).trajectory
    assert trajectory is not None
    assert verify(problem, trajectory).dilation == pytest.approx(1, abs=1e-9)


def test_scaling_the_limits_scales_the_time() -> None:
    problem = load("reversal")
    limits = problem.limits
    faster = Problem(problem.waypoints, Limits(limits.velocity * 3, limits.acceleration * 9))
    slow, fast = (Spline353NLP().solve(p).trajectory for p in (problem, faster))
    assert slow is not None
    assert fast is not None
    assert slow.duration == pytest.approx(3 * fast.duration, rel=1e-8)


def test_five_waypoints_are_refused_with_a_reason() -> None:
    assert Spline353NLP().unsupported(load("seven-waypoints")) == (
        "the 3-5-3 spline takes exactly 4 waypoints; this has 7"
    )
