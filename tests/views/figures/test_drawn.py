"""Figures are drawn again where their trials, or the files themselves, have changed."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from functools import partial

import pytest
from PIL import Image

from trajopt import Limits, Problem
from trajopt.benchmark.run.pool import Pool
from trajopt.benchmark.trial import judge
from trajopt.planners.registry import load
from trajopt.views.figures import draw as figures
from trajopt.views.figures import drawn, motions
from trajopt.views.figures.drawing import Drawer, Drawing, NotDrawn


@pytest.fixture
def trials():
    problem = Problem([[0.0], [1.0], [2.0], [1.5]], Limits([1.0], [2.0]), name="one")
    return judge(load("unoptimised"), problem, [0], "unoptimised")


@pytest.fixture
def calls(monkeypatch):
    """How often anything was drawn; each time two files, of what the trials are called."""
    seen = []

    def draw(trials, folder, drawer):
        seen.append(drawer)
        files = [folder / "one" / "durations.png", folder / "one" / "gaps.png"]
        for file in files:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(trials[0].started)
        return files

    monkeypatch.setattr(figures, "draw", draw)
    return seen


def test_the_same_trials_are_drawn_once(trials, calls, tmp_path):
    drawer = Drawer()
    first = drawn.draw(trials, tmp_path, drawer)
    again = drawn.draw(trials, tmp_path, drawer)
    assert again == first
    assert calls == [drawer]


@pytest.mark.parametrize(
    "change",
    [
        {"started": "2026-01-31T12:00:00+00:00"},
        {"label": "unoptimised:segment_time=2.0"},
        {"solve_time": 9.0},
        {"certificate": None},
    ],
)
def test_other_trials_are_drawn_anew(trials, calls, tmp_path, change):
    drawn.draw(trials, tmp_path)
    others = [replace(trial, **change) for trial in trials]
    drawn.draw(others, tmp_path)
    assert len(calls) == 2


@pytest.mark.parametrize("spoil", ["edited", "deleted", "damaged note", "foreign note"])
def test_what_was_touched_is_drawn_anew(trials, calls, tmp_path, spoil):
    first, _ = drawn.draw(trials, tmp_path)
    note = tmp_path / drawn.NOTE
    if spoil == "edited":
        first.write_text("a drawing of mine")
    elif spoil == "deleted":
        first.unlink()
    elif spoil == "damaged note":
        note.write_bytes(note.read_bytes()[:40])
    else:
        note.write_text('{"trials": 1, "files": [2]}')
    drawn.draw(trials, tmp_path)
    assert len(calls) == 2
    assert first.read_text() == trials[0].started


def test_another_code_that_draws_draws_anew(trials, calls, tmp_path, monkeypatch):
    drawn.draw(trials, tmp_path)
    monkeypatch.setattr(drawn, "code", lambda: "other")
    drawn.draw(trials, tmp_path)
    assert len(calls) == 2


def broken(*_, **__):
    raise RuntimeError("no ink")


def test_a_figure_that_fails_is_a_warning_and_tried_again_by_the_next_run(
    trials, tmp_path, monkeypatch
):
    with monkeypatch.context() as without_ink:
        without_ink.setattr(motions, "motion", broken)
        with pytest.warns(NotDrawn, match="motion-unoptimised: not drawn: no ink"):
            made = drawn.draw(trials, tmp_path)
    assert {file.stem for file in made} == {"durations"}
    assert {file.stem for file in drawn.draw(trials, tmp_path)} == {
        "durations",
        "motion-unoptimised",
    }


class Deadly(Drawing):
    """Kills any process but the one whose number is among what is shown."""

    def draw(self):
        if os.getpid() != self.arguments.pop("process"):
            os._exit(3)
        super().draw()


def test_what_a_process_dies_of_is_drawn_here(trials, tmp_path):
    shown = arguments(trials[0]) | {"process": os.getpid()}
    drawing = Deadly("motion", shown, tmp_path / "motion")
    with Pool(1) as pool:
        pool.submit(partial(os.getpid))
        files = Drawer(pool).finish([drawing])
    assert files == list(tmp_path.iterdir())
    assert len(files) == 1


def test_what_was_begun_and_is_right_is_not_drawn_again(trials, tmp_path):
    early = Drawing("motion", arguments(trials[0]), tmp_path / "motion")
    with Pool(1) as pool:
        drawer = Drawer(pool)
        drawer.begin([early])
        pool.submit(partial(os.getpid)).result()  # the only process has drawn it
        drawn_at = (tmp_path / "motion.png").stat().st_mtime_ns
        same = Drawing("motion", arguments(trials[0]), tmp_path / "motion")
        (file,) = drawer.finish([same])
    assert file.stat().st_mtime_ns == drawn_at


def test_what_was_begun_too_early_is_drawn_anew_and_what_nobody_wants_is_removed(trials, tmp_path):
    shown = arguments(trials[0])
    early = Drawing("motion", shown, tmp_path / "motion")
    stray = Drawing("motion", shown, tmp_path / "motion-of-another-name")
    final = Drawing("motion", shown | {"title": "all trials"}, tmp_path / "motion")
    with Pool(2) as pool:
        drawer = Drawer(pool)
        drawer.begin([early, stray])
        drawer.finish([final])
    assert list(tmp_path.iterdir()) == [tmp_path / "motion.png"]
    assert final.current


def test_motions_are_settled_once_the_references_of_their_problem_are(trials, tmp_path):
    (unoptimised,) = trials
    assert list(figures.ahead(trials, tmp_path)) == []
    exact = judge(load("exact"), unoptimised.problem, [0], "exact")
    ahead = list(figures.ahead([*exact, unoptimised], tmp_path))
    names = {drawing.file.name for drawing in ahead}
    assert names == {"motion-exact.png", "motion-unoptimised.png"}
    figures.draw([*exact, unoptimised], tmp_path)
    assert all(drawing.current for drawing in ahead)


def arguments(trial):
    return {"problem": trial.problem, "trajectory": trial.certified_trajectory}


def test_a_png_is_opaque_of_its_density_and_says_what_it_shows(trials, tmp_path):
    png, *_ = figures.draw(trials, tmp_path)
    with Image.open(png) as picture:
        assert picture.mode == "RGB"
        assert picture.info["dpi"] == pytest.approx((150, 150), abs=0.02)  # whole dots per metre
        assert re.fullmatch("[0-9a-f]{40}", picture.info["Description"])
