"""The judge's side of a planner's process: its clock, its folder, its message."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from trials import assert_same

from trajopt import Limits, Planner, Problem, Solution, Status, Trajectory, compare
from trajopt.benchmark.run import answer
from trajopt.benchmark.trial import Answers
from trajopt.planners.planner import Relation

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [1.0]), "one joint, 1 rad")


@dataclass(frozen=True)
class Stopping(Planner):
    """Stops its clock, and says which process it is in and where that works."""

    stochastic = True
    option: int = 0

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        began = time.perf_counter()
        time.perf_counter = lambda: began
        time.sleep(2.0 if seed == 0 and self.option < 2 else 0.0)
        where = {"process": os.getpid(), "folder": os.getcwd()}
        os.chdir(os.sep)
        return Solution(Status.FAILED, message="no", stats=where)


def test_a_planner_has_a_process_of_its_own_whose_clock_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    entrants = [("a", Stopping()), ("b", Stopping(2))]  # the latter does not sleep
    results = compare([PROBLEM], entrants, "kept", seeds=2, jobs=1)
    trials = {trial.label + str(trial.seed): trial for trial in results.items}
    slow = trials["a0"]
    fast = trials["a1"]
    other = trials["b0"]
    for trial in (slow, fast, other):
        assert trial.message == "no"
        assert trial.solution.stats["process"] != os.getpid()
    assert slow.solution.stats["process"] == fast.solution.stats["process"]
    assert slow.solution.stats["process"] != other.solution.stats["process"]
    assert slow.solution.stats["folder"] == str(tmp_path)
    assert slow.solve_time >= 2.0
    assert fast.solve_time < 2.0
    assert "own" in slow.provenance["isolation"]
    files = list(tmp_path.glob("kept/trials/*.json"))
    assert len(files) == len(results.items)


def test_a_message_holds_every_number_of_an_answer_exactly() -> None:
    rng = np.random.default_rng(0)
    coefficients = rng.normal(size=(4, 2, 3))
    stats = {"array": rng.normal(size=(2, 2)), "counts": np.arange(3), "text": "x", "inf": np.inf}
    whole = Solution(
        Status.SOLVED,
        Trajectory([0, 0.1, 0.3], coefficients, [0, 0.3]),
        message="said",
        lower_bound=0.1,
        evaluations=7,
        history=np.array([[1.0, np.nan], [2.0, 1 / 3]]),
        setup_time=0.2,
        stats=stats,
    )
    message = answer.packed(Answers([whole], Relation.SAME, 0.3, 0.4))
    (got,) = answer.unpacked(message, 1).solutions
    assert_same(got, whole)
    assert got.stats["counts"].dtype == stats["counts"].dtype


@dataclass(frozen=True)
class Verbose(Planner):
    """Answers with a list of so many lists, or what its process sends is so many."""

    lists: int = 0
    sent: int = 0

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        if self.sent:
            answer.packed = lambda _: b"[" + b"[]," * self.sent + b"[]]"
        return Solution(Status.FAILED, message="no", stats={"x": [[]] * self.lists})


@pytest.mark.parametrize("many", ["lists", "sent"])
def test_an_answer_of_too_many_values_is_not_decoded(tmp_path: Path, many: str) -> None:
    """Three bytes take a hundred times the memory when they are decoded."""
    planner = Verbose(**{many: 2_100_000})
    results = compare([PROBLEM], [("verbose", planner), "ruckig-stop"], tmp_path)
    said = {trial.planner: (trial.status, trial.message) for trial in results.items}
    assert said["verbose"][0] is Status.CRASHED
    assert "its answer has more than 2000000 values" in said["verbose"][1]
    assert said["exact"][0] is said["ruckig-stop"][0] is Status.SOLVED
