"""Each experiment runs in small, finds what it should, and does nothing twice."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest

from experiments import (
    certificates,
    commands,
    rivals,
)
from experiments.__main__ import questions
from experiments.common.output import save_table
from experiments.soaks import forgeries, tricks
from trajopt import Limits, Problem
from trajopt.benchmark.suites.catalogue import load


def test_every_experiment_asks_a_question_in_a_line():
    asked = questions()
    assert {"experiments.certificates", "experiments.soaks.tricks"} <= set(asked)
    for line in asked.values():
        assert line.endswith((".", "?"))


def test_certificates_count_what_is_closed():
    chosen = [("one", load("one-joint")), ("other", load("reversal"))]
    limits = Limits([1.0], [2.0])
    unknown = Problem([[0.0], [1.2345]], limits)
    chosen.append(("other", unknown))
    rows = pd.DataFrame([certificates.recorded(*pair) for pair in chosen])
    table = certificates.counted(rows)
    assert list(table.index) == ["one", "other", "all"]
    assert table["closed"].tolist() == [1, 1, 2]
    assert table["without a record"].tolist() == [0, 1, 1]
    assert (table["largest gap, %"] < 0.1).all()


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


def test_the_forgeries_experiment_says_what_is_believed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(forgeries, "PROBLEMS", ("six-axis",))
    forgeries.main(output=tmp_path)
    table = pd.read_csv(tmp_path / "forgeries.csv")
    assert f"0 of {len(table)} attacks of 9 families" in capsys.readouterr().out
    unproved = table["proved %"].isna()
    refused = table["refused"].notna()
    assert (unproved == refused).all()
    monkeypatch.setattr(forgeries, "proved", lambda _: 2.0)
    with pytest.raises(SystemExit, match="1"):
        forgeries.main(output=tmp_path)


def test_the_tricks_experiment_fails_where_a_trick_succeeds(tmp_path, monkeypatch):
    trick = tricks.tricks()[0]
    monkeypatch.setattr(tricks, "tricks", lambda: [replace(trick, optimum=1e3)])
    monkeypatch.setattr(tricks, "verify", lambda *_: Certified(999.0))
    with pytest.raises(SystemExit, match="1"):
        tricks.main(output=tmp_path)


@dataclass(frozen=True)
class Certified:
    certified_duration: float
    flaws: tuple[str, ...] = ()


def test_commands_are_compared_by_their_medians(tmp_path):
    rounds = []
    for new, old in ((1.0, 6.0), (9.0, 4.0), (2.0, 5.0)):
        taken = {"new": {"list": new}, "old": {"list": old}}
        rounds.append(taken)
    table = commands.medians(rounds)
    assert table.loc["list"].to_dict() == {
        "new, s": 2.0,
        "old, s": 5.0,
        "old / new": 2.5,
    }

    said = tmp_path / "said"
    command = tmp_path / "command"
    command.write_text(f"#!/bin/sh\necho $1 >> {said}\n")
    command.chmod(0o755)
    commands.main(str(command), rounds=2, output=tmp_path / "output")
    assert said.read_text().split() == ["compare", "compare", "list"] * 2
    written = pd.read_csv(tmp_path / "output" / "commands.csv")
    assert written["task"].tolist() == ["main job", "second run", "list"]


def test_the_table_of_rivals_says_how_many_are_solved():
    rows = [
        ("8 waypoints", "a", "toppra", "documented", np.nan, 2.0),
        ("8 waypoints", "b", "toppra", "documented", 2.2, 2.0),
        ("8 waypoints", "a", "toppra", "effort", 2.2, 2.0),
        ("8 waypoints", "b", "toppra", "effort", 2.4, 2.0),
        ("six-axis", "six-axis", "toppra", "effort", 3.0, 2.0),
        ("8 waypoints", "a", "ruckig-search", "effort", np.nan, 2.0),
    ]
    columns = ["group", "problem", "planner", "mode", "seconds", "best known"]
    table = rivals.gaps(pd.DataFrame(rows, columns=columns))
    of_arms = table["8 waypoints"]
    assert of_arms["toppra", "documented"] == "10.0 (10.0 to 10.0; 1 of 2)"
    assert of_arms["toppra", "effort"] == "15.0 (10.0 to 20.0; 2)"
    assert of_arms["ruckig-search", "effort"] == "none of 1"
    assert list(table["six-axis"]) == ["–", "50.0", "–"]


def test_rivals_are_run_as_documented_and_with_effort():
    rows = pd.DataFrame(rivals.trials(load("six-axis")))
    best = rows.pivot(index="planner", columns="mode", values="seconds")
    assert {"toppra", "ruckig-search"} <= set(best.index)
    assert (best["effort"] <= best["documented"]).all()
    known = rows["best known"].min()
    assert best["effort"].min() > known * (1 - 1e-9)
