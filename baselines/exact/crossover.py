"""Local optima of the program of `exact.acceleration`, on the limits that are active there.

An interior-point method only tends to an active limit. Where a limit is active and its multiplier
is nothing, as where a joint speeds up throughout a segment, both go to zero as the root of the
barrier: the last half of all steps goes into that, and a ramp of 1e-7 of the segment remains. So
from near the optimum (`exact.interior_point`) Newton's method leads to it: rows whose multipliers
stay are equations, all others are left out (crossover; which ones, by the indicators of Tapia 1980:
from one step to the next a multiplier keeps its value or loses it), and so are those whose
multipliers turn negative. What comes out is taken where it is an optimum of the whole program; else
the interior-point method goes on, and this is tried again from nearer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from baselines.exact import interior_point
from baselines.exact.cells import ROW_AXES, Cells, Point, Rows, Scaled
from baselines.exact.interior_point import Arrived, Iterate, Start
from baselines.exact.newton_step import Linear

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# How far the interior-point method goes before this is tried: to gaps, of the duration, or its end.
_ATTEMPTS: tuple[Arrived, ...] = (
    partial(interior_point.near, gap_rtol=1e-5),
    partial(interior_point.near, gap_rtol=1e-7),
    partial(interior_point.near, gap_rtol=1e-9),
    interior_point.converged,
)
_MOST_STEPS = 6
_MISS_TOL = 1e-13
_KEPT = 0.75  # of an active row's multiplier, from one step to the next
_STIFFNESS = 1e3  # of an equation, in what its row weighed in the interior-point method
# What keeps the rest from moving further than it needs: the square of a row that leaves so much.
_LEAST_WEIGHT = 1e-10
_LEAST_SLACK = 1e-2
_LEAST_MULTIPLIER = 1e-15
# What rounding asks for, and what an interior-point method's tolerances do.
_ROUNDING_DILATION = 1 + 1e-12
_LARGEST_DILATION = 1 + 1e-9


OptimumT = TypeVar("OptimumT")


class Passage(NamedTuple):
    """A local optimum.

    Attributes:
        log: logarithms of the segment times in stop times, `(segments,)`.
        ends: velocities at the start and at the end of each segment, from its mean velocity, in
            units of its time, `(2, segments, joints)`.
    """

    log: Array
    ends: Array


def minimised(
    scaled: Scaled,
    starts: Sequence[Start],
    reached: Callable[[Passage, float], OptimumT | None],
) -> list[OptimumT | None]:
    """The local optimum near each start; None where there is none that the method converges to.

    Args:
        scaled: the problem.
        starts: segment times `(segments,)` and inner waypoint velocities
            `(segments - 1, joints)` to start from.
        reached: the optimum of a passage, None where limits ask for a larger dilation than this.
    """
    cells = Cells(scaled, len(starts))
    optima: list[OptimumT | None] = [None] * len(starts)
    running = np.arange(len(starts))
    # a method that diverges overflows: it has not converged
    with np.errstate(all="ignore"):
        iterate = interior_point.begun(cells, starts)
        for arrived in _ATTEMPTS:
            iterate = interior_point.descended(iterate, arrived)
            point, ended = _crossed(iterate)
            for i in np.flatnonzero(ended):
                optimum = reached(_passage(point, i), _ROUNDING_DILATION)
                optima[running[i]] = optimum
                ended[i] = optimum is not None
            if ended.all():
                return optima
            if ended.any():
                running = running[~ended]
                cells = Cells(scaled, len(running))
                iterate = iterate.of(~ended, cells)
        converged = interior_point.converged(iterate.state)
        for i in np.flatnonzero(converged):
            passage = _passage(iterate.state.rows.point, i)
            optima[running[i]] = reached(passage, _LARGEST_DILATION)
    return optima


def _passage(point: Point, start: np.intp) -> Passage:
    return Passage(point.log[start], point.ends[:, start])


def _crossed(iterate: Iterate) -> tuple[Point, Bools]:
    """Where Newton's method leads, and for which starts that is an optimum of the active rows."""
    state = iterate.state
    active = state.multipliers > _KEPT * iterate.before.multipliers
    # a row that is left out counts as one that leaves something
    leaves = state.slacks > _KEPT * iterate.before.slacks
    slacks = np.where(leaves, state.slacks, 1.0)
    slacks = np.maximum(slacks, _LEAST_SLACK)
    held = _LEAST_WEIGHT / slacks**2
    weights = np.where(active, _STIFFNESS * state.weights, held)
    multipliers = np.where(active, state.multipliers, _LEAST_MULTIPLIER)
    rows = state.rows
    convexity = iterate.convexity
    for _ in range(_MOST_STEPS):
        linear = Linear(rows, multipliers, weights)
        miss = np.where(active, rows.values, 0.0)
        largest = np.abs(miss).max(axis=ROW_AXES)
        met = np.maximum(largest, linear.apart) <= _MISS_TOL
        level = linear.slope(multipliers) <= interior_point.SLOPE_RTOL * rows.duration
        arrived = met & level
        bands, convexity = interior_point.factors(linear.matrices(), convexity)
        step, change = linear.step(bands, multipliers - weights * miss)
        # an equation's multiplier makes up for what the step leaves of its miss
        made_up = np.where(active, weights * (miss + change), 0.0)
        multipliers = multipliers - made_up
        pressing = (multipliers >= 0).all(axis=ROW_AXES)
        whole = np.ones(len(convexity))
        point = rows.cells.clipped(rows.point.moved(step, whole))
        rows = Rows(rows.cells, point)
        # after one step more: what the objective hardly feels was known to a tolerance's root
        if (arrived & pressing).all():
            break
        # an equation whose multiplier pulls is none
        active &= multipliers >= 0
        multipliers = np.where(active, multipliers, _LEAST_MULTIPLIER)
        weights = np.where(active, weights, held)
    return rows.point, arrived & pressing
