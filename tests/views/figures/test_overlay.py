"""The first picture: motions on one time axis, labelled, with the hardest used limit below."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt import Limits, Problem
from trajopt.planners.registry import load
from trajopt.views.figures import overlay, plots
from trajopt.views.figures.style import BLACK, CURVES, KNOWN, places
from trajopt.views.report import content

PROBLEM = Problem([[0.0, 0.0], [0.2, 1.0], [0.3, 2.0]], Limits([1.0, 1.0], [2.0, 2.0]), "two")


def motion(name):
    return overlay.ShownMotion(name, name, load(name).solve(PROBLEM, seed=0).trajectory)


@pytest.fixture
def figure():
    return overlay.overlay(PROBLEM, [motion("exact"), motion("ruckig-stop")])


def test_it_shows_the_joint_whose_way_takes_longest(figure):
    """Joint 2 moves 2 rad, joint 1 0.3 rad; both at 1 rad/s at most."""
    upper, _ = figure.axes
    assert upper.get_ylabel() == "joint 2 (deg)"
    line = upper.lines[0]
    assert line.get_ydata()[-1] == pytest.approx(np.degrees(2.0))


def test_durations_and_the_ratio_are_said(figure):
    """One joint over 1 + 1 rad: 2/1 + 1/2 = 2.5 s without a stop, 2 (1/1 + 1/2) = 3 s with one."""
    upper, lower = figure.axes
    said = [text.get_text() for text in upper.texts]
    assert said == ["exact\n2.50 s", "ruckig-stop\n3.00 s"]
    title = " ".join(figure.get_suptitle().split())
    assert title.endswith("ruckig-stop takes 20.0 % more than the optimum")
    assert lower.lines[0].get_ydata().max() == pytest.approx(100, abs=0.1)


@pytest.mark.parametrize("stopping", ["ruckig-stop", "Ruckig, which stops at every waypoint"])
def test_labels_do_not_touch_and_are_inside(stopping):
    named = motion("ruckig-stop")._replace(name=stopping)
    figure = overlay.overlay(PROBLEM, [motion("exact"), named])
    figure.draw_without_rendering()
    upper, _ = figure.axes
    boxes = [text.get_window_extent() for text in upper.texts]
    assert not boxes[0].overlaps(boxes[1])
    boxes.append(figure.texts[0].get_window_extent())  # the title
    assert all(figure.bbox.contains(x, y) for box in boxes for x, y in (box.min, box.max))


def test_four_motions_of_about_one_length_leave_room_for_their_curves():
    shortest = motion("exact")
    names = ["exact optimum", "Ruckig with searched waypoints", "TOPP-RA", "Ruckig with stops"]
    shown = [
        shortest._replace(name=name, trajectory=shortest.trajectory.dilated(1 + 0.05 * k))
        for k, name in enumerate(names)
    ]
    figure = overlay.overlay(PROBLEM, shown)
    figure.draw_without_rendering()
    upper, _ = figure.axes
    low, high = upper.get_ylim()
    assert np.degrees(2.0) / (high - low) > 0.5  # the curves go from 0 to 2 rad
    boxes = [text.get_window_extent() for text in upper.texts]
    assert not any(box.count_overlaps(boxes[:k]) for k, box in enumerate(boxes))


def test_a_planner_of_the_toolkit_has_one_look_in_every_comparison():
    for order in (["exact", "mine", "toppra"], ["issa", "toppra", "yours"], ["toppra"]):
        assert places(order)["toppra"] == KNOWN.index("toppra")
    many = [*filter(None, KNOWN), *(f"mine-{i}" for i in range(8))]
    assert len(set(places(many).values())) == len(many)


def test_a_planner_keeps_its_look_with_options_and_in_the_report():
    assert places(["pso:iterations=60", "mine"]) == {
        "pso:iterations=60": KNOWN.index("pso"),
        "mine": len(KNOWN) + CURVES.index(BLACK),
    }
    both = places(["pso:iterations=60", "pso", "exact"])
    other = both.pop("pso:iterations=60")
    assert both == {"pso": KNOWN.index("pso"), "exact": 0}
    assert other >= len(KNOWN)
    assert other % len(CURVES) not in {place % len(CURVES) for place in both.values()}
    for label in filter(None, KNOWN):
        on_page = content.look(places([label])[label])
        assert on_page["colour"] == plots.planner_look(label)["color"]
        assert content.SYMBOLS[plots.planner_mark(label)] == (on_page["symbol"], on_page["mark"])
    looks = {
        (plots.planner_look(label)["color"], plots.planner_mark(label))
        for label in filter(None, KNOWN)
    }
    assert len(looks) == len(list(filter(None, KNOWN)))
    kinds = (["exact", "exact-jerk", "prove"], ["issa", "pso", "ssa"], ["toppra", "copp"])
    hues = [{plots.planner_look(label)["color"] for label in kind} for kind in kinds]
    assert [len(own) for own in hues] == [1, 1, 1]
    assert len(set.union(*hues)) == 3


def luminance(colour):
    """Of sRGB, as WCAG defines it."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = [p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("colour", CURVES)
def test_colours_have_a_contrast_of_three_on_white(colour):
    assert 1.05 / (luminance(colour) + 0.05) >= 3


def test_one_slow_motion_does_not_squeeze_the_others():
    """Of 1, 2 and 40 times the optimum: the axis ends at 1.3 times the second, with an arrow."""
    problem = Problem([[0.0], [1.0]], Limits([1.0], [1.0]))
    best = load("exact").solve(problem).trajectory
    shown = [
        overlay.ShownMotion(name, name, best.dilated(factor))
        for name, factor in (("exact", 1.0), ("a", 2.0), ("slow", 40.0))
    ]
    upper, _ = overlay.overlay(problem, shown).axes
    assert upper.get_xlim()[1] == pytest.approx(1.12 * 1.3 * 2 * best.duration)
    said = [text.get_text() for text in upper.texts]
    assert any("slow" in text and "→" in text for text in said)
    optimum, *others = (line for line in upper.lines if line.get_marker() == "None")
    assert all(optimum.get_zorder() > other.get_zorder() for other in others)
