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
    forgeries,
    ordering,
    proved_sizes,
    repair_residuals,
    rivals,
    sweep,
    throughput,
    tricks,
)
from experiments.common.output import save_table
from trajopt import Limits, Problem
from trajopt.benchmark.store.verification import verification
from trajopt.benchmark.suites.catalogue import load
from trajopt.planners.registry import entries, named


def test_ordering_finds_no_violation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ordering.main(problems=1, jobs=1, output=tmp_path)
    table = pd.read_csv(tmp_path / "ordering.csv").set_index("relation")
    assert (table["above 1e-06"] == 0).all()
    assert {"exact <= toppra", "ruckig-search <= ruckig-stop"} <= set(table.index)
    assert "Ruckig by segments = exact" in capsys.readouterr().out


def test_proofs_by_size_are_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    small = {"waypoints": 3, "joints": 2, "seeds": 1, "output": tmp_path}
    proved_sizes.main(**small)
    rows = pd.read_csv(tmp_path / "proved_sizes.csv")
    assert list(rows["status"]) == ["proved", "proved"]
    assert (rows["gap"] <= 1.001e-4).all()
    monkeypatch.setattr(proved_sizes, "measured", None)  # again would fail
    proved_sizes.main(**small)
    assert capsys.readouterr().out.count("proved") == 2


def test_certificates_count_what_is_closed_and_keep_the_proofs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    jerky = Problem([[0.0], [1.5]], Limits([1.0], [2.0], [8.0]), name="jerky")
    chosen = [("one", load("one-joint")), ("other", jerky), ("other", load("reversal"))]
    monkeypatch.setattr(certificates, "drawn_problems", lambda *_: chosen)
    certificates.main(output=tmp_path)
    rows = pd.read_csv(tmp_path / "certificates.csv").set_index("problem")
    assert list(rows["limits"]) == ["va", "vaj", "va"]
    assert (rows["gap"] < 1e-3).all()
    # jerk costs V (A/J): 2.25 s instead of 2 s
    assert rows.loc["jerky", "lifted_gap"] == pytest.approx(0.125, rel=1e-6)
    by_suite = pd.read_csv(tmp_path / "by-suite.csv").set_index("suite")
    assert list(by_suite["closed"]) == [1, 2, 3]
    assert list(by_suite["closed if lifted"]) == [1, 1, 2]
    assert (tmp_path / "certificates.png").exists()
    assert verification(tmp_path).holds
    monkeypatch.setattr(certificates, "measured", None)  # again would fail
    certificates.main(output=tmp_path)
    assert capsys.readouterr().out.count("other") == 2


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
        "|n|a|b|", "|1|1.25|x|", "|2|||"
    ]  # fmt: skip
    assert pd.read_csv(tmp_path / "new" / "table.csv")["a"].tolist()[0] == 1.25


def test_the_tricks_table_shows_a_flaw_or_what_is_certified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tricks.main(output=tmp_path)
    table = pd.read_csv(tmp_path / "tricks.csv").set_index("trick")
    assert (table["claimed %"] < 0).all()
    assert (table["certified %"].isna() == table["flaw"].notna()).all()
    # Four times the acceleration takes half the optimum, 2 √(h / A) = 2 s.
    overflow = table.loc["overflow of 1e+308, 1e+308 in a piece of 1e-40 s"]
    assert overflow["claimed %"] == pytest.approx(-50)
    assert overflow["optimum s"] == pytest.approx(2)
    assert "finite" in overflow["flaw"]
    assert (tmp_path / "tricks.md").read_text().startswith("| trick")
    assert f"certified below the optimum: 0 of {len(table)}" in capsys.readouterr().out


def test_the_repair_leaves_rounding_only(capsys: pytest.CaptureFixture[str]) -> None:
    repair_residuals.main(motions=20)
    *_, last = capsys.readouterr().out.splitlines()
    assert float(last.split()[-4]) < 1e-10  # of a limit


def test_the_forgeries_experiment_says_what_is_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(forgeries, "PROBLEMS", ("six-axis",))
    forgeries.main(output=tmp_path)
    assert "forgeries: 0 believed" in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "forgeries.csv")
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


def test_throughput_times_the_same_trials_at_one_and_two_jobs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = throughput.four_waypoints()
    assert {len(problem.waypoints) for problem in every} == {4}
    monkeypatch.setattr(throughput, "four_waypoints", lambda: every[:2])
    throughput.main(trials=3, iterations=2, output=tmp_path)
    table = pd.read_csv(tmp_path / "throughput.csv")
    assert table["jobs"].tolist() == [1, 2]
    assert table["trials"].nunique() == 1
    assert (table["wall (s)"] > 0).all()


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
