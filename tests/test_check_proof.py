"""The script of fifty lines that checks a stored proof knows no more than NumPy, and no other."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue

SCRIPT = Path(__file__).parents[1] / "docs" / "examples" / "best-known" / "check_proof.py"


@pytest.fixture(scope="module")
def record():
    file = records.file_of(catalogue.load("six-axis"))
    return json.loads(file.read_text(encoding="utf-8"))


def checked(said):
    """Run where neither trajopt nor anything else of ours can be imported."""
    return subprocess.run(
        [sys.executable, "-I", SCRIPT],
        input=json.dumps(said),
        capture_output=True,
        text=True,
        check=False,
    )


def test_it_is_short_and_imports_numpy_only():
    text = SCRIPT.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 50
    imports = {line.split()[1] for line in text.splitlines() if "import" in line.split()[:1]}
    assert imports == {"json", "sys", "numpy"}
    assert "trajopt" not in text


def test_a_stored_proof_proves_what_is_recorded(record):
    ran = checked(record)
    assert ran.returncode == 0, ran.stderr
    assert f"no motion is briefer than {record['lower_bound']:.9f} s" in ran.stdout


def larger_bound(said):
    said["lower_bound"] *= 1 + 1e-7


def no_multipliers(said):
    said["proof"]["multipliers"] = []


def shorter_way(said):
    rows = said["problem"]["waypoints"]
    said["problem"]["waypoints"] = [[0.99 * q for q in row] for row in rows]


def faster_joints(said):
    pairs = said["problem"]["limits"]["acceleration"]
    said["problem"]["limits"]["acceleration"] = [[1.1 * a for a in pair] for pair in pairs]


def other_costates(said):
    for cell in said["proof"]["cells"]:
        cell[4] *= 1.1


def other_units(said):
    units = said["proof"]["units"]
    said["proof"]["units"] = [2 * unit for unit in units]


def another_segments_cut(said):
    said["proof"]["cuts"][0][0] = -1


def overlapping_cells(said):
    said["proof"]["cells"][1][0] = 0.99


@pytest.mark.parametrize(
    "tamper",
    [
        larger_bound,
        no_multipliers,
        shorter_way,
        faster_joints,
        other_costates,
        other_units,
        another_segments_cut,
        overlapping_cells,
    ],
)
def test_a_tampered_proof_fails(record, tamper):
    said = json.loads(json.dumps(record))
    tamper(said)
    assert checked(said).returncode == 1
