"""Every command asks in one way, names a wrong file for what it is, and says what it cannot."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image

from trajopt import InvalidInput, Problem
from trajopt.cli import app as cli
from trajopt.core.out_of_scope import out_of_scope

DOCS = Path(__file__).parents[2] / "docs"
RECORDS = DOCS.parent / "data" / "best_known"
ROBOT = "--urdf robot.urdf --limits limits.yaml"
URDF = """<?xml version="1.0"?><robot name="r"><joint name="one" type="revolute">
<limit lower="-3" upper="3" velocity="1"/></joint></robot>"""
TWO_JOINTS = """<?xml version="1.0"?><robot name="r"><joint name="one" type="revolute">
<limit lower="-3" upper="3" velocity="1"/></joint><joint name="two" type="revolute">
<limit lower="-3" upper="3" velocity="1"/></joint></robot>"""
HALVES = {"default_velocity_scaling_factor": 0.5, "default_acceleration_scaling_factor": 0.5}
FACTORS = "".join(f"{key}: {value}\n" for key, value in HALVES.items())
LIMITS = "joint_limits:\n  one: {max_acceleration: 2}\n"
MESSAGE = """joint_names: [one]
points:
- {positions: [0.0], velocities: [0.0], time_from_start: {sec: 0, nanosec: 0}}
- {positions: [1.0], velocities: [0.0], time_from_start: {sec: 3, nanosec: 0}}
"""
PROBLEM = """waypoints = [[0.0], [1.0]]
angle_unit = "rad"
limits = { velocity = [1.0], acceleration = [2.0] }
"""


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a command in a folder with one file of each kind: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    texts = {
        "w.csv": "one\n0\n1\n",
        "w.json": '{"waypoints": [[0], [1]]}',
        "robot.urdf": URDF,
        "limits.yaml": LIMITS,
        "motion.yaml": MESSAGE,
        "motion.csv": "time [s],one [rad],one [rad/s]\n0,0,0\n3,1,0\n",
        "cell.toml": PROBLEM,
        "other.toml": "[project]\nname = 'x'\n",
        "other.json": '{"a": [1, 2]}',
        "other.yaml": "services:\n  web: {image: nginx}\n",
        "script.py": "import numpy as np\n",
        "page.md": "# A page\n\n```python\nimport numpy as np\n```\n",
        "page.html": "<!DOCTYPE html><html><body><svg></svg></body></html>",
        "empty.csv": "",
        "empty.toml": "",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["numbers"] = [1, 2]
    Image.new("RGB", (4, 4)).save(tmp_path / "picture.png")
    np.save(tmp_path / "w.npy", np.zeros((2, 1)))
    (tmp_path / "folder").mkdir()

    def command(line):
        with pytest.raises(SystemExit) as stop:
            cli.main(shlex.split(line))
        out, err = capsys.readouterr()
        return stop.value.code, out, err

    return command


# --- items that every command reads ---


@pytest.mark.parametrize("waypoints", ["w.csv", "w.json", "w.npy"])
@pytest.mark.parametrize("command", ["prove {}", "explain {} --planner ruckig-stop"])
def test_waypoints_with_a_urdf_and_limits(run, command, waypoints):
    """One joint from rest to rest over 1 rad at 1 rad/s and 2 rad/s² takes 1/1 + 1/2 s."""
    if waypoints == "w.npy":
        np.save("w.npy", [[0.0], [1.0]])
    code, out, _ = run(f"{command.format(waypoints)} {ROBOT} --json")
    found = json.loads(out)
    assert code == 0
    known = found["lower_bound"] if "prove" in command else found["certified_duration"]
    assert known == pytest.approx(1.5, rel=1e-4)


def test_compare_reads_waypoints_beside_names(run):
    code, out, err = run(f"compare one-joint w.csv {ROBOT} --planner ruckig-stop --output out")
    assert (code, err.count("ruckig")) == (0, 0)
    assert "w: certified durations" in out
    assert "1.5000" in out
    code, _, err = run("compare --suite six-axis --robot ur5e")
    assert code == 2
    assert "expected no such flag with --suite" in err


def test_scaling_factors_count_in_every_command_that_plans(run):
    """At half the velocity and half the acceleration: 1/0.5 + 0.5/1."""
    Path("limits.yaml").write_text(FACTORS + LIMITS, encoding="utf-8")
    for command in ("plan", "prove", "explain --planner ruckig-stop"):
        _, out, err = run(f"{command} w.csv {ROBOT} --json")
        found = json.loads(out)
        known = found["upper_bound"] if command == "prove" else found["certified_duration"]
        assert known == pytest.approx(2.5, rel=1e-4), command
        assert err.count("planned with 50 % of the velocity and 50 %") == 1
    _, _, err = run(f"new scaled.toml w.csv {ROBOT}")
    assert "its default scaling factors (velocity 0.5, acceleration 0.5) are not applied" in err
    assert Problem.from_toml("scaled.toml").limits.velocity[0, 1] == 1.0


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
    assert "waypoints are missing: expected a file" in run("new mine --robot ur5e")[2]


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

KINDS = {
    "w.csv": "a CSV of waypoints",
    "w.json": "a JSON file of waypoints",
    "w.npy": "a NumPy array",
    "robot.urdf": "a URDF",
    "limits.yaml": "a joint_limits.yaml",
    "motion.yaml": "a ROS message",
    "motion.csv": "a CSV of a motion",
    "cell.toml": "a problem file",
    "other.toml": "a TOML file of another kind",
    "other.json": "a JSON file of another kind",
    "other.yaml": "a YAML file of another kind",
    "script.py": "a Python file",
    "page.md": "a Markdown file",
    "page.html": "an HTML page",
    "empty.csv": "an empty file",
    "empty.toml": "an empty file",
    "other.h5": "an HDF5 file",
    "picture.png": "a picture",
    "folder": "a folder",
}
PROBLEMS = "problem file (.toml), a built-in name, or waypoints: give limits with --urdf, --limits"
STATED = "expected a problem file (.toml), which `trajopt new` writes, or a built-in name"
MOTIONS = "expected a motion: a CSV with a column of times, a ROS message, arrays"
RESULTS = "expected results: a folder that `trajopt compare` has filled, or its results.h5"
# Each command with a file, what it expects, and the files that are not wrong there.
COMMANDS = {
    "plan {}": (PROBLEMS, {"cell.toml"}),
    "prove {}": (PROBLEMS, {"cell.toml"}),
    "explain {} --planner exact": (PROBLEMS, {"cell.toml"}),
    "compare {}": (PROBLEMS, {"cell.toml"}),
    "judge motion.csv {}": (PROBLEMS, {"cell.toml"}),
    "new x.toml {}": (PROBLEMS, {"cell.toml"}),
    "claims {}": (STATED, {"cell.toml"}),
    "best-known list {}": (STATED, {"cell.toml"}),
    "best-known verify {}": (STATED, {"cell.toml"}),
    "judge {} cell.toml": (MOTIONS, {"motion.csv", "motion.yaml"}),
    "compare cell.toml --motion {}": (MOTIONS, {"motion.csv", "motion.yaml"}),
    "plan w.csv --urdf {}": ("expected a URDF behind --urdf", {"robot.urdf"}),
    "plan w.csv --limits {}": ("expected a joint_limits.yaml behind --limits", {"limits.yaml"}),
    "export {} --to csv": (RESULTS, {"other.h5", "folder"}),
    "report {}": (RESULTS, {"other.h5", "folder"}),
}


@pytest.mark.parametrize("command", ["verify {}", "judge {} six-axis", "report {}"])
def test_an_edited_trial_is_told_as_that(run, tmp_path, command):
    """A record with one digit changed: its seal is broken, and it is no file of waypoints."""
    record = next(RECORDS.glob("six-axis.*.json")).read_text(encoding="utf-8")
    edited = tmp_path / "edited.json"
    edited.write_text(record.replace("1.48", "1.47", 1), encoding="utf-8")
    code, out, err = run(command.format(edited))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "edited.json: damaged" in err
    assert "its checksum differs" in err


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", KINDS)
def test_every_wrong_kind_of_file_is_named(run, command, name):
    right, fitting = COMMANDS[command]
    if name in fitting:
        return
    code, out, err = run(command.format(name))
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert f"trajopt: {name} is {KINDS[name]}; " in err
    assert right in err


@pytest.mark.parametrize("name", KINDS)
def test_verify_names_what_is_neither_a_motion_nor_results(run, name):
    if name in ("motion.csv", "motion.yaml", "other.h5"):
        return
    code, _, err = run(f"verify {name} --robot ur5e")
    assert code == 2
    assert f"{name} is {KINDS[name]}; {MOTIONS}" in err
    code, _, err = run(f"verify {name}")
    is_table = Path(name).suffix in (".csv", ".json", ".yaml", ".npy")
    assert code == 2
    assert is_table or name == "folder" or f"{name} is {KINDS[name]}; {RESULTS}" in err


def test_a_file_of_the_right_kind_keeps_its_own_error(run):
    Path("cell.toml").write_text(PROBLEM + "tolerence = 3\n", encoding="utf-8")
    assert "cell.toml: tolerence is 3: expected the key tolerance" in run("plan cell.toml")[2]
    Path("cell.toml").write_text(PROBLEM + "= 3\n", encoding="utf-8")
    assert (
        "cell.toml: problem cannot be read (Invalid statement (at line 4"
        in run("plan cell.toml")[2]
    )
    assert "no.toml: it does not exist: expected a file that is there" in run("plan no.toml")[2]


def test_a_problem_and_a_motion_in_the_wrong_order(run):
    code, _, err = run("judge cell.toml motion.csv")
    assert code == 2
    assert err.startswith("trajopt: motion.csv is a CSV of a motion; expected a problem file")
    assert err.endswith("; `trajopt judge MOTION PROBLEM` takes the motion first\n")


def test_a_problem_is_no_suite(run):
    code, _, err = run("compare --suite robots-ur5e-w4")
    assert code == 2
    right = "the name of a suite; this is a problem's, which goes without --suite"
    assert err == f"trajopt: suite is 'robots-ur5e-w4': expected {right}\n"


def test_a_toml_file_with_a_byte_order_mark_is_read(run):
    Path("cell.toml").write_bytes(b"\xef\xbb\xbf" + PROBLEM.encode())
    assert Problem.from_toml("cell.toml").waypoints.tolist() == [[0.0], [1.0]]
    assert run("plan cell.toml --planner exact")[0] == 0


# --- what has no effect is said ---


def test_acceleration_is_of_joints_without_one(run):
    _, out, err = run(f"verify motion.yaml {ROBOT} --acceleration 3")
    assert "within robot.urdf, limits.yaml, 3 rad/s² for joints without one: feasible" in out
    assert "--acceleration 3 has no effect: every joint has an acceleration limit already" in err
    _, _, err = run("verify motion.yaml --limits cell.toml --acceleration 3")
    assert "--acceleration 3 has no effect" in err
    assert run("verify motion.yaml --urdf robot.urdf --acceleration 3")[::2] == (0, "")


def test_a_motion_and_its_waypoints_have_units_of_their_own(run):
    """A log in radians beside waypoints in degrees, both without units."""
    Path("log.csv").write_text("time [s],one,one_velocity\n0,0,0\n3,1,0\n", encoding="utf-8")
    Path("deg.csv").write_text(f"one\n0\n{np.degrees(1)}\n", encoding="utf-8")
    judge = f"judge log.csv deg.csv {ROBOT} --unit deg --json"
    compare = f"compare deg.csv {ROBOT} --unit deg --motion log.csv --planner ruckig-stop"
    for line in (judge, compare):
        code, _, err = run(line)
        assert (code, "expected the unit of angles: --motion-unit deg" in err) == (2, True)
        assert run(f"{line} --motion-unit rad")[0] == 0
    assert run("judge log.csv cell.toml --unit rad")[0] == 0
    for line in (f"judge motion.yaml w.csv {ROBOT}", "compare cell.toml --motion motion.yaml"):
        _, _, err = run(f"{line} --motion-unit deg")
        assert "--motion-unit is 'deg': expected no such flag with motion.yaml" in err


LOG = "time,q0,q1,mode,q0_Tq,q1_Tq\n0,0,0,auto,1,2\n0.5,1,1,auto,1,2\n1,2,2,auto,1,2\n"
RENAMED = (
    "rename the columns of log.csv: time [s],one [rad],two [rad],mode [-],q0_Tq [-],q1_Tq [-]\n"
)


@pytest.mark.parametrize("limits", ["--urdf robot.urdf --acceleration 2", "--limits robot.yaml"])
def test_a_log_is_shown_the_joints_of_the_limits(run, limits):
    """A torque is no position, nor is a column of texts."""
    Path("log.csv").write_text(LOG, encoding="utf-8")
    Path("robot.urdf").write_text(TWO_JOINTS, encoding="utf-8")
    entry = "{max_velocity: 1, max_acceleration: 2}"
    Path("robot.yaml").write_text(f"joint_limits:\n  one: {entry}\n  two: {entry}\n")
    Path("w.csv").write_text("one,two\n0,0\n2,2\n", encoding="utf-8")
    for line in (f"verify log.csv {limits}", f"judge log.csv w.csv {limits}"):
        code, _, err = run(line)
        assert (code, err.count("\n")) == (2, 1)
        assert err.startswith("trajopt: log.csv: header: expected the unit of angles: --")
        assert err.endswith(RENAMED)
    _, header = RENAMED.strip().split(": ")
    Path("log.csv").write_text(header + LOG[LOG.index("\n") :], encoding="utf-8")
    code, out, err = run(f"verify log.csv {limits} --interpolation spline --json")
    assert "log.csv: left out: mode, q0_Tq, q1_Tq\n" in err
    assert json.loads(out)["duration"] == 1


def test_columns_by_number_need_limits_with_an_order(run):
    """`judge` takes them beside the same limits, because the waypoints give the order."""
    Path("log.csv").write_text("t,q0 [rad],q1 [rad]\n0,0,0\n0.5,1,1\n", encoding="utf-8")
    Path("w.csv").write_text("two,one\n0,0\n1,1\n", encoding="utf-8")
    entry = "{max_velocity: 1, max_acceleration: 2}"
    Path("robot.yaml").write_text(f"joint_limits:\n  one: {entry}\n  two: {entry}\n")
    assert run("judge log.csv w.csv --limits robot.yaml")[::2] == (1, "")
    assert run("verify log.csv --limits robot.yaml") == (
        2,
        "",
        "trajopt: log.csv: joint_names is ['q0', 'q1']: expected joints of robot.yaml (it says no "
        "order): one, two; rename them\n",
    )


def test_a_note_goes_with_the_error_that_follows_it(run):
    Path("robot.urdf").write_text(TWO_JOINTS, encoding="utf-8")
    Path("limits.yaml").write_text(f"{LIMITS}  twoo: {{max_velocity: 1}}\n", encoding="utf-8")
    Path("w.csv").write_text("one,two\n0,0\n1,1\n", encoding="utf-8")
    code, _, err = run(f"plan w.csv {ROBOT}")
    assert (code, err.count("\n")) == (2, 1)
    assert "acceleration limit is missing: expected one for two; " in err
    note = "limits.yaml: left out, as robot.urdf has no such joint: twoo (perhaps two)\n"
    assert err.endswith(f"for all of them; {note}")
    assert run(f"plan w.csv {ROBOT} --acceleration 2")[::2] == (0, f"trajopt: {note}")


@pytest.mark.parametrize("name", ["left_joint_1", "joint_0", "two"])
def test_a_message_has_the_robots_names(run, name):
    Path("motion.yaml").write_text(MESSAGE.replace("[one]", f"[{name}]"), encoding="utf-8")
    for line in ("verify motion.yaml", "judge motion.yaml w.csv"):
        code, _, err = run(f"{line} {ROBOT}")
        assert (code, err.count("\n")) == (2, 1)
        assert f"motion.yaml: joint_names is ['{name}']: expected " in err
        assert err.endswith("one; rename them\n")


def test_a_namespace_of_a_message_is_no_other_name(run):
    Path("motion.yaml").write_text(MESSAGE.replace("[one]", "[left/one]"), encoding="utf-8")
    assert run(f"verify motion.yaml {ROBOT}")[0] == 0


def test_what_a_file_of_limits_says_in_vain(run):
    other = "  onne: {max_velocity: 3}\n  gripper: {max_velocity: 3}\n"
    effort = LIMITS.replace("2}", "2, has_effort_limits: true, max_effort: 150}")
    text = f"{effort}{other}cartesian_limits: {{max_trans_vel: 1}}\n"
    Path("limits.yaml").write_text(text, encoding="utf-8")
    code, _, err = run(f"plan w.csv {ROBOT} --out motion.json")
    assert (code, err.count("\n")) == (0, 3)
    assert "limits.yaml: cartesian_limits is left out: of the tool's limits, that" in err
    words = (
        "limits.yaml: efforts, which count where a limit of torque asks for them (--torque urdf)"
    )
    assert words in err
    assert "left out, as robot.urdf has no such joint: onne, gripper" in err
    alone = "joint_limits:\n  onne: {max_velocity: 3}\n  two: {max_velocity: 3}\n"
    Path("limits.yaml").write_text(alone, encoding="utf-8")
    Path("robot.urdf").write_text(TWO_JOINTS, encoding="utf-8")
    assert "no such joint: onne (perhaps one)" in run(f"plan w.csv {ROBOT} --acceleration 2")[2]
    off = effort.replace("true", "false")
    Path("limits.yaml").write_text(off, encoding="utf-8")
    assert run(f"plan w.csv {ROBOT}")[::2] == (0, "")


@pytest.mark.parametrize("rest", ["", "joint_limits: {}\n", "joint_limits:\n"])
def test_factors_alone_go_with_a_robot(run, rest):
    """At half of 1 rad/s and half of 2 rad/s²: 1/0.5 + 0.5/1 s."""
    for text in (f"{FACTORS}{rest}", f"move_group: {{ros__parameters: {json.dumps(HALVES)}}}"):
        Path("limits.yaml").write_text(text, encoding="utf-8")
        _, out, _ = run(f"plan w.csv {ROBOT} --acceleration 2 --json")
        assert json.loads(out)["certified_duration"] == pytest.approx(2.5, rel=1e-6)
        _, _, err = run("plan w.csv --limits limits.yaml")
        assert "at least one joint, or --robot or --urdf beside the scaling factors" in err


def test_judging_says_that_factors_do_not_count(run):
    Path("limits.yaml").write_text(FACTORS + LIMITS, encoding="utf-8")
    for line in ("verify motion.yaml", "judge motion.yaml w.csv"):
        _, _, err = run(f"{line} {ROBOT}")
        assert "(velocity 0.5, acceleration 0.5) are not applied" in err


def test_limits_that_are_switched_off_are_called_that(run):
    off = "joint_limits:\n  one: {has_acceleration_limits: false, max_acceleration: 0}\n"
    Path("limits.yaml").write_text(off, encoding="utf-8")
    _, _, err = run(f"plan w.csv {ROBOT}")
    assert "limit is switched off (has_acceleration_limits: false): expected one for one" in err
    code, _, err = run(f"verify motion.yaml {ROBOT}")
    assert (code, "accelerations are not judged" in err) == (0, True)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("judge motion.yaml limits.yaml", "`trajopt verify MOTION --limits FILE` judges"),
        (
            "verify motion.yaml cell.toml",
            "cell.toml: PATH: expected motions only",
        ),
        ("verify motion.yaml --limits robot.urdf", "is a URDF; expected a joint_limits.yaml"),
        ("plan w.csv --robot panda", "did you mean 'franka-panda'?"),
        ("plan w.csv --robot fr3", "did you mean 'franka-fr3'?"),
        ("plan cell.toml --dt 0.01", "`trajopt plan --cycle`"),
        ("plan cell.toml --format goal", "--as goal"),
        ("plan cell.toml --jerk 50", "max_jerk of a joint_limits.yaml"),
        ("plan cell.toml --velocity=2", "max_velocity, max_acceleration"),
    ],
)
def test_a_wrong_turn_is_shown_the_way(run, line, words):
    code, _, err = run(line)
    assert (code, err.count("\n")) == (2, 1)
    assert words in err


def test_one_number_is_no_limit_of_every_joint(run):
    Path("cell.toml").write_text(PROBLEM.replace("[1.0], a", "1.0, a"), encoding="utf-8")
    assert (
        "a list with a number, or a pair [low, high], for every joint" in run("plan cell.toml")[2]
    )


def test_new_writes_waypoints_in_their_unit(run):
    Path("w.csv").write_text("one\n0\n40.1\n", encoding="utf-8")
    run(f"new deg w.csv {ROBOT} --unit deg")
    table = tomllib.loads(Path("deg.toml").read_text(encoding="utf-8"))
    assert table["waypoints"] == [[0.0], [40.1]]
    assert table["units"] == {"waypoints": "deg", "limits": "rad"}
    assert table["limits"] == {"velocity": [1.0], "acceleration": [2.0], "position": [3.0]}
    assert Problem.from_toml("deg.toml").waypoints[1, 0] == np.radians(40.1)


# --- cannot, and what to do instead ---

ELSEWHERE = {
    "max_torque": "torques have a name of their own",
    "effort_limits": "torques have a name of their own",
    "payload_mass": "masses have places of their own",
    "tcp_speed": "of the tool's limits, that of its speed is",
    "cartesian_velocity": "of the tool's limits, that of its speed is",
    "obstacles": "obstacles are not",
    "collision_objects": "obstacles are not",
    "orientation": "poses of the tool are not",
    "wait": "a wait has a name of its own",
    "dwell_times": "a wait has a name of its own",
    "per_section_minimum_duration": "least times have a name of their own",
    "initial_velocity": "states at the ends have names of their own",
    "final_velocities": "states at the ends have names of their own",
    "segments": "limits of one segment have a place of their own",
    "limits_per_segment": "limits of one segment have a place of their own",
    "speed": "a speed is not asked for",
    "velocity_scaling": "a speed is not asked for",
    "blend_radius": "passing near a waypoint has a name of its own",
    "max_deviation": "passing near a waypoint has a name of its own",
    "durations": "the planner finds the times of",
    "time_from_start": "the planner finds the times of",
    "periodic": "a motion that ends as it begins has a name of its own",
    "margin": "a margin is not asked for",
    "safety_factor": "a margin is not asked for",
}


@pytest.mark.parametrize("name", ELSEWHERE)
def test_foreign_keys_and_options_say_what_comes_nearest(run, name):
    words = ELSEWHERE[name]
    option = f"--{name.replace('_', '-')}"
    for line in (f"plan cell.toml {option} 3", f"compare cell.toml {option}=3"):
        code, _, err = run(line)
        assert (code, err.count("\n")) == (2, 1)
        assert f"trajopt: {option} is no option: {words} " in err
        assert "the nearest" in err
    for text in (f"{name} = 3\n{PROBLEM}", PROBLEM.replace("{ v", f"{{ {name} = 3, v")):
        Path("cell.toml").write_text(text, encoding="utf-8")
        with pytest.raises(InvalidInput, match=f"{name} is 3: expected this key left out: {words}"):
            Problem.from_toml("cell.toml")


@pytest.mark.parametrize(
    ("own", "foreign"),
    [
        ("start_velocity", "current_velocity current_joint_velocities velocity_start sd_start v0"),
        ("end_velocity", "target_velocity target_joint_velocities vel_end sd_end targetVelocity"),
        ("start_acceleration", "current_acceleration initial_acc a_start qdd_start"),
        ("end_acceleration", "target_acceleration final_accel acceleration_end af"),
        ("[[limits.segment]]", "segment_velocity sections per_section_max_velocity section_limits"),
        ("rows of waypoints", "current_position target_joint_positions intermediate_positions"),
        ("scaling factors", "max_velocity_scaling_factor RelativeDynamicsFactor velocity_rel"),
        ("under [limits]", "velocity_limits vlim max_velocity a_max"),
    ],
)
def test_words_of_other_tools_in_any_order_and_spelling_have_the_right_answer(own, foreign):
    """Ruckig's, toppra's, MoveIt's and franky's; `target_…` once was told to be the start."""
    assert not [name for name in foreign.split() if own not in out_of_scope(name)]


@pytest.mark.parametrize("key", ["velocity", "jerk"])
def test_a_limit_beside_the_waypoints_is_told_where_it_goes(key, tmp_path):
    file = tmp_path / "cell.toml"
    file.write_text(f"{key} = [3.0]\n{PROBLEM}", encoding="utf-8")
    with pytest.raises(InvalidInput, match=rf"{key} is .*: expected this key under \[limits\]"):
        Problem.from_toml(file)


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


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("PLAN cell.toml", 'Did you mean "plan"?'),
        ("help Compare", 'Did you mean "compare"?'),
        ("suite SHOW robots", 'Did you mean "show"?'),
        ("suite show ROBOTS", "did you mean 'robots'?"),
        ("plan SIX-AXIS", "did you mean 'six-axis'?"),
        ("plan Robots-UR5E-w4", "did you mean 'robots-ur5e-w4'?"),
        ("plan six-axis --PLANNER exact", 'Did you mean "--planner"?'),
        ("plan six-axis --Planner exact", "Did you mean --planner?"),
        ("plan six-axis --planner TOPPRA", "did you mean 'toppra'?"),
        ("plan w.csv --robot UR5E", "did you mean 'ur5e'?"),
    ],
)
def test_upper_and_lower_case_are_forgiven(run, line, words):
    code, _, err = run(line)
    assert (code, err.count("\n")) == (2, 1)
    assert words in err


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
    code, _, err = run(f"plan w.csv {limits} --tool-speed 0.5 --planner along --out m.json")
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
    code, _, err = run(f"plan w.csv {limits} --link-speed b=0.3 --planner along --out m.json")
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
        code, out, err = run(f"plan w.csv {flags} --torque 50%{more} --planner along --json")
        assert code == 0, err
        told = json.loads(out)
        acceleration = 4 * 2 / torque
        assert told["certified_duration"] == pytest.approx(2 / acceleration**0.5, rel=1e-3)
    # of a joint_limits.yaml, which replaces the URDF's
    Path("limits.yaml").write_text("joint_limits: {one: {max_effort: 1}}", encoding="utf-8")
    code, out, err = run(
        f"plan w.csv {flags} --limits limits.yaml --torque urdf --planner along --json"
    )
    assert json.loads(out)["certified_duration"] == pytest.approx(2 / 0.5**0.5, rel=1e-3)
    code, out, err = run(f"plan w.csv {flags} --torque 4,inf --planner along --json")
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


def test_a_tool_speed_of_joints_without_frames_gets_a_line(run):
    Path("arm.urdf").write_text(ARM.replace('link="b"', 'link="a"'), encoding="utf-8")
    Path("w.csv").write_text("one,two\n0,0\n1,0\n", encoding="utf-8")
    flags = "--urdf arm.urdf --acceleration 2"
    code, _, err = run(f"plan w.csv {flags} --tool-speed 0.5")
    assert (code, err.count("\n")) == (2, 1)
    assert "link frames" in err
    assert "two" in err
    code, _, err = run(f"plan w.csv {flags} --tool-speed 0")
    assert (code, err.count("\n")) == (2, 1)
    assert "--tool-speed" in err
