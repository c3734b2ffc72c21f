"""A proof of a lower bound: a tree of boxes and multipliers, checked without a solver.

The relaxation has inequalities `A x ≤ b`. The multipliers `y ≥ 0` of a step bound an objective `c`:

    c x ≥ (c + Aᵀ y) x − bᵀ y ≥ min over the box of (c + Aᵀ y) x, less bᵀ y.

This holds for any multipliers, so the check does not depend on the solver. The rounding of the
arithmetic is bounded by the sizes of all terms and subtracted. That requires numbers of moderate
size: other numbers are refused, and so is any overflow or underflow (docs/mathematics.md,
section 5c).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from baselines.lower_bound import costates, jerk_rows
from baselines.lower_bound.apart import relaxed
from baselines.lower_bound.costates import Cut
from baselines.lower_bound.jerk_rows import Ramp, SquareTangent
from baselines.lower_bound.relaxation import (
    ROUNDING_RTOL,
    ROW_ENTRIES,
    BoundConstraints,
    Relaxation,
    VariableBounds,
    joined,
)
from trajopt.core.arrays import Array, Bools
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.planners.reductions import RESTING_JOINTS, SIMPLEST

# Kinds of steps of a proof. Steps are stored in the order of a walk through the tree.
RAISE = 0
LOWER = 1
BRANCH = 2
LEAF = 3

_PREFIX = "proof_"
# Smallest and largest size of a proof's numbers that are not 0; found proofs need 2e-30 to 9e17.
SMALLEST = 2.0**-128
LARGEST = 2.0**128
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

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by the names under which a trial stores them."""
        stored = {_PREFIX + name: value for name, value in vars(self).items()}
        for name in ("rates", "waypoints"):
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
        unknown = given - _SHAPES.keys()
        if unknown:
            right = f"a proof of {', '.join(_SHAPES)}"
            raise InvalidInput(f"stats, {_PREFIX}{min(unknown)}", right)
        found = {}
        for name, columns in _SHAPES.items():
            if name in _LATER and name not in given:
                continue
            value = _numbers(stats.get(_PREFIX + name))
            if columns and not value.size:
                value = value.reshape(0, columns)
            shape = (value.size,) if columns == 0 else (len(np.atleast_1d(value)), columns)
            if value.shape != shape or not np.isfinite(value).all():
                raise InvalidInput(f"stats, {_PREFIX}{name}", "a table of finite numbers")
            found[name] = value
        return cls(**found)


_SHAPES = {
    "units": 0,
    "cutoff": 0,
    "tangents": 2,
    "cuts": 3,
    "cells": costates.CELL_COLUMNS,
    "steps": 4,
    "multipliers": 2,
    "square_tangents": 2,
    "ramps": 3,
    "rates": 2,
    "waypoints": 0,
}


def _numbers(value: Any) -> Array:
    """Return a value as an array of floats; NaN if it cannot be one."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.array(np.nan)


# Columns that hold counts or numbers of something.
_WHOLE = {
    "tangents": [0],
    "cuts": [0, 1, 2],
    "steps": [0, 1, 3],
    "multipliers": [0],
    "square_tangents": [0],
    "ramps": [0, 1, 2],
    "rates": [0],
    "waypoints": slice(None),
}
# Tables that a proof may lack.
_LATER = ("square_tangents", "ramps", "rates", "waypoints")


class _ProofRows(NamedTuple):
    """A proof's own rows: square tangents, which change with the box, and all others."""

    squares: list[SquareTangent]
    others: BoundConstraints

    def with_box(self, relaxation: Relaxation, box: VariableBounds) -> BoundConstraints:
        """Return all rows of a step, in the order in which multipliers count them."""
        of_box = relaxation.box_rows(box)
        squares = jerk_rows.square_rows(relaxation, self.squares, box)
        return joined([of_box, squares, self.others])


def proved_bound(problem: Problem, proof: BoundProof) -> float:
    """Return the lower bound that a proof proves, s: no motion within all limits takes less.

    Args:
        problem: Consecutive identical waypoints count once. Waypoints that a motion may miss by
            rounding (`trajopt.core.resolution`) are left out.
        proof: The proof; a wrong one proves a smaller bound or is refused.

    Raises:
        InvalidInput: The proof is not one of this problem, or not in order.
    """
    _check_numbers(proof)
    try:
        # without overflow or underflow an operation's error is half a unit in its last place
        with np.errstate(all="raise"):
            numbers = proof.waypoints.astype(np.intp) if proof.waypoints.size else None
            through = relaxed(SIMPLEST.apply(problem), numbers)
            relaxation = relaxation_of(RESTING_JOINTS.apply(through), proof)
            rows = _proof_rows(relaxation, proof)
            lowest = _walked(relaxation, rows, proof)
    except ArithmeticError as error:
        right = "numbers that neither overflow nor underflow"
        raise InvalidInput("proof", right, value=str(error)) from error
    # a unit is a power of two: nothing is rounded here
    bound = min(lowest, relaxation.cutoff) * relaxation.time_unit
    waits = float(relaxation.waits.sum())
    return (bound + waits) * (1 - ROUNDING_RTOL) if waits else bound


def _check_numbers(proof: BoundProof) -> None:
    """Refuse numbers that are not of moderate size, and counts that are not whole."""
    for name, table in vars(proof).items():
        sizes = np.abs(table)
        moderate = (sizes >= SMALLEST) & (sizes <= LARGEST)
        _refuse(name, table, ~moderate & (table != 0), "0, or of a size from 2^-128 to 2^128")
        whole = table[..., _WHOLE.get(name, [])]
        _refuse(name, whole, whole != np.rint(whole), "whole, where something is counted")


def _refuse(name: str, table: Array, wrong: Bools, right: str) -> None:
    if wrong.any():
        raise InvalidInput(f"proof {name}", f"numbers that are {right}", value=table[wrong][0])


def relaxation_of(problem: Problem, proof: BoundProof) -> Relaxation:
    """Return the relaxation that a proof is about."""
    if proof.cutoff.shape != (1,) or not proof.cutoff[0] > 0:
        raise InvalidInput("proof cutoff", "one positive number", value=proof.cutoff.tolist())
    if not proof.units.size:
        raise InvalidInput("proof units", "a time and lengths")
    time_unit, *lengths = proof.units.tolist()
    return Relaxation(problem, float(proof.cutoff[0]), time_unit, np.array(lengths))


def _proof_rows(relaxation: Relaxation, proof: BoundProof) -> _ProofRows:
    squares = []
    for segment, at in proof.square_tangents.tolist():
        _check_place(at)
        number = _index(segment, relaxation.segments)
        squares.append(SquareTangent(number, at))
    parts = [relaxation.blank(0)]
    for segment, at in proof.tangents.tolist():
        _check_place(at)
        number = _index(segment, relaxation.segments)
        parts.append(relaxation.tangent(number, at))
    for row in proof.ramps.tolist():
        given = _ramp(relaxation, *row)
        parts.append(jerk_rows.ramp_row(relaxation, given))
    parts.append(_cuts(relaxation, proof))
    return _ProofRows(squares, joined(parts))


def _check_place(at: float) -> None:
    if not at > 0:
        raise InvalidInput("proof tangents", "places above 0", value=at)


def _ramp(relaxation: Relaxation, segment: float, joint: float, side: float) -> Ramp:
    ramp = Ramp(
        _index(segment, relaxation.segments), _index(joint, relaxation.joints), _index(side, 2)
    )
    if not np.isfinite(relaxation.j[ramp.side, ramp.segment, ramp.joint]):
        raise InvalidInput("proof ramps", "joints with a jerk limit on that side", value=joint)
    return ramp


def _cuts(relaxation: Relaxation, proof: BoundProof) -> BoundConstraints:
    first = 0
    given = []
    cells = costates.with_rates(proof.cells)
    for cell, rate in proof.rates.tolist():
        cells[_index(cell, len(cells)), costates.RATE] = rate
    for segment, joint, count in proof.cuts.tolist():
        k = _index(segment, relaxation.segments)
        j = _index(joint, relaxation.joints)
        last = first + _index(count, len(proof.cells) - first + 1)
        broken = Cut(k, j, cells[first:last])
        given.append(broken)
        first = last
    return cuts(relaxation, given)


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


def _walked(relaxation: Relaxation, rows: _ProofRows, proof: BoundProof) -> float:
    """Walk through the tree and return the lowest bound of its leaves."""
    box = relaxation.root_box()
    if is_empty(box):
        raise InvalidInput("proof cutoff", "a time in which every segment can be passed")
    pending = [box]
    lowest = np.inf
    first = 0
    for kind, variable, value, count in proof.steps.tolist():
        if not pending:
            raise InvalidInput("proof steps", "no step after the last leaf")
        box = pending.pop()
        last = first + _index(count, len(proof.multipliers) - first + 1)
        own = proof.multipliers[first:last]
        first = last
        if kind not in (RAISE, LOWER, BRANCH, LEAF):
            raise InvalidInput("proof steps", "kinds from 0 to 3", value=kind)
        if kind == BRANCH:
            column = _branchable(relaxation, variable)
            pending += reversed(branched(relaxation, box, column, value))
        elif kind == LEAF:
            bound = _step_bound(relaxation, rows, box, relaxation.total(), own)
            lowest = min(lowest, bound)
        else:
            column = _branchable(relaxation, variable)
            objective = np.zeros(relaxation.variables)
            objective[column] = 1.0 if kind == RAISE else -1.0
            bound = _step_bound(relaxation, rows, box, objective, own)
            if value != 0:
                bound = min(bound, objective[column] * value)
            pending.append(moved(relaxation, box, column, kind == RAISE, bound))
    if pending:
        raise InvalidInput("proof steps", "a leaf at the end of every branch")
    return lowest


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


def _step_bound(
    relaxation: Relaxation,
    rows: _ProofRows,
    box: VariableBounds,
    objective: Array,
    multipliers: Array,
) -> float:
    """Return the bound that a step's multipliers prove; infinity on an empty box."""
    if is_empty(box):
        return np.inf
    every = rows.with_box(relaxation, box)
    numbers = multipliers[:, 0]
    wrong = (numbers < 0) | (numbers >= len(every.bounds))
    _refuse("multipliers", numbers, wrong, "rows that exist, counted from 0")
    used = every.chosen(numbers.astype(np.intp))
    return dual_bound(objective, box, used, multipliers[:, 1])


def _index(value: float, count: int) -> int:
    """Return a whole number from 0 to below `count`, or refuse it."""
    if not 0 <= value < count or value != int(value):
        raise InvalidInput("proof", f"a whole number from 0 to {count - 1}", value=value)
    return int(value)


def _branchable(relaxation: Relaxation, variable: float) -> int:
    return _index(variable, relaxation.nothing)
