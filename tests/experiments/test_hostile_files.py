"""Files that a stranger crafted or a disk corrupted: one line, no traceback, no other number."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from experiments import hostile_files as hostile

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a process's memory, by Linux")

EACH = 4  # times each craft: 64 files


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return hostile.template(tmp_path_factory.mktemp("template"))


@pytest.mark.parametrize("craft", dict.fromkeys(hostile.CRAFTS), ids=lambda craft: craft.__name__)
def test_crafted_files_are_read_or_refused_in_a_line(
    folder: Path, tmp_path: Path, craft: hostile.Craft
) -> None:
    for seed in range(EACH):
        path = hostile.crafted(folder, tmp_path, craft, np.random.default_rng(seed))
        assert hostile.faults(path, expected=None, report=False) == [], seed


def test_corrupted_files_export_no_other_number(folder: Path, tmp_path: Path) -> None:
    expected = hostile.true_numbers(folder)
    assert len(expected) == len(hostile.PLANNERS)
    for seed in range(40):
        path = hostile.corrupted(folder, tmp_path, np.random.default_rng(seed))
        assert hostile.faults(path, expected=expected, report=False) == [], seed


def test_the_report_of_a_crafted_file_fails_in_a_line_too(folder: Path, tmp_path: Path) -> None:
    path = hostile.crafted(folder, tmp_path, hostile.odd_json, np.random.default_rng(1))
    assert hostile.faults(path, expected=None, report=True) == []


def test_faults_are_noticed(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "results.h5"
    path.write_bytes((folder / "results.h5").read_bytes())
    other = hostile.true_numbers(folder).replace("one-joint", "another")
    assert hostile.faults(path, expected=other, report=False) == ["export: other numbers"]
    said = f"two\nlines of {hostile.SECRET}\x1b[31m"
    monkeypatch.setattr(hostile, "run", lambda arguments: (2, "", said, ""))
    wrong = ["2 lines of error", "an escape sequence", "another file's content"]
    found = hostile.faults(path, expected=None, report=False)
    assert found == [f"{command}: {what}" for command in ("verify", "export") for what in wrong]
