"""The gate: what the judge does not certify is not `solved`; easier problems are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from baselines.exact.method import gate
from trajopt import Limits, Problem, verify
from trajopt.core.solution import Solution, Status

PROBLEM = Problem([[0.0], [1.0], [0.3]], Limits([2.0], [3.0]), tolerance=0.1)
NEAR = Problem([[0.0], [0.9], [0.3]], Limits([2.0], [3.0]))


def failing(_):
    return Solution(Status.FAILED, message="no start succeeded")


def beside(problem):
    """Return a motion that misses every waypoint."""
    own = Exact().solve(NEAR).trajectory
    return Solution(Status.SOLVED, replace(own, coefficients=own.coefficients + 5.0))


def exactly(problem):
    """Fail where there are tolerances."""
    return failing(problem) if "tolerance" in problem.demands else Exact().solve(problem)


@pytest.mark.parametrize("answer", [failing, beside])
def test_nothing_certified_is_not_solved(answer):
    solution = gate.certified(PROBLEM, answer, answer)
    assert solution.status == (Status.FAILED if answer is failing else Status.INVALID)
    if answer is beside:
        assert "misses the waypoint by" in solution.message


@pytest.mark.parametrize("answer", [failing, beside])
def test_the_exact_points_are_an_answer(answer):
    def own(problem):
        return answer(problem) if "tolerance" in problem.demands else exactly(problem)

    solution = gate.certified(PROBLEM, own, answer)
    assert solution.status is Status.SOLVED
    assert solution.message.startswith("through the points, as its own answer is not certified (")
    assert verify(PROBLEM, solution.trajectory).feasible


@pytest.mark.parametrize("share", gate.LADDER[:-1])
def test_smaller_tolerances_are_tried_in_order(share):
    most = share * PROBLEM.demands["tolerance"]

    def own(problem):
        wider = (problem.route.demand("tolerance") > most * (1 + 1e-12)).any()
        return failing(problem) if wider else Exact().solve(problem)

    solution = gate.certified(PROBLEM, own, failing)
    assert solution.message.startswith(f"planned within {share:g} of the tolerances")
    assert verify(PROBLEM, solution.trajectory).feasible


def test_a_stop_at_every_waypoint_is_the_last_resort():
    """From rest to rest over 1 rad and 0.7 rad: h/V + V/A and 2 √(h/A)."""
    solution = gate.certified(PROBLEM, failing, Exact().solve)
    assert solution.message.startswith("stops at every waypoint")
    stopping = 2 * np.sqrt([1.0 / 3.0, 0.7 / 3.0]).sum()
    duration = verify(PROBLEM, solution.trajectory).certified_duration
    assert duration == pytest.approx(stopping, rel=1e-12)


def test_a_start_in_motion_has_a_last_resort_too():
    problem = Problem(
        [[0.0], [1.0], [0.3]], Limits([2.0], [3.0], [20.0]), start_velocity=[0.5], tolerance=0.1
    )
    solution = gate.certified(problem, failing, ExactJerk().solve)
    assert solution.status is Status.SOLVED
    assert verify(problem, solution.trajectory).feasible


@pytest.mark.parametrize("status", [Status.RELAXED, Status.UNSUPPORTED, Status.INFEASIBLE])
def test_what_makes_no_such_claim_passes_unchanged(status):
    answer = Solution(status, message="as it is")
    assert gate.certified(PROBLEM, lambda _: answer, failing) is answer


@pytest.mark.parametrize("planner", [Exact(), ExactJerk()])
def test_many_near_points_within_tolerance(planner):
    """Points of a circle that noise moves: no slower than through the points as they are."""
    angle = np.linspace(0.0, 2.0, 16)[:, None]
    points = np.hstack([np.cos(angle), np.sin(angle)])
    points += 1e-3 * np.random.default_rng(0).normal(size=points.shape)
    jerk = [60.0, 60.0] if isinstance(planner, ExactJerk) else None
    limits = Limits([2.0, 2.0], [8.0, 8.0], jerk)
    exact = planner.solve(Problem(points, limits)).trajectory.duration
    found = [exact]
    for tolerance in (0.002, 0.01):
        problem = Problem(points, limits, tolerance=tolerance)
        solution = planner.solve(problem)
        assert solution.status is Status.SOLVED
        found.append(verify(problem, solution.trajectory).certified_duration)
    assert np.diff(found).max() <= 1e-9


@pytest.mark.parametrize("jerk", [None, [1e3]])
def test_given_times_that_only_a_bound_proves_impossible(jerk):
    """There and back takes 2 √(1/2) s each way; alone each segment could be passed in 1 s."""
    least = 2 * np.sqrt(0.5)
    limits = Limits([9.0], [2.0], jerk)
    planner = Exact() if jerk is None else ExactJerk()
    for share, status in ((0.9, Status.INFEASIBLE), (1.05, Status.SOLVED)):
        given = {"given_times": [share * least] * 2}
        solution = planner.solve(Problem([[0.0], [1.0], [0.0]], limits, demands=given))
        assert solution.status is status
        assert ("a bound proves" in solution.message) is (status is Status.INFEASIBLE)
