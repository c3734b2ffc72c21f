"""The relations in small: no violation, nothing done twice, whatever happens recorded."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from soaks import relations
from trajopt import Limits, Problem


@pytest.mark.long
def test_two_problems_keep_every_relation_and_are_kept(tmp_path, capsys, monkeypatch):
    file = tmp_path / "relations.csv"
    file.write_text("problem,kind,excess,tolerance\n0,first,0.0,inf\n")  # it is done
    relations.main(problems=3, output=tmp_path)
    first = capsys.readouterr().out
    rows = pd.read_csv(file)
    of_first = rows["problem"] == 0
    assert of_first.sum() == 1
    assert set(rows["problem"]) == {0, 1, 2}
    beyond = rows["excess"] > rows["tolerance"]
    assert not beyond.any()
    assert not rows["kind"].str.startswith("failed").any()
    expected = {
        "exact <= toppra",
        "exact-jerk <= ruckig-search (jerk)",
        "permuting exact",
        "scaling exact-jerk (jerk)",
        "Ruckig by segments = exact-jerk (jerk)",
    }
    assert expected <= set(rows["kind"])
    monkeypatch.setattr(relations, "checked", pytest.fail)
    relations.main(problems=3, output=tmp_path)
    again = pd.read_csv(file)
    pd.testing.assert_frame_equal(again, rows)
    assert capsys.readouterr().out == first


def test_every_second_problem_has_jerk_limits_and_a_third_of_them_lopsided():
    problems = [relations.drawn(seed) for seed in range(12)]
    has_jerk = [problem.has("jerk") for problem in problems]
    assert has_jerk == [False, True] * 6
    lopsided = []
    for problem in problems[1::2]:
        sums = problem.limits.jerk.sum(axis=1)
        lopsided.append(bool(sums.any()))
    assert lopsided == [False, True, False] * 2


def test_symmetries_undone_give_the_problem_back():
    limits = Limits(
        [[-1.0, 2.0], [-3.0, 3.0]], [[-4.0, 5.0], [-6.0, 6.0]], [[-7.0, 8.0], [-9.0, 9.0]]
    )
    waypoints = [[0.0, 0.1], [1.0, -0.2], [0.5, 0.4]]
    problem = Problem(waypoints, limits)
    own = problem.digest()
    scaling, *others = relations.alike(problem, seed=1)
    kind, factor, scaled = scaling
    assert (kind, factor) == ("scaling", 3.7)
    assert scaled.digest() != own
    for place, (_, factor, other) in enumerate(others, start=1):
        _, _, back = relations.alike(other, seed=1)[place]
        assert factor == 1.0
        assert back.digest() == own


def test_failures_are_rows(monkeypatch):
    def broken(*_: object):
        yield "first", np.nan, 1e-6
        raise ArithmeticError("no luck")

    monkeypatch.setattr(relations, "relations", broken)
    rows = relations.checked(0)
    assert list(rows["kind"]) == ["failed: first", "failed: ArithmeticError('no luck')"]
    table = relations.table(rows.assign(problem=0))
    assert table["violations"].tolist() == [1, 1]
