"""Each experiment runs in small, finds what it should, and does nothing twice."""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments import families, gaps, rivals
from experiments.__main__ import questions
from experiments.common.output import save_table
from experiments.common.spread import spread
from trajopt.benchmark.suites.catalogue import load


def test_every_experiment_asks_a_question_in_a_line():
    asked = questions()
    assert {"families", "gaps"} <= set(asked)
    for line in asked.values():
        assert line.endswith((".", "?"))


def test_a_saved_table_leaves_blank_what_is_not_there(tmp_path):
    columns = {"a": [1.25, None], "b": ["x", None]}
    rows = pd.Index([1, 2], name="n")
    table = pd.DataFrame(columns, index=rows)
    save_table(table, tmp_path / "new" / "table")
    markdown = tmp_path / "new" / "table.md"
    heading, _, *body = markdown.read_text().splitlines()
    assert [line.replace(" ", "") for line in (heading, *body)] == [
        "|n|a|b|",
        "|1|1.25|x|",
        "|2|||",
    ]
    again = pd.read_csv(markdown.with_suffix(".csv"))
    assert again["a"][0] == 1.25


def test_a_spread_says_how_many_answer():
    rows = [
        ("8 waypoints", "documented", np.nan),
        ("8 waypoints", "documented", 0.1),
        ("8 waypoints", "effort", 0.1),
        ("8 waypoints", "effort", 0.2),
        ("six-axis", "effort", 0.5),
        ("8 waypoints", "nothing", np.nan),
    ]
    table = spread(pd.DataFrame(rows, columns=["group", "planner", "gap"]), ["planner"])
    of_arms = table["8 waypoints"]
    assert of_arms["documented"] == "10.0 (10.0 to 10.0; 1 of 2)"
    assert of_arms["effort"] == "15.0 (10.0 to 20.0; 2)"
    assert of_arms["nothing"] == "none of 1"
    assert list(table["six-axis"].fillna("–")) == ["–", "50.0", "–"]


def test_rivals_are_run_as_documented_and_with_effort(tmp_path):
    rivals.main("six-axis", output=tmp_path)
    table = pd.read_csv(tmp_path / "rivals.csv", index_col="planner")
    gap = table["six-axis"]
    assert gap["toppra, effort"] <= gap["toppra, documented"]
    # stopping everywhere, and the waypoints' velocities searched for
    assert 0 <= gap["ruckig-search, effort"] < 1 < gap["ruckig-search, documented"]


def test_gaps_of_different_problems_are_paired():
    """Where all lines have the same problems there is nothing to pair."""
    table = pd.DataFrame(
        {
            "trials": [3, 1, 2],
            "solved": [3, 0, 1],
            "bounds": [0, 0, 0],
            "gap": [0.5, np.inf, 0.01],
            "worst": [0.75, np.nan, 0.02],
            "yardstick": ["stop"] * 3,
            "there": [0.125, np.nan, 0.0625],
        },
        index=["swarm", "none", "stop"],
    )
    shown = pd.DataFrame(gaps.columns("edges", table))
    assert shown.columns.tolist() == ["edges", "edges: stop there"]
    assert shown.loc["swarm"].tolist() == ["50.00 (75.00)", "12.50"]
    assert shown.loc["none"].tolist() == ["0 of 1", ""]
    assert shown.loc["stop"].tolist() == ["1.00 (2.00); 1 of 2", "6.25"]
    same = gaps.columns("edges", table.assign(there=0.0625))
    assert list(same) == ["edges"]


def test_families_lie_within_each_other(tmp_path, monkeypatch):
    """A spline of a higher degree holds those of a lower one with the same knots."""
    groups = [("six-axis", load("six-axis")), ("published", load("jerk-limit"))]
    monkeypatch.setattr(families, "problems", lambda random: groups)
    families.main(output=tmp_path)
    table = pd.read_csv(tmp_path / "families.csv").set_index(["jerk", "planner"])
    for jerk, group in ((False, "six-axis"), (True, "published")):
        gap = table.loc[jerk, group]
        assert 0 < gap["septic, 7-7-7"] < gap["quintic, 5-5-5"] < gap["3-5-3"]


ROOT = Path(__file__).parents[2]
SCRIPTS = [
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
    for path in sorted((ROOT / "experiments").rglob("*.py"))
    if "cyclopts.run(main)" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_experiment_has_one_word_for_smaller(name):
    assert len(SCRIPTS) >= 16
    assert "quick" in inspect.signature(import_module(name).main).parameters
