"""CSV logs in the shapes that other programs write: one motion, and what must be read of it.

Each text below is made from `POSITIONS` and `VELOCITIES` by an f-string of its own, in the shape of
a program's export; none of them is a copy.
"""

from __future__ import annotations

import json
import re
import warnings

import numpy as np
import pytest
from work import calls, doubling

from trajopt import cli
from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.core.units import asked
from trajopt.formats import arms, samples_csv, waypoints
from trajopt.formats.motion import motion
from trajopt.formats.robot_limits import RobotLimits

# A joint from rest to 1 rad, and one the other way by half of that: q = 3 s² - 2 s³, s = t / 0.4.
TIMES = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
SHARES = 3 * (TIMES / 0.4) ** 2 - 2 * (TIMES / 0.4) ** 3
POSITIONS = np.stack([SHARES, -0.5 * SHARES], axis=1)
RATES = 6 * (TIMES / 0.4) * (1 - TIMES / 0.4) / 0.4
VELOCITIES = np.stack([RATES, -0.5 * RATES], axis=1)


def log(header, row, separator=","):
    """A text of a header and a line per sample; `row` makes the cells of a sample."""
    lines = [header]
    for sample, time in enumerate(TIMES):
        cells = row(sample, time, POSITIONS[sample], VELOCITIES[sample])
        lines.append(separator.join(str(cell) for cell in cells))
    return "\n".join(lines) + "\n"


def degrees(values):
    return np.degrees(values).tolist()


def comma(values):
    return [str(value).replace(".", ",") for value in values]


SHAPES = {
    "plotjuggler": (
        log(
            "__time,/joint_states/elbow/position,/joint_states/elbow/velocity,"
            "/joint_states/elbow/effort,/joint_states/wrist/position,/joint_states/wrist/velocity",
            lambda n, t, q, v: [f"{1714564800 + t:.6f}", q[0], v[0], 7, q[1], v[1]],
        ),
        "rad",
        "times count from 1714564800.000000 s; left out: /joint_states/elbow/effort",
    ),
    "rostopic echo -p": (
        log(
            "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.position0,"
            "field.position1,field.velocity0,field.velocity1,field.effort0,field.effort1",
            lambda n, t, q, v: [f"1714564800{round(t * 10)}00000000", n, n, "base", *q, *v, 0, 0],
        ),
        "rad",
        "times count from 1714564800000000000 ns; left out: field.header.seq, field.header.stamp",
    ),
    "a bag of ROS 2, its stamp in two columns": (
        log(
            "header.stamp.sec,header.stamp.nanosec,header.frame_id,position_0,position_1,"
            "velocity_0,velocity_1,effort_0",
            lambda n, t, q, v: [1714564800, f"{round(t * 10)}00000000", n, *q, *v, 0],
        ),
        "rad",
        "times count from 1714564800.000000000 s; left out: header.frame_id, effort_0",
    ),
    "a bag of ROS 1, its stamp in two columns": (
        log(
            "Time,header.stamp.secs,header.stamp.nsecs,position_0,position_1".replace("Time,", ""),
            lambda n, t, q, v: [12, f"{round(t * 10)}00000000", *q],
        ),
        "rad",
        "times count from 12.000000000 s",
    ),
    "UR's RTDE, a space between cells": (
        log(
            "timestamp actual_q_0 actual_q_1 actual_qd_0 actual_qd_1 actual_TCP_speed_0",
            lambda n, t, q, v: [f"{5021.5 + t:.3f}", *q, *v, 0.25],
            " ",
        ),
        "rad",
        "times count from 5021.500 s; left out: actual_TCP_speed_0",
    ),
    "UR's RTDE, commanded and measured": (
        log(
            "timestamp actual_q_0 actual_q_1 actual_qd_0 actual_qd_1 target_q_0 target_q_1 "
            "target_qd_0 target_qd_1 target_moment_0",
            lambda n, t, q, v: [f"{5021.5 + t:.3f}", *q[::-1], *v[::-1], *q, *v, 0.25],
            " ",
        ),
        "rad",
        "what was commanded is read, not what was measured; left out: actual_q_0, actual_q_1",
    ),
    "a controller's state": (
        log(
            "time,/state/reference/positions[0],/state/reference/positions[1],"
            "/state/feedback/positions[0],/state/feedback/positions[1],/state/error/positions[0],"
            "/state/error/positions[1],/state/reference/velocities[0],"
            "/state/reference/velocities[1]",
            lambda n, t, q, v: [t, *q, 9, 9, 0, 0, *v],
        ),
        "rad",
        "what was commanded is read, not what was measured; left out: /state/feedback/positions[0]",
    ),
    "libfranka, desired and measured": (
        log(
            "time, success_rate, state.q[0], state.q[1],state.q_d[0], state.q_d[1],state.dq[0], "
            "state.dq[1],state.dq_d[0], state.dq_d[1],cmd.q_d[0], cmd.q_d[1],cmd.dq_d[0]",
            lambda n, t, q, v: [round(1000 * t), 1, 9, 9, *q, 9, 9, *v, 0, 0, 0],
        ),
        "rad,ms",
        "what was commanded is read, not what was measured; left out: success_rate, state.q[0]",
    ),
    "libfranka": (
        log(
            "time,success_rate,state.q[0],state.q[1],state.dq[0],state.dq[1],state.tau_J[0]",
            lambda n, t, q, v: [round(1000 * t), 0.99, *q, *v, 1.5],
        ),
        "rad,ms",
        "left out: success_rate, state.tau_J[0]",
    ),
    "pandas with an index": (
        log(
            ",time_ms,elbow_deg,wrist_deg".replace("_deg", ""),
            lambda n, t, q, v: [n, round(1000 * t), *degrees(q)],
        ),
        "deg",
        "left out: column 1",
    ),
    "a spreadsheet with decimal commas": (
        log(
            "Time (s);elbow (deg);wrist (deg);elbow_velocity (deg/s);wrist_velocity (deg/s)",
            lambda n, t, q, v: comma([t, *degrees(q), *degrees(v)]),
            ";",
        ),
        None,
        "",
    ),
    "numpy.savetxt": (log("# t q1 q2 qd1 qd2", lambda n, t, q, v: [t, *q, *v], " "), "rad", ""),
    "a unit once for all columns of a kind": (
        log(
            "time [ms],elbow [deg],wrist,elbow_velocity,wrist_velocity",
            lambda n, t, q, v: [round(1000 * t), *degrees(q), *degrees(v)],
        ),
        None,
        "",
    ),
    "microseconds since 1970": (
        log("timestamp,q0,q1", lambda n, t, q, v: [1714564800000000 + round(1e6 * t), *q]),
        "rad",
        "times count from 1714564800000000 us",
    ),
}


@pytest.mark.parametrize(("text", "unit", "said"), SHAPES.values(), ids=SHAPES)
def test_a_log_is_read_with_its_times_and_units(tmp_path, text, unit, said):
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        samples = samples_csv.read(path, unit)
    np.testing.assert_allclose(samples.times, TIMES, rtol=0, atol=1e-12)
    np.testing.assert_allclose(samples.positions, POSITIONS, rtol=0, atol=1e-15)
    if samples.velocities is not None:
        np.testing.assert_allclose(samples.velocities, VELOCITIES, rtol=0, atol=1e-14)
    assert [note.category for note in notes] == [FileNote] * bool(said)
    assert all(said in str(note.message) for note in notes)


@pytest.mark.parametrize(("text", "unit", "said"), SHAPES.values(), ids=SHAPES)
def test_a_refusal_shows_a_header_that_is_read(tmp_path, text, unit, said):
    path = tmp_path / "log.csv"
    for wrong in ("deg" if ";" in text else None, "grad"):
        path.write_text(text.replace("[deg]", "").replace("(deg)", "(rad)"), encoding="utf-8")
        with pytest.raises(InvalidInput) as caught:
            samples_csv.read(path, wrong)
        refused = str(caught.value)
        assert refused.startswith(f"{path}: ")
        assert len(refused.splitlines()) == 1
        if wrong == "grad":
            assert "unit= is 'grad'" in refused
            continue
        header = re.search("rename the columns of log.csv: (.*)", refused)[1]
        separator = ";" if ";" in text else " " if "," not in text else ","
        body = text.splitlines()[1:]
        path.write_text("\n".join([header.replace(",", separator), *body]), encoding="utf-8")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FileNote)
            samples = samples_csv.read(path)
        np.testing.assert_allclose(samples.times, TIMES, rtol=0, atol=1e-12)
        assert samples.positions.shape == POSITIONS.shape
        assert (samples.velocities is None) == (re.search("elocit|qd|dq", text) is None)


def test_numbered_columns_are_the_robots_joints_in_their_order(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q0,q1\n0,0,0\n1,90,10\n", encoding="utf-8")
    with pytest.raises(InvalidInput, match="'steps of 1': expected a unit"):
        motion(path, unit="deg")
    found = motion(path, unit="deg,s", joint_units={"turn": "rad", "rail": "m"})
    ordered = found.for_joints(["turn", "rail"])
    assert ordered.trajectory(1.0) == pytest.approx([np.pi / 2, 10])
    assert ordered.joint_units == ("rad", "m")
    with pytest.raises(InvalidInput, match="expected the joints a, b, c"):
        found.for_joints(["a", "b", "c"])
    path.write_text("clock,A1,A2\n0,0,0\n1,9,1\n", encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"log\.csv: time \[ms\],turn \[deg\],rail \[deg\]"):
        motion(path, unit="deg", joint_units={"turn": "rad", "rail": "rad"})
    path.write_text("t,q0,q2\n0,0,0\n1,90,10\n", encoding="utf-8")
    with pytest.raises(InvalidInput, match="expected the joints turn, rail"):
        motion(path, unit="deg,s").for_joints(["turn", "rail"])


CELL = RobotLimits(
    joints={
        "rail": {"velocity": (-1, 1), "acceleration": (-2, 2)},
        "turn": {"velocity": (-4, 4), "acceleration": (-5, 5)},
    },
    source="cell",
    units={"rail": "m", "turn": "rad"},
)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("rail,turn\n0,0\n100,180\n", "deg,mm"),
        ("rail [mm],turn [deg]\n0,0\n100,180\n", None),
        ("rail [mm],turn\n0,0\n100,180\n", "deg"),
        (",turn,rail\n0,0,0\n1,180,0.1\n", "deg"),
        ("index;j1;j2\n0;0;0\n1;0,1;180,0\n", "deg"),
        ("0 0\n0.1 180\n", "deg,m"),
    ],
)
def test_waypoints_of_tables_and_other_programs(tmp_path, text, unit):
    path = tmp_path / "w.csv"
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        problem = waypoints.problem(path, CELL, unit)
    indexed = text.startswith((",", "index"))
    assert [str(note.message) for note in notes] == ["w.csv: left out: column 1"] * indexed
    order = [problem.joint_names.index(name) for name in ("rail", "turn")]
    np.testing.assert_allclose(problem.waypoints[1, order], [0.1, np.pi])


@pytest.mark.parametrize("text", ["grad", "deg,rad", "deg;mm", "5", "deg,"])
def test_units_that_are_none_are_refused(text):
    with pytest.raises(InvalidInput, match="unit= is"):
        asked(text)


def log_of(rows, path):
    """A log of so many rows of 18 numbers."""
    lines = (f"{n / 1000},{','.join(['0.25'] * 18)}" for n in range(rows))
    names = [f"{kind}{joint}" for kind in ("q", "dq", "ddq") for joint in range(6)]
    path.write_text("\n".join([f"t,{','.join(names)}", *lines]), encoding="utf-8")
    return path


def test_a_log_takes_work_in_proportion_to_its_rows(tmp_path):
    paths = {rows: log_of(rows, tmp_path / f"{rows}.csv") for rows in (2000, 4000)}
    assert doubling(lambda rows: samples_csv.read(paths[rows], "rad"), 2000) < 2.1


def test_a_log_of_one_million_numbers_takes_bounded_memory(tmp_path):
    import resource

    path = log_of(50_000, tmp_path / "log.csv")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    samples = samples_csv.read(path, "rad")
    assert samples.accelerations.shape == (50_000, 6)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000  # kB


def test_a_heading_of_megabytes_is_refused_at_once(tmp_path):
    (tmp_path / "log.csv").write_text("<a>" * 1_000_000, encoding="utf-8")
    with pytest.raises(
        InvalidInput, match=r"line 1 is '<a><a>.*headings of at most 1000"
    ) as caught:
        calls(lambda: samples_csv.read(tmp_path / "log.csv"), at_most=10_000)
    assert len(str(caught.value)) < 500


# --- as a user types it ---


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)

    def ran(line):
        with pytest.raises(SystemExit) as ended:
            cli.main(line.split())
        captured = capsys.readouterr()
        return ended.value.code, captured.out, " ".join(captured.err.split())

    return ran


def test_a_log_in_degrees_and_milliseconds_is_verified_and_judged(run, tmp_path):
    rows = []
    for n, (share, rate) in enumerate(zip(SHARES, RATES, strict=True)):
        cells = [0.0] * 12
        cells[1], cells[7] = np.degrees([0.5 * share, 0.5 * rate])
        rows.append(",".join(map(str, [n * 100, *cells, 5])))
    names = [f"{kind}{joint}" for kind in ("q", "qd") for joint in range(6)]
    text = "\n".join([f"time,{','.join(names)},robot_status", *rows])
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    # 0.5 rad by q = 3 s² - 2 s³ in T = 0.4 s: a = 6 h / T² at both ends
    code, out, err = run("verify log.csv --robot ur5e --unit deg,ms --json")
    assert code == 1
    assert err == "trajopt: log.csv: left out: robot_status"
    assert json.loads(out)["dilation"] == pytest.approx(np.sqrt(6 * 0.5 / 0.16 / 5), rel=1e-6)
    code, _, err = run("verify log.csv --robot ur5e")
    assert code == 2
    assert (
        "expected the unit of angles: --unit deg or --unit rad; rename the columns of log.csv: "
        "time [ms],shoulder_pan_joint [deg],shoulder_lift_joint [deg]," in err
    )
    code, _, err = run("verify log.csv --robot ur5e --unit deg")
    assert (code, "times is 'steps of 100': expected a unit in the heading" in err) == (2, True)
    ends = ["0,0,0,0,0,0", f"0,{np.degrees(0.5)},0,0,0,0"]
    (tmp_path / "w.csv").write_text("\n".join(ends), encoding="utf-8")
    code, out, _ = run("judge log.csv w.csv --robot ur5e --unit deg --motion-unit deg,ms --json")
    assert code == 1
    assert '"claimed_duration": 0.4' in out
    names = list(arms.named("ur5e").joint_names)
    problem = f'robot = "ur5e"\njoint_names = {names}\nunits.waypoints = "rad"\n'
    problem += "waypoints = [[0, 0, 0, 0, 0, 0], [0, 0.5, 0, 0, 0, 0]]\n"
    (tmp_path / "p.toml").write_text(problem, encoding="utf-8")
    assert run("judge log.csv p.toml --unit deg,ms --json")[:2] == (1, out.replace('"w"', '"p"'))
    (tmp_path / "m.json").write_text("{}", encoding="utf-8")
    assert "--unit is 'deg'" in run("verify m.json --robot ur5e --unit deg")[2]
    assert "--unit is 'deg'" in run("judge m.json p.toml --unit deg")[2]


def test_degrees_in_a_dense_log_are_warned_of_beyond_the_position_limits(run, tmp_path):
    rows = "\n".join(f"{n / 100},{n / 2},0,0,0,0,0" for n in range(200))
    (tmp_path / "d.csv").write_text(f"t,q0,q1,q2,q3,q4,q5\n{rows}", encoding="utf-8")
    _, _, err = run("verify d.csv --robot ur5e --unit rad --interpolation spline")
    assert "warning: d.csv, shoulder_pan_joint: waypoints up to 99.5 beside" in err
    assert "look like degrees beside radians" in err


def test_a_log_in_another_unit_than_said_is_warned_of(run, tmp_path):
    for name, size in (("rad", 1.0), ("deg", 180 / np.pi)):
        rows = "\n".join(
            f"{t},{size * q},{-size * q / 2}" for t, q in zip(TIMES, SHARES, strict=True)
        )
        (tmp_path / f"{name}.csv").write_text(f"t,a,b\n{rows}", encoding="utf-8")
    (tmp_path / "w.csv").write_text("a,b\n0,0\n1,-0.5", encoding="utf-8")
    lines = ["joint_limits:"]
    for joint in ("a", "b"):
        # the motion's peaks: 1.5 / 0.4 rad/s and 6 / 0.16 rad/s²
        lines += [f"  {joint}:", "    max_velocity: 4.0", "    max_acceleration: 40.0"]
    (tmp_path / "l.yaml").write_text("\n".join(lines), encoding="utf-8")
    own = "--limits l.yaml --interpolation spline"
    err = run(f"verify rad.csv --unit deg {own}")[2]
    assert err.startswith("trajopt: warning: rad.csv moves 1 deg at 1.6 % of a velocity limit; ")
    assert err.endswith("are its angles in rad, and not in deg?")
    assert run(f"verify rad.csv --unit rad {own}")[2] == ""
    assert run(f"verify deg.csv --unit deg {own}")[2] == ""
    judged = f"w.csv --unit rad {own} --json --motion-unit"
    words = "times the waypoints: deg beside rad?"
    assert f"warning: rad.csv spans 0.0175 {words}" in run(f"judge rad.csv {judged} deg")[2]
    assert f"warning: deg.csv spans 57.3 {words}" in run(f"judge deg.csv {judged} rad")[2]
    assert run(f"judge deg.csv {judged} deg")[2] == ""
    assert run(f"judge rad.csv {judged} rad")[2] == ""


def test_numbers_without_a_header_are_named_and_shown_the_header_of_a_motion(run, tmp_path):
    (tmp_path / "m.csv").write_text("0,0,0\n0.1,0.5,0\n0.2,1,0\n", encoding="utf-8")
    code, _, err = run("verify m.csv --robot ur5e --unit rad")
    assert code == 2
    assert "m.csv is a CSV of waypoints; expected a motion: a CSV with a column of times" in err
    assert err.endswith("rename the columns of m.csv: time [s],joint_1 [rad],joint_2 [rad]")
    (tmp_path / "m.csv").write_text("0,0,0\n0.1,0.5,0\n0.1,1,0\n", encoding="utf-8")
    code, _, err = run("verify m.csv --robot ur5e --unit rad")
    assert (code, "rename" in err) == (2, False)
    assert "m.csv is a CSV of waypoints; expected a motion" in err


def test_joints_that_are_commanded_and_measured_keep_the_robots_names(run, tmp_path):
    header = "t,actual_elbow_joint,elbow_joint_target,actual_elbow_joint_vel"
    (tmp_path / "m.csv").write_text(f"{header}\n0,0,0,0\n1,9,1,9\n", encoding="utf-8")
    with pytest.warns(FileNote, match="commanded is read"):
        found = motion(tmp_path / "m.csv", unit="rad,s")
    assert found.joint_names == ("elbow_joint",)
    assert found.trajectory(1.0) == pytest.approx([1.0])
