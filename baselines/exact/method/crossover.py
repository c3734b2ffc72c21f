"""Crossover: from near a local optimum to it, on the limits that are active there.

An interior-point method only approaches an active limit. Where a limit is active and its multiplier
is zero, slack and multiplier both fall as the square root of the barrier. A joint that accelerates
throughout a segment has such a limit. Half of all steps would go into it, and a ramp of 1e-7 of the
segment would remain.

So crossover takes over near the optimum, in three steps:

1. *Guess the active set.* In a step of the interior point an active inequality keeps its
   multiplier, and an inactive one keeps its slack. A degenerate one halves both. These are the
   indicators of Tapia (1980).
2. *Solve.* Newton's method solves the active inequalities as equations. The inactive ones are left
   out. An inequality whose multiplier becomes negative leaves the active set.
3. *Check.* The result is accepted if it is an optimum of the whole program and its motion is
   reachable. Otherwise the interior point goes on, and crossover is tried again nearer the optimum.

A worked example is in docs/implementation-notes.md, "Crossover".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from baselines.exact.method import interior_point
from baselines.exact.method.interior_point import ROW_AXES, Arrived, Inequalities, Iterate
from trajopt.core.arrays import Array, Bools, Indices

# Crossover is tried at these gaps, relative to the duration, and where the method has converged.
# Larger: the active set is guessed wrong, and the attempt is in vain. Smaller: more steps before.
ATTEMPTS: tuple[Arrived, ...] = (
    partial(interior_point.near, gap_rtol=1e-5),
    partial(interior_point.near, gap_rtol=1e-7),
    partial(interior_point.near, gap_rtol=1e-9),
    interior_point.converged,
)
# Newton's method converges quadratically. Fewer: correct guesses fail. More: wrong ones cost more.
MAX_STEPS = 6
# Largest residual of an equation, or of a link between cells, that counts as zero. Smaller:
# rounding is above it, and nothing crosses. Larger: the motion needs a dilation.
RESIDUAL_TOL = 1e-13
# Largest entry of the Lagrangian's gradient at an optimum, relative to the duration. The error of
# the duration is of its square.
STATIONARITY_RTOL = 1e-8
# Tapia's indicators: an active inequality keeps this share of its multiplier in a step, an inactive
# one this share of its slack. A degenerate one keeps half, so it is in neither set above 0.5.
# Halved: more attempts fail. Above 1 nothing is active.
MIN_KEPT = 0.75
# Weight of an equation, relative to the weight of its inequality in the interior-point method.
# Smaller: the residual falls more slowly. Larger: the matrix is worse conditioned.
STIFFNESS = 1e3
# Weight of an inactive inequality, times its slack squared. It keeps an unknown that no equation
# determines from moving. Larger: it moves the others. Smaller: it is lost in rounding. A slack
# counts as no less than `MIN_SLACK`, so that its weight stays small.
FREE_WEIGHT = 1e-10
MIN_SLACK = 1e-2
FREE_MULTIPLIER = 1e-15  # of an inactive inequality, instead of 0
# Largest dilation of an accepted motion: after crossover, and without it. Larger: durations are
# above the optimum by as much. Smaller: solved problems are refused for rounding.
MAX_DILATION_CROSSED = 1 + 1e-12
MAX_DILATION_CONVERGED = 1 + 1e-9

OptimumT = TypeVar("OptimumT")


def minimised(
    start: Inequalities,
    reached: Callable[[Any, Indices, float], Sequence[OptimumT | None]],
    problems: Indices | None = None,
) -> list[OptimumT | None]:
    """Return the local optimum near each initial guess; None where the method does not converge.

    Args:
        start: The program at all initial guesses.
        reached: Returns the optima of some guesses from the program's inequalities at these, the
            guesses' numbers and the largest dilation allowed; None for one whose motion needs a
            larger one.
        problems: The number of each guess's problem, `(starts,)`; by default one for all. The
            answer to a problem does not depend on the others.
    """
    starts = len(start.times)
    optima: list[OptimumT | None] = [None] * starts
    running = np.arange(starts)  # indices of the initial guesses without an optimum

    def take(rows: Inequalities, there: Bools, largest_dilation: float) -> None:
        some = running[there]
        if some.size:
            rows = rows if there.all() else rows.of(there)
            for i, optimum in zip(some, reached(rows, some, largest_dilation), strict=True):
                optima[i] = optimum

    # A diverging method overflows; it then counts as not converged.
    with np.errstate(all="ignore"):
        iterate = interior_point.begun(start)
        for arrived in ATTEMPTS:
            numbers = None if problems is None else problems[running]
            iterate = interior_point.descended(iterate, arrived, problems=numbers)
            take(*_crossed(iterate, numbers), MAX_DILATION_CROSSED)
            left = np.array([optima[i] is None for i in running])
            if not left.any():
                return optima
            iterate = iterate.of(left)
            running = running[left]
        take(iterate.state.rows, interior_point.converged(iterate), MAX_DILATION_CONVERGED)
    return optima


def _crossed(iterate: Iterate, problems: Indices | None = None) -> tuple[Inequalities, Bools]:
    """Return the program after Newton's method on the active set, and which guesses converged.

    A problem's guesses take their steps until all of them have converged.
    """
    state = iterate.state
    active = state.multipliers > MIN_KEPT * iterate.before.multipliers
    free = _free_weights(iterate)
    weights = np.where(active, STIFFNESS * state.weights, free)
    multipliers = np.where(active, state.multipliers, FREE_MULTIPLIER)
    rows = state.rows
    length = np.ones(len(rows.times))  # 0 once all guesses of the problem are there
    optimal = np.zeros(len(length), dtype=bool)
    for _ in range(MAX_STEPS):
        linear = rows.linear(multipliers, weights)
        residual = np.where(active, rows.values, 0.0)
        largest_residual = np.abs(residual).max(axis=ROW_AXES)
        feasible = np.maximum(largest_residual, rows.apart) <= RESIDUAL_TOL
        stationary = linear.slope(multipliers) <= STATIONARITY_RTOL * rows.times.sum(axis=1)
        step, change = linear.step(multipliers - weights * residual)
        # The multiplier of an equation takes up the residual that the step leaves.
        multipliers = multipliers - np.where(active, weights * (residual + change), 0.0)
        right_sign = (multipliers >= 0).all(axis=ROW_AXES)
        optimal = np.where(length > 0, feasible & stationary & right_sign, optimal)
        # The last step is taken too: before it, degenerate directions are accurate to the root of
        # the tolerance only.
        rows = rows.after(step, length)
        if optimal.all():
            break
        if problems is not None and optimal.any():
            length = np.isin(problems, problems[~optimal]).astype(float)
        active &= multipliers >= 0
        multipliers = np.where(active, multipliers, FREE_MULTIPLIER)
        weights = np.where(active, weights, free)
    return rows, optimal


def _free_weights(iterate: Iterate) -> Array:
    """Return the weights of inequalities that are left out of the active set.

    That of an inactive one falls with its slack. A degenerate one gets the weight of a slack of 1.
    """
    slacks = iterate.state.slacks
    inactive = slacks > MIN_KEPT * iterate.before.slacks
    return FREE_WEIGHT / np.maximum(np.where(inactive, slacks, 1.0), MIN_SLACK) ** 2
