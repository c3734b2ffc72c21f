"""Results as a console and a notebook show them."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import matplotlib.image
import pytest
from test_results import OTHER, run

from trajopt import Results
from trajopt.views.figures import plots


@pytest.fixture
def results() -> Results:
    """Medians 20 % and 50 % above the optimum; one planner answers nothing."""
    items = [
        *run("exact", 2.0),
        *run("exact", 4.0, problem=OTHER),
        *run("mine", 2.4, 2.3, 2.6),
        *run("mine", 6.0, problem=OTHER),
        *run("lost", -1, problem=OTHER),
    ]
    marked = [replace(trial, label="a<b") if trial.label == "lost" else trial for trial in items]
    return Results(marked)


def test_the_text_is_a_few_lines(results: Results) -> None:
    counts, short, gaps, uses = repr(results).splitlines()
    assert counts == "Results of 7 trials: 3 planners on 2 problems, 6 solved"
    assert short == "Not run on all problems: a<b (1 of 2). Failed: a<b (1 of 1 runs)."
    assert gaps == "Median gap on the 2 problems that all answer: mine +35.0 % (not compared: a<b)"
    for name in re.findall(r"(\w+)\(\)", uses):
        assert callable(getattr(results, name))
    assert repr(Results([])) == Results([])._repr_html_() == "Results of no trials"


def test_earlier_versions_that_are_left_out_are_counted(results: Results) -> None:
    last, *others = reversed(results.items)
    older = replace(last, options={"old": 1}, started="2020-01-01T00:00:00+00:00")
    counts, *_ = repr(Results([older, last, *others])).splitlines()
    left_out = "Left out, as the planner's code changed since: trials of a<b (1). "
    left_out += "`trajopt diff OLD NEW` compares two versions, a folder each."
    assert counts == f"Results of 7 trials: 3 planners on 2 problems, 6 solved. {left_out}"


def test_the_table_of_a_notebook_has_a_row_per_planner(results: Results) -> None:
    html = results._repr_html_()
    assert "<p>Not run on all problems: a&lt;b (1 of 2). Failed: a&lt;b" in html
    rows = re.findall(r"<tr>\s*<th>(.*?)</th>(.*?)</tr>", html, re.S)
    cells = {label: re.findall(r"<td>(.*?)</td>", rest) for label, rest in rows}
    assert list(cells) == ["exact", "mine", "a&lt;b"]
    assert cells["mine"][:4] == ["2", "4 of 4", "+35.0 %", "+50.0 %"]
    assert cells["a&lt;b"][:4] == ["1", "0 of 1", "none", "–"]


def test_the_table_of_one_problem_has_durations() -> None:
    html = Results([*run("exact", 2.0), *run("mine", 2.4, 2.5, 2.3)])._repr_html_()
    assert "duration (s)" in html
    assert "<td>2.4000</td>" in html
    assert "on one, 4 solved" in html


def test_a_figure_shows_itself() -> None:
    figure = Results([*run("exact", 2.0), *run("mine", 2.4)]).plot()
    assert isinstance(figure, plots.Picture)
    png, size = figure._repr_png_()
    height, width, _ = matplotlib.image.imread(io.BytesIO(png), format="png").shape
    assert abs(width - 2 * size["width"]) <= 1
    assert abs(height - 2 * size["height"]) <= 1
