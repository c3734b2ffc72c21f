"""The speed table: every task has its ways, and a missing package says what to install."""

import sys

import numpy as np
import pandas as pd

from experiments import speed
from trajopt import Limits, Problem
from trajopt.judging.verification import verify
from trajopt.planners.registry import load
from trajopt.planners.spline353 import trajectory

LIMITS = Limits([1.0], [1.0])
PROBLEM = Problem([[0.0], [1.0], [2.0], [3.0]], LIMITS)


def test_quick_mode_has_every_task_and_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygmo", None)
    speed.main("one-joint", quick=True, output=tmp_path)
    table = pd.read_csv(tmp_path / "speed.csv").set_index("way")
    assert table["task"].nunique() == 2
    missing = table.loc["pygmo's PSO"]
    assert np.isnan(missing["cost"])
    assert "mintime[bench]" in missing["note"]
    measured = table.drop(index="pygmo's PSO")
    assert (measured["cost"] >= 0).all()


def test_the_fitness_is_the_duration_where_limits_are_kept_and_more_where_not():
    """6 s in all is slow enough; in 0.3 s no joint travels 3 rad at 1 rad/s."""
    fitness = speed.Fitness.of(PROBLEM)
    slow = np.array([4.0, 4.0, 4.0])
    assert verify(PROBLEM, trajectory(PROBLEM, slow)).feasible
    fast = np.array([0.1, 0.1, 0.1])
    candidates = np.stack([slow, fast])
    kept, broken = fitness(candidates)
    assert kept == 12.0
    assert broken > fitness.high.sum()


def test_the_error_of_exact_against_itself_is_none():
    duration = speed.certified_duration(PROBLEM, load("exact:starts=1"))
    # 3 rad at most 1 rad/s and 1 rad/s²: 3 / 1 + 1 / 1
    assert abs(duration - 4.0) < 1e-6
