"""Figures show the numbers they were given: data, limits and signs, never pixels."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from numpy import inf, nan
from pictures import motion_of, overlaps, texts

from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import load
from trajopt.views import table_cells
from trajopt.views.analysis.curves import GAP_FLOOR
from trajopt.views.figures import explanation, motions, plots, sampling, style

LONG = "issa:fitness=scaled,timing=per-joint"
NAMES = (r"a$b$\frac_{x}^2", "$", "$$", "<b>&amp;", "_hidden", "50 %", r"\$x\$")


def line(label, low=nan, q1=nan, median=nan, q3=nan, high=nan, **others):
    """A planner's line: its range, quartiles and median in order, and what else is known."""
    known = {
        "min": low,
        "q1": q1,
        "median": median,
        "q3": q3,
        "max": high,
        "kind": "exact",
        "reference": 1.5,
        "lower_bound": nan,
        "dilation": nan,
        "runs": 1,
        "solved": 1,
        "status": "solved",
    }
    return SimpleNamespace(label=label, **(known | others))


def stochastic(label, solved=30):
    return line(label, 4.0, 4.25, 4.5, 5.0, 6.0, gap=2.0, runs=30, solved=solved)


def table(**changes):
    """A made-up summary: exact, a stochastic planner, and one without a certified duration."""
    rows = [
        line("unsupporting", solved=0, status="unsupported"),
        stochastic(LONG),
        line("exact", 1.5, 1.5, 1.5, 1.5, 1.5, gap=0.0),
    ]
    for row in rows:
        vars(row).update(changes)
    return rows


def a_run(*rows):
    return np.array(rows, dtype=float)


def test_an_overlap_would_be_seen():
    figure = plots.durations(table())
    figure.text(0.1, 0.02, "over the legend " * 9)
    assert overlaps(figure) != []


def test_dots_are_the_medians_the_shortest_first():
    axes = plots.durations(table(), "t").axes[0]
    dots = [dot.get_xydata().tolist() for dot in axes.lines if len(dot.get_xydata())]
    assert sorted(dots) == [[[1.5, 0]], [[4.5, 1]]]
    labels = []
    for label in axes.get_yticklabels():
        words = label.get_text()
        labels.append(words.replace("\n", ""))
    assert labels == ["exact", LONG, "unsupporting"]


def test_whiskers_are_quartiles_and_range():
    axes = plots.durations(table()).axes[0]
    drawn = []
    for lines in axes.collections:
        drawn += [segment.tolist() for segment in lines.get_segments()]
    assert [[4.0, 1.0], [6.0, 1.0]] in drawn
    assert [[4.25, 1.0], [5.0, 1.0]] in drawn


def test_gaps_keep_their_sign_and_status_is_said():
    rows = table()
    rows[-1].gap = -0.0123
    shown = set(texts(plots.durations(rows)))
    assert {"+200.0 %", "−1.23 %", "unsupported"} <= shown
    assert table_cells.percent(1.9048) == "+190.5 %"


def test_a_gap_that_rounds_to_zero_has_no_minus():
    assert table_cells.percent(-4.9e-5) == table_cells.percent(4.9e-5) == "0.00 %"
    assert table_cells.percent(-5.1e-5) == "−0.01 %"
    assert table_cells.gap(-4.9e-5) == table_cells.gap(4.9e-5) == "+0.00"
    assert table_cells.gap(-5.1e-5) == "-0.01"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("exact", "exact optimum"),
        ("refined", "refined optimum"),
        ("relaxed", "relaxed optimum"),
        ("lower bound", "lower bound"),
    ],
)
def test_the_reference_is_a_line_and_named_for_what_it_is(kind, words):
    figure = plots.durations(table(kind=kind))
    name = f"{words} 1.500 s"
    assert name in texts(figure)
    lines = figure.axes[0].collections
    (reference,) = [own for own in lines if own.get_label() == name]
    (segment,) = reference.get_segments()
    assert segment[:, 0].tolist() == [1.5, 1.5]


def test_without_reference_there_are_no_gaps():
    unknown = table(gap=nan, kind=None, reference=nan)
    assert "gap" not in texts(plots.durations(unknown))


def test_without_durations_there_are_bounds():
    bounded = table(lower_bound=1.25)[:1]
    figure = plots.durations(bounded)
    assert "unsupported (lower bound 1.250 s)" in texts(figure)


@pytest.fixture(params=[1, 15])
def labels(request):
    """Long labels of few or many planners."""
    return [f"{LONG},evaluations={10**power}" for power in range(request.param)]


def test_no_text_overlaps_in_durations(labels):
    rows = [stochastic(label, solved=20) for label in labels]
    assert overlaps(plots.durations(rows, "problem")) == []


def test_no_text_overlaps_in_gaps(labels):
    gaps = dict.fromkeys(labels, np.array([0.5, 0.7, 1.9]))
    assert overlaps(plots.gap_distribution(gaps, "problem")) == []


def test_no_text_overlaps_in_convergence(labels):
    run = a_run([1, nan], [10, 6.0], [3000, 4.4])
    curves = dict.fromkeys(labels, sampling.over_runs([run]))
    assert overlaps(plots.convergence(curves, 4.3, "problem")) == []


def test_jumps_are_vertical():
    _, trajectory = motion_of(1)
    time, acceleration = sampling.curve(trajectory, 2)
    assert time.tolist() == [0, 1, 1, 2]
    assert acceleration[:, 0].tolist() == [1, 1, -1, -1]


def test_curves_are_the_trajectory_itself():
    problem = catalogue.load("six-axis")
    trajectory = load("unoptimised").solve(problem).trajectory
    time, values = sampling.curve(trajectory, 1)
    inside = ~np.isin(time, trajectory.breaks)
    expected = trajectory(time[inside], 1)
    np.testing.assert_allclose(values[inside], expected, atol=1e-12)


def best_within(run, budget):
    """The last best of a run within a budget of evaluations; +inf without one."""
    best = inf
    for spent, value in run:
        if spent <= budget and not np.isnan(value):
            best = value
    return best


def test_quartiles_over_seeds_count_runs_without_a_candidate_as_infinite():
    rng = np.random.default_rng(0)
    runs = []
    for first in (1, 3, 40, 700, 5):
        later = rng.integers(first, 1000, 20)
        spent = np.unique([first, *later, 1000])
        best = np.sort(rng.uniform(4, 9, spent.size))[::-1]
        best[0] = nan
        runs.append(np.column_stack([spent, best]))
    evaluations, quartiles = sampling.over_runs(runs)
    for budget, drawn in zip(evaluations, quartiles.T, strict=True):
        ranked = sorted(best_within(run, budget) for run in runs)
        np.testing.assert_array_equal(drawn, ranked[1:4])  # of five: the 2nd, 3rd and 4th
    assert quartiles[1, 0] == inf
    assert np.isfinite(quartiles[:, -1]).all()


@pytest.fixture
def curve():
    """Quartiles of two runs, the better one ending at 4 s."""
    first = a_run([1, nan], [2, 6.0], [100, 5.0])
    second = a_run([1, 8.0], [50, 4.0], [100, 4.0])
    return sampling.over_runs([first, second])


def test_convergence_draws_the_median_and_the_best_353(curve):
    figure = plots.convergence({"pso": curve}, 4.0)
    above, below = figure.axes
    median, best = above.lines
    evaluations, quartiles = curve
    expected = np.column_stack([evaluations, quartiles[1]])
    np.testing.assert_array_equal(median.get_xydata(), expected)
    assert median.get_drawstyle() == "steps-post"
    assert list(best.get_ydata()) == [4.0, 4.0]
    excess = below.lines[0].get_ydata()
    assert excess[-1] == pytest.approx(12.5)


def test_convergence_without_the_best_353_has_one_panel(curve):
    figure = plots.convergence({"pso": curve})
    assert len(figure.axes) == 1


def dots(axes):
    """The horizontal places of the dots of a panel."""
    (drawn,) = [own for own in axes.lines if own.get_marker() == "o"]
    return drawn.get_xdata()


def test_gap_distribution_shows_every_run_and_those_that_ran_once():
    runs = {"pso": np.array([0.3, 0.1, 0.2, nan]), "near": np.array([0.15]), "far": np.array([5.0])}
    figure = plots.gap_distribution(runs)
    left, right = figure.axes
    np.testing.assert_allclose(dots(left), [10, 20, 30])
    np.testing.assert_allclose(dots(right), [GAP_FLOOR, 10, 20])
    shown = texts(figure)
    assert "near" in shown
    assert "far" not in shown


def test_saved_files_are_whole_and_always_the_same(tmp_path):
    before = dict(matplotlib.rcParams)
    contents = []
    for name in ("one", "two"):
        files = plots.save(plots.durations(table()), tmp_path / f"{name}.v1")
        contents.append([file.read_bytes() for file in files])
    first, second = contents
    assert first == second
    png, svg = first
    assert png.startswith(b"\x89PNG\r\n")
    root = ElementTree.fromstring(svg)
    assert "+200.0 %" in "".join(root.itertext())
    assert before == dict(matplotlib.rcParams)


def drawn_texts(figure, file):
    """Every text of a figure in its SVG."""
    plots.write(figure, file)
    root = ElementTree.fromstring(file.read_bytes())
    found = [own.text for own in root.iter() if own.text]
    return [words.strip(style.ZERO_WIDTH_SPACE) for words in found]


TITLE = " ".join(NAMES)


def named_durations():
    rows = [stochastic(name) for name in NAMES]
    return plots.durations(rows, TITLE)


def named_curves():
    curve = sampling.over_runs([a_run([1, 6.0], [100, 5.0])])
    return plots.convergence(dict.fromkeys(NAMES, curve), 4.0, TITLE)


def named_gaps():
    gaps = dict.fromkeys(NAMES, np.array([0.1, 0.2]))
    return plots.gap_distribution(gaps, TITLE)


@pytest.mark.parametrize("picture", [named_durations, named_curves, named_gaps])
def test_names_are_drawn_as_they_are_written(tmp_path, picture):
    drawn = drawn_texts(picture(), tmp_path / "figure.svg")
    for name in (*NAMES, TITLE):
        assert drawn.count(name) == 1


def test_names_of_panels_and_titles_are_drawn_as_they_are_written(tmp_path):
    steps = [("optimum", 1.0), ("route", 2.0)]
    few = NAMES[:3]  # a panel each
    climb = explanation.waterfalls([(name, steps) for name in few])
    drawn = drawn_texts(climb, tmp_path / "climb.svg")
    assert set(few) <= set(drawn)
    motion = motions.motion(*motion_of(1), title=TITLE)
    assert TITLE in drawn_texts(motion, tmp_path / "motion.svg")
    use = explanation.limit_use(*motion_of(1), title=TITLE)
    wrapped = " ".join(drawn_texts(use, tmp_path / "use.svg"))
    assert all(word in wrapped for word in TITLE.split())


def test_what_cannot_be_printed_is_a_space():
    assert style.text("a\nb\t c\x1b[31m\ud800d\u202e") == "a b c [31m d"


def test_a_headline_is_cut_where_it_is_too_long():
    assert style.headline("p", ", 1 s") == "p, 1 s"
    long = style.headline("p" * 500, ", 1.234 s")
    assert len(long) == style.TITLE_LENGTH


def test_missing_glyphs_are_no_warning(tmp_path):
    rows = table(label="机器人")
    plots.save(plots.durations(rows, "机器人"), tmp_path / "glyphs")
