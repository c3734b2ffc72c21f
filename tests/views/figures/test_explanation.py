"""Figures of a gap, and `trajopt explain` that draws them: numbers, words, no overlap."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.patches import Rectangle
from pictures import motion_of, overlaps, texts

from trajopt.cli import app as cli
from trajopt.views.figures import explanation as gap_plots

STEPS = [("optimum", 1.5), ("route", 1.8), ("timing", 4.5)]
KEYS = [
    "problem",
    "planner",
    "seed",
    "certified_duration",
    "exact",
    "recorded",
    "gap",
    "timing_gap",
    "route_gap",
    "optimiser_gap",
    "shape_gap",
    "smoothness_gap",
    "notes",
    "active",
    "figures",
]


def test_a_waterfall_climbs_from_the_optimum_to_the_planner() -> None:
    figure = gap_plots.waterfalls([("a", STEPS), ("b", STEPS[:2])])
    bars = [b for b in figure.axes[0].patches if isinstance(b, Rectangle)]
    assert [b.get_y() for b in bars] == pytest.approx([0, 1.5, 1.8, 0])
    assert [b.get_height() for b in bars] == pytest.approx([1.5, 0.3, 2.7, 4.5])
    assert {"1.5 s", "+0.3 s\n×1.2000", "+2.7 s\n×2.5000", "4.5 s"} <= set(texts(figure))
    assert "certified duration (s)" in texts(figure)
    assert overlaps(figure) == []


def test_an_odd_panel_leaves_its_neighbour_empty() -> None:
    figure = gap_plots.waterfalls([("a", STEPS)] * 3)
    assert [axes.axison for axes in figure.axes] == [True, True, True, False]


@pytest.mark.parametrize("jerk", [False, True])
def test_limit_use_shows_every_moving_joints_limits(jerk: bool) -> None:
    problem, trajectory = motion_of(2, jerk)
    figure = gap_plots.limit_use(problem, trajectory, trajectory, "title")
    rows = ["vel.", "acc.", "jerk"][: 3 if jerk else 2]
    names = [f"joint {j} {row}" for j in (1, 2) for row in rows]
    for axes in figure.axes[1:3]:
        assert [label.get_text() for label in axes.get_yticklabels()] == names
    (mesh,) = (c for c in figure.axes[1].collections if isinstance(c, QuadMesh))
    use = np.asarray(mesh.get_array()).reshape(len(names), -1)
    # Acceleration is 1 of 3 throughout; velocity rises to 1 of 2 (of 3 for the second joint).
    assert use[1] == pytest.approx(1 / 3)
    assert use[0].max() == pytest.approx(1 / 2, abs=1e-3)
    assert use[len(rows)].max() == pytest.approx(1 / 3, abs=1e-3)
    assert overlaps(figure) == []


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as stop:
        cli.main(["explain", *arguments])
    return stop.value.code, *capsys.readouterr()


def test_explain_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("six-axis", "--planner", "issa:iterations=20", "--seed", "3")
    code, out, err = run(capsys, *arguments, "--output", str(tmp_path), "--json")
    table = json.loads(out)
    assert (code, err, list(table)) == (0, "", KEYS)
    assert table["seed"] == 3
    assert table["gap"] == pytest.approx((1 + table["timing_gap"]) * (1 + table["route_gap"]) - 1)
    assert {(b["joint"], b["limit"]) for b in table["active"]} <= {
        (joint, limit) for joint in range(1, 7) for limit in ("velocity", "acceleration")
    }
    assert sorted(table["figures"]) == sorted(str(f) for f in tmp_path.iterdir())
    assert len(table["figures"]) == 4


def test_explain_reads_as_a_few_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "six-axis", "--planner", "ruckig-stop", "--output", str(tmp_path))
    lines = [line for line in out.splitlines() if line.startswith("- ")]
    assert code == 0
    assert len(lines) == 6  # a 3-5-3 has one more: its decomposition
    assert lines[0].startswith("- ruckig-stop takes 2.3865 s on six-axis, 1.608 times")
    assert max(map(len, out.splitlines()[:-1])) <= 80


def test_nothing_certified_is_nothing_to_explain(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "seven-waypoints", "--planner", "issa", "--json")
    assert code == 1
    assert json.loads(out)["status"] == "unsupported"
    code, out, _ = run(capsys, "seven-waypoints", "--planner", "issa")
    assert (code, "exactly 4 waypoints" in out) == (1, True)


@pytest.mark.parametrize(
    "bad", [("six-axis", "--planner", "issa", "--seed", "-1"), ("nowhere", "--planner", "issa")]
)
def test_bad_input_exits_2(bad: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, *bad)
    assert (code, err.count("\n")) == (2, 1)
