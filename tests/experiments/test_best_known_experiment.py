"""Filling the registry: the six-axis problem ends proved, and a second run finds nothing better."""

from __future__ import annotations

from experiments import best_known
from trajopt.benchmark.best_known import records, verification
from trajopt.benchmark.best_known.record import CLOSED_WITHIN
from trajopt.benchmark.suites import catalogue


def test_six_axis_is_recorded_and_proved_and_stays_as_it_is(tmp_path, capsys):
    where = {"output": tmp_path / "trials", "registry": tmp_path / "registry"}
    best_known.main("six-axis", seconds=20.0, **where)
    (file,) = records.files(tmp_path / "registry")
    assert verification.checked(file).holds
    record = records.find(catalogue.load("six-axis"), tmp_path / "registry")
    assert record.motion.method == "exact"
    assert record.bound.method == "certify"
    assert record.proved_within < CLOSED_WITHIN
    before = file.read_bytes()
    capsys.readouterr()
    best_known.main("six-axis", seconds=20.0, **where)
    assert file.read_bytes() == before
    assert "0 records written" in capsys.readouterr().out
