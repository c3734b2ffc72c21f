"""The curves of figures by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trajopt.views.analysis import curves


def test_anytime_curves_are_quartiles_in_percent():
    """Two runs at 2 and 3 times the optimum after 1 s, one of which reaches it after 10 s."""
    runs = [np.array([[1.0, 2.0], [10.0, 1.0]]), np.array([[1.0, 3.0]])]
    spent, quartiles = curves.anytime({"search": runs})["search"]
    assert spent[[0, -1]].tolist() == [1.0, 10.0]
    assert quartiles[:, 0] == pytest.approx([125, 150, 175])
    assert quartiles[:, -1] == pytest.approx([50, 100, 150])


def test_a_planner_that_answers_once_is_a_point():
    once = [np.array([[2.0, 1.5]]), np.array([[4.0, 1.5]])]
    spent, quartiles = curves.anytime({"a": once, "b": [np.array([[1.0, 1.0]])]})["a"]
    assert spent.tolist() == [3.0]
    assert quartiles.shape == (3, 1)
    assert quartiles == pytest.approx(50)


def test_gap_shares_end_beyond_the_worst_gap():
    """Half of the problems are within 1 %, all within 200 %."""
    table = pd.DataFrame(
        {"label": "a", "digest": ["x", "y"], "gap": [0.01, 2.0], "reference": [1.0, 1.0]}
    )
    percent, shares = curves.gap_shares(table, ["a"])["a"]
    assert percent[0] == pytest.approx(curves.GAP_FLOOR)
    assert percent[-1] == pytest.approx(220)
    assert np.interp([0.5, 2.0, 150.0], percent, shares) == pytest.approx([0, 0.5, 0.5])
    assert shares[-1] == 1
