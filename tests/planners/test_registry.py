"""The planner's door: names, options as text, what is missing, and errors that travel."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint
from typing import ClassVar, Literal

import numpy as np
import pytest

from trajopt.core import exceptions
from trajopt.core.exceptions import (
    InvalidInput,
    InvalidTrajectory,
    MissingBackend,
    StoreError,
    TrajoptError,
    UnknownName,
    WorkerError,
    WrongType,
)
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Planner, Relation, adapted, backend
from trajopt.planners.reductions import EQUAL_WAYPOINTS, reduced
from trajopt.planners.registry import GROUP, Entry, configured, entries, label, load, options, parse
from trajopt.planners.swarm_planner import SwarmPlanner, Unoptimised
from trajopt.planners.testing import ContractError

NAMES = {
    *("unoptimised", "pso", "ssa", "issa", "spline353-nlp"),
    *("exact", "collocation", "toppra", "ruckig-search", "ruckig-stop"),
}


@dataclass(frozen=True)
class Inner:
    shape: Literal["round", "none", "7"] = "round"
    weight: float | None = None


@dataclass(frozen=True)
class Straight(Planner):
    """Goes straight from waypoint to waypoint at a constant speed: no planner at all."""

    steps: int = 10
    factor: float = 1.5
    careful: bool = False
    note: str = "plain"
    remark: str | None = None
    level: Literal[1, 2] = 1
    inner: Inner = field(default_factory=Inner)
    requires: ClassVar[tuple[str, ...]] = ()

    def relation(self, problem: Problem) -> Relation:
        return Relation.RESTRICTION

    def unsupported(self, problem: Problem) -> str | None:
        return None

    @reduced(EQUAL_WAYPOINTS)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        times = np.arange(len(problem.waypoints), dtype=float)
        coefficients = np.stack([problem.displacements, problem.waypoints[:-1]])
        return Solution(Status.SOLVED, Trajectory(times, coefficients, times), f"seed {seed}")


@dataclass(frozen=True)
class Picky(Planner):
    """Refuses problems with three waypoints."""

    def unsupported(self, problem: Problem) -> str | None:
        return "three waypoints" if len(problem.waypoints) == 3 else None

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        assert len(problem.waypoints) != 3
        return Solution(Status.FAILED, message=f"seed {seed}")


def test_what_a_planner_refuses_it_does_not_solve_when_called_directly_either():
    three = Problem([[0.0], [1.0], [2.0]], Limits([1.0], [1.0]))
    two = Problem([[0.0], [1.0]], Limits([1.0], [1.0]))
    refused = [Picky().solve(three, seed=4), *Picky().solve_batch(three, [1, 2])]
    assert [(s.status, s.message) for s in refused] == [(Status.UNSUPPORTED, "three waypoints")] * 3
    answered = [Picky().solve(two, seed=4), *Picky().solve_batch(two, [1, 2])]
    assert [s.message for s in answered] == ["seed 4", "seed 1", "seed 2"]
    assert Picky.solve.__name__ == "solve"


@dataclass(frozen=True)
class Together(Picky):
    """Solves many problems together, and says how many."""

    def solve_many(self, problems, seeds=None):
        assert all(len(problem.waypoints) != 3 for problem in problems)
        return [Solution(Status.FAILED, message=f"{own} of {len(seeds)}") for own in seeds]


def test_many_problems_are_answered_in_their_order_the_refused_ones_too():
    three = Problem([[0.0], [1.0], [2.0]], Limits([1.0], [1.0]))
    two = Problem([[0.0], [1.0]], Limits([1.0], [1.0]))
    one_by_one = Picky().solve_many([two, three, two], [5, 6, 7])
    assert [s.message for s in one_by_one] == ["seed 5", "three waypoints", "seed 7"]
    together = Together().solve_many([two, three, two], [5, 6, 7])
    assert [s.message for s in together] == ["5 of 2", "three waypoints", "7 of 2"]
    assert [s.message for s in Together().solve_many([two, two])] == ["0 of 2"] * 2
    assert Together().solve_many([three])[0].status is Status.UNSUPPORTED
    assert Together().solve_many([]) == []
    assert Together().takes_many
    assert not Picky().takes_many
    with pytest.raises(ValueError, match="shorter"):
        Picky().solve_many([two, two], [1])


def test_every_planner_of_ours_says_what_it_refuses_instead_of_failing_in_numpy():
    two = Problem([[0.0, 0.0], [1.0, 0.5]], Limits([1.0, 1.0], [1.0, 1.0], [9.0, 9.0]))
    for name, entry in entries().items():
        planner = entry.load()
        reason = planner.unsupported(two)
        if reason is not None:
            assert planner.solve(two).message == reason, name
            assert planner.solve(two).status is Status.UNSUPPORTED


def test_what_a_planner_need_not_say_has_a_default():
    problem = Problem([[0.0], [1.0]], Limits([1.0], [1.0]))

    @dataclass(frozen=True)
    class Bare(Planner):
        """First line.

        Second."""

        def solve(self, problem, *, seed=0):
            return Solution(Status.FAILED, message="no")

    planner = adapted(Bare())
    assert planner.relation(problem) is Relation.RESTRICTION
    assert planner.unsupported(problem) is None
    assert (planner.stochastic, planner.on_request, planner.requires) == (False, False, ())
    assert planner.description == "First line."
    assert not planner.batched
    timed = planner.along(problem, Trajectory([0, 1], np.ones((1, 1, 1)), [0, 1]))
    assert timed.status is Status.UNSUPPORTED


def test_all_ten_planners_are_registered():
    assert set(entries()) >= NAMES
    for name in NAMES:
        assert entries()[name].name == name
        assert entries()[name].missing() is None
        assert isinstance(entries()[name].load(), Planner)


def test_a_planner_made_here_is_one():
    planner = adapted(Straight(steps=3))
    assert isinstance(planner, Planner)
    assert planner.options() == options(Straight(steps=3))
    assert adapted(planner) is planner
    with pytest.raises(InvalidInput, match="planner is 'Inner': expected a planner: an object of"):
        adapted(Inner())
    with pytest.raises(InvalidInput, match=r"expected an object, Straight\(\)"):
        adapted(Straight)


@pytest.mark.parametrize(
    ("spec", "name", "given"),
    [
        ("issa", "issa", {}),
        ("issa:", "issa", {}),
        ("issa:population=50", "issa", {"population": "50"}),
        ("issa: step = matrix , levy=no,", "issa", {"step": "matrix", "levy": "no"}),
        ("a:b=c=d", "a", {"b": "c=d"}),
        ("a:b=", "a", {"b": ""}),
        ("a:b=1,b=2", "a", {"b": "2"}),
        ("", "", {}),
    ],
)
def test_a_planners_text_is_its_name_and_its_options(spec, name, given):
    assert parse(spec) == (name, given)


@pytest.mark.parametrize("spec", ["issa:population", "issa:population=5,scaled"])
def test_options_without_a_value_are_refused(spec):
    with pytest.raises(InvalidInput, match=r"planner issa is '\w+': expected options as key=value"):
        parse(spec)


def test_load_reaches_outer_and_nested_options():
    planner = load("issa:fitness=scaled,population=50,levy=false,evaluations=none,upper=3")
    assert isinstance(planner, SwarmPlanner)
    table = options(planner)
    chosen = ("fitness", "population", "levy", "evaluations", "upper")
    assert [table[key] for key in chosen] == ["scaled", 50, False, None, 3.0]
    assert isinstance(table["upper"], float)
    assert planner.optimiser.population == 50
    assert options(load("issa"))["population"] == 30


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("isa", "did you mean 'issa'"),
        ("certify", "it is now called 'prove'"),
        ("ruckig-serch", "did you mean 'ruckig-search'"),
        ("unoptimized", "did you mean 'unoptimised'"),
        ("qwertyuiop", "known: .*exact.*toppra"),
        ("", "known: "),
        ("ISSA?", "'ISSA\\?'; did you mean 'issa'"),
        ("TOPPRA", "did you mean 'toppra'"),
    ],
)
def test_an_unknown_planner_comes_with_a_suggestion(name, hint):
    with pytest.raises(UnknownName, match=f"no planner is called.*{hint}") as caught:
        load(name)
    assert set(caught.value.known) >= NAMES
    assert (caught.value.kind, caught.value.name) == ("planner", name)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("issa:popluation=50", "option popluation is '50': expected one of: .*population"),
        ("issa:population=many", "option population is 'many': expected int"),
        ("issa:population=2.5", "option population is 2.5: expected int"),
        ("issa:population=true", "option population is True: expected int"),
        ("issa:levy=1", "option levy is 1: expected bool"),
        ("issa:fitness=best", "option fitness is 'best': expected 'penalty' or 'scaled'"),
        ("issa:evaluations=2.5", "option evaluations is 2.5: expected int or NoneType"),
        ("issa:iterations=none", "option iterations: expected int"),
        ("issa:upper=", "option upper is '': expected float"),
        ("issa:upper=true", "option upper is True: expected float"),
        ("issa:upper=[1]", r"option upper is '\[1\]': expected float"),
        ("issa:population=30.0", "option population is 30.0: expected int"),
        ("issa:population=1e3", "option population is 1000.0: expected int"),
        ("issa:population=1_000", "option population is '1_000': expected int"),
        ("issa:population=0x10", "option population is '0x10': expected int"),
        ("issa:population=nan", "option population is 'nan': expected int"),
        ("issa:upper=1_0.0", "option upper is '1_0.0': expected float"),
        ("issa:upper=0x10", "option upper is '0x10': expected float"),
        ("issa:upper=inf", "option upper is 'inf': expected float"),
        ("issa:upper=1e999", "option upper is '1e999': expected float"),
        (f"issa:upper={10**400}", "option upper is .*0000.*: expected float"),
        (f"issa:upper={10**350}", "option upper is 1000.*: expected float"),
        ("issa:=3", "option  is '3'"),
        ("unoptimised:times=2", "option times is '2': expected one of: segment_time"),
    ],
)
def test_bad_options_are_named_with_what_would_be_right(spec, words):
    with pytest.raises(InvalidInput, match=words):
        load(spec)


@pytest.mark.parametrize(
    ("key", "given", "value"),
    [
        ("steps", "7", 7),
        ("steps", 7, 7),
        ("steps", "-7", -7),
        ("factor", "2", 2.0),
        ("factor", 2, 2.0),
        ("factor", "1e-3", 1e-3),
        ("careful", "true", True),
        ("careful", "True", True),
        ("careful", "FALSE", False),
        ("careful", True, True),
        ("note", "words", "words"),
        ("note", "7", "7"),  # text stays text where text is asked for
        ("note", "none", "none"),
        ("note", "true", "true"),
        ("remark", "none", None),
        ("remark", "words", "words"),
        ("remark", "7", "7"),
        ("level", "2", 2),
        ("level", 2, 2),
        ("shape", "none", "none"),
        ("shape", "7", "7"),
        ("weight", "none", None),
        ("weight", "3", 3.0),
        ("weight", 3, 3.0),
    ],
)
def test_text_becomes_what_the_annotation_says(key, given, value):
    found = options(configured(Straight(), {key: given}, "straight"))[key]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("steps", 1.0), ("steps", None), ("steps", True), ("factor", "x"), ("factor", False)),
        *(("careful", 0), ("level", 3), ("level", "none"), ("shape", "square"), ("shape", 7)),
        *(("weight", "heavy"), ("weight", True), ("note", 5), ("inner", "x"), ("nothing", 1)),
    ],
)
def test_what_the_annotation_forbids_is_refused(key, value):
    with pytest.raises(InvalidInput, match=f"planner straight, option {key}"):
        configured(Straight(), {key: value}, "straight")


def test_configuring_leaves_the_original_and_the_rest_alone():
    planner = Straight(steps=3)
    changed = configured(planner, {"weight": 2, "careful": True})
    assert changed == Straight(steps=3, careful=True, inner=Inner(weight=2.0))
    assert planner == Straight(steps=3)
    assert configured(planner, {}) == planner


def test_options_are_listed_flat():
    assert list(options(Straight())) == [
        *("steps", "factor", "careful", "note", "remark", "level", "shape", "weight")
    ]


def test_a_label_names_only_what_differs():
    assert label("issa", load("issa")) == "issa"
    assert label("issa", load("issa:population=50,fitness=scaled")) in (
        "issa:population=50,fitness=scaled",
        "issa:fitness=scaled,population=50",
    )
    assert label("mine", Straight(steps=3)) == "mine:steps=3"  # its own defaults
    assert load(label("issa", load("issa:levy=false"))) == load("issa:levy=false")


def test_a_missing_backend_is_told_with_the_line_that_mends_it(tmp_path, monkeypatch):
    (tmp_path / "needy_planner.py").write_text(
        "from dataclasses import dataclass\nfrom typing import ClassVar\n"
        "from trajopt import Planner\n@dataclass(frozen=True)\nclass Needy(Planner):\n"
        "    requires: ClassVar = ('numpy', 'no_such_solver', 'nor_this')\n"
        "    def solve(self, problem, *, seed=0): ...\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    missing = Entry("needy", EntryPoint("needy", "needy_planner:Needy", GROUP)).missing()
    assert "no_such_solver nor_this is not installed" in missing
    assert "pip install no_such_solver nor_this" in missing


def test_an_entry_point_that_imports_what_is_missing_tells_the_line_too(tmp_path, monkeypatch):
    (tmp_path / "eager_planner.py").write_text("import no_such_solver.sub\n")
    monkeypatch.syspath_prepend(tmp_path)
    entry = Entry("eager", EntryPoint("eager", "eager_planner:Eager", GROUP))
    assert "pip install no_such_solver" in entry.missing()
    with pytest.raises(MissingBackend) as caught:
        entry.load()
    assert caught.value.package == "no_such_solver"


@pytest.mark.parametrize(
    ("content", "target", "words"),
    [
        ("", "no_such_module_at_all:X", "No module named 'no_such_module_at_all'"),
        ("", "odd_planner.sub:X", "odd_planner"),
        ("", "odd_planner:Nothing", "Nothing"),
        ("1 / 0", "odd_planner:X", "division by zero"),
        ("def (", "odd_planner:X", "invalid syntax|expected"),
        ("class X:\n    def __init__(self, needed): ...", "odd_planner:X", "needed"),
    ],
)
def test_an_entry_point_that_cannot_be_imported_is_told_and_breaks_nothing(
    tmp_path, monkeypatch, content, target, words
):
    (tmp_path / "odd_planner.py").write_text(content)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "odd_planner", raising=False)
    entry = Entry("odd", EntryPoint("odd", target, GROUP))
    with pytest.raises(TrajoptError, match=f"planner 'odd' cannot be loaded: .*({words})"):
        entry.load()
    assert "planner 'odd' cannot be loaded" in entry.missing()
    sys.modules.pop("odd_planner", None)


def test_a_ready_made_planner_object_can_be_registered(tmp_path, monkeypatch):
    entry = Entry("pso", EntryPoint("pso", "trajopt.planners.swarm_planner:pso", GROUP))
    assert isinstance(entry.load(), SwarmPlanner)


def make_straight():
    return Straight(steps=4)


def test_a_function_that_makes_a_planner_can_be_registered(monkeypatch):
    monkeypatch.setitem(sys.modules, "straight_planners", sys.modules[__name__])
    entry = Entry("made", EntryPoint("made", "straight_planners:make_straight", GROUP))
    assert entry.load().options() == options(Straight(steps=4))
    assert entry.missing() is None


@pytest.mark.parametrize("content", ["", "raise SystemError('not ours')"])
def test_a_folder_that_hides_our_baselines_is_named(tmp_path, content):
    folder = tmp_path / "baselines"
    folder.mkdir()
    (folder / "__init__.py").write_text(content)
    code = "from trajopt.planners.registry import entries; print(entries()['exact'].missing())"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert f"planner 'exact' cannot be loaded: {folder} hides our package baselines" in done.stdout


def test_a_backend_is_imported_when_needed():
    assert backend("numpy") is np
    with pytest.raises(MissingBackend, match="pip install no_such_solver") as caught:
        backend("no_such_solver")
    assert isinstance(caught.value, ImportError)


def test_listing_imports_no_backend():
    code = (
        "import sys\nfrom trajopt.cli import described\n"
        "found = {described.described(e)['name'] for e in described.entries().values()}\n"
        f"assert found >= {NAMES!r}, found\n"
        "import scipy\n"
        "slow = {'casadi', 'toppra', 'ruckig', 'h5py'} | {f'scipy.{p}' for p in scipy.__all__}\n"
        "loaded = slow & set(sys.modules) - {'scipy.version'}\nassert not loaded, loaded\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_waypoint_given_twice_is_passed_once():
    problem = Problem([[0.0], [1.0], [1.0], [1.0], [3.0], [3.0]], Limits([9.0], [9.0]))
    solution = Straight().solve(problem, seed=5)
    assert solution.trajectory.waypoint_times.tolist() == [0, 1, 1, 1, 2, 2]
    assert len(solution.trajectory.breaks) == 3
    assert solution.message == "seed 5"
    assert Straight.solve.__name__ == "solve"


def test_an_answer_without_a_trajectory_is_left_as_it_is():
    @reduced(EQUAL_WAYPOINTS)
    def solve(self, problem, *, seed=0):
        return Solution(Status.FAILED, message=f"{len(problem.waypoints)} waypoints")

    problem = Problem([[0.0], [0.0], [1.0]], Limits([1.0], [1.0]))
    assert solve(None, problem).message == "2 waypoints"


ERRORS = [
    TrajoptError("plain"),
    InvalidInput("limits.velocity", "a number", value=[1, "x"], joint=2, file="a.toml"),
    InvalidInput("key", "this", value=None),
    WrongType("problem is a list"),
    InvalidTrajectory("breaks"),
    UnknownName("planner", "isa", ["issa", "ssa"]),
    MissingBackend("casadi"),
    StoreError("cannot write"),
    WorkerError("a daemon"),
    StoreError(2, "No such file", "a.h5"),
    ContractError("differs for the same seed"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_error_survives_pickling(error, protocol):
    again = pickle.loads(pickle.dumps(error, protocol))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert again.__dict__ == error.__dict__
    assert again.args == error.args


def test_every_error_is_tried_above():
    def below(kind):
        return {kind}.union(*(below(k) for k in kind.__subclasses__()))

    ours = {k for k in below(TrajoptError) if k.__module__ == exceptions.__name__}
    assert ours <= {type(e) for e in ERRORS}


def test_errors_are_also_what_python_calls_them():
    assert issubclass(InvalidInput, ValueError)
    assert issubclass(InvalidTrajectory, ValueError)
    assert issubclass(UnknownName, LookupError)
    assert issubclass(MissingBackend, ImportError)
    assert issubclass(StoreError, OSError)
    assert issubclass(ContractError, AssertionError)


def test_the_message_of_an_invalid_input_counts_joints_from_one():
    error = InvalidInput("waypoints", "a finite number", value=float("inf"), joint=0)
    assert str(error) == "waypoints, joint 1 is inf: expected a finite number"
    named = error.in_file("p.toml")
    assert str(named) == "p.toml: waypoints, joint 1 is inf: expected a finite number"
    assert (named.joint, named.key, error.file) == (0, "waypoints", None)


def test_the_fixed_times_are_two_seconds_each():
    problem = Problem([[0.0], [1.0], [1.0], [2.0], [3.0]], Limits([9.0], [9.0]))
    solution = Unoptimised().solve(problem)
    assert solution.trajectory.waypoint_times.tolist() == [0, 2, 2, 4, 6]
    assert Unoptimised().unsupported(Problem([[0.0], [1.0]], Limits([9.0], [9.0])))
