"""Piecewise polynomials from SciPy, converted exactly: nothing is sampled."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidTrajectory

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly


class PiecewisePolynomial(NamedTuple):
    """Breaks `(pieces + 1,)`, and coefficients `(degree + 1, pieces, joints)` since each break.

    Highest power first, as `scipy.interpolate.PPoly` has them.
    """

    breaks: Array
    coefficients: Array


def of_scipy(function: PPoly | BSpline) -> PiecewisePolynomial:
    """Convert SciPy's piecewise polynomial or B-spline.

    Raises:
        InvalidTrajectory: The object is neither a `PPoly` nor a `BSpline`, or not usable as one.
    """
    from scipy.interpolate import BSpline, PPoly  # slow to import, and seldom needed

    if isinstance(function, PPoly):
        return of_ppoly(function)
    if isinstance(function, BSpline):
        return of_spline(function)
    kind = type(function).__name__
    raise InvalidTrajectory(f"a Trajectory, PPoly or BSpline is needed, not {kind}")


def of_ppoly(ppoly: PPoly) -> PiecewisePolynomial:
    """SciPy's piecewise polynomial (`CubicSpline` and the like too), one column per joint.

    Raises:
        InvalidTrajectory: The polynomial has several axes, is complex, or its breaks do not
            increase.
    """
    coefficients = _columns(np.asarray(ppoly.c), "coefficients")
    breaks = np.asarray(ppoly.x, dtype=float)
    if not (np.diff(breaks) > 0).all():
        raise InvalidTrajectory("the breaks of a PPoly must increase")
    return PiecewisePolynomial(breaks, coefficients)


def of_spline(spline: BSpline) -> PiecewisePolynomial:
    """A B-spline on its own interval, from its degree's knot to the last but its degree.

    Every piece is the Taylor polynomial at its first knot, which is the piece itself.

    Raises:
        InvalidTrajectory: The spline has several axes or is complex.
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
    return PiecewisePolynomial(breaks, _columns(coefficients, "a B-spline's values"))


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
