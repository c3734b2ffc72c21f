"""A change of units changes no planner's answer: other lengths, other times, both at once."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites.random import random_problem
from trajopt.planners.planner import Planner
from trajopt.planners.registry import configured, entries, options

# Largest relative change of a certified duration by other units: rounding, or a solver's tolerance.
DEFAULT_RTOL = 1e-9
RTOL = {
    "exact-jerk": 1e-8,  # its solver's tolerance
    "collocation-refined": 1e-7,  # IPOPT's tolerance, on a grid of its own making
}
# Planners whose answers depend on the unit of time, and why. That of length changes none of them.
NOT_IN_TIME = {
    "unoptimised": "its option is a time of 2 s",
    "ssa": "eq. 41 divides segment times by durations, and adds that ratio to a segment time",
    "issa": "eq. 41, as for ssa",
}
NOT_WITH_JERK = {
    "prove": "its trajectory is exact-jerk's",
    "copp": "its cone solver stops early: rounding alone changes 1e-4 to 1e-3",
    "drake-kto": "SNOPT finds a spline or none",
    "gcs": "SNOPT finds curves or none",
}
NOT_AT_ALL = dict.fromkeys(
    ("totg", "totg-ruckig"),
    "it rounds the path's corners by a tolerance that is an option, in radians",
)
QUICK = {
    "iterations": 20,
    "gridpoints": 100,
    "evaluations": 300,
    "starts": 1,
    "rounds": 6,
    "refinements": 1,
    "within": 1e-2,
    "knots": "limit",
    "ends": "natural",
}
# Lengths larger and times smaller, so that every limit changes by another factor.
UNITS = [(1e3, 1e-3)]
# Powers of two round nothing: a search that rounding can lead astray takes the same path.
LENGTHS_ONLY = [(2.0**10, 1.0)]
CASES = [
    (name, jerk)
    for name, entry in entries().items()
    for jerk in (False, True)
    if entry.missing() is None
    if name not in NOT_AT_ALL and not (jerk and name in NOT_WITH_JERK)
]


def in_units(problem: Problem, length: float, time: float) -> Problem:
    """A problem in other units: a radian is `length` units long, and a second `time`."""
    rate = length / time
    limits = Limits(
        velocity=problem.limits.velocity * rate,
        acceleration=problem.limits.acceleration * rate / time,
        jerk=problem.limits.jerk * rate / time**2,
        position=problem.limits.position * length,
    )
    return Problem(problem.waypoints * length, limits)


def quick(name: str) -> Planner:
    planner = entries()[name].load()
    own = options(planner)
    less = {}
    for option, value in QUICK.items():
        # the rules of paths are words, of which one is the best of all
        if option in own and (own[option] == "best" or not isinstance(value, str)):
            less[option] = value
    return configured(planner, less, name)


def duration(planner: Planner, problem: Problem) -> float:
    trajectory = planner.solve(problem, seed=3).trajectory
    assert trajectory is not None
    certified = verify(problem, trajectory).certified_duration
    assert certified is not None
    return certified


@pytest.mark.parametrize(("name", "jerk"), CASES)
def test_other_units_change_no_answer(name: str, jerk: bool) -> None:
    planner = quick(name)
    problem = random_problem(2, waypoints=4, jerk=jerk).only([0, 1])
    lifted = jerk and "jerk" not in planner.knows
    if lifted or planner.unsupported(problem):
        pytest.skip("not for jerk limits")
    expected = duration(planner, problem)
    units = LENGTHS_ONLY if name in NOT_IN_TIME else UNITS
    for length, time in units:
        other = duration(planner, in_units(problem, length, time)) / time
        assert other == pytest.approx(expected, rel=RTOL.get(name, DEFAULT_RTOL))


@pytest.mark.parametrize("name", ["spline353-nlp", "pso"])
def test_position_limits_count_in_degrees_and_milliseconds_too(name: str) -> None:
    free = random_problem(1, waypoints=4).only([0, 1])
    low = free.waypoints.min(axis=0) - 0.02
    high = free.waypoints.max(axis=0) + 0.02
    stacked = np.stack([low, high], axis=1)
    limits = free.limits.by_name() | {"position": stacked}
    problem = Problem(free.waypoints, Limits(**limits))
    planner = quick(name)
    if name == "pso":
        planner = configured(planner, {"fitness": "scaled", "evaluations": 2000}, name)
    expected = duration(planner, problem)
    milliseconds = in_units(problem, 180 / np.pi, 1e3)
    other = duration(planner, milliseconds) / 1e3
    assert other == pytest.approx(expected, rel=DEFAULT_RTOL)
