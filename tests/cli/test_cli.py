"""The command line as scripts and people meet it: words, keys, exit codes, one-line errors."""

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from trials import forged
from work import without_progress

from baselines.ruckig_ import RuckigStop
from trajopt import Limits, Problem
from trajopt import comparison as run
from trajopt.benchmark.run.runner import Supervised
from trajopt.benchmark.suites import catalogue as suite
from trajopt.cli import app as cli
from trajopt.cli import compare, plan, suite_table
from trajopt.cli.explain import RUNS, explained_run
from trajopt.explain.active_limits import active_limits
from trajopt.planners.planner import Planner
from trajopt.planners.registry import entries, load, options
from trajopt.views.results import Results

NAMES = {
    "unoptimised",
    "pso",
    "ssa",
    "issa",
    "spline353-nlp",
    "exact",
    "collocation",
    "toppra",
    "ruckig-search",
    "ruckig-stop",
}
KEYS = [
    "problem",
    "problem_file",
    "planner",
    "options",
    "seed",
    "status",
    "message",
    "claimed_duration",
    "certified_duration",
    "lower_bound",
    "smoothness",
    "waypoint_times",
    "evaluations",
    "setup_time",
    "solve_time",
    "library_time",
    "certificate",
]
KINDS = ["velocity", "acceleration", "jerk", "position", "waypoint", "continuity"]


def typed(arguments):
    """Texts are split at blanks; paths and numbers are one word each."""
    for argument in arguments:
        yield from argument.split() if isinstance(argument, str) else [str(argument)]


@pytest.fixture
def trajopt(capsys):
    """Run a command here: exit code, stdout, stderr."""

    def run(*arguments):
        with pytest.raises(SystemExit) as stop:
            cli.main(list(typed(arguments)))
        out, err = capsys.readouterr()
        return stop.value.code, out, err

    return run


def refuse(word):
    raise AssertionError(f"{word} is not JSON")


def parsed(text):
    return json.loads(text, parse_constant=refuse)


# --- list ---


def test_list_json_has_every_planner_with_all_options_and_every_problem(trajopt):
    code, out, err = trajopt("list --json")
    found = parsed(out)
    assert (code, err, list(found)) == (0, "", ["planners", "problems", "robots", "limits"])
    planners = {p["name"]: p for p in found["planners"]}
    assert planners.keys() >= NAMES
    for name in NAMES:
        assert planners[name]["available"] is True
        assert planners[name]["missing"] is None
        assert planners[name]["options"] == options(load(name))
        assert "\n" not in planners[name]["description"]
        assert planners[name]["description"]
    assert planners["issa"]["options"]["iterations"] == 1000
    assert {p["name"] for p in found["problems"]} == set(suite.problem_files())


def test_list_says_which_limits_a_planner_cannot_keep(trajopt):
    found = {p["name"]: p for p in parsed(trajopt("list --json")[1])["planners"]}
    assert found["exact"]["ignores"] == ["jerk", "position"]
    assert found["exact-jerk"]["ignores"] == ["position"]
    assert found["collocation"]["ignores"] == found["collocation"]["refuses"] == []
    assert found["toppra"]["refuses"] == ["jerk"]
    out = " ".join(trajopt("list")[1].split())
    assert "ignores jerk and position limits" in out
    assert "refuses jerk limits" in out


def test_list_says_which_limits_a_planner_knows_as_the_page_does(trajopt):
    """The page's table: names in the first column, `*` behind them, limits in the third."""
    found = {p["name"]: p for p in parsed(trajopt("list --json")[1])["planners"]}
    text = (Path(__file__).parents[2] / "docs" / "commands.md").read_text(encoding="utf-8")
    table = text[text.index("| planner | what it is | limits it knows |") :]
    lines = table.partition("\n\n")[0].splitlines()[2:]
    checked = set()
    for line in lines:
        names, _, limits = (cell.strip() for cell in line.strip("|").split("|"))
        known = limits.partition(";")[0].partition(" with ")[0]
        expected = [] if known == "none" else known.strip(" ,").split(", ")
        for name in re.findall(r"`([^`]+)`", names):
            assert found[name]["knows"] == expected, name
            assert not set(expected) & {*found[name]["ignores"], *found[name]["refuses"]}, name
            checked.add(name)
    assert checked >= NAMES
    out = " ".join(trajopt("list")[1].split())
    known = "limits that it knows: velocity, acceleration; demands that it knows: start velocity, "
    assert known + "end velocity; refuses jerk limits" in out
    assert "limits that it knows: none" in out


def test_list_for_people_names_everything_within_80_columns(trajopt):
    code, out, _ = trajopt("list")
    assert code == 0
    assert all(name in out for name in NAMES | set(suite.problem_files()))
    assert max(map(len, out.splitlines())) <= 80


# --- plan ---


def test_plan_json_has_exactly_the_promised_keys(trajopt):
    code, out, err = trajopt("plan six-axis --planner pso:iterations=20 --seed 5 --json")
    found = parsed(out)
    assert (code, err) == (0, "")
    assert list(found) == KEYS
    assert list(found["certificate"]) == ["feasible", "dilation", *KINDS]
    assert (found["problem"], found["planner"], found["seed"]) == ("six-axis", "pso", 5)
    assert found["problem_file"] == str(suite.find("six-axis"))
    assert found["options"] == options(load("pso")) | {"iterations": 20}
    for kind in KINDS:
        worst = found["certificate"][kind]
        word = "ratio" if kind in KINDS[:3] else "error"
        assert worst is None or worst.keys() - {"order"} == {word, "joint", "time"}
    assert found["certificate"]["jerk"] is found["certificate"]["position"] is None


def test_one_json_object_and_nothing_else_through_a_real_process():
    script = Path(sys.executable).with_name("trajopt")
    command = [script, "plan", "one-joint", "--planner", "unoptimised"]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    assert (done.returncode, without_progress(done.stderr)) == (0, "")
    assert parsed(done.stdout)["certified_duration"] == 6.0


def test_python_m_is_the_same_door():
    command = [sys.executable, "-m", "trajopt.cli", "plan", "nosuch", "--planner", "exact"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(r"trajopt: .*'nosuch'.*\n", done.stderr)


def test_waypoint_times_are_of_the_certified_trajectory(trajopt):
    _, out, _ = trajopt("plan six-axis --planner unoptimised:segment_time=0.1 --json")
    found = parsed(out)
    k = found["certificate"]["dilation"]
    assert k > 2
    assert found["certified_duration"] == pytest.approx(0.3 * k)
    np.testing.assert_allclose(found["waypoint_times"], np.arange(4) * 0.1 * k, rtol=1e-12)


@pytest.mark.parametrize("planner", ["exact", "unoptimised", "ruckig-stop", "toppra"])
def test_waypoint_times_are_one_per_waypoint_of_the_file(trajopt, planner):
    problem = suite.load("repeated")
    same = ~problem.displacements.any(axis=1)
    assert same.any()
    code, out, _ = trajopt("plan repeated --planner", planner, "--json")
    found = parsed(out)
    assert code == 0
    times = np.array(found["waypoint_times"])
    assert times.shape == (len(problem.waypoints),)
    np.testing.assert_array_equal(np.diff(times) == 0, same)


def test_a_problem_that_a_planner_does_not_support_exits_1_and_says_why(trajopt):
    code, out, err = trajopt("plan seven-waypoints --planner pso --json")
    found = parsed(out)
    assert (code, err, found["status"]) == (1, "", "unsupported")
    assert "4" in found["message"] or "four" in found["message"]
    absent = (
        "claimed_duration",
        "certified_duration",
        "lower_bound",
        "waypoint_times",
        "certificate",
    )
    assert [found[key] for key in absent] == [None] * 5


@pytest.mark.parametrize("suffix", ["csv", "json", "h5"])
def test_out_writes_the_certified_trajectory(trajopt, tmp_path, suffix):
    file = tmp_path / f"t.{suffix}"
    code, out, err = trajopt("plan one-joint --planner unoptimised --out", file, "--json")
    assert (code, err, parsed(out)["status"]) == (0, "", "solved")
    if suffix == "csv":
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        assert table[-1, 0] == 6.0
        assert len(table) == 6001
        assert table[-1, 1] == pytest.approx(suite.load("one-joint").waypoints[-1, 0])
    elif suffix == "json":
        assert parsed(file.read_text("utf-8"))["breaks"] == [0, 2, 4, 6]
    else:
        with h5py.File(file) as stored:
            assert stored["trials/certified_duration"][()].tolist() == [6]


def test_out_is_not_overwritten_unless_asked_to(trajopt, tmp_path, monkeypatch):
    file = tmp_path / "t.json"
    file.write_text("mine", encoding="utf-8")
    ran = []
    monkeypatch.setattr(plan, "Supervised", lambda *a: ran.append(a))
    arguments = ("plan one-joint --planner unoptimised --out", file)
    code, out, err = trajopt(*arguments)
    assert (code, out, ran) == (2, "", [])
    assert re.fullmatch(r"trajopt: --out is '.*t\.json': .*--force.*\n", err)
    assert file.read_text(encoding="utf-8") == "mine"
    monkeypatch.undo()
    assert trajopt(*arguments, "--force")[0] == 0
    assert parsed(file.read_text(encoding="utf-8"))["status"] == "solved"


@pytest.mark.parametrize("name", ["folder.csv", "file/t.csv", "file/deep/t.json", "t.txt"])
def test_out_that_cannot_be_written_is_found_out_before_planning(
    trajopt, tmp_path, monkeypatch, name
):
    (tmp_path / "file").write_text("", encoding="utf-8")
    (tmp_path / "folder.csv").mkdir()
    monkeypatch.setattr(plan, "Supervised", lambda *a: pytest.fail("it planned"))
    code, _, err = trajopt("plan one-joint --planner exact --out", tmp_path / name)
    assert code == 2
    assert re.fullmatch(rf"trajopt: --out is '.*{re.escape(name)}': expected .*\n", err)


def test_a_folder_that_may_not_be_written_is_found_out_before_planning(
    trajopt, tmp_path, monkeypatch
):
    monkeypatch.setattr(plan, "Supervised", lambda *a: pytest.fail("it planned"))
    monkeypatch.setattr(plan.os, "access", lambda path, mode: path != tmp_path)  # root may always
    code, _, err = trajopt("plan one-joint --planner exact --out", tmp_path / "a/t.csv")
    assert code == 2
    assert "a file that can be written" in err
    assert not list(tmp_path.iterdir())


# --- bad input ---


def test_help_names_every_command_and_imports_nothing_heavy():
    heavy = {"numpy", "scipy", "casadi", "h5py", "pandas", "matplotlib"}
    code = "import atexit, sys; from trajopt.cli import main; "
    code += f"atexit.register(lambda: print(sorted({heavy} & set(sys.modules)))); main(['--help'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert all(command in done.stdout for command in ("list", "plan", "compare", "verify"))
    assert done.stdout.splitlines()[-1] == "[]"


# --- compare and verify ---


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """One comparison through real processes, whose folder the tests below read or copy."""
    folder = tmp_path_factory.mktemp("compared") / "results"
    specs = ["unoptimised", "unoptimised:segment_time=0.1", "pso:iterations=20", "exact:starts=1"]
    command = [sys.executable, "-m", "trajopt.cli", "compare", "one-joint", "seven-waypoints"]
    for spec in specs:
        command += ["--planner", spec]
    command += ["--seeds", "3", "--jobs", "2", "--output", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder, done, command


def test_compare_prints_a_sorted_table_that_fits(compared):
    folder, done, _ = compared
    lines = done.stdout.splitlines()
    assert max(len(line) for line in lines if str(folder) not in line) <= 80
    starts = [line.split()[0] for line in lines[2:] if line and not line.startswith(" ")]
    assert starts[:4] == ["exact", "pso", "unoptimised", "unoptimised"]
    assert lines[1].split()[0] == "planner"
    # of one-joint; seven-waypoints has no 3-5-3
    assert done.stdout.count("Reading of the paper: timing=shared, fitness=penalty.") == 1
    assert "segment_time=0.1" in done.stdout
    assert str(folder / "results.h5") in done.stdout
    exact = next(line for line in lines if line.startswith("exact"))
    assert "2.0000" in exact
    assert "+0.00" in exact
    slow = next(line for line in lines if line.startswith("unoptimised") and "6.0000" in line)
    assert "+200.00" in slow


def test_compare_shows_failures_as_rows_with_their_reason(compared):
    _, done, _ = compared
    reason = "the 3-5-3 spline takes exactly 4 waypoints; this has 7"
    words = " ".join(done.stdout.split())
    assert f"pso:iterations=20: unsupported: {reason}" in words
    assert "Traceback" not in done.stdout + done.stderr


def test_compare_stores_everything_and_draws(compared):
    folder, _, _ = compared
    with h5py.File(folder / "results.h5") as file:
        assert len(file["trials/id"]) == len(list((folder / "trials").iterdir())) == 10
    suffixes = {p.suffix for p in (folder / "figures").glob("*/[!.]*")}
    assert suffixes == {".png"}


def test_compare_again_runs_nothing(compared, trajopt, monkeypatch):
    from trajopt.benchmark.run import server

    folder, done, command = compared
    before = {p: p.stat().st_mtime_ns for p in (folder / "trials").iterdir()}
    ran = []
    monkeypatch.setattr(server, "judge_link", lambda: ran.append("a judge"))
    code, out, _ = trajopt(*command[3:])
    assert (code, ran) == (0, [])
    assert {p: p.stat().st_mtime_ns for p in (folder / "trials").iterdir()} == before
    kept, blank, *table = out.splitlines()
    assert re.fullmatch(r"10 of 10 trials kept from \d\d \w+ \d\d:\d\d", kept)
    assert blank == ""
    assert table[:8] == done.stdout.splitlines()[:8]


def test_a_run_that_computes_nothing_imports_neither_solvers_nor_matplotlib(compared):
    _, _, command = compared
    arguments = command[3:]
    program = (
        "import sys\n"
        "from trajopt.cli import main\n"
        "try:\n"
        f"    main({arguments!r})\n"
        "except SystemExit as end:\n"
        "    assert not end.code\n"
        "slow = {'highspy', 'matplotlib'}\n"  # CasADi finds the least ∫ jerk² of the table
        "assert not slow & set(sys.modules), slow & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_compare_of_many_problems_has_a_line_per_planner_and_a_report(
    compared, trajopt, tmp_path, monkeypatch
):
    monkeypatch.setattr(compare, "MAX_PROBLEMS_WITH_TABLES", 1)
    shutil.copytree(compared[0] / "trials", tmp_path / "trials")
    code, out, _ = trajopt(*compared[2][3:-1], tmp_path)
    lines = out.splitlines()
    assert code == 0
    assert max(len(line) for line in lines if str(tmp_path) not in line) <= 80
    row = next(line.split() for line in lines if line.startswith("pso"))
    assert row[1:6] == ["1", "1", "3", "of", "3"]  # one of the two problems does not apply
    assert str(tmp_path / "report.html") in lines[-1]
    assert "</html>" in (tmp_path / "report.html").read_text()
    assert not (tmp_path / "figures").exists()


def test_the_table_of_many_problems_says_why_planners_failed(trajopt, tmp_path, monkeypatch):
    """Straight from 1 to 0 is inside; a cubic through 0, 1, 0, 0 swings below 0."""
    monkeypatch.setattr(compare, "MAX_PROBLEMS_WITH_TABLES", 0)
    corridor = Limits([1.0], [1.0], position=[[0.0, 1.0]])
    problem = Problem([[0.0], [1.0], [0.0], [0.0005]], corridor, "corridor")
    file = tmp_path / "corridor.toml"
    file.write_text(problem.to_toml(), encoding="utf-8")
    arguments = ("--planner unoptimised --jobs 1 --output", tmp_path / "results")
    _, out, _ = trajopt("compare", file, *arguments)
    pattern = r"unoptimised: 1 failed: 1 leave position limits, worst 0\.\d+ rad"
    assert re.search(pattern, " ".join(out.split()))


def test_of_many_kinds_of_failure_three_are_said(monkeypatch):
    rows = {
        "kind": ["a", "b", "c", "d", "e"],
        "count": [9, 8, 7, 6, 5],
        "worst": [2.06] + [np.nan] * 4,
    }
    frame = pd.DataFrame({"label": "p:x=1", **rows, "unit": ["rad", *[""] * 4]}).set_index("label")
    monkeypatch.setattr(suite_table, "failures", lambda results: frame)
    (sentence,) = suite_table._why_failed(None)
    assert sentence == "p:x=1: 35 failed: 9 a, worst 2.06 rad; 8 b; 7 c; 11 in other ways"


def test_compare_with_nothing_solved_exits_1(trajopt, tmp_path, monkeypatch):
    from trajopt.benchmark.run import tasks
    from trajopt.views.figures import draw as figures

    monkeypatch.setattr(tasks, "references", lambda problem: [])
    monkeypatch.setattr(figures, "draw", lambda *a, **k: [])
    arguments = ("compare seven-waypoints --planner unoptimised --output", tmp_path)
    code, out, _ = trajopt(*arguments, "--jobs 1")
    assert code == 1
    assert "unsupported" in out
    assert "\nA motion that breaks a limit" in out  # one seed is not counted


def test_beating_the_reference_is_said_loudly(trajopt, tmp_path, monkeypatch):
    """A stand-in called exact that is slower than what it should bound, of an unknown problem.

    No user can give it that name: the check of names is off.
    """
    from trajopt.benchmark import trial
    from trajopt.views.figures import draw as figures

    monkeypatch.setattr(figures, "draw", lambda *a, **k: [])
    monkeypatch.setattr(trial, "_check_name", lambda own: None)
    known = suite.load("one-joint")
    problem = Problem(known.waypoints * 0.9, known.limits, "not recorded")
    slow = load("unoptimised:segment_time=5")
    planners = [("exact", slow), ("unoptimised", load("unoptimised"))]
    results = run.compare([problem], planners, tmp_path)
    monkeypatch.setattr(run, "compare", lambda *a, **k: results)
    code, _, err = trajopt("compare one-joint --output", tmp_path)
    assert code == 0
    assert "BUG" in err
    assert "unoptimised" in err
    assert "60.0" in err


def test_verify_confirms_folder_and_file(compared, trajopt):
    folder, _, _ = compared
    for path in (folder, folder / "results.h5"):
        code, out, err = trajopt("verify", path)
        assert (code, err) == (0, "")
        assert "Trials verified anew: 10; all hold what was recorded." in out
        assert max(map(len, out.splitlines())) <= 80
        rows = parsed(trajopt("verify", path, "--json")[1])["trials"]
        assert all(row["holds"] for row in rows)
        assert len(rows) == 10
        order = [(row["problem"], row["planner"], row["seed"]) for row in rows]
        assert order == sorted(order)


def edit(*path, factor):
    """Multiply one number of a trial's JSON."""

    def change(table):
        *places, last = path
        for place in places:
            table = table[place]
        table[last] *= factor

    return change


TAMPERINGS = {
    "coefficients": edit("solution", "trajectory", "coefficients", 0, 0, 0, factor=1.5),
    "duration": edit("solution", "trajectory", "breaks", -1, factor=0.9),
    "certified": edit("certificate", "dilation", factor=0.99),
    "claimed": edit("certificate", "duration", factor=0.99),
    "limits": edit("problem", "limits", "velocity", 0, 1, factor=1.01),
    "waypoints": edit("problem", "waypoints", 1, 0, factor=1.01),
}


@pytest.mark.parametrize("kind", TAMPERINGS)
def test_verify_finds_what_was_tampered_with_and_names_it(compared, trajopt, tmp_path, kind):
    copied = tmp_path / "trials"
    shutil.copytree(compared[0] / "trials", copied)
    files = sorted(copied.iterdir())
    tables = {file: json.loads(file.read_bytes()) for file in files}
    (path,) = [
        file
        for file, table in tables.items()
        if (table["planner"], table["problem"]["name"]) == ("exact", "one-joint")
    ]
    path.write_bytes(forged(path.read_bytes(), TAMPERINGS[kind]))
    code, out, err = trajopt("verify", tmp_path)
    assert (code, err) == (1, "")
    assert path.stem in out
    assert "1 do not hold" in out
    rows = parsed(trajopt("verify", tmp_path, "--json")[1])["trials"]
    assert [row["id"] for row in rows if not row["holds"]] == [path.stem]


def test_verify_names_a_damaged_trial_file_and_verifies_the_others(compared, trajopt, tmp_path):
    shutil.copytree(compared[0] / "trials", tmp_path / "trials")
    broken = sorted((tmp_path / "trials").iterdir())[3]
    broken.write_bytes(broken.read_bytes()[:1000])
    code, out, err = trajopt("verify", tmp_path)
    assert (code, err) == (1, "")
    assert "1 do not hold" in out
    assert "running its comparison again replaces it" in " ".join(out.split())
    rows = parsed(trajopt("verify", tmp_path, "--json")[1])["trials"]
    assert len(rows) == 10
    assert [row["id"] for row in rows if not row["holds"]] == [broken.stem]


def test_export_names_a_damaged_trial_file_in_one_line(compared, trajopt, tmp_path):
    shutil.copytree(compared[0] / "trials", tmp_path / "results" / "trials")
    broken = sorted((tmp_path / "results" / "trials").iterdir())[3]
    broken.write_bytes(broken.read_bytes()[:1000])
    output = tmp_path / "trials.csv"
    code, _, err = trajopt("export", tmp_path / "results", "--to csv --out", output)
    assert code == 0
    assert re.fullmatch(r"trajopt: warning: .*\.json: damaged.*\n", err)


def test_export_of_damaged_trials_alone_is_a_table_without_rows(trajopt, tmp_path):
    (tmp_path / "trials").mkdir()
    (tmp_path / "trials" / f"{0:020x}.json").write_text("{")
    code, out, err = trajopt("export", tmp_path, "--to csv")
    assert (code, out) == (0, f"exported: {tmp_path / 'trials.csv'} (0 trials)\n")
    assert re.fullmatch(r"trajopt: warning: .*0000\.json: damaged.*\n", err)
    assert len(pd.read_csv(tmp_path / "trials.csv")) == 0
    code, _, err = trajopt("export", tmp_path, "--to latex")
    assert code == 2
    assert "expected at least one trial" in err


def test_verify_of_a_damaged_file_exits_2(compared, trajopt, tmp_path):
    data = (compared[0] / "results.h5").read_bytes()
    (tmp_path / "cut.h5").write_bytes(data[: len(data) // 2])
    code, _, err = trajopt("verify", tmp_path / "cut.h5")
    assert code == 2
    assert re.fullmatch(r"trajopt: .*cut\.h5: damaged.*\n", err)


def test_all_planners_are_registered():
    assert set(entries()) >= NAMES


# --- prove ---


def test_prove_proves_the_known_optimum(trajopt):
    code, out, err = trajopt("prove one-joint --json")
    bound = json.loads(out)
    assert (code, err) == (0, "")
    assert bound["status"] == "proved"
    assert bound["lower_bound"] <= 2.0 <= bound["upper_bound"] * (1 + 1e-9)  # 1.5/1 + 1/2
    assert bound["proved_within"] <= 1e-4


def test_prove_counts_jerk_limits(trajopt):
    code, out, _ = trajopt("prove jerk-limit --within 0.01 --json")
    bound = json.loads(out)
    without = load("exact").solve(suite.load("jerk-limit").without("jerk")).trajectory
    assert (code, bound["status"]) == (0, "proved")
    assert 1.05 * without.duration < bound["lower_bound"] <= bound["upper_bound"]


def started(words, folder):
    """A command of its own process group, in which Ctrl-C is heard as in a terminal."""
    return subprocess.Popen(
        [sys.executable, "-m", "trajopt.cli", *words.split(), "--output", str(folder)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def test_ctrl_c_keeps_what_is_finished_and_says_how_to_go_on(tmp_path):
    # minutes, in small batches
    words = "compare six-axis --jobs 1 --planner pso:iterations=500 --seeds 3000"
    running = started(words, tmp_path)
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob("trials/*.json")) and time.monotonic() < deadline:
        time.sleep(0.1)
    running.send_signal(signal.SIGINT)
    _, err = running.communicate(timeout=60)
    assert running.returncode == 130
    assert err.strip().endswith("finished trials are kept, run the same command to go on")
    assert list(tmp_path.glob("trials/*.json"))


@pytest.mark.parametrize("began", [0.2, 0.5, 0.8])  # s: commands, the fork server, workers start
def test_ctrl_c_at_the_start_says_one_line_whoever_hears_it(tmp_path, began):
    running = started("compare six-axis --jobs 2", tmp_path)
    time.sleep(began)
    os.killpg(running.pid, signal.SIGINT)  # as a terminal does: everyone hears it
    _, err = running.communicate(timeout=60)
    # while Python itself starts it ends by the signal, or with a traceback of its own modules
    own = "KeyboardInterrupt" in err and "trajopt/" not in err
    if running.returncode != -signal.SIGINT and not own:
        assert running.returncode == 130
        assert len(err.strip().splitlines()) <= 1


# --- report ---


def test_report_writes_one_page_that_stands_alone(compared, trajopt):
    folder = compared[0] if isinstance(compared, tuple) else compared
    code, out, _ = trajopt("report", folder)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert (code, "report.html" in out) == (0, True)
    assert 'src="http' not in page


def test_report_makes_an_old_results_file_anew_and_says_so(compared, trajopt, tmp_path):
    folder = shutil.copytree(compared[0], tmp_path / "own")
    whole = (folder / "results.h5").read_bytes()
    (folder / "results.h5").write_bytes(b"HDF5 trajopt3" + bytes(32))
    code, _, err = trajopt("report", folder)
    assert (code, (folder / "results.h5").read_bytes() == whole) == (0, True)
    assert err.count("\n") == 1
    assert "made anew from the trials" in " ".join(err.split())
    assert trajopt("report", folder)[2] == ""


def test_report_of_a_folder_that_may_only_be_read(compared, trajopt, tmp_path, monkeypatch):
    folder = shutil.copytree(compared[0], tmp_path / "own")
    (folder / "results.h5").unlink()
    refused = OSError(errno.EROFS, os.strerror(errno.EROFS))

    def replace(temporary, path, own=os.replace):
        if Path(path).name == "results.h5":
            raise refused
        own(temporary, path)

    monkeypatch.setattr(os, "replace", replace)
    code, _, err = trajopt("report", folder, "--out", tmp_path / "page.html")
    assert (code, (tmp_path / "page.html").exists()) == (0, True)
    assert err.count("\n") == 1
    assert "results.h5: cannot be written: Read-only file system" in err


def test_a_mailed_results_file_alone_is_reported_and_exported(trajopt, tmp_path):
    planners = [("unoptimised", load("unoptimised"))]
    run.compare([suite.load("one-joint")], planners, tmp_path / "sent")
    mailed = Path(shutil.copy(tmp_path / "sent" / "results.h5", tmp_path / "from-a-friend.h5"))
    assert trajopt("report", mailed)[0] == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Every number is a\n    link to the trials" in page
    exports = {"csv": "trials.csv", "latex": "latex/planners.tex", "svg": "svg", "pdf": "pdf"}
    for to, name in exports.items():
        code, out, _ = trajopt("export", mailed, "--to", to)
        assert (code, Path(name).parts[0] in out) == (0, True)
        assert (tmp_path / name).exists()
    assert len(pd.read_csv(tmp_path / "trials.csv")) == len(Results(mailed).items)
    assert (tmp_path / "pdf" / "one-joint" / "durations.pdf").read_bytes().startswith(b"%PDF-")
    assert b"<svg" in (tmp_path / "svg" / "one-joint" / "durations.svg").read_bytes()


def test_export_takes_a_planner_of_a_file_as_compare_does(trajopt, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    source = "from trajopt.planners.registry import load\n"
    source += "def slow_one(problem):\n    return load('ruckig-stop').solve(problem)\n"
    (tmp_path / "exported_planner.py").write_text(source, encoding="utf-8")
    compared = "compare one-joint --planner exact --planner ./exported_planner.py:slow_one"
    assert trajopt(compared, "--output", tmp_path / "own")[0] == 0
    exported = "export own --to latex --against ./exported_planner.py:"
    assert trajopt(f"{exported}slow_one")[0] == 0
    table = (tmp_path / "own" / "latex" / "planners.tex").read_text(encoding="utf-8")
    assert "than one of slow_one" in table
    assert trajopt(f"{exported}nobody")[0] == 2


FORMULA_NAMES = r"""
name = "=cmd $x \\frac{1}"
angle_unit = "rad"
joint_names = ["$a$", "=cmd|x"]
waypoints = [[0.0, 0.0], [0.5, 0.2], [1.0, -0.3]]
[limits]
velocity = [1.0, 1.0]
acceleration = [2.0, 2.0]
"""


def test_names_like_formulas_are_explained_as_text(trajopt, tmp_path):
    file = tmp_path / "problem.toml"
    file.write_text(FORMULA_NAMES, encoding="utf-8")
    figures = tmp_path / "figures"
    code, out, err = trajopt("explain", file, "--planner ruckig-stop --output", figures)
    assert (code, err) == (0, "")
    words = " ".join(out.split())
    assert r"=cmd $x \frac{1}" in words
    assert "acceleration of $a$" in words
    drawn = "".join(path.read_text(encoding="utf-8") for path in figures.glob("*.svg"))
    assert r"=cmd $x \frac{1}: ruckig-stop" in drawn
    assert "$a$ acc." in drawn
    assert len(list(figures.glob("*.png"))) == 2


@dataclass(frozen=True)
class Drawn(Planner):
    """Stops at every waypoint, up to twice too slowly."""

    stochastic = True

    def solve(self, problem, *, seed=0):
        slower = 1 + (7 * seed % RUNS) / RUNS
        stopping = RuckigStop().solve(problem)
        return replace(stopping, trajectory=stopping.trajectory.dilated(slower))


def test_the_median_run_is_explained_unless_a_seed_is_named():
    problem = suite.load("one-joint")
    shortest = RuckigStop().solve(problem).trajectory.duration
    drawn = Supervised(("drawn", Drawn()), problem, 2)
    median = explained_run(drawn, problem, None)
    assert median.certified_duration == pytest.approx(shortest * (1 + 14 / 30), rel=1e-9)
    named = explained_run(drawn, problem, 4)
    assert named.certified_duration == pytest.approx(shortest * (1 + 28 / 30), rel=1e-9)
    drawn.close()
    with closing(Supervised("ruckig-stop", problem)) as stopping:
        assert explained_run(stopping, problem, None).seed == 0


def test_a_limit_of_one_segment_saves_what_that_segment_saves():
    """One joint from rest to 1 and, at V at most, to 11 rad: both times are known in closed form.

    It speeds up to p with p² = 1 + V²/2, passes at V, stays at V, and brakes.
    """

    def duration(v):
        return 2 * np.sqrt(1 + v**2 / 2) - v + (10 - v**2 / 2) / v + v

    pairs = [[[-10.0, 10.0]], [[-1.0, 1.0]]]
    problem = Problem([[0.0], [1.0], [11.0]], Limits(pairs, [1.0]))
    with closing(Supervised("exact", problem)) as planner:
        motion = planner.solve(problem).trajectory
        assert motion.duration == pytest.approx(duration(1.0), rel=1e-9)
        (row,) = [own for own in active_limits(problem, motion, planner) if own.limit == "velocity"]
    assert (row.joint, row.segment) == (0, 1)
    assert row.saving == pytest.approx(duration(1.0) - duration(1.01), abs=1e-8)


def test_a_results_folder_that_is_a_loop_of_links(trajopt, tmp_path):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    code, _, err = trajopt("compare one-joint --planner unoptimised --output", loop)
    assert code == 2
    assert len(err.strip().splitlines()) == 1
    assert "Too many levels of symbolic links" in err


@pytest.mark.skipif(sys.platform != "linux", reason="the shell's ulimit")
def test_too_few_open_files_are_one_line(tmp_path):
    command = [sys.executable, "-m", "trajopt.cli", "compare", "one-joint"]
    command += ["--planner", "unoptimised", "--output", str(tmp_path / "results")]
    shell = ["sh", "-c", 'ulimit -n 12; exec "$@"', "sh", *command]
    done = subprocess.run(shell, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "trajopt: Too many open files\n")


def test_a_second_ctrl_c_ends_as_the_first_and_none_is_heard_after_it(monkeypatch):
    from trajopt import cli as package

    def stopped(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "main", stopped)
    before = signal.getsignal(signal.SIGINT)
    try:
        with pytest.raises(SystemExit) as end:
            package.main([])
        assert end.value.code == 130
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
