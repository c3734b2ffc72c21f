"""The relations in small: no violation, nothing done twice, whatever happens recorded."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.soaks import relations
from trajopt import Limits, Problem


def test_two_problems_keep_every_relation_and_are_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "relations.csv"
    file.write_text("problem,kind,excess,tolerance\n0,seconds,1.0,inf\n")  # the first is done
    relations.main(problems=3, output=tmp_path)
    rows = pd.read_csv(file)
    assert (rows["problem"] == 0).sum() == 1
    assert set(rows["problem"]) == {0, 1, 2}
    assert not (rows["excess"] > rows["tolerance"]).any()
    assert not rows["kind"].str.startswith("failed").any()
    found = set(rows["kind"])
    assert {"exact <= toppra", "exact-jerk <= ruckig-search (jerk)", "permuting exact"} <= found
    assert {"scaling exact-jerk (jerk)", "Ruckig by segments = exact-jerk (jerk)"} <= found
    with file.open("a") as end:  # another problem, cut short
        end.write("3,exact <= ruckig-search,1.0,1e-06\n3,exa")
    monkeypatch.setattr(relations, "checked", None)  # again would fail
    relations.main(problems=3, output=tmp_path)
    pd.testing.assert_frame_equal(pd.read_csv(file), rows)
    printed = capsys.readouterr().out
    assert printed[: len(printed) // 2] == printed[len(printed) // 2 :]


def test_every_second_problem_has_jerk_limits_and_a_third_of_them_lopsided() -> None:
    problems = [relations.drawn(seed) for seed in range(12)]
    assert [p.has("jerk") for p in problems] == [False, True] * 6
    lopsided = [bool((p.limits.jerk.sum(axis=1) != 0).any()) for p in problems[1::2]]
    assert lopsided == [False, True, False] * 2


def test_symmetries_undone_give_the_problem_back() -> None:
    limits = Limits(
        [[-1.0, 2.0], [-3.0, 3.0]], [[-4.0, 5.0], [-6.0, 6.0]], [[-7.0, 8.0], [-9.0, 9.0]]
    )
    problem = Problem([[0.0, 0.1], [1.0, -0.2], [0.5, 0.4]], limits)
    for i, (kind, factor, other) in enumerate(relations.alike(problem, seed=1)):
        assert other.digest() != problem.digest() or kind == "permuting"
        if kind != "scaling":
            assert relations.alike(other, seed=1)[i][2].digest() == problem.digest()
        assert factor == (3.7 if kind == "scaling" else 1.0)


def test_failures_are_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> relations.Checks:
        yield "first", np.nan, 1e-6
        raise ArithmeticError("no luck")

    monkeypatch.setattr(relations, "relations", broken)
    rows = relations.checked(0)
    assert list(rows["kind"]) == ["failed: first", "failed: ArithmeticError('no luck')", "seconds"]
    table = relations.table(rows)
    assert list(table["violations"]) == [1, 1]


def test_a_process_that_dies_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relations, "checked", os._exit)
    kinds = [list(rows["kind"]) for rows in relations.run([3, 4], jobs=1)]
    assert [own[1] for own in kinds] == ["seconds", "seconds"]
    assert all(own[0].startswith("failed: ProcessExpired") for own in kinds)
