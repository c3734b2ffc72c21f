"""Problems that a planner solves together: one that hangs or crashes costs its own trial only."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from trajopt import Limits, Problem, Solution, Status, Trajectory
from trajopt.benchmark.run.runner import profiled
from trajopt.benchmark.run.tasks import Allowance, tasks_of, together
from trajopt.comparison import compare
from trajopt.planners.planner import Planner

LIMITS = Limits([1.0], [2.0])
FIRST = 0.25  # where the problem begins that goes wrong


def problems(count):
    starts = FIRST * np.arange(1, count + 1)
    return [Problem([[x], [x + 1.0]], LIMITS, f"from {x:g}") for x in starts]


@dataclass(frozen=True)
class Many(Planner):
    """Goes wrong on one problem, as told; leaves a mark in `log` whenever it runs."""

    does: str = ""
    log: str = ""

    def solve(self, problem, *, seed=0):
        return self._solved([problem])[0]

    def solve_many(self, problems, seeds=None):
        return self._solved(problems)

    def _solved(self, problems):
        with Path(self.log).open("a") as file:
            file.write(f"{len(problems)}\n")
        if FIRST in [problem.waypoints[0, 0] for problem in problems]:
            match self.does:
                case "raise":
                    raise RuntimeError("I will not")
                case "hang":
                    time.sleep(600)
                case "die":
                    os._exit(7)
        lines = [np.stack([own.displacements / 4, own.waypoints[:-1]]) for own in problems]
        if self.does == "few":
            lines = lines[len(lines) // 2 :]
        return [Solution(Status.SOLVED, Trajectory([0, 4.0], line, [0, 4.0])) for line in lines]


WRONG = {
    "": None,
    "raise": (Status.CRASHED, "I will not"),
    "hang": (Status.TIMEOUT, "stopped after 8 s"),
    "die": (Status.CRASHED, "exit code 7"),
    "few": None,
}


@pytest.mark.parametrize(
    ("does", "jobs"),
    [
        *(("", 1), ("die", 1), ("raise", 0), ("few", 0)),
        pytest.param("hang", 1, marks=pytest.mark.long),
    ],
)
def test_what_goes_wrong_costs_its_own_trial_only(tmp_path, does, jobs):
    planner = ("many", Many(does, str(tmp_path / "log")))
    limit = {"timeout": 8.0} if does == "hang" else {}
    found = compare(problems(3), [planner], tmp_path, jobs=jobs, progress=False, **limit)
    mine = {own.problem.name: own for own in found.items if own.planner == "many"}
    assert len(mine) == 3
    first = mine.pop("from 0.25")
    alone = ["1"] * 3 if does else []
    assert (tmp_path / "log").read_text().split() == ["3", *alone]
    if WRONG[does]:
        status, said = WRONG[does]
        assert first.status is status
        assert said in first.message
    else:
        mine["first"] = first
    # the lines jump from rest: the judge says so, whoever solved them together
    assert {own.status for own in mine.values()} == {Status.INVALID}
    assert {own.batch for own in mine.values()} == {1 if does else 3}


def test_groups_are_of_one_planner_and_one_shape_and_leave_no_worker_idle():
    alike, other = problems(5), Problem([[0.0], [1.0], [2.0]], LIMITS)
    asked = [*alike, other]
    profile = profiled(("many", Many()), asked, Allowance())
    tasks = tasks_of(asked, [profile], 1, pytest.fail, [own.digest() for own in asked])
    assert [len(group) for group in together(tasks, 1)] == [5, 1]
    assert sorted(len(group) for group in together(tasks, 2)) == [1, 2, 3]
