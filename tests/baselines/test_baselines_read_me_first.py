"""Read me first: a baseline is a planner that is found by its name, and judged as all others are.

The folders beside this file are those of `baselines`; each says in its `test_read_me_first.py` what
it is for.
"""

from __future__ import annotations

import pytest

from trajopt import Limits, Problem, Relation, verify
from trajopt.planners.registry import entries, load

# One joint that moves one way loses nothing at a waypoint on its way: h/V + V/A = 1.5/1 + 1/2.
PROBLEM = Problem([[0.0], [0.4], [1.5]], Limits([1.0], [2.0]))
OPTIMUM = 2.0


def certified(name: str) -> float:
    trajectory = load(name).solve(PROBLEM).trajectory
    assert trajectory is not None
    duration = verify(PROBLEM, trajectory).certified_duration
    assert duration is not None
    return duration


@pytest.mark.parametrize("name", ["exact", "exact-jerk", "collocation-refined", "ruckig-search"])
def test_the_optimum_is_found_by_methods_that_share_nothing(name: str) -> None:
    assert certified(name) == pytest.approx(OPTIMUM, rel=1e-4)


@pytest.mark.parametrize("name", ["toppra", "collocation", "spline"])
def test_others_come_near_it_and_never_below(name: str) -> None:
    assert OPTIMUM * (1 - 1e-9) <= certified(name) < 1.3 * OPTIMUM


def test_ruckig_alone_stops_at_every_waypoint() -> None:
    # 2 √(h/A) where the velocity limit is not reached, h/V + V/A where it is
    assert certified("ruckig-stop") == pytest.approx(2 * (0.4 / 2) ** 0.5 + 1.1 + 1 / 2)


def test_a_proof_holds_the_optimum_from_below() -> None:
    bound = load("prove").solve(PROBLEM).lower_bound
    assert bound is not None
    assert OPTIMUM * (1 - 1e-3) < bound <= OPTIMUM


def test_a_baseline_says_which_limits_it_ignores() -> None:
    limited = Problem(PROBLEM.waypoints, Limits([1.0], [2.0], jerk=[5.0]))
    assert load("exact").relation(PROBLEM) is Relation.SAME
    assert load("exact").relation(limited) is Relation.RELAXATION
    assert load("toppra").unsupported(limited) is not None


def test_a_baseline_that_lacks_its_package_names_the_extra() -> None:
    missing = entries()["copp"].missing()
    assert missing is None or missing.endswith('pip install "mintime[copp]"')
