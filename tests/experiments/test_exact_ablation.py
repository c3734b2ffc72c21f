"""The ablation's table is there row by row, and a run that was stopped goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments import exact_ablation
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem


def test_a_run_that_was_stopped_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = [(Problem([[0.0], [way]], Limits([1], [1]), f"{way} m"), np.inf) for way in (1.0, 4.0)]
    rows = {name: {} for name in ("all", "other")}
    timed, stops = exact_ablation.timed, iter([False] * 3 + [True] + [False])

    def stopped(planner: str, problem: Problem):
        if next(stops):
            raise KeyboardInterrupt
        return timed(planner, problem)

    monkeypatch.setattr(exact_ablation, "problems", lambda *_: iter(asked))
    monkeypatch.setattr(exact_ablation, "VARIANTS", {"exact": rows})
    monkeypatch.setattr(exact_ablation, "timed", stopped)
    with pytest.raises(KeyboardInterrupt):
        exact_ablation.main(output=tmp_path)
    assert len(pd.read_csv(tmp_path / "exact-ablation.csv")) == 1
    exact_ablation.main(output=tmp_path)
    assert next(stops, None) is None  # nothing was solved twice
    stored = pd.read_csv(tmp_path / "exact-ablation-answers.csv")
    assert stored["certified, s"].tolist() == pytest.approx([2.0, 5.0, 2.0, 5.0])  # h/V + V/A
    table = pd.read_csv(tmp_path / "exact-ablation.csv")
    assert table["without"].tolist() == ["all", "other"]
    assert (table["longer"] == 0).all()
