"""The relations of mathematics.md, section 10, on random problems.

The same relations run on hundreds of problems in `tests/soaks/relations.py`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from baselines.collocation.uniform import Collocation
from baselines.exact.acceleration import Exact
from baselines.ruckig_ import RuckigStop, RuckigVia
from baselines.spline353_nlp import Spline353NLP
from baselines.topp_ra import ToppRa
from soaks import relations
from trajopt import verify
from trajopt.benchmark.suites.random import random_problem
from trajopt.planners.registry import configured
from trajopt.planners.swarm_planner import issa, pso, ssa

SEEDS = range(100, 112, 2)
EXACT = Exact(4)
COLLOCATION = Collocation()
VIA = RuckigVia(600)
STOP = RuckigStop()
TOPPRA = ToppRa(gridpoints=150)
BEST_SPLINE = Spline353NLP()
SYMMETRIC = [EXACT, COLLOCATION, STOP, BEST_SPLINE]  # whose answers must obey every symmetry


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


JERK = {"jerk": True}  # which EXACT leaves: it stays a bound
FOUR = {"waypoints": 4}
PAIRS = [
    *((EXACT, other, {}, 1e-6) for other in (COLLOCATION, VIA, STOP, TOPPRA)),
    *((EXACT, other, JERK, 1e-6) for other in (COLLOCATION, STOP)),
    *((VIA, STOP, kind, 1e-12) for kind in ({}, JERK)),
    (EXACT, BEST_SPLINE, FOUR, 1e-6),
    *(
        (BEST_SPLINE, configured(swarm, {"fitness": fitness, "iterations": 120}), FOUR, 1e-8)
        for swarm, fitness in ((pso, "penalty"), (ssa, "scaled"), (issa, "penalty"))
    ),
]


def named(value):
    return f"{value}" if isinstance(value, dict | float) else type(value).__name__


@pytest.mark.parametrize(("least", "other", "kind", "tolerance"), PAIRS, ids=named)
@pytest.mark.parametrize("seed", SEEDS)
def test_no_planner_is_below_one_that_may_do_all_it_does(least, other, kind, tolerance, seed):
    problem = problem_of(seed, **kind)
    shortest = solved(least, problem).trajectory.duration
    assert certified(other, problem) >= shortest * (1 - tolerance)


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
