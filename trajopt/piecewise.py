"""Piecewise polynomials from SciPy, and one of them inside another: exact, nothing is sampled."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.exceptions import InvalidTrajectory

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly

Array = NDArray[np.float64]

# A crossing this near to a break is the break, relative to the whole: bisection finds no nearer.
_CROSSING_RTOL = 1e-12
# How far the inner function may leave the outer one's domain, relative to that: rounding.
_DOMAIN_RTOL = 1e-12


class Pieces(NamedTuple):
    """Breaks `(pieces + 1,)`, and coefficients `(degree + 1, pieces, joints)` since each break.

    Highest power first, as `scipy.interpolate.PPoly` has them.
    """

    breaks: Array
    coefficients: Array


def of_scipy(function: PPoly | BSpline) -> Pieces:
    """What SciPy has, as pieces.

    Raises:
        InvalidTrajectory: It is neither a `PPoly` nor a `BSpline`, or not usable as one.
    """
    from scipy.interpolate import BSpline, PPoly  # slow to import, and seldom needed

    if isinstance(function, PPoly):
        return of_ppoly(function)
    if isinstance(function, BSpline):
        return of_spline(function)
    kind = type(function).__name__
    raise InvalidTrajectory(f"a Trajectory, PPoly or BSpline is needed, not {kind}")


def of_ppoly(ppoly: PPoly) -> Pieces:
    """SciPy's piecewise polynomial (`CubicSpline` and the like too), one column per joint.

    Raises:
        InvalidTrajectory: It is of several axes, complex, or its breaks do not increase.
    """
    coefficients = _columns(np.asarray(ppoly.c), "coefficients")
    breaks = np.asarray(ppoly.x, dtype=float)
    if not (np.diff(breaks) > 0).all():
        raise InvalidTrajectory("the breaks of a PPoly must increase")
    return Pieces(breaks, coefficients)


def of_spline(spline: BSpline) -> Pieces:
    """A B-spline on its own interval, from its degree's knot to the last but its degree.

    Every piece is the Taylor polynomial at its first knot, which is the piece itself.

    Raises:
        InvalidTrajectory: It is of several axes or complex.
    """
    degree = int(spline.k)
    knots = np.asarray(spline.t, dtype=float)
    inside = knots[degree : len(knots) - degree]
    breaks = np.unique(inside)
    rows = []
    for power in range(degree, -1, -1):
        at_starts = np.moveaxis(spline(breaks[:-1], nu=power), spline.axis, 0)
        rows.append(np.asarray(at_starts) / factorial(power))
    return Pieces(breaks, _columns(np.stack(rows), "a B-spline's values"))


def _columns(coefficients: Array, what: str) -> Array:
    """With the joints as the last of three axes, where there is one joint too."""
    if np.iscomplexobj(coefficients):
        raise InvalidTrajectory(f"{what} must be real")
    if coefficients.ndim == 2:
        coefficients = coefficients[..., None]
    if coefficients.ndim != 3:
        shape = coefficients.shape[2:]
        raise InvalidTrajectory(f"{what} must be numbers or one row of joints, not {shape}")
    return np.asarray(coefficients, dtype=float)


def composed(path: Pieces, parameter: Pieces) -> Pieces:
    """`q(s(t))`, exactly: a polynomial on every piece, of both degrees' product.

    Broken where `s(t)` is broken, and where it crosses a break of the path.

    Args:
        path: `q(s)`, of any number of joints.
        parameter: `s(t)`, one column, within the path's domain.

    Raises:
        InvalidTrajectory: `s(t)` has several columns, or leaves the path's domain.
    """
    if parameter.coefficients.shape[2] != 1:
        raise InvalidTrajectory("the path's parameter s(t) must be one function")
    _check_domain(path, parameter)
    s = _split(parameter, path.breaks[1:-1])

    # Each piece of s(t) lies within one piece of the path: that of its middle.
    local = s.coefficients[..., 0]
    half = 0.5 * np.diff(s.breaks)
    middle = polynomials.evaluate(local, half)
    after = np.searchsorted(path.breaks, middle, side="right")
    piece = np.clip(after - 1, 0, len(path.breaks) - 2)

    # s(t) since that piece's start, and Horner's rule with it in place of a number.
    inner = np.array(local)
    inner[-1] -= path.breaks[piece]
    result = path.coefficients[:1, piece]
    for row in path.coefficients[1:, piece]:
        result = _product(result, inner)
        result[-1] += row
    return Pieces(s.breaks, result)


def _product(left: Array, right: Array) -> Array:
    """Of polynomials `(a, pieces, joints)` and `(b, pieces)`: `(a + b − 1, pieces, joints)`."""
    degrees = len(left) + len(right) - 2
    product = np.zeros((degrees + 1, *left.shape[1:]))
    for power, factor in enumerate(right):
        product[power : power + len(left)] += left * factor[:, None]
    return product


def _check_domain(path: Pieces, parameter: Pieces) -> None:
    """Refuse a parameter that leaves the path: its peaks, from roots, lie within the domain."""
    lengths = np.diff(parameter.breaks)
    unit = polynomials.stretched(parameter.coefficients, lengths)[..., 0]
    at = polynomials.critical_points(unit)
    values = polynomials.evaluate(unit[:, None], at)
    first = path.breaks[0]
    last = path.breaks[-1]
    slack = _DOMAIN_RTOL * max(last - first, abs(first), abs(last))
    lowest = float(values.min())
    highest = float(values.max())
    inside = lowest >= first - slack and highest <= last + slack
    if not inside:  # also of what is no number
        reached = f"s(t) runs from {lowest:.9g} to {highest:.9g}"
        raise InvalidTrajectory(f"{reached}; the path from {first:.9g} to {last:.9g}")


def _split(parameter: Pieces, levels: Array) -> Pieces:
    """The same function with a break wherever it crosses one of the levels, too."""
    lengths = np.diff(parameter.breaks)
    unit = polynomials.stretched(parameter.coefficients, lengths)[..., 0]
    bounds = polynomials.bernstein(unit)
    lowest = bounds.min(axis=0)[:, None]
    highest = bounds.max(axis=0)[:, None]
    piece, level = np.nonzero((lowest <= levels) & (levels <= highest))
    shifted = np.array(unit[:, piece])
    shifted[-1] -= levels[level]
    shares = polynomials.unit_roots(shifted)
    crossings = parameter.breaks[piece] + shares * lengths[piece]
    found = crossings[np.isfinite(crossings)]

    duration = parameter.breaks[-1] - parameter.breaks[0]
    slack = _CROSSING_RTOL * duration
    breaks = parameter.breaks
    for crossing in np.sort(found):
        nearest = np.abs(breaks - crossing).min()
        if nearest > slack:
            breaks = np.append(breaks, crossing)
    breaks = np.sort(breaks)
    after = np.searchsorted(parameter.breaks, breaks[:-1], side="right")
    own = after - 1
    offset = breaks[:-1] - parameter.breaks[own]
    moved = polynomials.shifted(parameter.coefficients[:, own], offset[:, None])
    return Pieces(breaks, moved)
