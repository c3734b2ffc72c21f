"""TOPP-RA: composition against evaluation, closed-form times, and a path's own timing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import toppra
from test_ruckig import random_problem

from baselines import topp_ra
from baselines.exact.acceleration import Exact
from baselines.topp_ra import ToppRa, along, spline
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify
from trajopt.planners import spline353

FOLDER = Path(__file__).parents[2] / "data/problems"
UNSUPPORTED = ("jerk-limit", "position-limits")
TIMED = [file for file in sorted(FOLDER.glob("*.toml")) if file.stem not in UNSUPPORTED]


def certified(problem, solution):
    assert solution.status is Status.SOLVED, solution.message
    certificate = verify(problem, solution.trajectory)
    assert certificate.flaws == ()
    return certificate.certified_duration


def candidates(solution):
    """The result of every spline: its certified duration, or the reason for its failure."""
    return {rule: result for rule, result in solution.stats.items() if "/" in rule}


def bang_bang(shares=(0.0, 1.0)):
    """Joints in proportion, ±2 and ±4 rad/s²: the exact optimum, 0.5 s² · 2 rad/s² each way."""
    half = np.sqrt(0.5)
    breaks = np.array([0.0, half, 2 * half])
    one = np.array([[1.0, -1.0], [0.0, 2 * half], [0.0, 0.5]])
    waypoints = np.outer(shares, [1.0, -2.0])
    problem = Problem(waypoints, Limits([100.0, 100.0], [2.0, 4.0]))
    times = []
    for share in shares:
        # the second half is the first one backwards
        from_end = min(share, 1 - share)
        time = half * np.sqrt(2 * from_end)
        times.append(time if share < 0.5 else 2 * half - time)
    both = one[:, :, None] * [1.0, -2.0]
    return problem, Trajectory(breaks, both, times)


@pytest.mark.parametrize("file", TIMED, ids=lambda f: f.stem)
def test_the_files_certify_within_a_hundredth_of_the_claim(file):
    problem = Problem.from_toml(file)
    solution = ToppRa(gridpoints=400).solve(problem)
    duration = certified(problem, solution)
    assert duration <= solution.trajectory.duration * 1.01
    results = candidates(solution)
    assert len(results) == 12
    assert duration == min(result for result in results.values() if isinstance(result, float))
    assert results[solution.stats["spline"]] == duration


@pytest.mark.parametrize("seed", range(25))
def test_random_problems_certify(seed):
    problem = random_problem(seed)
    solution = ToppRa(knots="limit", ends="natural", gridpoints=400).solve(problem)
    assert certified(problem, solution) <= solution.trajectory.duration * 1.05


@pytest.mark.parametrize("ends", ["not-a-knot", "natural", "clamped"])
def test_the_answer_is_the_path_at_the_parameter(ends, monkeypatch):
    problem = random_problem(3).merged()[0]
    path = spline(problem, "chord", ends)
    seen = []
    timed = topp_ra.timed

    def recorded(*given):
        seen.append(given)
        return timed(*given)

    monkeypatch.setattr(topp_ra, "timed", recorded)
    answer = along(problem, path, gridpoints=50).trajectory
    grid, speeds, waypoints = seen[0]
    # The package's own evaluation of q(s(t)), of scipy's spline at the same knots.
    curve = toppra.SplineInterpolator(waypoints, problem.waypoints, ends)
    reference = toppra.ParametrizeConstAccel(curve, grid.at, speeds)
    assert len(answer.coefficients) == 7
    t = np.linspace(0, answer.duration, 20001)
    for order in (0, 1):
        expected = reference(t, order)
        atol = 1e-9 * np.abs(expected).max()
        np.testing.assert_allclose(answer(t, order), expected, atol=atol)
    np.testing.assert_allclose(answer(answer.waypoint_times), problem.waypoints, atol=1e-10)


def test_a_line_takes_the_trapezoid():
    problem = Problem([[0.0, 0.0], [3.0, -1.5]], Limits([1.0, 1.0], [1.0, 1.0]))
    for ends in ("not-a-knot", "natural"):
        solution = ToppRa(ends=ends).solve(problem)
        assert certified(problem, solution) == pytest.approx(4.0, rel=1e-4)


def test_asymmetric_limits_take_the_lopsided_trapezoid():
    # Forwards at most 2 rad/s, up at 1 rad/s², down at 4: ramps of 2 s and 0.5 s over 2.5 rad.
    problem = Problem([[0.0], [4.5]], Limits([[-9.0, 2.0]], [[-4.0, 1.0]]))
    assert certified(problem, ToppRa().solve(problem)) == pytest.approx(3.5, rel=1e-4)
    back = Problem([[0.0], [-4.5]], Limits([[-2.0, 9.0]], [[-1.0, 4.0]]))
    assert certified(back, ToppRa().solve(back)) == pytest.approx(3.5, rel=1e-4)


def test_the_optimum_keeps_its_own_timing():
    problem, exact = bang_bang()
    solution = along(problem, exact)
    assert certified(problem, solution) == pytest.approx(exact.duration, rel=1e-6)


def test_limits_relaxed_by_a_millionth_give_half_a_millionth():
    problem, exact = bang_bang()
    limits = problem.limits
    acceleration = limits.acceleration * (1 + 1e-6)
    relaxed = Problem(problem.waypoints, Limits(limits.velocity, acceleration))
    solution = along(relaxed, exact)
    # the path can gain at most √(1 + 1e-6) − 1 everywhere
    gain = solution.trajectory.duration / exact.duration - 1
    assert -6e-7 <= gain <= 1e-7


def test_waypoints_between_are_passed_in_the_retimed_trajectory():
    problem, exact = bang_bang((0.0, 0.1, 0.5, 0.8, 1.0))
    slow = exact.dilated(3.0)
    solution = along(problem, slow)
    assert certified(problem, solution) == pytest.approx(exact.duration, rel=1e-6)
    times = solution.trajectory.waypoint_times
    np.testing.assert_allclose(times, exact.waypoint_times, rtol=1e-5)


@pytest.mark.parametrize("seed", range(15))
def test_no_slower_than_a_path_s_own_timing(seed):
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(1, 7))
    limits = Limits(*10 ** rng.uniform(-1, 1, (2, joints)))
    problem = Problem(rng.normal(size=(4, joints)), limits)
    own = spline353.trajectory(problem, rng.uniform(0.3, 2, 3))
    own = own.dilated(verify(problem, own).dilation)
    solution = along(problem, own, gridpoints=400)
    assert certified(problem, solution) <= own.duration * 1.001
    assert len(solution.trajectory.coefficients) == 11


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e4])
def test_the_unit_of_time_and_of_angle_do_not_matter(size):
    base = random_problem(5)
    limits = base.limits
    planner = ToppRa(gridpoints=200)
    velocity = limits.velocity * size**2
    acceleration = limits.acceleration * size**3
    scaled = Problem(base.waypoints * size, Limits(velocity, acceleration))
    expected = certified(base, planner.solve(base)) / size
    found = certified(scaled, planner.solve(scaled))
    assert found == pytest.approx(expected, rel=1e-6)


def test_resting_joints_and_repeated_waypoints():
    for name in ("resting-joint", "repeated"):
        problem = Problem.from_toml(FOLDER / f"{name}.toml")
        solution = ToppRa(knots="chord", ends="natural").solve(problem)
        certified(problem, solution)


def test_position_limits_choose_among_the_paths():
    waypoints = [[0.0, 0.0], [1.0, 1.0], [1.2, 3.0], [1.0, 4.0]]
    free = Problem(waypoints, Limits([2.0, 2.0], [5.0, 5.0]))
    planner = ToppRa(gridpoints=100)
    # the highest position of each spline's first joint, on a dense grid
    highest = {}
    for rule in candidates(planner.solve(free)):
        path = spline(free, *rule.split("/"))
        positions = path(np.linspace(0, path.duration, 10001))
        highest[rule] = positions[:, 0].max()
    middle = float(np.median(list(highest.values())))
    bounds = [[-1.0, middle], [-1.0, 5.0]]
    tight = Problem(waypoints, Limits([2.0, 2.0], [5.0, 5.0], None, bounds))
    solution = planner.solve(tight)
    certified(tight, solution)
    results = candidates(solution)
    kept = {rule for rule, value in results.items() if isinstance(value, float)}
    assert kept == {rule for rule, most in highest.items() if most <= middle}


def test_jerk_is_not_supported():
    problem = Problem.from_toml(FOLDER / "jerk-limit.toml")
    assert "jerk" in ToppRa().unsupported(problem)


def test_a_search_of_the_knots_is_no_longer_than_any_rule_and_counts_its_splines():
    problem = random_problem(4).merged()[0]
    rules = ToppRa(gridpoints=100).solve(problem)
    searched = ToppRa(gridpoints=100, search=30).solve(problem)
    assert (rules.evaluations, searched.evaluations) == (12, 42)
    assert certified(problem, searched) < certified(problem, rules)
    assert candidates(searched) == candidates(rules)
    one = ToppRa(knots="chord", ends="natural", gridpoints=100).solve(problem)
    assert one.evaluations == 1


def test_a_straight_path_in_motion_takes_the_least_time():
    demands = {"start_velocity": [1.0, -2.0], "end_velocity": [0.5, -1.0]}
    problem = Problem([[0, 0], [1, -2]], Limits([9.0, 9.0], [2.0, 4.0]), demands=demands)
    solution = ToppRa(knots="chord", ends="natural").solve(problem)
    peak = np.sqrt(2 * 1 + (1 + 0.25) / 2)
    assert certified(problem, solution) == pytest.approx((2 * peak - 1.5) / 2, rel=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_motion_in_motion_begins_and_ends_along_its_velocities(seed):
    drawn = random_problem(seed).merged()[0]
    V = drawn.limits.velocity[:, 1]
    demands = {"start_velocity": 0.4 * V * (-1) ** seed, "end_velocity": 0.2 * V}
    problem = replace(drawn, demands=demands)
    optimum = certified(problem, Exact().solve(problem))
    planner = ToppRa(knots="limit", ends="natural", gridpoints=100)
    assert certified(problem, planner.solve(problem)) >= optimum * (1 - 1e-9)


def test_a_path_that_does_not_leave_along_the_velocity_is_refused():
    demands = {"start_velocity": [1.0, 0.5]}
    problem = Problem([[0, 0], [1, -2]], Limits([9.0, 9.0], [2.0, 4.0]), demands=demands)
    line = Trajectory([0, 1], np.array([[[1.0, -2.0]], [[0.0, 0.0]]]), [0, 1])
    assert "does not leave along the start velocity" in along(problem, line).message
    backwards = replace(problem, demands={"start_velocity": [-1.0, 2.0]})
    assert "does not leave along the start velocity" in along(backwards, line).message


def test_an_optimum_in_motion_keeps_its_own_timing():
    demands = {"start_velocity": [0.6, -0.2], "end_velocity": [0.0, 0.3]}
    limits = Limits([1.0, 1.2], [2.0, 3.0])
    problem = Problem([[0, 0], [1, -0.4], [1.5, 0.5]], limits, demands=demands)
    motion = Exact().solve(problem).trajectory
    timed = along(problem, motion)
    assert certified(problem, timed) == pytest.approx(motion.duration, rel=1e-3)


def test_a_tangent_that_no_path_can_follow_is_not_tried_with_each_end_rule():
    """From 0.9 of its velocity limit a joint turns soon: the shortest tangents bend too much."""
    limits = Limits([1.0, 1.0], [2.0, 2.0])
    demands = {"start_velocity": [0.9, -0.9]}
    problem = Problem([[0.0, 0.0], [0.3, 0.3], [1.0, 0.0]], limits, demands=demands)
    stats = ToppRa(gridpoints=60).solve(problem).stats
    tried = [tuple(rule.split("/")) for rule in stats if rule.count("/") == 2]
    failed = [own for own in tried if isinstance(stats["/".join(own)], str)]
    assert failed
    for knots, _, length in failed:
        assert [own[::2] for own in tried].count((knots, length)) == 1
