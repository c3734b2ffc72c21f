"""When starts may stop: the rule against cases worked out by hand, and the experiment in small."""

from __future__ import annotations

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
def test_the_rule(excess, agreeing, expected):
    assert stopped(np.array(excess), agreeing) == expected


def test_the_tables_count_what_differs():
    one_worse = [2.0, 2.0, 2.2]
    one_failed = [5.0, np.inf, 5.0]
    all_failed = [np.inf] * 3
    table = pd.DataFrame(
        {
            "problem": np.repeat([0, 1, 2], 3),
            "duration": [*one_worse, *one_failed, *all_failed],
        }
    )
    counts = local_optima.differing(table).set_index("above the best by more than")
    row = counts.loc[1e-2]
    assert row["problems"] == 1
    assert row["of problems"] == 2
    assert row["starts"] == 1
    rules = local_optima.rules(table).set_index("agreeing")
    # one start in six, turn by turn, is the worse one of the first problem
    assert rules.loc[1, "missed %"] == pytest.approx(100 / 6)
    assert rules.loc[1, "worst miss"] == pytest.approx(0.1)
    assert rules.loc[2, "missed %"] == 0


def test_the_experiment_keeps_what_it_solved(tmp_path, capsys, monkeypatch):
    local_optima.main(problems=2, starts=3, output=tmp_path)
    assert "exact: 0 of 6 starts failed" in capsys.readouterr().out
    rules = pd.read_csv(tmp_path / "exact-rules.csv")
    assert (rules["missed %"] == 0).all()
    monkeypatch.setattr(local_optima, "durations", pytest.fail)
    local_optima.main(problems=2, starts=3, output=tmp_path)
