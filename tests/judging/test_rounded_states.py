"""States are known to their rounding: a motion that misses them by no more is certified as it is.

Closed form: a joint that brakes at its limit from `u` to `w` takes `(u − w) / A` and nothing less;
a joint that changes its acceleration at its jerk limit likewise. So the last millisecond of such a
motion takes a millisecond, whatever the last digits of its states are.
"""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.core.rounding import STATE_RTOL, of_states

MS = 1e-3
V, A, J = np.array([2.0, 1.5, 3.0]), np.array([4.0, 7.0, 5.0]), np.array([30.0, 90.0, 50.0])


def braking(seed, off=0.0):
    """A millisecond of three joints: the first brakes at its limit, the others within theirs.

    Its end is `off` roundings away from where the motion leads.
    """
    rng = np.random.default_rng(seed)
    q, u = rng.uniform(-2, 2, 3), V * rng.uniform(0.3, 0.9, 3)
    a = A * np.append(-1.0, rng.uniform(-0.9, 0.9, 2))
    limits = Limits(V, A)
    end = q + u * MS + a * MS**2 / 2
    problem = Problem([q, end], limits, start_velocity=u, end_velocity=u + a * MS)
    moved = end + off * of_states(problem).position
    return Problem([q, moved], limits, start_velocity=u, end_velocity=u + a * MS)


def easing(seed):
    """A millisecond of three joints: the second changes its acceleration at its jerk limit."""
    rng = np.random.default_rng(seed)
    q, u, a = rng.uniform(-2, 2, 3), V * rng.uniform(0.2, 0.5, 3), A * rng.uniform(-0.4, 0.4, 3)
    j = J * np.insert(rng.uniform(-0.8, 0.8, 2), 1, -1.0)
    end = q + u * MS + a * MS**2 / 2 + j * MS**3 / 6
    demands = {
        "start_velocity": u,
        "start_acceleration": a,
        "end_velocity": u + a * MS + j * MS**2 / 2,
        "end_acceleration": a + j * MS,
    }
    return Problem([q, end], Limits(V, A, J), demands=demands)


def one_piece(problem, duration, pieces=1):
    """Constant accelerations from the start: what a planner that rounds nothing would return."""
    u, a = problem.start_velocity, (problem.end_velocity - problem.start_velocity) / duration
    breaks = np.linspace(0.0, duration, pieces + 1)
    q = problem.waypoints[0] + np.outer(breaks, u) + np.outer(breaks**2, a) / 2
    v = u + np.outer(breaks, a)
    rows = np.array([np.tile(a / 2, (pieces, 1)), v[:-1], q[:-1]])
    return Trajectory(breaks, rows, breaks[[0, -1]])


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("off", [0.0, 0.5, -0.5])
def test_the_last_millisecond_takes_a_millisecond(seed, off):
    problem = braking(seed, off)
    solution = Exact().solve(problem)
    certificate = verify(problem, solution.trajectory)
    assert certificate.certified_duration == pytest.approx(MS, rel=1e-11)
    assert certificate.feasible


@pytest.mark.parametrize("seed", range(12))
def test_with_jerk_limits_it_takes_a_millisecond_too(seed):
    problem = easing(seed)
    duration = verify(problem, ExactJerk().solve(problem).trajectory).certified_duration
    assert duration == pytest.approx(MS, rel=1e-11)


@pytest.mark.parametrize("seed", range(4))
def test_a_state_that_is_missed_by_its_rounding_is_kept_as_returned(seed):
    problem = braking(seed, 0.5)
    certificate = verify(problem, one_piece(problem, MS))
    assert certificate.certified_duration == pytest.approx(MS, rel=1e-15)
    if certificate.rounded is not None:
        assert 0.4 < certificate.rounded < 0.6


def test_a_state_that_is_missed_by_more_is_not():
    problem = braking(0, 40.0)
    certificate = verify(problem, one_piece(problem, MS))
    assert certificate.rounded is None
    assert not certificate.feasible


def test_an_answer_that_is_long_by_rounding_says_so():
    problem = braking(0, -40.0)
    solution = Exact().solve(problem)
    assert solution.status == "solved"
    assert solution.trajectory.duration > 100 * MS
    away = 40 * of_states(problem).position[0]
    assert solution.message == (
        f"joint 1 can reach the end state in 0.001 s only within {away:.1g} rad of it; exactly, "
        f"it takes {solution.trajectory.duration:.6g} s"
    )


def test_many_small_jumps_are_one_large_one():
    """Each of 8 jumps of velocity is within rounding, all together are not."""
    problem = braking(0, 0.5)
    motion = one_piece(problem, MS, pieces=8)
    jump = 0.3 * of_states(problem).velocity * [1.0, 0.0, 0.0]
    rows = np.array(motion.coefficients)
    rows[1, ::2] += jump
    jumping = Trajectory(motion.breaks, rows, motion.waypoint_times)
    assert verify(problem, motion).feasible
    assert verify(problem, jumping).rounded is None


def test_how_far_states_are_known():
    """The place as the largest coordinate or `V²/A`; velocity and acceleration as their limits."""
    problem = Problem([[0.001, 1.0], [0.002, 3.0]], Limits([2.0, 1.0], [4.0, 5.0]))
    known = of_states(problem)
    assert known.position == pytest.approx(STATE_RTOL * np.array([2.0**2 / 4.0, 3.0]))
    assert known.velocity == pytest.approx(STATE_RTOL * np.array([2.0, 1.0]))
    assert known.acceleration == pytest.approx(STATE_RTOL * np.array([4.0, 5.0]))


def test_a_limit_that_no_motion_reaches_makes_nothing_unknown():
    problem = Problem([[0.0], [1.0]], Limits([1e9], [1.0]))
    known = of_states(problem)
    assert known.position[0] <= 1e-10
    assert known.velocity[0] <= 1e-12
