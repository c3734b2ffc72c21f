"""A linear program that is solved again and again, by HiGHS."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt.core.exceptions import TrajoptError

Array = NDArray[np.float64]

# HiGHS's own, for bounds and rows, primal and dual.
TOLERANCE = 1e-9
# Where it ends without an answer.
_LARGER_TOLERANCE = 1e-7


class Answer(NamedTuple):
    """A minimum, or why there is none.

    Attributes:
        x: The variables; None if no point meets the rows.
        value: The minimum; infinite if no point meets the rows.
        multipliers: Of the rows `≤`, not negative: those that prove the value, or (as a ray) that
            there is no point.
    """

    x: Array | None
    value: float
    multipliers: Array


class Linear:
    """HiGHS with a program in it; each minimum starts from the last one's basis."""

    def __init__(
        self,
        solver: Any,
        low: Array,
        high: Array,
        matrix: Any,
        below: Array,
        above: Array,
    ) -> None:
        """Of variables between `low` and `high`, and `below ≤ matrix x ≤ above`.

        Args:
            solver: The module `highspy`.
            low, high: `(variables,)`.
            matrix: SciPy's sparse, in rows, `(rows, variables)`.
            below, above: `(rows,)`.
        """
        program = solver.HighsLp()
        program.num_col_ = len(low)
        program.num_row_ = len(below)
        program.col_cost_ = np.zeros(len(low))
        program.col_lower_ = low
        program.col_upper_ = high
        program.row_lower_ = below
        program.row_upper_ = above
        program.a_matrix_.format_ = solver.MatrixFormat.kRowwise
        program.a_matrix_.start_ = matrix.indptr
        program.a_matrix_.index_ = matrix.indices
        program.a_matrix_.value_ = matrix.data
        self.solver = solver
        self.highs = solver.Highs()
        self.variables = np.arange(len(low), dtype=np.int32)
        options = {
            "output_flag": False,
            "threads": 1,
            "presolve": "off",
        }
        for name, value in options.items():
            self.highs.setOptionValue(name, value)
        self._tolerate(TOLERANCE)
        self.highs.passModel(program)

    def minimised(self, objective: Array) -> Answer:
        """The minimum of `objective · x`.

        Raises:
            TrajoptError: HiGHS breaks down.
        """
        self.highs.changeColsCost(len(self.variables), self.variables, objective)
        status = self._run()
        words = self.solver.HighsModelStatus
        if status not in (words.kOptimal, words.kInfeasible):
            status = self._run_anew()
        if status == words.kOptimal:
            solution = self.highs.getSolution()
            multipliers = -np.array(solution.row_dual)
            value = float(self.highs.getInfo().objective_function_value)
            return Answer(np.array(solution.col_value), value, multipliers)
        if status == words.kInfeasible:
            return Answer(None, np.inf, self._ray())
        raise TrajoptError(f"HiGHS ended with {status}")

    def _run(self) -> Any:
        self.highs.run()
        return self.highs.getModelStatus()

    def _run_anew(self) -> Any:
        """From scratch, with more tolerance if need be: a basis that went bad is left behind.

        Any multipliers are a proof of something.
        """
        words = self.solver.HighsModelStatus
        status = words.kUnknown
        for tolerance in (TOLERANCE, _LARGER_TOLERANCE):
            self._tolerate(tolerance)
            self.highs.clearSolver()
            status = self._run()
            if status in (words.kOptimal, words.kInfeasible):
                break
        self._tolerate(TOLERANCE)
        return status

    def _tolerate(self, tolerance: float) -> None:
        for name in ("primal_feasibility_tolerance", "dual_feasibility_tolerance"):
            self.highs.setOptionValue(name, tolerance)

    def _ray(self) -> Array:
        """Multipliers that prove that no point meets the rows; zeros where HiGHS has none."""
        _, exists, ray = self.highs.getDualRay()
        if not exists:
            return np.zeros(self.highs.getNumRow())
        return -np.array(ray)

    def set_box(self, low: Array, high: Array) -> None:
        """Other bounds of all variables."""
        self.highs.changeColsBounds(len(self.variables), self.variables, low, high)

    def set_row(self, number: int, columns: Any, coefficients: Array, bound: float) -> None:
        """Another row `≤` in the place of one with the same columns."""
        for column, coefficient in zip(columns.tolist(), coefficients.tolist(), strict=True):
            self.highs.changeCoeff(number, column, coefficient)
        self.highs.changeRowBounds(number, -np.inf, bound)

    def drop_rows(self, numbers: Any) -> None:
        """Without these rows; those after them move up."""
        indices = numbers.astype(np.int32)
        self.highs.deleteRows(len(indices), indices)

    def add_row(self, columns: Any, coefficients: Array, bound: float) -> bool:
        """Another row `≤` after the last one; false if HiGHS refuses it, for its numbers."""
        indices = columns.astype(np.int32)
        status = self.highs.addRow(-np.inf, bound, len(indices), indices, coefficients)
        return bool(status != self.solver.HighsStatus.kError)
