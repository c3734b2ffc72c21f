"""A motion moved to whole control cycles, so that a controller's interpolation reproduces it.

A controller joins the points that it is sent with cubic pieces (positions and velocities) or
quintic ones (accelerations too). Between two breaks on the cycle a motion of constant acceleration
is a cubic piece's twin, one of constant jerk a quintic one's (docs/mathematics.md, section 10): it
is executed as planned. A sample between breaks is not: bang-bang motions overshoot then.

So the breaks are moved to the nearest cycle, where many become one, and the motion between them is
found again, each joint alone: the linear program

    min Σ d_i |u_i − ū_i|    for the highest derivative u, constant on each piece of length d_i,

subject to the waypoints, rest at both ends, and every limit; ū is the planned one. Where that has
no solution, the motion gets a cycle longer, and another. Velocity and position inside a piece are
held by their Bernstein coefficients, which are linear in the unknowns too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import comb, factorial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_array, vstack

from trajopt.exceptions import InvalidInput
from trajopt.formats.samples import Samples
from trajopt.problem import LimitName, Limits, Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]
Indices = NDArray[np.int_]
_Term = tuple[Indices, Indices, Array]  # rows, columns and values of a matrix

_LIMIT_RTOL = 1e-5  # by which the program stays below each limit: its own tolerance follows
_LONGEST_RTOL = 0.25  # by which a motion may get longer; beyond, the cycle is too long for it
_PIECES_MAX = 400  # of a motion whose own pieces are of a higher degree
_CONSTANT_RTOL = 1e-4  # of a limit, by which a constant may vary
_SAME_PLACE_RTOL = 1e-12  # of the largest displacement, by which one waypoint may miss another
_DECIMALS = 9  # of a second: what a ROS message holds
_SAME_CYCLE = 1e-6  # of a cycle: a time this near to one is on it
_SOLVER = {"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9}


@dataclass(frozen=True, eq=False)
class OnCycle:
    """A motion whose breaks are all whole cycles.

    Attributes:
        cycle: s.
        breaks: In cycles from 0, `(pieces + 1,)`.
        waypoints: In cycles, one per waypoint.
        states: Positions, velocities and, where the problem limits jerk, accelerations at the
            breaks, `(2 or 3, pieces + 1, joints)`, rad and s.
    """

    cycle: float
    breaks: Indices
    waypoints: Indices
    states: Array

    @property
    def duration(self) -> float:
        """s."""
        return float(self._times(self.breaks)[-1])

    @property
    def waypoint_times(self) -> Array:
        """s, one per waypoint."""
        return self._times(self.waypoints)

    def at_breaks(self, joint_names: Sequence[str]) -> Samples:
        """The points that reproduce it, no more than needed."""
        return _samples(joint_names, self._times(self.breaks), self.states)

    def at_cycles(self, joint_names: Sequence[str]) -> Samples:
        """A point every cycle, which reproduce it too."""
        motion = self.at_breaks(joint_names).trajectory()
        every = np.arange(self.breaks[-1] + 1)
        times = self._times(every)
        orders = range(len(self.states))
        states = np.stack([motion(times, order) for order in orders])
        # At its breaks the motion is what it is, not what evaluating it rounds.
        states[:, self.breaks] = self.states
        return _samples(joint_names, times, states)

    def _times(self, cycles: Indices) -> Array:
        """s, as decimal fractions: 0.3, not 0.30000000000000004."""
        return np.round(cycles * self.cycle, _DECIMALS)


def _samples(joint_names: Sequence[str], times: Array, states: Array) -> Samples:
    return Samples(tuple(joint_names), times, *states)


def moved(problem: Problem, trajectory: Trajectory, cycle: float) -> OnCycle:
    """The motion with all breaks on whole cycles, hardly longer, within every limit.

    Args:
        problem: Its waypoints and limits.
        trajectory: A certified one of this problem.
        cycle: s, whole nanoseconds.

    Raises:
        InvalidInput: The cycle is too long for the motion.
    """
    merged, index = problem.merged()
    first = np.unique(index, return_index=True)[1]
    times = trajectory.waypoint_times[first]
    shortest = int(np.ceil(trajectory.duration / cycle - _SAME_CYCLE))
    longest = int(shortest * (1 + _LONGEST_RTOL)) + 1
    low = shortest - 1
    high = shortest
    found = _attempt(merged, trajectory, times, cycle, high)
    while found is None and high < longest:
        # twice as many more cycles each time, then the fewest that do
        low = high
        high = min(longest, shortest + max(1, 2 * (high - shortest)))
        found = _attempt(merged, trajectory, times, cycle, high)
    if found is None:
        right = (
            f"a shorter one: no motion on its grid takes {trajectory.duration:.4g} s or little more"
        )
        raise InvalidInput("--cycle", right, value=cycle)
    while high - low > 1:
        middle = (low + high) // 2
        shorter = _attempt(merged, trajectory, times, cycle, middle)
        if shorter is None:
            low = middle
        else:
            high = middle
            found = shorter
    breaks, waypoints, states = found
    return OnCycle(cycle, breaks, waypoints[index], states)


def _attempt(
    problem: Problem,
    trajectory: Trajectory,
    waypoint_times: Array,
    cycle: float,
    cycles: int,
) -> tuple[Indices, Indices, Array] | None:
    """The motion in so many cycles: its breaks and waypoints in cycles, and its states; or None."""
    duration = cycles * cycle
    stretched = trajectory.dilated(duration / trajectory.duration)
    waypoints = _whole(waypoint_times / trajectory.duration * cycles, problem)
    if waypoints[-1] != cycles:
        return None
    order = 3 if problem.has("jerk") else 2
    wanted = stretched.breaks
    if not _constant(problem, trajectory, order):
        finest = max(1, cycles // _PIECES_MAX)
        wanted = np.append(wanted, np.arange(0, cycles, finest) * cycle)
    nearest = np.rint(wanted / cycle).astype(int)
    if order == 3 and not problem.limits.jerk_limited[problem.moving].all():
        # What has no jerk limit changes its acceleration within a cycle.
        beside = np.concatenate([nearest - 1, nearest, nearest + 1])
        nearest = beside.clip(0, cycles)
    breaks = np.union1d(nearest, waypoints)
    times = breaks * cycle
    joints = []
    for joint in range(problem.joints):
        program = _Program(
            times=times,
            order=order,
            passing=np.searchsorted(breaks, waypoints),
            positions=problem.waypoints[:, joint],
            limits=problem.limits.only([joint]),
            planned=stretched(times, order - 1)[:, joint],
        )
        states = program.solved()
        if states is None:
            return None
        joints.append(states)
    return breaks, waypoints, np.stack(joints, axis=-1)


def _constant(problem: Problem, trajectory: Trajectory, order: int) -> bool:
    """Whether the derivative of this order is constant on each piece, but for rounding."""
    unit = trajectory.pieces(order)
    varying = np.abs(unit[:-1]).sum(axis=0).max(axis=0)
    kind: LimitName = "jerk" if order == 3 else "acceleration"
    limit = np.abs(problem.limits.by_name()[kind]).min(axis=1)
    usual = np.minimum(limit, np.abs(unit).max(initial=0.0))
    return bool(np.all(varying <= _CONSTANT_RTOL * usual))


def _whole(cycles: Array, problem: Problem) -> Indices:
    """The nearest whole cycle of each waypoint, each later than the one before.

    Waypoints that are one but for rounding may share a cycle.
    """
    found = np.rint(cycles).astype(int)
    largest = np.abs(problem.displacements).max()
    for segment, displacement in enumerate(problem.displacements):
        step = int(np.abs(displacement).max() > _SAME_PLACE_RTOL * largest)
        found[segment + 1] = max(found[segment + 1], found[segment] + step)
    return found


@dataclass(frozen=True, eq=False)
class _Program:
    """One joint's linear program.

    Attributes:
        times: Of the breaks, s, `(pieces + 1,)`.
        order: Of the derivative that is constant on each piece: 2 or 3.
        passing: The break of each waypoint.
        positions: The waypoints, rad.
        limits: The joint's own.
        planned: The derivative below that order at the breaks.
    """

    times: Array
    order: int
    passing: Indices
    positions: Array
    limits: Limits
    planned: Array

    def solved(self) -> Array | None:
        """Position and the derivatives below `order` at the breaks, `(order, pieces + 1)`."""
        if not np.ptp(self.positions):
            still = np.zeros((self.order, len(self.times)))
            still[0] = self.positions[0]
            return still
        steps = np.diff(self.times)
        planned = np.diff(self.planned) / steps
        rates = self._rates(steps, planned)
        if rates is None:
            return None
        return self._states(self._exact(rates))

    def _rates(self, steps: Array, planned: Array) -> Array | None:
        """The highest derivative on each piece that keeps all limits, nearest to the planned one.

        Unknowns: the states at the breaks, one derivative after the other, then the highest
        derivative `u`, then the distances `e ≥ |u − ū|`. The unit of length is the joint's range;
        of time the mean of the longest and the shortest, the geometric one: the solver drops
        coefficients below 1e-9, as d³/6 easily is.
        """
        T = float(np.sqrt(self.times[-1] * steps.min()))
        H = np.ptp(self.positions)
        d = steps / T
        pieces = len(d)
        unit = H / T ** np.arange(self.order + 1)  # of each derivative
        low, high = self._bounds(unit)
        equations = self._dynamics(d)
        matrix, most = self._distances(planned / unit[self.order])
        inside = self._inside(d, low, high)
        if inside is not None:
            matrix = vstack([matrix, inside[0]])
            most = np.concatenate([most, inside[1]])
        start = self.order * len(self.times)
        cost = np.zeros(start + 2 * pieces)
        cost[start + pieces :] = d
        answer = linprog(
            cost,
            A_ub=matrix,
            b_ub=most,
            A_eq=equations,
            b_eq=np.zeros(self.order * pieces),
            bounds=self._ranges(low, high, H),
            method="highs",
            options=_SOLVER,
        )
        if answer.status != 0:
            return None
        return np.asarray(answer.x[start : start + pieces] * unit[self.order])

    def _bounds(self, unit: Array) -> tuple[Array, Array]:
        """The limits of position and its derivatives, in the program's units."""
        limits = [
            self.limits.position[0] - self.positions[0],
            self.limits.velocity[0],
            self.limits.acceleration[0],
            self.limits.jerk[0],
        ]
        pairs = np.array(limits[: self.order + 1])
        pairs[1:] *= 1 - _LIMIT_RTOL
        low, high = (pairs / unit[:, None]).T
        return low, high

    def _dynamics(self, d: Array) -> csr_array:
        """Taylor: `Σ_p x_(k + p)(i) d_i^p / p! − x_k(i + 1) = 0`, the last term of `u`."""
        pieces = len(d)
        row = np.arange(pieces)
        terms: list[_Term] = []
        for kind in range(self.order):
            rows = kind * pieces + row
            terms.append((rows, self._columns(kind, row + 1), np.full(pieces, -1.0)))
            for power in range(self.order - kind + 1):
                taylor = d**power / factorial(power)
                terms.append((rows, self._columns(kind + power, row), taylor))
        return self._matrix(terms, self.order * pieces)

    def _columns(self, kind: int, breaks: Indices) -> Indices:
        """Where the unknowns `x_kind` at some breaks stand; `u` after the states."""
        return np.asarray(kind * len(self.times) + breaks)

    def _matrix(self, terms: Sequence[_Term], rows: int) -> csr_array:
        """A matrix of all unknowns from its entries: rows, columns, values."""
        row, column, value = [np.concatenate(parts) for parts in zip(*terms, strict=True)]
        pieces = len(self.times) - 1
        unknowns = self.order * len(self.times) + 2 * pieces
        return csr_array((value, (row, column)), shape=(rows, unknowns))

    def _inside(self, d: Array, low: Array, high: Array) -> tuple[csr_array, Array] | None:
        """`A x ≤ b`: the inner Bernstein coefficients of each piece's position and velocity.

        Of a polynomial of degree n: `b_j = Σ_p C(j, p) / C(n, p) c_p d^p`, with `c_p d^p` its
        Taylor terms. Sides without a limit need no rows.
        """
        pieces = len(d)
        row = np.arange(pieces)
        terms: list[_Term] = []
        most: list[Array] = []
        for kind, side in product((0, 1), (-1, 1)):
            limit = low[kind] if side < 0 else high[kind]
            degree = self.order - kind
            if np.isinf(limit):
                continue
            for inner in range(1, degree):
                rows = pieces * len(most) + row
                most.append(np.full(pieces, side * limit))
                for power in range(inner + 1):
                    share = comb(inner, power) / comb(degree, power)
                    taylor = share * d**power / factorial(power)
                    terms.append((rows, self._columns(kind + power, row), side * taylor))
        if not terms:
            return None
        return self._matrix(terms, pieces * len(most)), np.concatenate(most)

    def _distances(self, planned: Array) -> tuple[csr_array, Array]:
        """`u − e ≤ ū` and `−u − e ≤ −ū`."""
        pieces = len(planned)
        row = np.arange(pieces)
        rates = self._columns(self.order, row)
        ones = np.ones(pieces)
        terms: list[_Term] = []
        for number, side in enumerate((1.0, -1.0)):
            rows = number * pieces + row
            terms.append((rows, rates, side * ones))
            terms.append((rows, rates + pieces, -ones))
        return self._matrix(terms, 2 * pieces), np.concatenate([planned, -planned])

    def _ranges(self, low: Array, high: Array, H: float) -> Array:
        """The range of every unknown: limits, rest at both ends, and the waypoints."""
        points = len(self.times)
        pieces = points - 1
        ranges = []
        for kind in range(self.order):
            states = np.tile([low[kind], high[kind]], (points, 1))
            if kind > 0:
                states[[0, -1]] = 0.0
            else:
                passed = (self.positions - self.positions[0]) / H
                states[self.passing] = passed[:, None]
            ranges.append(states)
        ranges.append(np.tile([low[-1], high[-1]], (pieces, 1)))
        ranges.append(np.tile([0.0, np.inf], (pieces, 1)))
        return np.concatenate(ranges)

    def _exact(self, rates: Array) -> Array:
        """The nearest rates that pass the waypoints and end at rest to the last bit or so.

        What `u` does to a derivative at time t: `Σ_i u_i ((t − t_i)^n − (t − t_(i+1))^n) / n!`.
        """
        T = self.times[-1]
        rows = []
        wanted = []
        for row, position in zip(self.passing[1:], self.positions[1:], strict=True):
            rows.append(self._response(self.times[row], self.order) / T**self.order)
            wanted.append((position - self.positions[0]) / T**self.order)
        for kind in range(1, self.order):
            power = self.order - kind
            rows.append(self._response(T, power) / T**power)
            wanted.append(0.0)
        matrix = np.array(rows)
        for _ in range(2):  # once more for what the first correction rounds
            residual = np.array(wanted) - matrix @ rates
            rates = rates + np.linalg.lstsq(matrix, residual, rcond=None)[0]
        return rates

    def _response(self, time: float, power: int) -> Array:
        """What a unit of each piece's rate adds to the derivative `order − power` at a time."""
        since = np.maximum(0.0, time - self.times) ** power
        return -np.diff(since) / factorial(power)

    def _states(self, rates: Array) -> Array:
        """Position and derivatives at the breaks, summed from the start; waypoints exactly."""
        states = np.empty((self.order, len(self.times)))
        for kind in range(self.order):
            power = self.order - kind
            for row, time in enumerate(self.times):
                states[kind, row] = self._response(time, power) @ rates
        states[0] += self.positions[0]
        states[0, self.passing] = self.positions
        states[1:, [0, -1]] = 0.0
        return states
