"""Two results against each other, and several put together."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from test_results import OTHER, PROBLEM, THIRD, run

from trajopt import Results, StoreError
from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.trial import Trial
from trajopt.cli import main
from trajopt.views.analysis.changes import by_planner, changes

RUNS = (2.0, 2.1, 2.2, 2.3, 2.4)
LONGER = (2.5, 2.6, 2.7, 2.8, 2.9)
SAME = (2.4, 2.3, 2.2, 2.1, 2.0)


def sides() -> tuple[Results, Results]:
    """`slower` got longer in every run, `luck` in none, `fixed` by 1e-5, `still` by 1e-9."""
    old = [*run("slower", *RUNS), *run("luck", *RUNS), *run("fixed", 3.0), *run("still", 3.0)]
    new = [*run("slower", *LONGER), *run("luck", *SAME)]
    new += [*run("fixed", 3.0 * (1 + 1e-5)), *run("still", 3.0 * (1 + 1e-9))]
    return Results([*old, *run("gone", 2.0)]), Results([*new, *run("come", 2.0)])


def test_a_median_moves_by_a_test_or_without_chance() -> None:
    table = changes(*sides()).set_index("label")
    assert table["moved"].to_dict() == {
        "fixed": True,
        "luck": False,
        "slower": True,
        "still": False,
    }
    assert table.loc["slower", ["old", "new", "runs"]].tolist() == [2.2, 2.7, 5]
    assert table.loc["slower", "ratio"] == pytest.approx(2.7 / 2.2)
    exact = stats.mannwhitneyu(LONGER, RUNS, method="exact").pvalue
    assert table.loc["slower", "pvalue"] == pytest.approx(exact) == pytest.approx(2 / 252)
    assert table.loc["slower", "holm"] == pytest.approx(4 / 252)  # of two tests
    assert np.isnan(table.loc["fixed", "pvalue"])


def test_a_lost_answer_is_longer_than_any() -> None:
    old = Results(run("mine", 2.0))
    new = Results(run("mine", -1))
    (row,) = changes(old, new).itertuples()
    assert (row.new, row.ratio, row.moved) == (np.inf, np.inf, True)
    (both,) = changes(new, new).itertuples()
    assert (both.ratio, both.moved) == (1.0, False)


def test_a_planner_is_tested_over_the_problems() -> None:
    problems = (PROBLEM, OTHER, THIRD)
    old = Results([t for problem in problems for t in run("mine", 3.0, problem=problem)])
    new = Results([t for problem in problems for t in run("mine", 2.7, problem=problem)])
    row = by_planner(old, new).loc["mine"]
    assert row[["problems", "better", "tied", "worse"]].tolist() == [3, 3, 0, 0]
    assert row["ratio"] == pytest.approx(0.9)
    assert row["pvalue"] == 1.0  # the three share their limits: one group, whose sign is a coin


def stored(folder: Path, trials: list[Trial]) -> Path:
    Store(folder).write_all(trials)
    Store(folder).consolidate()
    return folder


def test_results_of_two_folders_are_put_together(tmp_path: Path) -> None:
    first = stored(tmp_path / "a", [*run("exact", 2.0), *run("mine", 3.0)])
    second = stored(tmp_path / "b", [*run("exact", 2.0), *run("yours", 2.5)])
    both = Results.of(first, second / "results.h5")
    assert both.planners()["gap"].to_dict() == pytest.approx(
        {"exact": 0.0, "yours": 0.25, "mine": 0.5}
    )
    assert len(Results.of(first, first).items) == 2
    with pytest.raises(StoreError, match="nothing"):
        Results.of(first, tmp_path / "nothing")


def said(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    shown = capsys.readouterr()
    return ended.value.code, shown.out, shown.err


def test_the_command_shows_what_moved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    old, new = sides()
    a = stored(tmp_path / "a", [*old.items, *run("slower", *RUNS, problem=OTHER)])
    b = stored(tmp_path / "b", [*new.items, *run("slower", *SAME, problem=OTHER)])
    code, out, _ = said(capsys, "diff", a, b)
    moved, summary = out.split("medians moved.")
    assert code == 1
    assert moved.rstrip().endswith("2 of 5")
    assert "+22.7" in moved
    assert "luck" not in moved
    assert "Largest difference: +22.7 %, slower on" in summary.replace("\n", " ")
    assert f"Only in {a}: gone." in summary.replace("\n", "")
    code, out, _ = said(capsys, "diff", a, a)
    assert code == 0
    assert "0 of 6 medians moved. A median" in out
    other = stored(tmp_path / "c", [*run("else", 1.0)])
    code, _, err = said(capsys, "diff", a, other)
    assert (code, err.count("\n")) == (2, 1)
    assert "a problem and planner that" in err


def test_one_report_of_two_folders(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    stored(tmp_path / "a", [*run("exact", 2.0)])
    stored(tmp_path / "b", [*run("mine", 2.5)])
    code, out, _ = said(capsys, "report", "a", "b")
    assert (code, "report: report.html" in out, "2 trials" in out) == (0, True, True)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert ">exact<" in page
    assert ">mine<" in page
    assert said(capsys, "report", "a", "b", "--out", "both.html")[0] == 0
    assert (tmp_path / "both.html").is_file()
    assert said(capsys, "report", "a")[0] == 0
    assert (tmp_path / "a" / "report.html").is_file()


@pytest.mark.long
def test_the_memory_of_many_runs_grows_as_their_number() -> None:
    """Two runs each with every other would be 16 times the rows of four times the runs."""
    peaks = []
    for count in (75, 300):
        one = Results(run("mine", *np.linspace(2.0, 3.0, count)))
        one.trials()
        tracemalloc.start()
        changes(one, one)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 5 * peaks[0]
