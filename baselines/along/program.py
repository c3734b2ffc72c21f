"""The squared path speed that takes the least time on given knots.

The unknown is `b = w²` over `σ`. With `x = b'/2` and `y = √b b''/2` a row of the law is

    c0 + cv √b + c2 b + ca b'/2 ≤ 0,
    c0/√b + cv + (c2 b + ca b'/2)/√b + c3 b + cb b'/2 + cu b''/2 ≤ 0    (with jerk, divided by w).

Without rows of jerk `b` is continuous and quadratic between knots, with them it is C¹ and cubic.
Rows hold at five points of each interval, on both sides of every knot. The time `∫ dσ/√b` is
convex. All rows are linear but for `cv √b` and `c0/√b`; where these are concave, their tangents are
on the safe side, so an interior point method that leaves out concave curvature converges (a
primal-dual one, Mehrotra 1992, with slacks). Its matrix has a band of three.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baselines.along.law import Law
from baselines.along.path import Path
from trajopt.core.arrays import Array, Bools
from trajopt.core.trajectory import nearest

POINTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
"""Where rows hold, as shares of an interval."""

# Gauss's points for the time of an interval: few while it is minimised, more for the answer.
_FEW, _MANY = (np.polynomial.legendre.leggauss(count) for count in (5, 20))
# `b` where a row is evaluated is at least this share of the largest.
_LEAST = 1e-14
# By how much of the way to the boundary a step goes at most, for slacks and for `b`.
_BOUNDARY, _POSITIVE = 0.995, 0.9
_MAX_STEPS = 100
# A row counts as kept if it exceeds its bound by less than this share.
_KEPT = 1e-8
# What the dual residual may be, relative to the time.
_DUAL_RTOL = 1e-6
# The highest speed, relative to a uniform one that keeps all limits: where the path stands, no row
# limits any. And the lowest that a row is taken to ask for.
_FREE, _SLOW = 1e3, 1e-12


class End(NamedTuple):
    """The squared speed at an end, and its derivative; None where it is free."""

    b: float | None = None
    slope: float | None = None


class _Point(NamedTuple):
    """A point of the method: rows' gradients and excess, dual residual, and the factor there."""

    rows: Array
    over: Array
    dual: Array
    slack: Array
    multiplier: Array
    factor: Array


class SpeedProgram:
    """Minimise `∫ dσ/√b` on knots."""

    def __init__(
        self, path: Path, law: Law, knots: Array, ends: Sequence[End], unit: float
    ) -> None:
        """Set up the rows.

        Args:
            path: the path.
            law: at `points`.
            knots: `(N + 1,)`, in `σ`.
            ends: of the motion.
            unit: about a uniform speed that keeps all limits.
        """
        self.knots = knots
        self.lengths = np.diff(knots)
        self.count = len(self.lengths)
        self.cubic = law.jerk.shape[2] > 0
        self.local = 4 if self.cubic else 3
        self.unknowns = 2 * self.count + (2 if self.cubic else 1)
        self.joins = _joins(path, knots)
        self.fixed = self._fixed(ends)
        self.free = np.ones(self.unknowns)
        self.free[list(self.fixed)] = 0.0
        self.scale = 0.0
        self.basis = self._basis(POINTS)
        self._times = [
            (self._basis((own + 1) / 2)[0], self.lengths[:, None] * weight / 2)
            for own, weight in (_FEW, _MANY)
        ]
        self._rows(law, unit)

    def _fixed(self, ends: Sequence[End]) -> dict[int, float]:
        """Return the unknowns whose values are given."""
        last = self.unknowns - (2 if self.cubic else 1)
        found = {}
        for place, end in zip((0, last), ends, strict=True):
            if end.b is not None:
                found[place] = end.b
            if end.slope is not None and self.cubic:
                found[place + 1] = end.slope
        return found

    def _basis(self, shares: Array) -> Array:
        return _basis(self.lengths, self.joins, shares[None], cubic=self.cubic)

    # --- rows ---

    def _rows(self, law: Law, unit: float) -> None:
        """Arrange all rows: their linear part `const + Σ_k gradient[k] X[k]`, and the rest.

        Rows of `w` alone are one row a point, `b ≤ top²`. The order is: these, linear ones, those
        with `cv √b`, those with jerk.
        """
        points = len(POINTS)
        slow = law.slow
        alone = ~slow[3:].any(axis=(0, 1))
        damped = slow[1].any(axis=0) & ~alone
        linear = ~alone & ~damped
        top = np.clip(_top(slow[..., alone]), _SLOW * unit, _FREE * unit)
        pure = np.zeros((7, slow.shape[1], 1))
        pure[0], pure[2] = -1.0, 1 / top[:, None] ** 2
        jerky = np.ones(law.jerk.shape[2], dtype=bool)
        groups = [(pure, np.ones(1, dtype=bool)), (slow, linear), (slow, damped), (law.jerk, jerky)]
        sizes = [points * int(columns.sum()) for _, columns in groups]
        ends = np.cumsum([0, *sizes]).tolist()
        places = [slice(*own) for own in pairwise(ends)]
        self.damped, self.jerk = places[2:]
        self.rows_in_all = ends[-1] * self.count
        shape = self.count, ends[-1]
        self.multiplier = np.zeros(shape)
        self.constant, self._rates = np.empty(shape), np.zeros(shape)
        self.gradient = np.empty((self.local, *shape))
        values, slopes, bends = self.basis[..., None]  # (local, N, points, 1) each

        def terms(table: Array, columns: Bools, *chosen: int) -> Iterator[Array]:
            """Yield some of the seven terms of some rows, `(N, points, rows)`."""
            for term in chosen:
                yield table[term][:, columns].reshape(self.count, points, -1)

        def flat(table: Array) -> Array:
            return table.reshape(*table.shape[:-3], self.count, -1)

        # one unknown after the other: of all together the tables would be as large as the program
        for place, group in zip(places[:3], groups[:3], strict=True):
            c0, c2, ca = terms(*group, 0, 2, 3)
            self.constant[:, place], self._rates[:, place] = flat(c0), flat(ca)
            for own, value, slope in zip(self.gradient, values, slopes, strict=True):
                own[:, place] = flat(c2 * value + ca / 2 * slope)
        cv, c3, cb, cu = terms(*groups[3], 1, 4, 5, 6)
        self.constant[:, self.jerk] = flat(cv)
        for own, value, slope, bend in zip(self.gradient, values, slopes, bends, strict=True):
            own[:, self.jerk] = flat(c3 * value + cb / 2 * slope + cu / 2 * bend)
        (cv,) = terms(*groups[2], 1)
        self.speed_term = flat(cv)
        c0, c2, ca = terms(*groups[3], 0, 2, 3)
        self.low_constant = flat(c0)
        self.low_gradient = None
        if c2.any() or ca.any():
            self.low_gradient = flat(c2 * values + ca / 2 * slopes)
        self.damped_value, self.jerk_value = (
            flat(np.broadcast_to(values, (*values.shape[:-1], int(columns.sum()))))
            for _, columns in groups[2:]
        )

    def _local(self, x: Array) -> Array:
        """Return the unknowns of each interval, `(local, N)`."""
        return np.stack([x[k : k + 2 * self.count - 1 : 2] for k in range(self.local)])

    def values(self, x: Array) -> tuple[Array, Array, Array | None]:
        """Return the rows' values `(N, rows)`, gradients `(local, N, rows)`, convex curvature.

        The curvature is by `b`, of the rows with jerk, or None.
        """
        local = self._local(x)
        value = self.constant + _combined(self.gradient, local)
        gradient = self.gradient
        curvature = None
        if self.speed_term.size or self.low_constant.size:
            gradient = gradient.copy()
        if self.speed_term.size:
            root = np.sqrt(self._positive(_combined(self.damped_value, local)))
            value[:, self.damped] += self.speed_term * root
            gradient[:, :, self.damped] += self.speed_term / (2 * root) * self.damped_value
        if self.low_constant.size:
            b = self._positive(_combined(self.jerk_value, local))
            root = np.sqrt(b)
            low = self.low_constant
            if self.low_gradient is not None:
                low = low + _combined(self.low_gradient, local)
                gradient[:, :, self.jerk] += self.low_gradient / root
            value[:, self.jerk] += low / root
            gradient[:, :, self.jerk] -= low / (2 * b * root) * self.jerk_value
            curvature = np.maximum(0.75 * low / (b * b * root), 0.0)
        return value, gradient, curvature

    def _positive(self, b: Array) -> Array:
        return np.maximum(b, _LEAST * self.scale)

    # --- times ---

    def times(self, x: Array) -> Array:
        """Return the time of each interval, `(N,)`."""
        basis, weights = self._times[1]
        return np.asarray((weights / np.sqrt(_combined(basis, self._local(x)))).sum(axis=1))

    def _time(self, x: Array) -> tuple[float, Array, Array]:
        """Return the time, its gradient by the unknowns, and each interval's Hessian."""
        basis, weights = self._times[0]
        b = _combined(basis, self._local(x))
        first = -0.5 * weights * b**-1.5
        second = 0.75 * weights * b**-2.5
        gradient = self._scattered((first * basis).sum(axis=2))
        hessian = np.einsum("np,knp,lnp->kln", second, basis, basis, optimize=True)
        return float((weights / np.sqrt(b)).sum()), gradient, hessian

    def _scattered(self, local: Array) -> Array:
        """Add up what each interval has for its unknowns, `(local, N)`."""
        found = np.zeros(self.unknowns)
        for k in range(self.local):
            found[k : k + 2 * self.count - 1 : 2] += local[k]
        return found

    # --- the method ---

    def uniform(self, speed: float) -> Array:
        """Return the unknowns of a uniform speed of the parameter."""
        x = np.zeros(self.unknowns)
        x[:: 2 if self.cubic else 1] = speed**2
        return x

    def positive(self, x: Array) -> Array:
        """Return the values of `b` that must be positive."""
        local = self._local(x)
        at = _combined(self.basis[0], local).ravel()
        first = 1 if 0 in self.fixed else 0
        last = len(at) - (1 if any(k >= self.unknowns - 2 for k in self.fixed if k > 1) else 0)
        return np.concatenate([_combined(self._times[0][0], local).ravel(), at[first:last]])

    def solve(self, start: Array, rtol: float, barrier: float | None = None) -> Array:
        """Return the unknowns of least time, from a start with positive `b`.

        Args:
            start: the unknowns, whose rows may exceed their bounds.
            rtol: the largest gap between primal and dual, relative to the time.
            barrier: the products of slacks and multipliers at the start.
        """
        x = np.array(start)
        for place, given in self.fixed.items():
            x[place] = given
        self.scale = float(x.max())
        value = self.values(x)[0]
        slack = np.maximum(-value, 1e-3 * np.maximum(np.abs(value), 1e-3))
        size = slack.size
        multiplier = (self._time(x)[0] / size if barrier is None else barrier) / slack
        for self.steps in range(1, _MAX_STEPS + 1):
            total, gradient, hessian = self._time(x)
            value, rows, curvature = self.values(x)
            over = value + slack
            dual = (gradient + self._scattered(_weighed(rows, multiplier))) * self.free
            gap = float((slack * multiplier).sum())
            if (
                gap < rtol * total
                and np.abs(over).max() < _KEPT
                and np.abs(dual * x).max() < _DUAL_RTOL * total
            ):
                break
            factor = self._factor(hessian, rows, multiplier / slack, curvature, multiplier)
            point = _Point(rows, over, dual, slack, multiplier, factor)
            dx, ds, dm = self._step(point, 0.0)
            reach = _reach(slack, ds, _BOUNDARY), _reach(multiplier, dm, _BOUNDARY)
            affine = float(((slack + reach[0] * ds) * (multiplier + reach[1] * dm)).sum())
            centred = max((affine / gap) ** 3, 1e-4) * gap
            target = max(centred, 0.1 * rtol * total) / size - ds * dm
            dx, ds, dm = self._step(point, target)
            near = max(_POSITIVE, 1 - gap / total)
            forward = min(
                _reach(slack, ds, near), _reach(self.positive(x), self.positive(dx), _POSITIVE)
            )
            back = _reach(multiplier, dm, near)
            x += forward * dx
            slack += forward * ds
            multiplier += back * dm
        self.multiplier = multiplier
        return x

    def _step(self, at: _Point, target: Array | float) -> tuple[Array, Array, Array]:
        """Return the step to products `target`: of unknowns, slacks and multipliers."""
        from scipy.linalg import cho_solve_banded  # late: planners that are only listed need it not

        wanted = (target + at.multiplier * at.over) / at.slack - at.multiplier
        right = self.free * (-at.dual - self._scattered(_weighed(at.rows, wanted)))
        dx = self.free * cho_solve_banded((at.factor, True), right, check_finite=False)
        change = _combined(at.rows, self._local(dx))
        return dx, -at.over - change, wanted + at.multiplier * change / at.slack

    def _factor(
        self,
        hessian: Array,
        rows: Array,
        weights: Array,
        curvature: Array | None,
        multiplier: Array,
    ) -> Array:
        """Return the Cholesky factor of the reduced matrix, as a band."""
        from scipy.linalg import cholesky_banded

        band = np.zeros((self.local, self.unknowns))
        convex = None
        if curvature is not None and curvature.any():
            convex = curvature * multiplier[:, self.jerk]
        stop = 2 * self.count - 1
        for k in range(self.local):
            weighed = rows[k] * weights
            for other in range(k, self.local):
                entry = hessian[k, other] + np.einsum("nr,nr->n", weighed, rows[other])
                if convex is not None:
                    entry = entry + np.einsum(
                        "nr,nr,nr->n", convex, self.jerk_value[k], self.jerk_value[other]
                    )
                band[other - k, k : k + stop : 2] += entry
        for place in self.fixed:
            band[:, place] = 0.0
            band[0, place] = 1.0
            for k in range(1, min(self.local, place + 1)):
                band[k, place - k] = 0.0
        band[0] *= 1 + 1e-13
        return cholesky_banded(band, lower=True, check_finite=False)

    # --- the answer ---

    @property
    def costate(self) -> Array:
        """The multiplier of `b' = 2 x` in each interval, `(N,)`, of rows without jerk."""
        return np.asarray(-(self.multiplier * self._rates).sum(axis=1) / (2 * self.lengths))

    def at(self, x: Array, sigma: Array, order: int = 0) -> Array:
        """Return `b` or a derivative by `σ` at some `σ`; at a knot in the interval after it."""
        interval = np.searchsorted(self.knots[1:-1], sigma, side="right")
        lengths = self.lengths[interval]
        share = (sigma - self.knots[interval]) / lengths
        basis = _basis(lengths, self.joins[interval], share[:, None], cubic=self.cubic)
        return _combined(basis[order], self._local(x)[:, interval])[:, 0]

    def ends(self, x: Array) -> Array:
        """Return `b` and `b'` at the start and the end of each interval, `(2 orders, 2, N)`."""
        basis = self.basis[:2][..., [0, -1]]
        found = np.einsum("oknp,kn->opn", basis, self._local(x))
        return np.stack([np.maximum(found[0], 0.0), found[1]])


def _basis(lengths: Array, joins: Array, shares: Array, *, cubic: bool) -> Array:
    """Return `b`, `b'`, `b''` by the local unknowns of intervals, `(3, local, N, shares)`.

    The local unknowns are the values at both ends and, in between, in the middle; with jerk value
    and slope at both ends. Where the parameter bends at the interval's end, the slope before it is
    not the one after it: `b'₋ = b'₊ − 2 bend b`.
    """
    h = lengths[:, None]
    t = np.broadcast_to(shares, (len(lengths), shares.shape[-1]))
    one = np.ones_like(t)
    if not cubic:
        rows = [
            [(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)],
            [4 * t - 3, 4 - 8 * t, 4 * t - 1],
            [4 * one, -8 * one, 4 * one],
        ]
        return np.stack([np.stack(row) / h**order for order, row in enumerate(rows)])
    square, cube = t**2, t**3
    rows = [
        [
            1 - 3 * square + 2 * cube,
            h * (t - 2 * square + cube),
            3 * square - 2 * cube,
            h * (cube - square),
        ],
        [
            6 * (square - t),
            h * (1 - 4 * t + 3 * square),
            6 * (t - square),
            h * (3 * square - 2 * t),
        ],
        [12 * t - 6, h * (6 * t - 4), 6 - 12 * t, h * (6 * t - 2)],
    ]
    found = np.stack([np.stack(row) / h**order for order, row in enumerate(rows)])
    found[:, 2] -= 2 * joins[:, None] * found[:, 3]
    return found


def _joins(path: Path, knots: Array) -> Array:
    """Return the bend of the parameter at the end of each interval, 0 where there is none."""
    found = np.zeros(len(knots) - 1)
    if path.bends.any():
        at = path.sigma(path.curve.breaks[1:-1])
        found[nearest(knots[1:], at)] = path.bends
    return found


def _top(rows: Array) -> Array:
    """Return the largest speed that rows of `w` alone allow at each point; infinite without any."""
    c0, cv, c2 = rows[:3]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(cv * cv - 4 * c2 * c0, 0.0))
        square = (-cv + root) / (2 * c2)
        line = np.where(cv > 0, -c0 / cv, np.inf)
        tops = np.where(c2 > 0, square, np.where(c2 == 0, line, np.inf))
    return np.asarray(np.min(tops, axis=1, initial=np.inf))


def _combined(parts: Array, local: Array) -> Array:
    """Return `Σ_k parts[k] local[k]`, of `(local, N, …)` and `(local, N)`."""
    found = parts[0] * local[0][:, None]
    for part, own in zip(parts[1:], local[1:], strict=True):
        found += part * own[:, None]
    return found


def _weighed(rows: Array, weights: Array) -> Array:
    """Return each interval's sum of its rows' gradients, `(local, N)`."""
    return np.stack([np.einsum("nr,nr->n", row, weights) for row in rows])


def _reach(values: Array, changes: Array, share: float) -> float:
    """Return the step, at most 1, that goes this share of the way to a value of 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ways = np.where(changes < 0, -values / changes, np.inf)
    return min(1.0, share * float(ways.min(initial=np.inf)))
