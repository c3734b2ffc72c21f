"""The planner `smooth`: closed forms, an independent program's values, limits kept everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.front.planner import Smooth
from trajopt.benchmark.suites.catalogue import load
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.judging.smoothness import smoothness
from trajopt.judging.verification import verify

FAR = Limits(velocity=[100.0], acceleration=[1000.0])


def solved(problem, **options):
    solution = Smooth(**options).solve(problem)
    assert solution.status is Status.SOLVED, solution.message
    certificate = verify(problem, solution.trajectory)
    assert certificate.valid
    assert certificate.dilation <= 1 + 1e-8
    found = smoothness(problem, solution.trajectory)
    by_measure = {"jerk": found.jerk_integral, "acceleration": found.acceleration_integral}
    value = by_measure[options.get("measure", "jerk")]
    assert value == pytest.approx(solution.stats["value"], rel=1e-9)
    return solution.trajectory.duration, value


@pytest.mark.parametrize(
    ("measure", "constant", "power"), [("jerk", 720, 5), ("acceleration", 12, 3)]
)
def test_rest_to_rest_in_closed_form(measure, constant, power):
    problem = Problem([[0.0], [2.0]], FAR)
    duration, value = solved(problem, measure=measure, duration=1.5)
    assert duration == pytest.approx(1.5, rel=1e-12)
    assert value == pytest.approx(constant * 4 / 1.5**power, rel=1e-9)
    duration, _ = solved(problem, measure=measure, budget=constant * 4 / 1.5**power)
    assert duration == pytest.approx(1.5, rel=1e-9)


def test_a_velocity_limit_in_closed_form():
    """Parabolic ramps of time r to the limit and back: D − 2r/3 = h/V, and 8V²/(3r)."""
    problem = Problem([[0.0], [1.0]], Limits(velocity=[1.2], acceleration=[100.0]))
    ramp = 1.5 * (1 - 1 / 1.2)
    _, value = solved(problem, measure="acceleration", duration=1.0)
    assert value == pytest.approx(8 * 1.2**2 / (3 * ramp), rel=1e-4)


@pytest.mark.parametrize(
    ("duration", "low", "high"),
    [(1.8, 921.86, 922.36), (2.0, 518.93, 518.96), (4.3104, 11.0738, 11.0742)],
)
def test_six_axis_lies_where_an_independent_program_says(duration, low, high):
    """Piecewise linear jerk, limits at 48 cells a segment: below; 24 Hermite pieces: above."""
    _, value = solved(load("six-axis"), duration=duration)
    assert low < value < high


def test_six_axis_within_the_353s_own_smoothness():
    """The independent program's durations: 1.7632 s with 48 cells, 1.7634 s keeps all limits."""
    duration, value = solved(load("six-axis"), budget=1044.0)
    assert duration == pytest.approx(1.7634, abs=1e-4)
    assert value == pytest.approx(1044.0, rel=1e-6)


@pytest.mark.parametrize("measure", ["jerk", "acceleration"])
@pytest.mark.parametrize("name", ["jerk-limit", "position-limits", "asymmetric", "seven-waypoints"])
def test_every_kind_of_limit_is_kept(name, measure):
    problem = load(name)
    slow, value = solved(problem, measure=measure)
    slower, less = solved(problem, measure=measure, duration=1.2 * slow)
    assert slower > slow
    assert less < value


def test_near_the_minimum_and_below_it():
    six_axis = load("six-axis")
    duration, _ = solved(six_axis, duration=1.5)
    assert duration == pytest.approx(1.5)
    below = Smooth(duration=1.2).solve(six_axis)
    assert below.status is Status.INFEASIBLE
    assert "1.2 s" in below.message


@pytest.mark.parametrize(
    "options",
    [{"measure": "snap"}, {"duration": -1.0}, {"budget": np.inf}, {"duration": 2.0, "budget": 1.0}],
)
def test_options_that_cannot_be_used_are_named(options):
    with pytest.raises(InvalidInput, match=next(reversed(options))):
        Smooth(**options)


def test_units_and_dilation_change_nothing():
    six_axis = load("six-axis")
    _, value = solved(six_axis, duration=1.8)
    slower = Limits(six_axis.limits.velocity / 1e3, six_axis.limits.acceleration / 1e6)
    _, slow = solved(Problem(six_axis.waypoints, slower), duration=1800.0)
    assert slow == pytest.approx(value / 1e15, rel=1e-4)
