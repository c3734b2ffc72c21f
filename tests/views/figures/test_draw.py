"""A comparison's figures: which are drawn, under which names, and when they are drawn again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pictures import Sleepy, some_trials

from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import trials_of
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners.registry import load
from trajopt.views.figures import draw, plots
from trajopt.views.report import content, panels
from trajopt.views.results import Results


@pytest.fixture(scope="module")
def trials():
    return some_trials()


@pytest.fixture
def drawings(monkeypatch):
    """Every file that is drawn; it holds no picture, which takes most of the time."""
    files = []

    def write(figure, file):
        files.append(file)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"drawn")
        return file

    monkeypatch.setattr(plots, "write", write)
    return files


def slow_trial(segment_time):
    problem = catalogue.load("one-joint")
    planner = load(f"unoptimised:segment_time={segment_time}")
    (trial,) = trials_of(planner, problem, [0], "slower")
    return trial


def test_a_problem_has_a_folder_with_a_picture_of_each_kind(trials, tmp_path):
    files = draw.draw(trials, tmp_path)
    names = {file.name for file in files}
    assert names == {
        "durations.png",
        "convergence.png",
        "gaps.png",
        "overlay.png",
        "motion-unoptimised.png",
        "motion-sleepy_deeply.png",
    }
    assert {file.parent for file in files} == {tmp_path / "one-joint"}


@pytest.mark.usefixtures("drawings")
def test_of_many_planners_the_shortest_middle_and_longest_move(trials, tmp_path):
    slower = [slow_trial(time) for time in (10, 20, 30, 40, 50)]
    files = draw.draw([trials[0], *slower], tmp_path)
    motions = {file.stem for file in files if file.stem.startswith("motion")}
    assert motions == {f"motion-slower_segment_time={time}.0" for time in (10, 30, 50)}


def test_a_reference_alone_moves(trials, tmp_path):
    files = draw.draw(trials[:1], tmp_path)
    assert {file.stem for file in files} == {"durations", "motion-exact"}


def test_every_motion_is_written_on_request(trials, tmp_path):
    draw.write(Results(trials), tmp_path, "svg")
    folder = tmp_path / "one-joint"
    stems = {file.stem for file in folder.iterdir()}
    assert stems == {
        "durations",
        "convergence",
        "gaps",
        "overlay",
        "motion-exact",
        "motion-unoptimised",
        "motion-sleepy_deeply",
    }
    motion = (folder / "motion-sleepy_deeply.svg").read_text(encoding="utf-8")
    assert "median of 3 runs, seed 1" in motion
    assert "exact optimum" in motion


def test_figures_of_the_same_trials_are_drawn_once(trials, tmp_path, drawings):
    first = draw.draw(trials, tmp_path)
    again = draw.draw(trials[::-1], tmp_path)
    assert sorted(first) == sorted(again)
    assert len(drawings) == len(first)


@pytest.mark.parametrize(
    "change",
    [
        {"started": "2026-01-31T12:00:00+00:00"},
        {"label": "unoptimised:segment_time=2.0"},
        {"status": Status.FAILED},
    ],
)
def test_other_trials_are_drawn_again(trials, tmp_path, drawings, change):
    draw.draw(trials, tmp_path)
    drawings.clear()
    exact, once, *often = trials
    draw.draw([exact, replace(once, **change), *often], tmp_path)
    assert drawings


def test_a_deleted_figure_is_drawn_again(trials, tmp_path, drawings):
    first, *_ = draw.draw(trials, tmp_path)
    first.unlink()
    drawings.clear()
    draw.draw(trials, tmp_path)
    assert first.is_file()


@pytest.mark.usefixtures("drawings")
def test_a_motion_that_is_no_longer_shown_is_removed(trials, tmp_path):
    draw.draw(trials, tmp_path)
    files = draw.draw(trials[:2], tmp_path)
    names = {file.name for file in (tmp_path / "one-joint").glob("*.png")}
    assert "motion-sleepy_deeply.png" not in names
    assert {file.name for file in files} <= names


@pytest.mark.usefixtures("drawings")
def test_a_figure_that_fails_is_a_warning_and_drawn_by_the_next_run(trials, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("no ink")

    with monkeypatch.context() as without_ink:
        without_ink.setattr(plots, "gap_distribution", broken)
        with pytest.warns(UserWarning, match=r"gaps.png: not drawn: no ink"):
            made = draw.draw(trials, tmp_path)
    assert "gaps" not in {file.stem for file in made}
    assert "gaps" in {file.stem for file in draw.draw(trials, tmp_path)}


@pytest.mark.usefixtures("drawings")
def test_problems_of_one_name_have_folders_of_their_own(tmp_path):
    problems = [Problem([[0.0], [x]], Limits([1.0], [1.0]), "same") for x in (1.0, 2.0)]
    trials = []
    for problem in problems:
        trials += trials_of(load("exact"), problem, [0], "exact")
    folders = {file.parent.name for file in draw.draw(trials, tmp_path)}
    assert folders == {f"same-{problem.digest()[:8]}" for problem in problems}


def test_a_relaxed_optimum_is_called_so(tmp_path):
    recorded = catalogue.load("jerk-limit")
    unknown = replace(recorded, waypoints=1.001 * recorded.waypoints)  # it has no record
    trials = []
    for name in ("exact", "unoptimised"):
        trials += trials_of(load(name), unknown, [0], name)
    draw.write(Results(trials), tmp_path, "svg")
    folder = tmp_path / "jerk-limit"
    motion = (folder / "motion-unoptimised.svg").read_text(encoding="utf-8")
    assert "best known without jerk limits (relaxed)" in motion
    assert not (folder / "motion-exact.svg").exists()
    chart = (folder / "durations.svg").read_text(encoding="utf-8")
    assert "relaxed optimum" in chart


def test_file_names_are_portable_and_never_clash():
    names = ["../x y", "x_y", "issa:fitness=scaled,timing=per-joint", "..", "X:Y"]
    digests = [letter * 64 for letter in "abcde"]
    found = draw.distinct_names(list(zip(names, digests, strict=True)))
    assert found == [
        "x_y-aaaaaaaa",
        "x_y-bbbbbbbb",
        "issa_fitness=scaled_timing=per-joint",
        "_",
        "X_Y-eeeeeeee",
    ]
    (cut,) = draw.distinct_names([("n" * 500, "0" * 64)])
    assert len(cut) < 100


class Hasty(Sleepy):
    """Claims half of what the unoptimised answer takes, and has a history of claims."""

    def solve(self, problem, *, seed=0):
        whole = load("unoptimised").solve(problem).trajectory
        claim = whole.dilated(0.3)
        history = np.array([[1.0, 2 * claim.duration], [10.0, claim.duration]])
        return Solution(Status.SOLVED, claim, evaluations=10, history=history)


def test_convergence_is_certified_in_the_report_as_in_the_figure():
    (trial,) = trials_of(Hasty(), catalogue.load("one-joint"), [0], "hasty")
    assert trial.certificate.dilation > 1.1
    panel = panels.panel([trial], ["hasty"], with_motions=False)
    (band,) = panel["convergence"]
    np.testing.assert_allclose(band["middle"][-1], trial.certified_duration, rtol=1e-5)


@pytest.mark.usefixtures("drawings")
def test_searches_whose_median_never_has_an_answer_have_no_curve(trials, tmp_path, monkeypatch):
    """Infinite curves have no logarithm: every file of the folder is written without them."""
    infinite = np.full((3, 2), np.inf)
    spent = np.array([1.0, 10.0])
    monkeypatch.setattr(draw.sampling, "over_runs", lambda runs: (spent, infinite))
    draw.write(Results(trials), tmp_path, "svg")
    stems = {file.stem for file in (tmp_path / "one-joint").iterdir()}
    assert "durations" in stems
    assert "convergence" not in stems


def test_a_planner_has_its_colour_of_the_figures_in_the_report(trials):
    labels = sorted({trial.label for trial in trials})
    for planner in content.page(Results(trials)).planners:
        look = plots.planner_look(planner["label"], labels)
        assert planner["colour"] == look["color"]


@pytest.mark.usefixtures("drawings")
def test_the_figures_of_a_suite_are_written_without_those_of_each_problem(tmp_path):
    found = []
    for number in (1.0, 2.0):
        problem = Problem([[0.0], [number]], Limits([1.0], [2.0]), f"problem {number:g}")
        found += trials_of(load("ruckig-stop"), problem, [0], "ruckig-stop")
        found += trials_of(load("exact"), problem, [0], "exact")
    results = Results(found)
    draw.write(results, tmp_path / "suite", "svg", each_problem=False)
    assert {path.name for path in (tmp_path / "suite").iterdir()} >= {"profile.svg", "gaps.svg"}
    assert not any(path.is_dir() for path in (tmp_path / "suite").iterdir())
    draw.write(results, tmp_path / "each", "svg")
    assert (tmp_path / "each" / "problem_1" / "durations.svg").is_file()
