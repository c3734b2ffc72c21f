"""Worker processes: how they start, and that nothing of them is left."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from trajopt import Planner, Solution, Status, compare
from trajopt.planners.registry import load

SCRIPT = """
from dataclasses import dataclass
from trajopt import Planner, Solution, Status, compare

@dataclass(frozen=True)
class Mine(Planner):
    def solve(self, problem, *, seed=0):
        return Solution(Status.FAILED, message="no luck")

results = compare(["one-joint"], ["ruckig-stop", Mine()], "kept", jobs=1, fresh_reference=True)
print(sorted((trial.planner, str(trial.status)) for trial in results.items))
"""
EXPECTED = "[('Mine', 'failed'), ('exact', 'solved'), ('ruckig-stop', 'solved')]"
FAKE = "from pathlib import Path; Path({mark!r}).touch()"


def run(command: list[str], folder: Path, text: str | None = None):  # type: ignore[no-untyped-def]
    arguments = {"cwd": folder, "capture_output": True, "text": True, "timeout": 120}
    return subprocess.run(command, input=text, check=False, **arguments)  # type: ignore[call-overload]


def test_a_script_needs_no_guard_from_standard_input_neither(tmp_path: Path) -> None:
    done = run([sys.executable, "-"], tmp_path, SCRIPT)
    assert done.stdout.strip() == EXPECTED, done.stderr


def test_no_module_of_the_working_folder_runs(tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    for name in ("json", "numpy", "pebble", "socket", "trajopt"):
        (tmp_path / f"{name}.py").write_text(FAKE.format(mark=str(mark)))
    command = ["compare", "one-joint", "--planner", "ruckig-stop", "--jobs", "1"]
    program = Path(sys.executable).with_name("trajopt")
    done = run([str(program), *command], tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert not mark.exists()


@dataclass(frozen=True)
class Parent(Planner):
    """Starts a process that would live for minutes, then does as told."""

    pids: str
    then: str = "answer"

    def solve(self, problem, *, seed=0):  # type: ignore[no-untyped-def]
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(300)"])
        with Path(self.pids).open("a") as file:
            file.write(f"{child.pid}\n")
        if self.then == "die":
            os._exit(3)
        if self.then == "hang":
            time.sleep(300)
        return Solution(Status.FAILED, message="no")


def lives(pid: int) -> bool:
    """Tell if a process runs; a zombie does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def outlived(file: Path) -> list[int]:
    """Return the processes that still run after two minutes."""
    pids = [int(line) for line in file.read_text().split()]
    end = time.monotonic() + 120.0
    while any(map(lives, pids)) and time.monotonic() < end:
        time.sleep(0.05)
    return [pid for pid in pids if lives(pid)]


needs_groups = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")


@needs_groups
def test_what_a_planner_started_ends_with_its_trial_s_process(tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    results = []
    # what hangs takes all the time it is given: on a busy machine too little for its start
    for then, timeout in (("answer", 60.0), ("die", 60.0), ("hang", 2.0), ("hang", 20.0)):
        planner = (then, Parent(str(pids), then))
        results += compare(["one-joint"], [planner], tmp_path, jobs=1, timeout=timeout).items
        if then == "hang" and len(pids.read_text().split()) == 3:
            break
    statuses = {trial.planner: trial.status for trial in results}
    expected = {"answer": Status.FAILED, "die": Status.CRASHED, "hang": Status.TIMEOUT}
    assert {name: statuses[name] for name in expected} == expected
    assert len(pids.read_text().split()) == 3
    assert outlived(pids) == []


KILLED = """
import signal
import sys
sys.path.insert(0, {tests!r})
from test_workers import Parent
from trajopt import compare

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's `&` had it ignored
    compare(["one-joint"], [Parent({pids!r}, "hang")], {folder!r}, jobs=1)
"""


@needs_groups
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGKILL])
def test_what_a_planner_started_ends_with_the_run(tmp_path: Path, sign: signal.Signals) -> None:
    pids = tmp_path / "pids"
    file = tmp_path / "script.py"
    folder = str(tmp_path / "kept")
    here = str(Path(__file__).parent)
    file.write_text(KILLED.format(tests=here, pids=str(pids), folder=folder))
    running = subprocess.Popen(
        [sys.executable, str(file)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    end = time.monotonic() + 60.0
    while not (pids.exists() and pids.read_text()) and time.monotonic() < end:
        time.sleep(0.05)
    running.send_signal(sign)
    running.wait(timeout=60)
    assert outlived(pids) == []


@dataclass(frozen=True)
class Refusing(Planner):
    def solve(self, problem, *, seed=0):  # type: ignore[no-untyped-def]
        return Solution(Status.FAILED, message="no")


def test_names_objects_and_pairs_are_one_comparison(tmp_path: Path) -> None:
    problem = tmp_path / "mine.toml"
    problem.write_text(
        'angle_unit = "rad"\nwaypoints = [[0], [1]]\n[limits]\nvelocity = [1]\nacceleration = [1]\n'
    )
    planners = ["ruckig-stop", load("unoptimised"), ("mine", Refusing())]
    results = compare(["one-joint", problem], planners, tmp_path / "kept", fresh_reference=True)
    found = {(trial.problem.name, trial.planner) for trial in results.items}
    names = ("ruckig-stop", "Unoptimised", "mine", "exact")
    assert found == {(problem, name) for problem in ("one-joint", "mine") for name in names}
    assert results.kept is None
