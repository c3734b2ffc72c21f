"""The general transcription against closed forms, Ruckig, and its own limits."""

from __future__ import annotations

import numpy as np
import pytest
from work import one_in

from baselines.collocation.uniform import Collocation
from baselines.ruckig_ import section
from trajopt import InvalidInput, Limits, Problem, Status, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load, problem_files
from trajopt.benchmark.suites.random import random_problem


def solved(problem: Problem, intervals: int = 20) -> Trajectory:
    solution = Collocation(intervals).solve(problem)
    assert solution.status is Status.SOLVED, solution.message
    assert solution.trajectory is not None
    return solution.trajectory


@pytest.mark.parametrize("name", problem_files())
def test_keeps_every_limit_as_claimed(name: str) -> None:
    certificate = verify(load(name), solved(load(name)))
    assert certificate.feasible, certificate.flaws


@pytest.mark.parametrize("seed", one_in(4, range(10)))
@pytest.mark.parametrize("jerk", [False, True])
def test_keeps_every_limit_on_random_problems(seed: int, jerk: bool) -> None:
    problem = random_problem(seed, jerk=jerk)
    certificate = verify(problem, solved(problem))
    assert certificate.feasible, certificate.flaws


def test_two_waypoints_with_jerk_tend_to_ruckig() -> None:
    limits = Limits([1.0, 0.7], [2.0, 1.5], [12.0, 5.0])
    problem = Problem([[0, 0], [0.9, -0.4]], limits)
    zero = np.zeros(2)
    ends = [(waypoint, zero, zero) for waypoint in problem.waypoints]
    optimum, _ = section(limits, *ends)
    durations = [solved(problem, n).duration for n in (20, 40, 80)]
    gaps = [duration / optimum - 1 for duration in durations]
    assert min(gaps) > -1e-7
    assert gaps[2] < 0.5 * gaps[0]
    assert gaps[2] < 2e-3


def test_an_even_number_of_intervals_reaches_the_triangle() -> None:
    problem = Problem([[0.0], [0.08]], Limits([10.0], [2.0]))
    assert solved(problem, 2).duration == pytest.approx(2 * np.sqrt(0.08 / 2), rel=1e-7)


def test_position_limits_cost_time_and_are_kept() -> None:
    problem = load("position-limits")
    boxed = solved(problem)
    free = solved(problem.without("position"))
    assert not verify(problem, free).valid
    assert verify(problem, boxed).feasible
    assert boxed.duration > free.duration * 1.01


def test_a_waypoint_on_its_position_limit_is_passed() -> None:
    limits = Limits([1.0], [2.0], position=[[0.0, 1.0]])
    problem = Problem([[0.0], [1.0], [0.2]], limits)
    assert verify(problem, solved(problem)).feasible


def test_mixed_jerk_limits() -> None:
    limits = Limits([1.0, 1.0], [2.0, 2.0], [np.inf, 10.0])
    problem = Problem([[0, 0], [0.5, 0.6], [1, 0.2]], limits)
    assert verify(problem, solved(problem)).feasible


def test_too_few_intervals_are_refused() -> None:
    with pytest.raises(InvalidInput, match="intervals is 1: expected at least 2"):
        Collocation(intervals=1)


def test_a_jerk_limit_on_one_side_only_is_unsupported() -> None:
    limits = Limits([1.0], [1.0], [[-np.inf, 5.0]])
    assert "one side" in str(Collocation().unsupported(Problem([[0.0], [1.0]], limits)))


def test_each_segment_has_its_own_limits():
    # up to 1.58 rad/s and down to 1 rad/s, which the second segment allows: a closed form
    problem = load("sections-slow")
    found = Collocation(intervals=40).solve(problem).trajectory
    peak = np.sqrt(2.5)
    optimum = peak / 2 + (peak - 1) / 2 + 0.75 + 0.5
    certified = verify(problem, found).certified_duration
    assert optimum * (1 - 1e-9) <= certified <= optimum * 1.01
