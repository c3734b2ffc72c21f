"""Small linear programs, one after another, by HiGHS.

Directly: SciPy checks and converts its arguments for longer than HiGHS solves a program of twenty
rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt.planners.planner import backend

Array = NDArray[np.float64]

# As many iterations as rows are usual; where rounding makes HiGHS go in circles, it has no answer.
_FEWEST_ALLOWED_ITERATIONS = 1_000
_ITERATIONS_PER_ROW = 10


class Entries(NamedTuple):
    """The entries of a matrix, row by row; any of them may be zero.

    Attributes:
        row: of each entry, never falling, `(entries,)`.
        column: of each entry.
        value: of each entry.
    """

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    value: Array


class LinearPrograms:
    """HiGHS, which solves one program at a time.

    Args:
        row_tolerance: what a row may be missed by, and a variable's bound.
    """

    def __init__(self, row_tolerance: float = 1e-7) -> None:
        self._solver = backend("highspy")
        self._highs = self._solver.Highs()
        options = {
            "output_flag": False,
            "threads": 1,
            "presolve": "off",
            "primal_feasibility_tolerance": row_tolerance,
        }
        for name, value in options.items():
            self._highs.setOptionValue(name, value)

    def minimised(
        self,
        cost: Array,
        matrix: Array,
        above: Array,
        high: Array,
    ) -> Array | None:
        """Where `cost · x` is least with `matrix x ≤ above` and `0 ≤ x ≤ high`, `(variables,)`.

        None where HiGHS finds no such place.
        """
        row, column = matrix.nonzero()
        entries = Entries(row, column, matrix[row, column])
        return self.minimised_sparse(
            cost,
            entries,
            above,
            high,
        )

    def minimised_sparse(
        self,
        cost: Array,
        entries: Entries,
        above: Array,
        high: Array,
    ) -> Array | None:
        """The same, of a matrix that is given by its entries."""
        rows = len(above)
        columns = len(cost)
        present = entries.value != 0
        row = entries.row[present]
        value = entries.value[present]
        row_starts = np.searchsorted(row, np.arange(rows + 1))
        no_offset = 0.0
        status = self._highs.passModel(
            columns,
            rows,
            len(value),
            int(self._solver.MatrixFormat.kRowwise),
            int(self._solver.ObjSense.kMinimize),
            no_offset,
            cost,
            np.zeros(columns),
            high,
            np.full(rows, -np.inf),
            above,
            row_starts,
            entries.column[present],
            value,
            np.full(columns, int(self._solver.HighsVarType.kContinuous)),
        )
        if status == self._solver.HighsStatus.kError:
            return None
        allowed = max(_FEWEST_ALLOWED_ITERATIONS, _ITERATIONS_PER_ROW * rows)
        self._highs.setOptionValue("simplex_iteration_limit", allowed)
        self._highs.run()
        if self._highs.getModelStatus() != self._solver.HighsModelStatus.kOptimal:
            return None
        return np.array(self._highs.getSolution().col_value)
