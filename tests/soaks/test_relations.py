"""The relations of mathematics.md, section 10, on random problems.

The same relations run on hundreds of problems in `tests/soaks/relations.py`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from work import one_in

from baselines.collocation.uniform import Collocation
from baselines.exact.acceleration import Exact
from baselines.ruckig_ import RuckigStop, RuckigVia
from baselines.spline353_nlp import Spline353NLP
from baselines.topp_ra import ToppRa, along
from soaks import relations
from trajopt import verify
from trajopt.benchmark.suites.random import random_problem
from trajopt.planners import spline353
from trajopt.planners.registry import configured
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.swarm_planner import issa, pso, ssa

SEEDS = range(100, 112, 2)
EXACT = Exact(4)
COLLOCATION = Collocation()
VIA = RuckigVia(600)
STOP = RuckigStop()
TOPPRA = ToppRa(gridpoints=150)
SYMMETRIC = [EXACT, COLLOCATION, STOP, Spline353NLP()]  # whose answers must obey every symmetry


@cache
def solved(planner, problem):
    return planner.solve(problem)


@cache
def certified(planner, problem):
    """Certified duration, s; NaN without one."""
    trajectory = solved(planner, problem).trajectory
    duration = verify(problem, trajectory).certified_duration if trajectory else None
    return np.nan if duration is None else duration


drawn = cache(random_problem)


def problem_of(seed, waypoints=None, jerk=False):
    """Return one object per seed."""
    return drawn(seed, waypoints=waypoints, jerk=jerk)


@pytest.mark.parametrize(
    "planner", [COLLOCATION, VIA, STOP, TOPPRA], ids=lambda p: type(p).__name__
)
@pytest.mark.parametrize("seed", SEEDS)
def test_exact_is_never_above_another_planner(planner, seed):
    problem = problem_of(seed)
    exact = certified(EXACT, problem)
    other = certified(planner, problem)
    assert np.isfinite(exact)
    assert not other < exact * (1 - 1e-6)


SWARMS = (pso, ssa, issa)
QUICK = [configured(planner, {"iterations": 20}) for planner in SWARMS]


@pytest.mark.parametrize("planner", [*QUICK, Spline353NLP(starts=1)])
@pytest.mark.parametrize("seed", SEEDS)
def test_exact_is_never_above_a_spline(planner, seed):
    problem = problem_of(seed, waypoints=4)
    exact = certified(EXACT, problem)
    assert certified(planner, problem) >= exact * (1 - 1e-6)


@pytest.mark.parametrize("jerk", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_ruckig_through_is_never_above_ruckig_stopping(seed, jerk):
    problem = problem_of(seed, jerk=jerk)
    through = solved(VIA, problem).trajectory
    stopping = solved(STOP, problem).trajectory
    assert through is not None
    assert stopping is not None
    assert through.duration <= stopping.duration * (1 + 1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_stopping_with_ruckig_is_the_closed_form(seed):
    problem = problem_of(seed)
    closed_form = stop_times(problem).sum()
    assert certified(STOP, problem) == pytest.approx(closed_form, rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_without_the_jerk_limit_is_never_slower(seed):
    problem = problem_of(seed, jerk=True)
    bound = solved(EXACT, problem).trajectory.duration
    for planner in (COLLOCATION, STOP):
        assert not certified(planner, problem) < bound * (1 - 1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_with_ever_stiffer_jerk_the_optimum_tends_to_exact(seed):
    problem = random_problem(seed, joints=2, waypoints=3)
    tighter = np.abs(problem.limits.acceleration).min(axis=1)
    durations = []
    for factor in (1.0, 10.0, 1000.0):
        limits = replace(problem.limits, jerk=tighter * factor)
        stiffer = replace(problem, limits=limits)
        duration = certified(Collocation(40), stiffer)
        durations.append(duration)
    exact = certified(EXACT, problem)
    soft, stiff, stiffest = durations
    assert soft > stiff > stiffest > exact * (1 - 1e-6)
    assert stiffest < exact * 1.02


@pytest.mark.parametrize("seed", SEEDS)
def test_topp_ra_along_a_spline_is_never_above_its_own_timing(seed):
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


@pytest.mark.parametrize("planner", SWARMS)
@pytest.mark.parametrize("fitness", ["penalty", "scaled"])
@pytest.mark.parametrize("seed", one_in(3, [101, 105, 109]))
def test_the_best_spline_is_never_above_a_swarm(planner, fitness, seed):
    problem = problem_of(seed, waypoints=4)
    swarm = configured(planner, {"fitness": fitness, "iterations": 120})
    best = certified(Spline353NLP(), problem)
    assert certified(swarm, problem) >= best * (1 - 1e-8)


# Collocation is a local optimum from one start; the others are the best of several.
@pytest.mark.parametrize("planner", SYMMETRIC, ids=lambda planner: type(planner).__name__)
@pytest.mark.parametrize("seed", SEEDS[::3])
def test_symmetries_change_nothing(planner, seed):
    problem = problem_of(seed)
    if planner.unsupported(problem):
        problem = problem_of(seed, waypoints=4)
    own = certified(planner, problem)
    for kind, factor, other in relations.alike(problem, seed):
        undone = factor * certified(planner, other)
        assert undone == pytest.approx(own, rel=1e-6), kind
