"""The 3-5-3 spline, against the paper's 14×14 system, dense samples and the verifier."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.judging.verification import verify
from trajopt.planners import spline353

reproducible = settings(deadline=None, derandomize=True, max_examples=40)
seeds = st.integers(0, 2**32 - 1)
INF = np.inf


def polynomial_rows(s, degree):
    """Position, velocity and acceleration at `s`, as rows that multiply the coefficients."""
    powers = np.arange(degree, -1, -1)
    rows = []
    factor = np.ones(degree + 1)
    for order in range(3):
        exponents = np.maximum(powers - order, 0)
        rows.append(factor * float(s) ** exponents)
        factor = factor * (powers - order)
    return np.array(rows)


def paper_system(x, t):
    """Eq. 30–33 (right-hand side in the order that its rows mean): `(3, 6)` coefficients.

    Unknowns: a13 … a10, a25 … a20, a33 … a30, each in its segment's own time.
    """
    t1, t2, t3 = t
    first = slice(0, 4)
    second = slice(4, 10)
    third = slice(10, 14)
    a = np.zeros((14, 14))
    # the segments join, and the motion rests at both ends
    a[0:3, first] = polynomial_rows(t1, 3)
    a[0:3, second] = -polynomial_rows(0.0, 5)
    a[3:6, second] = polynomial_rows(t2, 5)
    a[3:6, third] = -polynomial_rows(0.0, 3)
    a[6:9, third] = polynomial_rows(t3, 3)
    a[9:12, first] = polynomial_rows(0.0, 3)
    # both inner waypoints are passed
    a[12, third] = polynomial_rows(0.0, 3)[0]
    a[13, second] = polynomial_rows(0.0, 5)[0]
    right = np.zeros(14)
    right[[6, 9, 12, 13]] = x[3], x[0], x[2], x[1]
    solved = np.linalg.solve(a, right)
    table = np.zeros((3, 6))
    table[0, 2:] = solved[first]
    table[1] = solved[second]
    table[2, 2:] = solved[third]
    return table


@reproducible
@given(seeds)
def test_coefficients_solve_the_papers_system(seed):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-3, 3, 4)
    t = rng.uniform(0.2, 3, 3)
    found = spline353.coefficients(np.diff(x), t)
    found[:, -1] += x[:3]
    expected = paper_system(x, t)
    atol = 1e-8 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=atol)


@pytest.mark.parametrize(
    ("of_d", "of_t"), [((), ()), ((5,), ()), ((), (4,)), ((6,), (6,)), ((2, 1, 6), (3, 1))]
)
def test_every_batch_shape_gives_each_members_own_numbers(of_d, of_t):
    rng = np.random.default_rng(0)
    d = rng.normal(size=(*of_d, 3))
    t = rng.uniform(0.1, 2, (*of_t, 3))
    shape = np.broadcast_shapes(of_d, of_t)
    many_d = np.broadcast_to(d, (*shape, 3))
    many_t = np.broadcast_to(t, (*shape, 3))
    batch = spline353.coefficients(d, t)
    assert batch.shape == (3, *shape, 6)
    for i in np.ndindex(shape):
        alone = spline353.coefficients(many_d[i], many_t[i])
        np.testing.assert_array_equal(batch[(slice(None), *i)], alone)


@pytest.mark.parametrize("exact_above", [0.0, 0.5, 1.0, 10.0])
def test_uses_in_a_batch_are_those_of_each_alone(exact_above):
    rng = np.random.default_rng(1)
    d = rng.normal(size=(3, 3))
    t = rng.uniform(0.1, 3, (7, 4, 1, 3))
    limits = Limits([1, [-2, 3], 1], [3, [-1, 4], 2], [[-9, 3], INF, 5])
    batch = np.stack(spline353.limit_use(d, t, limits, exact_above))
    assert batch.shape == (3, 7, 4, 3)
    for i in np.ndindex(7, 4):
        alone = np.stack(spline353.limit_use(d, t[i], limits, exact_above))
        np.testing.assert_array_equal(batch[(slice(None), *i)], alone)


def random_case(seed: int, spread: float = 1.0):
    """Displacements of 1–4 joints (some zero), times over decades, limits of every kind."""
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(1, 5))
    d = rng.normal(size=(joints, 3))
    d *= rng.random((joints, 3)) > 0.2
    d[0, rng.integers(3)] += 1.0
    t = 10.0 ** rng.uniform(-spread, spread, 3)

    def pairs():
        high = 10.0 ** rng.uniform(-1, 1, joints)
        low = -high * rng.uniform(0.3, 3, joints)
        return np.stack([low, high], axis=1)

    has_jerk = rng.random((joints, 1)) < 0.7
    jerk = np.where(has_jerk, pairs(), [-INF, INF])
    return d, t, Limits(pairs(), pairs(), jerk)


def problem_of(d, limits, start=0.0) -> Problem:
    passed = np.cumsum(d.T, axis=0)
    waypoints = np.vstack([np.zeros(len(d)), passed])
    return Problem(start + waypoints, limits)


@pytest.mark.parametrize("spread", [0.3, 1.0, 3.0])
@reproducible
@given(seeds)
def test_the_verifier_finds_the_same_peaks_by_another_way(spread, seed):
    d, t, limits = random_case(seed, spread)
    if not d.any(axis=0).all():
        return
    problem = problem_of(d, limits)
    certificate = verify(problem, spline353.trajectory(problem, t))
    v, a, j = spline353.limit_use(d, t, limits)
    assert certificate.velocity.value == pytest.approx(v.max(), rel=1e-7)
    assert certificate.acceleration.value == pytest.approx(a.max(), rel=1e-7)
    if problem.has("jerk"):
        assert certificate.jerk.value == pytest.approx(j.max(), rel=1e-7)
    assert certificate.dilation == pytest.approx(spline353.dilation(d, t, limits), rel=1e-7)


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("segment", [0, 1, 2])
@pytest.mark.parametrize("d", [(1, 0.5, 0.3), (1, -0.5, 0.3), (0, 1, 0), (1, 0, -1)])
def test_one_segment_much_shorter_or_longer_than_the_others(ratio, segment, d):
    """Peaks of a degenerate spline, against dense samples of both ends and the middle."""
    t = np.ones(3)
    t[segment] = ratio
    v, a, j = spline353.limit_use([d], t, Limits([1.0], [1.0], [1.0]))
    near_start = np.geomspace(1e-12, 1, 2000)
    s = np.concatenate([np.linspace(0, 1, 4001), near_start, 1 - near_start])
    quintic = spline353.Quintic.of(np.array(d, dtype=float), t)
    for use, controls in [(v, quintic.velocity()), (a, quintic.acceleration())]:
        points = [np.full_like(s, control) for control in controls]
        while len(points) > 1:
            pairs = pairwise(points)
            points = [left + (right - left) * s for left, right in pairs]
        sampled = np.abs(points[0]).max()
        assert sampled * (1 - 1e-12) <= use[0] <= sampled * (1 + 1e-5)
    assert np.isfinite(j).all()


NEARLY_ONE = [1.0, *(1 + 10.0**-e for e in range(2, 16)), *(1 - 10.0**-e for e in range(2, 16))]


@pytest.mark.parametrize("factor", NEARLY_ONE)
def test_peaks_where_the_accelerations_leading_coefficient_all_but_vanishes(factor):
    """With t = 1 and d = (1, h, 1), h near 4, velocity peaks half-way, at (30 h − 48)/16.

    One root of the cubic runs away there; the others still hold the peak velocity.
    """
    h = 4 * factor
    found, _, _ = spline353.limit_use([[1.0, h, 1.0]], np.ones(3), Limits([1.0], [1.0]))
    assert found[0] == pytest.approx((30 * h - 48) / 16, rel=1e-13)


@reproducible
@given(seeds, st.sampled_from([0.3, 1.0, 3.0]))
def test_exact_above_spares_work_only_where_the_limit_is_kept(seed, above):
    d, t, limits = random_case(seed)
    exactly = spline353.limit_use(d, t, limits)
    sparingly = spline353.limit_use(d, t, limits, exact_above=above)
    for exact, spared in zip(exactly, sparingly, strict=True):
        assert (spared <= exact * (1 + 1e-14)).all()
        kept = exact <= above
        assert (spared[kept] <= above).all()
        np.testing.assert_array_equal(spared[~kept], exact[~kept])


@reproducible
@given(seeds)
def test_keeping_limits_means_that_no_use_is_above_one(seed):
    d, t, limits = random_case(seed)
    candidates = t * np.geomspace(0.1, 10, 25)[:, None]
    uses = spline353.limit_use(d, candidates[:, None], limits)
    expected = np.max(uses, axis=(0, 2)) <= 1
    found = spline353.keeps_limits(d, candidates, limits)
    np.testing.assert_array_equal(found, expected)


@reproducible
@given(seeds, st.floats(0.01, 100))
def test_stretching_time_divides_the_uses_by_its_powers(seed, c):
    d, t, limits = random_case(seed)
    uses = spline353.limit_use(d, t, limits)
    slower = spline353.limit_use(d, c * t, limits)
    for power, (use, slow) in enumerate(zip(uses, slower, strict=True), start=1):
        np.testing.assert_allclose(slow, use / c**power, rtol=1e-8, atol=1e-300)
    factor = spline353.dilation(d, t, limits)
    assert spline353.dilation(d, factor * t, limits) == pytest.approx(1.0, rel=1e-8)


def mirrored(pairs):
    return -pairs[:, ::-1]


@reproducible
@given(seeds)
def test_a_mirrored_motion_swaps_its_limits(seed):
    d, t, limits = random_case(seed)
    velocity = mirrored(limits.velocity)
    acceleration = mirrored(limits.acceleration)
    other = Limits(velocity, acceleration, mirrored(limits.jerk))
    uses = spline353.limit_use(d, t, limits)
    np.testing.assert_allclose(spline353.limit_use(-d, t, other), uses, rtol=1e-12)


@pytest.mark.parametrize(
    "limits",
    [
        Limits([6.0], [3.0], [6.0]),
        Limits([[-0.1, 6]], [[-12, 3]], [[-60, 6]]),
        Limits([6.0], [3.0], [[-INF, 6]]),
        Limits([6.0], [3.0]),
    ],
)
def test_peaks_by_hand(limits):
    """With t = 1 and d = (1, 4, 1): t³ to velocity 3 and acceleration 6, then 3 t + 3 t² − 2 t³."""
    d = np.array([[1.0, 4.0, 1.0]])
    v, a, j = spline353.limit_use(d, np.ones(3), limits)
    # Velocity 3 + 6t − 6t² peaks at 4.5, acceleration at ±6, jerk is 6, −12, 6.
    low_a, high_a = limits.acceleration[0]
    low_j, high_j = limits.jerk[0]
    assert v[0] == pytest.approx(4.5 / limits.velocity[0, 1], rel=1e-14)
    assert a[0] == pytest.approx(max(6 / high_a, 6 / -low_a), rel=1e-14)
    assert j[0] == pytest.approx(max(6 / high_j, 12 / -low_j), rel=1e-14)


# --- position limits ---


@pytest.mark.parametrize("factor", [1e-3, 1, 1e3])
@pytest.mark.parametrize(
    ("high", "expected"), [(1.0, 1 / 8), (1.125 + 1e-9, 0.0), (0.5, 5 / 8), (INF, 0.0)]
)
def test_the_peak_position_by_hand(factor, high, expected):
    """With t = 1 and d = (1, 0, −1): 3 s + 3 s² − 12 s³ + 6 s⁴, whose peak is 9/8 at s = 1/2."""
    d = np.array([[1.0, 0.0, -1.0]])
    room = np.array([[-0.1, high]])
    found = spline353.position_excess(d, factor * np.ones(3), room)
    np.testing.assert_allclose(found, [expected], rtol=1e-9)


@reproducible
@given(seeds)
def test_position_excess_is_that_of_the_samples(seed):
    rng = np.random.default_rng(seed)
    d, t, _ = random_case(seed)
    d[~d.any(axis=1)] = 1.0
    passed = np.cumsum(np.insert(d, 0, 0.0, axis=1), axis=1)
    from_second = passed - d[:, :1]
    room = np.stack([from_second.min(axis=1), from_second.max(axis=1)], axis=1)
    room += rng.choice([0.0, 0.1, 1.0, INF], room.shape) * [-1, 1]
    found = spline353.position_excess(d, t, room)
    s = np.linspace(0, t[1], 3001)
    steepness = (t.max() / t.min()) ** 2
    for joint, piece in enumerate(spline353.coefficients(d, t)[1]):
        low, high = room[joint]
        values = np.polyval(piece, s)
        beyond = max(values.max() - high, low - values.min(), 0.0)
        sampled = beyond / np.abs(d[joint]).max()
        assert found[joint] >= sampled - 1e-11
        assert found[joint] <= sampled + 1e-4 * (1 + sampled) * steepness


def touching(waypoints) -> Problem:
    """The first joint must stay within [0, 1]; the second is free."""
    limits = Limits([2.0, 2.0], [5.0, 5.0], position=[[0, 1], [-INF, INF]])
    return Problem([[x, row] for row, x in enumerate(waypoints)], limits)


@pytest.mark.parametrize(
    "waypoints",
    [
        [1, 1, 0.5, 0.2],
        [1, 1, 0.9999, 0],
        [0.2, 0.5, 1, 1],
        [0, 0.5, 0.2, 1],
        [0.2, 1 - 1e-6, 0.1, 0.5],
    ],
)
def test_some_times_keep_the_position_limits(waypoints):
    problem = touching(waypoints)
    assert spline353.infeasible(problem) is None
    d = problem.displacements.T
    room = spline353.position_room(problem)
    times = spline353.keeping_times(d, problem.limits, room, unit=1.0)
    certificate = verify(problem, spline353.trajectory(problem, times))
    assert certificate.feasible
    assert certificate.dilation == pytest.approx(1, rel=1e-9)


@pytest.mark.parametrize(
    "waypoints",
    [
        [0.5, 1, 0.5, 0.2],
        [0.5, 0, 0.5, 0.2],
        [0.5, 0.2, 1, 0.5],
        [0, 0.2, 0, 0.5],
        [0.2, 1, 1, 0.5],
    ],
)
def test_a_limit_passed_at_speed_is_infeasible(waypoints):
    problem = touching(waypoints)
    assert "joint 1 is at its limit at waypoint" in spline353.infeasible(problem)
    ratios = np.exp(np.random.default_rng(0).uniform(-8, 8, (4000, 1, 3)))
    room = spline353.position_room(problem)
    excess = spline353.position_excess(problem.displacements.T, ratios, room)
    assert (excess[:, 0] > 0).all()
    assert (excess[:, 1] == 0).all()


def test_the_waypoint_passed_at_its_limit_is_named_as_the_problem_counts():
    limits = Limits([2.0], [5.0], position=[[0, 1]])
    waypoints = [[0.5], [0.5], [0.2], [0.2], [1.0], [0.5]]
    problem = Problem(waypoints, limits, joint_names=["wrist"])
    assert "wrist is at its limit at waypoint 5 and" in spline353.infeasible(problem)
    assert spline353.infeasible(problem.without("position")) is None


def test_a_resting_joint_uses_nothing():
    times = np.array([[1e-3, 1, 50.0]])
    for use in spline353.limit_use(np.zeros((2, 3)), times, Limits([1, 2], [1, 2], [3, 4])):
        assert use.tolist() == [0, 0]


# --- the trajectory ---


@reproducible
@given(seeds)
def test_the_trajectory_passes_every_waypoint_and_is_twice_continuously_differentiable(seed):
    d, t, limits = random_case(seed, spread=0.5)
    if not d.any(axis=0).all():
        return
    problem = problem_of(d, limits, start=0.7)
    trajectory = spline353.trajectory(problem, t)
    assert trajectory.duration == pytest.approx(t.sum(), rel=1e-15)
    np.testing.assert_array_equal(trajectory.waypoint_times, trajectory.breaks)
    np.testing.assert_allclose(trajectory(trajectory.breaks), problem.waypoints, atol=1e-10)
    for order in (1, 2):
        scale = 1 + np.abs(d).max() / t.min() ** (order + 1)
        ends = trajectory(trajectory.breaks[[0, -1]], order)
        np.testing.assert_allclose(ends, 0, atol=1e-9 * scale)
        for inner in trajectory.breaks[1:-1]:
            before, after = trajectory([inner * (1 - 1e-13), inner], order)
            np.testing.assert_allclose(before, after, atol=1e-9 * scale)


@pytest.mark.parametrize(
    "times", [[1, 1], [[1, 1, 1]], [1, 0, 1], [1, -1, 1], [1, np.nan, 1], [1, 1, np.inf], 1.0, []]
)
def test_only_three_positive_times(times):
    four = Problem([[0.0], [1.0], [2.0], [3.0]], Limits([1.0], [1.0]))
    with pytest.raises(InvalidInput, match="three positive segment times"):
        spline353.trajectory(four, times)


@pytest.mark.parametrize(
    ("waypoints", "count"), [([0, 1], 2), ([0, 1, 2, 3, 4], 5), ([0, 1, 1, 2], 3)]
)
def test_other_numbers_of_waypoints_are_unsupported(waypoints, count):
    problem = Problem([[float(x)] for x in waypoints], Limits([1.0], [1.0]))
    assert f"this has {count}" in spline353.unsupported(problem)


@pytest.mark.parametrize("waypoints", [[0, 1, 2, 3], [0, 0, 0, 1, 2, 2, 0, 0]])
def test_four_waypoints_once_merged_are_supported(waypoints):
    problem = Problem([[float(x)] for x in waypoints], Limits([1.0], [1.0]))
    assert spline353.unsupported(problem) is None
