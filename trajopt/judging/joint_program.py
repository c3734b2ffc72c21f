"""One joint's motion on given breaks, within its limits and as close as possible to a plan.

The highest derivative `u` (acceleration, or jerk where jerk is limited) is constant on each piece
of length `d_i`. It solves the linear program

    min Σ d_i |u_i − ū_i|        ū the planned one,

subject to Taylor's formula from break to break, the waypoints, the states at both ends (rest,
unless others are given), and every limit.

At the breaks the states themselves are bounded. Inside a piece the Bernstein coefficients of
position and velocity are bounded, since the polynomial stays between them (docs/mathematics.md,
section 11). A falling velocity limit is a parabola of position and velocity. It is replaced by its
chord between the positions of the planned motion at both ends of the piece. The chord is inside the
limit as long as the motion stays close to the planned one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial
from typing import TYPE_CHECKING

import numpy as np
import scipy  # loads its submodules, half a second, where they are first used
from numpy.typing import NDArray

from trajopt.core.arrays import Array
from trajopt.core.limits import FallingVelocity, Limits

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Indices = NDArray[np.int_]
_Inequalities = tuple["csr_array", Array]  # a matrix, and the right-hand side

LIMIT_RTOL = 1e-5  # distance from each limit, relative; larger than the solver's tolerance
TOLERANCE = 1e-9  # of the solver, in the program's units
LEAST_TOLERANCE = 1e-10  # the smallest tolerance that the solver accepts
CORRECTIONS = 3  # each reduces the misses to the rounding of the last one


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
        distance: Distance from each limit in the program, relative.
        course: The planned position at the breaks, rad; None to ignore falling velocity limits.
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
        """Return position and the derivatives below `u` at the breaks, `(order, pieces + 1)`.

        None where the program has no solution.
        """
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
        """Return the solution `u` on each piece, rad/s^order; None where there is none."""
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
        """The identity matrix: row i selects unknown i."""
        count = self.order * self._points + 2 * self._pieces
        return scipy.sparse.eye_array(count, format="csr")

    def _states_at(self, kind: int, first_break: int) -> csr_array:
        """Rows that select `x_kind` at the start (0) or end (1) of each piece; `u` is the last."""
        first = kind * self._points + first_break
        return self._unknowns[first : first + self._pieces]

    def _term(self, kind: int, power: int) -> csr_array:
        """Return the Taylor term `x_(kind + power) d^power / power!` of each piece."""
        factors = self._lengths**power / factorial(power)
        return scipy.sparse.diags_array(factors) @ self._states_at(kind + power, 0)

    @cached_property
    def _limits(self) -> Array:
        """Limits of position and its derivatives up to `u`, in the program's units.

        `[low, high]` of each piece, `(order + 1, pieces, 2)`.
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
        """Return the bounds of every unknown: limits, the end states, and the waypoints."""
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
        """Return Taylor's formula, `Σ_p x_(k + p)(i) d_i^p / p! − x_k(i + 1) = 0`.

        The last term is that of `u`.
        """
        blocks = []
        for kind in range(self.order):
            powers = range(self.order - kind + 1)
            terms = [self._term(kind, power) for power in powers]
            block = sum(terms) - self._states_at(kind, 1)
            blocks.append(block)
        return scipy.sparse.vstack(blocks)

    def _inside(self) -> list[_Inequalities]:
        """Return `A x ≤ b` for the inner Bernstein coefficients of position and velocity.

        A polynomial of degree n with the Taylor terms `c_p d^p` has the Bernstein coefficients
        `b_j = Σ_p C(j, p) / C(n, p) c_p d^p`.
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
        """Return the rows of one Bernstein coefficient of a state on each piece."""
        terms = []
        for power in range(min(number, self.order - kind) + 1):
            share = comb(number, power) / comb(degree, power)
            terms.append(share * self._term(kind, power))
        return sum(terms)

    def _falling(self) -> list[_Inequalities]:
        """Return the chords of a falling velocity limit, `(a + b) (v + o) ≤ 2 d w + a b`.

        The chord leads from `v + o = a` to `v + o = b`, and `w = H − q` is the distance from the
        end. Where the limit allows no motion towards the end it is `v ≤ 0`.
        """
        own = self.limits.kinds.get(FallingVelocity.key)
        if self.course is None or not isinstance(own, FallingVelocity):
            return []
        ((offset, deceleration, *ends),) = own.numbers.tolist()
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
            slope = np.where(leaves, 0.0, 2 * deceleration / sums)  # dv/dw
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
        """Return `u − e ≤ ū` and `−u − e ≤ −ū`."""
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
        """Return the states of the closest `u` that meets the waypoints and the last state.

        They are summed from break to break, so that each piece is consistent to the last bit. Sums
        over the whole motion would have larger rounding errors, which a quintic piece of length `d`
        would magnify by 60/d³.
        """
        T = self.times[-1]
        # Targets: index of the break, order of the derivative there, its value.
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
        """Return the derivative of order `order − p` at a time `t`, for `u = 1` on each piece.

        It is `((t − t_i)₊^p − (t − t_(i + 1))₊^p) / p!`, where `p` is `power`.
        """
        since = np.maximum(0.0, time - self.times)
        grown = since**power / factorial(power)
        return np.asarray(grown[:-1] - grown[1:])

    def _states(self, rates: Array) -> Array:
        """Return position and derivatives at the breaks, by Taylor's formula."""
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
