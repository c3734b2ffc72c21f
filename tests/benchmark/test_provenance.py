"""Edited code never shows old results: what a digest covers, where the code lies."""

from __future__ import annotations

import importlib
import importlib.util
import linecache
import platform
import re
import sys
from dataclasses import dataclass, field, replace
from enum import Enum
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from trials import PROBLEM, Stopping
from work import calls

from trajopt import InvalidInput, Planner, Solution, Status
from trajopt.benchmark import provenance
from trajopt.benchmark.provenance import code_of, plain
from trajopt.benchmark.trial import Configuration, trial_id, trials_of
from trajopt.planners.planner import adapted
from trajopt.planners.registry import load

PLANNER = """
from dataclasses import dataclass
from trajopt import Planner, Solution, Status
{imports}

@dataclass(frozen=True)
class Mine(Planner):
    gain: float = 1.0

    def solve(self, problem, *, seed=0):
        return Solution(Status.FAILED, message="{message}")
"""


def source(message="first", imports=""):
    return PLANNER.format(message=message, imports=imports)


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Imports a module of `tmp_path` as a new process would, after its files have changed."""
    monkeypatch.syspath_prepend(tmp_path)

    def digest(module="stranger"):
        for name in [name for name in sys.modules if name.partition(".")[0] in own]:
            monkeypatch.delitem(sys.modules, name)
        importlib.invalidate_caches()
        provenance._release.cache_clear()
        return code_of(importlib.import_module(module).Mine()).digest

    own = {"stranger", "helper", "unrelated", "package"}
    return digest


def test_an_edited_script_or_what_it_imports_is_another_code(tmp_path, fresh):
    module, helper = tmp_path / "stranger.py", tmp_path / "helper.py"
    helper.write_text("import numpy\nWEIGHT = 1\n")
    module.write_text(source(imports="import helper"))
    first = fresh()
    assert fresh() == first
    (tmp_path / "unrelated.py").write_text("")
    assert fresh() == first
    helper.write_text("import numpy\nWEIGHT = 2\n")
    second = fresh()
    module.write_text(source("second", "import helper"))
    assert len({first, second, fresh()}) == 3


def test_a_module_that_was_edited_after_its_import_is_refused_until_it_is_reloaded(tmp_path, fresh):
    module, helper = tmp_path / "stranger.py", tmp_path / "helper.py"
    helper.write_text("def weight():\n    return 1\n")
    module.write_text(source(imports="import helper"))
    first = fresh()
    planner = sys.modules["stranger"].Mine()
    for edited in (helper, module):
        edited.write_text(edited.read_text().replace("1", "2").replace("first", "second"))
        with pytest.raises(InvalidInput, match=f"{edited.name}.* not edited after its import"):
            code_of(planner)
        bytecode = Path(importlib.util.cache_from_source(edited))
        bytecode.unlink(missing_ok=True)  # files that change twice in a second look the same
        reloaded = importlib.reload(sys.modules[edited.stem])
        if edited is module:
            planner = reloaded.Mine()
        assert code_of(planner).digest != first


def test_a_module_that_an_import_hook_rewrites_is_taken_as_it_is(tmp_path, fresh, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    class Rewriting(SourceFileLoader):
        def source_to_code(self, data, path):
            text = data.decode().replace("return Sol", "assert seed >= 0; return Sol")
            return super().source_to_code(text.encode(), path)

    path = tmp_path / "stranger.py"
    path.write_text(source())
    spec = importlib.util.spec_from_file_location(
        "stranger", path, loader=Rewriting("stranger", str(path))
    )
    sys.modules["stranger"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["stranger"])
    planner = sys.modules["stranger"].Mine()
    assert code_of(planner).digest == fresh()


def test_an_edited_module_anywhere_in_a_package_is_another_code(tmp_path, fresh):
    (tmp_path / "package/inner").mkdir(parents=True)
    for name in ("package/__init__.py", "package/inner/__init__.py"):
        (tmp_path / name).write_text("")
    (tmp_path / "package/planner.py").write_text(source())
    deep = tmp_path / "package/inner/deep.py"
    deep.write_text("x = 1\n")
    first = fresh("package.planner")
    assert fresh("package.planner") == first
    deep.write_text("x = 2\n")
    assert fresh("package.planner") != first


def test_of_an_installed_planner_the_version_and_its_own_file_count(tmp_path, fresh, monkeypatch):
    monkeypatch.setattr(provenance, "_is_installed", lambda file: file.is_relative_to(tmp_path))
    found = SimpleNamespace(name="strangers-planners", version="1.2")
    monkeypatch.setattr(provenance, "distribution", lambda name: found)
    module = tmp_path / "stranger.py"
    module.write_text(source(imports="import helper"))
    (tmp_path / "helper.py").write_text("")

    def digest():
        monkeypatch.delitem(sys.modules, "stranger", raising=False)
        importlib.invalidate_caches()
        provenance._release.cache_clear()
        return code_of(importlib.import_module("stranger").Mine())

    first = digest()
    assert (first.distribution, first.version) == ("strangers-planners", "1.2")
    (tmp_path / "helper.py").write_text("another = 1")  # the version tells, once it is raised
    assert digest() == first
    found.version = "1.3"
    raised = digest().digest
    module.write_text(source("edited in place", "import helper"))
    assert len({first.digest, raised, digest().digest}) == 3


def test_our_planners_name_our_distribution_and_are_digested_with_little_work():
    planner = load("toppra")
    provenance._ours.cache_clear()
    calls(lambda: code_of(planner), at_most=200_000)  # 40,000: a few for each file of ours
    code = code_of(planner)
    assert (code.distribution, code.version) == ("mintime", provenance.provenance()["mintime"])
    assert code_of(load("toppra:knots=chord")) == code  # options are not code
    assert code_of(load("exact")).digest != code.digest  # another class is


def test_of_a_checkout_only_what_can_change_a_trial_counts():
    names = [
        "trajopt/judging/verification.py",
        "trajopt/benchmark/trial.py",
        "baselines/topp_ra.py",
    ]
    assert all(map(provenance._decides, names))
    names = ["trajopt/cli/app.py", "trajopt/views/report/content.py", "trajopt/comparison.py"]
    assert not any(map(provenance._decides, names))


NOTEBOOK = """
from dataclasses import dataclass
from trajopt import Planner, Solution, Status

WEIGHT = {weight}

def helper(x):
    return {helper}

@dataclass(frozen=True)
class Mine(Planner):
    def solve(self, problem, *, seed=0):
        if seed in {{"a", "b", "c"}}:
            return None
        return Solution(Status.FAILED, message=str([helper(WEIGHT) for _ in range(2)]))
"""


@pytest.fixture
def notebook(monkeypatch):
    """Run a cell as a notebook does: there is no file, but `inspect` finds the source."""

    def digest(weight="1", helper="x + 1", *, keep=True):
        code = NOTEBOOK.format(weight=weight, helper=helper)
        module = ModuleType("a_notebook")
        monkeypatch.setitem(sys.modules, module.__name__, module)
        name = f"<cell {len(linecache.cache)}>"
        if keep:
            lines = code.splitlines(keepends=True)
            monkeypatch.setitem(linecache.cache, name, (len(code), None, lines, name))
        exec(compile(code, name, "exec"), vars(module))
        return code_of(module.Mine()).digest

    return digest


def test_a_planner_of_a_notebook_is_told_by_its_source_and_what_it_uses(notebook):
    first = notebook()
    assert notebook() == first
    assert len({first, notebook(weight="2"), notebook(helper="x + 2")}) == 3


def test_code_without_a_source_is_another_code_every_time(notebook):
    assert notebook(keep=False) != notebook(keep=False)


def made(gain):
    @dataclass(frozen=True)
    class Made(Planner):
        def solve(self, problem, *, seed=0):
            return Solution(Status.FAILED, message=str(gain))

    return Made()


def test_what_a_class_was_made_with_belongs_to_its_code():
    assert code_of(made(1)) == code_of(made(1))
    assert code_of(made(1)) != code_of(made(2))


@dataclass(frozen=True)
class Other(Stopping):
    """Another class with the same options and name."""


def test_two_classes_of_one_name_and_the_same_options_are_two_planners():
    ids = {
        Configuration.of(planner, "mine").entrant.trial_id(PROBLEM, 0)
        for planner in (Stopping(), Other())
    }
    assert len(ids) == 2


def test_a_trial_says_whose_code_ran_and_old_ones_keep_their_identity():
    trial = trials_of(Stopping(), PROBLEM, [3], "stopping")[0]
    code = code_of(adapted(Stopping()))
    assert trial.provenance["planner_digest"] == code.digest
    assert (trial.provenance["planner_distribution"], trial.provenance["planner_version"]) == (
        "",
        "",
    )
    assert trial.id == trial_id(PROBLEM, "stopping", trial.options, 3, code.digest)
    old = {key: value for key, value in trial.provenance.items() if not key.startswith("planner_")}
    release = trial.provenance["mintime"]
    earlier = replace(trial, provenance=old).id
    assert earlier == trial_id(PROBLEM, "stopping", trial.options, 3, release)
    assert earlier != trial.id


class Colour(Enum):
    RED = 1


@dataclass(frozen=True)
class Holding(Planner):
    value: Any = None

    def solve(self, problem, *, seed=0):
        return Solution(Status.FAILED, message="no")


@pytest.mark.parametrize(
    ("one", "two"),
    [
        (np.array([1.0, 2.0]), np.array([1.0, np.nextafter(2.0, 3.0)])),
        (np.zeros(5000), np.eye(1, 5000, 2500)[0]),  # their texts are the same: [0. 0. ... 0. 0.]
        (1.0, np.nextafter(1.0, 2.0)),
        (Path("a"), Path("b")),
        ({"a": [1, (2, 3)]}, {"a": [1, (2, 4)]}),
        (Stopping(1.0), Stopping(2.0)),
        ([Stopping(1.0)], [Stopping(2.0)]),
        (len, max),
        (made, source),
        (Colour.RED, "RED"),
        ({1, 2}, {1, 3}),
    ],
)
def test_options_that_differ_are_two_configurations(one, two):
    same = [
        Configuration.of(Holding(value), "h").entrant.trial_id(PROBLEM, 0)
        for value in (one, one, two)
    ]
    assert same[0] == same[1]
    assert same[0] != same[2]


def test_an_option_whose_text_says_nothing_of_it_is_refused():
    class Opaque:
        pass

    with pytest.raises(InvalidInput, match=r"planner h, option value is .*Opaque object"):
        Configuration.of(Holding(Opaque()), "h")
    assert plain(np.float64(2.5)) == 2.5
    assert plain(np.array([[1, 2]])) == [[1, 2]]


class Plain(Planner):
    """Options that nobody sees."""

    def __init__(self, gain):
        self.gain = gain

    def solve(self, problem, *, seed=0):
        return Solution(Status.FAILED, message=str(self.gain))


@dataclass
class Thawed(Planner):
    gain: float = 1.0

    def solve(self, problem, *, seed=0):
        return Solution(Status.FAILED, message="no")


@dataclass(frozen=True)
class Behind(Holding):
    """A field, and an attribute that is not a field."""

    def __post_init__(self):
        object.__setattr__(self, "table", [1, 2])


class Undecorated(Holding):
    def __init__(self, gain):
        super().__init__()
        object.__setattr__(self, "gain", gain)


@dataclass(frozen=True)
class Nested(Holding):
    inner: Any = field(default_factory=lambda: Behind())


class Listing(Plain):
    """Says itself what its options are."""

    def options(self):
        return {"gain": self.gain}


@pytest.mark.parametrize(
    ("planner", "words"),
    [
        (Plain(2.0), "options are no fields.*@dataclass.frozen=True.*class Plain.Planner.*gain"),
        (Thawed(), "planner Thawed: its options can change while it runs: expected a frozen"),
        (Behind(), "planner Behind: table cannot be seen"),
        (Undecorated(3), "planner Undecorated: gain cannot be seen"),
        (Nested(), "planner Nested: inner.table cannot be seen"),
    ],
    ids=lambda x: type(x).__name__,
)
def test_a_planner_with_options_that_nobody_sees_is_refused_with_the_lines_that_mend_it(
    planner, words
):
    with pytest.raises(InvalidInput) as refused:
        trials_of(planner, PROBLEM, [0])
    assert re.search(words, str(refused.value), flags=re.DOTALL)


def test_a_planner_may_list_its_options_itself():
    ids = {Configuration.of(Listing(gain)).entrant.trial_id(PROBLEM, 0) for gain in (1, 2)}
    assert len(ids) == 2
    assert trials_of(Listing(2), PROBLEM, [0])[0].options == {"gain": 2}


@dataclass(frozen=True)
class Vandal(Stopping):
    """Makes the problem easier, and solves that."""

    def solve(self, problem, *, seed=0):
        with pytest.raises(ValueError, match="read-only"):
            problem.waypoints[0, 0] = 7.0
        object.__setattr__(problem, "waypoints", problem.waypoints[:2].copy())
        problem.limits.velocity.flags.writeable = True
        problem.limits.velocity[:] *= 100.0
        return super().solve(problem, seed=seed)


def test_a_planner_that_changes_the_problem_is_judged_on_ours():
    before = PROBLEM.digest()
    (trial,) = trials_of(Vandal(), PROBLEM, [0], "vandal")
    assert PROBLEM.digest() == before
    assert trial.problem is PROBLEM
    assert trial.id == Configuration.of(Vandal(), "vandal").entrant.trial_id(PROBLEM, 0)
    assert trial.status is Status.INVALID
    assert trial.certified_duration is None


def test_the_processor_is_the_one_the_system_names():
    assert provenance.provenance()["cpu"] == provenance._processor()
    known = Path("/proc/cpuinfo")
    if known.exists():
        assert provenance._processor() in known.read_text() + platform.processor()
