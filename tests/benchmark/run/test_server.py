"""Workers that are forked are like fresh ones: what they know is the run's, not the server's."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from trajopt import Planner, Problem, Solution, Status, compare
from trajopt.benchmark.run import server

NAME = "TRAJOPT_TEST_FORK_SERVER"
# solvers start threads, figures take long
UNLOADED = ("casadi", "highspy", "matplotlib", "pandas")
LOOK = """
import os, sys
from importlib import import_module
from trajopt import compare  # as a planner's module may
from trajopt.benchmark.run import server
for name in server._LOADED:
    import_module(name)
print("scipy.optimize" in sys.modules)
for name in server._SHARED:
    import_module(name)
print(*(name for name in sys.argv[1:] if name in sys.modules))
print(len(os.listdir("/proc/self/task")))
"""
FOUND = "scipy.optimize" in sys.modules
LEFT = """
import os
from trajopt.benchmark.run import server
server.judge_link()
print(server._servers[0].process.pid, flush=True)
os._exit(0)
"""


@dataclass(frozen=True)
class Reporting(Planner):
    """Says what it finds in the environment."""

    stochastic = True

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        found = [os.environ.get(name, "nothing") for name in (NAME, "OMP_NUM_THREADS")]
        return Solution(Status.FAILED, message=" ".join(found))


@dataclass(frozen=True)
class Requiring(Planner):
    """Says what its process had loaded when it read this file."""

    requires = ("scipy.optimize",)

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        return Solution(Status.FAILED, message=f"found {FOUND}")


@dataclass(frozen=True)
class Drawing(Planner):
    """Draws from the global random streams, which nobody seeded."""

    option: int = 0

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        drawn = f"{random.random()} {np.random.random()}"  # noqa: NPY002
        return Solution(Status.FAILED, message=drawn)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems start fresh interpreters")
def test_what_is_loaded_before_forking_runs_no_threads() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOOK, *UNLOADED],
        env=os.environ | server.SINGLE_THREADED,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == ["False", "", "1"]


def test_what_planners_require_of_scipy_is_loaded_before_forking(tmp_path: Path) -> None:
    results = compare(["one-joint"], [("mine", Requiring())], tmp_path)
    said = {trial.planner: trial.message for trial in results.items}
    assert said["mine"] == "found True"


@pytest.mark.parametrize("sign", ["SIGKILL", "SIGSTOP"])
def test_a_judge_starts_although_its_server_was_just_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sign: str
) -> None:
    monkeypatch.setattr(server, "_START_TIMEOUT_S", 20.0 if sign == "SIGKILL" else 3.0)
    monkeypatch.setattr(server, "_END_TIMEOUT_S", 2.0)
    control, hit = server._control, []

    def dying() -> socket.socket:
        found = control()
        process = server._servers[-1].process
        if not hit:
            process.send_signal(getattr(signal, sign))
            hit.append(process.pid)
        return found

    monkeypatch.setattr(server, "_control", dying)
    results = compare(["one-joint"], ["ruckig-stop"], tmp_path)
    assert {str(trial.status) for trial in results.items} == {"solved"}
    assert hit


def test_workers_have_the_environment_of_their_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = []
    for value in ("first", "second"):
        monkeypatch.setenv(NAME, value)
        results = compare(["one-joint"], [("mine", Reporting())], tmp_path / value, seeds=1, jobs=1)
        said += [trial.message for trial in results.items if trial.planner == "mine"]
    assert said == ["first 1", "second 1"]


def test_no_two_workers_draw_the_same_random_numbers(tmp_path: Path) -> None:
    """NumPy 1 loads its global random stream itself, so that it exists before the fork."""
    entrants = [("a", Drawing()), ("b", Drawing(1))]
    results = compare(["one-joint"], entrants, tmp_path, jobs=1)
    said = [trial.message.split() for trial in results.items if trial.planner in "ab"]
    assert [len(set(numbers)) for numbers in zip(*said, strict=True)] == [2, 2]


def is_running(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return " Z " not in state


@pytest.mark.skipif(sys.platform != "linux", reason="other systems start fresh interpreters")
def test_the_server_ends_with_the_process_that_started_it() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LEFT], capture_output=True, text=True, check=True, timeout=60
    )
    # it holds standard output, so it was ending when that closed
    process = int(done.stdout)
    deadline = time.monotonic() + 120
    while is_running(process) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not is_running(process)
