"""No stranger's code runs where trials are judged, printed or drawn; what it does is one line."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from trajopt import (
    InvalidInput,
    Limits,
    Problem,
    Status,
    StoreError,
    TrajoptError,
    UnknownName,
    compare,
    plan,
)
from trajopt.benchmark.run import runner, server
from trajopt.benchmark.run.profile import _FLAGS, Profile
from trajopt.benchmark.run.runner import profiled
from trajopt.benchmark.run.tasks import Allowance
from trajopt.benchmark.store.folder import read
from trajopt.benchmark.trial import Trial
from trajopt.cli import main
from trajopt.planners import registry
from trajopt.planners.planner import Relation

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [1.0]), "one joint, 1 rad")
OPTIMUM = 2.0  # s: half of the way at 1 rad/s², half of it braking

PLANNER = """
import os, signal, sys, time
from dataclasses import dataclass, replace
AT_IMPORT
from trajopt import Planner
from trajopt.planners.registry import load

@dataclass(frozen=True)
class P(Planner):
    \"\"\"The optimum, half as slow again.\"\"\"
    stochastic = True
    factor: float = 1.5

    def unsupported(self, problem):
        UNSUPPORTED
        return None

    def solve(self, problem, *, seed=0):
        BEFORE
        found = load("exact").solve(problem)
        found = replace(found, trajectory=found.trajectory.dilated(self.factor))
        AFTER
        return found
"""
PATCH = "from trajopt.benchmark.trial import Trial; Trial.certified_duration = 0.001"


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Write a planner that does more than it should, in the working folder."""
    monkeypatch.chdir(tmp_path)

    def write(**code):
        text = PLANNER
        for place in ("AT_IMPORT", "UNSUPPORTED", "BEFORE", "AFTER"):
            text = text.replace(place, code.get(place.lower(), "pass"))
        (tmp_path / "p.py").write_text(text)
        return "./p.py:P"

    return write


@pytest.mark.parametrize("command", ["compare", "plan", "explain", "export"])
@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("1 / 0", r"ZeroDivisionError: division by zero \(.*p\.py, line 4\)"),
        ("sys.exit()", r"SystemExit: \(.*p\.py, line 4\)"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt"),
        ("print('so long'); os._exit(3)", "died with exit code 3.*; it printed last: so long"),
        ("os.kill(os.getpid(), 9)", "its process was killed"),
    ],
)
def test_a_planner_that_cannot_be_imported_is_a_line(file, capsys, code, words, command):
    spec = file(at_import=code)
    compare([PROBLEM], "exact", "kept")
    arguments = {
        "compare": ["one-joint", "--planner", spec, "--output", "new"],
        "plan": ["one-joint", "--planner", spec],
        "explain": ["one-joint", "--planner", spec],
        "export": ["kept", "--to", "latex", "--against", spec],
    }
    with pytest.raises(SystemExit) as stop:
        main([command, *arguments[command]])
    out, err = capsys.readouterr()
    assert (stop.value.code, out) == (2, "")
    assert re.fullmatch(rf"trajopt: planner '.*P' cannot be loaded: .*{words}.*\n", err)
    assert not Path("new").exists()


def test_an_import_that_hangs_meets_the_time_limit(file, monkeypatch):
    spec = file(at_import="time.sleep(600)")
    with pytest.raises(TrajoptError, match=r"cannot be loaded: stopped after 0\.5 s"):
        profiled(spec, [PROBLEM], Allowance(timeout=0.5))
    monkeypatch.setattr(runner, "IMPORT_TIMEOUT_S", 0.6)
    with pytest.raises(TrajoptError, match=r"cannot be loaded: stopped after 0\.6 s"):
        plan(PROBLEM, spec)


@pytest.mark.parametrize("place", ["at_import", "unsupported", "before", "after"])
def test_its_code_changes_nothing_here(file, place):
    """A class of this process stays as it is; `exact`, asked after it, is judged as always."""
    before = vars(Trial)["certified_duration"]
    results = compare([PROBLEM], [file(**{place: PATCH})], "r", seeds=2, jobs=2)
    assert vars(Trial)["certified_duration"] is before
    found = {(trial.planner, trial.seed): trial.certified_duration for trial in results.items}
    assert found["exact", 0] == pytest.approx(OPTIMUM, rel=1e-9)
    assert found["P", 0] == found["P", 1] == pytest.approx(1.5 * OPTIMUM, rel=1e-9)
    assert "p" not in sys.modules
    assert plan(PROBLEM, "./p.py:P").certified_duration == found["P", 0]


def test_another_package_on_its_path_judges_nothing(file, tmp_path):
    other = tmp_path / "other" / "trajopt"
    other.mkdir(parents=True)
    (other / "__init__.py").write_text("raise RuntimeError('another trajopt')\n")
    spec = file(at_import=f"sys.path.insert(0, {str(other.parent)!r})")
    results = compare([PROBLEM], [spec], "r", seeds=1)
    assert {trial.status for trial in results.items} == {Status.SOLVED}


@pytest.mark.parametrize("name", ["numbers", "json", "socket"])
def test_a_module_beside_a_script_hides_none_of_python_s(tmp_path, name):
    """The script has loaded Python's own; the processes that it starts have not."""
    (tmp_path / f"{name}.py").write_text("raise RuntimeError('not for you')\n")
    script = tmp_path / "script.py"
    script.write_text(
        f"import sys; here = sys.path.pop(0); import {name}; sys.path.insert(0, here)\n"
        "from trajopt import compare\n"
        "print(*(trial.status for trial in compare('one-joint', 'ruckig-stop').items))\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("solved\n", "")


def test_one_that_ends_its_process_in_solve_is_a_row_and_exit_code_1(file, capsys):
    spec = file(before="os._exit(0)")
    results = compare([PROBLEM], [spec], "r", seeds=1)
    assert {t.planner: str(t.status) for t in results.items} == {"P": "crashed", "exact": "solved"}
    with pytest.raises(SystemExit) as stop:
        main(["plan", "one-joint", "--planner", spec, "--json"])
    assert stop.value.code == 1
    assert json.loads(capsys.readouterr().out)["status"] == "crashed"


SERVER = "int(open(f'/proc/{os.getppid()}/stat').read().rpartition(')')[2].split()[1])"
KILLED = "the process that judged it was killed"
STOPPED = "the process that judged it took too long, or was stopped"


@pytest.mark.parametrize(
    ("sign", "whom", "message"),
    [
        ("SIGKILL", ["os.getppid()"], KILLED),
        ("SIGALRM", ["os.getppid()"], KILLED),
        ("SIGSTOP", ["os.getppid()"], STOPPED),
        ("SIGKILL", [SERVER, "os.getppid()"], KILLED),
        ("SIGSTOP", [SERVER, "os.getppid()"], STOPPED),
        ("SIGKILL", [SERVER], None),
        ("SIGSTOP", [SERVER], None),
    ],
)
def test_signals_to_its_judge_or_the_server_end_as_results(file, monkeypatch, sign, whom, message):
    """The run waits no longer than a trial and its judging may take, and judges the others."""
    monkeypatch.setattr(runner, "MIN_JUDGING_TIMEOUT_S", 2.0)
    monkeypatch.setattr(runner, "_END_TIMEOUT_S", 0.5)
    monkeypatch.setattr(server, "_END_TIMEOUT_S", 2.0)
    end = "; ".join(f"os.kill({process}, signal.{sign})" for process in whom)
    # a stopped process is waited for as long as a trial may take, which a busy machine needs
    timeout = 3.0 if sign == "SIGSTOP" else 60.0
    results = compare([PROBLEM], [file(before=end), "ruckig-stop"], "r", seeds=1, timeout=timeout)
    found = {trial.planner: trial for trial in results.items}
    statuses = {name: str(trial.status) for name, trial in found.items()}
    assert statuses.pop("P") == ("crashed" if message else "solved")
    # within three seconds a busy machine may not even start them
    answered = {"solved", "timeout"} if sign == "SIGSTOP" else {"solved"}
    assert statuses.keys() == {"exact", "ruckig-stop"}
    assert set(statuses.values()) <= answered
    assert (message or "") in found["P"].message


def test_limits_lowered_from_below_lose_nothing_that_has_finished(file):
    """A judge that may open no file says so, which ends the run; the next one goes on."""
    lower = "import resource; resource.prlimit(os.getppid(), resource.RLIMIT_NOFILE, (4, 4))"
    rivals = ["ruckig-stop", file(before=lower)]
    with pytest.raises((StoreError, OSError), match="Too many open files"):
        compare([PROBLEM], rivals, "r", seeds=1)
    done = {trial.planner for trial in read("r")}
    again = compare([PROBLEM], ["ruckig-stop"], "r", seeds=1)
    assert done <= {"exact", "ruckig-stop"}
    assert (again.kept.count if again.kept else 0) == len(done)
    assert {str(trial.status) for trial in again.items} == {"solved"}


@pytest.mark.parametrize("command", ["plan", "explain"])
def test_one_that_hangs_in_plan_or_explain_is_stopped(file, capsys, command):
    hanging = file(before="time.sleep(600)")
    extra = ["--seed", "0"] if command == "explain" else []
    with pytest.raises(SystemExit) as stop:
        main([command, "one-joint", "--planner", hanging, "--timeout", "1", *extra])
    assert stop.value.code == 1
    assert "stopped after 1 s" in capsys.readouterr().out


def test_what_it_is_comes_as_plain_data(file):
    profile = profiled(f"{file()}:factor=2", [PROBLEM], Allowance())
    assert profile.entrant.label == "P:factor=2.0"
    assert profile.entrant.options == {"factor": 2.0}
    assert profile.description == "The optimum, half as slow again."
    assert (profile.stochastic, profile.batched, profile.missing) == (True, False, None)
    assert profile.varies(PROBLEM)
    assert profile.relations == {PROBLEM.digest(): Relation.RESTRICTION}
    assert isinstance(profile.source, str)


def test_a_wrong_option_of_it_is_the_error_that_ours_give(file):
    spec = file()
    with pytest.raises(InvalidInput, match=r"option speed is '3': expected one of: factor"):
        profiled(f"{spec}:speed=3", [PROBLEM], Allowance())
    with pytest.raises(UnknownName, match=r"no planner of .*p\.py is called 'Q'"):
        profiled("./p.py:Q", [PROBLEM], Allowance())


@pytest.mark.parametrize(
    "change",
    [
        {"label": "exact"},
        {"label": "P\x1b[2J"},
        {"code": ["x"]},
        {"options": 3},
        {"refusals": None},
        {"relations": {"x": "BETTER"}},
        {"error": {"class": "SystemExit", "text": "no", "data": {}}},
        {"error": {"class": "InvalidInput"}},
        {"error": 3},
    ],
)
def test_a_description_that_no_planner_gives_is_refused(file, change):
    spec = registry.find(file())
    table = {
        "label": "P",
        "options": {},
        "code": ["", "", "0"],
        "description": "",
        "knows": [],
        "requires": [],
        "missing": None,
        "refusals": {},
        "relations": {},
    } | dict.fromkeys(_FLAGS, False)
    assert Profile.read(json.dumps(table).encode(), spec).entrant.name == "P"
    with pytest.raises(TrajoptError):
        Profile.read(json.dumps(table | change).encode(), spec)
