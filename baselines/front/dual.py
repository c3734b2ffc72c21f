"""Lower bounds of ∫ jerk² or ∫ acceleration² on a simplex of segment times (section 12).

Let `u` be the derivative whose square is integrated. A position, velocity or acceleration at an
instant `t` is `∫ u(s) (t − s)₊^p/p! ds`. Equations and inequalities prescribe or bound such values.
For any multipliers `y` of them

    ∫ u² ≥ 2 y·c − y'G(T) y.

Here `c` is the prescribed value of an equation, or the limit of an inequality on the side of `y`'s
sign. Instants are fixed shares of the segments, so `G` is a polynomial of the segment times `T`. If
`y` is a polynomial of `T` too, so is the right side. On a simplex it is at least its smallest
Bernstein coefficient.

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
_ROUNDING_RTOL = 4096 * float(np.finfo(float).eps)
# Weight of the simplex's centre in the points of interpolation: at a segment time of 0 costates
# would be infinite.
_CENTRE_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class SmoothnessConstraints:
    """The rows of a problem: first its equations, then its inequalities.

    Attributes:
        order: 3 for jerk, 2 for acceleration.
        segments: Number of segments `K`.
        power: `p` of each row, `(rows,)`.
        segment: The segment of its instant, `(rows,)`.
        share: The instant's share of that segment, `(rows,)`.
        low, high: Of each row and joint, `(rows, joints)`; equal for an equation.
    """

    order: int
    segments: int
    power: Indices
    segment: Indices
    share: Array
    low: Array
    high: Array

    @property
    def equations(self) -> int:
        """Return the number of equations: of the waypoints, and of rest at the end."""
        return self.segments + self.order - 1

    def only(self, keep: Indices) -> SmoothnessConstraints:
        """Return the problem with some of its rows."""
        return SmoothnessConstraints(
            self.order,
            self.segments,
            self.power[keep],
            self.segment[keep],
            self.share[keep],
            self.low[keep],
            self.high[keep],
        )

    def gram(self, times: Array) -> Array:
        """Return `G` at segment times `(…, K)`: `(…, rows, rows)`.

        The entry of two instants at the distance `d` is `∫ u^q/q! (u + d)^p/p! du`, from 0 to the
        earlier one.
        """
        before = np.concatenate([np.zeros((*times.shape[:-1], 1)), np.cumsum(times, -1)], -1)
        instants = before[..., self.segment] + self.share * times[..., self.segment]
        place = self.segment + self.share
        early = place[:, None] <= place[None, :]
        count = len(self.power)
        found = np.zeros((*times.shape[:-1], count, count))
        for p, q in product(range(self.order), repeat=2):
            own = (self.power == p)[:, None] & (self.power == q)[None, :]
            i, j = np.nonzero(own & early)
            start, distance = instants[..., i], instants[..., j] - instants[..., i]
            value = np.zeros(distance.shape)
            for r in range(q + 1):
                value = value + comb(q, r) * distance ** (q - r) * start ** (p + r + 1) / (
                    p + r + 1
                )
            value = value / (factorial(p) * factorial(q))
            found[..., i, j] = value
            found[..., j, i] = value
        return found

    def gain(self, costates: Array) -> Array:
        """Return `y·c` of costates `(…, rows, joints)`: its least value that the rows allow."""
        return np.where(costates > 0, costates * self.low, costates * self.high).sum((-2, -1))

    def gain_size(self, costates: Array) -> Array:
        """Return the sum of the sizes of the terms of `gain`."""
        size = np.maximum(np.abs(self.low), np.abs(self.high))
        return (np.abs(costates) * size).sum((-2, -1))


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
def _interpolation(corners: int, degree: int) -> tuple[Array, Array]:
    """Return points for costates, and their weights at the points of the whole lattice."""
    powers = exponents(corners, FREE_DEGREE)
    nodes = powers / FREE_DEGREE
    points = lattice(corners, degree).points

    def monomials(at: Array) -> Array:
        return np.prod(at[:, None, :] ** powers[None], -1)

    return nodes, monomials(points) @ np.linalg.inv(monomials(nodes))


def free_bounds(rows: SmoothnessConstraints, corners: Array) -> Array:
    """Return lower bounds of simplices `(B, K, K)` from the equations alone, `(B,)`.

    Each is the better of two bounds. The first one's costates interpolate the best ones at points
    of the simplex. The second one's are a multiple of those at its centre; it is better where a
    segment time may be 0.
    """
    own = rows.only(np.arange(rows.equations))
    with np.errstate(over="ignore", invalid="ignore"):
        found = np.maximum(_constant_bounds(own, corners), _curved_bounds(own, corners))
    return np.nan_to_num(found, nan=-np.inf)


def _equation_costates(own: SmoothnessConstraints, times: Array) -> Array:
    """Return the best costates of the equations at times `(…, K)`: `(…, rows, joints)`."""
    gram = own.gram(times)
    scale = 1 / np.sqrt(np.einsum("...ii->...i", gram))
    scaled = gram * scale[..., :, None] * scale[..., None, :] + 1e-12 * np.eye(len(own.power))
    return scale[..., None] * np.linalg.solve(scaled, scale[..., None] * own.low)


def _constant_bounds(own: SmoothnessConstraints, corners: Array) -> Array:
    """Return `(y·c)²` over the largest Bernstein coefficient of `y'G y`, `y` best at the centre."""
    centre = corners.mean(axis=1)
    costates = _equation_costates(own, centre)
    at = lattice(own.segments, 2 * own.order - 1)
    gram = own.gram(at.points @ corners)
    squares = np.einsum("brn,bsn->brs", costates, costates)
    values = (gram * squares[:, None]).sum((-2, -1))
    size = (np.abs(gram) * np.abs(squares)[:, None]).sum((-2, -1))
    largest = (values @ at.to_bernstein.T).max(axis=1)
    largest += at.error * np.abs(values).max(axis=1)
    largest += _ROUNDING_RTOL * (size @ np.abs(at.to_bernstein).T).max(axis=1)
    gain = own.gain(costates) - _ROUNDING_RTOL * own.gain_size(costates)
    return np.where(gain > 0, gain**2 / largest, -np.inf)


def _curved_bounds(own: SmoothnessConstraints, corners: Array) -> Array:
    """Return bounds from costates of degree `FREE_DEGREE` in the segment times."""
    degree = 2 * FREE_DEGREE + 2 * own.order - 1
    nodes, weights = _interpolation(own.segments, degree)
    times = nodes @ corners
    centre = corners.mean(axis=1)
    times = np.maximum(times, _CENTRE_SHARE * centre[:, None])
    best = _equation_costates(own, times)
    costates = np.einsum("pm,bmrn->bprn", weights, best)
    return _smallest(own, corners, costates, degree)


def linear_bounds(rows: SmoothnessConstraints, corners: Array, costates: Array) -> Array:
    """Return lower bounds of simplices from costates at their corners, linear in between.

    Args:
        rows: All equations and inequalities.
        corners: `(simplices, K, K)`.
        costates: `(simplices, K, rows, joints)`. The gain `y·c` is concave in them, so between
            corners it is at least its linear interpolation.
    """
    degree = 2 * rows.order + 1
    points = lattice(rows.segments, degree).points
    between = np.einsum("mc,bcrn->bmrn", points, costates)
    gains = np.einsum("mc,bc->bm", points, rows.gain(costates))
    return _smallest(rows, corners, between, degree, gains)


def _smallest(
    rows: SmoothnessConstraints,
    corners: Array,
    costates: Array,
    degree: int,
    gains: Array | None = None,
) -> Array:
    """Return the smallest Bernstein coefficient of each simplex, less its rounding error."""
    own = lattice(rows.segments, degree)
    gram = rows.gram(own.points @ corners)
    if gains is None:
        gains = rows.gain(costates)
    products = np.einsum("bprn,bprs->bpsn", costates, gram, optimize=True)
    values = 2 * gains - (products * costates).sum((-2, -1))
    sizes = np.abs(costates)
    terms = np.einsum("bprn,bprs->bpsn", sizes, np.abs(gram), optimize=True)
    size = 2 * rows.gain_size(costates) + (terms * sizes).sum((-2, -1))
    rounding = own.error * np.abs(values).max(axis=1)
    rounding += _ROUNDING_RTOL * (size @ np.abs(own.to_bernstein).T).max(axis=1)
    return (values @ own.to_bernstein.T).min(axis=1) - rounding


def best_costates(
    rows: SmoothnessConstraints, times: Array, iterations: int = 60
) -> tuple[Array, Array]:
    """Return the best costates at segment times, `(B, rows, joints)`, and their values, `(B,)`.

    An active-set loop starts without limits. Any costates prove a bound, so it may stop after any
    iteration.

    Args:
        rows: The equations and inequalities.
        times: `(B, K)`.
        iterations: Largest number of iterations.
    """
    batch, joints, count = len(times), rows.low.shape[1], len(rows.power)
    gram = np.repeat(rows.gram(times), joints, axis=0)
    scale = 1 / np.sqrt(np.maximum(np.einsum("bii->bi", gram), 1e-300))
    scaled = gram * scale[:, :, None] * scale[:, None, :]
    low, high = (np.tile(side.T, (batch, 1)) * scale for side in (rows.low, rows.high))
    is_limit: Bools = np.asarray(np.arange(count) >= rows.equations)
    active = np.repeat(~is_limit[None], len(low), axis=0)
    side = np.zeros(low.shape)
    goal = np.where(is_limit, 0.0, low)
    best = np.zeros(low.shape)
    best_value = np.full(len(low), -np.inf)
    size = np.minimum(np.abs(low), np.abs(high)) + 1e-12
    for _ in range(iterations):
        both = active[:, :, None] & active[:, None, :]
        diagonal = np.where(active, 1e-11, 1.0)[:, :, None] * np.eye(count)
        matrix = np.where(both, scaled, 0) + diagonal
        y = np.linalg.solve(matrix, np.where(active, goal, 0)[..., None])[..., 0]
        wrong = active & is_limit & (y * side < 0)
        valid = np.where(wrong, 0, y)
        taken = np.einsum("bij,bj->bi", scaled, valid)
        value = (valid * (2 * goal - taken)).sum(1)
        better = value > best_value
        best[better], best_value[better] = valid[better], value[better]
        reached = np.einsum("bij,bj->bi", scaled, y)
        over = np.where(is_limit & ~active, np.maximum(reached - high, low - reached), -1) / size
        any_wrong = np.logical_or.reduce(wrong, axis=1, keepdims=True)
        active &= ~wrong
        side = np.where(wrong, 0, side)
        worst = over.max(1)[:, None]
        added = (over > 1e-6) & (over >= 0.5 * worst) & ~any_wrong
        below = low - reached > reached - high
        active |= added
        side = np.where(added, np.where(below, 1.0, -1.0), side)
        goal = np.where(added, np.where(below, low, high), goal)
        if not (any_wrong.any() or added.any()):
            break
    costates = (best * scale).reshape(batch, joints, count).transpose(0, 2, 1)
    return costates, best_value.reshape(batch, joints).sum(1)
