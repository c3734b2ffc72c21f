"""Workers that are forked are like fresh ones: what they know is the run's, not the server's."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from trajopt import Planner, Problem, Solution, Status, compare

NAME = "TRAJOPT_TEST_FORK_SERVER"
# solvers start threads, figures take long, and workers would share one global random stream
UNLOADED = ("casadi", "highspy", "matplotlib", "numpy.random", "pandas", "scipy.optimize")
LOOK = """
import sys
from importlib import import_module
from trajopt.benchmark.run import server
for name in server._LOADED:
    import_module(name)
print(*(name for name in sys.argv[1:] if name in sys.modules))
"""
LEFT = """
import os
from trajopt.benchmark.run import server
server.judge()
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


def test_what_is_loaded_before_forking_neither_runs_threads_nor_draws_random_numbers() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOOK, *UNLOADED], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


def test_workers_have_the_environment_of_their_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = []
    for value in ("first", "second"):
        monkeypatch.setenv(NAME, value)
        results = compare(["one-joint"], [("mine", Reporting())], tmp_path / value, seeds=1, jobs=1)
        said += [trial.message for trial in results.items if trial.planner == "mine"]
    assert said == ["first 1", "second 1"]


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
    server = int(done.stdout)
    deadline = time.monotonic() + 30
    while is_running(server) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not is_running(server)
