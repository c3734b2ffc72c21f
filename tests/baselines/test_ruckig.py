"""Ruckig: stopping times in closed form, exact certificates, never worse than stopping."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import ruckig

from baselines.exact.acceleration import Exact
from baselines.ruckig_ import RuckigStop, RuckigVia, Sections, section
from soaks.relations import drawn
from trajopt.benchmark.suites import catalogue as suite
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.judging.verification import verify
from trajopt.planners.rest_to_rest import stop_times

FILES = sorted(Path(__file__).parents[2].glob("data/problems/*.toml"))
SHORT = RuckigVia(evaluations=600)


def random_problem(seed: int, *, jerk: bool = False, asymmetric: bool = True) -> Problem:
    """1–7 joints, 3–8 waypoints: reversals, rests, tiny segments, limits 100:1 apart."""
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(1, 8))
    segments = int(rng.integers(2, 8))
    steps = rng.normal(size=(segments, joints))
    steps *= 10.0 ** rng.uniform(-1.5, 0.3, joints)
    steps[rng.random(steps.shape) < 0.15] = 0
    steps[rng.integers(segments)] *= 1e-5 if rng.random() < 0.3 else 1
    steps[:, -1] *= joints == 1 or rng.random() > 0.3
    steps[0, 0] += 0.1

    def limit(low: float, high: float) -> np.ndarray:
        top = 10.0 ** rng.uniform(low, high, joints)
        ratio = np.ones(joints)
        if asymmetric:
            ratio = rng.uniform(0.4, 2.5, joints)
        return np.stack([-top * ratio, top], axis=1)

    velocity = limit(-1, 1)
    acceleration = limit(-1, 1)
    rate = None
    if jerk:
        largest = np.abs(acceleration).max(axis=1)
        rate = largest * 10.0 ** rng.uniform(0, 1, joints)
    start = np.zeros_like(steps[:1])
    waypoints = np.cumsum(np.vstack([start, steps]), axis=0)
    return Problem(waypoints, Limits(velocity, acceleration, rate))


def duration(problem, planner):
    certificate = verify(problem, planner.solve(problem).trajectory)
    assert certificate.flaws == ()
    assert certificate.dilation <= 1 + 1e-9
    return certificate.duration


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_the_files_certify_and_the_way_through_is_never_slower(file):
    problem = Problem.from_toml(file)
    stopping = duration(problem, RuckigStop())
    merged, _ = problem.merged()
    assert stopping == pytest.approx(stop_times(merged).sum(), rel=1e-12)
    assert duration(problem, SHORT) <= stopping


@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("jerk", [False, True])
def test_stopping_takes_the_closed_form(seed, jerk):
    problem = random_problem(seed, jerk=jerk, asymmetric=not jerk)
    stopping = stop_times(problem).sum()
    assert duration(problem, RuckigStop()) == pytest.approx(stopping, rel=1e-9)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("jerk", [False, True])
def test_through_the_waypoints_is_never_slower_than_stopping(seed, jerk):
    """Beside rests, tiny segments and limits 100:1 apart, which the relations' problems lack."""
    problem = random_problem(100 + seed, jerk=jerk)
    assert duration(problem, SHORT) <= duration(problem, RuckigStop()) * (1 + 1e-12)


def test_one_joint_one_way_finds_the_trapezoid():
    problem = Problem.from_toml(FILES[0].parent / "one-joint.toml")
    # 1.5 rad at most 1 rad/s and 2 rad/s²: two ramps of 0.5 s and 0.25 rad, and 1 s between.
    found = duration(problem, RuckigVia(evaluations=2000))
    assert found == pytest.approx(2.0, rel=1e-6)


def test_proportional_motion_comes_close_to_the_bang_bang_time():
    shares = np.array([0.0, 0.3, 0.45, 1.0])
    problem = Problem(np.outer(shares, [1.0, -2.0]), Limits([100.0, 100.0], [2.0, 4.0]))
    optimum = 2 * np.sqrt(0.5)
    found = duration(problem, RuckigVia(evaluations=4000))
    assert optimum * (1 - 1e-9) <= found <= optimum * 1.03


def test_a_reversal_finds_the_optimum_in_closed_form():
    problem = Problem([[0.0], [1.0], [0.0]], Limits([100.0], [2.0]))
    optimum = 2 * 2 * np.sqrt(0.5)
    assert duration(problem, SHORT) == pytest.approx(optimum, rel=1e-9)


def test_budget_determinism_and_history():
    problem = Problem.from_toml(FILES[0].parent / "six-axis.toml")
    one = SHORT.solve(problem, seed=1)
    two = SHORT.solve(problem, seed=2)
    expected = one.trajectory.coefficients
    np.testing.assert_array_equal(two.trajectory.coefficients, expected)
    assert one.history[-1, 1] == pytest.approx(one.trajectory.duration, rel=1e-14)
    assert (np.diff(one.history, axis=0)[:, 1] < 0).all()
    assert one.evaluations < 600 + 60


def test_position_limits_are_kept_where_ruckig_ignores_them():
    problem = Problem.from_toml(FILES[0].parent / "position-limits.toml")
    lifted = RuckigVia(evaluations=3000).solve(problem.without("position"))
    assert not verify(problem, lifted.trajectory).valid
    found = duration(problem, RuckigVia(evaluations=3000))
    assert found < duration(problem, RuckigStop())


@pytest.mark.parametrize("side", [9.0, np.inf])
def test_asymmetric_jerk_counts_at_its_tighter_side_and_says_so(side):
    problem = Problem([[0.0], [1.0]], Limits([1.0], [2.0], [[-5.0, side]]))
    solution = RuckigStop().solve(problem)
    symmetric = Limits([1.0], [2.0], [5.0])
    expected = stop_times(Problem(problem.waypoints, symmetric)).sum()
    assert solution.trajectory.duration == pytest.approx(expected, rel=1e-12)
    assert "tighter side" in solution.message
    assert verify(problem, solution.trajectory).feasible


def test_a_jerk_limit_on_one_joint_only():
    problem = Problem(
        [[0.0, 0.0], [1.0, 1.0], [1.5, 3.0]], Limits([2.0, 2.0], [3.0, 3.0], [10.0, np.inf])
    )
    stop = duration(problem, RuckigStop())
    assert stop == pytest.approx(stop_times(problem).sum(), rel=1e-12)
    assert duration(problem, SHORT) < stop


def test_resting_joints_and_repeated_waypoints():
    problem = Problem(
        [[0.0, 7.0], [1.0, 7.0], [1.0, 7.0], [3.0, 7.0]], Limits([1.0, 1.0], [1.0, 1.0])
    )
    trajectory = RuckigVia(evaluations=1500).solve(problem).trajectory
    assert verify(problem, trajectory).feasible
    assert trajectory.waypoint_times[1] == trajectory.waypoint_times[2]
    assert trajectory.duration == pytest.approx(1 + 3, rel=1e-6)  # the trapezoid over 3 rad


def test_a_section_between_moving_states():
    # Over 1 rad from 0.5 to 0.25 rad/s at ±2 rad/s² to a peak p: (2p² − 0.25 − 0.0625)/4 = 1.
    peak = np.sqrt((4 + 0.3125) / 2)
    limits = Limits([3.0, 3.0], [2.0, 2.0])
    start = (np.zeros(2), np.array([0.5, 0.0]), np.zeros(2))
    end = (np.array([1.0, 0.1]), np.array([0.25, 0.0]), np.zeros(2))
    together, alone = section(limits, start, end)
    assert alone == pytest.approx([(2 * peak - 0.75) / 2, 2 * np.sqrt(0.05)], rel=1e-12)
    assert together == pytest.approx(alone[0], rel=1e-12)


def test_a_section_that_starts_too_fast_is_refused():
    start = (np.array([0.0]), np.array([2.0]), np.zeros(1))
    end = (np.ones(1), np.zeros(1), np.zeros(1))
    together, _ = section(Limits([1.0], [2.0]), start, end)
    assert together == np.inf


@pytest.mark.parametrize("planner", [RuckigStop(), SHORT])
def test_a_solver_that_gives_up_is_a_failure_with_a_reason(monkeypatch, planner):
    class Refusing:
        def __init__(self, joints):
            self.joints = joints

        def validate_input(self, *_):
            return True

        def calculate(self, *_):
            return ruckig.Result.Error

    monkeypatch.setattr(ruckig, "Ruckig", Refusing)
    solution = planner.solve(Problem([[0.0], [1.0]], Limits([1.0], [1.0])))
    assert solution.status is Status.FAILED
    assert solution.message == "Ruckig gave up on segment 1"


def test_exactly_opposite_states_at_one_place_do_not_crash() -> None:
    # Ruckig 0.19.4 crashes on these states. `moving` makes them a section of a problem.
    velocity = [[-0.06074806613589745, 0.1103667172217071], [-1.0, 1.0]]
    limits = Limits(velocity, [5.739923928191976, 1.0], [25.17007747222217, 1.0])
    q = np.array([-1.9146983370118453, 0.0])
    v = np.array([0.010124677679191563, 0.0])
    a = np.array([0.9566539870753419, 0.0])
    moving = np.array([0.0, 0.01])
    sections = Sections(Problem([q - moving, q + moving, q], limits))
    sections.waypoints = np.array([q, q])
    at_ends = np.array([[-v, v], [a, a]])[:, :, None]
    minima = sections.minima(np.zeros(1, int), at_ends)
    assert np.isfinite(minima).all()


@pytest.mark.parametrize("name", ["edges-huge", "edges-slow", "edges-tiny-beside-huge"])
@pytest.mark.parametrize("planner", [RuckigStop(), SHORT])
def test_huge_and_slow_problems_are_solved_in_moderate_units(name: str, planner) -> None:
    (problem,) = [p for p in suite.problems("edges") if p.name == name]
    certificate = verify(problem, planner.solve(problem).trajectory)
    assert certificate.valid
    assert certificate.dilation <= 1 + 1e-9
    longest = stop_times(problem).sum()
    assert duration(problem, planner) <= longest * (1 + 1e-9)
    if planner == RuckigStop():
        assert duration(problem, planner) == pytest.approx(longest, rel=1e-9)


# Chen et al. 2023 (quantum PSO): eight points of two joints, degrees, a stiff jerk limit.
STIFF_WAYPOINTS = [
    [-78.3, -54.2],
    [-66.7, -43.3],
    [-60.0, -36.2],
    [-52.1, -36.7],
    [-37.9, -50.5],
    [-37.3, -58.4],
    [-44.3, -65.1],
    [-55.2, -76.4],
]
STIFF_LIMITS = Limits(
    velocity=[859.4, 859.4],
    acceleration=[31799, 31799],
    jerk=[3179916, 3179916],
    position=[[-90, 30], [-90, 30]],
)


def in_units(problem: Problem, length: float, time: float) -> Problem:
    own = problem.limits
    limits = Limits(
        velocity=own.velocity * length / time,
        acceleration=own.acceleration * length / time**2,
        jerk=own.jerk * length / time**3,
        position=own.position * length,
    )
    return Problem(problem.waypoints * length, limits)


@pytest.mark.parametrize(("length", "time"), [(1.0, 1.0), (np.pi / 180, 1.0), (1.0, 1e3)])
def test_a_published_case_of_stiff_jerk_is_solved_in_any_unit(length: float, time: float) -> None:
    problem = in_units(Problem(STIFF_WAYPOINTS, STIFF_LIMITS), length, time)
    stopping = duration(problem, RuckigStop())
    assert stopping == pytest.approx(stop_times(problem).sum(), rel=1e-9)
    assert duration(problem, RuckigVia(evaluations=1000)) < 0.7 * stopping


@pytest.mark.parametrize("stiffness", [1e3, 1e6])
@pytest.mark.parametrize("seed", range(4))
def test_stiff_jerk_is_solved_whatever_the_unit_of_time(seed: int, stiffness: float) -> None:
    """Jerk over acceleration, 1/s, in seconds and in milliseconds."""
    problem = random_problem(seed, asymmetric=False)
    own = problem.limits
    stiff = Limits(own.velocity, own.acceleration, stiffness * own.acceleration)
    for time in (1.0, 1e-3, 1e3):
        moved = in_units(Problem(problem.waypoints, stiff), 1.0, time)
        answer = RuckigStop().solve(moved).trajectory
        certified = verify(moved, answer).certified_duration
        # a phase takes 5e-8 of its segment, whose breaks round to 2e-16 and are one within 4e-15
        assert certified == pytest.approx(stop_times(moved).sum(), rel=2e-8)


@pytest.mark.parametrize("planner", [RuckigStop(), RuckigVia(evaluations=300)])
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("length", "time"), [(180 / np.pi, 1.0), (2.0**-30, 2.0**-20), (1e-3, 1e3), (1e3, 1.0)]
)
def test_other_units_change_nothing(seed: int, length: float, time: float, planner) -> None:
    problem = random_problem(seed, jerk=True, asymmetric=False)
    moved = planner.solve(in_units(problem, length, time)).trajectory
    original = planner.solve(problem).trajectory
    assert moved.duration == pytest.approx(original.duration * time, rel=1e-9)
    atol = 1e-7 * np.ptp(problem.waypoints)
    for fraction in (0.1, 0.5, 0.9):
        there = moved(moved.duration * fraction) / length
        here = original(original.duration * fraction)
        np.testing.assert_allclose(there, here, atol=atol)


@pytest.mark.parametrize("seed", [25, 77, 1433])
def test_a_segment_of_a_millionth_is_met_too(seed: int) -> None:
    """Ruckig's roots are exact to 1e-8 of its units, and must not cost time."""
    problem = drawn(seed)
    certificate = verify(problem, SHORT.solve(problem).trajectory)
    assert certificate.valid
    assert certificate.dilation <= 1 + 1e-11


def test_each_section_has_its_own_limits():
    problem = suite.load("sections-slow-middle")
    found = RuckigVia(evaluations=2000).solve(problem).trajectory
    peak = np.sqrt(2.5)
    optimum = 2 * (peak / 2 + (peak - 1) / 2) + 1.0
    assert verify(problem, found).certified_duration == pytest.approx(optimum, rel=1e-6)
    jerk = [[[-9, 9]], [[-np.inf, np.inf]]]
    partly = Problem([[0.0], [1.0], [2.0]], Limits([1.0], [2.0], jerk))
    assert "in some segments only" in RuckigVia().unsupported(partly)


def test_a_segment_takes_its_least_time_or_its_given_one():
    # from stop to stop each segment takes 2 √(1/1) s
    problem = Problem([[0.0], [1.0], [0.0]], Limits([9.0], [1.0]))
    least = replace(problem, demands={"least_times": [3.0, 1.0]})
    assert RuckigStop().solve(least).trajectory.duration == pytest.approx(5.0, rel=1e-9)
    optimum = Exact().solve(least).trajectory.duration
    searched = RuckigVia(evaluations=200).solve(least).trajectory.duration
    assert searched == pytest.approx(optimum, rel=1e-3)
    given = replace(problem, demands={"given_times": [2.5, 4.0]})
    times = RuckigStop().solve(given).trajectory.waypoint_times
    np.testing.assert_allclose(times, [0, 2.5, 6.5])
    short = RuckigStop().solve(replace(problem, demands={"given_times": [2.5, 1.9]}))
    assert short.message == "Ruckig takes 2 s for segment 2 between these states; 1.9 s are given"


def test_a_joint_that_only_begins_in_motion_is_searched_too():
    limits = Limits([1.0, 1.5], [2.0, 3.0])
    demands = {"start_velocity": [0.0, 0.3]}
    problem = Problem([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], limits, demands=demands)
    # joint 1 from rest to rest at 1 rad/s; joint 2 is back at its place well before
    searched = RuckigVia(evaluations=200).solve(problem).trajectory
    assert searched.duration == pytest.approx(2.5, rel=1e-3)
