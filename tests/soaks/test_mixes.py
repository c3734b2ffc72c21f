"""The soak of mixed demands keeps what it found, whatever comes next."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from soaks import mixes


def test_an_error_and_a_stop_lose_no_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def checks(seed: int, **_: bool) -> Iterator[mixes.Check]:
        yield "cut at random", f"mix-{seed}", 0.0
        if seed == 41:
            raise ZeroDivisionError
        if seed == 42:
            raise KeyboardInterrupt

    monkeypatch.setattr(mixes, "checks", checks)
    with pytest.raises(SystemExit, match="1"):  # the error
        mixes.main(problems=9, first=40, output=tmp_path)
    rows = pd.read_csv(tmp_path / "mixes-rows.csv")
    assert rows["problem"].str[:6].tolist() == ["mix-40", "mix-41", "mix-41", "mix-42"]
    said = capsys.readouterr().out
    assert "1   1 no error, with jerk limits" in said
    assert "2   0 cut at random, without jerk limits" in said


def test_every_other_seed_and_every_third_of_them_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def checks(seed: int, *, widened: bool, cut: bool) -> Iterator[mixes.Check]:
        asked.append((seed, widened, cut))
        yield "solved is certified", f"mix-{seed}", 0.0

    monkeypatch.setattr(mixes, "checks", checks)
    mixes.main(problems=4, first=41, step=2, wider_every=2, cut_every=3, output=tmp_path)
    widened_and_cut = [(41, True, True), (43, False, False), (45, True, False), (47, False, True)]
    assert asked == widened_and_cut
