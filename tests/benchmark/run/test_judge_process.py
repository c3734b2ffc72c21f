"""What a judge makes of what comes out of a planner's process."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

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
        time.sleep(1.0 if seed == 0 and self.option < 2 else 0.0)
        where = {"process": os.getpid(), "folder": os.getcwd()}
        os.chdir(os.sep)
        return Solution(Status.FAILED, message="no", stats=where)


def test_a_planner_has_a_process_of_its_own_whose_clock_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    entrants = [("a", Stopping()), ("b", Stopping(1))]
    results = compare([PROBLEM], entrants, "kept", seeds=2, jobs=1)
    mine = {(t.planner, t.seed): t for t in results.items if t.planner in "ab"}
    assert {trial.message for trial in mine.values()} == {"no"}
    process = {key: trial.solution.stats["process"] for key, trial in mine.items()}
    assert process["a", 0] == process["a", 1] != process["b", 0]
    assert os.getpid() not in process.values()
    assert mine["a", 0].solution.stats["folder"] == str(tmp_path)
    assert mine["a", 0].solve_time >= 1.0
    assert mine["a", 1].solve_time < 1.0
    assert "own" in mine["a", 0].provenance["isolation"]
    assert len(list(tmp_path.glob("kept/trials/*.json"))) == len(results.items)


def test_a_message_holds_every_number_of_an_answer_exactly() -> None:
    rng = np.random.default_rng(0)
    trajectory = Trajectory([0, 0.1, 0.3], rng.normal(size=(4, 2, 3)), [0, 0.3])
    history = np.array([[1.0, np.nan], [2.0, 1 / 3]])
    stats = {"array": rng.normal(size=(2, 2)), "counts": np.arange(3), "text": "x", "inf": np.inf}
    whole = Solution(Status.SOLVED, trajectory, "said", 0.1, 7, history, 0.2, stats)
    sent = Answers([whole], Relation.SAME, 0.3, 0.4)
    (got,) = answer.unpacked(answer.packed(sent), 1).solutions
    for name in ("breaks", "coefficients", "waypoint_times"):
        np.testing.assert_array_equal(getattr(got.trajectory, name), getattr(trajectory, name))
    np.testing.assert_array_equal(got.history, history)
    for name, value in stats.items():
        np.testing.assert_array_equal(got.stats[name], value)
    assert got.stats["counts"].dtype == np.arange(3).dtype
    rest = (got.status, got.message, got.lower_bound, got.evaluations, got.setup_time)
    assert rest == (Status.SOLVED, "said", 0.1, 7, 0.2)
