"""What a report says first: how far above the optimum, the durations, and a picture."""

from __future__ import annotations

import re

import pytest
from markupsafe import Markup

from trajopt import Limits, Problem, Results, compare
from trajopt.benchmark.trial import trials_of
from trajopt.planners.registry import load
from trajopt.views import report
from trajopt.views.report import verdict


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """Trials of one problem of one joint: its optimum has a closed form."""
    folder = tmp_path_factory.mktemp("one")
    return compare(["one-joint"], ["ruckig-stop", "pso"], folder / "r", seeds=2, jobs=1)


@pytest.fixture(scope="module")
def page(one, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    return report.write(Results(one.items), path).read_text(encoding="utf-8")


def test_the_first_sentence_says_how_far_above_the_proved_optimum(page, one):
    """`one-joint`: 1.5 rad at 1 rad/s and 2 rad/s² takes 1.5 + 0.5 = 2 s; stops take 2.9939 s."""
    [said] = re.findall(r'<p class="lead verdict">(.*?)</p>', page)
    gaps = one.gaps().groupby("label")["gap"].median()
    stops = 100 * gaps["ruckig-stop"]
    assert f"Ruckig with stops {stops:.1f} %" in said
    assert "PSO 72" in said
    assert "(median)" in said
    assert said.endswith("above the proved 2.0000 s.")


def test_a_duration_is_proved_where_the_bound_is_near():
    """Two joints whose optimum is 2 % above the bound in closed form, and no record."""
    far = Problem([[0.0, 0.0], [1.0, 0.3], [1.2, 1.0]], Limits([1.0] * 2, [1.0] * 2), "far")
    trials = [trials_of(load(name), far, [0], name)[0] for name in ("exact", "ruckig-stop")]
    assert "the best known" in verdict.of_problem(Results(trials))
    assert "not proved" in verdict.of_problem(Results(trials))


def test_no_line_ends_within_3_5_3():
    assert report._whole("best 3-5-3 spline") == 'best <span class="whole">3-5-3</span> spline'
    kept = '<a title="3-5-3">3-5</a> &lt;3-5-3'
    assert report._whole(Markup(kept)) == kept.replace(
        ";3-5-3", ';<span class="whole">3-5-3</span>'
    )


def test_one_problem_has_no_profile_and_no_shares(page):
    assert '<body class="single">' in page
    for name in ("planners", "paired"):
        assert re.search(rf'id="{name}" hidden', page)
    assert 'id="durations"' in page
    assert "<svg" in page[page.index('class="overlay"') :]


def test_bars_are_as_long_as_the_durations(page, one):
    bars = dict(
        re.findall(r'data-planner="(\d)" aria-pressed.*?style="width:([\d.]+)%', page, re.S)
    )
    certified = one.trials()["certified_duration"]
    shortest = 100 * certified.min() / certified.max()
    assert min(map(float, bars.values())) == pytest.approx(shortest, abs=0.01)


def test_options_stand_in_brackets():
    assert verdict._spoken("pso:iterations=60") == "PSO (iterations=60)"
    assert verdict._spoken("spline353-nlp") == "best 3-5-3 spline"
    assert verdict._spoken("mine") == "mine"
