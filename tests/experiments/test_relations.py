"""The relations of mathematics.md, section 8, on random problems.

The same relations run on hundreds of problems in `experiments/soaks/relations.py`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from baselines.collocation.uniform import Collocation
from baselines.exact.acceleration import Exact
from baselines.ruckig_ import RuckigStop, RuckigVia
from baselines.spline353_nlp import Spline353NLP
from baselines.topp_ra import ToppRa, along
from trajopt import Limits, Problem, Solution, verify
from trajopt.benchmark.suites.random import random_problem
from trajopt.planners import spline353
from trajopt.planners.planner import Planner
from trajopt.planners.registry import configured
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.swarm_planner import issa, pso, ssa

SEEDS = range(100, 112)
EXACT = Exact(4)
COLLOCATION = Collocation()
VIA = RuckigVia(600)
STOP = RuckigStop()
TOPPRA = ToppRa(gridpoints=150)
SYMMETRIC = [EXACT, COLLOCATION, STOP, Spline353NLP()]  # whose answers must obey every symmetry


@cache
def solved(planner: Planner, problem: Problem) -> Solution:
    return planner.solve(problem)


@cache
def certified(planner: Planner, problem: Problem) -> float:
    """Certified duration, s; NaN without one."""
    trajectory = solved(planner, problem).trajectory
    duration = verify(problem, trajectory).certified_duration if trajectory else None
    return np.nan if duration is None else duration


drawn = cache(random_problem)


def problem_of(seed: int, waypoints: int | None = None, jerk: bool = False) -> Problem:
    """Return one object per seed."""
    return drawn(seed, waypoints=waypoints, jerk=jerk)


def rewritten(problem: Problem, waypoints: np.ndarray, **changes: np.ndarray) -> Problem:
    kept = {n: getattr(problem.limits, n) for n in ("velocity", "acceleration", "jerk", "position")}
    return Problem(waypoints, Limits(**(kept | changes)))


@pytest.mark.parametrize(
    "planner", [COLLOCATION, VIA, STOP, TOPPRA], ids=lambda p: type(p).__name__
)
@pytest.mark.parametrize("seed", SEEDS)
def test_exact_is_never_above_another_planner(planner: Planner, seed: int) -> None:
    exact = certified(EXACT, problem_of(seed))
    assert np.isfinite(exact)
    assert not certified(planner, problem_of(seed)) < exact * (1 - 1e-6)


@pytest.mark.parametrize("planner", [pso, ssa, issa, Spline353NLP(starts=1)])
@pytest.mark.parametrize("seed", SEEDS)
def test_exact_is_never_above_a_spline(planner: Planner, seed: int) -> None:
    problem = problem_of(seed, waypoints=4)
    quick = configured(planner, {"iterations": 20} if planner in (pso, ssa, issa) else {})
    assert certified(quick, problem) >= certified(EXACT, problem) * (1 - 1e-6)


@pytest.mark.parametrize("jerk", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_ruckig_through_is_never_above_ruckig_stopping(seed: int, jerk: bool) -> None:
    problem = problem_of(seed, jerk=jerk)
    through, stopping = (solved(planner, problem).trajectory for planner in (VIA, STOP))
    assert through is not None
    assert stopping is not None
    assert through.duration <= stopping.duration * (1 + 1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_stopping_with_ruckig_is_the_closed_form(seed: int) -> None:
    assert certified(STOP, problem_of(seed)) == pytest.approx(
        stop_times(problem_of(seed)).sum(), rel=1e-9
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_without_the_jerk_limit_is_never_slower(seed: int) -> None:
    problem = problem_of(seed, jerk=True)
    bound = solved(EXACT, problem).trajectory.duration
    for planner in (COLLOCATION, STOP):
        assert not certified(planner, problem) < bound * (1 - 1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_with_ever_stiffer_jerk_the_optimum_tends_to_exact(seed: int) -> None:
    problem = random_problem(seed, joints=2, waypoints=3)
    tighter = np.abs(problem.limits.acceleration).min(axis=1)
    durations = [
        certified(Collocation(40), rewritten(problem, problem.waypoints, jerk=tighter * factor))
        for factor in (1.0, 10.0, 1000.0)
    ]
    exact = certified(EXACT, problem)
    assert durations[0] > durations[1] > durations[2] > exact * (1 - 1e-6)
    assert durations[2] < exact * 1.02


@pytest.mark.parametrize("seed", SEEDS)
def test_topp_ra_along_a_spline_is_never_above_its_own_timing(seed: int) -> None:
    problem = random_problem(seed, waypoints=4)
    times = np.random.default_rng(seed).uniform(0.5, 2, 3)
    own = spline353.trajectory(problem, times)
    duration = verify(problem, own).certified_duration
    retimed = along(problem, own).trajectory
    assert duration is not None
    assert retimed is not None
    again = verify(problem, retimed)
    assert again.valid, again.flaws
    assert again.certified_duration is not None
    assert again.certified_duration <= duration * 1.01  # the grid


@pytest.mark.parametrize("planner", [pso, ssa, issa])
@pytest.mark.parametrize("fitness", ["penalty", "scaled"])
@pytest.mark.parametrize("seed", [101, 105, 109])
def test_the_best_spline_is_never_above_a_swarm(planner: Planner, fitness: str, seed: int) -> None:
    problem = problem_of(seed, waypoints=4)
    swarm = configured(planner, {"fitness": fitness, "iterations": 120})
    assert certified(swarm, problem) >= certified(Spline353NLP(), problem) * (1 - 1e-8)


@pytest.mark.parametrize("planner", SYMMETRIC, ids=lambda p: type(p).__name__)
@pytest.mark.parametrize("seed", SEEDS[::3])
class TestSymmetries:
    """Relations that the optimum and deterministic planners obey."""

    # Collocation is a local optimum from one start; the others are the best of several.
    def compare(self, planner: Planner, a: Problem, b: Problem, factor: float = 1.0) -> None:
        first = certified(planner, a)
        second = certified(planner, b)
        assert first == pytest.approx(factor * second, rel=1e-6)

    def problem(self, planner: Planner, seed: int) -> Problem:
        if planner.unsupported(problem_of(seed)):
            return problem_of(seed, waypoints=4)
        return problem_of(seed)

    def test_scaling_velocity_and_acceleration(self, planner: Planner, seed: int) -> None:
        problem = self.problem(planner, seed)
        c = 3.7
        velocity = problem.limits.velocity * c
        acceleration = problem.limits.acceleration * c**2
        faster = rewritten(problem, problem.waypoints, velocity=velocity, acceleration=acceleration)
        self.compare(planner, problem, faster, c)

    def test_permuting_the_joints(self, planner: Planner, seed: int) -> None:
        problem = self.problem(planner, seed)
        order = np.random.default_rng(seed).permutation(problem.joints)
        limits = {
            n: getattr(problem.limits, n)[order]
            for n in ("velocity", "acceleration", "jerk", "position")
        }
        self.compare(planner, problem, rewritten(problem, problem.waypoints[:, order], **limits))

    def test_mirroring_a_joint_swaps_its_limits(self, planner: Planner, seed: int) -> None:
        problem = self.problem(planner, seed)
        signs = np.where(np.arange(problem.joints) % 2, -1.0, 1.0)
        limits = {}
        for name in ("velocity", "acceleration", "jerk", "position"):
            pairs = getattr(problem.limits, name)
            limits[name] = np.where(signs[:, None] < 0, -pairs[:, ::-1], pairs)
        self.compare(planner, problem, rewritten(problem, problem.waypoints * signs, **limits))

    def test_reversing_the_waypoints_swaps_the_velocity_limits(
        self, planner: Planner, seed: int
    ) -> None:
        problem = self.problem(planner, seed)
        velocity = -problem.limits.velocity[:, ::-1]
        self.compare(
            planner, problem, rewritten(problem, problem.waypoints[::-1], velocity=velocity)
        )
