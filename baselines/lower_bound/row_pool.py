"""The relaxation's linear program over one box: the box's inequalities, and those found so far.

Inequalities that were found hold in every box, so the pool keeps each of them for the proof. The
program itself keeps only those with a multiplier in one of the last programs. The others are found
again if they are violated again.

HiGHS's tolerances are absolute, and a segment of 1e-10 s beside one of 1 s has an inverse of 1e10.
So every variable is in units of the power of two next to the largest size in its box. Every row is
in units of its largest coefficient, and so is the objective. The tolerances are then relative, and
scaling by powers of two is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy  # its submodules are imported when they are used: listing planners does not need them

from baselines.linear_programs import TOLERANCE, LinearOptimum, LinearProgram
from baselines.lower_bound import dual_check
from baselines.lower_bound.costates import RATE, Cut, with_rates
from baselines.lower_bound.jerk_rows import Ramp, SquareTangent, ramp_row, square_rows
from baselines.lower_bound.relaxation import (
    BoundConstraints,
    Relaxation,
    VariableBounds,
    joined,
    powers_of_two,
)
from trajopt.core.arrays import Array, Bools, Indices

# A row without a multiplier in this many programs is dropped; number of programs between checks.
_MAX_IDLE_PROGRAMS = 40
_PROGRAMS_PER_LOOK = 20
# HiGHS accepts a smaller violation of a row, in the row's unit.
_VISIBLE_VIOLATION = 4 * TOLERANCE


class Tangent(NamedTuple):
    """A tangent to `1/T` of a segment, at a time."""

    segment: int
    at: float


Source = Tangent | SquareTangent | Ramp | Cut
# Order of the inequalities in a proof.
_KINDS: list[type] = [SquareTangent, Tangent, Ramp, Cut]


class ProvedRows(NamedTuple):
    """The inequalities with multipliers, by index in box and pool, and the bound they prove."""

    rows: Indices
    multipliers: Array
    bound: float


class RowPool:
    """The linear program over one box at a time.

    Attributes:
        box_count: Number of rows that enclose a box; the pool's rows are counted after them.
        programs: Number of linear programs solved.
        found: The pool's rows, one by one.
        sources: What each of them was made from.
        present: The pool's rows in the program, in the program's order.
        used_at: Number of the last program in which each of the pool's rows had a multiplier.
        units: Units of the variables, `(variables,)`.
        row_units: Units of the program's rows.
    """

    def __init__(self, relaxation: Relaxation, box: VariableBounds) -> None:
        self.relaxation = relaxation
        self.programs = 0
        self.found: list[BoundConstraints] = []
        self.sources: list[Source] = []
        self.present: list[int] = []
        self.used_at: list[int] = []
        self.box = box
        self.box_rows = relaxation.box_rows(box)
        self.box_count = len(self.box_rows.bounds)
        self._set_up()

    # --- the program ---

    def _set_up(self) -> None:
        """Make a new program in units that suit the box."""
        self.units = _farthest(self.box)
        every = joined([self.box_rows, *(self.found[number] for number in self.present)])
        rows, self.row_units = self._in_units(every)
        used = rows.columns != self.relaxation.nothing
        numbers, _ = np.nonzero(used)
        places = (numbers, rows.columns[used])
        shape = (len(rows.bounds), len(self.units))
        self.program = LinearProgram()
        self.program.load(
            self.box.low / self.units,
            self.box.high / self.units,
            matrix=scipy.sparse.csr_matrix((rows.coefficients[used], places), shape),
            above=np.where(self._says_something(rows), rows.bounds, np.inf),
        )

    def _says_something(self, rows: BoundConstraints) -> Bools:
        """Return which rows have no variable whose bounds are infinite."""
        unbounded = np.isinf(self.box.high)[rows.columns]
        return np.asarray(~(unbounded & (rows.coefficients != 0)).any(axis=1))

    def _in_units(self, rows: BoundConstraints) -> tuple[BoundConstraints, Array]:
        """Return rows in the program's units, and the unit of each."""
        coefficients = rows.coefficients * self.units[rows.columns]
        row_units = powers_of_two(np.abs(coefficients).max(axis=1))
        coefficients /= row_units[:, None]
        return BoundConstraints(rows.columns, coefficients, rows.bounds / row_units), row_units

    def enter(self, box: VariableBounds) -> None:
        """Use another box from now on."""
        self.box = box
        self.box_rows = self.relaxation.box_rows(box)
        self._renew_squares()
        basis = self.program.basis()
        self._set_up()
        self.program.begin_at(basis)

    def _renew_squares(self) -> None:
        """Compute the rows of the square tangents again: they depend on the box."""
        numbers = []
        squares = []
        for number, source in enumerate(self.sources):
            if isinstance(source, SquareTangent):
                numbers.append(number)
                squares.append(source)
        rows = square_rows(self.relaxation, squares, self.box)
        for place, number in enumerate(numbers):
            self.found[number] = rows.single(place)

    def minimised(self, objective: Array) -> LinearOptimum:
        """Return the minimum, with multipliers of the box's rows and then of all the pool's.

        Raises:
            TrajoptError: HiGHS breaks down.
        """
        self.programs += 1
        costs = objective * self.units
        unit = float(powers_of_two(np.abs(costs).max()))
        answer = self.program.minimised(costs / unit)
        of_pool = np.array(self.present, dtype=np.intp)
        numbers = np.append(np.arange(self.box_count), self.box_count + of_pool)
        multipliers = np.zeros(self.box_count + len(self.found))
        multipliers[numbers] = answer.multipliers / self.row_units
        for number in of_pool[answer.multipliers[self.box_count :] > 0]:
            self.used_at[number] = self.programs
        if self.programs % _PROGRAMS_PER_LOOK == 0:
            self._drop_idle()
        if answer.x is None:
            return answer._replace(multipliers=multipliers)
        # HiGHS may leave the box by its tolerance
        inside = np.clip(answer.x * self.units, self.box.low, self.box.high)
        return LinearOptimum(inside, answer.value * unit, multipliers * unit)

    # --- rows ---

    def _drop_idle(self) -> None:
        oldest = self.programs - _MAX_IDLE_PROGRAMS
        kept = [number for number in self.present if self.used_at[number] >= oldest]
        if len(kept) < len(self.present):
            self.present = kept
            self._set_up()

    def add(self, sources: Sequence[Source]) -> None:
        """Add the rows of sources of one kind."""
        self._add(sources, self._rows_of(sources))

    def add_violated(self, sources: Sequence[Source], x: Array) -> None:
        """Add the rows of one kind that a point violates by more than HiGHS's tolerance."""
        rows = self._rows_of(sources)
        scaled, _ = self._in_units(rows)
        terms = scaled.coefficients * (x / self.units)[rows.columns]
        violated = terms.sum(axis=1) - scaled.bounds > _VISIBLE_VIOLATION
        numbers = np.flatnonzero(violated)
        self._add([sources[number] for number in numbers.tolist()], rows.chosen(numbers))

    def _rows_of(self, sources: Sequence[Any]) -> BoundConstraints:
        """Return the rows of sources of one kind."""
        match sources:
            case [SquareTangent(), *_]:
                return square_rows(self.relaxation, sources, self.box)
            case [Cut(), *_]:
                return dual_check.cuts(self.relaxation, sources)
            case [Ramp(), *_]:
                return joined([ramp_row(self.relaxation, ramp) for ramp in sources])
        tangents = [self.relaxation.tangent(*tangent) for tangent in sources]
        return joined([self.relaxation.blank(0), *tangents])

    def _add(self, sources: Sequence[Source], rows: BoundConstraints) -> None:
        for number, source in enumerate(sources):
            row = rows.single(number)
            if self._append(row):
                self.present.append(len(self.found))
                self.used_at.append(self.programs)
                self.found.append(row)
                self.sources.append(source)

    def _append(self, row: BoundConstraints) -> bool:
        """Append a row to the program; return whether HiGHS accepts its numbers."""
        scaled, row_unit = self._in_units(row)
        used = scaled.columns[0] != self.relaxation.nothing
        above = float(scaled.bounds[0]) if self._says_something(row).all() else np.inf
        accepted = self.program.add_row(
            scaled.columns[0, used], scaled.coefficients[0, used], above
        )
        if accepted:
            self.row_units = np.append(self.row_units, row_unit)
        return accepted

    # --- proofs ---

    def proved(self, objective: Array, multipliers: Array) -> ProvedRows:
        """Return the bound of an objective on the box that multipliers prove."""
        used = np.flatnonzero(multipliers > 0)
        of_box = used[used < self.box_count]
        of_pool = used[used >= self.box_count] - self.box_count
        rows = joined([self.box_rows.chosen(of_box), *(self.found[n] for n in of_pool)])
        bound = dual_check.dual_bound(objective, self.box, rows, multipliers[used])
        return ProvedRows(used, multipliers[used], bound)

    def tables(self, used: Indices) -> tuple[dict[str, Array], Indices]:
        """Return the rows used as a proof stores them, and the new numbers of all rows."""

        def kind(number: int) -> int:
            return _KINDS.index(type(self.sources[number]))

        of_pool = used[used >= self.box_count] - self.box_count
        ordered = sorted(of_pool.tolist(), key=kind)
        numbers = np.arange(self.box_count + len(self.found))
        numbers[self.box_count + np.array(ordered, dtype=np.intp)] = self.box_count + np.arange(
            len(ordered)
        )
        by_kind: dict[type, list[Any]] = {own: [] for own in _KINDS}
        for number in ordered:
            by_kind[type(self.sources[number])].append(self.sources[number])
        heads = [(cut.segment, cut.joint, len(cut.cells)) for cut in by_kind[Cut]]
        every = (with_rates(cut.cells) for cut in by_kind[Cut])
        cells = np.concatenate([np.zeros((0, RATE + 1)), *every])
        sloping = np.flatnonzero(cells[:, RATE])
        tables = {
            "square_tangents": _table(by_kind[SquareTangent], 2),
            "tangents": _table(by_kind[Tangent], 2),
            "ramps": _table(by_kind[Ramp], 3),
            "cuts": _table(heads, 3),
            "cells": cells[:, :RATE],
            "rates": np.column_stack([sloping, cells[sloping, RATE]]),
        }
        return tables, numbers


def _table(rows: Sequence[Sequence[float]], columns: int) -> Array:
    return np.array(rows, dtype=float).reshape(-1, columns)


def _farthest(box: VariableBounds) -> Array:
    """Return the powers of two next to the largest sizes of a box's variables, if finite."""
    sizes = np.maximum(np.abs(box.low), np.abs(box.high))
    return powers_of_two(np.where(np.isfinite(sizes), sizes, 1.0))
