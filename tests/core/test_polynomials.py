"""Polynomials on the unit interval, against numpy's roots, chosen roots and exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trajopt.core import polynomials

reproducible = settings(deadline=None, derandomize=True, max_examples=60)
seeds = st.integers(0, 2**32 - 1)
degrees = st.integers(0, 9)


def column(*coefficients):
    """One polynomial, as a table with one column."""
    return np.array(coefficients, dtype=float)[:, None]


def inside(coefficients):
    """The roots found, without the gaps, sorted."""
    roots = polynomials.unit_roots(coefficients)
    return np.sort(roots[~np.isnan(roots)])


@reproducible
@given(seeds, degrees)
def test_values_and_derivatives_are_numpys(seed, degree):
    rng = np.random.default_rng(seed)
    many = rng.normal(size=(degree + 1, 4))
    s = rng.normal(size=4)
    for order in range(degree + 3):
        expected = [np.polyval(np.polyder(p, order), x) for p, x in zip(many.T, s, strict=True)]
        found = polynomials.evaluate(polynomials.derivative(many, order), s)
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11 * 9.0**order)


def test_the_derivative_beyond_the_degree_is_one_row_of_zeros():
    many = np.ones((3, 5, 2))
    for order in (3, 4, 9):
        zeros = np.zeros((1, 5, 2))
        assert np.array_equal(polynomials.derivative(many, order), zeros)


def test_points_broadcast_against_polynomials():
    many = np.array([[1.0, 2.0], [0.0, 1.0]])  # s, and 2 s + 1
    values = np.array([[0.0], [1.0], [3.0]])
    found = polynomials.evaluate(many, values)
    assert np.array_equal(found, [[0, 1], [1, 3], [3, 7]])


@reproducible
@given(seeds, degrees, st.floats(1e-7, 1e7))
def test_a_stretched_polynomial_is_the_old_one_at_length_times_s(seed, degree, length):
    rng = np.random.default_rng(seed)
    many = rng.normal(size=(degree + 1, 3, 2))
    lengths = length * rng.uniform(0.1, 1, size=3)
    s = rng.random()
    size = polynomials.evaluate(np.abs(many), lengths[:, None] * s).max()
    found = polynomials.evaluate(polynomials.stretched(many, lengths), np.array(s))
    expected = polynomials.evaluate(many, lengths[:, None] * s)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * size)


@reproducible
@given(seeds, degrees)
def test_a_shifted_polynomial_is_the_old_one_from_the_offset(seed, degree):
    rng = np.random.default_rng(seed)
    many = rng.normal(size=(degree + 1, 4))
    offset = rng.normal(size=4)
    t = rng.normal(size=4)
    kept = many.copy()
    found = polynomials.evaluate(polynomials.shifted(many, offset), t)
    size = polynomials.evaluate(np.abs(many), np.abs(offset) + np.abs(t)).max()
    expected = polynomials.evaluate(many, offset + t)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * size)
    assert np.array_equal(many, kept)


@pytest.mark.parametrize(
    ("power", "bernstein"),
    [
        ([5], [5]),
        ([1, 0], [0, 1]),
        ([1, 0, 0], [0, 0, 1]),
        ([-2, 2, 0], [0, 1, 0]),
        ([0, 1, 0], [0, 0.5, 1]),
        ([0, 0, 0, 1], [1, 1, 1, 1]),
        ([3, -6, 3, 0], [0, 1, 0, 0]),
    ],
)
def test_bernstein_coefficients_by_hand(power, bernstein):
    found = polynomials.bernstein(column(*power))[:, 0]
    np.testing.assert_allclose(found, bernstein, atol=1e-15)


@reproducible
@given(seeds, degrees)
def test_bernstein_coefficients_bound_the_polynomial_and_are_its_ends(seed, degree):
    rng = np.random.default_rng(seed)
    many = rng.normal(size=(degree + 1, 3, 2))
    controls = polynomials.bernstein(many)
    times = np.linspace(0, 1, 201)
    values = polynomials.evaluate(many[:, None], times[:, None, None])
    slack = 1e-13 * np.abs(many).sum(axis=0)
    assert (values <= controls.max(axis=0) + slack).all()
    assert (values >= controls.min(axis=0) - slack).all()
    expected = values[[0, -1]]
    found = controls[[0, -1]]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@reproducible
@given(seeds, st.integers(1, 8))
def test_simple_roots_inside_are_found_and_no_others(seed, degree):
    rng = np.random.default_rng(seed)
    places = np.linspace(-0.75, 1.75, 26)  # a tenth apart; 0.05, 0.15, … lie inside
    roots = np.sort(rng.choice(places, degree, replace=False))
    found = inside(column(*(rng.normal() * np.poly(roots))))
    expected = roots[(roots > 0) & (roots < 1)]
    assert len(found) == len(expected)
    np.testing.assert_allclose(found, expected, atol=1e-8)


@reproducible
@given(seeds, st.integers(1, 8))
def test_roots_are_numpys_on_random_polynomials(seed, degree):
    rng = np.random.default_rng(seed)
    many = rng.normal(size=(degree + 1, 20))
    found = polynomials.unit_roots(many)
    assert found.shape == (degree, 20)
    for p, own in zip(many.T, found.T, strict=True):
        roots = np.roots(p)
        sizes = np.abs(roots.imag)
        unclear = (sizes > 0) & (np.abs(roots.imag) < 1e-4)
        unclear |= np.minimum(np.abs(roots), np.abs(roots - 1)) < 1e-9
        if not unclear.any():
            real = np.sort(roots.real[(roots.imag == 0) & (roots.real > 0) & (roots.real < 1)])
            np.testing.assert_allclose(np.sort(own[~np.isnan(own)]), real, atol=1e-9)


@pytest.mark.parametrize(
    ("coefficients", "roots"),
    [
        ([0.0], []),
        ([3.0], []),
        ([0.0, 0.0, 0.0], []),
        ([0.0, 0.0, -2.0], []),
        ([1.0, -0.5], [0.5]),
        ([-1.0, 0.5], [0.5]),
        ([0.0, 0.0, 1.0, -0.25], [0.25]),  # vanishing leading coefficients
        ([1e-300, 0.0, 1.0, -0.25], [0.25]),
        ([1e-17, -1e-16, 1.0, -0.25], [0.25]),
        ([1.0, -1.0, 0.25], []),  # a double root changes no sign
        ([1.0, -1.5, 0.75, -0.125], [0.5]),  # a triple one does
        ([1.0, 0.0, 1.0], []),
        ([1e200, -1e200, 0.24e200], [0.4, 0.6]),  # squares would overflow, or vanish
        ([1e-200, -1e-200, 0.24e-200], [0.4, 0.6]),
        ([1e-300, 1.0, -0.25], [0.25]),
        ([1.0, -1e8, 1.0], [1e-8]),  # no cancellation
        ([1e200, -0.5e200], [0.5]),
        ([1e-200, -0.5e-200], [0.5]),
    ],
)
def test_roots_of_awkward_polynomials(coefficients, roots):
    found = inside(column(*coefficients))
    assert len(found) == len(roots)
    np.testing.assert_allclose(found, roots, atol=1e-5 if len(coefficients) == 4 else 1e-12)


@pytest.mark.parametrize("root", [0.2, 0.5, 1 / 3, 0.9])
@pytest.mark.parametrize("double", [0.1, 0.5, 0.7])
def test_a_double_root_hides_no_other(root, double):
    p = column(*np.poly([double, double, root]))
    found = inside(p)
    if root != double:
        assert np.abs(found - root).min() < 1e-12
    assert np.abs(polynomials.evaluate(p, found[:, None])).max() < 1e-12


@pytest.mark.parametrize("end", [0.0, 1.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_root_at_an_end_hides_none_inside_and_makes_none(end, sign):
    found = inside(column(*(sign * np.poly([end, 0.25, 0.625]))))
    interior = found[(found > 1e-9) & (found < 1 - 1e-9)]
    np.testing.assert_allclose(interior, [0.25, 0.625], atol=1e-12)
    assert len(found) <= 3


@reproducible
@given(seeds, st.integers(0, 9))
def test_the_extremes_lie_at_critical_points(seed, degree):
    rng = np.random.default_rng(seed)
    p = column(*rng.normal(size=degree + 1))
    points = polynomials.critical_points(p)
    assert ((points >= 0) & (points <= 1)).all()
    values = polynomials.evaluate(p, points)
    times = np.linspace(0, 1, 20001)
    dense = polynomials.evaluate(p, times[:, None])
    assert values.max() >= dense.max() - 1e-13
    assert values.min() <= dense.min() + 1e-13
    # A grid of step h sees at least all but max|p''| h²/8.
    sizes = np.abs(polynomials.bernstein(polynomials.derivative(p, 2)))
    gap = sizes.max() / 8 / 20000**2 + 1e-13
    assert values.max() <= dense.max() + gap
    assert values.min() >= dense.min() - gap


def real_roots(table):
    return np.sort(table[~np.isnan(table) & np.isfinite(table)])


@pytest.mark.parametrize(
    ("a", "b", "c", "roots"),
    [
        (1, -3, 2, [1, 2]),
        (1, 0, -4, [-2, 2]),
        (-1, 0, 4, [-2, 2]),
        (1, 0, 1, []),
        (0, 2, -1, [0.5]),
        (1, -1e8, 1, [1e-8, 1e8]),  # to 1e-16: cancellation would lose the small one
        (1, 1e8, 1, [-1e8, -1e-8]),
        (1e-20, 1, -0.5, [-1e20, 0.5]),
        (1, -2, 1, [1, 1]),
        (1, 3, 0, [-3, 0]),
    ],
)
def test_quadratic_roots_lose_no_digits(a, b, c, roots):
    found = real_roots(polynomials.quadratic_roots(*(np.array([float(x)]) for x in (a, b, c))))
    np.testing.assert_allclose(found, roots, rtol=1e-15, atol=1e-300)


@reproducible
@given(st.integers(-50, 50), st.integers(-50, 50), st.integers(-50, 50))
def test_quadratic_roots_satisfy_vieta(a, b, c):
    found = polynomials.quadratic_roots(*(np.array([float(x)]) for x in (a, b, c)))
    if a and b * b >= 4 * a * c and (b or c):
        assert found.sum() == pytest.approx(-b / a, rel=1e-13, abs=1e-13)
        assert found.prod() == pytest.approx(c / a, rel=1e-13, abs=1e-13)
    elif a and b * b < 4 * a * c:
        assert np.isnan(found).all()


def cubic(roots, far):
    """`(1 − s/far) (s − r0) (s − r1)`, its coefficients rounded once."""
    r0 = Fraction(roots[0])
    r1 = Fraction(roots[1])
    slope = -1 / Fraction(far)
    b = 1 - slope * (r0 + r1)
    exact = (slope, b, slope * r0 * r1 - (r0 + r1), r0 * r1)
    return [np.array([float(x)]) for x in exact]


@pytest.mark.parametrize("exponent", [*range(14), 20, 100])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("roots", [(0.3, 0.7), (0.01, 0.99), (0.5, 0.5001), (0.0, 1.0)])
def test_cubic_roots_survive_a_third_one_far_away(roots, sign, exponent):
    far = sign * 1.7 * 10.0**exponent
    found = polynomials.cubic_roots(*cubic(roots, far))
    for root in roots:
        expected = 1e-11 / (roots[1] - roots[0])
        assert np.nanmin(np.abs(found - root)) < expected


@pytest.mark.parametrize(
    ("coefficients", "roots"),
    [
        ((1, -6, 11, -6), [1, 2, 3]),
        ((-2, 12, -22, 12), [1, 2, 3]),
        ((1, 0, -1, 0), [-1, 0, 1]),
        ((1, 0, 0, -8), [2]),
        ((1, 0, 1, 0), [0]),
        ((1, 1, 1, 1), [-1]),
        ((0, 1, -3, 2), [1, 2]),
        ((0, 0, 2, -1), [0.5]),
        ((1e-14, 1, -3, 2), [1, 2]),
        ((1e150, -6e150, 11e150, -6e150), [1, 2, 3]),
        ((1e-150, -6e-150, 11e-150, -6e-150), [1, 2, 3]),
    ],
)
def test_cubic_roots_by_hand(coefficients, roots):
    table = polynomials.cubic_roots(*(np.array([float(x)]) for x in coefficients))
    assert table.shape == (3, 1)
    found = np.unique(np.round(real_roots(table), 10))
    np.testing.assert_allclose(found, roots, atol=1e-9)


@pytest.mark.parametrize("root", [0.0, 0.3, 0.4, 1 / 3, 0.7, 1.0])
def test_a_triple_root_is_found_as_well_as_it_can_be(root):
    found = polynomials.cubic_roots(*(np.array([x]) for x in np.poly([root] * 3)))
    assert np.nanmin(np.abs(found - root)) < 2e-5


@reproducible
@given(seeds)
def test_cubic_roots_are_numpys(seed):
    many = np.random.default_rng(seed).normal(size=(4, 30))
    found = polynomials.cubic_roots(*many)
    for p, own in zip(many.T, found.T, strict=True):
        roots = np.roots(p)
        for root in roots.real[np.abs(roots.imag) == 0]:
            close = np.abs(roots - root)
            if np.sort(close)[1] > 1e-3:
                expected = 1e-9 * (1 + abs(root))
                assert np.nanmin(np.abs(own - root)) < expected


@reproducible
@given(seeds)
def test_a_root_at_zero_spoils_no_other(seed):
    """A joint that rests in the first segment: there its acceleration's first control is 0."""
    first, second = np.random.default_rng(seed).uniform(0.2, 1.5, (2, 300))
    scale = 10 ** np.random.default_rng(seed).uniform(-3, 3, 300)
    zero = np.zeros(300)
    # (s - first) (s - second) s
    table = scale * [1 + zero, -(first + second), first * second, zero]
    found = np.sort(polynomials.cubic_roots(*table), axis=0)
    expected = np.sort([zero, first, second], axis=0)
    apart = np.abs(first - second) > 1e-3
    np.testing.assert_allclose(found[:, apart], expected[:, apart], atol=1e-9)


def test_batches_keep_their_shape():
    rng = np.random.default_rng(0)
    a, b, c, d = rng.normal(size=(4, 2, 5))
    assert polynomials.cubic_roots(a, b, c, d).shape == (3, 2, 5)
    assert polynomials.quadratic_roots(a, b, c).shape == (2, 2, 5)
    drawn = rng.normal(size=(6, 5))
    assert polynomials.unit_roots(drawn).shape == (5, 5)
    ones = np.ones((1, 5))
    assert polynomials.unit_roots(ones).shape == (0, 5)
    one = polynomials.cubic_roots(a[1, 3], b[1, 3], c[1, 3], d[1, 3])
    expected = polynomials.cubic_roots(a, b, c, d)[:, 1, 3]
    np.testing.assert_array_equal(one, expected)
