"""Functions as planners: options from keywords, the rules of classes, and what is printed."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from types import ModuleType

import pytest

from trajopt import compare
from trajopt.benchmark.trial import Configuration, trials_of
from trajopt.core.exceptions import InvalidInput, PlannerWarning
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners.planner import Planner, Relation, adapted
from trajopt.planners.registry import _object, configured, load
from trajopt.planners.testing import ContractError, check_planner

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [2.0]))


def stopping(problem: Problem, *, seed: int = 0, slower: float = 1.0) -> Solution:
    """Stops at every waypoint."""
    found = load("ruckig-stop").solve(problem)
    return Solution(found.status, found.trajectory.dilated(slower))


def test_keywords_are_options():
    planner = adapted(stopping)
    assert isinstance(planner, Planner)
    assert planner.options() == {"slower": 1.0}
    assert planner.description == "Stops at every waypoint."
    slow = configured(planner, {"slower": "2"})
    assert slow.options() == {"slower": 2.0}
    (trial,) = trials_of(slow, PROBLEM, [0])
    assert (trial.planner, trial.label) == ("stopping", "stopping:slower=2.0")
    assert trial.certified_duration == pytest.approx(3.0)  # 1/1 + 1/2, twice as slow
    with pytest.raises(InvalidInput, match="option slower is 'fast': expected float"):
        configured(planner, {"slower": "fast"})


def test_an_entry_point_may_be_a_function_that_plans_or_one_that_makes_a_planner():
    def made():
        return adapted(stopping)

    assert _object(stopping) is stopping
    assert isinstance(_object(made), Planner)


def test_it_is_compared_beside_names(tmp_path):
    with pytest.warns(PlannerWarning, match="stopping runs once"):  # it takes a seed
        results = compare([PROBLEM], ["ruckig-stop", stopping], tmp_path)
    assert set(results.trials()["planner"]) >= {"ruckig-stop", "stopping"}


FUNCTION = "def plan(problem, *, size=1): return Solution(Status.FAILED, message={})"
CLASS = """
@dataclass(frozen=True)
class plan(Planner):
    size: int = 1
    def solve(self, problem, *, seed=0): return Solution(Status.FAILED, message={})
"""


@pytest.mark.parametrize("module", [None, "__main__"])
@pytest.mark.parametrize("text", [FUNCTION, CLASS])
def test_an_executed_text_is_another_code_every_time(text, module, tmp_path, monkeypatch):
    """Also where the module has a file: that file need not hold the text."""
    script = ModuleType("__main__")
    script.__file__ = str(tmp_path / "script.py")
    (tmp_path / "script.py").write_text("", encoding="utf-8")
    monkeypatch.setitem(sys.modules, "__main__", script)
    names = {"dataclass": dataclass, "Planner": Planner, "Solution": Solution, "Status": Status}
    if module:
        names["__name__"] = module
    ids = set()
    for _ in range(2):
        exec(text.format("'one'"), names)
        plan = names["plan"]
        planner = plan() if text == CLASS else plan
        for _ in range(2):
            ids.add(Configuration.of(planner).entrant.trial_id(PROBLEM, 0))
    assert len(ids) == 2


def test_what_it_says_of_itself_by_attributes():
    def relaxed(problem):
        return Solution(Status.FAILED, message="never")

    relaxed.relation = lambda problem: Relation.RELAXATION
    relaxed.unsupported = lambda problem: "two joints" if problem.joints > 1 else None
    relaxed.stochastic = True
    planner = adapted(relaxed)
    assert planner.relation(PROBLEM) is Relation.RELAXATION
    assert planner.stochastic
    two = Problem([[0, 0], [1, 1]], Limits([1, 1], [1, 1]))
    assert planner.solve(two).status is Status.UNSUPPORTED
    assert planner.solve(PROBLEM).message == "never"


def with_needed(problem, *, size): ...
def with_any(problem, **options): ...
def with_list(problem, *, sizes=[]): ...  # noqa: B006


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (with_needed, "with_needed, size: expected a keyword with a default"),
        (with_any, "with_any, options: expected options by their names, without *"),
        (with_list, "with_list: expected other defaults: mutable default"),
        (lambda: None, "planner"),
        (len, "an object of a class derived from trajopt.Planner, or a function"),
    ],
)
def test_options_that_nobody_sees_are_refused(function, words):
    with pytest.raises(InvalidInput) as caught:
        adapted(function)
    assert words in str(caught.value)


# --- what check_planner prints ---


def test_what_was_checked_is_printed(capsys):
    check_planner(stopping)
    printed = capsys.readouterr().out
    assert printed.startswith("stopping: options {'slower': 1.0}, survives pickling\n")
    # 0.4, 0.6 and 0.5 rad at 1 rad/s and 2 rad/s²: 2 sqrt(0.2), 1.1, 1.0
    assert "  one joint: certified 2.99443 s, as claimed\n" in printed
    assert "  jerk limits: certified " in printed
    assert "(it does not know jerk limits)" in printed
    assert "  position limits: certified " in printed


def test_a_planner_that_says_it_knows_a_limit_must_keep_it():
    def careless(problem, *, seed=0):
        return load("exact").solve(problem.without("jerk", "position"))

    limits = Limits([1.0, 1.0], [2.0, 2.0], position=[[0.0, 1.0], [-1.0, 1.0]])
    narrow = Problem([[0, 0], [1, -0.5], [0.4, 0.6]], limits, name="narrow")
    check_planner(careless, [narrow])
    careless.knows = ("velocity", "acceleration", "position")
    with pytest.raises(ContractError, match="on 'narrow': invalid"):
        check_planner(careless, [narrow])
