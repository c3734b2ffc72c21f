"""Each experiment runs in small, finds what it should, and does nothing twice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments import (
    certificates,
    commands,
    explained,
    rivals,
    sweep,
)
from experiments.__main__ import questions
from experiments.common.output import save_table
from experiments.soaks import forgeries, repair_residuals, tricks
from trajopt import Limits, Problem
from trajopt.benchmark.suites.catalogue import load
from trajopt.planners.registry import entries, named


def test_every_experiment_asks_a_question_in_a_line() -> None:
    asked = questions()
    assert {"experiments.certificates", "experiments.soaks.tricks"} <= set(asked)
    assert all(line.endswith((".", "?")) for line in asked.values())


def test_certificates_count_what_is_closed() -> None:
    chosen = [("one", load("one-joint")), ("other", load("reversal"))]
    unknown = Problem([[0.0], [1.2345]], Limits([1.0], [2.0]))
    chosen.append(("other", unknown))
    rows = pd.DataFrame([certificates.recorded(*pair) for pair in chosen])
    table = certificates.counted(rows)
    assert list(table.index) == ["one", "other", "all"]
    assert table["closed"].tolist() == [1, 1, 2]
    assert table["without a record"].tolist() == [0, 1, 1]
    assert (table["largest gap, %"] < 0.1).all()


def test_random_problems_are_proved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    certificates.sizes(waypoints=3, joints=2, seeds=1, output=tmp_path)
    assert "proved to 0.01 %: 2 of 2" in capsys.readouterr().out


def test_explained_draws_both_decompositions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    explained.main(planner=("ruckig-stop", "unoptimised"), output=tmp_path)
    table = pd.read_csv(tmp_path / "explained.csv").set_index("planner")
    product = (1 + table["timing_gap"]) * (1 + table["route_gap"])
    assert product.tolist() == pytest.approx((1 + table["gap"]).tolist(), rel=1e-9)
    assert table["shape_gap"].notna().tolist() == [False, True]
    assert {f.name for f in tmp_path.iterdir()} >= {"waterfalls.png", "waterfalls.svg"}
    assert "ruckig-stop" in capsys.readouterr().out


def test_a_saved_table_leaves_blank_what_is_not_there(tmp_path: Path) -> None:
    table = pd.DataFrame({"a": [1.25, None], "b": ["x", None]}, index=pd.Index([1, 2], name="n"))
    save_table(table, tmp_path / "new" / "table")
    lines = (tmp_path / "new" / "table.md").read_text().splitlines()
    assert [line.replace(" ", "") for line in (lines[0], *lines[2:])] == [
        "|n|a|b|",
        "|1|1.25|x|",
        "|2|||",
    ]
    assert pd.read_csv(tmp_path / "new" / "table.csv")["a"].tolist()[0] == 1.25


def test_the_repair_leaves_rounding_only(capsys: pytest.CaptureFixture[str]) -> None:
    repair_residuals.main(motions=20)
    *_, last = capsys.readouterr().out.splitlines()
    assert float(last.split()[-4]) < 1e-10  # relative to a limit


def test_the_forgeries_experiment_says_what_is_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(forgeries, "PROBLEMS", ("six-axis",))
    forgeries.main(output=tmp_path)
    table = pd.read_csv(tmp_path / "forgeries.csv")
    assert f"0 of {len(table)} attacks of 9 families" in capsys.readouterr().out
    assert (table["proved %"].isna() == table["refused"].notna()).all()
    monkeypatch.setattr(forgeries, "proved", lambda _: 2.0)
    with pytest.raises(SystemExit, match="1"):
        forgeries.main(output=tmp_path)


def test_the_tricks_experiment_fails_where_a_trick_succeeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trick = tricks.tricks()[0]
    monkeypatch.setattr(tricks, "tricks", lambda: [replace(trick, optimum=1e3)])
    monkeypatch.setattr(tricks, "verify", lambda *_: Certified(999.0))
    with pytest.raises(SystemExit, match="1"):
        tricks.main(output=tmp_path)


@dataclass(frozen=True)
class Certified:
    certified_duration: float
    flaws: tuple[str, ...] = ()


def test_commands_are_compared_by_their_medians(tmp_path: Path) -> None:
    rounds = [
        {"new": {"list": new}, "old": {"list": old}}
        for new, old in ((1.0, 6.0), (9.0, 4.0), (2.0, 5.0))
    ]
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


def test_the_sweep_writes_its_report_and_counts_every_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    others = {name for name, entry in entries().items() if "third_party" in entry.point.module}
    assert {named(spec)[0] for spec in sweep.planners()} == set(entries()) - others
    every = sweep.drawn()
    assert sum(map(len, every.values())) == len({p.digest() for own in every.values() for p in own})
    few = {name: sweep.drawn(1)[name] for name in ("six-axis", "robots")}
    monkeypatch.setattr(sweep, "drawn", lambda size: few)
    monkeypatch.setattr(sweep, "planners", lambda: ["unoptimised", "ruckig-stop"])
    sweep.main(quick=True, jobs=1, output=tmp_path)
    table = pd.read_csv(tmp_path / "sweep.csv").set_index("label")
    assert table.loc["ruckig-stop", "solved"] == 2
    suites = pd.read_csv(tmp_path / "suites.csv").set_index(["group", "label"])
    assert suites.loc[("six-axis", "unoptimised"), "gap"] == pytest.approx(6 / 1.483853 - 1, 1e-6)
    trials = len(list((tmp_path / "trials").iterdir()))
    assert table[["trials", "unsupported"]].to_numpy().sum() == trials
    files = pd.read_csv(tmp_path / "files.csv").set_index("what")
    assert files.loc["trials/", "files"] == trials
    assert files.loc["report.html", "MB"] > 0.5
    monkeypatch.setattr(sweep.run, "compare", None)  # again would fail
    sweep.main(stored=True, output=tmp_path)
    again = pd.read_csv(tmp_path / "sweep.csv").set_index("label")
    pd.testing.assert_frame_equal(again, table)
    assert again.loc["ruckig-stop", "proved"] <= again.loc["ruckig-stop", "problems"]
    assert "ruckig-stop" in capsys.readouterr().out


def test_the_table_of_rivals_says_how_many_are_solved() -> None:
    rows = [
        ("8 waypoints", "a", "toppra", "documented", np.nan, 2.0),
        ("8 waypoints", "b", "toppra", "documented", 2.2, 2.0),
        ("8 waypoints", "a", "toppra", "effort", 2.2, 2.0),
        ("8 waypoints", "b", "toppra", "effort", 2.4, 2.0),
        ("six-axis", "six-axis", "toppra", "effort", 3.0, 2.0),
        ("8 waypoints", "a", "ruckig-search", "effort", np.nan, 2.0),
    ]
    table = rivals.gaps(pd.DataFrame(rows, columns=rivals.COLUMNS[:6]))
    of_arms = table["8 waypoints"]
    assert of_arms["toppra", "documented"] == "10.0 (10.0 to 10.0; 1 of 2)"
    assert of_arms["toppra", "effort"] == "15.0 (10.0 to 20.0; 2)"
    assert of_arms["ruckig-search", "effort"] == "none of 1"
    assert list(table["six-axis"]) == ["–", "50.0", "–"]


def test_rivals_are_run_as_documented_and_with_effort() -> None:
    rows = pd.DataFrame(rivals.trials(load("six-axis")))
    best = rows.pivot(index="planner", columns="mode", values="seconds")
    assert {"toppra", "ruckig-search"} <= set(best.index)
    assert (best["effort"] <= best["documented"]).all()
    assert (best["effort"] > rows["best known"].min() * (1 - 1e-9)).all()
