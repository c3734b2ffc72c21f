"""A proof of a lower bound: a tree of boxes and multipliers; and the bounds of single steps.

The relaxation has inequalities `A x ≤ b`. The multipliers `y ≥ 0` of a step bound an objective `c`:

    c x ≥ (c + Aᵀ y) x − bᵀ y ≥ min over the box of (c + Aᵀ y) x, less bᵀ y.

The search computes this in floats, less the rounding. The bound of a finished proof is computed by
the kernel (`trajopt.judging.check_proof`), in exact fractions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from baselines.lower_bound import costates
from baselines.lower_bound.costates import Cut
from baselines.lower_bound.relaxation import (
    ROUNDING_RTOL,
    ROW_ENTRIES,
    BoundConstraints,
    Relaxation,
    VariableBounds,
)
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.judging import proved_bounds
from trajopt.judging.check_proof import OPTIONAL, TABLES

# Kinds of steps of a proof. Steps are stored in the order of a walk through the tree.
RAISE = 0
LOWER = 1
BRANCH = 2
LEAF = 3

_PREFIX = "proof_"
# Smallest size of a multiplier that is not 0; found proofs need 2e-30 to 9e17.
SMALLEST = 2.0**-128
# Rounding of an operation, relative; and extra operations for a row's own entries.
_EPSILON = 2.0**-52
_ENTRY_ROUNDINGS = 32


@dataclass(frozen=True, eq=False)
class BoundProof:
    """A proof of a lower bound; all arrays of floats, as they are stored with the trial.

    Attributes:
        units: The unit of time, s, then of each moving joint's lengths, rad; powers of two.
        cutoff: The proof is about motions shorter than this, s, `(1,)`.
        tangents: Segment and place of each tangent to `1/T`, `(tangents, 2)`.
        square_tangents: Segment and place of each square tangent of `jerk_rows`; optional.
        ramps: Segment, joint and side of each ramp of `jerk_rows`, `(ramps, 3)`; optional.
        cuts: Segment, joint and number of cells of each row of costates, `(cuts, 3)`.
        cells: Their cells one after the other, `(cells, 7)`: those of `costates.row` without rates.
        waypoints: Numbers of the waypoints that it counts, from 0, `(waypoints,)`; optional, by
            default all but those that rounding may miss.
        joints: Numbers of the joints that it counts, from 0, `(joints,)`; optional, by default all.
        rates: Number of a cell and the rate of its `λ`, `(rates, 2)`; optional, 0 elsewhere.
        steps: Kind, variable, value and number of multipliers, `(steps, 4)`. `RAISE` and `LOWER`
            move a side of the box to the value, or as far as the multipliers prove if that is less
            or the value is 0; `BRANCH` splits the box at the value, the lower part first; `LEAF`
            bounds the time in what is left.
        multipliers: Row and value, `(multipliers, 2)`; rows count those of the box first (the
            cut-off, secants, McCormick's), then square tangents, tangents, ramps, cuts.
    """

    units: Array
    cutoff: Array
    tangents: Array
    cuts: Array
    cells: Array
    steps: Array
    multipliers: Array
    square_tangents: Array = field(default_factory=lambda: np.zeros((0, 2)))
    ramps: Array = field(default_factory=lambda: np.zeros((0, 3)))
    rates: Array = field(default_factory=lambda: np.zeros((0, 2)))
    waypoints: Array = field(default_factory=lambda: np.zeros(0))
    joints: Array = field(default_factory=lambda: np.zeros(0))

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by the names under which a trial stores them."""
        stored = {_PREFIX + name: value for name, value in vars(self).items()}
        for name in ("rates", "waypoints", "joints"):
            if not stored[_PREFIX + name].size:
                del stored[_PREFIX + name]
        return stored

    @classmethod
    def stored(cls, stats: Mapping[str, Any]) -> BoundProof | None:
        """Return the proof among a trial's statistics, if there is one.

        Raises:
            InvalidInput: A part is missing, or has the wrong shape.
        """
        if _PREFIX + "steps" not in stats:
            return None
        given = {name.removeprefix(_PREFIX) for name in stats if name.startswith(_PREFIX)}
        unknown = given - TABLES.keys()
        if unknown:
            right = f"a proof of {', '.join(TABLES)}"
            raise InvalidInput(f"stats, {_PREFIX}{min(unknown)}", right)
        found = {}
        for name, columns in TABLES.items():
            if name in OPTIONAL and name not in given:
                continue
            value = _numbers(stats.get(_PREFIX + name))
            if columns and not value.size:
                value = value.reshape(0, columns)
            shape = (value.size,) if columns == 0 else (len(np.atleast_1d(value)), columns)
            if value.shape != shape or not np.isfinite(value).all():
                raise InvalidInput(f"stats, {_PREFIX}{name}", "a table of finite numbers")
            found[name] = value
        return cls(**found)


def _numbers(value: Any) -> Array:
    """Return a value as an array of floats; NaN if it cannot be one."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.array(np.nan)


def proved_bound(problem: Problem, proof: BoundProof) -> float:
    """Return the lower bound that a proof proves, s: no motion within all limits takes less.

    Args:
        problem: Consecutive identical waypoints count once. Waypoints that a motion may miss by
            rounding (`trajopt.core.resolution`) are left out.
        proof: The proof; a wrong one proves a smaller bound or is refused.

    Raises:
        InvalidInput: The proof is not one of this problem, or not in order.
    """
    return proved_bounds.proved_bound(problem, vars(proof))


def cuts(relaxation: Relaxation, given: Sequence[Cut]) -> BoundConstraints:
    """Return the inequalities of the proof's costates.

    Raises:
        InvalidInput: The cells do not divide the segment, the joint has no jerk limit and `p` is
            not 0, or it has no falling velocity limit and `λ` has a rate.
    """
    rows = relaxation.blank(len(given))
    counts = np.array([len(row.cells) for row in given], dtype=int)
    for number, row in enumerate(given):
        _check_cells(relaxation, row)
        columns = relaxation.row_columns(row.segment, row.joint)
        rows.columns[number, : len(columns)] = columns
    for count in np.unique(counts):
        numbers = np.flatnonzero(counts == count).tolist()
        alike = costates.Costates(
            segments=np.array([given[number].segment for number in numbers]),
            joints=np.array([given[number].joint for number in numbers]),
            cells=np.stack([costates.with_rates(given[number].cells) for number in numbers]),
        )
        coefficients, bounds = costates.rows(relaxation, alike)
        rows.coefficients[numbers, : relaxation.row_entries] = coefficients
        rows.bounds[numbers] = bounds
    _count_given_with_time(relaxation, rows, given)
    return rows


def _count_given_with_time(
    relaxation: Relaxation, rows: BoundConstraints, given: Sequence[Cut]
) -> None:
    """Replace `α = a T` by its multiple of `T` where the acceleration `a` at an end is given.

    The rounding of the sum of both coefficients is subtracted for the longest `T`.
    """
    for entry in (ROW_ENTRIES - 2, ROW_ENTRIES - 1):
        (numbers,) = np.nonzero(rows.columns[:, entry] == rows.columns[:, 0])
        if not len(numbers):
            continue
        cut = [given[number] for number in numbers.tolist()]
        factors = [relaxation.row_factors(own.segment, own.joint) for own in cut]
        added = rows.coefficients[numbers, entry] * np.array(factors)[:, entry]
        size = np.abs(rows.coefficients[numbers, 0]) + np.abs(added)
        bounds = rows.bounds[numbers]
        rounding = ROUNDING_RTOL * (size * relaxation.cutoff + np.abs(bounds))
        rows.bounds[numbers] = bounds + rounding
        rows.coefficients[numbers, 0] += added
        rows.coefficients[numbers, entry] = 0.0
        rows.columns[numbers, entry] = relaxation.nothing


def _check_cells(relaxation: Relaxation, row: Cut) -> None:
    starts = row.cells[:, 0]
    ordered = bool(len(starts)) and starts[0] == 0.0 and starts[-1] < 1.0
    if not ordered or not (np.diff(starts) > 0).all():
        raise InvalidInput("proof cells", "starts that rise from 0 to below 1")
    if not relaxation.limited[row.segment, row.joint] and row.cells[:, 1:4].any():
        raise InvalidInput("proof cells", "no p for a joint without jerk limits")
    falls = not np.isnan(relaxation.falling.offset[row.joint])
    if not falls and row.cells[:, costates.RATE :].any():
        right = "no rate of λ for a joint without a falling velocity limit"
        raise InvalidInput("proof rates", right)


def dual_bound(
    objective: Array, box: VariableBounds, rows: BoundConstraints, multipliers: Array
) -> float:
    """Return the lower bound of an objective on a box that multipliers prove, rounded down.

    Args:
        objective: `(variables,)`.
        box: The variables' bounds.
        rows: The rows used.
        multipliers: `(rows,)`; negative ones count as 0.
    """
    y = np.maximum(multipliers, 0.0)
    unbounded = np.isinf(box.high)
    if unbounded.any():
        # where a segment may take no time, its inverse bounds nothing
        y = np.where((unbounded[rows.columns] & (rows.coefficients != 0)).any(axis=1), 0.0, y)
        box = VariableBounds(*(np.where(unbounded, 0.0, side) for side in box))
    terms = y[:, None] * rows.coefficients
    places = rows.columns.ravel()
    variables = len(objective)
    reduced = objective + np.bincount(places, terms.ravel(), variables)
    sizes = np.abs(objective) + np.bincount(places, np.abs(terms).ravel(), variables)
    least = np.minimum(reduced * box.low, reduced * box.high)
    farthest = np.maximum(np.abs(box.low), np.abs(box.high))
    of_bounds = y * rows.bounds
    value = least.sum() - of_bounds.sum()
    size = (sizes * farthest).sum() + np.abs(of_bounds).sum()
    roundings = len(y) + variables + _ENTRY_ROUNDINGS
    bound = float(value - roundings * _EPSILON * size)
    return bound if np.isfinite(bound) else -np.inf


def branched(
    relaxation: Relaxation, box: VariableBounds, column: int, value: float
) -> tuple[VariableBounds, VariableBounds]:
    """Return both parts of a box, split at a value of one variable."""
    high = box.high.copy()
    high[column] = min(high[column], value)
    low = box.low.copy()
    low[column] = max(low[column], value)
    lower = _completed(relaxation, VariableBounds(box.low, high))
    upper = _completed(relaxation, VariableBounds(low, box.high))
    return lower, upper


def moved(
    relaxation: Relaxation, box: VariableBounds, column: int, raises: bool, bound: float
) -> VariableBounds:
    """Return the box with one side moved as far as a bound on `x` (or on `−x`) proves."""
    low = box.low.copy()
    high = box.high.copy()
    if raises:
        low[column] = max(low[column], bound)
    else:
        high[column] = min(high[column], -bound)
    return _completed(relaxation, VariableBounds(low, high))


def is_empty(box: VariableBounds) -> bool:
    """Return whether a box holds no point."""
    return bool((box.low > box.high).any())


def _completed(relaxation: Relaxation, box: VariableBounds) -> VariableBounds:
    """Complete a box unless it is empty."""
    return box if is_empty(box) else relaxation.completed(box)
