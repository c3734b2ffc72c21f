"""The repair joint by joint: what each limit of a joint asks to be continuous, and no more."""

from types import SimpleNamespace

import numpy as np
import pytest

from trajopt import Limits, Problem, Trajectory, verify
from trajopt.judging import repair
from trajopt.judging.repair import repaired

INF = np.inf
WAYPOINTS = [[0.0, 0.0], [1.0, -0.5], [0.4, 0.6]]


def problem(jerk):
    return Problem(WAYPOINTS, Limits([2.0, 2.0], [5.0, 5.0], jerk=jerk))


def quintic(jump):
    """From rest to rest in each of two segments of 1 s; then `jump` is added to coefficients."""
    way = np.diff(np.array(WAYPOINTS), axis=0)
    pieces = np.zeros((6, 2, 2))
    pieces[0], pieces[1], pieces[2] = 6 * way, -15 * way, 10 * way
    pieces[5] = WAYPOINTS[:-1]
    times = np.arange(3.0)
    return Trajectory(times, pieces + jump, times)


def jumps(trajectory, order):
    """Jumps of a derivative at the breaks, from 0 before the start and to 0 after the end."""
    ends = trajectory.lengths
    powers = np.arange(len(trajectory.coefficients) - 1, -1, -1)
    factor = np.array([np.prod(p - np.arange(order)) for p in powers], dtype=float)
    slopes = trajectory.coefficients * factor[:, None, None]
    at_start = slopes[powers == order][0]
    exponents = np.maximum(powers - order, 0)
    at_end = (slopes * ends[None, :, None] ** exponents[:, None, None]).sum(axis=0)
    zero = np.zeros((1, trajectory.joints))
    return np.abs(np.concatenate([zero, at_end]) - np.concatenate([at_start, zero]))


def bent():
    """Velocity jumps in the middle by 0.1 rad/s, acceleration there and at the end by 0.2 rad/s².

    The latter by t² (1 - t)² / 10 in the second segment, which moves neither its ends nor their
    velocities.
    """
    jump = np.zeros((6, 2, 2))
    jump[4, 1] = 0.1
    jump[1, 1], jump[2, 1], jump[3, 1] = 0.1, -0.2, 0.1
    return quintic(jump)


@pytest.mark.parametrize("jerk", [[50.0, INF], [INF, 50.0], [50.0, 50.0], None])
def test_acceleration_is_made_continuous_where_jerk_is_limited_alone(jerk):
    own = problem(jerk)
    smooth = np.isfinite(jerk) if jerk else np.zeros(2, dtype=bool)
    found = repaired(own, bent())
    np.testing.assert_allclose(found(found.waypoint_times), WAYPOINTS, atol=1e-14)
    assert jumps(found, 1).max() < 1e-12
    accelerations = jumps(found, 2).max(axis=0)
    assert (accelerations[smooth] < 1e-12).all()
    assert (accelerations[~smooth] > 0.1).all()


def test_no_joint_is_changed_that_needs_no_repair():
    """Joint 2 has no jump: its coefficients stay, whichever joint's jerk is limited."""
    jump = np.zeros((6, 2, 2))
    jump[4, 1, 0] = 0.1
    given = quintic(jump)
    for jerk in ([50.0, INF], [INF, 50.0], [50.0, 50.0]):
        found = repaired(problem(jerk), given)
        np.testing.assert_allclose(
            found.coefficients[:, :, 1], given.coefficients[:, :, 1], rtol=0, atol=1e-13
        )


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("segment", [0, 1])
def test_one_number_that_overflows_makes_repair_impossible(joint, segment):
    """1e308 rad/s³ in one joint and segment: three times that is its velocity at the end."""
    jump = np.zeros((6, 2, 2))
    jump[2, segment, joint] = 1e308
    given = quintic(jump)
    assert repaired(problem(None), given) is None
    certificate = verify(problem(None), given)
    assert not certificate.valid
    assert certificate.certified_duration is None


@pytest.mark.parametrize("side", ["low", "high"])
def test_an_excess_beside_a_limit_gains_less_than_rounding(side):
    """At a waypoint 1e-12 rad from the nearer limit it is 1e-10 times sqrt(1e-12 · 1)."""
    near = 1e-12
    waypoints = np.array([[near], [1.0]])
    limits = Limits([9.0], [9.0], position=[[0.0, 5.0]])
    if side == "high":
        waypoints, limits = -waypoints, Limits([9.0], [9.0], position=[[-5.0, 0.0]])
    problem = Problem(waypoints, limits)
    layout = SimpleNamespace(waypoints=problem.waypoints)
    allowed = repair._allowed_excess(repair._Asked.of(problem), layout, np.zeros((2, 1)))
    assert allowed.item() == pytest.approx(1e-16, rel=1e-6, abs=0)


def test_the_worked_example():
    """docs/mathematics/verification.md, section 9: one miss, and one jump of velocity."""
    straight = Problem([[0.0], [1.0]], Limits([9.0], [99.0]))
    curve = np.polynomial.Polynomial([0.0, 0.0, 3.0, -2.0])
    x = np.polynomial.Polynomial([1.0, -1.0]) / 0.75  # 1 at the break, 0 at the end
    later = curve + 0.075 * (x**2 - x**3)
    break_ = np.polynomial.Polynomial([0.25, 1.0])
    pieces = np.array([[curve(np.polynomial.Polynomial([0.0, 1.0])).coef, later(break_).coef]])
    coefficients = pieces.transpose(2, 1, 0)[::-1]
    missing = Trajectory([0, 1], 0.99 * curve.coef[::-1, None, None], [0, 1])
    jumping = Trajectory([0, 0.25, 1], coefficients, [0, 1])
    at = np.linspace(0, 1, 21)
    for motion in (missing, jumping):
        assert np.abs(motion(at)[:, 0] - curve(at)).max() > 1e-3
        np.testing.assert_allclose(repaired(straight, motion)(at)[:, 0], curve(at), atol=1e-14)
    bend = repaired(straight, jumping)([0.25], 2) - jumping([0.25], 2)
    assert bend.item() == pytest.approx(4 * 0.1 / 0.75, rel=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_a_correction_below_its_bound_is_negligible(order):
    """Jumps and misses at random, of sizes about that at which a correction counts."""
    rng = np.random.default_rng(order)
    limits = Limits([1.0] * 2, [2.0] * 2, [3.0] * 2 if order == 2 else None)
    counts = [0, 0]
    for _ in range(300):
        breaks = np.append(0.0, np.cumsum(rng.uniform(0.05, 1.0, 6)))
        waypoints = rng.normal(size=(3, 2))
        motion = Trajectory(breaks, rng.normal(size=(4, 6, 2)), breaks[[0, 2, 6]])
        problem = Problem(waypoints, limits)
        asked = repair._Asked.of(problem)
        layout = repair._layout(asked, motion, np.ones(3, dtype=bool))
        size = 10.0 ** rng.uniform(-16, -12)
        missed = 1e-3 * size * rng.normal(size=(2, 2))
        jumps = [size * rng.normal(size=(7, 2)) for _ in range(order)]
        ((pieces, added),) = repair._cancelling(layout, missed, jumps)
        computed = repair._is_negligible(asked, layout, added, pieces)
        bound = repair._surely_negligible(asked, layout, missed, jumps)
        assert computed or not bound
        counts[0] += bound
        counts[1] += computed
    assert 0.3 * counts[1] < counts[0] < 300
