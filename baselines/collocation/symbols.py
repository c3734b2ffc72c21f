"""Symbols of CasADi that take part in NumPy's arithmetic, for the rows of limits.

`Polynomial` is a polynomial of time on every interval, by its Bernstein coefficients: where these
are within a row's bounds, the row holds at every instant. It knows sums, products, quotients by
numbers, and whole powers. `Symbol` is a value at an instant of every interval. It knows every
function of CasADi.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import comb
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from trajopt.planners.planner import backend

# NumPy's functions whose names CasADi has, too, or others for the same.
_FUNCTIONS = {
    **{name: name for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "hypot")},
    **{f"arc{name}": f"a{name}" for name in ("sin", "cos", "tan")},
    "arctan2": "atan2",
    "absolute": "fabs",
    "fabs": "fabs",
    "maximum": "fmax",
    "minimum": "fmin",
    "add": "plus",
    "subtract": "minus",
    "multiply": "times",
    "divide": "rdivide",
    "power": "power",
    "square": "sq",
}


class NotPolynomialError(TypeError):
    """A row is no polynomial of the state."""


class Symbol(NDArrayOperatorsMixin):
    """Values at an instant of every interval: a column of CasADi."""

    def __init__(self, column: Any) -> None:
        self.column = column

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *given: Any, **keywords: Any) -> Any:
        if any(isinstance(own, np.ndarray) and own.dtype == object for own in given):
            return NotImplemented  # NumPy then asks its elements one by one
        columns = [own.column if isinstance(own, Symbol) else _number(own) for own in given]
        if ufunc is np.negative:
            return Symbol(-columns[0])
        if method != "__call__" or keywords or ufunc.__name__ not in _FUNCTIONS:
            raise TypeError(f"numpy.{ufunc.__name__} of symbols")
        function = getattr(backend("casadi"), _FUNCTIONS[ufunc.__name__])
        return Symbol(function(*columns))

    def positive(self, corner: float) -> Symbol:
        """Return a smooth function above `max(0, x)`; see `trajopt.core.limits.rows.positive`."""
        return Symbol(_above(self.column, corner))


class Polynomial(NDArrayOperatorsMixin):
    """A polynomial on every interval.

    Attributes:
        parts: its Bernstein coefficients, columns of CasADi.
        continuous: whether the last one is the first one of the next interval.
    """

    def __init__(self, parts: Sequence[Any], *, continuous: bool) -> None:
        self.parts = tuple(parts)
        self.continuous = continuous

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *given: Any, **keywords: Any) -> Any:
        if any(isinstance(own, np.ndarray) and own.dtype == object for own in given):
            return NotImplemented
        rule = _RULES.get(ufunc)
        if method != "__call__" or keywords or rule is None:
            raise NotPolynomialError(ufunc.__name__)
        return rule(*given)

    def positive(self, corner: float) -> Polynomial:
        """Return the polynomial whose coefficients are above 0, and above those of this one."""
        return self._each(lambda own: _above(own, corner))

    def at(self, share: float) -> Any:
        """Return the values at a share of every interval, from 0 to 1."""
        n = len(self.parts) - 1
        weights = [comb(n, k) * share**k * (1 - share) ** (n - k) for k in range(n + 1)]
        pairs = zip(weights, self.parts, strict=True)
        return sum(weight * own for weight, own in pairs if weight)

    def _each(self, change: Callable[[Any], Any]) -> Polynomial:
        return Polynomial([*map(change, self.parts)], continuous=self.continuous)

    def _elevated(self, degree: int) -> Polynomial:
        """Return the same polynomial with the coefficients of a higher degree."""
        parts = self.parts
        while (count := len(parts)) <= degree:
            inner = [
                (k * before + (count - k) * after) / count
                for k, (before, after) in enumerate(pairwise(parts), 1)
            ]
            parts = (parts[0], *inner, parts[-1])
        return Polynomial(parts, continuous=self.continuous)


def _above(x: Any, corner: float) -> Any:
    return (x + backend("casadi").sqrt(x**2 + corner**2)) / 2


def made(value: Any) -> Polynomial:
    """Return a polynomial as it is; a number, or one for each interval, as a constant one."""
    if isinstance(value, Polynomial):
        return value
    return Polynomial([_number(value)], continuous=bool(np.ptp(value) == 0))


def _number(value: Any) -> Any:
    return backend("casadi").DM(value) if isinstance(value, np.ndarray) else float(value)


def _sum(one: Any, other: Any) -> Polynomial:
    a, b = made(one), made(other)
    degree = max(len(a.parts), len(b.parts)) - 1
    both = zip(a._elevated(degree).parts, b._elevated(degree).parts, strict=True)
    return Polynomial([x + y for x, y in both], continuous=a.continuous and b.continuous)


def _negative(own: Polynomial) -> Polynomial:
    return own._each(lambda x: -x)


def _product(one: Any, other: Any) -> Polynomial:
    a, b = made(one), made(other)
    m, n = len(a.parts) - 1, len(b.parts) - 1
    continuous = a.continuous and b.continuous
    if not m or not n:
        return Polynomial([x * y for x in a.parts for y in b.parts], continuous=continuous)
    parts = []
    for k in range(m + n + 1):
        terms = [
            comb(m, i) * comb(n, k - i) * a.parts[i] * b.parts[k - i]
            for i in range(max(0, k - n), min(m, k) + 1)
        ]
        parts.append(sum(terms) / comb(m + n, k))
    return Polynomial(parts, continuous=continuous)


def _quotient(one: Any, other: Any) -> Polynomial:
    if isinstance(other, Polynomial):
        raise NotPolynomialError("divide")
    return _product(one, 1 / np.asarray(other))


def _power(own: Any, exponent: Any) -> Polynomial:
    if not isinstance(exponent, int | np.integer) or exponent < 1:
        raise NotPolynomialError("power")
    found = own
    for _ in range(int(exponent) - 1):
        found = _product(found, own)
    return found


_RULES: dict[np.ufunc, Callable[..., Polynomial]] = {
    np.add: _sum,
    np.subtract: lambda one, other: _sum(one, -other),
    np.negative: _negative,
    np.positive: made,
    np.multiply: _product,
    np.divide: _quotient,
    np.power: _power,
    np.square: lambda own: _product(own, own),
}


def _named(name: str) -> Callable[[Any], Any]:
    function = getattr(np, name)
    return lambda own: function(own)


for _name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "square"):
    # NumPy asks the entries of an array of objects for a method of the function's name
    for _kind in (Symbol, Polynomial):
        setattr(_kind, _name, _named(_name))
