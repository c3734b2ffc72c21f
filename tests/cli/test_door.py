"""Files as people have them, and suggestions that are true for whoever follows them."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from work import one_in

from cli.test_field_failures import quintic

DEG = 180 / np.pi
OWN = "{max_velocity: 2.0, max_acceleration: 4.0}"
TWO = f"joint_limits: {{q1: {OWN}, q2: {OWN}}}"
PEAKS = (1.875 / 2 / 2, 10 / np.sqrt(3) / 4 / 4)  # of the quintic of 1 rad in 2 s, of its limits


def motion(samples=101):
    """Times, positions and velocities of a quintic of q1, and half of it backwards of q2."""
    times = np.linspace(0, 2, samples)
    q, v = quintic(times)
    return times, np.column_stack([q, -q / 2]), np.column_stack([v, -v / 2])


def uses(out):
    certificate = json.loads(out)["certificate"]
    return certificate["velocity"]["ratio"], certificate["acceleration"]["ratio"]


# --- suggestions, followed ---

HEADINGS = {
    "bare": "{clock},q1,q2",
    "other clock": "IPOC,q1,q2",
    "numbered": "{clock},a0,a1",
    "no header": "",
    "velocities": "{clock},q1,q2,q1_vel,q2_vel",
    "units of time": "time [{time}],q1,q2",
    "units of angles": "{clock},q1 [{angle}],q2 [{angle}]",
    "with a status": "{clock},q1,q2,mode",
    "twice": "{clock},target_q1,target_q2,actual_q1,actual_q2",
}
FLAGS = ("", " --unit {angle}", " --unit {angle},{time}")


def log(heading, angle, time, samples=126):
    """A log in these units, whose first column counts from 1 on."""
    times, q, v = motion(samples)
    size = DEG if angle == "deg" else 1.0
    clock = {"s": times, "ms": 1e3 * times}[time] + 1
    columns = [clock, *(size * q.T)]
    if "vel" in heading:
        columns += [*(size * v.T)]
    if "mode" in heading:
        columns.append(np.zeros(len(times)))
    if "actual" in heading:
        columns += [*(size * q.T + 0.001)]
    rows = [",".join(f"{value:.6f}" for value in row) for row in np.column_stack(columns)]
    return [heading.format(clock="t", time=time, angle=angle)] * bool(heading) + rows


@pytest.mark.parametrize(("heading", "flags"), [*product(HEADINGS, FLAGS)])
@pytest.mark.parametrize(
    ("angle", "time"), one_in(2, [("rad", "s"), ("deg", "s"), ("deg", "ms"), ("rad", "ms")])
)
def test_a_suggestion_is_true_for_whoever_follows_it(run, heading, flags, angle, time):
    """With the flags that are there, and with those that an error asks for."""
    lines = log(HEADINGS[heading], angle, time)
    line = "verify log.csv --limits l.yaml --json" + flags.format(angle=angle, time=time)
    code, out, err = run(line, log__csv="\n".join(lines), l__yaml=TWO)
    mark = "rename the columns of log.csv: "
    if mark in err:
        header = err.partition(mark)[2].partition("; log.csv:")[0]
        lines = [header, *lines[bool(HEADINGS[heading]) :]]
        code, out, err = run(line, log__csv="\n".join(lines))
    if code == 2:  # a fault that no header mends is named
        assert "expected" in err
        assert mark not in err, header
    else:
        velocity, acceleration = uses(out)
        assert velocity == pytest.approx(PEAKS[0], rel=0.1), (lines[0], line)
        # of the motions within the digits one is shown; it may turn a little more sharply
        assert 0.9 < acceleration / PEAKS[1] < 1.5, (lines[0], line)


def test_the_clock_of_a_controller_in_degrees(run):
    """FT5-03: IPOC counts milliseconds."""
    lines = log("IPOC,q1,q2", "deg", "ms", 501)
    line = "verify log.csv --limits l.yaml --unit deg"
    _, _, err = run(line, log__csv="\n".join(lines), l__yaml=TWO)
    assert "time [ms],q1 [deg],q2 [deg]" in err


# --- containers and arrays ---


def written(name):
    """The quintic, as a program keeps it, under this file's name."""
    times, q, v = motion()
    if name.endswith(".npz"):
        np.savez(name, t=times, q=q, dq=v)
        return
    named = {"joint_names": ["q2", "q1"]}
    arrays = {
        "dt.json": {**named, "dt": 0.02, "position": q[:, ::-1], "velocity": v[:, ::-1]},
        "fps.json": {"fps": 50, "q": q, "qd": v, "reward": 1.0},
        "ns.json": {"time_stamp_ns": 1700000000 * 10**9 + np.arange(101) * 20_000_000}
        | {"joint_positions": q, "joint_velocities": v},
        "nested.json": {"plan": {"qpos": q[None], "qvel": v[None], "time": times}, "robot": "two"},
    }
    if name in arrays:
        text = json.dumps(arrays[name], default=lambda own: np.asarray(own).tolist())
    elif name == "records.json":
        rows = zip(times.tolist(), q.tolist(), v.tolist(), strict=True)
        text = json.dumps([{"t": t, "q": own, "dq": rate} for t, own, rate in rows])
    else:
        points = [
            {"positions": own, "velocities": rate, "time_from_start": t}
            for t, own, rate in zip(times.tolist(), q.tolist(), v.tolist(), strict=True)
        ]
        message = {"joint_names": ["q1", "q2"], "points": points}
        poses = {"joint_names": ["base"], "points": []}
        inside = {"joint_trajectory": message, "multi_dof_joint_trajectory": poses}
        text = json.dumps(
            {
                "plan.json": {"motion_plan_response": {"trajectory": inside, "planning_time": 0.1}},
                "bridge.json": {"op": "publish", "topic": "/command", "msg": message},
                "task.json": {"sub_trajectory": [{"info": {}}, {"trajectory": inside}]},
                "display.json": {"trajectory": [inside], "trajectory_start": {"joint_state": {}}},
            }[name]
        )
    Path(name).write_text(text, encoding="utf-8")


FILES = ["a.npz", "dt.json", "fps.json", "ns.json", "nested.json", "records.json"]
FILES += ["plan.json", "bridge.json", "task.json", "display.json"]


@pytest.mark.parametrize("name", FILES)
def test_a_motion_is_found_in_what_programs_keep(run, name):
    """FT5-04 to FT5-06."""
    written(name)
    code, out, err = run(f"verify {name} --limits l.yaml --json", l__yaml=TWO)
    assert code == 0, err
    assert uses(out) == pytest.approx(PEAKS, rel=1e-3)
    is_array = name in FILES[:6]
    assert ("angles are read in rad; --unit deg if not" in err) == is_array
    code, out, err = run(f"verify {name} --limits l.yaml --json --unit deg")
    if is_array:
        assert uses(out)[0] == pytest.approx(PEAKS[0] / DEG)
    else:
        assert (code, f"expected left out: {name} is in rad and m" in err) == (2, True)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"q": [[0.0], [1.0]]}, "expected an array of times, t, or a step of time, dt; the arrays"),
        ({"t": [0.0, 1.0], "x": [1.0, 2.0]}, "expected an array of positions, (samples, joints)"),
    ],
)
def test_arrays_that_are_no_motion_are_listed(run, arrays, words):
    np.savez("a.npz", **arrays)
    Path("a.json").write_text(json.dumps(arrays), encoding="utf-8")
    for name in ("a.npz", "a.json"):
        code, _, err = run(f"verify {name} --robot ur5e")
        assert code == 2
        assert f"the arrays are {', '.join(arrays)}".split(",")[0] in err
        assert words.partition("; ")[0].partition("expected ")[2][:20] in err or "arrays" in err


def test_an_array_without_names_is_told_how_to_get_them(run):
    """And whoever does it is told the truth."""
    times, q, _ = motion()
    a = np.column_stack([times, q])
    np.save("log.npy", a)
    code, _, err = run("verify log.npy --limits l.yaml", l__yaml=TWO)
    assert (code, "np.savez('log.npz', t=a[:, 0], q=a[:, 1:])" in err) == (2, True)
    np.savez("log.npz", t=a[:, 0], q=a[:, 1:])
    code, out, _ = run("verify log.npz --limits l.yaml --interpolation spline --json")
    assert uses(out) == pytest.approx(PEAKS, rel=0.2)


def test_of_several_trajectories_the_places_are_named(run):
    points = [{"positions": [own, own], "time_from_start": own} for own in (0, 1)]
    message = {"joint_names": ["q1", "q2"], "points": points}
    text = json.dumps({"sub_trajectory": [{"joint_trajectory": message}] * 2})
    code, _, err = run("verify m.json --limits l.yaml", m__json=text, l__yaml=TWO)
    assert code == 2
    assert "sub_trajectory[0].joint_trajectory, sub_trajectory[1].joint_trajectory" in err


# --- shapes of CSV ---


def rows_of(header, cells):
    return "\n".join([header, *cells]) + "\n"


@pytest.mark.parametrize("separator", [", ", " "])
def test_lists_in_cells_are_columns_and_indices_are_none(run, separator):
    """FT5-07."""
    times, q, _ = motion()
    cells = []
    for row, (t, own) in enumerate(zip(times, q, strict=True)):
        listed = separator.join(f"{value:.9f}" for value in own)
        cells.append(f'0,{row},{t:.2f},"[{listed}]","[9{separator}9]"')
    text = rows_of("episode_index,frame_index,timestamp,action,observation.state", cells)
    line = "verify l.csv --limits l.yaml --unit rad --interpolation spline --json"
    code, out, err = run(line, l__csv=text, l__yaml=TWO)
    assert uses(out) == pytest.approx(PEAKS, rel=0.2)
    assert "what was commanded is read, not what was measured" in err
    assert "left out: frame_index" in err  # the episode is told apart by its own
    code, _, err = run(line, l__csv=text.replace("9]", "9 9]"))
    assert (code, "line 2, column 5, observation.state" in err) in ((2, True), (0, False))


def test_a_controller_s_reference_is_read_and_not_its_output(run):
    """FT5-08."""
    times, q, _ = motion()
    start = "/jtc/controller_state"
    header = "__time," + ",".join(
        f"{start}/{what}/positions/{joint}"
        for what in ("reference", "output")
        for joint in ("q1", "q2")
    )
    cells = [
        ",".join(f"{value:.9f}" for value in (1700000000 + t, *own, *(own + 0.1)))
        for t, own in zip(times, q, strict=True)
    ]
    line = "verify c.csv --limits l.yaml --unit rad --interpolation spline --json"
    code, out, err = run(line, c__csv=rows_of(header, cells), l__yaml=TWO)
    assert code == 0, err
    assert uses(out) == pytest.approx(PEAKS, rel=0.2)
    assert "what was commanded is read, not what was sent to the hardware (output)" in err


def test_a_prefix_of_a_maker_is_left_out_and_said(run):
    written("dt.json")
    text = TWO.replace("q1", "arm_q1").replace("q2", "arm_q2")
    code, out, err = run("verify dt.json --limits l.yaml --json", l__yaml=text)
    assert code == 0, err
    assert uses(out) == pytest.approx(PEAKS, rel=1e-3)
    assert "its joints are found without a prefix: q2 is arm_q2" in err
    both = text.replace("}}", f"}}, other_q1: {OWN}, other_q2: {OWN}}}")
    code, _, err = run("verify dt.json --limits l.yaml", l__yaml=both)
    assert (code, "expected joints of l.yaml" in err) == (2, True)


# --- several motions, and one after another ---


def test_several_motions_are_one_table_with_the_worst_exit_code(run):
    for name in ("a.npz", "plan.json"):
        written(name)
    line = "verify a.npz plan.json --limits l.yaml"
    code, out, _ = run(line, l__yaml=TWO)
    assert code == 0
    assert out.count("0.4688") == 2
    slow = TWO.replace("max_velocity: 2.0", "max_velocity: 0.9")
    code, out, _ = run(f"{line} --json", l__yaml=slow)
    assert code == 1
    assert [own["feasible"] for own in json.loads(out)["motions"]] == [False, False]
    code, out, _ = run(f"{line.replace('plan', 'none')} --json", l__yaml=TWO)
    assert code == 2
    assert "none.json: it does not exist" in json.loads(out)["motions"][1]["error"]


def test_a_motion_that_takes_over_from_another(run):
    """It continues the quintic at 0.7 s, or begins 0.1 rad/s too fast."""
    written("plan.json")
    times = np.linspace(0.7, 2, 66)
    s = times / 2
    q = 10 * s**3 - 15 * s**4 + 6 * s**5
    v = (30 * s**2 - 60 * s**3 + 30 * s**4) / 2
    for more, code in ((0.0, 0), (0.1, 1)):
        points = [
            {"positions": [a, -a / 2], "velocities": [b, -b / 2], "time_from_start": t - 0.7}
            for t, a, b in zip(times.tolist(), q.tolist(), v.tolist(), strict=True)
        ]
        points[0]["time_from_start"] = 0
        points[0]["velocities"][0] += more
        text = json.dumps({"joint_names": ["q1", "q2"], "points": points})
        line = "verify next.json --before plan.json --at 0.7 --limits l.yaml"
        found, out, err = run(f"{line} --json", next__json=text, l__yaml=TWO)
        assert found == code, err
        jumps = json.loads(out)["jumps"]
        assert jumps[:2] == pytest.approx([0, more], abs=1e-5)
        assert "At the hand-over position, velocity and acceleration jump by" in run(line)[1]
    code, _, err = run(line.replace("0.7", "2.5"))
    assert (code, "expected a time from 0 to 2 s" in err) == (2, True)


# --- joints that turn without end ---


# --- questions of others ---


def problem(more="", **limits):
    said = "".join(f"{key} = {value}\n" for key, value in limits.items())
    return f'angle_unit = "rad"\n{more}\n[limits]\n{said}'


@pytest.mark.parametrize("velocity", ["[[0, 1]]", "[[0.0, 1]]"])
def test_a_joint_that_may_only_move_forward(run, velocity):
    """FT5-11: h / v + v / a; no way back is planned, and one that goes back breaks its limit."""
    text = problem("waypoints = [[0], [0.5], [2]]", velocity=velocity, acceleration="[2]")
    code, out, _ = run("plan p.toml --json", p__toml=text)
    assert code == 0
    assert json.loads(out)["certified_duration"] == pytest.approx(2.5, rel=1e-7)
    back = text.replace("[0.5]", "[-0.5]")
    code, out, _ = run("plan p.toml --json", p__toml=back)
    assert code == 1 or json.loads(out)["certified_duration"] > 1e6
    code, _, err = run("plan p.toml", p__toml=text.replace(velocity, "[[0, 0]]"))
    assert (code, "expected a positive number, or low < 0 < high" in err) == (2, True)


@pytest.mark.parametrize(
    ("jerk", "start", "time", "way"),
    [
        ("", 1.5, 0.25, 0.3125),  # 0.5 / 2, and 1.25 rad/s all that time
        # 2/8 s until -2 rad/s², which takes 1/4 rad/s off; the rest at -2 rad/s²
        ("[8]", 1.5, 0.375, 0.494792),
        ("[8]", 2.0, 0.625, 0.994792),
    ],
)
def test_a_start_beyond_a_limit_is_told_how_it_brakes(run, jerk, start, time, way):
    """FT5-12."""
    more = f"waypoints = [[0], [9]]\nstart_velocity = [{start}]"
    limits = {"velocity": "[1]", "acceleration": "[2]"} | ({"jerk": jerk} if jerk else {})
    code, out, _ = run("plan p.toml", p__toml=problem(more, **limits))
    assert code == 1
    words = f"is beyond its limit, 1 rad/s: it brakes to it in {time:g} s and {way:g} rad at least"
    assert words in " ".join(out.split())
