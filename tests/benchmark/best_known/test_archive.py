"""The archive of records is checked by Python alone, and the same records give the same bytes."""

from __future__ import annotations

import csv
import io
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from trajopt import Problem
from trajopt.benchmark.best_known import archive, records
from trajopt.benchmark.suites import catalogue
from trajopt.core.exceptions import InvalidInput

NAMES = ("six-axis", "moving-gap", "rivals-own-ruckig-trajectory")


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three records: a proof, a bound in closed form, a problem in motion."""
    folder = tmp_path_factory.mktemp("registry")
    for name in NAMES:
        file = records.file_of(catalogue.load(name))
        assert file is not None
        shutil.copy(file, folder)
    return folder


def unpacked(registry: Path, where: Path) -> Path:
    file = where / "data.zip"
    assert archive.write(file, registry) == len(NAMES)
    with zipfile.ZipFile(file) as packed:
        packed.extractall(where)
    return where / "data"


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the archive's own script with no package that is installed anywhere."""
    command = [sys.executable, "-I", "-S", folder / "check_all.py"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_python_alone_confirms_every_bound_from_the_archive(registry: Path, tmp_path: Path) -> None:
    ran = check(unpacked(registry, tmp_path))
    assert ran.returncode == 0, ran.stdout
    assert "lower bounds: 3; faults: 0" in ran.stdout


def test_a_changed_file_and_a_higher_bound_are_faults(registry: Path, tmp_path: Path) -> None:
    folder = unpacked(registry, tmp_path)
    index = folder / "index.csv"
    index.write_text(index.read_text() + "one more\n")
    (record,) = folder.glob("records/six-axis*")
    sums = folder / "SHA256SUMS"
    text = record.read_text()
    bound = records.read(record).lower_bound
    record.write_text(text.replace(repr(bound), repr(1.01 * bound)))
    lines = sums.read_text().splitlines(keepends=True)
    sums.write_text("".join(line for line in lines if record.name not in line))
    ran = check(folder)
    assert ran.returncode == 1
    assert "index.csv: not the file of SHA256SUMS" in ran.stdout
    assert f"records/{record.name}: not in SHA256SUMS" in ran.stdout
    assert "faults: 3" in ran.stdout


def test_the_same_records_give_the_same_bytes(registry: Path, tmp_path: Path) -> None:
    once, again = tmp_path / "once" / "data.zip", tmp_path / "again" / "data.zip"
    for file in (once, again):
        file.parent.mkdir()
        archive.write(file, registry)
    assert once.read_bytes() == again.read_bytes()


def test_index_and_problems_are_those_of_the_records(registry: Path, tmp_path: Path) -> None:
    folder = unpacked(registry, tmp_path)
    rows = list(csv.DictReader(io.StringIO((folder / "index.csv").read_text())))
    assert {row["problem"] for row in rows} == set(NAMES)
    for row in rows:
        record = records.read(folder / row["record"])
        assert float(row["duration_s"]) == record.duration
        assert float(row["lower_bound_s"]) == record.lower_bound
        stated = folder / "problems" / f"{Path(row['record']).stem}.toml"
        assert Problem.from_toml(stated).digest() == record.problem.digest()


def test_another_name_and_an_empty_folder_are_one_clear_error(
    registry: Path, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=r"ends in \.zip"):
        archive.write(tmp_path / "data.tar", registry)
    with pytest.raises(InvalidInput, match="a folder of records"):
        archive.write(tmp_path / "data.zip", tmp_path)
