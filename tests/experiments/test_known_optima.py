"""Known optima: what the experiment draws has the optimum that it says."""

from __future__ import annotations

import numpy as np
import pytest

from experiments import known_optima


@pytest.mark.parametrize("seed", range(4))
def test_the_tightest_joint_alone_bounds_a_straight_line(seed):
    problem = known_optima.line(np.random.default_rng(seed))
    steps = np.diff(problem.waypoints, axis=0)
    assert np.linalg.matrix_rank(steps, tol=1e-9) == 1
    share = np.abs(steps[0] / steps[0, 0])
    for limits in problem.limits.by_name().values():
        if np.isfinite(limits).all():
            tightest = np.abs(limits) / share[:, None]
            assert (np.sort(tightest)[1:] >= np.sort(tightest)[0] * (1 - 1e-12)).all()


@pytest.mark.long
def test_the_quick_look_finds_nothing_beyond_tolerance(tmp_path, capsys):
    known_optima.main(0.004, tmp_path)
    assert "two waypoints" in capsys.readouterr().out
    rows = known_optima.counted(known_optima.pd.read_csv(tmp_path / "problems.csv"))
    assert rows["problems"].tolist() == [2, 2, 4, 1, 1, 1]
    assert rows["beyond tolerance"].sum() == 0
    assert rows["latest"].max() < 1e-9
    assert rows["brief"].sum() == 0


def test_a_problem_without_an_answer_is_beyond_tolerance():
    columns = ["claimed", "certified", "late", "pieces", "brief", "needless"]
    unknown = {column: [np.nan] for column in columns}
    rows = known_optima.pd.DataFrame({"kind": ["straight"], "seed": [0], **unknown})
    assert known_optima.counted(rows)["beyond tolerance"].tolist() == [1]


@pytest.mark.parametrize("kind", ["suites", "suites without jerk limits"])
def test_every_suite_problem_is_asked(kind):
    asked = known_optima.suites(jerk=kind == "suites")
    number, _ = known_optima.KINDS[kind]
    assert len(asked) == number
    assert all(known_optima.record(problem).duration > 0 for problem in asked)
