"""`verify` and `judge` of logs: three verdicts, their numbers, exit codes and files."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

LIMITS = "joint_limits: {{q1: {{{own}}}, q2: {{{own}}}}}"
OWN = "max_velocity: {v}, max_acceleration: {a}"


def quintic(rate, cut=0.0):
    """q1 from 0 to 1 rad in 2 s: 0.9375 rad/s, 1.4434 rad/s²; q2 half of it, backwards."""
    t = np.arange(round(cut * rate), round((2 - cut) * rate) + 1) / rate
    s = t / 2
    q = 10 * s**3 - 15 * s**4 + 6 * s**5
    return t - t[0], np.stack([q, -q / 2], axis=1)


def write(name, rate=500, decimals=4, unit="rad", cut=0.0):
    t, q = quintic(rate, cut)
    values = q if unit == "rad" else np.degrees(q)
    lines = [f"time [s],q1 [{unit}],q2 [{unit}]"]
    lines += [
        f"{time!r},{a:.{decimals}f},{b:.{decimals}f}"
        for time, (a, b) in zip(t.tolist(), values, strict=True)
    ]
    Path(name).write_text("\n".join(lines) + "\n")


def limits(v=2, a=4, jerk=""):
    Path("l.yaml").write_text(LIMITS.format(own=OWN.format(v=v, a=a) + jerk))


@pytest.mark.parametrize(
    ("rate", "decimals", "unit"), [(500, 4, "rad"), (100, 4, "rad"), (1000, 3, "deg")]
)
def test_a_motion_far_from_its_limits_is_kept_though_its_digits_look_fast(
    run, rate, decimals, unit
):
    write("log.csv", rate, decimals, unit)
    limits()
    code, out, err = run("verify log.csv --limits l.yaml --json")
    assert (code, err) == (0, "")
    table = json.loads(out)
    found = table["evidence"]
    assert (found["verdict"], found["digits"]) == ("kept", [decimals, decimals])
    assert table["feasible"]
    truth = {"velocity": 0.46875, "acceleration": 0.360844}
    for name, used in truth.items():
        own = found[name]
        assert used * 0.85 <= own["at_least"] <= used * (1 + 1e-6)
        assert own["at_least"] <= own["uses"] < 1
        assert own["window"] <= 0.1
    digit = 0.5 * 10.0**-decimals * (1 if unit == "rad" else np.pi / 180)
    known = found["premise"][0]
    assert known["rounding"] == pytest.approx(digit)
    half = max(own["half_width"] for own in found["premise"])
    assert 1.6 * digit * (1 - 1e-9) <= half < 4 * digit
    assert found["acceleration"]["digits_alone"] == pytest.approx(12 * half * rate**2 / 4)
    line = "verify log.csv --limits l.yaml --commanded --json"
    sent = json.loads(run(line)[1])["evidence"]["acceleration"]
    assert sent["digits_alone"] == pytest.approx(12 * digit * rate**2 / 4)
    assert "jerk" not in found


def test_a_broken_log_ends_with_1_and_names_joint_limit_and_proof(run):
    write("log.csv")
    limits(a=1.2)
    code, out, _ = run("verify log.csv --limits l.yaml")
    text = " ".join(out.split())
    assert code == 1
    assert text.startswith("log.csv within l.yaml: broken Positions are known to")
    assert "or better: 4 decimals and noise below" in text
    proof = re.search(
        r"With positions known to ±(\S+) rad, q1's mean acceleration over the rows at (\S+), (\S+) "
        r"and (\S+) s is at least (\S+) times its limit \(proved; these three rows suffice\)\. "
        r"Lawful only if positions were off by at least (\S+) times as much\.",
        text,
    )
    width, *times, share, margin = map(float, proof.groups())
    t, q = quintic(500)
    early, middle, late = np.round(q[np.isin(np.round(t, 6), times), 0], 4)
    h = times[1] - times[0]
    mean, doubt = abs(early - 2 * middle + late) / h**2, 4 * width / h**2
    assert share == pytest.approx((mean - doubt) / 1.2, abs=0.005)  # width has two digits
    assert margin >= (mean - 1.2) / doubt * 0.9  # other windows may need more
    assert json.loads(run("verify log.csv --limits l.yaml --json")[1])["evidence"]["conviction"][
        "at_least"
    ] == pytest.approx(1.4434 / 1.2, rel=0.03)


def test_a_short_window_cannot_be_told_and_the_answer_s_window_is_enough(run):
    write("log.csv")
    limits(jerk=", max_jerk: 40")
    code, out, _ = run("verify log.csv --limits l.yaml --window 0.01")
    text = " ".join(out.split())
    assert code == 0
    assert re.search(r": cannot be told from ±0\.000\d+ rad at 500 Hz", text)
    window = text.partition("with --window ")[2].split()[0]
    out = run(f"verify log.csv --limits l.yaml --window {window} --json")[1]
    assert json.loads(out)["evidence"]["verdict"] == "kept"


@pytest.mark.long
def test_a_cut_log_is_judged_and_a_line_says_so(run):
    write("log.csv", cut=0.5)
    limits()
    code, out, _ = run("verify log.csv --limits l.yaml")
    text = " ".join(out.split())
    assert code == 0
    assert re.search(r"kept, as far as ±\S+ rad at 500 Hz can tell", text)
    begins, ends = re.search(r"It begins at (\S+) rad/s and ends at (\S+) rad/s\.", text).groups()
    assert float(begins) == pytest.approx(30 * 0.25**2 * 0.75**2 / 2, rel=0.05)
    assert ends == begins
    assert "Slowing down does not help" not in text
    limits(v=0.8)
    code, out, _ = run("verify log.csv --limits l.yaml")
    text = " ".join(out.split())
    assert code == 1
    assert "q1's mean velocity over the rows at" in text
    assert "is at least 1.16" in text


@pytest.mark.parametrize("name", ["out.csv", "out.json", "out.yaml"])
def test_the_motion_is_written_and_keeps_the_limits_when_it_is_read(run, name):
    write("log.csv")
    limits(jerk=", max_jerk: 40")
    code, out, _ = run(f"verify log.csv --limits l.yaml --out {name}")
    assert code == 0
    assert f"{name}: the motion within the half widths" in out
    code, out, _ = run(f"verify {name} --limits l.yaml --json")
    table = json.loads(out)
    assert (code, table["feasible"], table["evidence"]) == (0, True, None)
    code, _, err = run(f"verify log.csv --limits l.yaml --out {name}")
    assert code == 2
    assert "--force to overwrite it" in err
    assert run(f"verify log.csv --limits l.yaml --out {name} --force")[0] == 0


@pytest.mark.parametrize(("name", "begins"), [("out.svg", b"<?xml"), ("out.h5", b"\x89HDF")])
def test_the_motion_as_a_picture_and_as_a_trial(run, name, begins):
    write("log.csv", rate=100)
    limits()
    code, _, err = run(f"verify log.csv --limits l.yaml --out {name}")
    assert (code, err) == (0, "")
    assert Path(name).read_bytes().startswith(begins)
    if name == "out.h5":
        assert run("verify out.h5")[0] == 0


def test_a_said_interpolation_is_judged_as_it_stands_and_many_decimals_are_a_log_too(run):
    write("log.csv", decimals=4)
    limits()
    code, out, _ = run("verify log.csv --limits l.yaml --interpolation linear --json")
    assert (code, json.loads(out)["evidence"]) == (1, None)
    write("log.csv", decimals=12)
    code, out, _ = run("verify log.csv --limits l.yaml --interpolation spline --json")
    found = json.loads(out)["evidence"]
    assert (code, found["verdict"]) == (0, "kept")
    assert [own["half_width"] for own in found["premise"]] == [1e-7, 1e-7]


def test_noise_is_said_to_be_statistical(run):
    write("log.csv", decimals=6)
    limits()
    rows = Path("log.csv").read_text().splitlines()
    noise = np.random.default_rng(3).normal(0, 1e-4, (len(rows) - 1, 2))
    noisy = [rows[0]]
    for row, (a, b) in zip(rows[1:], noise, strict=True):
        t, q1, q2 = map(float, row.split(","))
        noisy.append(f"{t!r},{q1 + a:.6f},{q2 + b:.6f}")
    Path("log.csv").write_text("\n".join(noisy))
    code, out, _ = run("verify log.csv --limits l.yaml --commanded")
    assert (code, "proved; these three rows suffice" in " ".join(out.split())) == (1, True)
    code, out, _ = run("verify log.csv --limits l.yaml --window 0.2")
    text = " ".join(out.split())
    assert code == 0
    assert re.search(r"6 decimals and noise of up to 0\.0001\d? rad \(found\)", text)
    assert re.search(r"As exact digits: at least \d+(\.\d+)? times \(--commanded\)\.", text)
    code, out, _ = run("verify log.csv --limits l.yaml --noise 0.0001 --window 0.2")
    text = " ".join(out.split())
    assert (code, "noise of 0.0001 rad (as you said)" in text) == (0, True)
    limits(v=0.5)
    code, out, _ = run("verify log.csv --limits l.yaml")
    assert code == 1
    assert "(proved, with noise that convicts 0.1 % of lawful logs;" in " ".join(out.split())
    code, _, err = run("verify log.csv --limits l.yaml --noise 1e308")
    assert code == 2
    assert err == "trajopt: noise is 1e+308: expected a number from 0 to 100, rad (m)"


def test_a_printed_optimum_is_judged_as_the_optimum_that_it_is(run):
    """A bang-bang motion of 2 s at exactly its limit, with velocities, in five decimals."""
    t = np.arange(501) / 250
    q = np.where(t < 1, t**2 / 2, 1 - (2 - t) ** 2 / 2)
    v = np.where(t < 1, t, 2 - t)
    rows = [f"{a:.3f},{b:.5f},{c:.5f}" for a, b, c in zip(t, q, v, strict=True)]
    Path("log.csv").write_text("time [s],j [rad],j [rad/s]\n" + "\n".join(rows))
    problem = 'joint_names = ["j"]\nwaypoints = [[0], [0.32], [1]]\n'
    problem += 'units = {waypoints = "rad", limits = "rad"}\n'
    Path("p.toml").write_text(problem + "[limits]\nvelocity = [2]\nacceleration = [1]\n")
    code, out, _ = run("judge log.csv p.toml --json")
    table = json.loads(out)
    assert code == 0
    assert table["evidence"]["verdict"] == "kept"
    assert table["certified_duration"] == pytest.approx(2, rel=1e-3)
    assert table["waypoint_times"] == pytest.approx([0, 0.8, 2], abs=1e-3)
    code, out, _ = run("judge log.csv p.toml --interpolation cubic --json")
    assert code == 1
    assert json.loads(out)["evidence"] is None


def test_a_log_that_misses_a_waypoint_is_no_answer_to_the_problem(run):
    write("log.csv")
    problem = 'joint_names = ["q1", "q2"]\nwaypoints = [[0, 0], [0.5, 0.1], [1, -0.5]]\n'
    problem += 'units = {waypoints = "rad", limits = "rad"}\n'
    Path("p.toml").write_text(problem + "[limits]\nvelocity = [2, 2]\nacceleration = [4, 4]\n")
    code, out, _ = run("judge log.csv p.toml")
    text = " ".join(out.split())
    assert code == 1
    assert re.search(
        r"log\.csv on p: kept, as far as ±\S+ rad at 500 Hz can tell; not feasible", text
    )
    assert "misses the waypoint by 0.28 rad" in text
    assert "straight lines" not in text


def test_a_sensor_s_steps_are_said(run):
    t, q = quintic(200)
    steps = np.round(q / 0.002) * 0.002
    rows = [f"{a!r},{b:.6f},{c:.6f}" for a, (b, c) in zip(t.tolist(), steps, strict=True)]
    Path("log.csv").write_text("time [s],q1 [rad],q2 [rad]\n" + "\n".join(rows))
    limits()
    code, out, _ = run("verify log.csv --limits l.yaml --window 0.3")
    assert code == 0
    assert "kept, as far as" in out
    assert re.search(r"a step of 0\.002 rad in all \d+ values", " ".join(out.split()))
