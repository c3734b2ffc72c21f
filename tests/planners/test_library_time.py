"""The time inside a library: its parts are added up, callbacks do not count, answers state it."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import pytest

from trajopt import Limits, Planner, Problem, Solution, Status, Trajectory
from trajopt.benchmark.store import trial_text
from trajopt.benchmark.trial import trials_of
from trajopt.planners.library_time import inside_library, measured, outside_library

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [2.0]))
WAITS = Problem([[0.0], [1.0], [2.0]], Limits([1.0], [2.0]), demands={"dwell": [0, 0.5, 0]})


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test moves: `clock(seconds)`."""
    now = [100.0]

    def advance(seconds):
        now[0] += seconds

    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    return advance


def test_read_me_first(clock):
    with measured() as spent:
        clock(1)
        with inside_library():
            clock(2)
            with outside_library():  # the library asks for the objective
                clock(4)
            clock(8)
        clock(16)
        with inside_library():
            clock(32)
    assert spent.seconds == 2 + 8 + 32


def test_a_planner_within_a_planner_counts_for_both(clock):
    with measured() as whole:
        with inside_library():
            clock(1)
        with measured() as part, inside_library():
            clock(2)
    assert (whole.seconds, part.seconds) == (3, 2)


def test_what_a_library_raises_ends_its_part(clock):
    with measured() as spent:
        with suppress(ZeroDivisionError), inside_library():
            clock(1)
            raise ZeroDivisionError
        clock(2)
    assert spent.seconds == 1


def test_outside_of_any_planner_nothing_is_counted(clock):
    with inside_library():
        clock(1)


def motion(problem):
    samples = Trajectory.from_samples([0.0, 4.0], problem.waypoints, np.zeros((2, 1)))
    return Solution(Status.SOLVED, samples)


@dataclass(frozen=True)
class Wrapper(Planner):
    """Sleep in a library, and around it."""

    inside: float = 0.0
    outside: float = 0.0

    def solve(self, problem, *, seed=0):
        if self.inside:
            with inside_library():
                time.sleep(self.inside)
        time.sleep(self.outside)
        return motion(problem)


@dataclass(frozen=True)
class Batch(Wrapper):
    """Answer all seeds in one call of the library."""

    stochastic = True

    def solve_batch(self, problem, seeds):
        with inside_library():
            time.sleep(self.inside)
        return [motion(problem) for _ in seeds]


@pytest.fixture
def sleeping(clock, monkeypatch):
    monkeypatch.setattr(time, "sleep", clock)


@pytest.mark.usefixtures("sleeping")
def test_an_answer_states_the_time_in_the_library():
    assert Wrapper(2.0, 3.0).solve(PROBLEM).library_time == 2.0
    assert Wrapper(0.0, 3.0).solve(PROBLEM).library_time is None
    assert Wrapper(2.0, 3.0).solve(WAITS).library_time == 4.0  # two parts, from rest to rest
    batch = Batch(8.0).solve_batch(PROBLEM, [0, 1, 2, 3])
    assert [own.library_time for own in batch] == [2.0] * 4


@pytest.mark.usefixtures("sleeping")
def test_a_trial_has_the_part_and_the_whole():
    (trial,) = trials_of(Wrapper(2.0, 3.0), PROBLEM, [0])
    assert (trial.solve_time, trial.library_time) == (5.0, 2.0)
    assert trial.as_dict()["library_time"] == 2.0


@pytest.mark.parametrize("stated", [0.0, 1e6])
def test_the_part_is_at_most_the_whole(stated):
    (trial,) = trials_of(Wrapper(), PROBLEM, [0])
    assert trial.library_time is None
    lie = replace(trial, solution=replace(trial.solution, library_time=stated))
    assert lie.library_time == min(stated, trial.solve_time)


@pytest.mark.parametrize("stated", [-1.0, float("nan"), float("inf"), "fast"])
def test_a_time_that_is_none_is_a_crash(stated):
    @dataclass(frozen=True)
    class Wrong(Planner):
        def solve(self, problem, *, seed=0):
            return replace(motion(problem), library_time=stated)

    (trial,) = trials_of(Wrong(), PROBLEM, [0])
    assert trial.status is Status.CRASHED
    assert "library_time" in trial.message


def test_texts_keep_it_and_older_texts_have_none():
    (without,) = trials_of(Wrapper(), PROBLEM, [0])
    text = trial_text.write(without)
    assert b"library_time" not in text  # as texts were before
    assert trial_text.read(text).library_time is None
    own = replace(without, solution=replace(without.solution, library_time=1e-9))
    assert trial_text.read(trial_text.write(own)).solution.library_time == 1e-9
