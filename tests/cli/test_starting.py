"""`plan --from --at`, `plan --brake-first`, `judge --scaled`, and what a slow plan says."""

from __future__ import annotations

import json
import time

import pytest

import trajopt
from trajopt.cli import console

PROBLEM = """
joint_names = ["a", "b"]
waypoints = [[0, 0], [1, 0.4], [2, 1]]
angle_unit = "rad"
start_velocity = {start}
[limits]
velocity = [1, 1]
acceleration = [2, 2]
jerk = [20, 20]
"""
RUNS = PROBLEM.format(start="[0, 0]")
FAST = PROBLEM.format(start="[1.3, -1.2]")
LIMITS = """
joint_limits:
  a: {max_velocity: 1.0, max_acceleration: 2.0}
  b: {max_velocity: 1.0, max_acceleration: 2.0}
"""


def test_a_plan_takes_over_from_a_motion(run):
    """The answer equals the problem with that state, and joins the motion without a jump."""
    run("plan runs.toml --out runs.csv", runs__toml=RUNS)
    running = trajopt.judge("runs.toml", "runs.csv").trajectory
    code, out, err = run("plan runs.toml --from runs.csv --at 0.8 --out next.csv --json")
    assert code == 0, err
    state = [running(0.8, order) for order in range(3)]
    asked = trajopt.Problem(
        [state[0], [1, 0.4], [2, 1]],
        trajopt.problem("runs.toml").limits,
        start_velocity=state[1],
        start_acceleration=state[2],
    )
    found = json.loads(out)["certified_duration"]
    assert found == pytest.approx(trajopt.plan(asked).certified_duration, rel=1e-9)
    limits = LIMITS.replace("2.0}", "2.0, max_jerk: 20.0}")
    line = "verify next.csv --limits l.yaml --before runs.csv --at 0.8 --json"
    code, out, err = run(line, l__yaml=limits)
    assert code == 0, err
    assert max(json.loads(out)["jumps"]) < 1e-9


def test_waypoints_are_the_goals_and_one_is_enough(run):
    code, _, err = run(
        "plan way.csv --limits l.yaml --out m.csv", way__csv="a,b\n0,0\n1,1\n", l__yaml=LIMITS
    )
    assert code == 0, err
    code, out, err = run(
        "plan goal.csv --limits l.yaml --from m.csv --at 0.4 --json", goal__csv="b,a\n2,0.5\n"
    )
    assert code == 0, err
    assert json.loads(out)["certified_duration"] > 0
    code, _, err = run("plan goal.csv --limits l.yaml")
    assert (code, "at least two rows" in err) == (2, True)


@pytest.mark.parametrize("file", ["m.csv", "m.yaml", "m.png"])
def test_a_braking_is_planned_written_and_judged(run, file):
    code, out, err = run(f"plan fast.toml --brake-first --out {file}", fast__toml=FAST)
    assert code == 0, err
    assert "It begins beyond limits, and brakes into them in 0.2" in " ".join(out.split())
    if not file.endswith("png"):
        code, out, err = run(f"judge {file} fast.toml --brake-first --json")
        assert (code, json.loads(out)["feasible"]) == (0, True), err
        assert run(f"judge {file} fast.toml --json")[0] == 1


def test_scaled_limits_are_judged_as_they_are_planned(run):
    slow = "default_velocity_scaling_factor: 0.1\ndefault_acceleration_scaling_factor: 0.1\n"
    run(
        "plan way.csv --limits l.yaml --out m.csv",
        way__csv="a,b\n0,0\n1,1\n",
        l__yaml=slow + LIMITS,
    )
    gaps = [
        json.loads(run(f"judge m.csv way.csv --limits l.yaml --json {flag}")[1])["gap"]
        for flag in ("", "--scaled")
    ]
    assert gaps[0] > 1
    assert gaps[1] == pytest.approx(0, abs=2e-3)


def test_a_slow_step_is_named(monkeypatch, capsys):
    monkeypatch.setattr(console, "_SILENT_S", 0.0)
    with console.waiting("planning it", long=True) as tell:
        tell("exact plans")
        for _ in range(1000):
            time.sleep(0.01)
            err = capsys.readouterr().err
            if err:
                break
    assert err.startswith("trajopt: planning it")


def test_a_braking_that_a_limit_forbids_is_not_solved(run):
    """At −1 rad the falling velocity is √(2·1.5·2.2) − 0.1 = 2.47 rad/s; the rest is lawful."""
    text = """
waypoints = [[-1], [1]]
angle_unit = "rad"
start_velocity = [3.0]
[limits]
velocity = [1]
acceleration = [5]
falling_velocity = {offset = [0.1], deceleration = [1.5], position = [[-2, 1.2]]}
"""
    code, out, _ = run("plan p.toml --brake-first --json", p__toml=text)
    found = json.loads(out)
    assert (code, found["status"], found["certified_duration"]) == (1, "invalid", None)
    assert "falling velocity" in found["message"]
