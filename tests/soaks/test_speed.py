"""The speed table: every task has its ways."""

import pandas as pd

from soaks import speed
from trajopt import Limits, Problem
from trajopt.planners.registry import load

LIMITS = Limits([1.0], [1.0])
PROBLEM = Problem([[0.0], [1.0], [2.0], [3.0]], LIMITS)


def test_quick_mode_has_two_tasks(tmp_path):
    speed.main("one-joint", quick=True, output=tmp_path)
    table = pd.read_csv(tmp_path / "speed.csv").set_index("way")
    assert table["task"].nunique() == 2
    assert (table["cost"] >= 0).all()


def test_the_error_of_exact_against_itself_is_none():
    duration = speed.certified_duration(PROBLEM, load("exact:starts=1"))
    # 3 rad at most 1 rad/s and 1 rad/s²: 3 / 1 + 1 / 1
    assert abs(duration - 4.0) < 1e-6
