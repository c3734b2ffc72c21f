"""Each experiment runs in small, finds what it should, and does nothing twice."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from experiments import certificates, ordering


def test_ordering_finds_no_violation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ordering.main(problems=2, jobs=2, output=tmp_path)
    table = pd.read_csv(tmp_path / "ordering.csv").set_index("relation")
    assert (table["above 1e-06"] == 0).all()
    assert {"exact <= toppra", "ruckig <= ruckig-stop"} <= set(table.index)
    assert "Ruckig by segments = exact" in capsys.readouterr().out


def test_certificates_are_proved_and_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    small = {"waypoints": 3, "joints": 2, "seeds": 1, "output": tmp_path}
    certificates.main(**small)
    rows = pd.read_csv(tmp_path / "certificates.csv")
    assert list(rows["status"]) == ["proved", "proved"]
    assert (rows["gap"] <= 1.001e-4).all()
    monkeypatch.setattr(certificates, "measured", None)  # again would fail
    certificates.main(**small)
    assert capsys.readouterr().out.count("proved") == 2
