"""Linear programs that are solved again and again, by HiGHS.

HiGHS is called directly: SciPy's checks and conversions take longer than HiGHS takes for a program
of twenty rows.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import TrajoptError
from trajopt.planners.planner import backend

# Absolute feasibility tolerances of HiGHS, primal and dual: the usual one, and a second attempt's.
TOLERANCE = 1e-9
_SECOND_TOLERANCE = 1e-7
# Rounding can make the simplex method cycle; it is stopped after this many iterations.
_MIN_ITERATIONS = 10_000
_ITERATIONS_PER_ROW = 10
_STANDARD_OUTPUT = 1


class LinearOptimum(NamedTuple):
    """The minimum of a linear program, or the proof that no point satisfies its rows.

    Attributes:
        x: The variables; None if no point satisfies the rows.
        value: The minimum; infinite if no point satisfies the rows.
        multipliers: One per row `≤`, not negative. They prove the value, or they are a ray that
            proves that there is no point.
    """

    x: Array | None
    value: float
    multipliers: Array


@contextmanager
def _no_banner() -> Iterator[None]:
    """Suppress the text that HiGHS 1.16 prints at its start, before options take effect."""
    if sys.stdout is None:  # it was closed
        yield
        return
    sys.stdout.flush()
    kept = os.dup(_STANDARD_OUTPUT)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), _STANDARD_OUTPUT)
    try:
        yield
    finally:
        os.dup2(kept, _STANDARD_OUTPUT)
        os.close(kept)


class LinearProgram:
    """A program inside HiGHS; each minimum starts from the basis of the last one."""

    def __init__(self, tolerance: float = TOLERANCE) -> None:
        """Start HiGHS with an absolute feasibility tolerance, primal and dual."""
        self.solver = backend("highspy")
        with _no_banner():
            self.highs = self.solver.Highs()
        self.tolerance = tolerance
        self._set_options(output_flag=False, threads=1, presolve="off")
        self._set_tolerance(tolerance)

    def load(
        self, low: Array, high: Array, matrix: Any, above: Array, below: Array | None = None
    ) -> None:
        """Replace the program by `below ≤ matrix x ≤ above` and `low ≤ x ≤ high`.

        Args:
            low, high: `(variables,)`.
            matrix: SciPy's sparse matrix by rows, `(rows, variables)`.
            above: `(rows,)`.
            below: `(rows,)`; minus infinity if it is not given.
        """
        program = self.solver.HighsLp()
        program.num_col_ = len(low)
        program.num_row_ = len(above)
        program.col_cost_ = np.zeros(len(low))
        program.col_lower_ = low
        program.col_upper_ = high
        program.row_lower_ = np.full(len(above), -np.inf) if below is None else below
        program.row_upper_ = above
        program.a_matrix_.format_ = self.solver.MatrixFormat.kRowwise
        program.a_matrix_.start_ = matrix.indptr
        program.a_matrix_.index_ = matrix.indices
        program.a_matrix_.value_ = matrix.data
        self.variables = np.arange(len(low), dtype=np.int32)
        iterations = _MIN_ITERATIONS + _ITERATIONS_PER_ROW * len(above)
        self._set_options(simplex_iteration_limit=iterations)
        self.highs.passModel(program)

    def minimised(self, objective: Array) -> LinearOptimum:
        """Return the minimum of `objective · x`.

        Raises:
            TrajoptError: HiGHS breaks down.
        """
        self.highs.changeColsCost(len(self.variables), self.variables, objective)
        words = self.solver.HighsModelStatus
        status = self._run()
        if status not in (words.kOptimal, words.kInfeasible):
            status = self._run_anew()
        if status == words.kInfeasible:
            return LinearOptimum(None, np.inf, self._ray())
        if status != words.kOptimal:
            raise TrajoptError(f"HiGHS ended with {status}")
        solution = self.highs.getSolution()
        value = float(self.highs.getInfo().objective_function_value)
        return LinearOptimum(np.array(solution.col_value), value, -np.array(solution.row_dual))

    def _run(self) -> Any:
        self.highs.run()
        return self.highs.getModelStatus()

    def _run_anew(self) -> Any:
        """Solve without the last basis, with the larger tolerance if that fails too.

        A larger tolerance makes no proof wrong: any multipliers prove some bound.
        """
        words = self.solver.HighsModelStatus
        status = words.kUnknown
        for tolerance in (self.tolerance, _SECOND_TOLERANCE):
            self._set_tolerance(tolerance)
            self.highs.clearSolver()
            status = self._run()
            if status in (words.kOptimal, words.kInfeasible):
                break
        self._set_tolerance(self.tolerance)
        return status

    def _set_tolerance(self, tolerance: float) -> None:
        self._set_options(
            primal_feasibility_tolerance=tolerance, dual_feasibility_tolerance=tolerance
        )

    def _set_options(self, **options: object) -> None:
        for name, value in options.items():
            self.highs.setOptionValue(name, value)

    def _ray(self) -> Array:
        """Return multipliers that prove that there is no point; zeros if HiGHS has none."""
        _, exists, ray = self.highs.getDualRay()
        if not exists:
            return np.zeros(self.highs.getNumRow())
        return -np.array(ray)

    def basis(self) -> Any:
        """Return the last basis; a program of the same size can begin there."""
        return self.highs.getBasis()

    def begin_at(self, basis: Any) -> None:
        """Begin the next minimum at the basis of another program."""
        self.highs.setBasis(basis)

    def add_row(self, columns: Any, coefficients: Array, bound: float) -> bool:
        """Append a row `≤`; return whether HiGHS accepts its numbers."""
        indices = columns.astype(np.int32)
        status = self.highs.addRow(-np.inf, bound, len(indices), indices, coefficients)
        return bool(status != self.solver.HighsStatus.kError)
