"""When starts may stop: the rule against cases worked out by hand, and the experiment in small."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments import local_optima
from experiments.local_optima import stopped


@pytest.mark.parametrize(
    ("excess", "agreeing", "expected"),
    [
        ([0.0, 0.0, 0.0], 1, (1, 0.0)),
        ([0.5, 0.0, 0.5, 0.0], 2, (4, 0.0)),  # the second start is better: it wants company
        ([0.5, 0.5, 0.0], 2, (2, 0.5)),  # two agree on what is not the best
        ([np.inf, 0.5, 0.5], 2, (3, 0.5)),  # failed starts agree on nothing
        ([0.0, 0.5, 0.25], 2, (3, 0.0)),  # none agree: all are tried
    ],
)
def test_the_rule(excess: list[float], agreeing: int, expected: tuple[int, float]) -> None:
    assert stopped(np.array(excess), agreeing) == expected


def test_the_tables_count_what_differs() -> None:
    table = pd.DataFrame(
        {
            "problem": [0, 0, 0, 1, 1, 1, 2, 2, 2],
            "duration": [2.0, 2.0, 2.2, 5.0, np.inf, 5.0, np.inf, np.inf, np.inf],
        }
    )
    counts = local_optima.differing(table).set_index("above the best by more than")
    assert counts.loc[1e-2, ["problems", "of problems", "starts"]].tolist() == [1, 2, 1]
    rules = local_optima.rules(table).set_index("agreeing")
    # one start in six, turn by turn, is the worse one of the first problem
    assert rules.loc[1, "missed %"] == pytest.approx(100 / 6)
    assert rules.loc[1, "worst miss"] == pytest.approx(0.1)
    assert rules.loc[2, "missed %"] == 0


def test_the_experiment_keeps_what_it_solved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    local_optima.main(problems=2, starts=3, output=tmp_path)
    assert "exact: 0 of 6 starts failed" in capsys.readouterr().out
    rules = pd.read_csv(tmp_path / "exact-rules.csv")
    assert (rules["missed %"] == 0).all()
    monkeypatch.setattr(local_optima, "durations", None)  # again would fail
    local_optima.main(problems=2, starts=3, output=tmp_path)
