"""Whether 3-5-3 splines keep their limits, for many segment times at once (mathematics, section 1).

A search asks this far more often than how much of a limit is used. The answer is that of
`spline353.limit_use`, but most splines need no peak: one instant that breaks a limit is enough, and
so are Bernstein coefficients that all keep it. Both are linear in a few products of the times, so
one small matrix has them for all joints. What rounding leaves open is decided by the exact peaks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.problem import Limits
from trajopt.planners import spline353

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

# With every halving Bernstein coefficients come four times nearer to the curve.
_HALVINGS = 2
# Of the largest sum of a coefficient's terms: far more than rounding in it, or in a peak.
_ROUNDING_RTOL = 1e-13
# Which segment's displacement multiplies each product of the times (see `_products`).
_SEGMENTS = (1, 0, 2, 0, 2, 0, 2)


class _Candidates(NamedTuple):
    """Some of the segment times asked for: their `number`, times `(3, n)`, s, and products."""

    number: Indices
    times: Array
    products: Array

    @property
    def T(self) -> Array:
        middle: Array = self.times[1]
        return middle

    def only(self, chosen: Mask) -> _Candidates:
        (places,) = chosen.nonzero()
        if len(places) == len(self.number):
            return self
        return _Candidates(
            self.number[places],
            self.times[:, places],
            self.products[:, places],
        )


@dataclass(frozen=True, eq=False)
class LimitCheck:
    """Whether all joints keep all limits at given segment times: no `limit_use` is above 1.

        check = LimitCheck.of(displacements, limits)
        keeps = check(times)

    Attributes:
        displacements: Of the three segments, `(3, joints)`, rad.
        rates: What is limited, the costliest to decide last: few candidates come so far.
    """

    displacements: Array
    rates: tuple[_Rate, ...]

    @classmethod
    def of(cls, displacements: Array, limits: Limits) -> LimitCheck:
        """Of joints with displacements `(joints, 3)`, rad, and these limits."""
        rates = [_Rate.of(2, displacements, limits.acceleration)]
        if np.isfinite(limits.jerk).any():
            rates.append(_Rate.of(3, displacements, limits.jerk))
        rates.append(_Rate.of(1, displacements, limits.velocity))
        return cls(displacements.T.copy(), tuple(rates))

    def __call__(self, times: Array) -> Mask:
        """For times `(N, 3)`, s: `(N,)`."""
        t = times.T.copy()
        left = _Candidates(np.arange(len(times)), t, _products(t))
        for rate in self.rates:
            left = left.only(~rate.broken_at_instants(left))
        for rate in self.rates:
            if len(left.number) > 0:
                left = left.only(~rate.broken_at_peaks(left, self.displacements))
        keeps = np.zeros(len(times), dtype=bool)
        keeps[left.number] = True
        return keeps


@dataclass(frozen=True, eq=False)
class _Rate:
    """Velocity, acceleration or jerk: tables of what multiplies the products of the times.

    They give utilisations times `T` to the order, of every joint on each side of its limits. The
    first two are widened by rounding, the products being positive: above `T` to the order, an
    instant surely breaks a limit; not above it, coefficients surely keep it.

    Attributes:
        order: 1, 2 or 3.
        limits: `(joints, 2)`.
        instants: Of a few instants, `(sides · rows, products)`.
        coefficients: Of Bernstein, `(sides · rows, products)`.
        powers: Of the quintic's part in powers of `s = t/T`, `(degree + 1, sides, products)`.
        size: The largest sum of a coefficient's terms, `(products,)`.
    """

    order: int
    limits: Array
    instants: Array
    coefficients: Array
    powers: Array
    size: Array

    @classmethod
    def of(cls, order: int, displacements: Array, limits: Array) -> _Rate:
        whole = _coefficients(order)
        parts = [whole]
        for _ in range(_HALVINGS):
            parts = [half for part in parts for half in _halves(part)]
        starts = [part[0] for part in parts]
        inner = [row for part in parts for row in part[1:-1]]
        # the last one's end, and what is constant over each cubic
        others = [parts[-1][-1], *_cubics(order)]
        instants = _utilisation([*starts, *others], displacements, limits)
        coefficients = _utilisation([*starts, *inner, *others], displacements, limits)
        size = np.abs(coefficients).max(axis=(0, 1))
        rounding = _ROUNDING_RTOL * size
        powers = _utilisation(polynomials.from_bernstein(whole), displacements, limits)
        return cls(
            order,
            limits,
            _flat(instants - rounding),
            _flat(coefficients + rounding),
            powers.swapaxes(0, 1).copy(),
            size,
        )

    def broken_at_instants(self, candidates: _Candidates) -> Mask:
        """Whether one instant is enough to know that a limit is broken, `(n,)`."""
        use = self.instants @ candidates.products
        return np.asarray(use.max(axis=0) > candidates.T**self.order)

    def broken_at_peaks(self, candidates: _Candidates, displacements: Array) -> Mask:
        """Whether any joint's exact use is above 1, `(n,)`."""
        broken = np.zeros(len(candidates.T), dtype=bool)
        side, place = self._undecided(candidates)
        if self.order == 2:
            use, rounding = self._peak_acceleration(candidates, side, place)
            broken[place[use > 1 + rounding]] = True
            (close,) = ((use > 1 - rounding) & ~broken[place]).nonzero()
            side = side[close]
            place = place[close]
        if side.size > 0:
            joint = side // 2
            use = self._exact_use(displacements[:, joint], candidates.times[:, place], joint)
            broken[place[use > 1]] = True
        return broken

    def _undecided(self, candidates: _Candidates) -> tuple[Indices, Indices]:
        """Sides, and candidates, where the coefficients do not show that the limit is kept."""
        sides = 2 * len(self.limits)
        rows = len(self.coefficients) // sides
        bound = self.coefficients @ candidates.products
        by_side = bound.reshape(sides, rows, len(candidates.T))
        above = by_side.max(axis=1) > candidates.T**self.order
        side, place = np.nonzero(above)
        return side, place

    def _peak_acceleration(
        self,
        candidates: _Candidates,
        side: Indices,
        place: Indices,
    ) -> tuple[Array, Array]:
        """Peak use on these sides at these candidates, and its rounding, `(n,)` each.

        The quintic's acceleration is a cubic, and turns at the roots of a parabola.
        """
        of_all = self.powers @ candidates.products
        a, b, c, d = of_all[:, side, place]
        turns = polynomials.quadratic_roots(3 * a, 2 * b, c)
        # NaN, no root, becomes 0
        s = np.fmin(np.fmax(turns, 0.0), 1.0)
        one, other = ((a * s + b) * s + c) * s + d
        ends = np.maximum(d, a + b + c + d)
        peak = np.maximum(ends, np.maximum(one, other))
        terms = self.size @ candidates.products
        square = candidates.T**2
        rounding = _ROUNDING_RTOL * terms / square
        return peak / square[place], rounding[place]

    def _exact_use(self, displacements: Array, times: Array, joint: Indices) -> Array:
        """That of joints with displacements and times `(3, n)` where it is above 1, `(n,)`."""
        d1, h, d3 = displacements
        t1, T, t3 = times
        d = (d1, h, d3)
        t = (t1, T, t3)
        limits = self.limits[joint]
        if self.order == 1:
            return spline353.velocity_use(d, t, limits, exact_above=1.0)
        if self.order == 2:
            return spline353.acceleration_use(d, t, limits, exact_above=1.0)
        return spline353.jerk_use(d, t, limits)


def _products(times: Array) -> Array:
    """`1, r1, r3, r1², r3², r1³, r3³` of times `(3, n)`, where `r1 = T/t1` and `r3 = T/t3`."""
    outer = times[[0, 2]]
    ratios = times[1] / outer
    squares = ratios * ratios
    products = np.ones((len(_SEGMENTS), times.shape[1]))
    products[1:3] = ratios
    products[3:5] = squares
    products[5:7] = squares * ratios
    return products


def _coefficients(order: int) -> Array:
    """The quintic's Bernstein coefficients for `T = 1`, `(degree + 1, products)`."""
    one, r1, r3, r1_squared, r3_squared, _, _ = np.eye(len(_SEGMENTS))
    quintic = spline353.Quintic(
        h=one,
        T=1.0,
        v0=3 * r1,
        a0=6 * r1_squared,
        v1=3 * r3,
        a1=-6 * r3_squared,
    )
    rates = (quintic.velocity, quintic.acceleration, quintic.jerk)
    return np.array(rates[order - 1]())


def _cubics(order: int) -> Sequence[Array]:
    """What the ends of the quintic do not have of the cubics, `(products,)` each: their jerk."""
    if order < 3:
        return ()
    r1_cubed, r3_cubed = np.eye(len(_SEGMENTS))[-2:]
    return 6 * r1_cubed, 6 * r3_cubed


def _halves(coefficients: Array) -> tuple[Array, Array]:
    """Bernstein coefficients of both halves, by de Casteljau's algorithm."""
    left = []
    right = []
    while len(coefficients) > 0:
        left.append(coefficients[0])
        right.append(coefficients[-1])
        coefficients = (coefficients[1:] + coefficients[:-1]) / 2
    return np.array(left), np.array(right[::-1])


def _utilisation(rows: Sequence[Array] | Array, displacements: Array, limits: Array) -> Array:
    """Rows over the limit, on both sides of every joint's: `(2 · joints, rows, products)`."""
    table = np.array(rows)
    own = displacements[:, _SEGMENTS]
    values = table * own[:, None, None]
    use = values / limits[:, :, None, None]
    return use.reshape(-1, *table.shape)


def _flat(table: Array) -> Array:
    return table.reshape(-1, len(_SEGMENTS))
