"""Polynomials on the unit interval, many at once: roots, extrema and bounds.

Every array holds coefficients along its first axis, highest power first, one polynomial per
remaining index. No eigenvalues: roots are bracketed between the roots of the derivative, so a
vanishing leading coefficient needs no special case.
"""

from __future__ import annotations

from functools import cache
from math import comb

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices

# The root is known to 2^-42 of the interval. An extremum's value is then exact to rounding.
BISECTIONS = 42
# Evaluating a polynomial of degree d rounds by less than this times (d + 1) Σ |coefficients|.
EVALUATION_RTOL = 2 * float(np.finfo(float).eps)


def evaluate(coefficients: Array, s: Array) -> Array:
    """Horner's rule: `(degree + 1, …)` coefficients at points that broadcast against `…`."""
    highest, *others = coefficients
    value = 0.0 * s + highest  # broadcast
    for c in others:
        value = value * s + c
    return value


def evaluation_rounding(coefficients: Array) -> Array:
    """Bound the rounding of each polynomial's values on `[0, 1]`."""
    terms = np.abs(coefficients).sum(axis=0)
    return EVALUATION_RTOL * len(coefficients) * terms


def derivative(coefficients: Array, order: int = 1) -> Array:
    """Coefficients of the derivative; of a constant, one row of zeros."""
    trailing = (1,) * (coefficients.ndim - 1)
    for _ in range(order):
        degree = len(coefficients) - 1
        # d/ds c_p s^p = p c_p s^(p − 1)
        powers = np.arange(degree, 0, -1.0)
        without_constant = coefficients[:-1]
        coefficients = without_constant * powers.reshape(-1, *trailing)
    if len(coefficients):
        return coefficients
    return np.zeros((1, *coefficients.shape[1:]))


def plus(left: Array, right: Array) -> Array:
    """The sum of polynomials of any two degrees, whose remaining indices broadcast."""
    longer, shorter = sorted((left, right), key=len, reverse=True)
    shape = np.broadcast_shapes(longer.shape[1:], shorter.shape[1:])
    total = np.zeros((len(longer), *shape))
    total += longer
    lowest = total[-len(shorter) :]
    lowest += shorter
    return total


def product(left: Array, right: Array) -> Array:
    """The product of polynomials of any two degrees, whose remaining indices broadcast."""
    shape = np.broadcast_shapes(left.shape[1:], right.shape[1:])
    rows = len(left) + len(right) - 1
    result = np.zeros((rows, *shape))
    for power, factor in enumerate(right):
        result[power : power + len(left)] += left * factor
    return result


def composed(outer: Array, inner: Array) -> Array:
    """The polynomials `outer(inner(t))`, whose remaining indices broadcast."""
    result = outer[:1] + 0.0 * inner[:1]
    for row in outer[1:]:
        result = product(result, inner)
        result[-1] += row
    return result


def stretched(coefficients: Array, length: Array | float) -> Array:
    """Coefficients of `p(length · s)`: a piece in local time, moved to the unit interval."""
    # c_p (length s)^p = (c_p length^p) s^p
    factors = powers(np.asarray(length, dtype=float), len(coefficients) - 1)
    trailing = (1,) * (coefficients.ndim - factors.ndim)
    factors = factors.reshape(*factors.shape, *trailing)
    return coefficients * factors


def powers(length: Array, degree: int) -> Array:
    """`length` to the powers `degree` … 0, `(degree + 1, …)`.

    Their last bits depend on how many are computed at once: NumPy squares some, others are powers.
    """
    shared = (1,) * length.ndim
    return np.asarray(length ** np.arange(degree, -1, -1).reshape(-1, *shared))


def shifted(coefficients: Array, offset: Array | float) -> Array:
    """Coefficients of `p(offset + t)` (Taylor shift), one offset per polynomial."""
    shifted = np.array(coefficients)
    rows = len(shifted)
    for row in range(rows - 1):  # repeated synthetic division
        for i in range(1, rows - row):
            shifted[i] += offset * shifted[i - 1]
    return shifted


@cache
def _to_bernstein(degree: int) -> Array:
    """`b_i = Σ_p C(i, p) / C(degree, p) c_p`."""
    matrix = np.empty((degree + 1, degree + 1))
    for i in range(degree + 1):
        for column in range(degree + 1):
            p = degree - column
            share = comb(i, p) / comb(degree, p)
            matrix[i, column] = share
    return matrix


def bernstein(coefficients: Array) -> Array:
    """Bernstein coefficients on `[0, 1]`; the polynomial stays within their range."""
    degree = len(coefficients) - 1
    flat = _to_bernstein(degree) @ coefficients.reshape(degree + 1, -1)
    return flat.reshape(coefficients.shape)


def from_bernstein(controls: Array) -> Array:
    """Polynomials given by Bernstein coefficients `(degree + 1, …)`, in powers of `s`."""
    degree = len(controls) - 1
    rows = []
    differences = controls
    for power in range(degree + 1):
        # C(n, p) Δ^p b_0 multiplies s^p
        rows.append(comb(degree, power) * differences[0])
        differences = np.diff(differences, axis=0)
    return np.stack(rows[::-1])


def unit_roots(coefficients: Array) -> Array:
    """Roots in `[0, 1]` where the sign changes, `(degree, N)` for `(degree + 1, N)`; NaN elsewhere.

    Between neighbouring roots of the derivative a polynomial is monotone, so each such interval
    holds at most one root, found by bisection.
    """
    degree = len(coefficients) - 1
    if degree < 1:
        return np.empty((0, *coefficients.shape[1:]))
    if degree == 2:
        return _unit_quadratic(coefficients)
    turns = unit_roots(derivative(coefficients))
    turns = np.nan_to_num(turns, nan=1.0)
    start = np.zeros_like(coefficients[:1])
    knots = np.concatenate([start, turns, start + 1.0])
    knots = np.sort(knots, axis=0)
    values = evaluate(coefficients[:, None], knots)
    negative = values < 0
    crosses = np.diff(negative, axis=0)
    row, column = np.nonzero(crosses)
    low = knots[row, column]
    high = knots[row + 1, column]
    roots = np.full_like(coefficients[:-1], np.nan)
    roots[row, column] = _bisect(coefficients[:, column], low, high, negative[row, column])
    return roots


def _unit_quadratic(coefficients: Array) -> Array:
    """`unit_roots` of degree 2, in closed form, which saves most of the bisections."""
    size = np.abs(coefficients).max(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c = coefficients / size
        roots = quadratic_roots(a, b, c)
        inside = (roots >= 0) & (roots <= 1)
        crosses = roots[0] != roots[1]
        return np.where(inside & crosses, roots, np.nan)


def _bisect(coefficients: Array, low: Array, high: Array, negative: Bools) -> Array:
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        below = evaluate(coefficients, middle) < 0
        left = below == negative
        low = np.where(left, middle, low)
        high = np.where(left, high, middle)
    return 0.5 * (low + high)


def critical_points(coefficients: Array) -> Array:
    """Possible extrema on `[0, 1]`: both ends and the inner critical points, `(k, N)`."""
    inner = unit_roots(derivative(coefficients))
    inner = np.nan_to_num(inner, nan=0.0)
    start = np.zeros((1, *inner.shape[1:]))
    return np.concatenate([start, start + 1.0, inner])


def positive_intervals(
    coefficients: Array,
) -> tuple[Array, Array, tuple[Indices, ...]]:
    """Every part of `[0, 1]` where a polynomial is positive.

    Between neighbouring roots the sign is that of the middle.

    Returns:
        The starts and ends of the parts, `(n,)` each, and the index of each one's polynomial.
    """
    flat = coefficients.reshape(len(coefficients), -1)
    roots = unit_roots(flat).reshape(-1, *coefficients.shape[1:])
    zeros = np.zeros_like(coefficients[:1])
    knots = np.concatenate([zeros, np.nan_to_num(roots, nan=1.0), zeros + 1.0])
    knots = np.sort(knots, axis=0)
    left = knots[:-1]
    right = knots[1:]
    middle = 0.5 * (left + right)
    above = evaluate(coefficients[:, None], middle) > 0
    found = np.nonzero(above & (right > left))
    _, *which = found
    return left[found], right[found], tuple(which)


def quadratic_roots(a: Array, b: Array, c: Array) -> Array:
    """Real roots of `a s² + b s + c`, `(2, …)`, without cancellation; complex ones are NaN."""
    with np.errstate(invalid="ignore", divide="ignore"):
        discriminant = b * b - 4 * a * c
        root = np.copysign(np.sqrt(discriminant), b)
        q = -0.5 * (b + root)
        return np.stack([q / a, c / q])


_NEAR_ZERO = 1e-3  # of `c`, for `a s²`: the largest root has at least a third of it


def cubic_roots(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Real roots of `a s³ + b s² + c s + d`, `(3, …)`; NaN where fewer.

    The root farthest from the others is found in closed form and polished; the others are the roots
    of the remaining quadratic (Kahan). Where `a` is negligible beside the other coefficients, the
    quadratic's roots are returned. Meant for roots of moderate size, such as those in the unit
    interval.
    """
    coefficients = np.stack(np.broadcast_arrays(a, b, c, d))
    sizes = np.abs(coefficients)
    largest = sizes.max(axis=0)
    flat = sizes[0] <= 1e-12 * largest
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        lone = _lone_root(b / a, c / a, d / a)
        lone = _newton(lone, coefficients)
        # a s³ + b s² + c s + d = (s − lone) (a s² + linear s + constant), divided from that end of
        # the cubic where no terms cancel.
        squared = a * lone * lone
        far = np.abs(squared * lone) > np.abs(d)
        # a root near zero is no better known than zero: never divide by it
        far &= np.abs(squared) > _NEAR_ZERO * np.abs(c)
        forwards = a * lone + b
        backwards = -d / lone
        linear = np.where(far, (backwards - c) / lone, forwards)
        constant = np.where(far, backwards, forwards * lone + c)
        square = np.where(flat, b, a)
        linear = np.where(flat, c, linear)
        constant = np.where(flat, d, constant)
        pair = quadratic_roots(square, linear, constant)
    lone = np.where(flat, np.nan, lone)
    return np.concatenate([lone[None], pair])


def _newton(roots: Array, coefficients: Array) -> Array:
    """Two steps, each kept only where it comes nearer: at a multiple root none may."""
    derivatives = derivative(coefficients)
    for _ in range(2):
        value = evaluate(coefficients, roots)
        slope = evaluate(derivatives, roots)
        nearer = roots - value / slope
        left = evaluate(coefficients, nearer)
        better = np.abs(left) < np.abs(value)
        roots = np.where(better, nearer, roots)
    return roots


def _lone_root(b: Array, c: Array, d: Array) -> Array:
    """The root of `s³ + b s² + c s + d` farthest from the mean of all three (Viète, Cardano)."""
    # q = (b² − 3c) / 9,  r = (2b³ − 9bc + 27d) / 54
    q = (b * b - 3 * c) / 9
    # products: a power takes as long as thirty of them
    b3 = b * b * b
    r = (2 * b3 - 9 * b * c + 27 * d) / 54
    q3 = q * q * q
    size = np.abs(r)

    # Three real roots where r² < q³ (Viète): 2 √q cos(arccos(r / √q³) / 3)
    cosine = np.minimum(size / np.sqrt(q3), 1.0)
    angle = np.arccos(cosine) / 3
    three = 2 * np.sqrt(q) * np.cos(angle)

    # else one (Cardano): u + q/u with u = ∛(r + √(r² − q³))
    square = r * r
    u = np.cbrt(size + np.sqrt(square - q3))
    partner = np.where(u != 0, q / u, 0.0)
    one = u + partner

    distance = np.where(square < q3, three, one)
    mean = b / 3
    return -np.copysign(distance, r) - mean
