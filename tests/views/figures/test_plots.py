"""Figures show the numbers they were given: data, limits and signs, never pixels."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from contextlib import AbstractContextManager
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from numpy import nan
from pictures import motion_of, overlaps, texts

from trajopt.benchmark.suites import catalogue as suite
from trajopt.planners.registry import load
from trajopt.views.figures import explanation, motions, plots, sampling, style

LONG = "issa:fitness=scaled,timing=per-joint"


def line(label, low=nan, q1=nan, median=nan, q3=nan, high=nan, **others):
    """A planner's line: its range, quartiles and median in order, and what else is known."""
    durations = {"min": low, "q1": q1, "median": median, "q3": q3, "max": high}
    reference = {"kind": "exact", "reference": 1.5}
    counts = {"runs": 1, "solved": 1, "status": "solved", "lower_bound": nan}
    known = durations | reference | counts | others
    return SimpleNamespace(label=label, **known)


def changed(row, **changes):
    return SimpleNamespace(**(vars(row) | changes))


MANY = line(LONG, 4.0, 4.25, 4.5, 5.0, 6.0, gap=2.0, runs=30, solved=30)


def table(**changes):
    """A made-up summary: exact, a stochastic planner, and one without a certified duration."""
    lines = [
        line("unsupporting", solved=0, status="unsupported"),
        MANY,
        line("exact", *[1.5] * 5, gap=0.0),
    ]
    return [changed(own, **changes) for own in lines]


def test_an_overlap_would_be_seen() -> None:
    figure = plots.durations(table())
    figure.text(0.1, 0.02, "over the legend " * 9)
    assert overlaps(figure) != []


def test_dots_are_the_medians_the_shortest_first() -> None:
    axes = plots.durations(table(), "t").axes[0]
    assert sorted(line.get_xydata().tolist() for line in axes.lines) == [[[1.5, 0]], [[4.5, 1]]]
    labels = [t.get_text() for t in axes.get_yticklabels()]
    assert [label.replace("\n", "") for label in labels] == ["exact", LONG, "unsupporting"]


def test_whiskers_are_quartiles_and_range() -> None:
    axes = plots.durations(table()).axes[0]
    drawn = [s.tolist() for c in axes.collections for s in c.get_segments()]  # type: ignore[attr-defined]
    assert [[4.0, 1.0], [6.0, 1.0]] in drawn
    assert [[4.25, 1.0], [5.0, 1.0]] in drawn


def test_gaps_keep_their_sign_and_status_is_said() -> None:
    first, many, exact = table()
    shown = texts(plots.durations([first, many, changed(exact, gap=-0.0123)]))
    assert {"+200.0 %", "−1.23 %", "unsupported"} <= set(shown)
    assert style.percent(1.9048) == "+190.5 %"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("exact", "exact optimum"),
        ("refined", "refined optimum"),
        ("relaxed", "relaxed optimum"),
        ("lower bound", "lower bound"),
    ],
)
def test_the_reference_is_a_line_and_named_for_what_it_is(kind: str, words: str) -> None:
    figure = plots.durations(table(kind=kind))
    assert f"{words} 1.500 s" in texts(figure)
    (line,) = [c for c in figure.axes[0].collections if str(c.get_label()).startswith(words)]
    assert line.get_segments()[0][:, 0].tolist() == [1.5, 1.5]  # type: ignore[attr-defined]


def test_without_reference_or_durations() -> None:
    nothing = table(gap=np.nan, kind=None, reference=np.nan)
    assert "gap" not in texts(plots.durations(nothing))
    bounded = table(lower_bound=1.25)[:1]
    assert "unsupported (lower bound 1.250 s)" in texts(plots.durations(bounded))


@pytest.mark.parametrize("planners", [1, 15])
def test_no_text_overlaps(planners: int) -> None:
    labels = [f"{LONG},evaluations={10**k}" for k in range(planners)]
    summary = [changed(MANY, label=label, solved=20) for label in labels]
    assert overlaps(plots.durations(summary, "problem")) == []
    gaps = dict.fromkeys(labels, np.array([0.5, 0.7, 1.9]))
    assert overlaps(plots.gap_distribution(gaps, "problem")) == []
    curve = sampling.over_runs([np.array([[1, np.nan], [10, 6.0], [3000, 4.4]])])
    assert overlaps(plots.convergence(dict.fromkeys(labels, curve), 4.3, "problem")) == []


def test_jumps_are_vertical() -> None:
    time, acceleration = sampling.curve(motion_of(1)[1], 2)
    assert time.tolist() == [0, 1, 1, 2]
    assert acceleration[:, 0].tolist() == [1, 1, -1, -1]


def test_curves_are_the_trajectory_itself() -> None:
    trajectory = load("unoptimised").solve(suite.load("six-axis")).trajectory
    assert trajectory is not None
    time, values = sampling.curve(trajectory, 1)
    inside = ~np.isin(time, trajectory.breaks)
    np.testing.assert_allclose(values[inside], trajectory(time[inside], 1), atol=1e-12)


def test_quartiles_over_seeds_count_runs_without_a_candidate_as_infinite() -> None:
    rng = np.random.default_rng(0)
    runs = []
    for first in (1, 3, 40, 700, 5):
        spent = np.unique(np.r_[first, rng.integers(first, 1000, 20), 1000])
        best = np.sort(rng.uniform(4, 9, len(spent)))[::-1]
        best[0] = np.nan
        runs.append(np.column_stack([spent, best]))
    evaluations, quartiles = sampling.over_runs(runs)
    for n, drawn in zip(evaluations, quartiles.T, strict=True):
        now = [next((b for e, b in run[::-1] if e <= n), np.nan) for run in runs]
        ranked = sorted(np.nan_to_num(now, nan=np.inf))  # of five: the 2nd, 3rd and 4th
        np.testing.assert_array_equal(drawn, ranked[1:4])
    assert quartiles[1, 0] == np.inf
    assert np.isfinite(quartiles[:, -1]).all()


def test_the_median_of_an_even_number_needs_one_more_than_half() -> None:
    runs = [np.array([[k, 5.0 + k], [8, 5.0 + k]]) for k in (1, 2, 4, 8)]
    evaluations, quartiles = sampling.over_runs(runs)
    assert (quartiles[1, evaluations < 4] == np.inf).all()
    assert quartiles[1, -1] == np.median([6, 7, 9, 13])


def test_convergence_draws_the_median_and_the_best_353() -> None:
    runs = [
        np.array([[1, np.nan], [2, 6.0], [100, 5.0]]),
        np.array([[1, 8.0], [50, 4.0], [100, 4.0]]),
    ]
    figure = plots.convergence({"pso": sampling.over_runs(runs)}, 4.0)
    curve, line = figure.axes[0].lines
    evaluations, quartiles = sampling.over_runs(runs)
    np.testing.assert_array_equal(curve.get_xydata(), np.column_stack([evaluations, quartiles[1]]))
    assert list(line.get_ydata()) == [4.0, 4.0]
    assert curve.get_drawstyle() == "steps-post"
    assert figure.axes[1].lines[0].get_ydata()[-1] == pytest.approx(12.5)
    assert len(plots.convergence({"pso": sampling.over_runs(runs)}).axes) == 1


def test_gap_distribution_shows_every_run_and_those_that_ran_once() -> None:
    runs = {"pso": [0.3, 0.1, 0.2, np.nan], "near": [0.15], "far": [5.0]}
    figure = plots.gap_distribution({label: np.array(gaps) for label, gaps in runs.items()})
    left, right = figure.axes
    (dots,) = [line for line in left.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(dots.get_xdata(), [10, 20, 30])
    (above,) = [line for line in right.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(above.get_xdata(), [style.GAP_FLOOR, 10, 20])
    assert "near" in texts(figure)
    assert "far" not in texts(figure)


def test_saved_files_are_whole_and_always_the_same(tmp_path: Path) -> None:
    before = dict(matplotlib.rcParams)
    for name in ("one", "two"):
        png, svg = plots.save(plots.durations(table()), tmp_path / f"{name}.v1")
        assert png.read_bytes().startswith(b"\x89PNG\r\n")
        root = ElementTree.fromstring(svg.read_text(encoding="utf-8"))
        assert "+200.0 %" in "".join(root.itertext())
    for suffix in ("png", "svg"):
        one, two = (tmp_path / f"{n}.v1.{suffix}" for n in ("one", "two"))
        assert one.read_bytes() == two.read_bytes()
    assert before == dict(matplotlib.rcParams)


NAMES = (r"a$b$\frac_{x}^2", "$", "$$", "<b>&amp;", "_hidden", "50 %", r"\$x\$")


def test_names_are_drawn_as_they_are_written(tmp_path: Path) -> None:
    """Each as a label of a row, a curve or a panel, and all of them in a title."""
    rows = [changed(MANY, label=name) for name in NAMES]
    runs = dict.fromkeys(NAMES, sampling.over_runs([np.array([[1, 6.0], [100, 5.0]])]))
    gaps = dict.fromkeys(NAMES, np.array([0.1, 0.2]))
    few = NAMES[:3]  # a panel each
    climbs = [(name, [("optimum", 1.0), ("route", 2.0)]) for name in few]
    title = " ".join(NAMES)
    made = {
        "durations": plots.durations(rows, title),
        "convergence": plots.convergence(runs, 4.0, title),
        "gaps": plots.gap_distribution(gaps, title),
        "waterfall": explanation.waterfalls(climbs),
        "motion": motions.motion(*motion_of(1), title=title),
        "use": explanation.limit_use(*motion_of(1), title=title),
    }
    for stem, figure in made.items():
        file = tmp_path / f"{stem}.svg"
        with style_of_the_files():
            figure.savefig(file)
        root = ElementTree.fromstring(file.read_text(encoding="utf-8"))
        drawn = [(t.text or "").strip(style.ZERO_WIDTH_SPACE) for t in root.iter() if t.text]
        if stem not in ("motion", "use"):
            names = few if stem == "waterfall" else NAMES
            assert [drawn.count(name) for name in names] == [1] * len(names)
        if stem not in ("waterfall", "use"):
            assert drawn.count(title) == 1
        if stem == "use":  # whose title is wrapped
            assert all(word in " ".join(drawn) for word in title.split())


def style_of_the_files() -> AbstractContextManager[None]:
    return matplotlib.rc_context(style.STYLE_SHEET)


def test_what_cannot_be_printed_is_a_space_and_what_is_too_long_is_cut(tmp_path: Path) -> None:
    assert style.text("a\nb\t c\x1b[31m\ud800d\u202e") == "a b c [31m d"
    assert style.headline("p", ", 1 s") == "p, 1 s"
    assert len(style.headline("p" * 500, ", 1.234 s")) == style.TITLE_LENGTH
    figure = motions.motion(*motion_of(2), title=style.headline("n" * 500, ", 1.234 s"))
    FigureCanvasAgg(figure).draw()
    found = figure.findobj(Text)
    (title,) = (t for t in found if isinstance(t, Text) and t.get_text().startswith("n"))
    assert title.get_window_extent().x1 <= figure.bbox.x1
    plots.save(plots.durations(table(label="机器人"), "机器人"), tmp_path / "glyphs")
