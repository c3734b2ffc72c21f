"""Planners of a Python file by `FILE.py:NAME`: what is named, its identity, and what is refused."""

from __future__ import annotations

import importlib
import json
import sys

import pytest

from trajopt import InvalidInput, Limits, Problem, TrajoptError, UnknownName, compare
from trajopt.benchmark.run import server
from trajopt.benchmark.trial import Configuration
from trajopt.cli import main
from trajopt.core.exceptions import PlannerWarning
from trajopt.planners.registry import entries, load, named

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [2.0]))

SOURCE = """
from dataclasses import dataclass, field

from beside_it import SLOWER
from trajopt import Planner
from trajopt.planners.registry import load


@dataclass(frozen=True)
class Slow(Planner):
    \"\"\"The optimum, slower.\"\"\"

    factor: float = SLOWER

    def solve(self, problem, *, seed=0):
        found = load("ruckig-stop").solve(problem)
        return type(found)(found.status, found.trajectory.dilated(self.factor))


def slow(problem, *, factor: float = SLOWER):
    return Slow(factor).solve(problem)


def exact(problem):
    return Slow().solve(problem)


ready = Slow(4.0)


def made():
    return Slow(5.0)


@dataclass(frozen=True)
class Annotated(Slow):
    stochastic: bool = True


class Unrelated:
    def solve(self, problem):
        pass


number = 3
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    """A file of planners and a module beside it, unknown to Python before and after."""
    own = tmp_path / "own_planners.py"
    own.write_text(SOURCE, encoding="utf-8")
    (tmp_path / "beside_it.py").write_text("SLOWER = 2.0\n", encoding="utf-8")
    monkeypatch.setattr(sys, "path", [*sys.path])
    importlib.invalidate_caches()
    yield own
    for name in ("own_planners", "beside_it"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("name", "label", "factor"),
    [
        ("Slow", "Slow", 2.0),
        ("Slow:factor=3", "Slow", 3.0),
        ("slow", "slow", 2.0),
        ("slow:factor=3", "slow", 3.0),
        ("exact", "own_planners.exact", 2.0),  # never taken for the reference of this name
        ("ready", "ready", 4.0),
        ("made", "made", 5.0),
    ],
)
def test_classes_objects_and_functions_of_a_file(file, name, label, factor):
    own_label, planner = named(f"{file}:{name}")
    assert own_label == label
    # rest to rest over 1 rad at 1 rad/s and 2 rad/s²: 1/1 + 1/2
    assert planner.solve(PROBLEM).trajectory.duration == pytest.approx(factor * 1.5)


def test_a_path_may_be_relative(file, monkeypatch):
    monkeypatch.chdir(file.parent)
    assert load("./own_planners.py:Slow").options() == load("own_planners.py:Slow").options()


def test_it_runs_in_processes_of_its_own_and_its_code_is_its_identity(file, tmp_path):
    specs = [f"{file}:Slow", f"{file}:slow:factor=3"]
    first = compare([PROBLEM], specs, tmp_path / "results", jobs=1)
    rows = first.trials().set_index("label")["certified_duration"]
    assert rows["Slow"] == pytest.approx(3.0)
    assert rows["slow:factor=3.0"] == pytest.approx(4.5)
    kept = compare([PROBLEM], specs, tmp_path / "results", jobs=1).kept
    assert (kept.count, kept.total) == (2, 2)  # the reference is a best known motion


def test_an_edited_file_is_another_planner(file, tmp_path):
    before = Configuration.of(load(f"{file}:Slow")).entrant.code.digest
    (tmp_path / "beside_it.py").write_text("SLOWER = 7.0\n", encoding="utf-8")
    after = Configuration.of(load(f"{file}:Slow")).entrant.code.digest
    assert before != after


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("slwo", UnknownName, "no planner of .*own_planners.py is called 'slwo'; did you mean"),
        ("", InvalidInput, "own_planners.py:NAME, where NAME is one of Slow, slow, exact, ready, "),
        ("SLOW", UnknownName, "did you mean '[Ss]low'"),
        ("number", TrajoptError, "'number' cannot be loaded: planner is 'int': expected a planner"),
        ("Unrelated", TrajoptError, "planner is 'Unrelated': expected a planner: an object of"),
        ("Slow:speed=3", InvalidInput, "option speed is '3': expected one of: factor"),
    ],
)
def test_a_name_that_is_no_planner_is_refused(file, name, error, words):
    with pytest.raises(error, match=words):
        load(f"{file}:{name}")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("absent.py", None, "absent.py': expected a Python file that exists"),
        ("random.py", "", r"random.py': expected a file of another name: import random finds /"),
        ("sys.py", "", r"sys.py': expected a file of another name: import sys finds a module of"),
        ("broken.py", "def x(:", r"'P' cannot be loaded: invalid syntax \(broken.py, line 1\)"),
        ("needy.py", "import absent_package", "absent_package is not installed; install it with"),
        (
            "raising.py",
            "1 / 0",
            r"loaded: ZeroDivisionError: division by zero \(.*raising.py, line 1\)",
        ),
    ],
)
def test_a_file_that_cannot_be_imported_is_named(file, tmp_path, name, text, words):
    if text is not None:
        (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(TrajoptError, match=words):
        load(f"{tmp_path / name}:P")


def test_a_member_with_an_annotation_is_no_option(file):
    right = "write `stochastic = True` without its type"
    with pytest.raises(InvalidInput, match=f"planner Annotated: stochastic: expected .*{right}"):
        Configuration.of(load(f"{file}:Annotated"))


DRAWN = """
from dataclasses import dataclass

import numpy as np
from trajopt import Planner, Solution, Status
from trajopt.planners.registry import load


@dataclass(frozen=True)
class Drawn(Planner):
    def solve(self, problem, *, seed=0):
        factor = 2 + np.random.default_rng(seed).random()
        found = load("ruckig-stop").solve(problem)
        history = np.array([[1.0, 9.0]])
        return Solution(Status.SOLVED, found.trajectory.dilated(factor), history=history)


@dataclass(frozen=True)
class Fixed(Drawn):
    stochastic = False

    def solve(self, problem, *, seed=0):
        return load("ruckig-stop").solve(problem, seed=seed)


@dataclass(frozen=True)
class Deaf(Planner):
    def solve(self, problem, *, seed=0):
        return load("ruckig-stop").solve(problem)


def function(problem, *, seed=0):
    return Drawn().solve(problem, seed=seed)


function.stochastic = False
"""


def test_a_planner_that_runs_once_with_a_seed_and_a_history_left_out_are_said(file, tmp_path):
    file.write_text(DRAWN, encoding="utf-8")
    specs = [f"{file}:{name}" for name in ("Drawn", "Fixed", "Deaf", "function")]
    with pytest.warns(PlannerWarning) as caught:
        results = compare([PROBLEM], specs, tmp_path / "results", seeds=2)
    assert len(results.items) == 4  # the reference is a best known motion
    once, *histories = [str(one.message) for one in caught]
    assert once == "Drawn runs once: set `stochastic = True` if the seed matters, else False"
    assert len(histories) == 2
    assert all(": a history is left out: it ends at 9 s, but the" in words for words in histories)
    with pytest.warns(PlannerWarning, match="history") as caught:
        compare([PROBLEM], specs, tmp_path / "results", seeds=1)
    assert len(caught) == 2


@pytest.mark.parametrize("name", entries())
def test_no_planner_of_ours_reads_a_seed_that_it_says_does_not_matter(name):
    entry = entries()[name]
    assert entry.missing() or not entry.load().may_be_stochastic


@pytest.mark.parametrize("command", ["plan", "explain"])
def test_with_json_what_a_planner_prints_goes_to_standard_error(
    file, tmp_path, capfd, monkeypatch, command
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(server, "_servers", [])  # a new one has the captured standard error
    text = 'print("imported")\n' + SOURCE.replace(
        "        found =", '        print("asked")\n        found ='
    )
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit):
        main([command, "one-joint", "--planner", f"{file}:Slow", "--json"])
    captured = capfd.readouterr()
    assert json.loads(captured.out)["planner"] == "Slow"
    assert captured.err.startswith("imported\nasked\n")


def test_a_name_that_is_given_is_the_label(file):
    planner = load(f"{file}:Slow:factor=3")
    for name in ("Ours (tripled)", "Ours: tripled"):
        entrant = Configuration.given((name, planner)).entrant
        assert (entrant.name, entrant.label) == (name, name)
    assert Configuration.given(f"{file}:Slow:factor=3").entrant.label == "Slow:factor=3.0"


def test_no_planner_has_the_name_of_a_registered_one(file):
    """Gaps are measured against `exact`: another one of that name would be its own reference."""
    own = load(f"{file}:Slow")
    for name in ("exact", "exact:", "exact:mine", "prove", "pso"):
        with pytest.raises(InvalidInput, match=r"a name of its own: '\w+' is a reg"):
            Configuration.given((name, own))
    smaller = Configuration.given(("pso", load("pso:population=10"))).entrant
    assert (smaller.name, smaller.label) == ("pso", "pso:population=10")
