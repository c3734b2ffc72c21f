"""A killed run loses nothing, and the experiment would notice a loss."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pandas as pd
import pytest

from soaks import kills
from trajopt.benchmark.store.folder import Store, read

pytestmark = pytest.mark.skipif(os.name != "posix", reason="SIGKILL and process groups")


@pytest.mark.long
def test_five_kills_lose_and_tear_nothing(tmp_path, capsys, monkeypatch):
    # fewer words than a child tells: no run to learn from
    monkeypatch.setattr(kills, "uninterrupted", lambda *_: (80, 90))
    kills.main(output=tmp_path, quick=True)
    rows = pd.read_csv(tmp_path / "kills.csv")
    assert (rows[kills.FAULTS] == 0).all(axis=None), rows.to_string()
    assert len(rows) == 5
    assert set(rows["hit"]) <= set(kills.STEPS)
    assert rows["promised"].between(0, 22).all()
    assert not list(tmp_path.glob("kill-*"))
    monkeypatch.setattr(kills, "attempt", pytest.fail)
    kills.main(output=tmp_path, quick=True)
    table = pd.read_csv(tmp_path / "kills-by-step.csv", index_col="step hit")
    assert list(table.index) == [*kills.STEPS, "all"]
    *by_step, every = table["kills"]
    assert every == sum(by_step) == 5
    assert capsys.readouterr().out.count(": replace") == 2


def test_the_child_tells_every_step_and_how_many_trials_are_kept(tmp_path):
    told, _ = kills.told(tmp_path / "run", jobs=0)
    words = [word for _, word in told]
    steps = {*kills.CALLS, kills.MAKING, "end"}
    assert set(words) - {str(number) for number in range(23)} == steps
    assert "replace" in words[words.index(kills.MAKING) :]
    assert words[-1] == "end"
    assert "22" in words
    # each of 22 trials and results.h5 is renamed into place once; what is unfinished is said before
    assert words.count("replace") == 24


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference")
    kills.sweep(folder, seeds=1)
    return folder


def cut(path):
    content = path.read_bytes()
    half = len(content) // 2
    path.write_bytes(content[:half])


def exchanged(path):
    """A trial of the same identity with another answer."""
    store = Store(path.parent.parent)
    (one,) = read(path)
    others = [t for t in store.read() if t.problem == one.problem]
    answer = next(t for t in others if t.planner != one.planner)
    object.__setattr__(one, "solution", answer.solution)
    store.write(one)


CASES = [
    ("trials", lambda path: None, {}),
    ("trials", Path.unlink, {"lost": 1}),
    ("trials", cut, {"lost": 1, "torn": 1}),
    ("trials", lambda path: path.write_bytes(b""), {"lost": 1, "torn": 1}),
    ("trials", exchanged, {"different": 1, "run again": 1}),
    ("results.h5", Path.unlink, {"lost": 8}),
    ("results.h5", cut, {"lost": 8, "torn": 1}),
]


@pytest.mark.parametrize(("what", "harm", "expected"), CASES)
@pytest.mark.filterwarnings("ignore::trajopt.benchmark.store.folder.DamagedFile")
@pytest.mark.filterwarnings("ignore::trajopt.benchmark.store.folder.Unheld")
def test_harm_is_noticed(tmp_path, whole, monkeypatch, what, harm, expected):
    sweep = kills.sweep
    monkeypatch.setattr(kills, "sweep", lambda folder: sweep(folder, seeds=1))
    folder = shutil.copytree(whole, tmp_path / "killed")
    reference = kills.answers(Store(whole).read())
    place = folder / what
    if place.is_dir():
        place = min(place.iterdir())
    harm(place)
    found = kills.faults(folder, len(reference), set(reference), reference)
    counted = {fault: found[fault] for fault in kills.FAULTS}
    assert {fault: count for fault, count in counted.items() if count} == expected
    assert bool(found["note"]) == ("torn" in expected)
