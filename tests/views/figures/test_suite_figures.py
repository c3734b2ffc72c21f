"""Figures of a suite: their curves by hand, their size and fonts as a journal prints them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from trajopt import (
    InvalidInput,
    Limits,
    Problem,
    Relation,
    Results,
    Solution,
    Status,
    Trajectory,
)
from trajopt.benchmark.trial import Trial, trials_of
from trajopt.planners.planner import Planner
from trajopt.views.analysis.curves import GAP_FLOOR, anytime, gap_shares, profile
from trajopt.views.figures import draw, plots, suite
from trajopt.views.figures.sampling import bounded

COLUMN_IN = 3.5
SMALLEST_FONT_PT = 7


class Searching(Planner):
    """A quintic in the given time, found after 10 evaluations of another in twice the time."""

    def __init__(self, duration: float) -> None:
        self.duration = duration

    def options(self) -> dict[str, object]:
        return {}

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        t = self.duration + 0.01 * seed
        h = problem.displacements[0, 0]
        c = [6 * h / t**5, -15 * h / t**4, 10 * h / t**3, 0, 0, problem.waypoints[0, 0]]
        history = np.array([[10.0, 2 * t], [100.0, t]])
        trajectory = Trajectory([0, t], np.reshape(c, (6, 1, 1)), [0, t])
        return Solution(Status.SOLVED, trajectory, evaluations=100, history=history)


def trials() -> list[Trial]:
    limits = Limits([10.0], [100.0])
    found = []
    for number in range(3):
        problem = Problem([[0.0], [1.0 + number]], limits, f"problem {number}")
        for name, duration, seeds in (("exact", 2.0, 1), ("a_b", 2.2, 3), ("slow$", 3.0, 3)):
            found += trials_of(Searching(duration), problem, range(seeds), name)
    return found


@pytest.fixture(scope="module")
def results() -> Results:
    return Results(trials())


def test_a_profile_steps_at_the_ratios() -> None:
    durations = pd.DataFrame({"a": [1.0, 2.0], "b": [2.0, np.inf]})
    curves = profile(durations)
    x, y = curves["a"]
    assert (x[0], set(y)) == (1.0, {1.0})
    x, y = curves["b"]
    assert set(y[x < 2]) == {0.0}
    assert set(y[x >= 2]) == {0.5}  # half of the problems within twice the best
    assert profile(durations[[]]) == {}


def test_all_shares_are_of_the_same_problems() -> None:
    """`b` refuses the second problem: it climbs to half of them, not to all of its own."""
    durations = pd.DataFrame({"a": [1.0, 2.0], "b": [2.0, np.nan]})
    assert set(profile(durations)["b"][1]) == {0.0, 0.5}
    assert set(profile(durations, pd.Series([0.5, 2.0]))["a"][1]) == {0.5, 1.0}


class Relaxing(Searching):
    """Ignores a velocity limit on the problems of displacement 2, and says so."""

    def relation(self, problem: Problem) -> Relation:
        return Relation.RELAXATION

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        found = super().solve(problem, seed=seed)
        if problem.displacements[0, 0] != 2:
            return found
        trajectory = found.trajectory
        assert trajectory is not None
        jumping = Trajectory([0, 0.1], [[[20.0]], [[0.0]]], [0, 0.1])
        return replace(found, status=Status.RELAXED, trajectory=jumping, history=None)


def test_the_shortest_of_all_answers_counts_and_the_table_s_problems() -> None:
    """By hand: 2.2 s, 2.2 s and 2.2 s beside 2 s on one problem, and beside 3 s, invalid on one."""
    limits = Limits([10.0], [100.0])
    found = []
    for number in range(3):
        problem = Problem([[0.0], [1.0 + number]], limits, f"problem {number}")
        found += trials_of(Searching(2.2), problem, [0], "everywhere")
        found += trials_of(Relaxing(3.0), problem, [0], "relaxing")
        if number == 0:
            found += trials_of(Searching(2.0), problem, [0], "once")
    results = Results(found)
    table = results.planners()
    assert table.loc["relaxing", ["failed", "solved"]].tolist() == [1, 2]
    figure = dict(draw.of_suite(results))["profile"]()
    lines = {line.get_label(): line.get_xydata() for line in figure.axes[0].lines}
    assert set(lines) == {"everywhere", "relaxing"}
    x, y = lines["everywhere"].T
    assert y[0] == pytest.approx(2 / 3)
    assert x[np.argmax(y == 1)] == pytest.approx(2.2 / 2, rel=0.01)
    x, y = lines["relaxing"].T
    assert sorted(set(y)) == pytest.approx([0, 1 / 3, 2 / 3])
    assert x[np.argmax(y > 0)] == pytest.approx(3 / 2.2, rel=0.01)
    assert x[np.argmax(y > 0.5)] == pytest.approx(3 / 2, rel=0.01)


def test_a_planner_that_answers_once_is_a_point_among_the_searches() -> None:
    once = [np.array([[seconds, 1.0]]) for seconds in (0.1, 0.3, 0.2)]
    runs = [np.array([[1.0, 1.5], [10.0, 1.1]])]
    curves = anytime({"once": once, "search": runs})
    spent, quartiles = curves["once"]
    assert spent.tolist() == [0.2]
    assert quartiles.tolist() == [[0.0]] * 3
    assert len(curves["search"][0]) > 1
    drawn = colours(suite.anytime(curves, ["once", "search"], "seconds"))
    assert set(drawn) == {"once", "search"}


def test_shares_count_each_problem_once() -> None:
    rows = [("p", 0.01), ("p", 0.03), ("q", np.nan), ("r", 0.0)]
    gaps = pd.DataFrame(rows, columns=["digest", "gap"]).assign(label="a", reference=1.0)
    x, y = gap_shares(gaps, ["a"])["a"]
    assert y[0] == pytest.approx(1 / 3)  # one of three problems is within GAP_FLOOR
    assert x[0] == pytest.approx(GAP_FLOOR)
    assert set(np.round(y[(x > 1) & (x < 3)], 9)) == {0.5}  # half of p's runs too
    assert y[-1] == pytest.approx(2 / 3)
    assert x[-1] == pytest.approx(1.1 * 3)  # beyond the worst gap, in percent


def test_anytime_curves_are_quartiles_of_the_gap() -> None:
    runs = [np.array([[1.0, np.nan], [4.0, 1.5], [10.0, factor]]) for factor in (1.0, 1.1, 1.3)]
    spent, quartiles = anytime({"a": runs})["a"]
    assert np.isinf(quartiles[:, spent < 4]).all()
    middle = quartiles[1]
    assert middle[(spent >= 4) & (spent < 10)] == pytest.approx(50.0)
    assert middle[-1] == pytest.approx(10.0)


def test_the_figures_fit_a_column(results: Results) -> None:
    figures = {name: picture() for name, picture in draw.of_suite(results)}
    assert list(figures) == ["profile", "gaps", "anytime-seconds", "anytime-evaluations"]
    for figure in figures.values():
        width, height = figure.get_size_inches()
        assert width == COLUMN_IN
        assert height < 4
        sizes = [text.get_fontsize() for text in figure.findobj(Text) if text.get_text()]
        assert min(sizes) >= SMALLEST_FONT_PT
        figure.draw_without_rendering()
        drawn = figure.get_tightbbox()  # inches
        assert min(drawn.x0, drawn.y0) >= -0.01
        assert drawn.x1 <= width + 0.01
        assert drawn.y1 <= height + 0.01


def colours(figure: Figure) -> dict[str, str]:
    handles, labels = figure.axes[0].get_legend_handles_labels()
    return {label: line.get_color() for label, line in zip(labels, handles, strict=True)}


def test_a_planner_looks_the_same_in_every_figure(results: Results) -> None:
    first, *others = (colours(picture()) for _, picture in draw.of_suite(results))
    assert len(set(first.values())) == 3
    for other in others:
        assert other.items() <= first.items()


def test_the_convergence_of_a_search_has_the_colour_that_it_has_in_a_suite() -> None:
    curve = (np.array([10.0, 20.0]), np.array([[4.0, 3.9], [4.5, 4.4], [5.0, 4.9]]))
    order = ["a", "exact", "pso", "ssa"]
    steps = {label: (np.array([1.0, 2.0]), np.array([0.5, 1.0])) for label in order}
    suite_colours = colours(suite.profile(steps, order))
    searches = {"ssa": curve, "pso": curve}
    own = colours(plots.convergence(searches, order=order))
    assert own == {label: suite_colours[label] for label in searches}


def test_the_reader_s_own_style_counts(results: Results) -> None:
    with matplotlib.rc_context({"font.size": 11, "axes.labelsize": 12.0}):
        label = results.plot().axes[0].xaxis.label
        assert label.get_fontsize() == 12
    assert results.plot().axes[0].xaxis.label.get_fontsize() == 8
    assert matplotlib.rcParams["font.size"] == matplotlib.rcParamsDefault["font.size"]


def test_a_pdf_embeds_its_fonts_and_holds_no_pixels(results: Results, tmp_path: Path) -> None:
    draw.write(results, tmp_path, "pdf", each_problem=False)
    for name in ("profile", "gaps", "anytime-seconds", "anytime-evaluations"):
        content = (tmp_path / f"{name}.pdf").read_bytes()
        assert re.search(rb"/MediaBox \[ 0 0 252 ", content)  # points: 3.5 in
        fonts = re.findall(rb"/BaseFont /([\w-]+)", content)
        assert fonts
        assert len(re.findall(rb"/FontFile2 \d+ 0 R", content)) >= len(set(fonts)) / 2
        assert b"/Subtype /Image" not in content
    draw.write(results, tmp_path, "svg", each_problem=False)
    drawn = (tmp_path / "profile.svg").read_text(encoding="utf-8")
    assert "<image" not in drawn
    assert "a_b" in drawn


def test_plot_draws_a_suite(results: Results) -> None:
    profile_label = results.plot().axes[0].get_xlabel()
    assert profile_label == "certified duration / shortest of all planners"
    assert results.plot(kind="anytime-evaluations").axes[0].get_xlabel() == "evaluations spent"
    assert results.plot("problem 1").axes[0].get_title() == "problem 1"
    with pytest.raises(InvalidInput, match="one of profile, gaps, anytime-seconds"):
        results.plot(kind="pie")
    with pytest.raises(InvalidInput, match="one of problem 0, problem 1"):
        results.plot("problem 7")


def test_a_band_is_endless_where_a_quarter_of_the_runs_has_no_answer() -> None:
    """Two of three runs answer: the median does too, and the upper quartile is infinite."""
    never = np.array([[1.0, np.nan], [10.0, np.nan]])
    runs = [never, np.array([[1.0, 1.2]]), np.array([[1.0, 1.3]])]
    curves = anytime({"a": runs, "b": [np.array([[1.0, 6.0]])]})
    _, (low, middle, high) = bounded(curves)["a"]
    assert middle == pytest.approx(30.0)
    assert low == pytest.approx(25.0)
    assert high == pytest.approx(500.0)  # the largest of all curves
    _, unanswered = bounded(
        {"a": curves["a"], "never": (np.array([1.0]), np.full((3, 1), np.inf))}
    )["never"]
    assert np.isinf(unanswered).all()
    figure = suite.anytime(curves, ["a", "b"], "seconds")
    band, _ = figure.axes[0].collections
    assert band.get_datalim(figure.axes[0].transData).y1 == pytest.approx(500.0)
