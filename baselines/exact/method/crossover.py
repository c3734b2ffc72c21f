"""Local optima of the programs of a chain of cells, on the limits that are active there.

An interior-point method only tends to an active limit. Where a limit is active and its multiplier
is zero, as where a joint speeds up throughout a segment, both fall as the root of the barrier: the
last half of all steps goes into that, and a ramp of 1e-7 of the segment remains.

So from near the optimum (`exact.method.interior_point`) Newton's method leads to it. Rows whose
multipliers stay are equations, all others are left out, and so are rows whose multipliers become
negative. Which rows these are the indicators of Tapia (1980) tell: from one step to the next the
multiplier of an active row keeps its value. The result is taken where it is an optimum of the
whole program. Else the interior-point method goes on, and this is tried again from nearer.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numpy as np

from baselines.exact.method import interior_point
from baselines.exact.method.interior_point import ROW_AXES, Arrived, Inequalities, Iterate
from trajopt.core.arrays import Bools

# Crossover is tried at these gaps, relative to the duration, and where the method has converged.
ATTEMPTS: tuple[Arrived, ...] = (
    partial(interior_point.near, gap_rtol=1e-5),
    partial(interior_point.near, gap_rtol=1e-7),
    partial(interior_point.near, gap_rtol=1e-9),
    interior_point.converged,
)
MAX_STEPS = 6
MISS_TOL = 1e-13
# Largest entry of the Lagrangian's gradient, relative to the duration.
SLOPE_RTOL = 1e-8
# An active row keeps this share of its multiplier from one step to the next.
MIN_KEPT_MULTIPLIER = 0.75
# Weight of an equation, relative to its row's weight in the interior-point method.
STIFFNESS = 1e3
# Weight of a row that is left out, times its slack squared: it keeps the rest from moving further
# than it needs.
FREE_WEIGHT = 1e-10
MIN_SLACK = 1e-2
FREE_MULTIPLIER = 1e-15
# Dilations that are accepted: for rounding, and for the interior-point method's tolerances.
ROUNDING_DILATION = 1 + 1e-12
MAX_DILATION = 1 + 1e-9


OptimumT = TypeVar("OptimumT")


def minimised(
    rows: Inequalities, reached: Callable[[Any, int, float], OptimumT | None]
) -> list[OptimumT | None]:
    """The local optimum near each start; None where the method does not converge.

    Args:
        rows: the program at all starts.
        reached: the optimum of one of the starts of some rows, None where limits ask for a larger
            dilation than this.
    """
    starts = len(rows.times)
    optima: list[OptimumT | None] = [None] * starts
    running = np.arange(starts)
    # a method that diverges overflows: it has not converged
    with np.errstate(all="ignore"):
        iterate = interior_point.begun(rows)
        for arrived in ATTEMPTS:
            iterate = interior_point.descended(iterate, arrived)
            crossed, ended = _crossed(iterate)
            for i in np.flatnonzero(ended).tolist():
                optimum = reached(crossed, i, ROUNDING_DILATION)
                optima[running[i]] = optimum
                ended[i] = optimum is not None
            if ended.all():
                return optima
            running = running[~ended]
            iterate = iterate.of(~ended)
        for i in np.flatnonzero(interior_point.converged(iterate)).tolist():
            optima[running[i]] = reached(iterate.state.rows, i, MAX_DILATION)
    return optima


def _crossed(iterate: Iterate) -> tuple[Inequalities, Bools]:
    """Newton's method on the active rows, and which starts have reached an optimum of them."""
    state = iterate.state
    active = state.multipliers > MIN_KEPT_MULTIPLIER * iterate.before.multipliers
    # a row that is left out counts as inactive
    inactive = state.slacks > MIN_KEPT_MULTIPLIER * iterate.before.slacks
    slacks = np.maximum(np.where(inactive, state.slacks, 1.0), MIN_SLACK)
    free = FREE_WEIGHT / slacks**2
    weights = np.where(active, STIFFNESS * state.weights, free)
    multipliers = np.where(active, state.multipliers, FREE_MULTIPLIER)
    rows = state.rows
    whole = np.ones(len(rows.times))
    for _ in range(MAX_STEPS):
        linear = rows.linear(multipliers, weights)
        miss = np.where(active, rows.values, 0.0)
        missed = np.abs(miss).max(axis=ROW_AXES)
        met = np.maximum(missed, rows.apart) <= MISS_TOL
        slope_tol = SLOPE_RTOL * rows.times.sum(axis=1)
        arrived = met & (linear.slope(multipliers) <= slope_tol)
        step, change = linear.step(multipliers - weights * miss)
        # an equation's multiplier makes up for what the step leaves of its miss
        multipliers = multipliers - np.where(active, weights * (miss + change), 0.0)
        positive = (multipliers >= 0).all(axis=ROW_AXES)
        rows = rows.after(step, whole)
        # after one step more: what the objective hardly feels was known to a tolerance's root
        if (arrived & positive).all():
            break
        # a row whose multiplier is negative is no equation
        active &= multipliers >= 0
        multipliers = np.where(active, multipliers, FREE_MULTIPLIER)
        weights = np.where(active, weights, free)
    return rows, np.asarray(arrived & positive)
