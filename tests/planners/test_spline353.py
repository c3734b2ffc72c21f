"""The 3-5-3 spline, against the paper's 14×14 system, dense samples and the verifier."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Limits, Problem
from trajopt.judging.verification import verify
from trajopt.planners import spline353

reproducible = settings(deadline=None, derandomize=True, max_examples=60)
seeds = st.integers(0, 2**32 - 1)
INF = np.inf


def paper_system(x, t):
    """Eq. 30–33 (right-hand side in the order that its rows mean): `(3, 6)` coefficients.

    Unknowns: a13 … a10, a25 … a20, a33 … a30, each in its segment's own time.
    """
    t1, t2, t3 = t

    def cubic(s):
        return [[s**3, s**2, s, 1], [3 * s**2, 2 * s, 1, 0], [6 * s, 2, 0, 0]]

    def quintic(s):
        return [
            [s**5, s**4, s**3, s**2, s, 1],
            [5 * s**4, 4 * s**3, 3 * s**2, 2 * s, 1, 0],
            [20 * s**3, 12 * s**2, 6 * s, 2, 0, 0],
        ]

    a = np.zeros((14, 14))
    a[0:3, 0:4], a[0:3, 4:10] = cubic(t1), -np.array(quintic(0.0))
    a[3:6, 4:10], a[3:6, 10:14] = quintic(t2), -np.array(cubic(0.0))
    a[6:9, 10:14] = cubic(t3)
    a[9:12, 0:4] = cubic(0.0)
    a[12, 10:14], a[13, 4:10] = cubic(0.0)[0], quintic(0.0)[0]
    right = [0, 0, 0, 0, 0, 0, x[3], 0, 0, x[0], 0, 0, x[2], x[1]]
    solved = np.linalg.solve(a, np.array(right, dtype=float))
    return np.stack(
        [np.r_[0, 0, solved[:4]], solved[4:10], np.r_[0, 0, solved[10:]]],
    )


@reproducible
@given(seeds)
def test_coefficients_solve_the_papers_system(seed):
    rng = np.random.default_rng(seed)
    x, t = rng.uniform(-3, 3, 4), rng.uniform(0.2, 3, 3)
    found = spline353.coefficients(np.diff(x), t)
    found[:, -1] += x[:3]
    expected = paper_system(x, t)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


SHAPES = [((), ()), ((5,), ()), ((), (4,)), ((6,), (6,)), ((6,), (7, 1)), ((2, 1, 6), (3, 1))]


@pytest.mark.parametrize(("of_d", "of_t"), SHAPES)
def test_every_batch_shape_gives_each_members_own_numbers(of_d, of_t):
    rng = np.random.default_rng(0)
    d, t = rng.normal(size=(*of_d, 3)), rng.uniform(0.1, 2, (*of_t, 3))
    shape = np.broadcast_shapes(of_d, of_t)
    many_d, many_t = np.broadcast_to(d, (*shape, 3)), np.broadcast_to(t, (*shape, 3))
    batch = spline353.coefficients(d, t)
    assert batch.shape == (3, *shape, 6)
    for i in np.ndindex(shape):
        alone = spline353.coefficients(many_d[i], many_t[i])
        np.testing.assert_array_equal(batch[(slice(None), *i)], alone)


@pytest.mark.parametrize("exact_above", [0.0, 0.5, 1.0, 10.0])
def test_uses_in_a_batch_are_those_of_each_alone(exact_above):
    rng = np.random.default_rng(1)
    d, t = rng.normal(size=(3, 3)), rng.uniform(0.1, 3, (7, 4, 1, 3))
    limits = Limits([1, [-2, 3], 1], [3, [-1, 4], 2], [[-9, 3], INF, 5])
    batch = np.stack(spline353.limit_use(d, t, limits, exact_above))
    assert batch.shape == (3, 7, 4, 3)
    for i in np.ndindex(7, 4):
        alone = np.stack(spline353.limit_use(d, t[i], limits, exact_above))
        np.testing.assert_array_equal(batch[(slice(None), *i)], alone)
    factors = spline353.dilation(d, t, limits)
    v, a, j = spline353.limit_use(d, t, limits)
    expected = np.max([v, a ** (1 / 2), j ** (1 / 3)], axis=(0, 3))
    np.testing.assert_allclose(factors, expected, rtol=1e-14)


def sampled_use(d, t, limits, order, samples=2001):
    """Worst use of a limit `(joints,)` at so many instants of each segment: a lower bound."""
    s, worst = np.linspace(0, 1, samples), []
    pieces = spline353.coefficients(d, t)
    for piece, length in zip(pieces, np.broadcast_to(t, (3,)), strict=True):
        for joint, own in enumerate(piece):
            values = np.polyval(np.polyder(own, order), s * length)
            low, high = limits[joint]
            worst.append((joint, max((values / high).max(), (values / low).max())))
    return np.array([max(w for j, w in worst if j == joint) for joint in range(len(d))])


def random_case(seed: int, spread: float = 1.0):
    """Displacements of 1–4 joints (some zero), times over decades, limits of every kind."""
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(1, 5))
    d = rng.normal(size=(joints, 3)) * (rng.random((joints, 3)) > 0.2)
    d[0, rng.integers(3)] += 1.0
    t = 10.0 ** rng.uniform(-spread, spread, 3)

    def pairs():
        high = 10.0 ** rng.uniform(-1, 1, joints)
        return np.stack([-high * rng.uniform(0.3, 3, joints), high], axis=1)

    jerk = np.where(rng.random((joints, 1)) < 0.7, pairs(), [-INF, INF])
    return d, t, Limits(pairs(), pairs(), jerk)


@reproducible
@given(seeds)
def test_peaks_are_never_below_a_dense_sampling_and_hardly_above(seed):
    d, t, limits = random_case(seed)
    found = spline353.limit_use(d, t, limits)
    for order, (use, name) in enumerate(
        zip(found, ("velocity", "acceleration", "jerk"), strict=True), start=1
    ):
        pairs = getattr(limits, name)
        sampled = sampled_use(d, t, pairs, order)
        assert (use >= sampled * (1 - 1e-9)).all()
        # Between instants h apart a function f exceeds both neighbours by at most max|f''| h²/8.
        if order < 3:
            curvature = sampled_use(d, t, np.abs(pairs).min(axis=1, keepdims=True) * [-1, 1], 3)
            if order == 1:
                assert (use <= sampled + 1.1 * curvature * (t.max() / 2000) ** 2 / 8 + 1e-12).all()
            else:
                assert (use <= sampled + 1.1 * curvature * t.max() / 2000 / 2 + 1e-12).all()


def problem_of(d, limits) -> Problem:
    waypoints = np.vstack([np.zeros(len(d)), np.cumsum(d.T, axis=0)])
    return Problem(waypoints, limits)


@pytest.mark.parametrize("spread", [0.3, 1.0, 3.0])
@settings(deadline=None, derandomize=True, max_examples=60)
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


@pytest.mark.parametrize("ratio", [1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6])
@pytest.mark.parametrize("segment", [0, 1, 2])
@pytest.mark.parametrize("d", [(1, 0.5, 0.3), (1, -0.5, 0.3), (0, 1, 0), (1, 0, -1), (1, 1, 1)])
def test_one_segment_much_shorter_or_longer_than_the_others(ratio, segment, d):
    """Peaks of a degenerate spline, against the extremes of exact Bernstein evaluation."""
    d, t = np.array([d], dtype=float), np.ones(3)
    t[segment] = ratio
    limits = Limits([1.0], [1.0], [1.0])
    v, a, j = (u[0] for u in spline353.limit_use(d, t, limits))
    s = np.r_[np.linspace(0, 1, 4001), np.geomspace(1e-12, 1, 2000), 1 - np.geomspace(1e-12, 1, 99)]
    quintic = spline353.Quintic.between(d[0], t)
    for use, controls in [(v, quintic.velocity()), (a, quintic.acceleration())]:
        n = len(controls) - 1
        basis = [comb(n, k) * s**k * (1 - s) ** (n - k) for k in range(n + 1)]
        sampled = np.abs(np.tensordot(controls, np.array(basis), axes=1)).max()
        assert sampled * (1 - 1e-12) <= use <= sampled * (1 + 1e-5)
    edge = max(abs(6 * d[0, 0] / t[0] ** 3), abs(6 * d[0, 2] / t[2] ** 3))
    assert j >= edge * (1 - 1e-14)
    assert np.isfinite(j)


NEARLY = [0, *(sign * 10.0**-e for e in range(2, 16) for sign in (1, -1))]


@pytest.mark.parametrize("off", NEARLY)
@pytest.mark.parametrize("t", [(1, 1, 1), (0.7, 1.3, 1.1), (0.7, 2.5, 0.4)])
@pytest.mark.parametrize("d3", [1.0, 0.6, -0.3])
def test_peaks_where_the_accelerations_leading_coefficient_all_but_vanishes(off, t, d3):
    """There one root of the cubic runs away; the others still hold the peak velocity.

    Cardano's discriminant cannot tell those apart, and once lost both. The leading coefficient is
    10 (a1 − a0) + 120 h/T² − 60 (v0 + v1)/T, nought for the `h` below.
    """
    v0, a0, v1, a1 = 3 / t[0], 6 / t[0] ** 2, 3 * d3 / t[2], -6 * d3 / t[2] ** 2
    h = (t[1] * (v0 + v1) / 2 - t[1] ** 2 * (a1 - a0) / 12) * (1 + off)
    d, limits = np.array([[1.0, h, d3]]), Limits([1.0], [1.0])
    problem = problem_of(d, limits)
    expected = verify(problem, spline353.trajectory(problem, np.array(t))).velocity.value
    found, _, _ = spline353.limit_use(d, np.array(t), limits)
    assert found[0] == pytest.approx(expected, rel=1e-10)
    assert expected > max(abs(v0), abs(v1)) * 1.01


@pytest.mark.parametrize("off", NEARLY)
def test_the_same_by_hand(off):
    """With t = 1 and d = (1, h, 1), h near 4, velocity peaks half-way, at (30 h − 48)/16."""
    h = 4 * (1 + off)
    found, _, _ = spline353.limit_use([[1.0, h, 1.0]], np.ones(3), Limits([1.0], [1.0]))
    assert found[0] == pytest.approx((30 * h - 48) / 16, rel=1e-13)


@reproducible
@given(seeds, st.sampled_from([0.3, 1.0, 3.0]))
def test_exact_above_only_spares_work_where_the_limit_is_kept_anyway(seed, above):
    d, t, limits = random_case(seed)
    for exact, spared in zip(
        spline353.limit_use(d, t, limits),
        spline353.limit_use(d, t, limits, exact_above=above),
        strict=True,
    ):
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
    uses, slower = spline353.limit_use(d, t, limits), spline353.limit_use(d, c * t, limits)
    for power, (use, slow) in enumerate(zip(uses, slower, strict=True), start=1):
        np.testing.assert_allclose(slow, use / c**power, rtol=1e-8, atol=1e-300)
    factor = spline353.dilation(d, t, limits)
    assert spline353.dilation(d, c * t, limits) == pytest.approx(factor / c, rel=1e-8)
    assert spline353.dilation(d, factor * t, limits) == pytest.approx(1.0, rel=1e-8)


@reproducible
@given(seeds)
def test_mirrored_and_reversed_motions_swap_their_limits(seed):
    d, t, limits = random_case(seed)

    def turned(pairs):
        return -pairs[:, ::-1]

    v, a, j = spline353.limit_use(d, t, limits)
    mirrored = Limits(turned(limits.velocity), turned(limits.acceleration), turned(limits.jerk))
    for found, expected in zip(spline353.limit_use(-d, t, mirrored), (v, a, j), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    backwards = Limits(turned(limits.velocity), limits.acceleration, turned(limits.jerk))
    found = spline353.limit_use(-d[:, ::-1], t[::-1], backwards)
    for one, expected in zip(found, (v, a, j), strict=True):
        np.testing.assert_allclose(one, expected, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize(
    "limits",
    [
        Limits([6.0], [3.0], [6.0]),
        Limits([[-0.1, 6]], [[-12, 3]], [[-60, 6]]),
        Limits([[-0.1, 6]], [[-1, 300]], [[-60, 6]]),
        Limits([6.0], [3.0], [[-INF, 6]]),
        Limits([6.0], [3.0]),
    ],
)
def test_peaks_by_hand(limits):
    """With t = 1 and d = (1, 4, 1): t³ to velocity 3 and acceleration 6, then 3 t + 3 t² − 2 t³."""
    quintic = np.poly1d([-2, 3, 3, 0])
    assert [quintic(1), quintic.deriv()(1), quintic.deriv(2)(1)] == [4, 3, -6]
    d, t = np.array([[1.0, 4.0, 1.0]]), np.ones(3)
    np.testing.assert_allclose(
        spline353.coefficients(d[0], t)[1], [0, 0, -2, 3, 3, 0], rtol=0, atol=1e-14
    )
    found = np.array(spline353.limit_use(d, t, limits))[:, 0]
    # Velocity 3 + 6t − 6t² peaks at 4.5, acceleration at ±6, jerk is 6, −12, 6.
    high_v = limits.velocity[0, 1]
    assert found[0] == pytest.approx(4.5 / high_v, rel=1e-14)
    low_a, high_a = limits.acceleration[0]
    assert found[1] == pytest.approx(max(6 / high_a, 6 / -low_a), rel=1e-14)
    low_j, high_j = limits.jerk[0]
    assert found[2] == pytest.approx(max(6 / high_j, 12 / -low_j), rel=1e-14)


def test_the_peak_position_by_hand():
    """With t = 1 and d = (1, 0, −1): 3 s + 3 s² − 12 s³ + 6 s⁴, whose peak is 9/8 at s = 1/2."""
    d, t = np.array([[1.0, 0.0, -1.0]]), np.array([1.0, 1.0, 1.0])
    middle = np.poly1d([6, -12, 3, 3, 0])
    assert [middle(0.5), middle.deriv()(0.5)] == [9 / 8, 0]
    assert middle.deriv()(0) == 3
    for high, expected in ((1.0, 1 / 8), (1.125 + 1e-9, 0.0), (0.5, 5 / 8), (INF, 0.0)):
        for factor in (1e-3, 1, 1e3):  # only the ratios of the times matter
            room = np.array([[-0.1, high]])
            found = spline353.position_excess(d, factor * t, room)
            np.testing.assert_allclose(found, [expected], rtol=1e-9)
    mirrored = spline353.position_excess(-d, t, np.array([[-1.0, 0.1]]))
    np.testing.assert_allclose(mirrored, [1 / 8], rtol=1e-9)


@reproducible
@given(seeds)
def test_position_excess_is_that_of_the_samples(seed):
    rng = np.random.default_rng(seed)
    d, t, _ = random_case(seed)
    d[~d.any(axis=1)] = 1.0
    way = np.cumsum(np.insert(d, 0, 0.0, axis=1), axis=1) - d[:, :1]
    room = np.stack([way.min(axis=1), way.max(axis=1)], axis=1)
    room += rng.choice([0.0, 0.1, 1.0, INF], room.shape) * [-1, 1]
    batch = spline353.position_excess(d, np.stack([t, 2 * t, t[::-1]])[:, None], room)
    np.testing.assert_allclose(batch[1], batch[0], rtol=1e-9, atol=1e-15)
    assert (batch[0] == spline353.position_excess(d, t, room)).all()
    s = np.linspace(0, t[1], 3001)
    for joint, piece in enumerate(spline353.coefficients(d, t)[1]):
        low, high = room[joint]
        values = np.polyval(piece, s)
        sampled = max(values.max() - high, low - values.min(), 0.0) / np.abs(d[joint]).max()
        assert batch[0, joint] >= sampled - 1e-11
        assert batch[0, joint] <= sampled + 1e-4 * (1 + sampled) * (t.max() / t.min()) ** 2


TOUCHING = [
    # waypoints within [0, 1], whether any 3-5-3 keeps it
    ([0.5, 1, 0.5, 0.2], False),
    ([0.5, 0, 0.5, 0.2], False),
    ([0.5, 0.2, 1, 0.5], False),
    ([0, 0.2, 0, 0.5], False),
    ([0.2, 1, 1, 0.5], False),
    ([1, 1, 0.5, 0.2], True),
    ([1, 1, 0.9999, 0], True),
    ([0.2, 0.5, 1, 1], True),
    ([0, 0.5, 0.2, 1], True),
    ([0.2, 1 - 1e-6, 0.1, 0.5], True),
    ([0, 0.5, 0.5, 1], True),
]


@pytest.mark.parametrize(("waypoints", "possible"), TOUCHING)
def test_only_a_limit_passed_at_speed_makes_it_infeasible(waypoints, possible):
    limits = Limits([2.0, 2.0], [5.0, 5.0], position=[[0, 1], [-INF, INF]])
    problem = Problem([[x, row] for row, x in enumerate(waypoints)], limits)
    reason = spline353.infeasible(problem)
    room = spline353.position_room(problem)
    d = problem.displacements.T
    if possible:
        assert reason is None
        times = spline353.keeping_times(d, limits, room, unit=1.0)
        certificate = verify(problem, spline353.trajectory(problem, times))
        assert certificate.feasible
        assert certificate.dilation == pytest.approx(1, rel=1e-9)
    else:
        assert "joint 1 is at its limit at waypoint" in reason
        ratios = np.exp(np.random.default_rng(0).uniform(-8, 8, (4000, 1, 3)))
        excess = spline353.position_excess(d, ratios, room)
        assert (excess[:, 0] > 0).all()
        assert (excess[:, 1] == 0).all()


def test_the_waypoint_passed_at_its_limit_is_named_as_the_problem_counts():
    limits = Limits([2.0], [5.0], position=[[0, 1]])
    problem = Problem([[0.5], [0.5], [0.2], [0.2], [1.0], [0.5]], limits, joint_names=["wrist"])
    assert "wrist is at its limit at waypoint 5 and" in spline353.infeasible(problem)
    assert spline353.infeasible(problem.without("position")) is None


def test_a_resting_joint_uses_nothing():
    d, t = np.zeros((2, 3)), np.array([[1e-3, 1, 50.0]])
    for use in spline353.limit_use(d, t, Limits([1, 2], [1, 2], [3, 4])):
        assert use.tolist() == [0, 0]


@reproducible
@given(seeds)
def test_the_trajectory_passes_everything_and_is_twice_continuously_differentiable(seed):
    d, t, limits = random_case(seed)
    if not d.any(axis=0).all():
        return
    problem = Problem(problem_of(d, limits).waypoints + 0.7, limits)
    trajectory = spline353.trajectory(problem, t)
    assert trajectory.duration == pytest.approx(t.sum(), rel=1e-15)
    assert np.array_equal(trajectory.waypoint_times, trajectory.breaks)
    np.testing.assert_allclose(trajectory(trajectory.breaks), problem.waypoints, atol=1e-10)
    for order in (1, 2):
        scale = 1 + np.abs(d).max() / t.min() ** order
        ends = trajectory(trajectory.breaks[[0, -1]], order)
        np.testing.assert_allclose(ends, 0, atol=1e-9 * scale)
        for inner in trajectory.breaks[1:-1]:
            before, after = trajectory([inner * (1 - 1e-13), inner], order)
            jerk = np.abs(d).max() / t.min() ** (order + 1) * inner
            np.testing.assert_allclose(before, after, atol=1e-9 * scale + 1e-9 * jerk)


FOUR = Problem([[0.0], [1.0], [2.0], [3.0]], Limits([1.0], [1.0]))


@pytest.mark.parametrize(
    "times",
    [
        [1, 1],
        [1, 1, 1, 1],
        [[1, 1, 1]],
        [1, 0, 1],
        [1, -1, 1],
        [1, np.nan, 1],
        [1, 1, np.inf],
        1.0,
        [],
    ],
)
def test_only_three_positive_times(times):
    with pytest.raises(InvalidInput, match="three positive segment times"):
        spline353.trajectory(FOUR, times)


@pytest.mark.parametrize(
    ("waypoints", "count"), [([0, 1], 2), ([0, 1, 2], 3), ([0, 1, 2, 3, 4], 5), ([0, 1, 1, 2], 3)]
)
def test_other_numbers_of_waypoints_are_not_for_it(waypoints, count):
    problem = Problem([[float(x)] for x in waypoints], Limits([1.0], [1.0]))
    assert f"this has {count}" in spline353.unsupported(problem)


@pytest.mark.parametrize("waypoints", [[0, 1, 2, 3], [0, 1, 1, 2, 3], [0, 0, 0, 1, 2, 2, 0, 0]])
def test_four_waypoints_once_merged_are(waypoints):
    problem = Problem([[float(x)] for x in waypoints], Limits([1.0], [1.0]))
    assert spline353.unsupported(problem) is None
