"""Kinds of limits, demands and outputs, two and three at a time: no traceback, true exit codes."""

from __future__ import annotations

import json
from itertools import combinations_with_replacement, cycle, product
from pathlib import Path

import numpy as np
import pytest
from work import one_in

import trajopt
from trajopt import cli
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.views.figures import motions

LIMITS = {
    "plain": "",
    "jerk": "jerk = [50, 50]\n",
    "position": "position = [[-2, 2], [-2, 2]]\n",
    "falling": "falling_velocity = {offset = [0.1, 0.1], deceleration = [3.0, 3.0], "
    "position = [[-2, 2], [-2, 2]]}\n",
    "one way": "",
    "segment": "[[limits.segment]]\nnumber = 1\nvelocity = [1, 1]\n",
    "segments": "[[limits.segment]]\nnumber = 2\nacceleration = [3, 3]\n",
}
DEMANDS = {
    "none": "",
    "tolerance": "tolerance = 0.05\n",
    "dwell": "dwell = [0, 0.3, 0]\n",
    "least_times": "least_times = [0, 2]\n",
    "given_times": "given_times = [2.0, 2.0]\n",
    "least_duration": "least_duration = 5\n",
    "duration": "duration = 8\n",
    "closed": "closed = true\n",
    "start_velocity": "start_velocity = [0.2, 0]\n",
}
CASES = [*product(combinations_with_replacement(LIMITS, 2), DEMANDS)]
OUTPUTS = ("m.csv", "m.yaml", "m.json", "m.png", "m.svg")
PLANNED = [*zip(CASES[:: len(CASES) // 10], cycle(OUTPUTS), strict=False)]


def problem(kinds, demand):
    """A problem of two joints and two segments with these kinds of limits and this demand."""
    rows = (
        "[[0, 0], [0.5, -0.3], [0, 0]]" if demand == "closed" else "[[0, 0], [0.5, -0.3], [1, 0.2]]"
    )
    velocity = "[[0, 2], 2]" if "one way" in kinds and demand != "closed" else "[2, 2]"
    own = sorted(dict.fromkeys(kinds), key=lambda kind: kind.startswith("segment"))
    said = "".join(LIMITS[kind] for kind in own)
    return (
        f'waypoints = {rows}\nangle_unit = "rad"\n{DEMANDS[demand]}[limits]\n'
        f"velocity = {velocity}\nacceleration = [4, 4]\n{said}"
    )


def by_line(loaded):
    """A slow motion at rest at every waypoint, of quintics of 4 s."""
    times = np.arange(3) * 4.0
    steps = np.diff(loaded.waypoints, axis=0)
    shares = np.array([6 / 4**5, -15 / 4**4, 10 / 4**3, 0.0, 0.0, 0.0])
    coefficients = shares[:, None, None] * steps
    coefficients[-1] = loaded.waypoints[:-1]
    return Trajectory(times, coefficients, times)


@pytest.mark.parametrize(
    ("kinds", "demand"), one_in(4, [own for own in CASES if "falling" in own[0]])
)
def test_a_figure_has_the_limits_that_count(tmp_path, kinds, demand):
    """The lines drawn are `Limit.edges`, within the limits of the segment at each time."""
    path = tmp_path / "p.toml"
    path.write_text(problem(kinds, demand))
    loaded = Problem.from_toml(path)
    motion = by_line(loaded)
    figure = motions.motion(loaded, motion)
    falling = loaded.limits.kinds["falling_velocity"]
    for joint in range(2):
        lines = [line.get_xydata() for line in figure.axes[3 * joint + 1].lines]
        if loaded.has("jerk"):
            lines = [line.get_xydata() for line in figure.axes[4 * joint + 1].lines]
        drawn = [own for own in lines if len(own) == motions.EDGE_SAMPLES]
        assert len(drawn) >= 2
        times = drawn[0][:, 0]
        edges = falling.edges(motion, times)[1, joint]
        segments = np.minimum((times >= 4.0).astype(int), 1)
        pairs = loaded.limits.velocity
        low, high = (pairs[segments, joint] if pairs.ndim == 3 else pairs[[joint] * len(times)]).T
        for edge in edges:
            expected = np.clip(edge, low, high)
            assert any(np.allclose(own[:, 1], expected, atol=1e-12) for own in drawn)


KEPT = ("none", "tolerance", "least_times", "least_duration", "duration")


@pytest.mark.parametrize(("kinds", "demand"), one_in(27, CASES))
def test_a_slow_motion_of_every_pair_is_judged(tmp_path, kinds, demand):
    path = tmp_path / "p.toml"
    path.write_text(problem(kinds, demand))
    loaded = Problem.from_toml(path)
    judged = trajopt.judge(loaded, by_line(loaded))
    table = json.loads(json.dumps(judged.as_dict(), default=str))
    assert table["feasible"] == judged.certificate.feasible
    if demand in KEPT:
        assert judged.certificate.feasible, judged.certificate.flaws


@pytest.mark.parametrize(("number", "case"), [*enumerate(CASES[::16])])
def test_a_motion_of_a_pair_is_judged_by_a_command(run, number, case):
    """By its problem, and by limits alone."""
    kinds, demand = case
    Path("p.toml").write_text(problem(kinds, demand))
    slow = by_line(Problem.from_toml(Path("p.toml")))
    breaks, coefficients = slow.breaks.tolist(), slow.coefficients.tolist()
    text = json.dumps({"breaks": breaks, "coefficients": coefficients})
    line = ("judge m.json p.toml", "verify m.json --limits p.toml")[number % 2]
    code, out, err = run(f"{line} --json", m__json=text)
    if number % 2 and any(kind.startswith("segment") for kind in kinds):
        assert (code, "`trajopt judge MOTION PROBLEM` knows the segments" in err) == (2, True)
    elif demand in KEPT:
        assert (code, json.loads(out)["feasible"]) == (0, True), err
    else:
        assert code in (0, 1), err


@pytest.mark.parametrize(("case", "output"), PLANNED)
def test_a_plan_of_a_pair_is_written(run, case, output):
    code, _, err = run(f"plan p.toml --out {output}", p__toml=problem(*case))
    assert code in (0, 1), err
    assert (code == 0) == Path(output).exists(), err


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """A folder with trials of every demand beside two kinds of limits each: 14 problems."""
    folder = tmp_path_factory.mktemp("pairs")
    chosen = CASES[:: len(CASES) // 13]
    files = []
    for number, case in enumerate(chosen):
        file = folder / f"p{number}.toml"
        file.write_text(f'name = "p{number}"\n' + problem(*case))
        files.append(file)
    planners = ("--planner", "exact", "--planner", "ruckig-stop")
    line = ["compare", *map(str, files), *planners, "--output", str(folder / "out"), "--jobs", "1"]
    with pytest.raises(SystemExit) as ended:
        cli.main(line)
    assert ended.value.code in (0, 1)
    return folder / "out", files


@pytest.mark.parametrize("to", ["csv", "parquet", "latex", "svg"])
def test_pairs_are_exported(compared, run, to):
    folder, files = compared
    out = "--out t.csv" if to == "csv" else "--output out" * (to != "parquet")
    assert run(f"export {folder} --to {to} {out}")[0] == 0
    if to == "csv":
        assert len(Path("t.csv").read_text().splitlines()) > 2 * len(files)


def test_pairs_are_verified_and_reported(compared, run):
    folder, _ = compared
    code, out, err = run(f"verify {folder} --json")
    assert (code, json.loads(out)["holds"]) == (0, True), err
    assert run(f"report {folder} --out r.html")[0] == 0
    assert Path("r.html").stat().st_size > 10_000


@pytest.mark.parametrize("number", range(0, 14, 3))
def test_a_pair_is_explained(compared, run, number):
    _, files = compared
    code, out, err = run(f"explain {files[number]} --planner ruckig-stop --json")
    assert code in (0, 1), err
    if code == 0:
        assert json.loads(out)["gap"] > -1e-6


@pytest.mark.parametrize("demand", ["none", "dwell", "least_duration", "duration", "closed"])
def test_the_front_of_a_pair(run, demand):
    """It has a curve, or says in a line why there is none."""
    text = problem(("position", "plain"), demand)
    code, out, err = run("front p.toml --durations 9 --time-limit 0 --json", p__toml=text)
    assert code in (0, 1, 2), err
    assert (code == 0) == out.startswith("{"), err
    assert "Traceback" not in err
    if code:
        assert len(err.split("trajopt: ")) == 2, err
