"""`exact:within=…`: near enough to an optimum, many problems at once."""

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from trajopt import InvalidInput, Limits, Problem, verify

WITHIN = 1e-4


def noisy_line(seed: int, points: int = 24, joints: int = 3) -> Problem:
    """Targets along a smooth way, with noise of a tenth of the tolerance."""
    rng = np.random.default_rng(seed)
    share = np.linspace(0, 1, points)[:, None]
    way = share * rng.uniform(0.3, 0.8, joints) + 0.1 * np.sin(2 * np.pi * share)
    noise = rng.normal(0, 5e-4, way.shape)
    limits = Limits(velocity=[2.0] * joints, acceleration=[10.0] * joints)
    return Problem(way + noise, limits, tolerance=5e-3)


def test_a_straight_way_takes_the_time_of_its_trapezoid():
    # 1 rad at 2 rad/s and 10 rad/s²: v/a to speed up, as long to brake, the rest at full velocity
    least = 1 / 2 + 2 / 10
    problem = Problem(
        np.linspace(0, 1, 30)[:, None], Limits(velocity=[2.0], acceleration=[10.0]), tolerance=5e-3
    )
    found = verify(problem, Exact(within=WITHIN).solve(problem).trajectory)
    assert least <= found.certified_duration * (1 + 1e-12) <= least * (1 + 5 * WITHIN)


def test_near_is_near_the_optimum():
    problem = noisy_line(0, points=8, joints=2)
    near = verify(problem, Exact(within=WITHIN).solve(problem).trajectory)
    best = Exact().solve(problem).trajectory.duration
    assert best * (1 - 1e-9) <= near.certified_duration <= best * (1 + 10 * WITHIN)


def test_problems_of_one_shape_are_solved_together():
    problems = [noisy_line(seed) for seed in range(4)]
    planner = Exact(within=WITHIN)
    together = planner.solve_many(problems)
    for problem, own in zip(problems, together, strict=True):
        alone = planner.solve(problem).trajectory.duration
        assert own.trajectory.duration == pytest.approx(alone, rel=10 * WITHIN)
        assert verify(problem, own.trajectory).certified_duration is not None


def test_a_start_in_motion():
    problem = noisy_line(1)
    moving = Problem(
        problem.waypoints, problem.limits, tolerance=5e-3, start_velocity=[0.5, 0.5, 0.3]
    )
    still = Exact(within=WITHIN).solve(problem).trajectory
    found = verify(moving, Exact(within=WITHIN).solve(moving).trajectory)
    assert found.certified_duration < still.duration


def test_within_is_a_share():
    with pytest.raises(InvalidInput, match="within"):
        Exact(within=-0.1)
