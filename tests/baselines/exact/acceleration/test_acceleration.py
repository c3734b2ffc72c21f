"""The exact minimum time against closed forms, Ruckig, collocation, TOPP-RA, linear programs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog

from baselines.collocation.uniform import Collocation
from baselines.exact.acceleration import Exact
from baselines.exact.acceleration.profiles import extremes
from baselines.exact.method import interior_point
from baselines.ruckig_ import section
from baselines.topp_ra import along
from trajopt import InvalidInput, Limits, Problem, Relation, Solution, Status, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load, problem_files
from trajopt.benchmark.suites.random import random_problem
from trajopt.planners.rest_to_rest import stop_times


def solved(problem: Problem, **options: int) -> Trajectory:
    solution = Exact(**options).solve(problem)
    assert solution.status is Status.SOLVED, solution.message
    assert solution.trajectory is not None
    return solution.trajectory


def one_joint(*waypoints: float, v: float = 1.0, a: float = 2.0) -> Problem:
    return Problem([[q] for q in waypoints], Limits([v], [a]))


@pytest.mark.parametrize(
    ("problem", "optimum"),
    [
        (one_joint(0, 1.5), 1.5 / 1 + 1 / 2),  # trapezoid: h/V + V/A
        (one_joint(0, 0.4, 1.0, 1.5), 1.5 / 1 + 1 / 2),  # waypoints on the way cost nothing
        (one_joint(0, 0.08), 2 * np.sqrt(0.08 / 2)),  # triangle: 2 √(h/A)
        (one_joint(0, 1.5, 0), 4.0),  # a reversal is two stops for a single joint
        (one_joint(0, 1e-9), 2 * np.sqrt(1e-9 / 2)),  # tiny
        (one_joint(0, 1e5), 1e5 + 0.5),  # huge
        (one_joint(0, 1.5, v=1e4), 2 * np.sqrt(1.5 / 2)),  # the velocity limit is never felt
        (Problem([[0, 5], [1.5, 5]], Limits([1, 1], [2, 2])), 2.0),  # a joint that rests
        (Problem([[0, 0], [1.5, 1.5]], Limits([1, 3], [2, 9])), 2.0),  # the slower joint decides
    ],
)
def test_closed_forms(problem: Problem, optimum: float) -> None:
    assert solved(problem).duration == pytest.approx(optimum, rel=1e-8)


def test_asymmetric_two_waypoints_equals_the_trapezoid() -> None:
    problem = Problem([[0.0], [1.0]], Limits([[-1, 0.5]], [[-1.0, 4.0]]))
    # speed up at 4, cruise at 0.5, brake at 1: h/V + V/2 (1/4 + 1/1)
    assert solved(problem).duration == pytest.approx(1 / 0.5 + 0.25 * (1 / 4 + 1), rel=1e-8)


def last_place(problem: Problem) -> float:
    """The last place of the largest coordinate, relative to the shortest displacement.

    The judge mends misses of that size too, so no motion through these numbers is exact beyond it.
    """
    h = np.abs(problem.displacements)
    return float(np.spacing(np.abs(problem.waypoints).max()) / h[h > 0].min())


@pytest.mark.parametrize("name", problem_files())
def test_every_shipped_problem_is_exact_to_rounding(name: str) -> None:
    known = load(name).without("jerk", "position")
    certificate = verify(known, solved(known))
    assert certificate.valid
    assert certificate.dilation <= 1 + 1e-12 + last_place(known)


@pytest.mark.parametrize("seed", [2, 79, 87, 153, 266])
def test_rounding_of_breaks_costs_nothing(seed: int) -> None:
    """In 153 a segment of 1e-5 s at 28 s once cost 2e-8, its breaks rounded after its motion."""
    problem = random_problem(seed)
    certificate = verify(problem, solved(problem))
    assert certificate.valid
    assert certificate.dilation <= 1 + 1e-10 + last_place(problem)
    farthest = np.abs(problem.displacements).max()
    assert certificate.waypoint.value <= 1e-13 * farthest


def test_a_brief_segment_passed_fast_keeps_its_limits_in_rounded_time() -> None:
    """2.6e-6 s at 19 s round by 3e-10, and so does the mean velocity: once a dilation of 6e-5."""
    problem = load("random-tiny-j10-w50-jerk-16").without("jerk", "position")
    certificate = verify(problem, solved(problem))
    assert certificate.valid
    assert certificate.dilation <= 1 + 1e-9 + last_place(problem)


def test_a_segment_that_takes_less_time_than_can_be_stored_is_flown_by() -> None:
    problem = one_joint(-10, 0, 1e-16, 1e-15, 10)
    certificate = verify(problem, solved(problem))
    assert certificate.valid
    assert certificate.certified_duration == pytest.approx(20 / 1 + 1 / 2, rel=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_ruckig_from_its_waypoint_velocities_returns_its_segment_times(seed: int) -> None:
    """Mathematics, section 10: velocities divided by 1 + 1e-6 keep rounding off a longer branch."""
    problem = random_problem(seed)
    times = solved(problem).waypoint_times
    velocities = solved(problem)(times, order=1) / (1 + 1e-6)
    zero = np.zeros(problem.joints)
    states = list(zip(problem.waypoints, velocities, strict=True))
    ruckig = [
        section(problem.limits, (*start, zero), (*end, zero))[0]
        for start, end in itertools.pairwise(states)
    ]
    np.testing.assert_allclose(ruckig, np.diff(times), rtol=1e-5, atol=1e-6 * times[-1])


@pytest.mark.parametrize("name", ["six-axis", "reversal", "asymmetric"])
def test_collocation_tends_to_it_from_above(name: str) -> None:
    problem = load(name)
    exact = solved(load(name)).duration
    solutions = [Collocation(intervals=n).solve(problem).trajectory for n in (10, 20, 40, 80)]
    gaps = np.array([t.duration / exact - 1 for t in solutions if t])
    assert len(gaps) == 4
    assert (gaps > -1e-7).all()
    assert (gaps[1:] < 0.55 * gaps[:-1]).all()  # first order at least
    assert gaps[-1] < 2e-4


@pytest.mark.parametrize("name", ["six-axis", "seven-waypoints", "asymmetric", "resting-joint"])
def test_topp_ra_along_its_own_path_returns_its_duration(name: str) -> None:
    """Mathematics, section 10, limits relaxed by 1e-6."""
    problem = load(name)
    trajectory = solved(load(name))
    wider = Problem(
        problem.waypoints,
        Limits(problem.limits.velocity * (1 + 1e-6), problem.limits.acceleration * (1 + 1e-6)),
    )
    retimed = along(wider, trajectory).trajectory
    assert retimed is not None
    assert retimed.duration == pytest.approx(trajectory.duration, rel=2e-6)


@pytest.mark.parametrize("seed", range(8))
def test_extremes_are_those_of_a_linear_program(seed: int) -> None:
    """D_lo and D_up against a fine discretisation of the velocity profile, which lies inside."""
    rng = np.random.default_rng(seed)
    v = np.array([-1.0, 1.3])
    a = np.array([-2.0, 1.5])
    t = rng.uniform(0.4, 3)
    u, w = rng.uniform(-0.4, 0.4, 2)
    steps = 600
    dt = t / steps
    trapezoid = np.full(steps + 1, dt)
    trapezoid[[0, -1]] = dt / 2
    difference = np.diff(np.eye(steps + 1), axis=0)
    rows = np.vstack([difference, -difference])
    edges = np.r_[np.full(steps, a[1] * dt), np.full(steps, -a[0] * dt)]
    bounds = [(u, u), *[tuple(v)] * (steps - 1), (w, w)]
    reached = [
        sign * linprog(sign * trapezoid, rows, edges, bounds=bounds).fun for sign in (1.0, -1.0)
    ]
    _, d_up, _, d_lo = extremes(np.array(u), np.array(w), np.array(t), v, a)
    np.testing.assert_allclose([d_lo, d_up], reached, atol=4 * dt**2 * a[1] * 2)
    assert d_lo <= reached[0] + 1e-9
    assert reached[1] <= d_up + 1e-9


@pytest.mark.parametrize("seed", range(12))
def test_never_above_stopping_and_a_single_start_is_never_better(seed: int) -> None:
    problem = random_problem(seed)
    solution = Exact().solve(problem)
    assert solution.trajectory is not None
    assert solution.trajectory.duration <= stop_times(problem).sum() * (1 + 1e-9)
    assert solution.trajectory.duration <= np.min(solution.stats["start_duration"]) * (1 + 1e-9)
    assert len(solution.stats["start_status"]) == 2  # two agree


def test_more_starts_are_tried_until_as_many_agree_as_asked() -> None:
    stats = Exact(starts=5, agreeing=4).solve(load("six-axis")).stats
    assert len(stats["start_duration"]) == 4
    assert np.ptp(stats["start_duration"]) <= 1e-9 * np.min(stats["start_duration"])


def test_a_jerk_or_position_limit_makes_it_a_relaxation() -> None:
    """A duration that is not proved is not reported as a lower bound."""
    for name in ("jerk-limit", "position-limits"):
        problem = load(name)
        solution = Exact().solve(problem)
        free = solved(problem.without("jerk", "position")).duration
        assert Exact().relation(problem) is Relation.RELAXATION
        assert solution.status is Status.RELAXED
        assert solution.lower_bound is None
        assert solution.trajectory.duration == pytest.approx(free, rel=1e-9)
        assert f"{free:.6g} s" in solution.message
    assert Exact().relation(load("six-axis")) is Relation.SAME
    assert Exact().solve(load("six-axis")).status is Status.SOLVED


def test_where_every_start_fails_a_motion_that_is_certified_is_the_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(interior_point, "MAX_ITERATIONS", 1)
    problem = load("six-axis")
    solution: Solution = Exact(starts=2).solve(problem)
    assert solution.status is Status.SOLVED
    assert "Not_Converged: the best of their last iterates" in solution.message
    assert verify(problem, solution.trajectory).feasible


@pytest.mark.parametrize("option", ["starts", "agreeing"])
def test_no_start_is_refused(option: str) -> None:
    with pytest.raises(InvalidInput, match=f"{option} is 0: expected at least 1"):
        Exact(**{option: 0})


def test_limits_a_million_to_one_apart_still_reach_the_waypoints() -> None:
    # The slow joint takes h/V + V/A twice; a knot left out once cost the fast one 4 mrad.
    limits = Limits([1e-3, 1e3], [1e-3, 1e3])
    problem = Problem([[0.0, 0.0], [1.0, -0.5], [0.4, 0.6]], limits)
    optimum = Exact().solve(problem).trajectory
    assert optimum is not None
    assert verify(problem, optimum).certified_duration == pytest.approx(1001 + 601, rel=1e-7)
