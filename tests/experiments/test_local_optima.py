"""When starts may stop: the rule against cases worked out by hand, and the experiment in small."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from experiments import local_optima
from experiments.local_optima import missed


@pytest.mark.parametrize(
    ("excess", "agreeing", "expected"),
    [
        ([0.0, 0.0, 0.0], 1, 0.0),
        ([0.5, 0.0, 0.5, 0.0], 2, 0.0),  # the second start is better: it wants company
        ([0.5, 0.5, 0.0], 2, 0.5),  # two agree on what is not the best
        ([np.inf, 0.5, 0.5], 2, 0.5),  # failed starts agree on nothing
        ([0.0, 0.5, 0.25], 2, 0.0),  # none agree: all are tried
    ],
)
def test_the_rule(excess, agreeing, expected):
    assert missed(np.array(excess), agreeing) == expected


def test_the_table_counts_what_differs():
    one_worse = [2.0, 2.0, 2.2]
    one_failed = [5.0, np.inf, 5.0]
    all_failed = [np.inf] * 3
    table = pd.DataFrame(
        {"problem": np.repeat([0, 1, 2], 3), "duration": [*one_worse, *one_failed, *all_failed]}
    )
    found = local_optima.summary(table)
    assert found["failed"] == 4
    assert found["above the best by more than 1e-09"] == 1
    # turn by turn, the worse start of the first problem is the first one
    assert found["the first start misses the best by"] == pytest.approx(0.1)
    assert found["the first two that agree miss it by"] == 0


def test_the_experiment_keeps_what_it_solved(tmp_path, capsys, monkeypatch):
    local_optima.main(problems=2, starts=3, output=tmp_path)
    (row,) = pd.read_csv(tmp_path / "exact-summary.csv").to_dict("records")
    assert row["starts"] == 6
    assert row["failed"] == 0
    monkeypatch.setattr(local_optima, "durations", pytest.fail)
    local_optima.main(problems=2, starts=3, output=tmp_path)
