"""Failures by kind of reason: what the verifier says of made-up trajectories, counted by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_results import OTHER, PROBLEM, Answering, leaving, run
from trials import as_runs

from trajopt import Limits, Problem, Status, Trajectory
from trajopt.benchmark.trial import Configuration, Trial, trials_of, unanswered
from trajopt.cli.suite_table import show
from trajopt.planners.swarm_planner import Unoptimised
from trajopt.views import report
from trajopt.views.analysis.failures import Failure, Reason, failures, in_words
from trajopt.views.results import Results

LIMITED = Problem([[0.0], [0.4], [0.5]], Limits([10.0], [100.0], position=[[-1.0, 0.5]]), "limited")


def message(status: Status, text: str) -> Trial:
    own = Configuration.of(Unoptimised(), "own")
    return unanswered(own.entrant, PROBLEM, 0, status, text)


def piecewise(*values: float) -> list[Trial]:
    """From rest through values (rad) at whole seconds, as if the velocity could jump."""
    breaks = np.arange(len(values))
    trajectory = Trajectory(
        breaks, [np.diff(values)[:, None], np.array(values)[:-1, None]], breaks[[0, -1]]
    )
    return trials_of(Answering(trajectory), PROBLEM, [0], "straight")


def test_position_limits_are_counted_once_with_the_worst() -> None:
    items = [*leaving(LIMITED, 2.56), *leaving(LIMITED, 1.5), *leaving(LIMITED, 0.7)]
    table = failures(Results(as_runs(items)))
    (row,) = table.itertuples()
    assert (row.kind, row.count, row.unit) == ("leave position limits", 3, "rad")
    assert row.worst == pytest.approx(2.06)
    assert in_words(table) == "3 leave position limits, worst 2.06 rad"


@pytest.mark.parametrize("name", ["panda_joint6", "slide at 3 s: it moves by 2 mm", "7"])
def test_named_joints_are_of_one_kind_too(name: str) -> None:
    named = replace(LIMITED, joint_names=(name,))
    items = [*leaving(LIMITED, 0.7), *leaving(named, 2.56)]
    table = failures(Results(as_runs(items)))
    assert in_words(table) == "2 leave position limits, worst 2.06 rad"


def test_every_flaw_that_the_verifier_names_has_a_kind() -> None:
    late = trials_of(
        Answering(Trajectory([0, 1], [[[0.9]], [[0.0]]], [0, 1])), PROBLEM, [0], "late"
    )
    skip = Trajectory([0, 1, 2], [[[0.0], [0.0]], [[0.0], [1.0]]], [0, 2])
    jumps = trials_of(Answering(skip), PROBLEM, [0], "skips")
    words = {
        t.label.split(":")[0]: in_words(failures(Results([t])))
        for t in [*late, *jumps, *piecewise(0.0, 1.0)]
    }
    assert words == {
        "late": "1 miss a waypoint, worst 0.1 rad",
        "skips": "1 jump in position, worst 1 rad",
        "straight": "1 jump in velocity, worst 1 rad/s",
    }


def test_messages_that_differ_in_numbers_are_one_kind() -> None:
    items = [
        message(Status.TIMEOUT, "stopped after 600 s"),
        message(Status.TIMEOUT, "stopped after 1 s"),
        message(Status.CRASHED, "Traceback\n  File x, line 3\nValueError: bad x1: -2.5e-3\n"),
        message(Status.CRASHED, "Traceback\n  File x, line 9\nValueError: bad x1: 7\n"),
        message(Status.CRASHED, "ValueError: bad x2: 7"),
        message(Status.FAILED, ""),
    ]
    table = failures(Results(as_runs(items)))
    assert dict(zip(table["kind"], table["count"], strict=True)) == {
        "timeout: stopped after … s": 2,
        "crashed: ValueError: bad x1: …": 2,
        "crashed: ValueError: bad x2: …": 1,
        "failed": 1,
    }
    assert in_words(table.iloc[[0, -1]]) == "2 timeout: stopped after … s; 1 failed"


def test_failures_are_those_of_the_overview() -> None:
    items = [
        *run("mine", 2.0, -1, -1),
        *run("mine", -1, problem=OTHER),
        *run("prove", -1, bound=1.0),
        message(Status.UNSUPPORTED, "not for me"),
    ]
    results = Results(items)
    table = failures(results)
    assert table.index.tolist() == ["mine"]
    assert table["count"].sum() == results.planners()["failed"].sum() == 3
    assert failures(Results(run("mine", 2.0))).empty
    assert in_words(failures(Results([]))) == ""


def test_the_terminal_says_why_planners_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    items = [message(Status.TIMEOUT, f"stopped after {seconds} s") for seconds in (1, 2, 600)]
    monkeypatch.setattr(report, "write", lambda *_, **__: tmp_path / "report.html")
    show(Results(as_runs([*items, message(Status.CRASHED, "boom")], "own")), tmp_path)
    said = " ".join(capsys.readouterr().out.split())
    assert "own: 4 failed: 3 timeout: stopped after … s; 1 crashed: boom" in said


def test_a_failure_says_its_kind_and_the_largest_size():
    assert (
        str(Failure([], Reason("miss a waypoint", 0.25, "rad")))
        == "miss a waypoint, worst 0.25 rad"
    )
    assert str(Failure([], Reason("gave up"))) == "gave up"
