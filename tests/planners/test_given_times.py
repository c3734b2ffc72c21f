"""Times that are given: an optimum's own are kept, and those that no motion keeps are proved so."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites.catalogue import load
from trajopt.core.solution import Status
from trajopt.planners.given_times import impossible

V, A = Limits([2.0], [1e9]), Limits([1e9], [2.0])


@pytest.mark.parametrize(
    ("waypoints", "limits", "given", "needed", "more"),
    [
        # at the velocity limit: 1 rad at 2 rad/s
        ([[0.0], [1.0], [3.0], [4.0]], V, [9.0, 0.98, 9.0], 1.0, {}),
        # from rest: h = A T²/2
        ([[0.0], [1.0], [2.0]], A, [0.98, 9.0], 1.0, {}),
        # to rest, likewise
        ([[0.0], [1.0], [2.0]], A, [9.0, 0.98], 1.0, {}),
        # from rest to rest: 2 √(h/A)
        ([[0.0], [0.5]], A, [0.98], 1.0, {}),
        # a tolerance takes 0.25 rad off
        ([[0.0], [1.25], [3.0]], A, [0.98, 9.0], 1.0, {"tolerance": 0.25}),
    ],
)
def test_a_time_that_is_too_short(waypoints, limits, given, needed, more):
    problem = Problem(waypoints, limits, demands={"given_times": given, **more})
    solution = Exact().solve(problem)
    segment = int(np.argmin(given))
    assert solution.status is Status.INFEASIBLE
    assert solution.message == (
        f"segment {segment + 1} is given 0.98 s, and joint 1 takes {needed:g} s at least: "
        "0.02 s too little"
    )
    enough = np.array(given) / 0.98 * (1 + 1e-6)
    assert impossible(Problem(waypoints, limits, demands={"given_times": enough, **more})) is None


def test_in_motion_a_first_segment_needs_no_speeding_up():
    """0.5 s at 2 rad/s, where rest would take 1 s."""
    given = {"given_times": [0.5, 9.0], "start_velocity": [2.0]}
    assert impossible(Problem([[0.0], [1.0], [2.0]], A, demands=given)) is None


@pytest.mark.parametrize("name", ["six-axis", "reversal", "seven-waypoints", "jerk-limit"])
@pytest.mark.parametrize("longer", [1.0, 1 + 1e-9, 1.3])
def test_an_optimums_own_times_are_kept(name, longer):
    problem = load(name)
    planner = ExactJerk() if problem.has("jerk") else Exact()
    optimum = planner.solve(problem).trajectory
    times = longer * np.diff(optimum.waypoint_times)
    given = Problem(problem.waypoints, problem.limits, given_times=times)
    solution = planner.solve(given)
    assert solution.status is Status.SOLVED
    duration = verify(given, solution.trajectory).certified_duration
    assert duration == pytest.approx(longer * optimum.duration, rel=2e-9)
