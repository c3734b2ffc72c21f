"""The linear program over a box, in units that suit the box.

HiGHS's tolerances are absolute, and a segment of 1e-10 s beside one of 1 s has an inverse of 1e10.
So every variable counts in the power of two next to what its box reaches to, every row in that of
its largest coefficient, and the objective likewise: the tolerances are then worth the same
everywhere, and the units round nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # its parts are imported when they are used: listing needs none
from numpy.typing import NDArray

from baselines.lower_bound.linear import TOLERANCE, Answer, Linear
from baselines.lower_bound.relaxation import Box, Rows, powers_of_two

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# A box whose variables reach to less than a unit's share of this, or to more, asks for other units.
_OUTGROWN_FACTOR = 16.0
# What breaks a row by less, in its unit, HiGHS takes for met.
_BROKEN = 4 * TOLERANCE


class ScaledProgram:
    """Rows `≤` over a box; all that comes in or goes out counts in the caller's units.

    Attributes:
        nothing: The variable that is always 0: entries of rows that multiply it are left out.
        units: Of the variables, `(variables,)`.
        row_units: What each row was divided by, `(rows,)`.
    """

    def __init__(self, solver: Any, box: Box, rows: Rows, nothing: int) -> None:
        self.nothing = nothing
        self.units = _reach(box)
        counted, self.row_units = self._counted(rows)
        variables = len(self.units)
        self.program = Linear(
            solver,
            box.low / self.units,
            box.high / self.units,
            matrix=_sparse(counted, variables, nothing),
            below=np.full(len(counted.bounds), -np.inf),
            above=counted.bounds,
        )

    def _counted(self, rows: Rows) -> tuple[Rows, Array]:
        """Rows in the program's units, and what each was divided by."""
        coefficients = rows.coefficients * self.units[rows.columns]
        largest = np.abs(coefficients).max(axis=1)
        row_units = powers_of_two(largest)
        counted = Rows(
            rows.columns,
            coefficients / row_units[:, None],
            rows.bounds / row_units,
        )
        return counted, row_units

    def suits(self, box: Box) -> bool:
        """Whether its units are still those of a box, about."""
        ratios = _reach(box) / self.units
        smallest = ratios.min()
        largest = ratios.max()
        return bool(smallest > 1 / _OUTGROWN_FACTOR and largest < _OUTGROWN_FACTOR)

    def minimised(self, objective: Array) -> Answer:
        """The minimum of `objective · x`.

        Raises:
            TrajoptError: HiGHS breaks down.
        """
        costs = objective * self.units
        largest = np.abs(costs).max()
        unit = powers_of_two(largest)
        answer = self.program.minimised(costs / unit)
        per_row = answer.multipliers / self.row_units
        if answer.x is None:
            return answer._replace(multipliers=per_row)
        return Answer(
            x=answer.x * self.units,
            value=float(answer.value * unit),
            multipliers=per_row * unit,
        )

    def set_box(self, box: Box) -> None:
        """Another box; the rows that enclose its curves are to be set too."""
        low = box.low / self.units
        high = box.high / self.units
        self.program.set_box(low, high)

    def set_row(self, number: int, row: Rows) -> None:
        """Another one in the place of one of the first rows, with the same columns."""
        counted, row_units = self._counted(row)
        self.row_units[number] = row_units[0]
        self.program.set_row(number, *self._entries(counted))

    def add_row(self, row: Rows) -> bool:
        """One more row after the last one; false if HiGHS refuses it, for its numbers."""
        counted, row_units = self._counted(row)
        taken = self.program.add_row(*self._entries(counted))
        if taken:
            self.row_units = np.append(self.row_units, row_units)
        return taken

    def _entries(self, counted: Rows) -> tuple[Indices, Array, float]:
        """Columns, coefficients and bound of one row, without what multiplies nothing."""
        columns, coefficients, bound = counted.row(0)
        used = columns != self.nothing
        return columns[used], coefficients[used], bound

    def breaks(self, rows: Rows, x: Array) -> NDArray[np.bool_]:
        """Which rows a point breaks by so much that HiGHS sees it."""
        counted, _ = self._counted(rows)
        point = x / self.units
        terms = counted.coefficients * point[rows.columns]
        violations = terms.sum(axis=1) - counted.bounds
        return np.asarray(violations > _BROKEN)

    def drop_rows(self, numbers: Indices) -> None:
        """Without these rows; those after them move up."""
        self.program.drop_rows(numbers)
        self.row_units = np.delete(self.row_units, numbers)


def _reach(box: Box) -> Array:
    """The powers of two next to how far a box's variables get from 0."""
    farthest = np.maximum(np.abs(box.low), np.abs(box.high))
    return powers_of_two(farthest)


def _sparse(rows: Rows, variables: int, nothing: int) -> Any:
    """Their coefficients as SciPy's matrix."""
    count, entries = rows.columns.shape
    numbers = np.repeat(np.arange(count), entries)
    columns = rows.columns.ravel()
    values = rows.coefficients.ravel()
    used = columns != nothing
    places = (numbers[used], columns[used])
    return scipy.sparse.csr_matrix(
        (values[used], places),
        shape=(count, variables),
    )
