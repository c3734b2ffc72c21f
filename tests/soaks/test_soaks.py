"""Each soak says its question, runs in small, and fails where an attack succeeds."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest

import soak
from experiments.__main__ import questions
from soaks import commands, forgeries, relations, tricks

QUESTIONS = questions(Path(__file__).parent, soak.COMMAND)


def test_every_soak_asks_a_question_in_a_line():
    assert {"tricks", "kills", "speed", "commands"} <= set(QUESTIONS)
    for line in QUESTIONS.values():
        assert line.endswith((".", "?"))


def test_soaks_are_listed_and_run_by_name(tmp_path, capsys, monkeypatch):
    with pytest.raises(SystemExit, match="no soak is called 'trick'"):
        soak.main("trick")
    assert "python tests/soak.py tricks" in capsys.readouterr().out
    trick = tricks.tricks()[0]
    monkeypatch.setattr(tricks, "tricks", lambda: [trick])
    soak.main("tricks", "--output", str(tmp_path))
    assert "0 of 1 attacks" in capsys.readouterr().out


@pytest.mark.parametrize("name", QUESTIONS)
def test_every_soak_has_one_word_for_smaller(name):
    assert "quick" in inspect.signature(import_module(f"soaks.{name}").main).parameters


@pytest.mark.long
def test_the_forgeries_experiment_says_what_is_believed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(forgeries, "PROBLEMS", ("six-axis",))
    forgeries.main(output=tmp_path)
    table = pd.read_csv(tmp_path / "forgeries.csv")
    assert f"0 of {len(table)} attacks of 9 families" in capsys.readouterr().out
    unproved = table["proved %"].isna()
    refused = table["refused"].notna()
    assert (unproved == refused).all()
    monkeypatch.setattr(forgeries, "believed", lambda _: 2.0)
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
    assert table.loc["list"].to_dict() == {"new, s": 2.0, "old, s": 5.0, "old / new": 2.5}

    said = tmp_path / "said"
    command = tmp_path / "command"
    command.write_text(f"#!/bin/sh\necho $1 >> {said}\n")
    command.chmod(0o755)
    commands.main(str(command), rounds=2, output=tmp_path / "output")
    assert said.read_text().split() == ["compare", "compare", "list"] * 2
    written = pd.read_csv(tmp_path / "output" / "commands.csv")
    assert written["task"].tolist() == ["main job", "second run", "list"]


@pytest.mark.long
def test_a_soak_says_at_once_how_much_there_is(tmp_path, capsys):
    relations.main(output=tmp_path, problems=1)
    assert capsys.readouterr().err.startswith("experiment: 1 trials in all\n")
