"""The program of `exact.acceleration` by a primal-dual interior-point method made for it.

IPOPT makes such steps with a general sparse solver; here each one eliminates what belongs to a
segment of a joint alone (`exact.cells`), at a twentieth of the cost. Slacks and multipliers of all
inequalities, Newton steps to a falling barrier parameter (Nocedal and Wright, Numerical
Optimization, chapter 19), and no line search: end velocities and peaks are clipped to where an
answer can have them instead. Where that does not converge it says so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # its parts are imported when they are used: listing needs none
from numpy.typing import NDArray

from baselines.exact.cells import Cells, Linear, Point, Scaled

Array = NDArray[np.float64]

_MOST_STEPS = 100
# Where the method has converged: what the objective, relative, and a constraint may miss.
_GAP_RTOL = 1e-12
_MISS_TOL = 1e-11
# Of the objective, whose error is the square of that.
_SLOPE_RTOL = 1e-8
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


class Optimum(NamedTuple):
    """Where the method ended.

    Attributes:
        converged: whether the point is a local optimum, to 1e-12 of the duration.
        steps: how many it took.
        point: the unknowns.
    """

    converged: bool
    steps: int
    point: Point


class _State(NamedTuple):
    """A point with what its rows leave, their slacks (one and the same at an answer), multipliers.

    One number per inequality each, `(rows,)`.
    """

    point: Point
    values: Array
    slacks: Array
    multipliers: Array

    @property
    def gap(self) -> float:
        """What the multipliers leave of the objective."""
        return float(self.slacks @ self.multipliers)

    @property
    def miss(self) -> Array:
        """What the slacks miss."""
        return np.asarray(self.values - self.slacks)

    @property
    def weights(self) -> Array:
        """What each row's square counts in a Newton step."""
        return np.asarray(self.multipliers / self.slacks)


def minimised(scaled: Scaled, times: Array, velocities: Array) -> Optimum:
    """The local optimum near a start, where the method converges.

    Args:
        scaled: the problem.
        times: segment times to start from, `(segments,)`.
        velocities: inner waypoint velocities to start from, `(segments - 1, joints)`.
    """
    cells = Cells(scaled)
    # a method that diverges overflows: it has not converged
    with np.errstate(all="ignore"):
        return _minimised(cells, times, velocities)


def _minimised(cells: Cells, times: Array, velocities: Array) -> Optimum:
    state = _start(cells, times, velocities)
    convexity = 0.0
    length = _START_LENGTH
    for steps in range(_MOST_STEPS):
        point = state.point
        if not np.isfinite(state.gap):
            break
        linear = cells.linear(
            point,
            state.multipliers,
            state.weights,
        )
        if _converged(linear, state):
            return Optimum(True, steps, point)
        factor, convexity = _factor(linear.matrix(), convexity)
        if convexity > _LARGEST_CONVEXITY:
            break
        left = max(1 - length, _LEAST_LEFT)
        wanted = left**_FALL_POWER * state.gap
        least = _LEAST_BARRIER_RTOL * linear.duration
        barrier = max(wanted, least) / len(state.slacks)
        state, length = _stepped(
            cells,
            linear,
            factor,
            state,
            barrier,
        )
    return Optimum(False, steps, point)


def _start(cells: Cells, times: Array, velocities: Array) -> _State:
    point = cells.start(times, velocities)
    values = cells.values(point)
    slacks = np.maximum(values, _START_SLACK)
    multipliers = _START_BARRIER / slacks
    return _State(
        point,
        values,
        slacks,
        multipliers,
    )


def _converged(linear: Linear, state: _State) -> bool:
    """Whether a point is a local optimum to the tolerances."""
    duration = linear.duration
    if state.gap > _GAP_RTOL * duration:
        return False
    largest = np.abs(state.miss).max()
    if max(largest, linear.apart) > _MISS_TOL:
        return False
    slope = linear.slope(state.multipliers)
    return slope <= _SLOPE_RTOL * duration


def _factor(matrix: Array, last: float) -> tuple[Array, float]:
    """The Cholesky factor of a band, and the last addition to its diagonal that had to be made."""
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


def _stepped(
    cells: Cells,
    linear: Linear,
    factor: Array,
    state: _State,
    barrier: float,
) -> tuple[_State, float]:
    """The state after a Newton step to `slack × multiplier = barrier`, and its length, up to 1."""
    slacks = state.slacks
    multipliers = state.multipliers
    miss = state.miss
    aim = barrier / slacks
    step, change = linear.step(factor, aim - state.weights * miss)
    slack_step = change + miss
    relaxed = state.weights * slack_step
    multiplier_step = aim - multipliers - relaxed

    farthest = np.abs(step.log).max()
    shortened = _LONGEST_STEP / max(farthest, _LONGEST_STEP)
    forwards = min(shortened, _longest(slacks, slack_step))
    upwards = _longest(multipliers, multiplier_step)
    moved = state.point.moved(step, forwards)
    point = cells.clipped(moved)
    values = cells.values(point)
    # a row that leaves more than its slack says keeps it
    slacks = slacks + forwards * slack_step
    slacks = np.maximum(slacks, values)
    aim = barrier / slacks
    lowest = aim / _MULTIPLIER_SPREAD
    highest = aim * _MULTIPLIER_SPREAD
    multipliers = multipliers + upwards * multiplier_step
    multipliers = np.clip(multipliers, lowest, highest)
    stepped = _State(
        point,
        values,
        slacks,
        multipliers,
    )
    return stepped, min(forwards, upwards)


def _longest(values: Array, step: Array) -> float:
    """How far along a step, at most all of it, no value loses more than its share."""
    losses = -step / values
    fastest = losses.max()
    return float(_TO_BOUNDARY / max(fastest, _TO_BOUNDARY))
