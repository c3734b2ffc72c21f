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
        coefficients = rows.coefficients * self.units[rows.columns]
        self.row_units = _row_units(coefficients)
        scaled = coefficients / self.row_units[:, None]
        self.program = Linear(
            solver,
            box.low / self.units,
            box.high / self.units,
            _sparse(rows.columns, scaled, len(self.units), nothing),
            below=np.full(len(self.row_units), -np.inf),
            above=rows.bounds / self.row_units,
        )

    def suits(self, box: Box) -> bool:
        """Whether its units are still those of a box, about."""
        ratios = _reach(box) / self.units
        return bool(np.abs(np.log2(ratios)).max() < np.log2(_OUTGROWN_FACTOR))

    def minimised(self, objective: Array) -> Answer:
        """The minimum of `objective · x`, at a point of the box.

        Raises:
            TrajoptError: HiGHS breaks down.
        """
        scaled = objective * self.units
        unit = powers_of_two(np.abs(scaled).max())
        answer = self.program.minimised(scaled / unit)
        if answer.x is None:
            return answer._replace(multipliers=answer.multipliers / self.row_units)
        return Answer(
            x=answer.x * self.units,
            value=float(answer.value * unit),
            multipliers=answer.multipliers * unit / self.row_units,
        )

    def set_box(self, box: Box) -> None:
        """Another box; the rows that enclose its curves are to be set too."""
        self.program.set_box(box.low / self.units, box.high / self.units)

    def set_row(self, number: int, rows: Rows) -> None:
        """One of the first rows, as it is in another box."""
        columns = rows.columns[number]
        coefficients = rows.coefficients[number] * self.units[columns]
        unit = _row_units(coefficients)
        self.row_units[number] = unit
        used = columns != self.nothing
        self.program.set_row(
            number,
            columns[used],
            coefficients[used] / unit,
            float(rows.bounds[number] / unit),
        )

    def breaks(self, rows: Rows, x: Array) -> NDArray[np.bool_]:
        """Which rows a point breaks by so much that HiGHS sees it."""
        coefficients = rows.coefficients * self.units[rows.columns]
        values = (rows.coefficients * x[rows.columns]).sum(axis=1)
        violations = (values - rows.bounds) / _row_units(coefficients)
        return np.asarray(violations > _BROKEN)

    def add_row(self, row: Rows) -> bool:
        """One more row after the last one; false if HiGHS refuses it, for its numbers."""
        columns = row.columns[0]
        coefficients = row.coefficients[0] * self.units[columns]
        unit = _row_units(coefficients)
        used = columns != self.nothing
        taken = self.program.add_row(
            columns[used],
            coefficients[used] / unit,
            float(row.bounds[0] / unit),
        )
        if taken:
            self.row_units = np.append(self.row_units, unit)
        return taken

    def drop_rows(self, numbers: Indices) -> None:
        """Without these rows; those after them move up."""
        self.program.drop_rows(numbers)
        self.row_units = np.delete(self.row_units, numbers)


def _reach(box: Box) -> Array:
    """The powers of two next to how far a box's variables get from 0."""
    farthest = np.maximum(np.abs(box.low), np.abs(box.high))
    return powers_of_two(farthest)


def _row_units(coefficients: Array) -> Array:
    """The powers of two next to rows' largest coefficients."""
    largest = np.abs(coefficients).max(axis=-1)
    return powers_of_two(largest)


def _sparse(columns: Indices, coefficients: Array, variables: int, nothing: int) -> Any:
    """Rows as SciPy's matrix."""
    count, entries = columns.shape
    numbers = np.repeat(np.arange(count), entries)
    places = columns.ravel()
    used = places != nothing
    return scipy.sparse.csr_matrix(
        (coefficients.ravel()[used], (numbers[used], places[used])),
        shape=(count, variables),
    )
