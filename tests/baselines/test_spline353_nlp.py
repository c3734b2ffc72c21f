"""The best 3-5-3 spline against a global search over both ratios of its times."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize
from work import one_in

from baselines.spline353_nlp import Spline353NLP
from trajopt import Limits, Problem, Solution, Status, verify
from trajopt.benchmark.suites.catalogue import load, problem_files
from trajopt.benchmark.suites.random import random_problem
from trajopt.planners import spline353

FOUR = [name for name in problem_files() if spline353.unsupported(load(name)) is None]


@cache
def shipped(name: str) -> Solution:
    return Spline353NLP().solve(load(name))


def global_search(problem: Problem) -> float:
    """Uniform time scaling: only two ratios matter. Nelder and Mead from the best random ratios."""
    merged = problem.merged()[0]
    h = merged.displacements.T
    room = spline353.position_room(merged)

    def durations(log_ratios: np.ndarray) -> np.ndarray:
        times = np.exp(np.insert(log_ratios, 1, 0.0, axis=-1))[..., None, :]
        k = spline353.dilation(h, times, merged.limits)
        total = k * times.sum(axis=(-2, -1))
        if room is None:
            return total
        leaves = spline353.position_excess(h, times, room).any(axis=-1)
        return np.where(leaves, np.inf, total)

    rng = np.random.default_rng(1)
    points = rng.normal(scale=2.5, size=(6000, 2))
    found = []
    for start in points[np.argsort(durations(points))[:3]]:
        end = minimize(
            lambda point: float(durations(point[None])[0]),
            start,
            method="Nelder-Mead",
            options={"xatol": 1e-11, "fatol": 1e-11},
        )
        found.append(end.fun)
    return float(min(found))


@pytest.mark.parametrize("name", one_in(4, FOUR))
def test_shipped_problems_reach_the_global_search(name: str) -> None:
    problem = load(name)
    solution = shipped(name)
    assert solution.status is Status.SOLVED
    assert solution.trajectory is not None
    assert verify(problem, solution.trajectory).feasible
    assert solution.trajectory.duration <= global_search(problem) * (1 + 1e-8)


@pytest.mark.parametrize("seed", one_in(4, range(8)))
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
    trajectory = shipped("six-axis").trajectory
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


def walled_problem(seed: int) -> Problem:
    """Walls at up to a tenth of the way around the waypoints of a random problem."""
    free = random_problem(seed, waypoints=4, jerk=seed % 2 == 0)
    rng = np.random.default_rng(seed)
    margin = rng.uniform(0.02, 0.1, (2, free.joints)) * np.ptp(free.waypoints, axis=0)
    low = free.waypoints.min(axis=0) - margin[0]
    high = free.waypoints.max(axis=0) + margin[1]
    limits = free.limits.by_name() | {"position": np.stack([low, high], axis=1)}
    return Problem(free.waypoints, Limits(**limits))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_position_limits_are_kept_and_cost_no_more_than_they_must(seed: int) -> None:
    problem = walled_problem(seed)
    solution = Spline353NLP().solve(problem)
    assert solution.trajectory is not None
    assert verify(problem, solution.trajectory).feasible
    assert solution.trajectory.duration <= global_search(problem) * (1 + 1e-6)
    free = Spline353NLP().solve(problem.without("position")).trajectory
    assert free is not None
    assert solution.trajectory.duration >= free.duration * (1 - 1e-9)


def test_limits_that_are_never_met_change_nothing() -> None:
    free = load("six-axis")
    limits = free.limits.by_name() | {"position": np.full((6, 2), [-1e3, 1e3])}
    far = Spline353NLP().solve(Problem(free.waypoints, Limits(**limits))).trajectory
    near = shipped("six-axis").trajectory
    assert far is not None
    assert near is not None
    assert far.duration == pytest.approx(near.duration, rel=1e-9)


def test_a_waypoint_a_hair_from_its_limit_is_still_passed() -> None:
    """The price grows as the distance to the power −2/3 (docs/mathematics.md, section 1)."""
    durations = []
    for distance in (1e-3, 1e-6):
        limits = Limits([2.0], [5.0], position=[[-1.0, 1.0]])
        problem = Problem([[0.0], [1 - distance], [0.5], [0.0]], limits)
        solution = Spline353NLP().solve(problem)
        assert solution.trajectory is not None
        assert verify(problem, solution.trajectory).feasible
        durations.append(solution.trajectory.duration)
    assert durations[1] / durations[0] == pytest.approx(1e2, rel=0.1)


def test_a_limit_passed_at_speed_is_infeasible_and_says_why() -> None:
    limits = Limits([2.0], [5.0], position=[[0.0, 1.0]])
    solution = Spline353NLP().solve(Problem([[0.2], [1.0], [0.5], [0.0]], limits))
    assert solution.status is Status.INFEASIBLE
    assert solution.trajectory is None
    assert "joint 1 is at its limit at waypoint 2 and would pass it at speed" in solution.message
