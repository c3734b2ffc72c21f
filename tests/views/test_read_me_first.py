"""Views are functions of a list of trials: tables, figures, a report, exports."""

from __future__ import annotations

import pandas as pd
import pytest

from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import trials_of
from trajopt.planners.registry import load
from trajopt.views import report
from trajopt.views.export import tables
from trajopt.views.figures import draw
from trajopt.views.results import Results


@pytest.fixture(scope="module")
def trials():
    """The exact optimum of a problem, and a planner that is slower."""
    problem = catalogue.load("one-joint")
    exact = trials_of(load("exact"), problem, [0], "exact")
    slow = trials_of(load("unoptimised"), problem, [0], "unoptimised")
    return [*exact, *slow]


def test_a_table_has_a_line_per_problem_and_planner(trials):
    summary = Results(trials).summary().set_index("label")
    gaps = summary["gap"]
    assert gaps["exact"] == pytest.approx(0, abs=1e-6)
    assert gaps["unoptimised"] > 0
    assert set(summary["kind"]) == {"exact"}


def test_figures_are_files_in_a_folder_per_problem(trials, tmp_path):
    files = draw.draw(trials, tmp_path)
    names = [file.relative_to(tmp_path).as_posix() for file in files]
    stems = ("durations", "overlay", "motion-unoptimised")
    assert names == [f"one-joint/{stem}.png" for stem in stems]


def test_a_report_is_one_page_that_opens_offline(trials, tmp_path):
    page = report.write(Results(trials), tmp_path / "report.html")
    html = page.read_text(encoding="utf-8")
    assert html.startswith("<!doctype html>")
    assert "<script src" not in html


def test_an_export_is_what_other_programs_read(trials, tmp_path):
    file = tmp_path / "trials.csv"
    tables.write_csv(Results(trials), file)
    table = pd.read_csv(file)
    assert table["label"].tolist() == ["exact", "unoptimised"]
