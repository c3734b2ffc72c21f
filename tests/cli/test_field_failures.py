"""Files and questions of others that once got a wrong answer, each with its right value."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from trajopt import Limits, Problem
from trajopt.core.exceptions import InvalidInput


def robot(joints, attributes=""):
    return f'<robot name="r"{attributes}><link name="a"/><link name="b"/>{joints}</robot>'


def joint(name, limit, more=""):
    inner = f'<parent link="a"/><child link="b"/><limit {limit}/>{more}'
    return f'<joint name="{name}" type="revolute">{inner}</joint>'


PLAIN = 'lower="-3.14" upper="3.14" velocity="2" effort="10"'


def quintic(t):
    s = t / t[-1]
    return 10 * s**3 - 15 * s**4 + 6 * s**5, (30 * s**2 - 60 * s**3 + 30 * s**4) / t[-1]


# --- FT4-01, FT4-02: every limit is read ---


def test_lower_sides_of_a_joint_limits_yaml(run):
    own = "{min_velocity: -2, max_velocity: 3, min_acceleration: -1, max_acceleration: 4}"
    text = f"joint_limits: {{q1: {own}, q2: {own}}}"
    line = "plan l.csv --limits l.yaml --unit rad --json"
    code, out, _ = run(line, l__yaml=text, l__csv="q1,q2\n0,0\n1,-0.5\n")
    v = np.sqrt(2 / (1 / 4 + 1 / 1))  # h = v² (1/4 + 1) / 2 and T = v (1/4 + 1)
    assert code == 0
    assert json.loads(out)["certified_duration"] == pytest.approx(v * 1.25, rel=1e-8)


def test_a_motion_beyond_the_lower_sides(run):
    own = "{min_velocity: -0.3, max_velocity: 3, min_acceleration: -1, max_acceleration: 4}"
    times = np.linspace(0, 2, 21)
    q, v = quintic(times)
    rows = np.column_stack([times, q, -q / 2, v, -v / 2])
    header = "time [s],q1 [rad],q2 [rad],q1 [rad/s],q2 [rad/s]\n"
    text = header + "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    limits = f"joint_limits: {{q1: {own}, q2: {own}}}"
    code, out, _ = run("verify m.csv --limits l.yaml --json", m__csv=text, l__yaml=limits)
    found = json.loads(out)["certificate"]
    assert code == 1
    # peaks of the quintic: 1.875 h / T and 10 / sqrt(3) h / T², which cubic pieces blur
    assert found["velocity"] == {"ratio": pytest.approx(0.46875 / 0.3), "joint": 2, "time": 1.0}
    assert found["acceleration"]["ratio"] == pytest.approx(10 / 4 / np.sqrt(3), rel=5e-2)
    assert found["acceleration"]["joint"] == 1


VERSION_1_2 = robot(
    joint("j1", PLAIN + ' acceleration="1.0" deceleration="1.0" jerk="20"')
    + joint("j2", PLAIN + ' acceleration="1.0" jerk="20"'),
    ' version="1.2"',
)


@pytest.mark.parametrize("more", ["", " --acceleration 4"])
def test_limits_of_a_urdf_of_version_1_2(run, more):
    line = f"plan j.csv --urdf u.urdf --unit rad --json{more}"
    code, out, err = run(line, u__urdf=VERSION_1_2, j__csv="j1,j2\n0,0\n1,-0.5\n")
    v = (np.sqrt(0.05**2 + 4) - 0.05) / 2  # v (v / a + a / j) = h, T = 2 (v / a + a / j)
    assert code == 0
    assert json.loads(out)["certified_duration"] == pytest.approx(2 * (v + 0.05), rel=1e-7)
    assert ("has no effect" in err) == bool(more)


def test_a_motion_beyond_the_limits_of_such_a_urdf(run):
    text = "time [s],j1 [rad],j2 [rad],j1_velocity [rad/s],j2_velocity [rad/s]\n"
    text += "0,0,0,0,0\n0.5,0.5,-0.25,1.5,-0.75\n1,1,-0.5,0,0\n"
    code, out, _ = run("verify j.csv --urdf u.urdf --json", u__urdf=VERSION_1_2, j__csv=text)
    assert code == 1
    assert json.loads(out)["certificate"]["acceleration"]["ratio"] == pytest.approx(6.0)


# --- FT4-03 to FT4-06: what other programs put into a URDF ---


# --- FT4-07: digits are no motion ---


@pytest.mark.parametrize(
    ("rate", "unit", "decimals", "raw"),
    [(500, "rad", 4, 18.746286), (100, "rad", 4, 1.413871), (1000, "deg", 3, 19.204272)],
)
def test_digits_of_a_log_are_not_taken_for_motion(run, rate, unit, decimals, raw):
    times = np.arange(2 * rate + 1) / rate
    q, _ = quintic(times)
    size = 1 if unit == "rad" else 180 / np.pi
    rows = [
        f"{t!r},{size * a:.{decimals}f},{-size * a / 2:.{decimals}f}"
        for t, a in zip(times.tolist(), q, strict=True)
    ]
    text = f"time [s],q1 [{unit}],q2 [{unit}]\n" + "\n".join(rows)
    own = "{max_velocity: 2, max_acceleration: 4}"
    limits = f"joint_limits: {{q1: {own}, q2: {own}}}"
    line = "verify m.csv --limits l.yaml --interpolation spline --json"
    code, out, _ = run(line, m__csv=text, l__yaml=limits)
    found = json.loads(out)["evidence"]
    assert (code, found["verdict"]) == (0, "kept")
    assert found["acceleration"]["spline"] == pytest.approx(raw, rel=1e-4)
    assert found["velocity"]["at_least"] <= 0.46875 * (1 + 1e-6)  # 1.875 h / T of 2
    assert found["acceleration"]["at_least"] <= 10 / np.sqrt(3) / 4 / 4 * (1 + 1e-6)
    assert found["velocity"]["uses"] == pytest.approx(0.46875, rel=0.01)


def with_velocities(v_decimals, filtered=0.0):
    """The same motion at 125 Hz, in four decimals, with velocities, perhaps late by seconds."""
    times = np.arange(251) / 125
    q, _ = quintic(times)
    _, v = quintic(np.append(np.clip(times - filtered, 0, 2), 2.0))
    rows = [
        f"{t!r},{a:.4f},{-a / 2:.4f},{b:.{v_decimals}f},{-b / 2:.{v_decimals}f}"
        for t, a, b in zip(times.tolist(), q, v[:-1], strict=True)
    ]
    return "time [s],q1 [rad],q2 [rad],q1 [rad/s],q2 [rad/s]\n" + "\n".join(rows)


def test_a_log_with_velocities_is_told_by_both(run):
    line = "verify m.csv --limits l.yaml --json"
    own = "{max_velocity: 2, max_acceleration: 4}"
    limits = f"joint_limits: {{q1: {own}, q2: {own}}}"
    code, out, _ = run(line, m__csv=with_velocities(4), l__yaml=limits)
    found = json.loads(out)["evidence"]
    assert (code, found["verdict"], found["by_positions"]) == (0, "kept", None)
    # The acceleration of the quintic is 10/√3 h / T² = 0.3608 of 4; cubic pieces have 2.6375.
    assert 0.35 < found["acceleration"]["at_least"] <= 10 / np.sqrt(3) / 4 / 4 * (1 + 1e-6)
    assert found["velocities_left_out"] == [None, None]
    code, out, _ = run(f"{line} --interpolation cubic")
    assert json.loads(out)["certificate"]["acceleration"]["ratio"] == pytest.approx(2.6375)
    code, out, _ = run(f"{line} --interpolation spline")
    alone = json.loads(out)["evidence"]["acceleration"]
    assert alone["at_least"] < found["acceleration"]["at_least"] < alone["uses"]


@pytest.mark.parametrize(
    "late", [0.004, 0.012, 0.03, 3.0]
)  # s: after 2 s the joint rests, all are zero
def test_velocities_that_are_not_those_of_the_positions_are_left_out(run, late):
    own = "{max_velocity: 2, max_acceleration: 4}"
    files = {
        "m__csv": with_velocities(4, filtered=late),
        "l__yaml": f"joint_limits: {{q1: {own}, q2: {own}}}",
    }
    code, out, _ = run("verify m.csv --limits l.yaml", **files)
    text = " ".join(out.split())
    assert (code, "m.csv within l.yaml: kept" in text) == (0, True)
    reason = re.search(r"The velocities are left out: they are (.*?)\.(?!\d)", text)[1]
    assert reason in ("not those of the positions at these times", "always the same")


# --- FT4-08: a jump that the next limit bridges in a microsecond hides nothing ---


def test_a_positions_only_log_of_a_jerk_limited_arm_gets_its_slow_down(run):
    times = np.arange(1001) / 1000
    share, _ = quintic(times)
    still = (0, -0.785, 0, -2.356, 0, 1.571, 0.785)
    table = np.tile(still, (1001, 1))
    table[:, 0] = np.pi / 4 * (2 * share - 1)
    names = ",".join(f"fr3_joint{i} [rad]" for i in range(1, 8))
    rows = ["time [s]," + names]
    rows += [
        ",".join(map(repr, [t, *q])) for t, q in zip(times.tolist(), table.tolist(), strict=True)
    ]
    line = "verify khz.csv --robot franka-fr3 --interpolation spline --json"
    code, out, _ = run(line, khz__csv="\n".join(rows))
    slower = 1.875 * np.pi / 2 / 2.62  # the quintic's peak over the limit
    assert code == 1
    found = json.loads(out)["evidence"]
    assert found["conviction"]["limit"] == "velocity"
    assert found["conviction"]["at_least"] == pytest.approx(slower, rel=1e-4)
    assert json.loads(out)["certified_duration"] == pytest.approx(slower, rel=1e-4)


def test_a_larger_jump_is_no_motion_and_the_slow_down_is_said_beside_it(run):
    text = "time [s],j [rad],j [rad/s]\n0,0,0\n0.5,0.5,1.5\n1,1,0.001\n"
    problem = 'waypoints = [[0], [1]]\nangle_unit = "rad"\njoint_names = ["j"]\n'
    problem += "[limits]\nvelocity = [1]\nacceleration = [9]\n"
    code, out, _ = run("verify m.csv --limits p.toml", m__csv=text, p__toml=problem)
    text = " ".join(out.split())
    assert code == 1
    assert "Slowing down does not help: j at 1 s: velocity jumps by 0.001 rad/s." in text
    assert "Besides, its limits need it 1.5" in text


# --- the FR3: a motion that breaks a limit is no file, unless it is asked for ---


def test_a_motion_that_breaks_the_arms_own_limits_is_not_written(run):
    """`two`'s joint may move at √(2·1·x) − 0.1 at a distance x from 1.05 rad: not at all at 1.048.

    Nearer by 1.05 − 1 it may, and the motion is slowed down as far as that needs.
    """
    own = '<position_based_velocity_limits velocity_offset="0.1" deceleration_limit="1"/>'
    limit = 'lower="-3" upper="1.05" velocity="2" effort="1"'
    text = robot(joint("two", limit, own))
    files = {"r__urdf": text, "w__csv": "two\n0\n1.048\n"}
    line = "plan w.csv --urdf r.urdf --acceleration 4 --unit rad --planner exact --out m.csv"
    code, out, err = run(line, **files)
    assert code == 1
    assert not Path("m.csv").exists()
    assert "m.csv is not written: the motion breaks falling velocity limits" in err
    assert re.search(r"falling velocity +no motion allowed +two", out)
    assert "keeps every limit" not in out
    assert run(f"{line} --force", **files)[0] == 1  # overwrites, and nothing else
    assert not Path("m.csv").exists()
    code, out, _ = run(f"{line} --out-anyway", **files)
    assert code == 0
    assert Path("m.csv").exists()
    assert "it keeps every other limit" in " ".join(out.split())
    code, out, _ = run(f"{line} --force", **{**files, "w__csv": "two\n0\n1\n"})
    assert (code, "keeps every limit" in " ".join(out.split())) == (0, True)
    code, out, _ = run("verify m.csv --urdf r.urdf --acceleration 4")
    assert code == 0
    slow = {**files, "w__csv": "two\n-2.9\n-2.8\n"}
    code, out, _ = run(f"{line} --force", **slow)
    assert (code, "keeps every limit" in " ".join(out.split())) == (0, True)


# --- FT4-09 to FT4-15, FT4-23, FT4-24: tables as people have them, and suggestions ---


def verdict(run, command, text):
    """The exit code, the worst uses, and the errors of a motion."""
    code, out, err = run(f"{command} --json", log__csv=text)
    uses = {}
    if out:
        certificate = json.loads(out)["certificate"]
        uses = {kind: certificate[kind]["ratio"] for kind in ("velocity", "acceleration")}
    return code, uses, err


def steps(header, size=1.0, times=(0, 0.5, 1), more=("", "", "")):
    """q1 from 0 to 1 rad, q2 half of it backwards, on straight lines: 1 and 0.5 rad/s."""
    rows = [header]
    for time, share, end in zip(times, (0, 0.5, 1), more, strict=True):
        rows.append(f"{time},{share * size!r},{-share / 2 * size!r}{end}")
    return "\n".join(rows) + "\n"


DEG = 180 / np.pi
OWN = "{max_velocity: 2, max_acceleration: 4}"
TWO = f"joint_limits: {{q1: {OWN}, q2: {OWN}}}"
# What provokes a suggestion or a refusal, and the true velocity of q1 as a share of 2 rad/s.
PROVOKING = {
    "FT4-10, units behind names": (steps("time_s,q1_deg,q2_deg", DEG), 0.5),
    "FT4-11, no times": ("q1,q2\n0,0\n0.1,-0.05\n0.2,-0.1\n", None),
    "FT4-12, a name twice": (steps("time [s],q1 [rad],q1 [rad]"), None),
    "FT4-13, an index": (
        "Pt,Time [ms],q1 [rad],q2 [rad]\n0,0,0,0\n1,500,0.5,-0.25\n2,1000,1,-0.5\n",
        0.5,
    ),
    "no unit of angles": (steps("time [s],q1,q2"), 0.5),
    "no unit of angles, with a gripper": (
        steps("time [s],q1,q2,finger_joint1", more=(",0.01", ",0.02", ",0.03")),
        0.5,
    ),
    "milliseconds said, no unit of angles": (steps("time [ms],q1,q2", times=(0, 500, 1000)), 0.5),
    "milliseconds in the name": (steps("time_ms,q1,q2", times=(0, 500, 1000)), 0.5),
    "no header": ("0,0,0\n0.5,0.5,-0.25\n1,1,-0.5\n", None),
    "another clock": (steps("clock,q1,q2"), 0.5),
    "FT4-14, UTF-16 with tabs": (
        steps("time [s],q1 [rad],q2 [rad]").replace(",", "\t").encode("utf-16"),
        0.5,
    ),
    "FT4-15, a preamble": (
        "Robot: two-joint\nRate: 10 Hz\n\n" + steps("time [s],q1 [rad],q2 [rad]"),
        None,
    ),
    "FT4-23, LeRobot": (
        "timestamp,frame_index,action.q1.pos,action.q2.pos,observation.state.q1.pos,"
        "observation.state.q2.pos\n0,0,0,0,9,9\n0.5,1,0.5,-0.25,8,8\n1,2,1,-0.5,9,9\n",
        0.5,
    ),
}


@pytest.mark.parametrize("case", PROVOKING)
def test_whoever_follows_a_suggestion_gets_the_truth_or_a_refusal(run, case):
    text, truth = PROVOKING[case]
    Path("l.yaml").write_text(TWO)
    command = "verify log.csv --limits l.yaml"
    code, uses, err = verdict(run, command, text)
    if "rename the columns of log.csv: " in err:
        header = err.partition("rename the columns of log.csv: ")[2]
        lines = text.splitlines()
        number = [line[:1] in "0123456789-" for line in lines].index(True)
        text = "\n".join([header, *lines[number:]])
        code, uses, err = verdict(run, command, text)
    if truth is None:
        assert code == 2 or uses["velocity"] == pytest.approx(0.5)
    elif code == 2:
        assert "expected" in err
    else:
        assert uses["velocity"] == pytest.approx(truth)


GERMAN = "Zeit [s];Achse1 [°];Achse2 [°]\n0;0,0;0,0\n0,5;28,6;-14,3\n1;57,3;-28,6\n"


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig", "utf-16"])
def test_a_german_sheet_in_excel_s_encodings(run, encoding):
    """FT4-14; numbered columns are the robot's joints, which are numbered too."""
    Path("l.yaml").write_text(TWO)
    code, uses, err = verdict(run, "verify log.csv --limits l.yaml", GERMAN.encode(encoding))
    if encoding == "cp1252":
        words = "byte 18 is not text in UTF-8; save it as UTF-8, in Excel as 'CSV UTF-8'"
        assert (code, words in err) == (2, True)
    else:
        assert uses["velocity"] == pytest.approx(0.5, abs=1e-3)
    Path("l.yaml").write_text(TWO.replace("q1", "shoulder").replace("q2", "elbow"))
    code, _, err = verdict(run, "verify log.csv --limits l.yaml", GERMAN.encode("utf-8"))
    words = "joint_names is ['Achse1', 'Achse2']: expected joints of l.yaml"
    assert (code, words in err) == (2, True)


@pytest.mark.parametrize("case", ["FT4-10", "FT4-13", "FT4-14", "FT4-23"])
def test_what_is_read_as_it_stands(run, case):
    Path("l.yaml").write_text(TWO)
    own = next(text for name, (text, _) in PROVOKING.items() if name.startswith(case))
    unit = " --unit rad" if case == "FT4-23" else ""
    code, uses, err = verdict(run, f"verify log.csv --limits l.yaml{unit}", own)
    assert code == 0  # one speed all the way: how it begins and ends is a fact
    assert uses["velocity"] == pytest.approx(0.5)
    assert ("what was commanded is read" in err) == (case == "FT4-23")


def test_a_policy_s_stream_gets_the_excess_of_each_joint_and_a_lawful_motion(run):
    """LeRobot: commands at 30 Hz in degrees, q1 at twice its acceleration limit, q2 at less."""
    times = np.arange(61) / 30
    share, _ = quintic(times)
    header = "timestamp,frame_index,action.q1.pos,action.q2.pos,observation.state.q1.pos,"
    rows = [header + "observation.state.q2.pos"]
    for frame, (t, s) in enumerate(zip(times.tolist(), share, strict=True)):
        rows.append(f"{t!r},{frame},{DEG * s:.4f},{-DEG * s / 4:.4f},{DEG * s:.1f},0")
    least = float(10 / np.sqrt(3) / 4 / 2)  # half of what q1 uses
    own = f"{{max_velocity: 2, max_acceleration: {least!r}}}"
    limits = f"joint_limits: {{q1: {own}, q2: {own}}}"
    line = "verify s.csv --limits l.yaml --unit deg --out lawful.csv --json"
    code, out, err = run(line, s__csv="\n".join(rows), l__yaml=limits)
    found = json.loads(out)["evidence"]
    assert (code, found["verdict"]) == (1, "broken")
    assert "what was commanded is read" in err
    assert [own["joint"] for own in found["convictions"]] == [1]
    first, second = found["acceleration"]["by_joint"]
    assert (first, second) == (pytest.approx(2, rel=0.03), pytest.approx(0.5, rel=0.03))
    assert found["slower"]["factor"] == pytest.approx(np.sqrt(2), rel=0.03)
    assert found["slower"]["at_least"] <= np.sqrt(2)
    code, out, _ = run("verify lawful.csv --limits l.yaml --json")
    assert (code, json.loads(out)["feasible"]) == (0, True)
    assert json.loads(out)["duration"] == pytest.approx(2 * found["slower"]["factor"])


PLAN_JOINTS = [f"panda_joint{i}" for i in range(1, 8)]
PLAN_JOINTS += ["panda_finger_joint1", "panda_finger_joint2"]
PLAN = f"""time_from_start,{",".join(PLAN_JOINTS)}
0,1.01652,0.782749,1.87932,-1.96894,-0.738131,1.64453,-2.41761,0.00210446,5.3741e-05
0.193732,1.05995,0.85268,1.9164,-1.94795,-0.80967,1.57987,-2.41329,0.00210446,5.3741e-05
0.303629,1.10338,0.92261,1.95349,-1.92696,-0.88121,1.51521,-2.40897,0.00210446,5.3741e-05
0.389133,1.14681,0.992541,1.99058,-1.90597,-0.95275,1.45054,-2.40464,0.00210446,5.3741e-05
0.462744,1.19024,1.06247,2.02767,-1.88498,-1.02429,1.38588,-2.40032,0.00210446,5.3741e-05
"""


def test_a_gripper_beside_the_arm_is_left_out(run):
    """FT4-09."""
    line = "verify m.csv --robot franka-panda --unit rad --interpolation spline --json"
    code, out, err = run(line, m__csv=PLAN)
    assert code in (0, 1)
    assert (
        "left out, as the robot has no such joint: panda_finger_joint1, panda_finger_joint2" in err
    )
    from scipy.interpolate import CubicSpline

    rows = np.array([list(map(float, row.split(","))) for row in PLAN.splitlines()[1:]])
    spline = CubicSpline(rows[:, 0], rows[:, 1:8], bc_type="clamped")
    bends = np.abs(spline(rows[:, 0], 2)) / [15, 7.5, 10, 12.5, 15, 20, 20]
    assert json.loads(out)["certificate"]["acceleration"]["ratio"] == pytest.approx(bends.max())
    _, _, err = run("verify m.csv --robot franka-panda", m__csv=PLAN)
    assert "panda_joint7 [rad],panda_finger_joint1 [-],panda_finger_joint2 [-]" in err
    _, _, err = run(line, m__csv=PLAN.replace("panda_joint7", "panda_joint77"))
    assert "panda_joint7" in err
    assert "expected joints of franka-panda" in err


# --- FT4-22: MATLAB's polynomials and logs of /joint_states ---

PP = """{"form": "pp", "breaks": [0, 5, 10], "coefs": [
 [-0.016755160819145562, 0.12566370614359174, 0.0, 0.3490658503988659],
 [0.0153588974175501, -0.11519173063162574, 0.0, 1.3962634015954636]],
 "pieces": 2, "order": 4, "dim": 1}"""


def test_matlab_s_polynomials(run):
    """Cubics of 60 and -55 deg in 5 s, at rest at their ends: 1.5 h / T and 6 h / T²."""
    limits = "joint_limits: {j: {max_velocity: 1, max_acceleration: 1}}"
    code, out, _ = run("verify m.json --limits l.yaml --json", m__json=PP, l__yaml=limits)
    found = json.loads(out)["certificate"]
    h = 1.3962634015954636 - 0.3490658503988659
    assert code == 0
    assert found["velocity"]["ratio"] == pytest.approx(1.5 * h / 5)
    assert found["acceleration"]["ratio"] == pytest.approx(6 * h / 25)
    _, _, err = run(
        "verify m.json --limits l.yaml", m__json=PP.replace("[0, 5, 10]", "[0, 5, 10, 15]")
    )
    assert "m.json" in err


def test_a_log_of_joint_states(run):
    message = """header: {{stamp: {{sec: {sec}, nanosec: {nano}}}, frame_id: ''}}
name: [shoulder_pan_joint, shoulder_lift_joint]
position: [{q}, -1.57]
velocity: [0.0, 0.0]
effort: [0.0, 0.0]
---
"""
    text = message.format(sec=1700000010, nano=950000000, q=0.0)
    text += message.format(sec=1700000011, nano=50000000, q=0.1)
    line = "verify m.yaml --robot ur5e --json"
    names = "shoulder_pan_joint: {max_velocity: 3, max_acceleration: 80}, shoulder_lift_joint: "
    limits = f"joint_limits: {{{names} {{max_velocity: 3, max_acceleration: 80}}}}"
    code, out, _ = run("verify m.yaml --limits l.yaml --json", m__yaml=text, l__yaml=limits)
    found = json.loads(out)
    assert code == 0
    assert found["duration"] == pytest.approx(0.1)
    assert found["certificate"]["velocity"]["ratio"] == pytest.approx(1.5 / 3)
    assert found["certificate"]["acceleration"]["ratio"] == pytest.approx(60 / 80)
    wrong = text.replace("[0.1, -1.57]", "[0.1]")
    code, _, err = run(line, m__yaml=wrong)
    assert (code, "message 2: position is [0.1]: expected 2 numbers" in err) == (2, True)


# --- FT4-16 to FT4-20: what is not here is named, with what is nearest ---


def test_arguments_that_nobody_has():
    limits = Limits([1.0], [1.0])
    with pytest.raises(TypeError, match="Problem takes no colour: it has waypoints, limits"):
        Problem([[0.0], [1.0]], limits, colour=1)
    with pytest.raises(TypeError, match="in this tool; the nearest is start_velocity,"):
        Problem([[0.0], [1.0]], limits, current_velocity=1)
    for names in ("max_velocity", "velocity_limits", "v_max"):
        with pytest.raises(InvalidInput, match=f"limits.{names}: expected this left out"):
            Limits(**{names: [1.0], "acceleration": [1.0]})
    with pytest.raises(InvalidInput, match=r"limits\.velocity: expected this limit; it is missing"):
        Limits(acceleration=[1.0])
    with pytest.raises(InvalidInput, match="torques have a name of their own in this tool"):
        Limits([1.0], [1.0], max_torque=[3.0])
