"""The refined transcription against closed forms, the exact optima and Ruckig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from work import one_in

from baselines.collocation.refined import CollocationRefined
from baselines.collocation.uniform import CollocationGrid, transcription
from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from baselines.ruckig_ import RuckigVia, section
from trajopt import InvalidInput, Limits, Problem, Relation, Status, verify
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.testing import check_planner, examples

ERROR = 1e-4


def duration(problem: Problem) -> float:
    """The certified duration of an answer that keeps every limit and claims the error wanted."""
    solution = CollocationRefined(starts=2).solve(problem)
    assert solution.status is Status.SOLVED, solution.message
    assert solution.trajectory is not None
    assert solution.message == ""
    assert solution.stats["error_estimate"] <= ERROR
    certificate = verify(problem, solution.trajectory)
    assert certificate.feasible, certificate.flaws
    assert certificate.certified_duration is not None
    return certificate.certified_duration


def boxed(problem: Problem, position: object) -> Problem:
    limits = problem.limits
    box = Limits(limits.velocity, limits.acceleration, limits.jerk, position)
    return replace(problem, limits=box)


def overshoot(room: float, jerk: float | None = None) -> Problem:
    """Joint 1 would pass its second waypoint fast while joint 2, which waits, takes its time."""
    limits = Limits([10.0, 10.0], [2.0, 2.0], jerk and [jerk] * 2, [[0, 1 + room], [0, 1]])
    return Problem([[0, 0], [1, 0], [1, 1]], limits)


def test_a_reversal_at_the_limit_is_two_stops() -> None:
    limits = Limits([1.2], [2.0], position=[[0.0, 1.0]])
    problem = Problem([[0.0], [1.0], [0.0]], limits)
    stop = 1.2 / 2 + 1 / 1.2
    assert duration(problem) == pytest.approx(2 * stop, rel=1e-6)


@pytest.mark.parametrize("room", [0.0, 0.001, 0.1, 0.2])
def test_the_room_behind_a_waypoint_limits_its_velocity(room: float) -> None:
    """Braking from `u` takes `u²/(2A)`; joint 2 cannot move before, between its limits."""
    u = np.sqrt(2 * 2.0 * room)
    peak = np.sqrt(2.0 + u**2 / 2)  # speeding up to it and braking to u covers 1 rad
    optimum = (2 * peak - u) / 2 + 2 * np.sqrt(0.5)
    assert duration(overshoot(room)) == pytest.approx(optimum, rel=ERROR)


def test_the_mirrored_problem_takes_as_long() -> None:
    problem = overshoot(0.1)
    limits = problem.limits
    mirrored = Limits(limits.velocity, limits.acceleration, position=-limits.position[:, ::-1])
    other = duration(replace(problem, waypoints=-problem.waypoints, limits=mirrored))
    assert other == pytest.approx(duration(problem), rel=ERROR)


def test_with_jerk_each_segment_is_ruckigs_with_a_free_acceleration() -> None:
    """At its limit a joint is at rest, but its acceleration may already point inwards."""
    problem = overshoot(0.0, jerk=20.0)
    one = problem.without("position").limits.only([0])
    zero = np.zeros(1)

    def arriving(a: float) -> float:
        end = (np.ones(1), zero, np.array([-a]))
        together, _ = section(one, (zero, zero, zero), end)
        return together

    inner = minimize_scalar(arriving, bounds=(0.0, 2.0), method="bounded").fun
    least = min(inner, arriving(0.0), arriving(2.0))
    # Joint 2 leaves as joint 1 arrives, backwards in time.
    assert duration(problem) == pytest.approx(2 * least, rel=ERROR)


def test_two_waypoints_with_jerk_are_ruckigs() -> None:
    limits = Limits([1.0, 0.7], [2.0, 1.5], [12.0, 5.0], [[0.0, 0.9], [-0.4, 0.0]])
    problem = Problem([[0, 0], [0.9, -0.4]], limits)
    zero = np.zeros(2)
    ends = [(q, zero, zero) for q in problem.waypoints]
    assert duration(problem) == pytest.approx(section(limits, *ends)[0], rel=ERROR)


@pytest.mark.parametrize("seed", range(3))
def test_limits_far_away_change_nothing(seed: int) -> None:
    problem = random_problem(seed, joints=3, waypoints=4)
    answer = Exact().solve(problem).trajectory
    assert answer is not None
    far = boxed(problem, [[-1e3, 1e3]] * 3)
    assert duration(far) == pytest.approx(answer.duration, rel=ERROR)


@pytest.mark.parametrize("seed", range(2))
def test_with_jerk_it_is_the_exact_optimum(seed: int) -> None:
    problem = random_problem(seed, joints=2, waypoints=3, jerk=True)
    answer = ExactJerk(starts=2).solve(problem).trajectory
    assert answer is not None
    assert duration(problem) <= answer.duration * (1 + ERROR)


def test_between_the_relaxed_optimum_and_ruckig() -> None:
    problem = load("position-limits")
    relaxed = Exact().solve(problem).trajectory
    ruckig = RuckigVia(500).solve(problem).trajectory
    assert relaxed is not None
    assert ruckig is not None
    least = duration(problem)
    assert relaxed.duration * 1.01 < least
    assert least < ruckig.duration * (1 + ERROR)


def test_stopping_where_there_is_no_room_at_all() -> None:
    """A reversal of every joint at both of its limits."""
    limits = Limits([1.0, 2.0], [2.0, 1.0], position=[[0, 1], [0, 1]])
    problem = Problem([[0, 0], [1, 1], [0, 0], [1, 1]], limits)
    assert duration(problem) == pytest.approx(stop_times(problem).sum(), rel=1e-6)


def test_jerk_limits_on_some_joints() -> None:
    limits = Limits([1.0, 1.0], [2.0, 2.0], [np.inf, 10.0], [[-0.01, 1.01], [0, np.inf]])
    assert duration(Problem([[0, 0], [0.5, 0.6], [1, 0.2]], limits)) > 0


def test_a_jerk_limit_on_one_side_only_is_unsupported() -> None:
    limits = Limits([1.0], [2.0], [[-np.inf, 10.0]])
    assert "one side" in str(CollocationRefined().unsupported(Problem([[0.0], [1.0]], limits)))


def test_what_was_not_reached_is_said() -> None:
    solution = CollocationRefined(error=1e-15, refinements=1).solve(load("position-limits"))
    assert solution.status is Status.SOLVED
    assert len(solution.stats["refinement_duration"]) == 2
    assert f"error is {solution.stats['error_estimate']:.1e}" in solution.message
    assert "1.0e-15 was wanted" in solution.message


def test_keeps_the_public_contract() -> None:
    check_planner(CollocationRefined(starts=1), examples()[:2])
    assert CollocationRefined().relation(examples()[0]) is Relation.RESTRICTION


@pytest.mark.parametrize(
    ("option", "value"), [("error", 0.0), ("error", np.nan), ("starts", 0), ("refinements", 0)]
)
def test_bad_options_are_refused(option: str, value: float) -> None:
    with pytest.raises(InvalidInput, match=f"{option} is"):
        CollocationRefined(**{option: value})  # type: ignore[arg-type]


def test_intervals_that_change_nothing_stay_where_they_start() -> None:
    """The second joint has time to spare: any lengths will do, and IPOPT would wander for long."""
    limits = Limits([1.0, 1.0], [2.0, 2.0], [20.0, 20.0], [[0.0, 2.0], [0.0, 2.0]])
    problem = Problem([[0.0, 0.0], [1.0, 0.1], [1.9, 0.2]], limits)
    grid = CollocationGrid(problem, 8)
    start = grid.stopping()
    optimum = transcription(grid, free=True)(grid, start)
    assert optimum.success
    stretch = start.times / optimum.nodes.times
    idle = optimum.nodes.lengths[:, 1] * np.repeat(stretch, 8)
    assert idle == pytest.approx(start.lengths[:, 1], rel=0.05)


def test_a_joint_that_begins_too_fast_comes_back() -> None:
    # it stops after 2 s and 2 rad, 1 rad too far, and is back at rest 2 s later
    limits = Limits([9.0, 9.0], [1.0, 1.0])
    problem = Problem([[0, 0], [1, 1]], limits, demands={"start_velocity": [2.0, 0.0]})
    assert duration(problem) == pytest.approx(4.0, rel=1e-6)


def test_within_tolerance_it_turns_sooner() -> None:
    problem = Problem([[0.0], [1.0], [0.0]], Limits([9.0], [2.0]), demands={"tolerance": 0.1})
    assert duration(problem) == pytest.approx(4 * np.sqrt(0.9 / 2), rel=1e-6)


@pytest.mark.parametrize("jerk", [False, True])
@pytest.mark.parametrize("key", one_in(2, ["end_velocity", "least_times", "given_times", "closed"]))
def test_demands_on_the_way_agree_with_the_exact_program(key: str, jerk: bool) -> None:
    problem = random_problem(3, joints=2, waypoints=4, jerk=jerk)
    stop = stop_times(problem)
    asked = {
        "end_velocity": 0.5 * problem.limits.velocity[:, 1],
        "least_times": 1.2 * stop * [0, 1, 0],
        "given_times": 1.1 * stop,
        "closed": True,
    }
    if key == "closed":
        problem = replace(problem, waypoints=np.vstack([problem.waypoints, problem.waypoints[0]]))
    problem = replace(problem, demands={key: asked[key]})
    exact = ExactJerk() if jerk else Exact()
    optimum = verify(problem, exact.solve(problem).trajectory).certified_duration
    assert duration(problem) == pytest.approx(optimum, rel=ERROR)
