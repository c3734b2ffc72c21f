"""One joint's motion between given breaks, within its limits, as near as possible to a planned one.

The highest derivative u (acceleration, or jerk where jerk is limited) is constant on each piece of
length d_i. It solves the linear program

    min Σ d_i |u_i − ū_i|        ū the planned one,

subject to Taylor's formula from break to break, the waypoints, rest at both ends, and every limit:
at the breaks the states themselves are bounded, inside a piece the Bernstein coefficients of
position and velocity, between which the polynomial stays (docs/mathematics.md, section 10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import comb, factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy  # which imports its parts, half a second, where they are first used
from numpy.typing import NDArray

from trajopt.core.problem import Limits

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[np.float64]
Indices = NDArray[np.int_]
_Rows = tuple["csr_array", Array]  # a matrix, and the right-hand side

_LIMIT_RTOL = 1e-5  # by which the program stays below each limit: its own tolerance follows
_CORRECTIONS = 3  # each takes the misses to what the one before rounded
_SOLVER = {"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9}


class _Term(NamedTuple):
    """Entries of a matrix."""

    row: Indices
    column: Indices
    value: Array


@dataclass(frozen=True, eq=False)
class JointProgram:
    """The program of one joint.

    The unknowns are the states at the breaks, one derivative after the other, then `u`, then the
    distances `e ≥ |u − ū|`. Its unit of length is the joint's range; its unit of time the geometric
    mean of the longest and the shortest, since the solver drops coefficients below 1e-9, as d³/6
    easily is.

    Attributes:
        times: Of the breaks, s, `(pieces + 1,)`.
        order: Of the derivative `u`: 2 or 3.
        passing: The break of each waypoint.
        positions: The waypoints, rad.
        limits: The joint's own.
        planned: The derivative below `u` at the breaks, as planned, rad and s.
    """

    times: Array
    order: int
    passing: Indices
    positions: Array
    limits: Limits
    planned: Array

    def solved(self) -> Array | None:
        """Position and the derivatives below `u` at the breaks, `(order, pieces + 1)`; or None."""
        if not np.ptp(self.positions):
            still = np.zeros((self.order, self._points))
            still[0] = self.positions[0]
            return still
        rates = self._rates()
        if rates is None:
            return None
        return self._exact(rates)

    @property
    def _points(self) -> int:
        return len(self.times)

    @property
    def _pieces(self) -> int:
        return len(self.times) - 1

    @cached_property
    def _time_unit(self) -> float:
        steps = np.diff(self.times)
        product_of_both = self.times[-1] * steps.min()
        return float(np.sqrt(product_of_both))

    @cached_property
    def _units(self) -> Array:
        """Of position and its derivatives up to `u`, rad and s."""
        powers = np.arange(self.order + 1)
        length = np.ptp(self.positions)
        return np.asarray(length / self._time_unit**powers)

    @cached_property
    def _lengths(self) -> Array:
        """Of the pieces, in the program's unit."""
        return np.diff(self.times) / self._time_unit

    def _rates(self) -> Array | None:
        """The program's `u` on each piece, rad/s^order; None where it has no solution."""
        matrix, most = self._distances()
        inside = self._inside()
        if inside is not None:
            matrix = scipy.sparse.vstack([matrix, inside[0]])
            most = np.concatenate([most, inside[1]])
        dynamics = self._dynamics()
        first_rate = self.order * self._points
        first_distance = first_rate + self._pieces
        cost = np.zeros(first_distance + self._pieces)
        cost[first_distance:] = self._lengths
        answer = scipy.optimize.linprog(
            cost,
            A_ub=matrix,
            b_ub=most,
            A_eq=dynamics,
            b_eq=np.zeros(dynamics.shape[0]),
            bounds=self._ranges(),
            method="highs",
            options=_SOLVER,
        )
        if answer.status != 0:
            return None
        rates = answer.x[first_rate:first_distance]
        return np.asarray(rates * self._units[self.order])

    # ---- the program's rows -----------------------------------------------------------------

    def _limits(self) -> tuple[Array, Array]:
        """Low and high of position and its derivatives up to `u`, in the program's units."""
        pairs = np.array(
            [
                self.limits.position[0] - self.positions[0],
                self.limits.velocity[0],
                self.limits.acceleration[0],
                self.limits.jerk[0],
            ]
        )
        pairs[1:] *= 1 - _LIMIT_RTOL
        known = pairs[: self.order + 1]
        low, high = known.T / self._units
        return low, high

    def _ranges(self) -> Array:
        """The range of every unknown: limits, rest at both ends, and the waypoints."""
        low, high = self._limits()
        passed = (self.positions - self.positions[0]) / self._units[0]
        ranges = []
        for kind in range(self.order):
            pair = [low[kind], high[kind]]
            states = np.tile(pair, (self._points, 1))
            if kind == 0:
                states[self.passing] = passed[:, None]
            else:
                states[[0, -1]] = 0.0
            ranges.append(states)
        rate = [low[-1], high[-1]]
        distance = [0.0, np.inf]
        for pair in (rate, distance):
            ranges.append(np.tile(pair, (self._pieces, 1)))
        return np.concatenate(ranges)

    def _dynamics(self) -> csr_array:
        """Taylor: `Σ_p x_(k + p)(i) d_i^p / p! − x_k(i + 1) = 0`, the last term of `u`."""
        piece = np.arange(self._pieces)
        ones = np.ones(self._pieces)
        terms: list[_Term] = []
        for kind in range(self.order):
            rows = kind * self._pieces + piece
            ends = self._columns(kind, piece + 1)
            terms.append(_Term(rows, ends, -ones))
            for power in range(self.order - kind + 1):
                starts = self._columns(kind + power, piece)
                taylor = self._taylor(power)
                terms.append(_Term(rows, starts, taylor))
        return self._matrix(terms, self.order * self._pieces)

    def _inside(self) -> _Rows | None:
        """`A x ≤ b`: the inner Bernstein coefficients of each piece's position and velocity.

        Of a polynomial of degree n: `b_j = Σ_p C(j, p) / C(n, p) c_p d^p`, with `c_p d^p` its
        Taylor terms. Sides without a limit need no rows.
        """
        low, high = self._limits()
        piece = np.arange(self._pieces)
        terms: list[_Term] = []
        most: list[Array] = []
        for kind, side in product((0, 1), (-1, 1)):
            limit = low[kind] if side < 0 else high[kind]
            if np.isinf(limit):
                continue
            degree = self.order - kind
            for inner in range(1, degree):
                rows = self._pieces * len(most) + piece
                most.append(np.full(self._pieces, side * limit))
                for power in range(inner + 1):
                    share = comb(inner, power) / comb(degree, power)
                    starts = self._columns(kind + power, piece)
                    taylor = self._taylor(power)
                    terms.append(_Term(rows, starts, side * share * taylor))
        if not terms:
            return None
        matrix = self._matrix(terms, self._pieces * len(most))
        return matrix, np.concatenate(most)

    def _distances(self) -> _Rows:
        """`u − e ≤ ū` and `−u − e ≤ −ū`."""
        changes = np.diff(self.planned)
        steps = np.diff(self.times)
        rate_unit = self._units[self.order]
        planned = changes / steps / rate_unit
        piece = np.arange(self._pieces)
        ones = np.ones(self._pieces)
        rates = self._columns(self.order, piece)
        distances = rates + self._pieces
        terms: list[_Term] = []
        for number, sign in enumerate((1.0, -1.0)):
            rows = number * self._pieces + piece
            terms.append(_Term(rows, rates, sign * ones))
            terms.append(_Term(rows, distances, -ones))
        matrix = self._matrix(terms, 2 * self._pieces)
        return matrix, np.concatenate([planned, -planned])

    def _taylor(self, power: int) -> Array:
        """`d^p / p!` of each piece."""
        return np.asarray(self._lengths**power / factorial(power))

    def _columns(self, kind: int, breaks: Indices) -> Indices:
        """Where the unknowns `x_kind` at some breaks stand; `u` after the states."""
        return np.asarray(kind * self._points + breaks)

    def _matrix(self, terms: Sequence[_Term], rows: int) -> csr_array:
        """A matrix of all unknowns from its entries."""
        row = np.concatenate([term.row for term in terms])
        column = np.concatenate([term.column for term in terms])
        value = np.concatenate([term.value for term in terms])
        states = self.order * self._points
        rates_and_distances = 2 * self._pieces
        shape = (rows, states + rates_and_distances)
        return scipy.sparse.csr_array((value, (row, column)), shape=shape)

    # ---- from the program's answer to exact states ------------------------------------------

    def _exact(self, rates: Array) -> Array:
        """The states of the nearest rates that pass the waypoints and end at rest.

        Summed from break to break, so that each piece is consistent to the last bit: what sums over
        the whole motion round would be magnified by the interpolation, by 60/d³ of a quintic piece.
        """
        T = self.times[-1]
        rows = []
        for row in self.passing[1:]:
            reached = self._response(self.times[row], self.order)
            rows.append(reached / T**self.order)
        for power in range(1, self.order):
            at_end = self._response(T, power)
            rows.append(at_end / T**power)
        matrix = np.array(rows)
        states = self._states(rates)
        for _ in range(_CORRECTIONS):
            correction, *_ = np.linalg.lstsq(matrix, -self._misses(states), rcond=None)
            rates = rates + correction
            states = self._states(rates)
        states[0, self.passing] = self.positions
        states[1:, -1] = 0.0
        return states

    def _response(self, time: float, power: int) -> Array:
        """What a unit of each piece's `u` adds to the derivative `order − power` at a time.

        `((t − t_i)^p − (t − t_(i + 1))^p) / p!`, where these differences are positive.
        """
        since = np.maximum(0.0, time - self.times)
        grown = since**power / factorial(power)
        return np.asarray(grown[:-1] - grown[1:])

    def _misses(self, states: Array) -> Array:
        """How far the states are off the waypoints and rest, divided by the duration's powers."""
        T = self.times[-1]
        passed = states[0, self.passing[1:]]
        misses = (passed - self.positions[1:]) / T**self.order
        at_end = []
        for power in range(1, self.order):
            derivative = states[self.order - power, -1]
            at_end.append(derivative / T**power)
        return np.concatenate([misses, at_end])

    def _states(self, rates: Array) -> Array:
        """Position and derivatives at the breaks, by Taylor's formula from each to the next."""
        states = np.zeros((self.order + 1, self._points))
        states[0, 0] = self.positions[0]
        states[self.order, :-1] = rates
        for piece, length in enumerate(np.diff(self.times)):
            for kind in range(self.order):
                value = 0.0
                for power in range(self.order - kind, -1, -1):  # the smallest terms first
                    value += states[kind + power, piece] * length**power / factorial(power)
                states[kind, piece + 1] = value
        return states[: self.order]
