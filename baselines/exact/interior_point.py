"""The program of `exact.acceleration` by a primal-dual interior-point method made for it.

IPOPT makes such steps with a general sparse solver; here each one eliminates what belongs to a
segment of a joint alone (`exact.newton_step`), at a twentieth of the cost. Slacks and multipliers
of all inequalities, Newton steps to a falling barrier parameter (Nocedal and Wright, Numerical
Optimization, chapter 19), and no line search: end velocities and peaks are clipped to where an
answer can have them instead. Several starts take their steps together, each at its own barrier and
length. Where that does not converge it says so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.exact.cells import ROW_AXES, Cells, Rows
from baselines.exact.newton_step import Linear

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Start = tuple[Array, Array]  # segment times, inner waypoint velocities

_MOST_STEPS = 100
# Where the method has converged: what the objective, relative, and a constraint may miss.
_GAP_RTOL = 1e-12
_MISS_TOL = 1e-11
# Of the objective, whose error is the square of that.
SLOPE_RTOL = 1e-8
_LEAST_BARRIER_RTOL = 1e-13
_START_BARRIER = 0.1
_START_SLACK = 0.1
_START_LENGTH = 0.5
# The barrier falls to this power of what the last step left of its way, not below the least.
_FALL_POWER = 1.5
_LEAST_LEFT = 0.02
_TO_BOUNDARY = 0.99  # of the way to where a slack or a multiplier vanishes
_LONGEST_STEP = 2.0  # of the logarithm of a segment time
_MULTIPLIER_SPREAD = 1e10  # of a multiplier from barrier over slack, either way
# What is added to the diagonal where the matrix is not positive definite, and how it changes.
_START_CONVEXITY = 1e-4
_MORE_CONVEXITY = 8.0
_LESS_CONVEXITY = 3.0
_LARGEST_CONVEXITY = 1e12


@dataclass(frozen=True, eq=False)
class State:
    """A point with its rows' slacks (what they leave, at an answer) and multipliers.

    One number per inequality each, `(2 kinds, 2 sides, starts, segments, joints)`.
    """

    rows: Rows
    slacks: Array
    multipliers: Array

    @cached_property
    def gap(self) -> Array:
        """What the multipliers leave of the objective, `(starts,)`."""
        products = self.slacks * self.multipliers
        return np.asarray(products.sum(axis=ROW_AXES))

    @cached_property
    def miss(self) -> Array:
        """What the slacks miss."""
        return np.asarray(self.rows.values - self.slacks)

    @cached_property
    def weights(self) -> Array:
        """What each row's square counts in a Newton step."""
        return np.asarray(self.multipliers / self.slacks)

    @cached_property
    def linear(self) -> Linear:
        """The model of a Newton step from here."""
        return Linear(self.rows, self.multipliers, self.weights)

    def of(self, some: Bools, cells: Cells) -> State:
        """The state of some of the starts; `cells` of as many."""
        return State(
            Rows(cells, self.rows.point.of(some)),
            self.slacks[:, :, some],
            self.multipliers[:, :, some],
        )


class Iterate(NamedTuple):
    """How far some starts are.

    Attributes:
        state: where they are.
        before: where they were before the last step.
        convexity: what was last added to the diagonal of each one's matrix, `(starts,)`.
        length: of each one's last step, up to 1, `(starts,)`.
        steps: how many there were.
    """

    state: State
    before: State
    convexity: Array
    length: Array
    steps: int

    @property
    def lost(self) -> Bools:
        """Which starts have diverged, `(starts,)`."""
        diverged = ~np.isfinite(self.state.gap)
        return np.asarray(diverged | (self.convexity > _LARGEST_CONVEXITY))

    def of(self, some: Bools, cells: Cells) -> Iterate:
        """Some of the starts; `cells` of as many."""
        return Iterate(
            self.state.of(some, cells),
            self.before.of(some, cells),
            self.convexity[some],
            self.length[some],
            self.steps,
        )


Arrived = Callable[[State], Bools]
"""Which starts need no more steps, `(starts,)`."""


def begun(cells: Cells, starts: Sequence[Start]) -> Iterate:
    """No step yet.

    Args:
        cells: the problem, for as many starts.
        starts: segment times `(segments,)` and inner waypoint velocities
            `(segments - 1, joints)` to start from.
    """
    times = np.array([start[0] for start in starts])
    velocities = np.array([start[1] for start in starts])
    point = cells.start(times, velocities)
    rows = Rows(cells, point)
    slacks = np.maximum(rows.values, _START_SLACK)
    state = State(rows, slacks, _START_BARRIER / slacks)
    return Iterate(
        state,
        state,
        convexity=np.zeros(len(starts)),
        length=np.full(len(starts), _START_LENGTH),
        steps=0,
    )


def descended(iterate: Iterate, arrived: Arrived) -> Iterate:
    """Steps until every start has arrived or is lost."""
    while iterate.steps < _MOST_STEPS:
        if (arrived(iterate.state) | iterate.lost).all():
            break
        iterate = _stepped(iterate)
    return iterate


def near(state: State, gap_rtol: float) -> Bools:
    """Which points' gaps are as small a share of their durations, `(starts,)`."""
    return np.asarray(state.gap <= gap_rtol * state.rows.duration)


def converged(state: State) -> Bools:
    """Which points are local optima to the tolerances, `(starts,)`."""
    closed = near(state, _GAP_RTOL)
    if not closed.any():
        return closed
    linear = state.linear
    largest = np.abs(state.miss).max(axis=ROW_AXES)
    closed &= np.maximum(largest, linear.apart) <= _MISS_TOL
    level = linear.slope(state.multipliers) <= SLOPE_RTOL * state.rows.duration
    return np.asarray(closed & level)


def factors(matrices: Array, last: Array) -> tuple[list[Array], Array]:
    """The Cholesky factor of every band, and what was last added to its diagonal."""
    bands = []
    added = []
    for matrix, before in zip(matrices, last, strict=True):
        factor, convexity = _factor(matrix, before)
        bands.append(factor)
        added.append(convexity)
    return bands, np.array(added)


def _factor(matrix: Array, last: float) -> tuple[Array, float]:
    """The Cholesky factor of a band, and the last addition to its diagonal that had to be made."""
    import scipy  # late: planners that are only listed need none of it

    if last > _LARGEST_CONVEXITY:
        return matrix, last
    factor, failed = scipy.linalg.lapack.dpbtrf(matrix, lower=1)
    if not failed:
        return factor, last
    added = max(_START_CONVEXITY, last / _LESS_CONVEXITY)
    while failed and added <= _LARGEST_CONVEXITY:
        convex = matrix.copy()
        convex[0] += added
        factor, failed = scipy.linalg.lapack.dpbtrf(convex, lower=1)
        last = added
        added *= _MORE_CONVEXITY
    if failed:
        return factor, np.inf
    return factor, last


def _stepped(iterate: Iterate) -> Iterate:
    """After a Newton step to `slack × multiplier = barrier`."""
    state = iterate.state
    rows = state.rows
    slacks = state.slacks
    multipliers = state.multipliers
    weights = state.weights
    miss = state.miss
    linear = state.linear
    left = np.maximum(1 - iterate.length, _LEAST_LEFT)
    wanted = left**_FALL_POWER * state.gap
    least = _LEAST_BARRIER_RTOL * rows.duration
    barrier = np.maximum(wanted, least) / rows.cells.rows
    by_cell = barrier[:, None, None]

    bands, convexity = factors(linear.matrices(), iterate.convexity)
    aim = by_cell / slacks
    step, change = linear.step(bands, aim - weights * miss)
    slack_step = change + miss
    relaxed = weights * slack_step
    multiplier_step = aim - multipliers - relaxed

    farthest = np.abs(step.log).max(axis=1)
    shortened = _LONGEST_STEP / np.maximum(farthest, _LONGEST_STEP)
    forwards = np.minimum(shortened, _longest(slacks, slack_step))
    upwards = _longest(multipliers, multiplier_step)
    moved = rows.point.moved(step, forwards)
    rows = Rows(rows.cells, rows.cells.clipped(moved))
    # a row that leaves more than its slack says keeps it
    slacks = slacks + forwards[:, None, None] * slack_step
    slacks = np.maximum(slacks, rows.values)
    aim = by_cell / slacks
    multipliers = multipliers + upwards[:, None, None] * multiplier_step
    multipliers = np.maximum(multipliers, aim / _MULTIPLIER_SPREAD)
    multipliers = np.minimum(multipliers, aim * _MULTIPLIER_SPREAD)
    return Iterate(
        State(rows, slacks, multipliers),
        state,
        convexity,
        length=np.minimum(forwards, upwards),
        steps=iterate.steps + 1,
    )


def _longest(values: Array, step: Array) -> Array:
    """How far along a step, at most all of it, no value loses more than its share, `(starts,)`."""
    gains = step / values
    fastest = -gains.min(axis=ROW_AXES)
    return np.asarray(_TO_BOUNDARY / np.maximum(fastest, _TO_BOUNDARY))
