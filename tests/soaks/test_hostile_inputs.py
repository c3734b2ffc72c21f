"""Files that a stranger crafted or an accident changed: one line, no traceback, no nonsense."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from soaks import forged_results as forged
from soaks import hostile_inputs, said
from soaks import hostile_texts as texts

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a process's memory, by Linux")

EACH = 3  # times each craft: 33 files
PEAK = 1e6  # MB: the suite's own processes hold more than the experiment allows


@pytest.fixture(autouse=True)
def _any_memory(monkeypatch):
    monkeypatch.setattr(said, "MEMORY_MB", PEAK)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return forged.template(tmp_path_factory.mktemp("template"))


@pytest.mark.parametrize("mutated", [True, False])
def test_text_files_are_read_or_refused_in_a_line(tmp_path, mutated):
    for seed in range(30):
        rng = np.random.default_rng([seed, mutated])
        row = hostile_inputs.text(tmp_path, rng, mutated)
        assert row["faults"] == "", (seed, row)


@pytest.mark.parametrize("craft", dict.fromkeys(forged.CRAFTS), ids=lambda craft: craft.__name__)
def test_crafted_results_are_read_or_refused_in_a_line(folder, tmp_path, craft):
    for seed in range(EACH):
        rng = np.random.default_rng(seed)
        path = forged.crafted(folder, tmp_path, craft, rng)
        found = forged.faults(path, expected=None, report=False)
        assert found == [], seed


def test_corrupted_results_export_no_other_number(folder, tmp_path):
    expected = forged.true_numbers(folder)
    assert len(expected) == len(forged.PLANNERS)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        path = forged.corrupted(folder, tmp_path, rng)
        found = forged.faults(path, expected=expected, report=False)
        assert found == [], seed


def test_the_report_of_a_crafted_file_fails_in_a_line_too(folder, tmp_path):
    rng = np.random.default_rng(1)
    path = forged.crafted(folder, tmp_path, forged.odd_json, rng)
    found = forged.faults(path, expected=None, report=True)
    assert found == []


def test_faults_are_noticed(folder, tmp_path, monkeypatch):
    path = tmp_path / "results.h5"
    path.write_bytes((folder / "results.h5").read_bytes())
    other = forged.true_numbers(folder).replace("one-joint", "another")
    assert forged.faults(path, expected=other, report=False) == ["export: other numbers"]
    err = f"two\nlines of {forged.SECRET}\x1b[31m"
    answer = said.CommandOutcome(2, "", err, "", seconds=11.0, megabytes=2 * PEAK)
    monkeypatch.setattr(said, "by", lambda arguments: answer)
    wrong = ["2 lines of error", "an escape sequence", "11 s", "2000000 MB"]
    wrong.append("another file's content")
    found = forged.faults(path, expected=None, report=False)
    assert found == [*(f"verify: {what}" for what in wrong), *(f"export: {what}" for what in wrong)]


@pytest.mark.parametrize(
    ("name", "old", "new", "found"),
    [
        ("joint limits", b"max_velocity", b"max_velocty", "unknown keys ['max_velocty']"),
        ("joint limits", b"150", b"0150", "numbers ['0150']"),
        ("message, YAML", b"sec: 0", b"sec: 1:30", "numbers ['1:30', "),
        ("polynomials", b'{"joint', b'{"breaks": 1, "joint', "breaks, twice"),
        ("samples, CSV", b"0.0", b"1_0", "numbers ['1_0']"),
        ("URDF", b"<robot", b"<sdf", "unknown keys ['sdf']"),
        ("problem", b"[limits]", b"[limit]", "unknown keys ['limit']"),
    ],
)
def test_nonsense_is_noticed(name, old, new, found):
    kind = texts.formats()[name]
    content = kind.shipped[0].replace(old, new)
    assert content != kind.shipped[0]
    content = content.replace(b"</robot", b"</sdf") if new == b"<sdf" else content
    assert found in texts.nonsense(kind, content)
    for shipped in kind.shipped:
        assert texts.nonsense(kind, shipped) == ""


@pytest.mark.parametrize("name", texts.formats())
def test_shipped_files_are_read(tmp_path, name):
    kind = texts.formats()[name]
    path = tmp_path / f"input{kind.ending}"
    path.write_bytes(kind.shipped[0])
    answer = said.by(kind.command(path))
    assert answer.faults() == []
    assert answer.code in (0, 1)
    assert answer.err == ""
