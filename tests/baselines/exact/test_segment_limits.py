"""`exact` and `exact-jerk` where limits differ from segment to segment."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.acceleration.planner import Exact
from baselines.exact.jerk.planner import ExactJerk
from trajopt import Limits, Problem, verify


def straight(limits, ways=(1.0, 1.0)):
    """One joint along a line, with velocity and acceleration limits of each segment."""
    velocity = [[[-v, v]] for v, _ in limits]
    acceleration = [[[-a, a]] for _, a in limits]
    waypoints = np.cumsum([0.0, *ways])[:, None]
    return Problem(waypoints, Limits(velocity, acceleration))


def random_problem(rng):
    segments, joints = int(rng.integers(2, 6)), int(rng.integers(1, 5))
    waypoints = np.cumsum(rng.normal(0, 1, (segments + 1, joints)), axis=0)
    sizes = rng.uniform(0.5, 3, joints), rng.uniform(1, 8, joints)
    velocity, acceleration = (
        [-1, 1] * (size * rng.uniform(0.2, 1, (segments, joints)))[..., None] for size in sizes
    )
    return Problem(waypoints, Limits(velocity, acceleration))


def duration(problem, **options):
    trajectory = Exact(**options).solve(problem).trajectory
    assert verify(problem, trajectory).dilation <= 1 + 1e-9
    return trajectory.duration


def test_it_is_slower_through_one_section_in_closed_form():
    # at 2 rad/s² to 2 rad/s at 1 rad; from there √(2² + 2 · 2 · 1) = √8 without the other limit.
    # With 1 rad/s in the second segment: up to p, down to 1, p² = (1 + 2 · 2 · 1)/2, cruise, stop.
    peak = np.sqrt(2.5)
    first = peak / 2 + (peak - 1) / 2
    last = 0.75 / 1 + 1 / 2
    assert duration(straight([(10, 2), (1, 2)])) == pytest.approx(first + last, rel=1e-12)
    # it may be faster in one segment than anywhere else
    assert duration(straight([(1, 2), (1, 2), (10, 2)], (1, 1, 1))) == pytest.approx(
        1 / 2 + 0.75 + 1 + first, rel=1e-12
    )


def test_it_brakes_gently_through_one_section():
    # 8 rad/s² up, 1 rad/s² down from 1 rad on: it passes 1 rad at √2 at most.
    peak = np.sqrt((2 + 2 * 8) / 2)
    first = peak / 8 + (peak - np.sqrt(2)) / 8
    found = duration(straight([(10, 8), (10, 1)]))
    assert found == pytest.approx(first + np.sqrt(2), rel=1e-12)


def test_a_joint_may_wait_for_the_slow_one():
    velocity = [[[-2, 2], [-2, 2]], [[-2, 2], [-0.1, 0.1]]]
    problem = Problem([[0.0, 0.0], [1.0, 0.0], [2.0, 0.5]], Limits(velocity, [4.0, 4.0]))
    found = duration(problem)
    assert found > 5.0
    assert found < 5.0 + 2.0


def test_the_known_optimum_of_a_random_problem():
    # by IPOPT, every joint in its own pieces of constant acceleration: eight starts agree
    waypoints = [
        [0.0, 0.0],
        [-0.05161, 1.822272],
        [-0.570623, 1.364886],
        [-0.064086, 2.241605],
        [0.140334, 1.613618],
    ]
    velocity = [
        [0.83973, 1.106874],
        [0.573541, 1.032498],
        [0.707885, 0.923598],
        [0.658427, 0.799218],
    ]
    acceleration = [
        [3.719511, 1.301676],
        [3.182762, 1.79505],
        [1.524444, 1.987513],
        [3.28897, 0.848613],
    ]
    pairs = ([-1, 1] * np.array(sizes)[..., None] for sizes in (velocity, acceleration))
    assert duration(Problem(waypoints, Limits(*pairs))) == pytest.approx(6.514882389, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_wider_segment_never_costs_time(seed):
    problem = random_problem(np.random.default_rng([51, seed]))
    own = duration(problem)
    for key, segment in (("velocity", 0), ("acceleration", 1)):
        for joint in range(problem.joints):
            wider = problem.limits.widened(key, joint, 0.2, segment)
            assert duration(Problem(problem.waypoints, wider)) <= own * (1 + 1e-9)
    tightest = Problem(problem.waypoints, problem.limits.in_all_segments())
    widest = Problem(problem.waypoints, problem.limits.in_all_segments(tightest=False))
    assert duration(widest) <= own * (1 + 1e-9) <= duration(tightest) * (1 + 2e-9)


def test_limits_that_hardly_differ_hardly_matter():
    problem = random_problem(np.random.default_rng([51, 9]))
    limits = problem.limits.in_all_segments()
    velocity = np.repeat(limits.velocity[None], problem.segments, axis=0)
    velocity[0] *= 1 + 1e-9
    constant = Problem(problem.waypoints, limits)
    hardly = Problem(problem.waypoints, Limits(velocity, limits.acceleration))
    assert duration(hardly) == pytest.approx(duration(constant), rel=1e-8)


def test_ipopt_finds_the_same():
    pytest.importorskip("casadi")
    problem = random_problem(np.random.default_rng([51, 2]))
    assert duration(problem, solver="ipopt") == pytest.approx(duration(problem), rel=1e-8)


def test_equal_waypoints_take_no_limits_along():
    velocity = [[[-10, 10]], [[-0.01, 0.01]], [[-1, 1]]]
    repeated = Problem([[0.0], [1.0], [1.0], [2.0]], Limits(velocity, [2.0]))
    assert duration(repeated) == pytest.approx(duration(straight([(10, 2), (1, 2)])), rel=1e-12)


def with_jerk(problem, rng):
    """The problem with jerk limits of each segment's own."""
    limits = problem.limits
    sizes = np.abs(limits.acceleration[..., 1]) * rng.uniform(4, 30, limits.acceleration.shape[:2])
    jerk = [-1, 1] * sizes[..., None]
    return Problem(problem.waypoints, Limits(limits.velocity, limits.acceleration, jerk))


def jerky(problem):
    trajectory = ExactJerk().solve(problem).trajectory
    assert verify(problem, trajectory).dilation <= 1 + 1e-9
    return trajectory.duration


def test_it_may_speed_up_at_a_waypoint_where_the_next_segment_is_faster():
    # by IPOPT, every joint in its own pieces of constant jerk
    waypoints = [[0.0, 0.0], [-0.165515, 0.430499], [-1.399317, -0.233564]]
    velocity = [[1.785856, 0.661487], [1.43778, 1.903306]]
    acceleration = [[3.524495, 4.318808], [3.567837, 3.895471]]
    jerk = [[40.587806, 50.482977], [36.842299, 77.992409]]
    sizes = (np.array(own)[..., None] for own in (velocity, acceleration, jerk))
    problem = Problem(waypoints, Limits(*([-1, 1] * own for own in sizes)))
    assert jerky(problem) == pytest.approx(1.879713740, rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_jerk_limits_of_segments_lie_between_the_tightest_and_the_widest(seed):
    rng = np.random.default_rng([52, seed])
    problem = with_jerk(random_problem(rng), rng)
    own = jerky(problem)
    for key in ("velocity", "jerk"):
        wider = problem.limits.widened(key, 0, 0.2, 0)
        assert jerky(Problem(problem.waypoints, wider)) <= own * (1 + 1e-9)
    tightest = Problem(problem.waypoints, problem.limits.in_all_segments())
    widest = Problem(problem.waypoints, problem.limits.in_all_segments(tightest=False))
    assert jerky(widest) <= own * (1 + 1e-9) <= jerky(tightest) * (1 + 2e-9)
    assert own >= duration(problem.without("jerk")) * (1 - 1e-9)


def test_a_jerk_limit_in_some_segments_only_has_no_optimum():
    jerk = [[[-9, 9]], [[-np.inf, np.inf]]]
    problem = Problem([[0.0], [1.0], [2.0]], Limits([1.0], [2.0], jerk))
    assert "in some segments only" in ExactJerk().unsupported(problem)
    everywhere = Problem(problem.waypoints, Limits([[[-1, 1]], [[-2, 2]]], [2.0], [9.0]))
    assert "the same limits" in ExactJerk(solver="ipopt").unsupported(everywhere)


def test_it_may_begin_and_end_in_motion():
    velocity = [[[-2, 2]], [[-0.8, 0.8]], [[-2, 2]]]
    ends = {"start_velocity": [1.5], "end_velocity": [1.0]}
    problem = Problem([[0.0], [1.0], [2.0], [3.0]], Limits(velocity, [4.0]), **ends)
    # to a peak and down to 0.8, at 0.8 for 1 rad, up to a peak and down to 1
    first, last = (np.sqrt((v**2 + 0.8**2) / 2 + 4) for v in (1.5, 1.0))
    times = [(2 - v) / 4 + (2 - 0.8) / 4 + (1 - (8 - v**2 - 0.8**2) / 8) / 2 for v in (1.5, 1.0)]
    assert min(first, last) > 2  # it cruises
    assert duration(problem) == pytest.approx(times[0] + 1 / 0.8 + times[1], rel=1e-9)
    stiff = Problem(problem.waypoints, Limits(velocity, [4.0], [4e2]), **ends)
    assert jerky(stiff) == pytest.approx(duration(problem), rel=3e-3)
