"""The interior-point method of `exact`: against closed forms, differences, and IPOPT."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from baselines.exact import interior_point
from baselines.exact.acceleration import Exact, Scaled, starting_points
from baselines.exact.cells import Cells, Rows
from baselines.exact.newton_step import Linear
from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites import families
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem


def duration(problem: Problem) -> float:
    """The optimum from the first start, s."""
    scaled = Scaled(problem)
    iterate = interior_point.begun(Cells(scaled, starts=1), list(starting_points(scaled, 1)))
    iterate = interior_point.descended(iterate, interior_point.converged)
    assert interior_point.converged(iterate.state)
    return scaled.unit * float(iterate.state.rows.times.sum())


def by_ipopt(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> float:
    """IPOPT's optimum, s."""
    with monkeypatch.context() as patch:
        patch.setattr(interior_point, "_MOST_STEPS", 1)
        stats = Exact(starts=1).solve(problem).stats
    assert stats["start_status"] == ["Solve_Succeeded"]
    return float(stats["start_duration"][0])


@pytest.mark.parametrize("length", [1e-9, 1e-3, 1.0, 1e4])
def test_one_way_in_one_joint(length: float) -> None:
    problem = Problem([[0.0], [length]], Limits([1.0], [2.0]))
    cruising = length / 1.0 + 1.0 / 2.0  # h/V + V/A
    triangle = 2 * np.sqrt(length / 2.0)  # 2 √(h/A)
    expected = cruising if length > 0.5 else triangle  # where the peak √(h A) is 1
    assert duration(problem) == pytest.approx(expected, rel=1e-11)


def test_waypoints_on_a_monotone_path_cost_nothing() -> None:
    path = np.cumsum([0, 0.3, 0.4, 1.2, 0.05, 0.9])
    problem = Problem(path[:, None], Limits([[-0.3, 0.8]], [[-1.0, 3.0]]))
    # speed up at 3, cruise at 0.8, brake at 1: h/V + V/2 (1/3 + 1/1)
    expected = path[-1] / 0.8 + 0.8 / 2 * (1 / 3 + 1)
    assert duration(problem) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("name", ["six-axis", "asymmetric", "seven-waypoints", "resting-joint"])
def test_ipopt_finds_the_same_optimum(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = load(name)
    assert duration(problem) == pytest.approx(by_ipopt(problem, monkeypatch), rel=1e-9)


@pytest.mark.parametrize("seed", range(40, 55))
def test_ipopt_finds_the_same_optimum_of_random_ones(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = random_problem(seed, jerk=False)
    assert duration(problem) == pytest.approx(by_ipopt(problem, monkeypatch), rel=1e-9)


def test_where_it_fails_ipopt_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = load("six-axis")
    monkeypatch.setattr(interior_point, "_MOST_STEPS", 5)
    solution = Exact().solve(problem)
    assert solution.stats["start_status"] == ["Solve_Succeeded"] * 2
    assert solution.trajectory is not None
    assert verify(problem, solution.trajectory).feasible


@pytest.mark.parametrize("joints", [1, 3])
@pytest.mark.parametrize("segments", [1, 2, 5])
def test_a_step_changes_rows_as_differences_say(segments: int, joints: int) -> None:
    """Rows are differentiated by hand: along a step they change as they do in small."""
    rng = np.random.default_rng(segments)
    path = np.cumsum(rng.uniform(-1, 1, (segments + 1, joints)), axis=0)
    sides = rng.uniform(0.5, 2.0, (2, joints, 2)) * [-1, 1]
    scaled = Scaled(Problem(path, Limits(*sides)))
    cells = Cells(scaled, starts=2)
    ((times, velocities),) = starting_points(scaled, 1)
    velocities = velocities + rng.uniform(-0.1, 0.1, (2, *velocities.shape))
    point = cells.start(np.stack([times, 0.9 * times]), velocities)
    multipliers = rng.uniform(0.1, 1.0, (2, 2, *cells.every))
    linear = Linear(Rows(cells, point), multipliers, multipliers)
    factors, _ = interior_point.factors(linear.matrices(), np.zeros(2))
    step, change = linear.step(factors, multipliers)
    small = np.full(2, 1e-6)
    ahead = Rows(cells, point.moved(step, small)).values
    behind = Rows(cells, point.moved(step, -small)).values
    differences = (ahead - behind) / 2e-6
    np.testing.assert_allclose(change, differences, atol=1e-6 * np.abs(change).max())


def test_families_of_extremes_converge() -> None:
    """Segments of 1e-9 rad to 15 000 rad and limits a million to one apart, most of them."""
    problems = []
    for family in ("tiny", "huge", "unequal"):
        problems += islice(families.stream(family), 6)
    converged = [Exact(starts=1).solve(problem).stats["start_status"] for problem in problems]
    assert converged.count(["Converged"]) >= 0.9 * len(problems)
