"""Running: a planner has a process of its own, and a judge that never runs its code."""

import os
from dataclasses import dataclass

from trajopt import Limits, Planner, Problem, Solution, Status, compare

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [1.0]), "one joint, 1 rad")


@dataclass(frozen=True)
class Reporting(Planner):
    """Tells its process, or ends it."""

    stochastic = True

    def solve(self, problem, *, seed=0):
        if seed == 1:
            os._exit(3)
        return Solution(Status.FAILED, stats={"process": os.getpid()})


@dataclass(frozen=True)
class Boasting(Planner):
    """Says that it solved the problem, without a trajectory."""

    def solve(self, problem, *, seed=0):
        return Solution(Status.SOLVED)


def trials(planner, folder, **options):
    results = compare([PROBLEM], [("mine", planner)], folder, jobs=1, **options)
    return [trial for trial in results.items if trial.planner == "mine"]


def test_a_planner_runs_in_a_process_of_its_own(tmp_path):
    (trial,) = trials(Reporting(), tmp_path, seeds=1)
    assert trial.solution.stats["process"] != os.getpid()


def test_a_planner_that_ends_its_process_is_a_trial_and_the_run_goes_on(tmp_path):
    found = {trial.seed: trial for trial in trials(Reporting(), tmp_path, seeds=3)}
    assert found[1].status is Status.CRASHED
    assert "exit code 3" in found[1].message
    assert found[2].status is Status.FAILED


def test_what_a_planner_says_is_not_believed(tmp_path):
    (trial,) = trials(Boasting(), tmp_path)
    assert trial.status is Status.FAILED
    assert trial.message == "reported solved without a trajectory"
