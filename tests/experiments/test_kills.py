"""A killed run loses nothing, and the experiment would notice a loss."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from experiments import kills
from trajopt.benchmark.store.folder import Store, read

pytestmark = pytest.mark.skipif(os.name != "posix", reason="SIGKILL and process groups")


def test_five_kills_in_every_phase_lose_and_tear_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    uninterrupted = kills.uninterrupted
    # Half a folder of trials changes little of how long a phase takes: one run to learn from.
    monkeypatch.setattr(kills, "uninterrupted", lambda *setting: uninterrupted(*setting[:2], False))
    kills.main(output=tmp_path, quick=True)
    rows = pd.read_csv(tmp_path / "kills.csv")
    assert (rows[kills.FAULTS] == 0).all(axis=None), rows.to_string()
    assert len(rows) == 5
    assert set(rows["wanted"]) == set(kills.PHASES[:-1])
    assert set(rows["hit"]) <= set(kills.PHASES)
    assert rows["promised"].between(0, 22).all()
    assert not list(tmp_path.glob("kill-*"))
    monkeypatch.setattr(kills, "attempt", None)  # again would fail
    kills.main(output=tmp_path, quick=True)
    table = pd.read_csv(tmp_path / "kills-by-phase.csv", index_col="phase hit")
    assert list(table.index) == [*kills.PHASES, "all"]
    assert table.loc["all", "kills"] == table["kills"][:-1].sum() == 5
    assert capsys.readouterr().out.count("consolidating") == 2


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reference")
    kills.sweep(folder, seeds=1)
    return folder


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def exchanged(path: Path) -> None:
    """A trial of the same identity with another answer."""
    store = Store(path.parent.parent)
    one = read(path)[0]
    other = store.read()
    answer = next(t for t in other if t.problem == one.problem and t.planner != one.planner)
    object.__setattr__(one, "solution", answer.solution)
    store.write(one)


CASES: list[tuple[str, Callable[[Path], object], dict[str, int]]] = [
    ("trials", lambda path: None, {}),
    ("trials", Path.unlink, {"lost": 1}),
    ("trials", cut, {"lost": 1, "torn": 1}),
    ("trials", lambda path: path.write_bytes(b""), {"lost": 1, "torn": 1}),
    ("trials", exchanged, {"different": 1, "unequal": 1}),
    ("results.h5", Path.unlink, {"lost": 8}),
    ("results.h5", cut, {"lost": 8, "torn": 1}),
]


@pytest.mark.parametrize(("what", "harm", "expected"), CASES)
@pytest.mark.filterwarnings("ignore::trajopt.benchmark.store.folder.DamagedFile")
def test_harm_is_noticed(
    tmp_path: Path,
    whole: Path,
    monkeypatch: pytest.MonkeyPatch,
    what: str,
    harm: Callable[[Path], object],
    expected: dict[str, int],
) -> None:
    sweep = kills.sweep
    monkeypatch.setattr(kills, "sweep", lambda folder: sweep(folder, seeds=1))
    folder = shutil.copytree(whole, tmp_path / "killed")
    reference = kills.answers(Store(whole).read())
    harm(folder / what if what != "trials" else sorted((folder / what).iterdir())[0])
    found = kills.faults(folder, set(reference), set(reference), reference)
    assert {fault: found[fault] for fault in kills.FAULTS if found[fault]} == expected
    assert bool(found["note"]) == ("torn" in expected)
