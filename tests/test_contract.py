"""Every registered planner on every shipped problem, and the public contract check on each."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from trajopt import Relation, Status, verify
from trajopt.benchmark.suites.catalogue import load, problem_files
from trajopt.benchmark.trial import Trial, trials_of
from trajopt.planners.planner import Planner
from trajopt.planners.registry import configured, entries, options
from trajopt.planners.testing import check_planner

# Options that mean less work: the contract does not depend on effort.
_QUICK = {
    "iterations": 4,
    "gridpoints": 50,
    "evaluations": 100,
    "intervals": 10,
    "starts": 1,
    "rounds": 6,
    "refinements": 1,
    "within": 1e-2,
}
# One path instead of the best of twelve, where others' planners follow paths.
_ONE_PATH = {
    "knots": "limit",
    "ends": "natural",
    "gridpoints": 100,
    "points": 5,
    "algorithm": "closed-form",
}
INSTALLED = [name for name, entry in entries().items() if entry.missing() is None]


def third_party(name: str) -> bool:
    return "third_party" in entries()[name].point.module


@cache
def quick(name: str) -> Planner:
    planner = entries()[name].load()
    own = options(planner)
    less = {k: v for k, v in _QUICK.items() if isinstance(own.get(k), int | float)}
    if third_party(name):
        less |= {k: v for k, v in _ONE_PATH.items() if k in own}
    return configured(planner, less, name)


@cache
def trial(name: str, problem: str) -> Trial:
    return trials_of(quick(name), load(problem), [0], name)[0]


@pytest.mark.parametrize("name", INSTALLED)
def test_keeps_the_public_contract(name: str) -> None:
    check_planner(quick(name))


@pytest.mark.parametrize("problem", problem_files())
@pytest.mark.parametrize("name", INSTALLED)
def test_every_problem_ends_in_a_verdict_that_holds(name: str, problem: str) -> None:
    t = trial(name, problem)
    verdicts = [Status.SOLVED, Status.RELAXED, Status.UNSUPPORTED, Status.INVALID]
    if third_party(name):
        verdicts.append(Status.FAILED)
    assert t.status in verdicts, t.message
    if t.status is Status.SOLVED:
        assert t.certified_trajectory is not None
        again = verify(t.problem, t.certified_trajectory)
        assert again.feasible
        assert again.duration == pytest.approx(t.certified_duration, rel=1e-12)
        assert len(t.certified_trajectory.waypoint_times) == len(t.problem.waypoints)
    else:
        assert t.certified_duration is None
        assert t.message


@pytest.mark.parametrize("problem", problem_files())
@pytest.mark.parametrize("name", INSTALLED)
def test_nothing_beats_the_exact_optimum(name: str, problem: str) -> None:
    certified = trial(name, problem).certified_duration
    reference = trial("exact", problem)
    bound = reference.certified_duration or reference.relaxed_duration
    assert bound is not None
    if certified is not None:
        assert certified >= bound * (1 - 1e-6)


@pytest.mark.parametrize("problem", problem_files())
@pytest.mark.parametrize("name", INSTALLED)
def test_only_what_cannot_be_helped_is_invalid(name: str, problem: str) -> None:
    """A planner may leave position limits that it does not know; `prove:joint` has no motion."""
    t = trial(name, problem)
    if t.status is Status.INVALID:
        assert t.problem.has("position") or t.solution.trajectory is None
    if t.status is Status.RELAXED:
        assert t.relation is Relation.RELAXATION


@pytest.mark.parametrize("name", INSTALLED)
def test_the_verdict_is_json_without_nan(name: str) -> None:
    for problem in ("six-axis", "jerk-limit", "repeated"):
        table = trial(name, problem).as_dict()
        json.dumps(table, allow_nan=False)
        assert table["options"] == options(quick(name))
        if table["certified_duration"] is not None:
            assert len(table["waypoint_times"]) == len(load(problem).waypoints)
            assert (np.diff(table["waypoint_times"]) >= 0).all()


def test_a_repeated_waypoint_is_passed_once() -> None:
    for name in INSTALLED:
        times = trial(name, "repeated").as_dict()["waypoint_times"]
        assert times is not None
        assert times[1] == times[2]
