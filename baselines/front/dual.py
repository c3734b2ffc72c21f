"""Lower bounds of ∫ jerk² or ∫ acceleration² on a simplex of segment times (section 12).

Let `u` be the derivative whose square is integrated. A position, velocity or acceleration at an
instant `t` is `∫ u(s) (t − s)₊^p/p! ds`. Equations and inequalities prescribe or bound such values.
For any multipliers `y` of them

    ∫ u² ≥ 2 y·c − y'G(T) y.

Here `c` is the prescribed value of an equation, or the limit of an inequality on the side of `y`'s
sign. The best multiple of `y = z` gives `(z·c)²/z'G z` where `z·c ≥ 0`. Instants are fixed shares
of the segments, so `G` is a polynomial of the segment times `T`. If `z` is a polynomial of `T` too,
so is `(z·c)² − b z'G z`. Where its Bernstein coefficients on a simplex are not negative, `b` is a
lower bound on that simplex.

Time is in units of the duration: the segment times of a motion add up to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import comb, factorial
from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices

# Degree of the costates that are computed from the equations alone.
FREE_DEGREE = 3
# Rounding of a sum of products, relative to the sum of the sizes of all terms.
_ROUNDING_RTOL = 1024 * float(np.finfo(float).eps)
# Largest number of iterations of an active-set loop.
_ITERATIONS = 60
# Weight of the simplex's centre in the points of interpolation: at a segment time of 0 costates
# would be infinite.
_CENTRE_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class SmoothnessConstraints:
    """The rows of a problem: first its equations, then its inequalities.

    A row is the value of a derivative at an instant, or the change of a derivative from one instant
    of a segment to another. Its mean rate is limited, so a multiple of the segment time limits such
    a change.

    Attributes:
        order: 3 for jerk, 2 for acceleration.
        segments: Number of segments `K`.
        power: `p` of each row, `(rows,)`.
        segment: The segment of its instant, `(rows,)`.
        share: The instant's share of that segment, `(rows,)`.
        since: The share of the instant that a change is counted from, else `share`, `(rows,)`.
        low, high: Of each row and joint, `(rows, joints)`; equal for an equation. Of a change:
            limits of the mean rate.
    """

    order: int
    segments: int
    power: Indices
    segment: Indices
    share: Array
    since: Array
    low: Array
    high: Array

    @property
    def equations(self) -> int:
        """Return the number of equations: of the waypoints, and of rest at the end."""
        return self.segments + self.order - 1

    @property
    def width(self) -> Array:
        """Share of the segment over which a row counts a change, 0 for an instant, `(rows,)`."""
        return self.share - self.since

    def only(self, keep: Indices) -> SmoothnessConstraints:
        """Return the problem with some of its rows."""
        return SmoothnessConstraints(
            self.order,
            self.segments,
            self.power[keep],
            self.segment[keep],
            self.share[keep],
            self.since[keep],
            self.low[keep],
            self.high[keep],
        )

    def lengths(self, times: Array) -> Array:
        """Return what the limits are multiplied by at segment times `(…, K)`: `(…, rows)`."""
        width = self.width
        return np.where(width > 0, width * times[..., self.segment], 1.0)

    def gram(self, times: Array) -> Array:
        """Return `G` at segment times `(…, K)`: `(…, rows, rows)`."""
        changes = np.flatnonzero(self.width > 0)
        power = np.append(self.power, self.power[changes])
        segment = np.append(self.segment, self.segment[changes])
        found = _gram(self.order, power, segment, np.append(self.share, self.since[changes]), times)
        count = len(self.power)
        found[..., changes, :] -= found[..., count:, :]
        found[..., :, changes] -= found[..., :, count:]
        own: Array = found[..., :count, :count]
        return own

    def squares(self, costates: Array, times: Array) -> tuple[Array, Array]:
        """Return `y'G y` of costates `(…, rows, joints)` at segment times, and its error.

        It is `∫ λ²`, summed from the end to the start: between instants `λ` is a polynomial, at an
        instant a derivative of it changes by a costate.
        """
        place, before = self.segment + self.share, self.segment + self.since
        instants = np.unique(np.concatenate([place, before, np.arange(self.segments + 1.0)]))
        at, back = (np.searchsorted(instants, own) for own in (place, before))
        y = np.moveaxis(costates, -2, 0)
        changes = np.zeros((self.order, len(instants), *y.shape[1:]))
        sizes = np.zeros_like(changes)
        for row, power in enumerate(self.power):
            changes[power, at[row]] += y[row]
            sizes[power, at[row]] += np.abs(y[row])
            if self.width[row] > 0:
                changes[power, back[row]] -= y[row]
                sizes[power, back[row]] += np.abs(y[row])
        steps = np.diff(instants)
        segment = np.ceil(instants[1:]).astype(int) - 1
        lengths = np.moveaxis(steps * times[..., segment], -1, 0)[..., None]
        nodes, weights = np.polynomial.legendre.leggauss(self.order)
        value, largest = np.zeros(y.shape[1:]), np.zeros(y.shape[1:])
        own, size = changes[:, -1].copy(), sizes[:, -1].copy()
        for i in range(len(steps) - 1, -1, -1):
            length = lengths[i]
            _shift(size, length)
            for node, weight in zip(nodes, weights, strict=True):
                costate = _taylor(own, 0.5 * (1 + node) * length)
                error = _ROUNDING_RTOL * size[0]
                value += 0.5 * weight * length * costate**2
                largest += 0.5 * weight * length * error * (2 * np.abs(costate) + error)
            _shift(own, length)
            own += changes[:, i]
            size += sizes[:, i]
        return value.sum(-1), largest.sum(-1) + _ROUNDING_RTOL * value.sum(-1)

    def gain(self, costates: Array, times: Array | None = None) -> Array:
        """Return `y·c`: of costates `(…, rows, joints)`, the least that the rows allow."""
        gain = np.where(costates > 0, costates * self.low, costates * self.high).sum(-1)
        found: Array = (gain if times is None else gain * self.lengths(times)).sum(-1)
        return found

    def gain_size(self, costates: Array, times: Array) -> Array:
        """Return the sum of the sizes of the terms of `gain`."""
        size = np.maximum(np.abs(self.low), np.abs(self.high))
        return ((np.abs(costates) * size).sum(-1) * self.lengths(times)).sum(-1)


def _taylor(derivatives: Array, step: Array) -> Array:
    """Return a polynomial of one, two or three derivatives, a step further."""
    found = derivatives[-1]
    for order in range(len(derivatives) - 1, 0, -1):
        found = derivatives[order - 1] + step / order * found
    return found


def _shift(derivatives: Array, step: Array) -> None:
    """Move all derivatives of a polynomial a step further."""
    for order in range(len(derivatives)):
        derivatives[order] = _taylor(derivatives[order:], step)


def _gram(order: int, power: Indices, segment: Indices, share: Array, times: Array) -> Array:
    """Products of the kernels of instants: `∫ u^q/q! (u + d)^p/p! du` from 0 to the earlier one.

    `d` is their distance.
    """
    before = np.concatenate([np.zeros((*times.shape[:-1], 1)), np.cumsum(times, -1)], -1)
    instants = before[..., segment] + share * times[..., segment]
    place = segment + share
    early = place[:, None] <= place[None, :]
    count = len(power)
    found = np.zeros((*times.shape[:-1], count, count))
    for p, q in product(range(order), repeat=2):
        own = (power == p)[:, None] & (power == q)[None, :]
        i, j = np.nonzero(own & early)
        start, distance = instants[..., i], instants[..., j] - instants[..., i]
        value = np.zeros(distance.shape)
        for r in range(q + 1):
            value = value + comb(q, r) * distance ** (q - r) * start ** (p + r + 1) / (p + r + 1)
        value = value / (factorial(p) * factorial(q))
        found[..., i, j] = value
        found[..., j, i] = value
    return found


class Lattice(NamedTuple):
    """Points of a simplex that determine a polynomial of a degree.

    Attributes:
        points: Barycentric coordinates, `(points, corners)`.
        to_bernstein: Matrix from the values there to Bernstein coefficients, `(points, points)`.
        error: Rounding error of a coefficient, relative to the largest size of a value.
    """

    points: Array
    to_bernstein: Array
    error: float


def exponents(corners: int, degree: int) -> Indices:
    """Return the exponents of all monomials of a degree, `(monomials, corners)`."""
    found = [e for e in product(range(degree + 1), repeat=corners) if sum(e) == degree]
    return np.array(found)


@lru_cache
def lattice(corners: int, degree: int) -> Lattice:
    """Return the points whose coordinates are multiples of 1/degree."""
    powers = exponents(corners, degree)
    points = powers / degree
    multinomials = [factorial(degree) / np.prod([factorial(i) for i in e]) for e in powers.tolist()]
    values = np.array(multinomials) * np.prod(points[:, None, :] ** powers[None], -1)
    inverse = np.linalg.inv(values)
    inverse = inverse @ (2 * np.eye(len(values)) - values @ inverse)  # a Newton step
    residual = np.abs(inverse @ values - np.eye(len(values))).sum(axis=1).max()
    error = float(residual + np.finfo(float).eps * len(values) * np.abs(inverse).sum(axis=1).max())
    return Lattice(points, inverse, error)


@lru_cache
def _interpolation(corners: int, degree: int, whole: int) -> tuple[Array, Array]:
    """Points of costates of a degree, and their weights at the lattice of the whole polynomial."""
    powers = exponents(corners, degree)
    nodes = powers / degree if degree else np.full((1, corners), 1 / corners)
    points = lattice(corners, whole).points

    def monomials(at: Array) -> Array:
        return np.prod(at[:, None, :] ** powers[None], -1)

    return nodes, monomials(points) @ np.linalg.inv(monomials(nodes))


def free_bounds(rows: SmoothnessConstraints, corners: Array) -> Array:
    """Return lower bounds of simplices `(B, K, K)` from the equations alone, `(B,)`.

    Their costates go through the best ones at points of the simplex, or are constant where they do
    not: a time may be 0.
    """
    own = rows.only(np.arange(rows.equations))
    return np.maximum(_curved_bounds(own, corners, 0), _curved_bounds(own, corners, FREE_DEGREE))


def _curved_bounds(own: SmoothnessConstraints, corners: Array, degree: int) -> Array:
    """Return lower bounds from costates of a degree in the segment times."""
    nodes, weights = _interpolation(own.segments, degree, _degree(own.order, degree))
    times = nodes @ corners
    centre = corners.mean(axis=1, keepdims=True)
    times = np.maximum(times, _CENTRE_SHARE * centre)
    best = scaled_costates(own, _equation_costates(own, times), times)
    costates = np.einsum("pm,bmrn->bprn", weights, best)
    return _smallest_ratio(own, corners, costates, own.gain(costates), degree)


def _degree(order: int, costates: int) -> int:
    """Return the degree of `z'G z` in the times, where the costates `z` have this degree."""
    return 2 * costates + 2 * order - 1


def scaled_costates(rows: SmoothnessConstraints, costates: Array, times: Array) -> Array:
    """Return the multiple of costates that gains 1: neighbours can then be interpolated."""
    gain = rows.gain(costates, times)
    scaled: Array = costates / np.where(gain > 0, gain, np.inf)[..., None, None]
    return scaled


def _equation_costates(own: SmoothnessConstraints, times: Array) -> Array:
    """Return the best costates of the equations at times `(…, K)`: `(…, rows, joints)`."""
    gram = own.gram(times)
    scale = 1 / np.sqrt(np.einsum("...ii->...i", gram))
    scaled = gram * scale[..., :, None] * scale[..., None, :] + 1e-12 * np.eye(len(own.power))
    return scale[..., None] * np.linalg.solve(scaled, scale[..., None] * own.low)


def linear_bounds(rows: SmoothnessConstraints, corners: Array, costates: Array) -> Array:
    """Return lower bounds of simplices from costates at their corners, linear in between.

    Args:
        rows: All equations and inequalities.
        corners: `(simplices, K, K)`.
        costates: `(simplices, K, rows, joints)`. The gain `y·c` is concave in them, so between
            corners it is at least its linear interpolation.
    """
    some = np.flatnonzero((costates != 0).any(axis=(0, 1, 3)))
    rows, costates = rows.only(some), costates[:, :, some]
    points = lattice(rows.segments, _degree(rows.order, 1)).points
    between = np.einsum("mc,bcrn->bmrn", points, costates)
    own = np.where(costates > 0, costates * rows.low, costates * rows.high).sum(-1)
    lengths = rows.lengths(points @ corners)
    gains = np.einsum("mc,bcr,bmr->bm", points, own, lengths)
    return _smallest_ratio(rows, corners, between, gains, 1)


def _smallest_ratio(
    rows: SmoothnessConstraints, corners: Array, costates: Array, gains: Array, degree: int
) -> Array:
    """The largest `t` with `(z·c)² − t z'G z` nowhere negative by its Bernstein coefficients.

    Less what rounding may do; minus infinity where `z·c` may be negative.
    """
    own = lattice(rows.segments, _degree(rows.order, degree))
    times = own.points @ corners
    squares, error = rows.squares(costates, times)
    gain_size = _ROUNDING_RTOL * rows.gain_size(costates, times)
    upper = _coefficients(squares, error, own, 1.0)
    lower = _coefficients(gains**2, 2 * gain_size * np.abs(gains), own, -1.0)
    positive = _coefficients(gains, gain_size, own, -1.0).min(axis=1) > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(upper > 0, lower / upper, np.inf).min(axis=1)
    return np.where(positive & (lower.min(axis=1) >= 0), ratio, -np.inf)


def _coefficients(values: Array, error: Array, own: Lattice, side: float) -> Array:
    """Return Bernstein coefficients of values at the points, with their error added on a side."""
    rounding = own.error * np.abs(values).max(axis=1, keepdims=True)
    rounding = rounding + error @ np.abs(own.to_bernstein).T
    shifted: Array = values @ own.to_bernstein.T + side * rounding
    return shifted


def best_costates(
    rows: SmoothnessConstraints,
    times: Array,
    *,
    used: Bools | None = None,
    like: Array | None = None,
) -> tuple[Array, Array]:
    """Return the best costates at segment times, `(B, rows, joints)`, and their values, `(B,)`.

    An active-set loop. Any costates prove a bound, so it may stop at any time.

    Args:
        rows: The equations and inequalities.
        times: `(B, K)`.
        used: The limits of each joint that may be active, `(rows, joints)`; all by default.
        like: Costates `(B, rows, joints)` to start from; only their own limits may be active.
    """
    allowed: Bools = np.ones(rows.low.shape, dtype=bool) if used is None else used.copy()
    if like is not None:
        allowed &= (like != 0).any(axis=0)
    allowed[: rows.equations] = True
    some = np.flatnonzero(allowed.any(axis=1))
    few = rows.only(some)
    gram = few.gram(times)
    lengths = few.lengths(times)
    costates = np.zeros((len(times), *rows.low.shape))
    values = np.zeros(len(times))
    for joint in range(rows.low.shape[1]):
        keep = np.flatnonzero(allowed[some, joint])
        low, high = (side[keep, joint] * lengths[:, keep] for side in (few.low, few.high))
        start = None if like is None else like[:, some[keep], joint]
        found, value = _active_set(gram[:, keep][:, :, keep], low, high, rows.equations, start)
        costates[:, some[keep], joint] = found
        values += value
    return costates, values


def _active_set(
    gram: Array, low: Array, high: Array, equations: int, like: Array | None
) -> tuple[Array, Array]:
    """Return the best costates of one joint, `(B, rows)`, and their values, `(B,)`."""
    count = gram.shape[-1]
    scale = 1 / np.sqrt(np.maximum(np.einsum("bii->bi", gram), 1e-300))
    scaled = gram * scale[:, :, None] * scale[:, None, :]
    low, high = low * scale, high * scale
    is_limit = np.arange(count) >= equations
    allowed: Bools = np.repeat(is_limit[None], len(low), axis=0)
    active = ~allowed
    side = np.zeros(low.shape)
    goal = np.where(is_limit, 0.0, low)
    if like is not None:
        side = np.sign(like) * is_limit
        allowed = side != 0
        active = active | allowed
        goal = np.where(side > 0, low, np.where(side < 0, high, goal))
    best = np.zeros(low.shape)
    best_value = np.full(len(low), -np.inf)
    size = np.minimum(np.abs(low), np.abs(high)) + 1e-12
    left = np.arange(len(low))  # the rows whose active set still changes
    for _ in range(_ITERATIONS):
        now, aim, sides = active[left], goal[left], side[left]
        own = np.flatnonzero(now.any(axis=0))
        some = now[:, own]
        both = some[:, :, None] & some[:, None, :]
        diagonal = np.where(some, 1e-11, 1.0)[:, :, None] * np.eye(len(own))
        matrix = np.where(both, scaled[left[:, None, None], own[:, None], own], 0) + diagonal
        y = np.linalg.solve(matrix, np.where(some, aim[:, own], 0)[..., None])[..., 0]
        wrong = some & is_limit[own] & (y * sides[:, own] < 0)
        valid = np.where(wrong, 0, y)
        of_rows = scaled[left[:, None], own]
        reached = np.einsum("bij,bi->bj", of_rows, y)
        any_wrong = np.asarray(wrong.any(axis=1))
        taken = reached
        if any_wrong.any():
            taken = np.einsum("bij,bi->bj", of_rows, valid)
        value = (valid * (2 * aim[:, own] - taken[:, own])).sum(1)
        better = value > best_value[left]
        rows = left[better]
        best[rows] = 0.0
        best[rows[:, None], own] = valid[better]
        best_value[rows] = value[better]
        beyond = np.maximum(reached - high[left], low[left] - reached)
        over = np.where(allowed[left] & ~now, beyond, -1) / size[left]
        now[:, own] &= ~wrong
        sides[:, own] = np.where(wrong, 0, sides[:, own])
        worst = over.max(1)[:, None]
        added = (over > 1e-6) & (over >= 0.5 * worst) & ~any_wrong[:, None]
        below = low[left] - reached > reached - high[left]
        active[left] = now | added
        side[left] = np.where(added, np.where(below, 1.0, -1.0), sides)
        goal[left] = np.where(added, np.where(below, low[left], high[left]), aim)
        left = left[any_wrong | added.any(axis=1)]
        if not len(left):
            break
    return best * scale, best_value
