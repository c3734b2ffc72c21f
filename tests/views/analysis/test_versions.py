"""One version of each planner is shown, by every reader: the one that was compared last."""

import importlib
import shutil
import sys
from dataclasses import dataclass, replace

import pytest
from trials import solved

from trajopt import InvalidInput, Limits, Planner, Problem, compare
from trajopt.benchmark.store import folder as store
from trajopt.planners.registry import load
from trajopt.views.analysis.versions import newest
from trajopt.views.results import Results

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [2.0]), "one")
OTHER = replace(PROBLEM, waypoints=[[0.0], [2.0]], name="two")
SOURCE = """
from dataclasses import dataclass
from trajopt import Planner
from trajopt.planners.registry import load

@dataclass(frozen=True)
class Mine(Planner):
    stochastic = True
    def solve(self, problem, *, seed=0):
        found = load("ruckig-stop").solve(problem)
        from dataclasses import dataclass, replace
        return replace(found, trajectory=found.trajectory.dilated({slower} + seed))
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A planner in a script, imported anew as it is edited."""
    monkeypatch.syspath_prepend(tmp_path)

    def written(slower):
        (tmp_path / "my_script.py").write_text(SOURCE.format(slower=slower))
        sys.modules.pop("my_script", None)
        importlib.invalidate_caches()
        shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
        return importlib.import_module("my_script").Mine()

    yield written
    sys.modules.pop("my_script", None)


def medians(results):
    table = results.summary().set_index("label")
    return table.loc["Mine", ["runs", "median"]].tolist()


def test_every_reader_follows_the_code_as_compare_does(tmp_path, mine, capsys):
    """A folder pooled both versions: 20 of 20, with a median that neither has."""
    folder = tmp_path / "results"
    rival = ("exact", load("exact"))
    for slower, seeds, hidden in ((5, 4, 0), (2, 2, 4), (5, 3, 2)):  # edited, and edited back
        own = medians(compare([PROBLEM], [mine(slower), rival], folder, seeds=seeds))
        readers = [Results(folder), Results(folder / "results.h5")]
        for results in readers:
            runs, median = medians(results)
            assert results.left_out == ({"Mine": hidden} if hidden else {})
            assert runs == (4 if slower == 5 else 2)  # of this version, all there are
            assert median == pytest.approx(own[1], rel=0.5)
    assert str(Results(folder).newest) == (
        "Left out, as the planner's code changed since: trials of Mine (2). "
        "`trajopt diff OLD NEW` compares two versions, a folder each."
    )
    assert len(store.read(folder)) == 7  # nothing is lost


def test_a_version_is_one_on_all_problems(tmp_path, mine):
    compare([PROBLEM, OTHER], [mine(5)], tmp_path / "results", seeds=1)
    compare([PROBLEM], [mine(2)], tmp_path / "results", seeds=1)
    results = Results(tmp_path / "results")
    assert results.left_out == {"Mine": 1 + 1}
    lines = results.summary()
    assert lines.loc[lines["label"] == "Mine", "problem"].tolist() == ["one"]


def test_the_same_trial_from_two_folders_counts_once():
    trial = solved()
    copy = replace(trial, asked="2126-01-01T00:00:00.000+00:00")
    assert newest([trial, copy]).trials == newest([copy, trial]).trials == [copy]
    assert not newest([trial, copy]).left_out


def test_two_planners_of_one_name_are_refused(tmp_path):
    def made(slower):
        @dataclass(frozen=True)
        class Mine(Planner):
            def solve(self, problem, *, seed=0):
                found = load("ruckig-stop").solve(problem)
                return replace(found, trajectory=found.trajectory.dilated(slower))

        return Mine()

    first = made(5)
    second = made(2)
    with pytest.raises(InvalidInput, match="a name of its own"):
        compare([PROBLEM], [first, second], tmp_path / "results")
    found = compare([PROBLEM], [("a", second), ("b", second)], tmp_path / "results", seeds=1)
    assert set(found.summary()["label"]) == {"a", "b"}
