"""Readers compute every verdict from the stored motion; what a file states is only compared."""

from dataclasses import replace
from pathlib import Path

import pytest
from trials import PROBLEM, Stopping, assert_same, forged, solved

import trajopt
from trajopt import Status, compare
from trajopt.benchmark.store import trial_text, verdicts
from trajopt.benchmark.store.folder import Store, Unheld, read
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import trials_of
from trajopt.planners.registry import load
from trajopt.views import report


def faster(table):
    """A forger's edit: half the duration, within every limit."""
    table["certificate"]["duration"] *= 0.5
    table["certificate"]["dilation"] = 1.0
    for kind in ("velocity", "acceleration"):
        table["certificate"][kind]["value"] = 1.0


def planted(folder, trial, change):
    """Store a trial whose text was edited and sealed again; return the `results.h5` too."""
    store = Store(folder)
    store.write(trial).write_bytes(forged(trial_text.write(trial), change))
    return store.consolidate()


@pytest.mark.parametrize("place", ["folder", "results.h5"])
def test_a_forged_verdict_is_shown_as_computed_and_counted(tmp_path, place):
    true = solved()
    file = planted(tmp_path / "r", true, faster)
    path = file if place == "results.h5" else file.parent
    for _ in range(2):
        with pytest.warns(Unheld, match=r"1 of 1 trials do not hold what they state; every"):
            results = trajopt.Results(path)
        (shown,) = results.items
        assert_same(shown.certificate, true.certificate)
        assert results.trials()["certified_duration"].item() == true.certified_duration
        page = report.write(results, tmp_path / "page.html").read_text(encoding="utf-8")
        assert "1 of 1 trials do not hold what their files state" in page


@pytest.mark.parametrize(
    ("change", "name", "value"),
    [
        (lambda table: table.update(status="failed"), "status", Status.SOLVED),
        (lambda table: table.update(message="it gave up"), "message", ""),
        (lambda table: table.update(label="exact"), "label", "stopping"),
        (lambda table: table.update(certificate=None), "feasible", False),
    ],
)
@pytest.mark.filterwarnings("ignore::trajopt.benchmark.store.folder.Unheld")
def test_no_part_of_a_verdict_is_taken_from_the_file(tmp_path, change, name, value):
    planted(tmp_path / "r", solved(), change)
    for _ in range(2):
        (shown,) = read(tmp_path / "r")
        assert getattr(shown, name) == value


def test_no_verdict_is_remembered(tmp_path, monkeypatch):
    """What a planner wrote into the user's folders says nothing: each reading computes anew."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    store = Store(tmp_path / "r")
    store.write_all([solved(), replace(solved(), seed=8)])
    seen = []
    own = verdicts.verdicts
    monkeypatch.setattr(verdicts, "verdicts", lambda pairs: (seen.extend(pairs), own(pairs))[1])
    for count in (2, 4):
        read(tmp_path / "r")
        assert len(seen) == count
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("bound", [9.0, 0.1])
def test_a_bound_that_gaps_rest_on_is_what_its_proof_proves(tmp_path, bound):
    problem = catalogue.load("one-joint")
    (true,) = trials_of(load("prove"), problem, [0], "prove")

    def change(table):
        table["solution"]["lower_bound"] = bound

    file = planted(tmp_path / "r", true, change)
    for _ in range(2):
        with pytest.warns(Unheld):
            results = trajopt.Results(file)
        (shown,) = results.items
        assert shown.lower_bound == pytest.approx(true.lower_bound, rel=1e-12)
        # the closed form of this problem, 2 s, closes it too
        assert shown.lower_bound <= results.references()["proved"].item() <= 2.0


def test_a_kept_trial_that_does_not_hold_runs_again(tmp_path):
    first = compare([PROBLEM], [("mine", Stopping())], tmp_path / "r")
    (mine,) = (one for one in first.items if one.planner == "mine")
    path = Store(tmp_path / "r").path(mine.id)
    path.write_bytes(forged(path.read_bytes(), faster))
    with pytest.warns(Unheld, match="1 of 3 trials"):
        second = compare([PROBLEM], [("mine", Stopping())], tmp_path / "r")
    assert second.kept.count == 2
    (again,) = (one for one in second.items if one.planner == "mine")
    assert_same(again.certificate, mine.certificate)
    assert [one.id for one in read(Path(tmp_path / "r")) if one.planner == "mine"] == [mine.id]


@pytest.mark.parametrize("name", ["run 12:30.csv", ":"])
def test_a_name_with_a_colon_holds_and_is_kept(tmp_path, name):
    """A label is the name, and a colon and options where there are some."""
    for kept in (None, 3):
        found = compare([PROBLEM], [(name, Stopping())], tmp_path / "r")
        assert (found.kept and found.kept.count) == kept
    (own,) = (trial for trial in found.items if trial.planner == name)
    assert (own.label, own.differences) == (name, ())
    assert verification(tmp_path / "r").holds
