"""One joint's motion between given breaks, within its limits, as near as possible to a planned one.

The highest derivative `u` (acceleration, or jerk where jerk is limited) is constant on each piece
of length `d_i`. It solves the linear program

    min Σ d_i |u_i − ū_i|        ū the planned one,

subject to Taylor's formula from break to break, the waypoints, the states at both ends (rest,
unless others are given), and every limit.
At the breaks the states themselves are bounded. Inside a piece the Bernstein coefficients of
position and velocity are bounded: the polynomial stays between them (docs/mathematics.md,
section 10). So are those of a chord of the parabola where a velocity limit falls: the chord between
the places where the planned motion is at the ends of the piece. It holds inside as long as the
motion stays near the planned one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial
from typing import TYPE_CHECKING

import numpy as np
import scipy  # imports its parts, half a second, where they are first used
from numpy.typing import NDArray

from trajopt.core.arrays import Array
from trajopt.core.limits import FallingVelocity, Limits

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Indices = NDArray[np.int_]
_Inequalities = tuple["csr_array", Array]  # a matrix, and the right-hand side

LIMIT_RTOL = 1e-5  # distance that the program keeps from each limit: its tolerance is smaller
TOLERANCE = 1e-9  # of the solver, in the program's units
LEAST_TOLERANCE = 1e-10  # the solver takes no smaller one
CORRECTIONS = 3  # each reduces the misses to the rounding of the one before


@dataclass(frozen=True, eq=False)
class JointProgram:
    """The linear program of one joint.

    The unknowns are the states at the breaks, one derivative after the other, then `u`, then the
    distances `e ≥ |u − ū|`. The unit of length is the joint's range. The unit of time is the
    geometric mean of the longest and the shortest time, since the solver drops coefficients below
    1e-9, and d³/6 is easily smaller.

    Attributes:
        times: Breaks, s, `(pieces + 1,)`.
        order: Order of the derivative `u`: 2 or 3.
        passing: The break of each waypoint.
        positions: The joint's waypoints, rad.
        limits: The joint's limits.
        planned: The planned derivative below `u` at the breaks, rad and s.
        ends: Velocity (and acceleration, of order 3) at the start and at the end, rad and s,
            `(2, order - 1)`; None at rest.
        distance: What the program keeps from each limit, relative.
        course: The planned position at the breaks, rad; without it falling velocity limits are not
            counted.
    """

    times: Array
    order: int
    passing: Indices
    positions: Array
    limits: Limits
    planned: Array
    ends: Array | None = None
    distance: float = LIMIT_RTOL
    course: Array | None = None

    def solved(self) -> Array | None:
        """Position and the derivatives below `u` at the breaks, `(order, pieces + 1)`; or None."""
        if not np.ptp(self.positions) and not self._ends[:, 1:].any():
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
    def _ends(self) -> Array:
        """The states at the start and at the end, from position on, rad and s, `(2, order)`."""
        rates = np.zeros((2, self.order - 1)) if self.ends is None else self.ends
        return np.column_stack([self.positions[[0, -1]], rates])

    @cached_property
    def _time_unit(self) -> float:
        shortest = np.diff(self.times).min()
        return float(np.sqrt(self.times[-1] * shortest))

    @cached_property
    def _units(self) -> Array:
        """Units of position and its derivatives up to `u`, rad and s."""
        powers = np.arange(self.order + 1)
        length = float(np.ptp(self.positions))
        if self._ends[:, 1:].any():
            rates = np.abs(self._ends[:, 1:]).max(axis=0).tolist()
            length = max(length, rates[0] * self._time_unit)
            length = length or rates[-1] * self._time_unit**2
        return np.asarray(length / self._time_unit**powers)

    @cached_property
    def _lengths(self) -> Array:
        """Lengths of the pieces, in the program's unit of time."""
        return np.diff(self.times) / self._time_unit

    def _rates(self) -> Array | None:
        """The program's `u` on each piece, rad/s^order; None where it has no solution."""
        parts = [self._distances(), *self._inside(), *self._falling()]
        dynamics = self._dynamics()
        cost = np.zeros(dynamics.shape[1])
        cost[-self._pieces :] = self._lengths
        answer = scipy.optimize.linprog(
            cost,
            A_ub=scipy.sparse.vstack([matrix for matrix, _ in parts]),
            b_ub=np.concatenate([most for _, most in parts]),
            A_eq=dynamics,
            b_eq=np.zeros(dynamics.shape[0]),
            bounds=self._ranges(),
            method="highs",
            options={
                f"{side}_feasibility_tolerance": max(
                    LEAST_TOLERANCE, min(TOLERANCE, self.distance / 10)
                )
                for side in ("primal", "dual")
            },
        )
        if answer.status != 0:
            return None
        _, rates, _ = np.split(answer.x, [-2 * self._pieces, -self._pieces])
        unit = self._units[self.order]
        return np.asarray(rates * unit)

    # ---- the program's matrices -------------------------------------------------------------

    @cached_property
    def _unknowns(self) -> csr_array:
        """A row for each unknown, which selects it."""
        count = self.order * self._points + 2 * self._pieces
        return scipy.sparse.eye_array(count, format="csr")

    def _states_at(self, kind: int, first_break: int) -> csr_array:
        """Rows that select `x_kind` at the start (0) or end (1) of each piece; `u` is the last."""
        first = kind * self._points + first_break
        return self._unknowns[first : first + self._pieces]

    def _term(self, kind: int, power: int) -> csr_array:
        """The Taylor term `x_(kind + power) d^power / power!` of each piece."""
        factors = self._lengths**power / factorial(power)
        return scipy.sparse.diags_array(factors) @ self._states_at(kind + power, 0)

    @cached_property
    def _limits(self) -> Array:
        """`[low, high]` of position and its derivatives up to `u`, in the program's units.

        Of each piece: `(order + 1, pieces, 2)`.
        """
        own = self.limits
        inner = self.passing[1:-1]
        segment = np.searchsorted(inner, np.arange(self._pieces), side="right")
        pairs = np.empty((4, self._pieces, 2))
        for kind, given in enumerate((own.position, own.velocity, own.acceleration, own.jerk)):
            pairs[kind] = given[segment, 0] if given.ndim == 3 else given
        pairs[0] -= self.positions[0]
        pairs[1:] *= 1 - self.distance
        same = own.segments is None
        for states, ending in zip(self._ends, (segment == 0, segment == segment[-1]), strict=True):
            for kind in range(1, self.order):  # an end state may lie at its limit
                low, high = pairs[kind].T
                low[:] = np.where(ending | same, np.minimum(low, states[kind]), low)
                high[:] = np.where(ending | same, np.maximum(high, states[kind]), high)
        kinds = self.order + 1
        return np.asarray(pairs[:kinds] / self._units[:, None, None])

    def _ranges(self) -> Array:
        """The range of every unknown: limits, the states at both ends, and the waypoints."""
        # at a break the limits of the pieces on both sides
        each = self._limits[:-1]
        before = np.concatenate([each[:, :1], each], axis=1)
        after = np.concatenate([each, each[:, -1:]], axis=1)
        states = np.empty_like(before)
        states[..., 0] = np.maximum(before[..., 0], after[..., 0])
        states[..., 1] = np.minimum(before[..., 1], after[..., 1])
        passed = (self.positions - self.positions[0]) / self._units[0]
        states[0, self.passing] = passed[:, None]
        states[1:, [0, -1]] = (self._ends[:, 1:] / self._units[1 : self.order]).T[..., None]
        distances = np.tile([0.0, np.inf], (self._pieces, 1))
        return np.concatenate([states.reshape(-1, 2), self._limits[-1], distances])

    def _dynamics(self) -> csr_array:
        """Taylor: `Σ_p x_(k + p)(i) d_i^p / p! − x_k(i + 1) = 0`, the last term of `u`."""
        blocks = []
        for kind in range(self.order):
            powers = range(self.order - kind + 1)
            terms = [self._term(kind, power) for power in powers]
            block = sum(terms) - self._states_at(kind, 1)
            blocks.append(block)
        return scipy.sparse.vstack(blocks)

    def _inside(self) -> list[_Inequalities]:
        """`A x ≤ b`: the inner Bernstein coefficients of each piece's position and velocity.

        Of a polynomial of degree n: `b_j = Σ_p C(j, p) / C(n, p) c_p d^p`, with `c_p d^p` its
        Taylor terms.
        """
        found = []
        for kind in (0, 1):
            degree = self.order - kind
            for side, limit in zip((-1, 1), self._limits[kind].T, strict=True):
                if np.isinf(limit).all():
                    continue
                most = side * limit
                for inner in range(1, degree):
                    found.append((side * self._control(kind, degree, inner), most))
        return found

    def _control(self, kind: int, degree: int, number: int) -> csr_array:
        """Rows of a Bernstein coefficient of a state on each piece, in this degree."""
        terms = []
        for power in range(min(number, self.order - kind) + 1):
            share = comb(number, power) / comb(degree, power)
            terms.append(share * self._term(kind, power))
        return sum(terms)

    def _falling(self) -> list[_Inequalities]:
        """`(a + b) (v + o) ≤ 2 d w + a b` of a chord from `v + o = a` to `b`, with `w = H − q`.

        Where the planned motion is where nothing is allowed, it leaves: `v ≤ 0`.
        """
        own = self.limits.kinds.get(FallingVelocity.key)
        if self.course is None or not isinstance(own, FallingVelocity):
            return []
        ((offset, deceleration, *ends),) = own.rows.tolist()
        lengths = np.diff(self.times)
        drift = np.abs(np.diff(self.course)) / lengths * lengths.min()
        at = np.array([self.course[:-1], self.course[1:]])
        found = []
        for sign, end in zip((-1.0, 1.0), ends, strict=True):
            distances = sign * (end - at)
            near = distances.min(axis=0) - drift
            far = distances.max(axis=0) + drift
            blocked = offset**2 / (2 * deceleration)
            leaves = near < blocked
            a, b = np.sqrt(2 * deceleration * np.maximum([near, far], blocked))
            sums = a + b
            slope = np.where(leaves, 0.0, 2 * deceleration / sums)  # of v by w
            height = np.where(leaves, 0.0, a * b / sums - offset)
            most = height + slope * sign * (end - self.positions[0])
            for number in range(self.order + 1):
                position, velocity = (self._control(kind, self.order, number) for kind in (0, 1))
                by_position = slope * self._units[0] / self._units[1]
                rows = scipy.sparse.diags_array(sign * by_position) @ position
                rows += sign / (1 - self.distance) * velocity
                found.append((rows, most / self._units[1]))
        return found

    def _distances(self) -> _Inequalities:
        """`u − e ≤ ū` and `−u − e ≤ −ū`."""
        changes = np.diff(self.planned)
        steps = np.diff(self.times)
        planned = changes / steps / self._units[self.order]
        rates = self._states_at(self.order, 0)
        distances = self._unknowns[-self._pieces :]
        above = rates - distances
        below = -rates - distances
        matrix = scipy.sparse.vstack([above, below])
        return matrix, np.concatenate([planned, -planned])

    # ---- from the program's answer to exact states ------------------------------------------

    def _exact(self, rates: Array) -> Array:
        """The states of the nearest rates that pass the waypoints and end as they are to.

        They are summed from break to break, so that each piece is consistent to the last bit. Sums
        over the whole motion would round more, and the interpolation would magnify that rounding:
        60/d³ times for a quintic piece.
        """
        T = self.times[-1]
        # The aims: the break, the order of the derivative there, and its value.
        passed = zip(self.passing, self.positions, strict=True)
        aims = [(row, 0, q) for row, q in passed][1:]
        for kind in range(1, self.order):
            aims.append((self._pieces, kind, self._ends[1, kind]))
        scales = []
        responses = []
        for row, kind, _ in aims:
            power = self.order - kind
            scale = T**power
            response = self._response(self.times[row], power)
            scales.append(scale)
            responses.append(response / scale)
        matrix = np.array(responses)
        states = self._states(rates)
        for _ in range(CORRECTIONS):
            misses = [states[kind, row] - value for row, kind, value in aims]
            wanted = -np.divide(misses, scales)
            correction, *_ = np.linalg.lstsq(matrix, wanted, rcond=None)
            rates = rates + correction
            states = self._states(rates)
        for row, kind, value in aims:
            states[kind, row] = value
        return states

    def _response(self, time: float, power: int) -> Array:
        """The derivative of order `order − power` at a time, for a unit of each piece's `u`.

        `((t − t_i)^p − (t − t_(i + 1))^p) / p!`, where these differences are positive.
        """
        since = np.maximum(0.0, time - self.times)
        grown = since**power / factorial(power)
        return np.asarray(grown[:-1] - grown[1:])

    def _states(self, rates: Array) -> Array:
        """Position and derivatives at the breaks, by Taylor's formula from each to the next."""
        states = np.zeros((self.order + 1, self._points))
        states[: self.order, 0] = self._ends[0]
        states[self.order, :-1] = rates
        for piece, length in enumerate(np.diff(self.times)):
            for kind in range(self.order):
                value = 0.0
                for power in range(self.order - kind, -1, -1):  # the smallest terms first
                    derivative = states[kind + power, piece]
                    value += derivative * length**power / factorial(power)
                states[kind, piece + 1] = value
        return states[: self.order]
