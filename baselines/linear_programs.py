"""Small linear programs, one after another, by HiGHS.

Directly: SciPy checks and converts its arguments for longer than HiGHS solves a program of twenty
rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trajopt.planner import backend

Array = NDArray[np.float64]


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
        rows, columns = matrix.shape
        program = self._solver.HighsLp()
        program.num_col_ = columns
        program.num_row_ = rows
        program.col_cost_ = cost
        program.col_lower_ = np.zeros(columns)
        program.col_upper_ = high
        program.row_lower_ = np.full(rows, -np.inf)
        program.row_upper_ = above
        # column by column, without zeros
        column, row = matrix.T.nonzero()
        program.a_matrix_.format_ = self._solver.MatrixFormat.kColwise
        program.a_matrix_.start_ = np.searchsorted(column, range(columns + 1))
        program.a_matrix_.index_ = row
        program.a_matrix_.value_ = matrix[row, column]
        self._highs.passModel(program)
        self._highs.run()
        if self._highs.getModelStatus() != self._solver.HighsModelStatus.kOptimal:
            return None
        return np.array(self._highs.getSolution().col_value)
