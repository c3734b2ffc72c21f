"""The best spline of a family: closed forms, nested families, and the 3-5-3 as one of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from baselines.exact.jerk import ExactJerk
from baselines.spline import Spline
from baselines.spline353_nlp import Spline353NLP
from trajopt import InvalidInput, Limits, Problem, Status, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load


def best(planner: Spline, problem: Problem) -> Trajectory:
    """The planner's answer; it keeps every limit without dilation."""
    solution = planner.solve(problem)
    assert solution.status is Status.SOLVED
    assert solution.trajectory is not None
    certificate = verify(problem, solution.trajectory)
    assert certificate.valid
    assert certificate.dilation == pytest.approx(1, abs=1e-8)
    return solution.trajectory


def straight(h: float, jerk: float | None) -> Problem:
    limits = Limits([2.0], [3.0], None if jerk is None else [jerk])
    return Problem([[0.0], [h]], limits)


@pytest.mark.parametrize(
    "name", ["jerk-limit", "asymmetric", "resting-joint", "tiny", "position-limits"]
)
def test_the_353_is_a_case_of_it(name: str) -> None:
    problem = load(name)
    own = Spline353NLP().solve(problem).trajectory
    assert own is not None
    assert best(Spline(shape="3-5-3", starts=2), problem).duration == pytest.approx(
        own.duration, rel=1e-8
    )


@pytest.mark.parametrize("h", [0.01, 1.0, 30.0])
def test_one_quintic_from_rest_to_rest(h: float) -> None:
    """Peaks 15/8 h/T, 10/√3 h/T² and 60 h/T³ of 10 s³ − 15 s⁴ + 6 s⁵."""
    times = [15 / 8 * h / 2, np.sqrt(10 / np.sqrt(3) * h / 3), np.cbrt(60 * h / 20)]
    assert best(Spline(starts=1), straight(h, 20.0)).duration == pytest.approx(max(times), rel=1e-9)


def test_one_cubic_from_standstill_to_standstill() -> None:
    """Peaks 3/2 h/T and 6 h/T² of 3 s² − 2 s³."""
    duration = best(Spline(degree=3, starts=1), straight(1.0, None)).duration
    assert duration == pytest.approx(max(1.5 / 2, np.sqrt(6 / 3)), rel=1e-9)


def test_cubics_are_the_clamped_spline() -> None:
    problem = load("seven-waypoints")
    trajectory = best(Spline(degree=3, starts=1), problem)
    passed = trajectory.waypoint_times
    clamped = CubicSpline(passed, problem.waypoints, bc_type="clamped")
    t = np.linspace(0, trajectory.duration, 200)
    np.testing.assert_allclose(trajectory(t), clamped(t), atol=1e-9)


def test_a_larger_family_is_no_longer() -> None:
    problem = load("jerk-limit")
    shapes = ["3-5-3", "5-5-5", "5-7-5"]
    durations = [best(Spline(shape=shape, starts=1), problem).duration for shape in shapes]
    assert durations == sorted(durations, reverse=True)
    optimum = ExactJerk(starts=1).solve(problem).trajectory
    assert optimum is not None
    assert durations[-1] > optimum.duration


def test_where_jerk_is_limited_cubics_have_a_knot_more_at_both_ends() -> None:
    problem = load("jerk-limit")
    trajectory = best(Spline(degree=3, starts=1), problem)
    assert len(trajectory.breaks) == len(problem.waypoints) + 2
    np.testing.assert_allclose(trajectory([0, trajectory.duration], order=2), 0, atol=1e-9)


def test_the_middle_degree_is_repeated() -> None:
    problem = load("seven-waypoints")
    short = best(Spline(shape="4-3-4", starts=1), problem)
    whole = best(Spline(shape="4-3-3-3-3-4", starts=1), problem)
    assert short.duration == whole.duration


def test_what_does_not_fit_is_refused() -> None:
    assert "degrees for 6 segments" in (
        Spline(shape="4-4").unsupported(load("seven-waypoints")) or ""
    )
    assert "jerk is limited" in (Spline(ends="standstill").unsupported(load("jerk-limit")) or "")
    for shape in ("4-x-4", "2-3-2", "4--4", "10"):
        with pytest.raises(InvalidInput, match="degrees from 3 to 9"):
            Spline(shape=shape)
    with pytest.raises(InvalidInput, match="at least 1"):
        Spline(rounds=0)


def test_a_joint_on_its_position_limit_stands_still_there() -> None:
    waypoints = [[0.0, 0.0], [1.0, 1.0], [0.5, 2.0]]
    free = Problem(waypoints, Limits([9.0] * 2, [1.0] * 2))
    walled = Limits([9.0] * 2, [1.0] * 2, position=[[-1.0, 1.0], [-9.0, np.inf]])
    kept = best(Spline(starts=2), Problem(waypoints, walled))
    assert kept(kept.waypoint_times[1], 1)[0] == pytest.approx(0, abs=1e-9)
    assert best(Spline(starts=2), free).duration < kept.duration * (1 - 1e-3)
    one_way = Problem([[0.0], [1.0]], Limits([9.0], [1.0]))
    stopping = 2 * best(Spline(starts=1), one_way).duration
    assert kept.duration < stopping


def test_cubics_that_turn_on_a_limit_have_the_times_that_continuity_asks_for() -> None:
    # −6 h₁/T₁² = 6 h₂/T₂²
    problem = Problem(
        [[0.0, 0.0], [1.0, 0.5], [0.3, 0.8]],
        Limits([9.0] * 2, [1.0] * 2, position=[[-5.0, 1.0], [-5.0, 5.0]]),
    )
    solution = Spline(degree=3, starts=1).solve(problem)
    first, second = solution.stats["piece_times"]
    assert second / first == pytest.approx(np.sqrt(0.7), rel=1e-6)


def test_cubics_that_cannot_turn_on_a_limit_fail_where_quintics_do_not() -> None:
    limits = Limits([9.0] * 2, [1.0] * 2, position=[[-5.0, 1.0], [-5.0, 0.5]])
    problem = Problem([[0.0, 0.0], [1.0, 0.5], [0.3, 0.2]], limits)
    solution = Spline(degree=3, starts=1).solve(problem)
    assert solution.trajectory is None
    assert "no start succeeded" in solution.message
    assert best(Spline(degree=5, starts=1), problem).duration > 0
