"""Piecewise polynomials from SciPy, and one of them inside another: exact, nothing is sampled."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidTrajectory

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly

Array = NDArray[np.float64]

# Relative to the duration. A nearer crossing of a break is the break itself.
CROSSING_RTOL = 1e-12
# Relative to the domain: rounding by which s(t) may leave it.
DOMAIN_RTOL = 1e-12


class Pieces(NamedTuple):
    """Breaks `(pieces + 1,)`, and coefficients `(degree + 1, pieces, joints)` since each break.

    Highest power first, as `scipy.interpolate.PPoly` has them.
    """

    breaks: Array
    coefficients: Array


def of_scipy(function: PPoly | BSpline) -> Pieces:
    """Convert SciPy's piecewise polynomial or B-spline.

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
    last = len(knots) - degree
    breaks = np.unique(knots[degree:last])
    starts = breaks[:-1]
    rows = []
    for power in reversed(range(degree + 1)):
        derivative = spline(starts, nu=power)
        pieces_first = np.moveaxis(derivative, spline.axis, 0)
        rows.append(pieces_first / factorial(power))
    coefficients = np.stack(rows)
    return Pieces(breaks, _columns(coefficients, "a B-spline's values"))


def _columns(coefficients: Array, what: str) -> Array:
    """Coefficients with joints as the last of three axes, also for a single joint."""
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
    lengths = np.diff(s.breaks)
    middle = polynomials.evaluate(local, 0.5 * lengths)
    after = np.searchsorted(path.breaks, middle, side="right")
    last_piece = len(path.breaks) - 2
    piece = np.clip(after - 1, 0, last_piece)

    # s(t) since that piece's start, and Horner's rule with it in place of a number.
    inner = np.array(local)
    inner[-1] -= path.breaks[piece]
    result = path.coefficients[:1, piece]
    for row in path.coefficients[1:, piece]:
        result = polynomials.product(result, inner[..., None])
        result[-1] += row
    return Pieces(s.breaks, result)


def _check_domain(path: Pieces, parameter: Pieces) -> None:
    """Refuse a parameter that leaves the path: its peaks, from roots, lie within the domain."""
    unit = _unit(parameter)
    at = polynomials.critical_points(unit)
    values = polynomials.evaluate(unit[:, None], at)
    first = path.breaks[0]
    last = path.breaks[-1]
    size = max(last - first, abs(first), abs(last))
    slack = DOMAIN_RTOL * size
    lowest = float(values.min())
    highest = float(values.max())
    inside = lowest >= first - slack and highest <= last + slack
    if not inside:  # also where a value is not a number
        reached = f"s(t) runs from {lowest:.9g} to {highest:.9g}"
        raise InvalidTrajectory(f"{reached}; the path from {first:.9g} to {last:.9g}")


def _unit(parameter: Pieces) -> Array:
    """The one function's pieces on the unit interval, `(degree + 1, pieces)`."""
    lengths = np.diff(parameter.breaks)
    one = parameter.coefficients[..., 0]
    return polynomials.stretched(one, lengths)


def _split(parameter: Pieces, levels: Array) -> Pieces:
    """Add a break to a function wherever it crosses one of the levels."""
    breaks = _with_crossings(parameter, levels)
    starts = breaks[:-1]
    after = np.searchsorted(parameter.breaks, starts, side="right")
    own = after - 1
    offset = starts - parameter.breaks[own]
    moved = polynomials.shifted(
        parameter.coefficients[:, own],
        offset[:, None],
    )
    return Pieces(breaks, moved)


def _with_crossings(parameter: Pieces, levels: Array) -> Array:
    """Its breaks, and the times at which it crosses a level, those at a break left out."""
    unit = _unit(parameter)
    bounds = polynomials.bernstein(unit)
    lowest = bounds.min(axis=0)
    highest = bounds.max(axis=0)
    above = lowest[:, None] <= levels
    below = levels <= highest[:, None]
    piece, level = np.nonzero(above & below)
    shifted = unit[:, piece]
    shifted[-1] -= levels[level]
    shares = polynomials.unit_roots(shifted)
    lengths = np.diff(parameter.breaks)
    elapsed = shares * lengths[piece]
    crossings = parameter.breaks[piece] + elapsed
    found = crossings[np.isfinite(crossings)]

    breaks = parameter.breaks
    duration = breaks[-1] - breaks[0]
    slack = CROSSING_RTOL * duration
    for crossing in found:
        distance = np.abs(breaks - crossing)
        if distance.min() > slack:
            breaks = np.append(breaks, crossing)
    return np.sort(breaks)
