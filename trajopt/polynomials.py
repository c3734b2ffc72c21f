"""Polynomials on the unit interval, many at once: roots, extrema and the bounds that avoid them.

Every array holds coefficients along its first axis, highest power first, one polynomial per
remaining index. No eigenvalues: roots are bracketed between the roots of the derivative, so a
vanishing leading coefficient needs no special case.
"""

from __future__ import annotations

from functools import cache
from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# 2^-42 of the interval: an extremum's value is then exact to rounding, being flat there.
_BISECTIONS = 42


def evaluate(coefficients: Array, s: Array) -> Array:
    """Horner's rule: `(degree + 1, …)` coefficients at points that broadcast against `…`."""
    value = np.zeros(np.broadcast_shapes(coefficients.shape[1:], np.shape(s)))
    for c in coefficients:
        value = value * s + c
    return value


def derivative(coefficients: Array, order: int = 1) -> Array:
    """Coefficients of the derivative; of a constant, one row of zeros."""
    for _ in range(order):
        powers = np.arange(len(coefficients) - 1, 0, -1.0)
        coefficients = coefficients[:-1] * powers.reshape((-1,) + (1,) * (coefficients.ndim - 1))
    return coefficients if len(coefficients) else np.zeros((1, *coefficients.shape[1:]))


def stretched(coefficients: Array, length: Array | float) -> Array:
    """Coefficients of `p(length · s)`: a piece in local time, moved to the unit interval."""
    powers = np.arange(len(coefficients) - 1, -1, -1)
    factors = np.asarray(length, dtype=float) ** powers.reshape((-1,) + (1,) * np.ndim(length))
    shape = factors.shape + (1,) * (coefficients.ndim - factors.ndim)
    return np.asarray(coefficients * factors.reshape(shape))


def shifted(coefficients: Array, offset: Array) -> Array:
    """Coefficients of `p(offset + t)` (Taylor shift), one offset per polynomial."""
    shifted = np.array(coefficients)
    for row in range(len(shifted) - 1):  # repeated synthetic division
        for i in range(1, len(shifted) - row):
            shifted[i] += offset * shifted[i - 1]
    return shifted


@cache
def _to_bernstein(degree: int) -> Array:
    rows = [
        [comb(i, p) / comb(degree, p) for p in range(degree, -1, -1)] for i in range(degree + 1)
    ]
    return np.array(rows)


def bernstein(coefficients: Array) -> Array:
    """Bernstein coefficients on `[0, 1]`; the polynomial stays within their range."""
    return np.tensordot(_to_bernstein(len(coefficients) - 1), coefficients, axes=1)


def unit_roots(coefficients: Array) -> Array:
    """Roots in `[0, 1]` where the sign changes, `(degree, N)` for `(degree + 1, N)`; NaN elsewhere.

    Between neighbouring roots of the derivative a polynomial is monotone, so each such interval
    holds at most one root, found by bisection.
    """
    if len(coefficients) < 2:
        return np.empty((0, *coefficients.shape[1:]))
    if len(coefficients) == 3:
        return _unit_quadratic(coefficients)
    inner = np.nan_to_num(unit_roots(derivative(coefficients)), nan=1.0)
    ends = np.zeros_like(coefficients[:1])
    knots = np.sort(np.concatenate([ends, inner, ends + 1.0]), axis=0)
    values = evaluate(coefficients[:, None], knots)
    row, column = np.nonzero((values[:-1] < 0) != (values[1:] < 0))
    roots = np.full((len(coefficients) - 1, *coefficients.shape[1:]), np.nan)
    roots[row, column] = _bisect(
        coefficients[:, column], knots[row, column], knots[row + 1, column], values[row, column] < 0
    )
    return roots


def _unit_quadratic(coefficients: Array) -> Array:
    """The same in closed form for degree 2, which saves most of the bisections."""
    size = np.abs(coefficients).max(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        roots = quadratic_roots(*(coefficients / size))
        crossed = (roots >= 0) & (roots <= 1) & (roots[0] != roots[1])
        return np.where(crossed, roots, np.nan)


def _bisect(coefficients: Array, low: Array, high: Array, negative: NDArray[np.bool_]) -> Array:
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        left = (evaluate(coefficients, middle) < 0) == negative
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    return 0.5 * (low + high)


def critical_points(coefficients: Array) -> Array:
    """Where an extremum can lie on `[0, 1]`: both ends and the inner critical points, `(k, N)`."""
    inner = unit_roots(derivative(coefficients))
    ends = np.zeros((1, *inner.shape[1:]))
    return np.concatenate([ends, ends + 1.0, np.nan_to_num(inner, nan=0.0)])


def quadratic_roots(a: Array, b: Array, c: Array) -> Array:
    """Real roots of `a s² + b s + c`, `(2, …)`; NaN where there are none, no cancellation."""
    with np.errstate(invalid="ignore", divide="ignore"):
        q = -0.5 * (b + np.copysign(np.sqrt(b * b - 4 * a * c), b))
        return np.stack([q / a, c / q])


def cubic_roots(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Real roots of `a s³ + b s² + c s + d`, `(3, …)`; NaN where fewer.

    The root that stands most apart from the others, in closed form and polished; then the quadratic
    that is left without it (Kahan), however far away that root is. Where `a` is nothing beside the
    others the quadratic's roots are returned. Meant for roots of moderate size, such as those in
    the unit interval.
    """
    size = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.maximum(np.abs(c), np.abs(d)))
    flat = np.abs(a) <= 1e-12 * size
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        lone = _newton(_lone_root(b / a, c / a, d / a), a, b, c, d)
        # Divide it out from the end of the cubic where nothing cancels.
        far = np.abs(a * lone**3) > np.abs(d)
        linear = np.where(far, (-d / lone - c) / lone, a * lone + b)
        constant = np.where(far, -d / lone, (a * lone + b) * lone + c)
        pair = quadratic_roots(
            np.asarray(np.where(flat, b, a)),
            np.asarray(np.where(flat, c, linear)),
            np.asarray(np.where(flat, d, constant)),
        )
    return np.concatenate([np.where(flat, np.nan, lone)[None], pair])


def _newton(roots: Array, a: Array, b: Array, c: Array, d: Array) -> Array:
    """Two steps, each kept only where it comes nearer: at a multiple root none may."""
    for _ in range(2):
        value = ((a * roots + b) * roots + c) * roots + d
        nearer = roots - value / ((3 * a * roots + 2 * b) * roots + c)
        left = ((a * nearer + b) * nearer + c) * nearer + d
        roots = np.where(np.abs(left) < np.abs(value), nearer, roots)
    return roots


def _lone_root(b: Array, c: Array, d: Array) -> Array:
    """The root of `s³ + b s² + c s + d` farthest from the mean of all three (Viète, Cardano)."""
    q, r = (b * b - 3 * c) / 9, (2 * b**3 - 9 * b * c + 27 * d) / 54
    three = 2 * np.sqrt(q) * np.cos(np.arccos(np.minimum(np.abs(r) / np.sqrt(q**3), 1.0)) / 3)
    big = np.cbrt(np.abs(r) + np.sqrt(r * r - q**3))
    one = big + np.where(big != 0, q / big, 0.0)
    return np.asarray(-np.copysign(np.where(r * r < q**3, three, one), r) - b / 3)
