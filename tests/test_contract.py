"""Every registered planner on every shipped problem, and the public contract check on each."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from itertools import cycle

import numpy as np
import pytest

from trajopt import Limits, Problem, Relation, Solution, Status, verify
from trajopt.benchmark.provenance import Code
from trajopt.benchmark.suites.catalogue import load, problem_files
from trajopt.benchmark.trial import Answers, Entrant, Trial, judged, trials_of
from trajopt.core.demand import DEMANDS
from trajopt.core.limits import KINDS
from trajopt.planners.planner import Planner
from trajopt.planners.registry import configured, entries, options
from trajopt.planners.testing import check_planner
from trajopt.views.results import Results

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
    "tries": 1,
}
INSTALLED = [name for name, entry in entries().items() if entry.missing() is None]


_FALLING = {"offset": [0.1], "deceleration": [2.0], "position": [[-1.0, 1.05]]}
_WAYPOINTS = [[0.0], [0.4], [0.7], [1.0]]
FALLING = Problem(_WAYPOINTS, Limits([2.0], [8.0], falling_velocity=_FALLING), "falling")
JERKY = Problem(_WAYPOINTS, Limits([2.0], [8.0], [80.0], falling_velocity=_FALLING), "jerky")


@dataclass(frozen=True)
class Wrapped(Planner):
    """Another planner that says `solved` to every motion, that it knows all, and a relation."""

    inner: Planner
    stated: Relation

    knows = (*KINDS, *DEMANDS)

    def options(self) -> dict[str, str]:
        return {"stated": self.stated.name}

    def relation(self, problem: Problem) -> Relation:
        return self.stated

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        found = self.inner.solve(problem, seed=seed)
        if found.trajectory is None:
            return found
        return Solution(Status.SOLVED, found.trajectory)


def third_party(name: str) -> bool:
    return "third_party" in entries()[name].point.module


@cache
def quick(name: str) -> Planner:
    planner = entries()[name].load()
    own = options(planner)
    less = {k: v for k, v in _QUICK.items() if isinstance(own.get(k), int | float)}
    for option, rule in _ONE_PATH.items():
        if option in own and (third_party(name) or own[option] == "best"):
            less[option] = rule
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
    verdicts = [Status.SOLVED, Status.UNSUPPORTED, Status.INVALID]
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
    if t.status is Status.INVALID and t.solution.trajectory is not None:
        broken = {"position", *quick(name).unknown(t.problem)}
        assert broken & set(t.problem.limits.kinds)


@pytest.mark.parametrize("problem", ["six-axis", "position-limits", "jerk-limit"])
@pytest.mark.parametrize("name", INSTALLED)
def test_the_grade_of_a_motion_is_what_it_does_and_no_statement(name: str, problem: str) -> None:
    own = trial(name, problem)
    if own.solution.trajectory is None:
        return
    wrapped = Entrant("wrapped", "wrapped", {}, Code("", "", ""))
    for status, relation in zip(Status, cycle(Relation), strict=False):
        answers = Answers([replace(own.solution, status=status)], relation)
        (other,) = judged(wrapped, own.problem, [0], answers, own.started)
        for value in ("status", "certified_duration", "feasible", "dilation", "is_answered"):
            assert getattr(other, value) == getattr(own, value), value


@pytest.mark.parametrize("name", ["exact", "exact-jerk", "toppra", "ruckig-search", "spline"])
@pytest.mark.parametrize("problem", [load("position-limits"), FALLING, JERKY], ids=str)
def test_a_wrapped_planner_has_the_row_of_the_planner_itself(name: str, problem: Problem) -> None:
    """Relations, known limits and statuses that are stated change no count and no median."""
    planner = quick(name)
    items = trials_of(planner, problem, [0], name)
    for relation in Relation:
        items += trials_of(Wrapped(planner, relation), problem, [0], f"as {relation.name}")
    table = Results(items).planners().drop(columns=["time", "library", "there"])
    assert len(table) == 1 + len(Relation)
    assert (table.nunique(dropna=False) == 1).all(), table.T


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
