"""Figures show the numbers they were given: data, limits and signs, never pixels."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ElementTree
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN
from matplotlib.text import Text
from PIL import Image

from trajopt.benchmark.run.pool import Pool
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import Trial, judge
from trajopt.core.problem import Limits, Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Relation
from trajopt.planners.registry import load
from trajopt.views.analysis.summary import Line
from trajopt.views.figures import draw as figures
from trajopt.views.figures import explanation, motions, plots, sampling, style
from trajopt.views.figures.drawing import Drawer
from trajopt.views.report import panels

LONG = "issa:fitness=scaled,timing=per-joint"


def line(label: str, *five: float, **others: object) -> Line:
    """A planner's line: its range, quartiles and median in order; NaN for what is not said."""
    low, q1, median, q3, high = five or [np.nan] * 5
    blank = dict.fromkeys((field.name for field in fields(Line)), np.nan)
    said = {
        "label": label, "min": low, "q1": q1, "median": median, "q3": q3, "max": high,
        "kind": "exact", "reference": 1.5, "runs": 1, "solved": 1, "status": "solved",
    }  # fmt: skip
    return Line(**(blank | said | others))  # type: ignore[arg-type]


MANY = line(LONG, 4.0, 4.25, 4.5, 5.0, 6.0, gap=2.0, runs=30, solved=30)


def table(**changes: object) -> list[Line]:
    """A made-up summary: exact, a stochastic planner, and one without a certified duration."""
    lines = [
        line("unsupporting", solved=0, status="unsupported"),
        MANY,
        line("exact", *[1.5] * 5, gap=0.0),
    ]
    return [replace(own, **changes) for own in lines]  # type: ignore[arg-type]


def motion_of(joints: int, jerk: bool = False) -> tuple[Problem, Trajectory]:
    """Every joint from 0 to 1 rad in 2 s: acceleration +1, then −1 rad/s²; asymmetric limits."""
    velocity = [[-1.5, 2.0 + j] for j in range(joints)]
    limits = Limits(velocity, [3.0] * joints, [50.0] * joints if jerk else None)
    problem = Problem(np.repeat([[0.0], [0.5], [1.0]], joints, axis=1), limits, "made-up")
    pieces = np.array([[0.5, -0.5], [0.0, 1.0], [0.0, 0.5]])
    coefficients = np.repeat(pieces[:, :, None], joints, axis=2)
    return problem, Trajectory([0.0, 1.0, 2.0], coefficients, [0.0, 1.0, 2.0])


def texts(figure: Figure) -> list[str]:
    found = [t.get_text() for t in figure.findobj(Text) if isinstance(t, Text)]
    return [t for t in found if t]


def overlaps(figure: Figure) -> list[tuple[str, str]]:
    """Pairs of drawn texts whose boxes overlap by more than a point."""
    FigureCanvasAgg(figure).draw()
    every = {id(t): t for t in figure.findobj(Text) if isinstance(t, Text)}
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        drawn = axis._update_ticks()  # type: ignore[attr-defined]
        for tick in {*axis.majorTicks, *axis.minorTicks} - set(drawn):  # type: ignore[attr-defined]
            every.pop(id(tick.label1), None)
    shown = [t for t in every.values() if t.get_visible() and t.get_text().strip()]
    boxes = [(t.get_text(), t.get_window_extent().padded(-1.0)) for t in shown]
    return [(a, b) for i, (a, one) in enumerate(boxes) for b, two in boxes[:i] if one.overlaps(two)]


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
    shown = texts(plots.durations([first, many, replace(exact, gap=-0.0123)]))
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
    summary = [replace(MANY, label=label, solved=20) for label in labels]
    assert overlaps(plots.durations(summary, "problem")) == []
    gaps = dict.fromkeys(labels, np.array([0.5, 0.7, 1.9]))
    assert overlaps(plots.gap_distribution(gaps, "problem")) == []
    curve = sampling.over_runs([np.array([[1, np.nan], [10, 6.0], [3000, 4.4]])])
    assert overlaps(plots.convergence(dict.fromkeys(labels, curve), 4.3, "problem")) == []


def test_letters_keep_a_margin_in_pixels(tmp_path: Path) -> None:
    """Half of the layout's own, 0.04 inches: hinted letters vary in width with the density."""
    labels = [f"{LONG},evaluations={10**k}" for k in range(3)]
    rows = [replace(MANY, label=label, solved=20) for label in labels]
    curve = sampling.over_runs([np.array([[1, np.nan], [10, 6.0], [3000, 4.4]])])
    made = {
        "durations": plots.durations(rows, "problem"),
        "gaps": plots.gap_distribution(dict.fromkeys(labels, np.array([0.5, 0.7])), "problem"),
        "convergence": plots.convergence(dict.fromkeys(labels, curve), 4.3, "problem"),
        "motion": motions.motion(*motion_of(3, jerk=True), title="problem"),
    }
    for name, figure in made.items():
        with Image.open(plots.write(figure, tmp_path / f"{name}.png")) as picture:
            pixels = np.asarray(picture)
            margin = round(0.02 * picture.info["dpi"][0])
        inside = np.zeros(pixels.shape[:2], dtype=bool)
        inside[margin:-margin, margin:-margin] = True
        assert (pixels[~inside] == 255).all(), name


@pytest.mark.parametrize("joints", [1, 6, 12])
def test_motion_has_a_row_per_joint_counted_from_one(joints: int) -> None:
    problem, trajectory = motion_of(joints)
    figure = motions.motion(problem, trajectory, trajectory.dilated(1.5), "title")
    rows = [panel.joint for panel in motions.panels(problem, trajectory)]
    assert rows == np.repeat(range(joints), 3).tolist()
    assert {f"joint {j + 1}" for j in range(joints)} <= set(texts(figure))
    assert {"position (rad)", "velocity (rad/s)", "acceleration (rad/s²)"} <= set(texts(figure))
    assert overlaps(figure) == []


def drawn(figure: Figure, layer: str) -> list[list[list[float]]]:
    """The lines of a layer, in inches."""
    (found,) = figure.findobj(lambda artist: artist.get_gid() == layer)
    if isinstance(found, LineCollection):
        return [segment.tolist() for segment in found.get_segments()]
    assert isinstance(found, Line2D)
    return [np.asarray(found.get_xydata()).tolist()]


def test_motion_draws_limits_waypoints_and_both_curves() -> None:
    """Each as a line through two points of its panel that are known: a corner, and its values."""
    problem, trajectory = motion_of(2)
    slower = trajectory.dilated(2.0)
    figure = motions.motion(problem, trajectory, slower, "title")
    shown = motions.panels(problem, trajectory, slower)
    velocity = shown[4]
    assert (velocity.joint, velocity.order, velocity.end) == (1, 1, 4.0)
    assert velocity.low < -1.5
    assert velocity.high > 3.0
    left, bottom = velocity.corner
    width, height = velocity.size
    for limit in (-1.5, 3.0):
        y = bottom + height * (limit - velocity.low) / (velocity.high - velocity.low)
        level = [[left, y], [left + width, y]]
        assert any(np.allclose(line, level) for line in drawn(figure, "limits"))
    first = shown[0]
    x = first.corner[0] + first.size[0] * np.array([0, 1, 2]) / 4
    uprights = drawn(figure, "waypoint times")
    assert len(uprights) == 3 * len(shown)
    for time in x:
        ends = [[time, first.corner[1]], [time, first.corner[1] + first.size[1]]]
        assert any(np.allclose(line, ends) for line in uprights)
    values = (np.array([0, 0.5, 1]) - first.low) / (first.high - first.low)
    dots = np.column_stack([x, first.corner[1] + first.size[1] * values])
    (marks,) = drawn(figure, "waypoints")
    np.testing.assert_allclose(marks[:3], dots)
    # at most 1 rad/s in the middle of 2 s, and half of that over the whole width behind it
    top = bottom + height * (1.0 - velocity.low) / (velocity.high - velocity.low)
    own = np.array(drawn(figure, "motion")[4])
    assert own[:, 1].max() == pytest.approx(top)
    assert own[-1, 0] == pytest.approx(left + width / 2)
    behind = np.array(drawn(figure, "reference")[4])
    assert behind[-1, 0] == pytest.approx(left + width)
    assert {"exact optimum", "limit", "waypoint", "planner"} <= set(texts(figure))


def test_all_that_is_drawn_lies_in_its_panel() -> None:
    problem, trajectory = motion_of(3, jerk=True)
    figure = motions.motion(problem, trajectory, trajectory.dilated(0.5))
    shown = motions.panels(problem, trajectory, trajectory.dilated(0.5))
    for layer in ("motion", "reference"):
        for panel, line in zip(shown, drawn(figure, layer), strict=True):
            inside = np.array(line) - panel.corner
            assert inside.min() >= -1e-12
            assert (inside <= panel.size + 1e-12).all()
    corners = np.array([panel.corner for panel in shown])
    assert len(np.unique(corners, axis=0)) == 12
    assert (corners[:, 0] + shown[0].size[0]).max() < figure.get_figwidth()


def test_what_lies_beyond_a_limit_is_on_its_far_side_whatever_its_sign() -> None:
    """Positions from −2.5 to −1.5 rad, between limits that are both negative."""
    problem, trajectory = motion_of(1)
    limits = Limits([2.0], [3.0], position=[[-3.0, -1.0]])
    below = Problem(problem.waypoints - 2.5, limits)
    coefficients = trajectory.coefficients.copy()
    coefficients[-1] -= 2.5
    moved = Trajectory(trajectory.breaks, coefficients, trajectory.waypoint_times)
    panel = motions.panels(below, moved)[0]
    lower, upper = panel.beyond()
    assert lower[:, 1].max() == pytest.approx(panel.y(-3.0))
    assert lower[:, 1].min() == pytest.approx(panel.y(panel.low))
    assert upper[:, 1].min() == pytest.approx(panel.y(-1.0))
    assert upper[:, 1].max() == pytest.approx(panel.y(panel.high))


def test_ticks_are_round_and_in_view() -> None:
    figure = motions.motion(*motion_of(1))
    shown = texts(figure)
    assert {"0", "0.5", "1", "1.5", "2"} <= set(shown)
    heights = [line[0][1] for line in drawn(figure, "ticks")]
    assert max(heights) < figure.get_figheight()


def test_jerk_has_a_column_only_where_it_is_limited() -> None:
    assert len(motions.panels(*motion_of(1, jerk=True))) == 4
    assert len(motions.panels(*motion_of(1))) == 3


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


def test_minor_ticks_are_those_of_matplotlib_in_every_panel() -> None:
    """2, 3, … 9 times each power of ten from 1 to 110 evaluations, under both panels."""
    runs = [np.array([[1, 8.0], [50, 4.2], [100, 4.1]])]
    figure = plots.convergence({"pso": sampling.over_runs(runs)}, 4.0)
    expected = [*range(2, 10), *range(20, 100, 10)]
    drawn = [artist for artist in figure.artists if isinstance(artist, Line2D)]
    ticks = [own.get_xdata() for own in drawn if own.get_marker() == TICKDOWN]
    np.testing.assert_allclose(np.array(ticks), [expected] * 2)
    for axes in figure.axes:
        assert not len(axes.xaxis.get_minorticklocs())


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


def test_file_names_are_portable_and_never_clash() -> None:
    digests = ["a" * 64, "b" * 64, "c" * 64, "d" * 64, "e" * 64]
    names = ["../x y", "x_y", LONG, "..", "X:Y"]
    found = figures.distinct_names(list(zip(names, digests, strict=True)))
    assert found == [
        "x_y-aaaaaaaa", "x_y-bbbbbbbb", "issa_fitness=scaled_timing=per-joint", "_", "X_Y-eeeeeeee",
    ]  # fmt: skip
    assert len(figures.distinct_names([("n" * 500, "0" * 64)])[0]) < 100


@dataclass(frozen=True)
class Sleepy:
    """A stochastic planner: the unoptimised answer, later with every seed; seed 3 fails."""

    stochastic = True

    def relation(self, problem: Problem) -> Relation:
        return Relation.RESTRICTION

    def unsupported(self, problem: Problem) -> str | None:
        return None

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        found = load("unoptimised").solve(problem).trajectory
        assert found is not None
        late = None if seed == 3 else found.dilated(1 + seed / 10)
        claims = [np.nan, 8.0, 6.0]
        history = np.column_stack([[1.0, 10.0, 99.0], (1 + seed / 10) * np.array(claims)])
        return Solution(Status.FAILED if seed == 3 else Status.SOLVED, late, history=history)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    problem = suite.load("one-joint")
    return [
        *judge(load("exact"), problem, [0], "exact"),
        *judge(load("unoptimised"), problem, [0], "unoptimised"),
        *judge(Sleepy(), problem, range(4), "sleepy:deeply"),
    ]


@pytest.fixture(scope="module")
def once_drawn(trials: list[Trial], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("figures")
    figures.draw(trials, folder)
    return folder


def test_draw_writes_every_figure_of_a_problem(
    trials: list[Trial], once_drawn: Path, tmp_path: Path
) -> None:
    shutil.copytree(once_drawn, tmp_path, dirs_exist_ok=True)
    files = figures.draw(trials, tmp_path)
    stems = {
        "durations",
        "motion-exact",
        "motion-unoptimised",
        "motion-sleepy_deeply",
        "convergence",
        "gaps",
    }
    expected = {tmp_path / "one-joint" / f"{stem}.png" for stem in stems}
    assert set(files) == expected == set((tmp_path / "one-joint").iterdir())
    figures.write(trials, tmp_path, "svg")
    motion = (tmp_path / "one-joint" / "motion-sleepy_deeply.svg").read_text(encoding="utf-8")
    assert "median of 3 runs, seed 1" in motion
    assert "exact optimum" in motion


def test_problems_of_one_name_do_not_overwrite_each_other(tmp_path: Path) -> None:
    problems = [Problem([[0.0], [x]], Limits([1.0], [1.0]), "same") for x in (1.0, 2.0)]
    items = [t for p in problems for t in judge(load("exact"), p, [0], "exact")]
    folders = {file.parent.name for file in figures.draw(items, tmp_path)}
    assert folders == {f"same-{p.digest()[:8]}" for p in problems}


def test_a_relaxed_optimum_is_called_so(tmp_path: Path) -> None:
    recorded = suite.load("jerk-limit")
    problem = replace(recorded, waypoints=1.001 * recorded.waypoints)  # of it no motion is recorded
    items = [t for n in ("exact", "unoptimised") for t in judge(load(n), problem, [0], n)]
    figures.write(items, tmp_path, "svg")
    motion = (tmp_path / "jerk-limit" / "motion-unoptimised.svg").read_text(encoding="utf-8")
    assert "best known without jerk limits (relaxed)" in motion
    assert not (tmp_path / "jerk-limit" / "motion-exact.svg").exists()
    chart = (tmp_path / "jerk-limit" / "durations.svg").read_text(encoding="utf-8")
    assert "relaxed optimum" in chart


def test_runs_that_nothing_certified_found_nothing(trials: list[Trial]) -> None:
    own = [t for t in trials if t.label == "sleepy:deeply"]
    _, quartiles = figures._convergence(own)["curves"]["sleepy:deeply"]
    # 6, 6.6, 7.2 s and none: the quartiles are 3/4, 6/4 and 9/4 of the way along them.
    np.testing.assert_allclose(quartiles[:, -1], [6.45, 6.9, np.inf])


@dataclass(frozen=True)
class Hasty(Sleepy):
    """Claims half of what the unoptimised answer takes, and has a history of claims."""

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        whole = load("unoptimised").solve(problem).trajectory
        assert whole is not None
        claim = whole.dilated(0.3)
        history = np.array([[1.0, 2 * claim.duration], [10.0, claim.duration]])
        return Solution(Status.SOLVED, claim, evaluations=10, history=history)


def test_convergence_is_certified_in_the_figure_and_in_the_report() -> None:
    (trial,) = judge(Hasty(), suite.load("one-joint"), [0], "hasty")
    assert trial.certificate is not None
    assert trial.certificate.dilation > 1.1
    _, quartiles = figures._convergence([trial])["curves"]["hasty"]
    (band,) = panels.panel([trial], ["hasty"], with_motions=False)["convergence"]
    np.testing.assert_allclose(quartiles[:, -1], trial.certified_duration)
    np.testing.assert_allclose(band["middle"][-1], trial.certified_duration, rtol=1e-5)


NAMES = (r"a$b$\frac_{x}^2", "$", "$$", "<b>&amp;", "_hidden", "50 %", r"\$x\$")


def test_names_are_drawn_as_they_are_written(tmp_path: Path) -> None:
    """Each as a label of a row, a curve or a panel, and all of them in a title."""
    rows = [replace(MANY, label=name) for name in NAMES]
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


def test_only_figures_whose_data_changed_are_drawn_again(
    trials: list[Trial], once_drawn: Path, tmp_path: Path
) -> None:
    shutil.copytree(once_drawn, tmp_path, dirs_exist_ok=True)
    files = figures.draw(trials, tmp_path)
    before = {file: file.stat().st_mtime_ns for file in files}
    assert figures.draw(list(trials), tmp_path) == files
    assert {file: file.stat().st_mtime_ns for file in files} == before
    exact, *others = trials
    slower = replace(exact, solution=replace(exact.solution, trajectory=doubled(exact)))
    figures.draw([slower, *others], tmp_path)
    changed = {file.stem for file in files if file.stat().st_mtime_ns != before[file]}
    assert changed == {"motion-exact", "motion-unoptimised", "motion-sleepy_deeply"}
    (tmp_path / "one-joint" / "gaps.png").unlink()
    (tmp_path / "one-joint" / "durations.png").write_bytes(b"")
    figures.draw(trials, tmp_path)
    assert all(drawing_is_whole(file) for file in files)


def doubled(trial: Trial) -> Trajectory:
    assert trial.solution.trajectory is not None
    return trial.solution.trajectory.dilated(2.0)


def drawing_is_whole(file: Path) -> bool:
    return file.read_bytes().startswith(b"\x89PNG")


def test_other_processes_draw_the_same_bytes(
    trials: list[Trial], once_drawn: Path, tmp_path: Path
) -> None:
    with Pool(1) as pool:
        files = figures.draw(trials, tmp_path, Drawer(pool))
    assert len(files) == 6
    for file in files:
        assert file.read_bytes() == (once_drawn / file.relative_to(tmp_path)).read_bytes()
