"""Tables that grow in a file: nothing is computed twice, whatever happens to a process is a row."""

from __future__ import annotations

import os
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest

from experiments.common.kept import apart, kept

COLUMNS = ["problem", "seed"]


def test_a_cell_is_computed_once(tmp_path):
    file = tmp_path / "new" / "table.csv"
    rows = [{"gap": 0.75}, {"gap": np.inf}]
    first = kept(file, COLUMNS, {("a", 1): lambda: rows})
    assert first.to_dict("list") == {"problem": ["a", "a"], "seed": [1, 1], "gap": [0.75, np.inf]}
    cells = {("b", 1): lambda: rows[:1], ("a", 1): lambda: pytest.fail("computed twice")}
    both = kept(file, COLUMNS, cells)
    assert both["problem"].tolist() == ["a", "a", "b"]


def test_what_is_interrupted_is_computed_again(tmp_path):
    file = tmp_path / "table.csv"

    def interrupted():
        raise KeyboardInterrupt

    cells = {(1,): lambda: [{"x": 1}], (2,): interrupted}
    with pytest.raises(KeyboardInterrupt):
        kept(file, ["seed"], cells)
    table = pd.read_csv(file)
    assert table["seed"].tolist() == [1]


def test_a_process_that_dies_or_hangs_is_a_row():
    cells = [partial(os._exit, 3), partial(time.sleep, 60.0), partial(max, 1, 2)]
    for timeout in (3.0, 30.0):  # a busy machine may need the longer one
        rows = apart(cells, lost=lambda error: type(error).__name__, workers=1, timeout=timeout)
        found = list(rows)
        if found[2] == 2:
            break
    assert found == ["ProcessExpired", "TimeoutError", 2]
