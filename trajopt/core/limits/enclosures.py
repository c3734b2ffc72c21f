"""Bounds of a formula over intervals of time, computed by the formula itself.

An `Enclosure` is a value at the middle of each interval, bounds of it over the interval, and bounds
of its derivative. It takes part in NumPy's arithmetic, so that a limit's `rows` compute them. The
mean value theorem then bounds a formula to second order in the length of the interval.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from trajopt.core.arrays import Array

Range = tuple[Array, Array]  # lowest and highest
# An end of a range that is nearer to 0, relative to the other end, is 0 by its rounding.
_ROUNDING_RTOL = 1e-9


class Enclosure(NDArrayOperatorsMixin):
    """A value over intervals.

    Attributes:
        middle: the value in the middle of each interval.
        values: its lowest and highest value over the interval.
        slopes: the lowest and highest derivative, times half the length of the interval.
    """

    def __init__(self, middle: Array, values: Range, slopes: Range) -> None:
        self.middle, self.slopes = middle, slopes
        change = np.maximum(np.abs(slopes[0]), np.abs(slopes[1]))
        low, high = values
        self.values = (np.maximum(low, middle - change), np.minimum(high, middle + change))

    @classmethod
    def of_polynomial(cls, coefficients: Array) -> Enclosure:
        """Return the enclosure of polynomials over `[−1, 1]`.

        Args:
            coefficients: highest power first, `(degree + 1, …)`.
        """
        *_, slope, middle = np.concatenate([np.zeros_like(coefficients[:1]), coefficients])
        powers = np.arange(len(coefficients) - 1, 1, -1).reshape(-1, *[1] * middle.ndim)
        curved = np.abs(coefficients[:-2])
        bend = (powers * curved).sum(axis=0)
        change = np.abs(slope) + curved.sum(axis=0)
        return cls(middle, (middle - change, middle + change), (slope - bend, slope + bend))

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *given: Any, **keywords: Any) -> Any:
        if any(isinstance(operand, np.ndarray) and operand.dtype == object for operand in given):
            return NotImplemented  # NumPy then asks its elements one by one
        rule = _RULES.get(ufunc)
        if method != "__call__" or keywords or rule is None:
            raise TypeError(f"numpy.{ufunc.__name__} in the rows of a limit: no bounds are known")
        return rule(*given)


def made(value: Any) -> Enclosure:
    if isinstance(value, Enclosure):
        return value
    exact = np.asarray(value, dtype=float)
    zero = np.zeros_like(exact)
    return Enclosure(exact, (exact, exact), (zero, zero))


def _plus(one: Range, other: Range) -> Range:
    return one[0] + other[0], one[1] + other[1]


def _times(one: Range, other: Range) -> Range:
    (a, b), (c, d) = one, other
    with np.errstate(invalid="ignore"):  # 0 times infinity
        ac, ad, bc, bd = a * c, a * d, b * c, b * d
    lowest = np.minimum(np.minimum(ac, ad), np.minimum(bc, bd))
    highest = np.maximum(np.maximum(ac, ad), np.maximum(bc, bd))
    if np.isfinite(lowest).all() and np.isfinite(highest).all():
        return lowest, highest
    return np.where(np.isnan(lowest), -np.inf, lowest), np.where(np.isnan(highest), np.inf, highest)


def _sum(one: Any, other: Any) -> Enclosure:
    a, b = made(one), made(other)
    return Enclosure(a.middle + b.middle, _plus(a.values, b.values), _plus(a.slopes, b.slopes))


def _negative(argument: Enclosure) -> Enclosure:
    (low, high), (falls, rises) = argument.values, argument.slopes
    return Enclosure(-argument.middle, (-high, -low), (-rises, -falls))


def _product(one: Any, other: Any) -> Enclosure:
    if isinstance(one, float | int):
        return _scaled(other, one)
    if isinstance(other, float | int):
        return _scaled(one, other)
    a, b = made(one), made(other)
    slopes = _plus(_times(a.slopes, b.values), _times(a.values, b.slopes))
    return Enclosure(a.middle * b.middle, _times(a.values, b.values), slopes)


def _scaled(argument: Enclosure, factor: float) -> Enclosure:
    if factor < 0:
        return _scaled(_negative(argument), -factor)
    low, high = argument.values
    falls, rises = argument.slopes
    return Enclosure(
        factor * argument.middle, (factor * low, factor * high), (factor * falls, factor * rises)
    )


def _square(argument: Enclosure) -> Enclosure:
    low, high = argument.values
    inside = (low < 0) & (high > 0)
    values = (np.where(inside, 0.0, np.minimum(low**2, high**2)), np.maximum(low**2, high**2))
    return Enclosure(argument.middle**2, values, _times((2 * low, 2 * high), argument.slopes))


def _power(argument: Any, exponent: Any) -> Enclosure:
    if not isinstance(exponent, int | np.integer) or exponent < 1:
        raise TypeError("a power in the rows of a limit that is no whole number from 1")
    found = _square(argument) if exponent > 1 else argument
    for _ in range(int(exponent) - 2):
        found = _product(found, argument)
    return found


def _quotient(one: Any, other: Any) -> Enclosure:
    if not isinstance(other, Enclosure):
        return _product(one, 1 / np.asarray(other, dtype=float))
    low, high = other.values
    inside = (low <= 0) & (high >= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = (np.where(inside, -np.inf, 1 / high), np.where(inside, np.inf, 1 / low))
        inverse = Enclosure(
            1 / other.middle,
            values,
            _times(_negative_range(_times(values, values)), other.slopes),
        )
    return _product(one, inverse)


def _negative_range(argument: Range) -> Range:
    return -argument[1], -argument[0]


def _wave(
    function: Callable[[Array], Array], derivative: Callable[[Enclosure], Range]
) -> Callable[[Enclosure], Enclosure]:
    """Return the rule of sine or cosine, by the range of its derivative."""

    def rule(argument: Enclosure) -> Enclosure:
        middle = function(argument.middle)
        one = np.ones_like(middle)
        return Enclosure(middle, (-one, one), _times(derivative(argument), argument.slopes))

    return rule


def _around(function: Callable[[Array], Array]) -> Callable[[Enclosure], Range]:
    """Return the range of a function whose derivative is between −1 and 1, and so is it."""

    def span(argument: Enclosure) -> Range:
        low, high = argument.values
        middle, reach = (low + high) / 2, (high - low) / 2
        value = function(middle)
        return np.maximum(value - reach, -1.0), np.minimum(value + reach, 1.0)

    return span


def _sign(argument: Enclosure) -> Enclosure:
    """Return the signs within the interval: where the value ends at 0, it has the sign before."""
    low, high = argument.values
    falls = low < -_ROUNDING_RTOL * np.maximum(high, 0.0)
    rises = high > _ROUNDING_RTOL * np.maximum(-low, 0.0)
    signs = np.where(falls, -1.0, rises), np.where(rises, 1.0, -1.0 * falls)
    jumps = np.where(falls & rises, np.inf, 0.0)
    return Enclosure(np.clip(np.sign(argument.middle), *signs), signs, (-jumps, jumps))


def _sqrt(argument: Enclosure) -> Enclosure:
    low, high = (np.maximum(end, 0.0) for end in argument.values)
    with np.errstate(divide="ignore"):
        steep = (1 / (2 * np.sqrt(high)), 1 / (2 * np.sqrt(low)))
    middle = np.sqrt(np.maximum(argument.middle, 0.0))
    return Enclosure(middle, (np.sqrt(low), np.sqrt(high)), _times(steep, argument.slopes))


def _highest(one: Any, other: Any) -> Enclosure:
    a, b = made(one), made(other)
    first, second = a.values[0] >= b.values[1], b.values[0] >= a.values[1]
    slopes = tuple(
        np.where(first, x, np.where(second, y, choose(x, y)))
        for x, y, choose in zip(a.slopes, b.slopes, (np.minimum, np.maximum), strict=True)
    )
    values = tuple(np.maximum(x, y) for x, y in zip(a.values, b.values, strict=True))
    return Enclosure(np.maximum(a.middle, b.middle), values, slopes)  # type: ignore[arg-type]


_COS = _around(np.cos)
_SIN = _around(np.sin)
_RULES: dict[np.ufunc, Callable[..., Enclosure]] = {
    np.add: _sum,
    np.subtract: lambda one, other: _sum(one, _negative(made(other))),
    np.negative: _negative,
    np.multiply: _product,
    np.divide: _quotient,
    np.square: _square,
    np.power: _power,
    np.sqrt: _sqrt,
    np.sign: _sign,
    np.sin: _wave(np.sin, _COS),
    np.cos: _wave(np.cos, lambda argument: _negative_range(_SIN(argument))),
    np.maximum: _highest,
    np.minimum: lambda one, other: _negative(
        _highest(_negative(made(one)), _negative(made(other)))
    ),
    np.absolute: lambda argument: _highest(argument, _negative(argument)),
}


def _named(name: str) -> Callable[[Any], Any]:
    function = getattr(np, name)
    return lambda argument: function(argument)


for _name in ("sin", "cos", "sqrt", "sign", "square"):
    # NumPy asks the entries of an array of objects for a method of the function's name
    setattr(Enclosure, _name, _named(_name))
