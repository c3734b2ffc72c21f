"""`trajopt.retime` and `trajopt retime`: a motion's own path, splines, waits, and bad input."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import trajopt
from trajopt import InvalidInput, Limits, Problem, Trajectory, retime
from trajopt.cli.app import main
from trajopt.retiming import apart

MOTIONS = Path(__file__).parents[1] / "docs" / "examples" / "motions"
LINE = Trajectory([0.0, 3.0], np.array([[0.5], [0.0]])[:, None], [0.0, 3.0])
# h/v + v/a + a/j over 1.5 rad
LIMITS, RIGHT = Limits([1.0], [2.0], [10.0]), 1.5 + 0.5 + 0.2


def command(line, capsys):
    """Return the exit code of a command, and what it prints."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    out, err = capsys.readouterr()
    return ended.value.code or 0, out, err


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shutil.copytree(MOTIONS, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("path", [LINE, CubicSpline([0, 1], [[0.0], [1.5]]), [[0.0], [1.5]]])
def test_a_motion_a_spline_and_waypoints_are_paths(path):
    found = retime(path, LIMITS)
    assert RIGHT * (1 - 1e-6) < found.duration < RIGHT * (1 + 5e-4)
    assert found.leaves < 1e-13
    assert found.held[0].longest.limit == "velocity"
    # 0.8 s at 1 rad/s, and on both sides what a jerk of 10 takes for the last 1 %
    assert found.held[0].share == pytest.approx((0.8 + 2 * 0.002**0.5) / RIGHT, abs=0.01)


def test_a_path_waits_where_it_is_asked_to():
    path = Trajectory([0.0, 3.0], np.array([[0.5], [0.0]])[:, None], [0.0, 1.0, 3.0])
    found = retime(path, Limits([1.0], [2.0]), dwell=[0.0, 0.3, 0.0])
    # rest to rest over 0.5 and 1 rad, and the wait
    assert found.duration == pytest.approx(1.0 + 1.5 + 0.3, rel=5e-4)


def test_a_timing_that_is_the_best_is_kept():
    problem = Problem([[0.0, 0.0], [1.0, 0.5], [0.5, 1.0]], Limits([1.0, 1.0], [2.0, 3.0]))
    best = trajopt.plan(problem, "exact").certified_trajectory
    found = retime(best, problem)
    assert found.duration <= best.duration * (1 + 1e-12)
    assert found.given_certified == pytest.approx(best.duration)


def test_demands_beside_a_problem_are_refused():
    problem = Problem([[0.0], [1.5]], LIMITS)
    with pytest.raises(InvalidInput, match="start_velocity"):
        retime(LINE, problem, start_velocity=[0.1])
    with pytest.raises(InvalidInput, match="limits beside waypoints"):
        retime([[0.0], [1.5]], problem)


def test_ceilings_are_the_maximum_velocity_curves():
    """A circle of two joints in its angle: speeds of 1 and, by acceleration, sqrt(a)."""
    angle = np.linspace(0, 2 * np.pi, 60)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = retime(CubicSpline(angle, circle), Limits([10.0, 10.0], [2.0, 2.0]))
    times = np.linspace(0.3, 0.7, 5) * found.duration
    speeds = np.linalg.norm(found.motion(times, 1), axis=1)
    q = found.motion(times)
    ceilings = {key: own * speeds for key, own in found.ceilings(times).items()}
    # velocity w (−sin, cos): w ≤ 10/max; acceleration −w² (cos, sin) + x (−sin, cos) within 2
    assert ceilings["velocity"] == pytest.approx(10 / np.abs(q).max(axis=1), rel=1e-4)
    c, s = np.abs(q).T
    assert ceilings["acceleration"] ** 2 == pytest.approx(2 * (c + s), rel=1e-3)


@pytest.mark.parametrize("limits", [Limits([1.0], [2.0]), LIMITS])
def test_a_bound_is_below_the_optimum_without_jerk_limits_and_near_it(limits):
    assert 2 * (1 - 1e-3) < retime(LINE, limits).bound < 2.0


def test_motions_apart_are_apart():
    moved = Trajectory([0.0, 1.0, 3.0], np.array([[[0.5], [0.5]], [[0.0], [0.501]]]), [0.0, 3.0])
    assert apart(LINE, LINE) < 1e-14
    assert apart(LINE, moved) == pytest.approx(1e-3, rel=1e-6)


def test_the_command_says_how_much_faster_and_what_holds(folder, capsys):
    code, out, _ = command("retime sent.yaml --limits joint_limits.yaml --bound", capsys)
    assert code == 0
    said = " ".join(out.split())
    assert "Along the same path this is 1.223 times as fast." in said
    assert "That timing is held back by acceleration of shoulder (" in said
    assert "It leaves the path by at most " in said
    assert "No motion along this path takes less than 1.97" in said
    assert Path("results/retime/sent.yaml-along.png").is_file()


def test_a_problem_s_waypoints_count_where_the_path_passes(folder, capsys):
    code, out, _ = command("retime sent.yaml arm.toml --json --out sent.csv", capsys)
    table = json.loads(out)
    assert code == 0
    assert table["misses_waypoints"] == pytest.approx(8.8e-6, rel=0.1)
    assert table["certified_duration"] < table["given_certified_duration"]
    code, out, _ = command("verify sent.csv --limits joint_limits.yaml", capsys)
    assert code == 0, out


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("nothing.csv", "does not exist"),
        ("arm.toml spline.csv", "the motion first, then its problem"),
        ("spline.csv", "--limits"),
        ("spline.csv arm.toml --knots even", "'centripetal'"),
        ("spline.csv arm.toml --accuracy 2", "--accuracy"),
    ],
)
def test_bad_input_is_one_line(line, said, folder, capsys):
    code, out, err = command(f"retime {line}", capsys)
    assert (code, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
