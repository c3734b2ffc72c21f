"""Files that `new` writes, words of other tools, help and completion, limits of the tool."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest

from trajopt import Problem
from trajopt.cli import app as cli
from trajopt.core.out_of_scope import out_of_scope

DOCS = Path(__file__).parents[2] / "docs"
ROBOT = "--urdf robot.urdf --limits limits.yaml"
FILES = {
    "w.csv": "one\n0\n1\n",
    "robot.urdf": '<robot name="r"><joint name="one" type="revolute">'
    '<limit lower="-3" upper="3" velocity="1"/></joint></robot>',
    "limits.yaml": "joint_limits:\n  one: {max_acceleration: 2}\n",
}


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a command in a folder with these files: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")

    def command(line):
        with pytest.raises(SystemExit) as stop:
            cli.main(shlex.split(line))
        out, err = capsys.readouterr()
        return stop.value.code, out, err

    return command


# --- items that every command reads ---


def test_new_writes_the_problem_of_waypoints(run):
    code, out, _ = run(f"new written w.csv {ROBOT}")
    assert (code, out) == (0, "written.toml: edit it, then run: trajopt plan written.toml\n")
    written = Problem.from_toml("written.toml")
    assert (written.name, written.joint_names) == ("written", ("one",))
    assert written.waypoints.tolist() == [[0.0], [1.0]]
    assert written.limits.acceleration.tolist() == [[-2.0, 2.0]]
    assert written.limits.position.tolist() == [[-3.0, 3.0]]
    right = "a file that is not there yet, or --force to overwrite it"
    assert (
        run(f"new written w.csv {ROBOT}")[2]
        == f"trajopt: NAME is 'written.toml': expected {right}\n"
    )
    words = "and behind it the waypoints that the limits are for"
    assert words in run("new w.csv --robot ur5e")[2]
    Path("scaled.yaml").write_text(f"default_velocity_scaling_factor: 0.5\n{FILES['limits.yaml']}")
    run("new scaled w.csv --urdf robot.urdf --limits scaled.yaml")
    assert Problem.from_toml("scaled.toml").limits.velocity[0, 1] == 1.0  # not scaled


def test_new_keeps_what_only_a_built_in_arm_says(run):
    rows = "0,0,0,-1,0,1,0\n0.1,0,0,-1,0,1,0\n"
    Path("seven.csv").write_text(rows, encoding="utf-8")
    assert run("new franka seven.csv --robot franka-fr3")[0] == 0
    written = Problem.from_toml("franka.toml")
    assert len(written.limits.kinds["falling_velocity"].numbers) == 7
    code, _, err = run("plan franka.toml --planner exact-jerk")
    assert (code, err) == (0, "")
    # An own file may take limits away: the arm's name would bring them back.
    own = "joint_limits:\n  fr3_joint1: {has_jerk_limits: false}\n"
    Path("own.yaml").write_text(own, encoding="utf-8")
    assert run("new less seven.csv --robot franka-fr3 --limits own.yaml")[0] == 0
    less = Problem.from_toml("less.toml").limits
    assert np.isinf(less.jerk[0]).all()
    assert less.others.keys() == {"falling_velocity"}


# --- a file of the wrong kind is named for what it is ---


# --- what has no effect is said ---


def test_new_writes_waypoints_in_their_unit(run):
    Path("w.csv").write_text("one\n0\n40.1\n", encoding="utf-8")
    run(f"new deg w.csv {ROBOT} --unit deg")
    table = tomllib.loads(Path("deg.toml").read_text(encoding="utf-8"))
    assert table["waypoints"] == [[0.0], [40.1]]
    assert table["units"] == {"waypoints": "deg", "limits": "rad"}
    assert table["limits"] == {"velocity": [1.0], "acceleration": [2.0], "position": [3.0]}
    assert Problem.from_toml("deg.toml").waypoints[1, 0] == np.radians(40.1)


# --- cannot, and what to do instead ---


@pytest.mark.parametrize(
    ("own", "foreign"),
    [
        ("start_velocity", "current_velocity current_joint_velocities velocity_start sd_start v0"),
        ("start_velocity", "initial_velocity"),
        ("end_velocity", "target_velocity target_joint_velocities vel_end sd_end targetVelocity"),
        ("end_velocity", "final_velocities"),
        ("start_acceleration", "current_acceleration initial_acc a_start qdd_start"),
        ("end_acceleration", "target_acceleration final_accel acceleration_end af"),
        ("[[limits.segment]]", "segment_velocity sections per_section_max_velocity section_limits"),
        ("[[limits.segment]]", "segments limits_per_segment"),
        ("rows of waypoints", "current_position target_joint_positions intermediate_positions"),
        ("scaling factors", "max_velocity_scaling_factor RelativeDynamicsFactor velocity_rel"),
        ("a speed is not asked for", "relative_dynamics_factor speed velocity_scaling"),
        ("a margin is not asked for", "margin safety_factor"),
        ("under [limits]", "velocity_limits vlim max_velocity min_velocity a_max"),
        ("torques have a name of their own", "max_torque effort_limits"),
        ("masses have places of their own", "payload_mass"),
        ("of the tool's limits, that of its speed is", "tcp_speed cartesian_velocity"),
        ("obstacles are not", "obstacles collision_objects"),
        ("poses of the tool are not", "orientation"),
        ("the nearest is dwell", "wait dwell_times"),
        ("the nearest is least_times", "per_section_minimum_duration minimum_time"),
        ("least_duration and duration (exactly)", "minimum_duration desired_duration"),
        ("the nearest is given_times", "durations time_from_start timepoints"),
        ("the nearest is tolerance", "blend_radius max_deviation"),
        ("closed = true", "periodic"),
    ],
)
def test_words_of_other_tools_in_any_order_and_spelling_have_the_right_answer(own, foreign):
    """Ruckig's, toppra's, MoveIt's and franky's; `target_…` once was told to be the start."""
    assert not [name for name in foreign.split() if own not in out_of_scope(name)]


def test_known_keys_and_options_are_in_scope():
    text = subprocess.run(
        ["git", "grep", "-hoE", "^[a-z_]+ =", "--", "data/problems"],
        capture_output=True,
        text=True,
        cwd=DOCS,
        check=False,
    ).stdout
    known = {line.removesuffix(" =") for line in text.splitlines()}
    options = "--time-limit --timeout --within --points --rate --cycle --seed --via-tolerance"
    assert not [name for name in (*known, *options.split()) if out_of_scope(name)]


# --- help, completion, upper and lower case ---


def test_help_is_a_command(run):
    assert run("help") == run("--help")
    assert run("help compare") == run("compare --help")
    assert run("help best-known list") == run("best-known list --help")
    _, out, err = run("help")
    assert err == ""
    words = " ".join(out.split())
    assert "Not in scope: obstacles, orientation." in words
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_script_is_installed_and_sound(run, tmp_path, monkeypatch, shell):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", f"/bin/{shell}")
    for name in ("XDG_DATA_HOME", "XDG_CONFIG_HOME", "ZSH_CUSTOM", "ZDOTDIR"):
        monkeypatch.delenv(name, raising=False)
    script = cli.app.generate_completion(shell=shell)
    for word in ("compare", "best-known", "planner"):
        assert word in script
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True)
    installed = cli.app.install_completion(shell=shell)
    assert installed.is_relative_to(tmp_path)
    assert installed.read_text(encoding="utf-8") == script


LINE = "along:knots=chord,ends=natural"  # between two waypoints all rules have the same line
ARM = """<robot name="r"><link name="base"/><link name="a"/><link name="b"/><link name="tool"/>
<joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2"/></joint>
<joint name="two" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<origin xyz="0.6 0 0"/><limit lower="-3" upper="3" velocity="2"/></joint>
<joint name="fixed" type="fixed"><parent link="b"/><child link="tool"/>
<origin xyz="0.4 0 0"/></joint></robot>"""


def test_a_tool_speed_on_the_command_line(run):
    """Of waypoints with a URDF, of a robot's problem, and of a motion by limits alone."""
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    Path("w.csv").write_text("one,two\n0,0\n1,0\n", encoding="utf-8")
    limits = "--urdf arm.urdf --acceleration 2"
    code, _, err = run(f"plan w.csv {limits} --tool-speed 0.5 --planner {LINE} --out m.json")
    assert code == 0, err
    # joint one alone turns 1 m about the base: 1 rad at 0.5 rad/s, with 2 rad/s²
    told = json.loads(run(f"verify m.json {limits} --tool-speed 0.5 --json")[1])
    assert told["certificate"]["feasible"]
    assert told["duration"] == pytest.approx(1 / 0.5 + 0.5 / 2, rel=1e-3)
    told = json.loads(run(f"verify m.json {limits} --tool-speed 0.25 --json")[1])
    assert told["dilation"] == pytest.approx(2.0, rel=1e-3)
    shown = run(f"verify m.json {limits} --tool-speed 0.25")[1]
    assert shown.startswith("m.json within arm.urdf, ")
    assert "tool speed 0.25: not feasible" in " ".join(shown.split())
    assert run(f"judge m.json w.csv {limits} --tool-speed 0.25")[0] == 1
    code, out, _ = run("plan robots-crs-a255-w4 --tool-speed 1")
    assert code == 2
    code, out, _ = run("plan robots-ur5e-w4 --tool-speed 1 --planner exact")
    assert (code, "it does not know tool speed limits" in out) == (1, True)


def test_speeds_of_links_on_the_command_line(run):
    """The elbow is 0.6 m from the base; a fixed link behind it is the tool."""
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    Path("w.csv").write_text("one,two\n0,0\n1,0\n", encoding="utf-8")
    limits = "--urdf arm.urdf --acceleration 2"
    code, _, err = run(f"plan w.csv {limits} --link-speed b=0.3 --planner {LINE} --out m.json")
    assert code == 0, err
    told = json.loads(run(f"verify m.json {limits} --link-speed b=0.3,a=1 --json")[1])
    assert told["duration"] == pytest.approx(1 / 0.5 + 0.5 / 2, rel=1e-3)
    code, out, _ = run(f"judge m.json w.csv {limits} --link-speed tool=0.25")
    assert (code, "two at" in out) == (1, True)
    code, _, err = run(f"plan w.csv {limits} --link-speed elbow=0.3")
    assert (code, err.count("\n")) == (2, 1)
    assert "expected a link or joint of the arm: one, two, a, b, tool" in err


def test_torques_on_the_command_line(run):
    """A share of the URDF's efforts, a payload, and a line where there is nothing to weigh."""
    mass = '<inertial><mass value="2"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'
    text = ARM.replace('<link name="tool"/>', f'<link name="tool">{mass}</inertial></link>')
    Path("arm.urdf").write_text(text.replace('velocity="2"', 'velocity="2" effort="8"'))
    Path("w.csv").write_text("one,two\n0,0\n1,0\n", encoding="utf-8")
    flags = "--urdf arm.urdf --acceleration 2"
    # both axes are upright: 2 kg at 1 m, and as much again, with the torque of joint one alone
    for more, torque in (("", 4.0), (" --payload 2", 8.0)):
        code, out, err = run(f"plan w.csv {flags} --torque 50%{more} --planner {LINE} --json")
        assert code == 0, err
        told = json.loads(out)
        acceleration = 4 * 2 / torque
        assert told["certified_duration"] == pytest.approx(2 / acceleration**0.5, rel=1e-3)
    # of a joint_limits.yaml, which replaces the URDF's
    Path("limits.yaml").write_text("joint_limits: {one: {max_effort: 1}}", encoding="utf-8")
    code, out, err = run(
        f"plan w.csv {flags} --limits limits.yaml --torque urdf --planner {LINE} --json"
    )
    assert json.loads(out)["certified_duration"] == pytest.approx(2 / 0.5**0.5, rel=1e-3)
    code, out, err = run(f"plan w.csv {flags} --torque 4,inf --planner {LINE} --json")
    assert json.loads(out)["certified_duration"] == pytest.approx(2 / 2**0.5, rel=1e-3)
    code, _, err = run(f"plan w.csv {flags} --torque 4")
    assert (code, err.count("\n")) == (2, 1)
    assert "expected 2 numbers, N m, one per joint" in err
    code, _, err = run(f"plan w.csv {flags} --payload 2")
    assert (code, err.count("\n")) == (2, 1)
    assert "--payload is 2.0: expected a limit that it weighs on" in err
    Path("arm.urdf").write_text(ARM, encoding="utf-8")
    code, _, err = run(f"plan w.csv {flags} --torque urdf")
    assert (code, err.count("\n")) == (2, 1)
    assert "mass behind two is 0: expected a link with a mass" in err
