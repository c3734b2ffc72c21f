"""The suite of times, waits, loops and waypoints within tolerance."""

from __future__ import annotations

import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from trajopt.benchmark.suites import catalogue, demands
from trajopt.judging.verification import verify

CLOSED_FORMS = {"turn": 2.7, "instant": 3.0, "slow": 5.0, "wait": 4.5, "loop": 4.0, "given": 3.0}


@pytest.mark.parametrize("key", CLOSED_FORMS)
def test_closed_forms(key):
    problem = catalogue.given(f"demands-{key}")
    motion = Exact().solve(problem).trajectory
    certificate = verify(problem, motion)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(CLOSED_FORMS[key], rel=1e-9)


def test_forty_of_each_kind():
    drawn = demands.SUITE.problems()
    assert len({problem.digest() for problem in drawn}) == demands.SUITE.size == 206
    of_kind = [next(iter(problem.demands)) for problem in drawn[-demands.RANDOM :]]
    assert {kind: of_kind.count(kind) for kind in demands.KINDS} == dict.fromkeys(demands.KINDS, 40)
    assert all(catalogue.given(problem.name) == problem for problem in drawn[::29])


@pytest.mark.parametrize("index", range(10))
def test_random_ones_are_solved(index):
    problem = demands.draw(index)
    planner = ExactJerk() if problem.has("jerk") else Exact()
    assert verify(problem, planner.solve(problem).trajectory).nearly_feasible
