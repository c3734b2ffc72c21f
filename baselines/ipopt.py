"""IPOPT through CasADi, for every planner that uses it: options and one run.

A program's variables, parameters and constraints are tables, for example segments × joints. CasADi
requires vectors: all tables one after another, each column by column. `program` and `flat` use that
order for symbols and for numbers; `unflat` is the inverse of `flat`.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, Any

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.planners.planner import backend

if TYPE_CHECKING:
    import scipy

Options = Mapping[str, float | str]
Bounds = tuple[Array | float, Array | float]  # low, high

_QUIET: Options = {"print_level": 0, "sb": "yes"}


@dataclass(frozen=True, eq=False)
class Run:
    """The result of a run of IPOPT.

    Attributes:
        x: the variables, in the order of `flat`.
        status: IPOPT's own word, for example `Solve_Succeeded`.
        success: whether IPOPT calls it solved and every number is finite.
    """

    x: Array
    status: str
    success: bool


class Program:
    """An NLP built once, its numbers being parameters; see `program`."""

    def __init__(self, solver: Any) -> None:
        self._solver = solver

    def __call__(
        self, start: Array, parameters: Array, bounds: Bounds, constraint_bounds: Bounds
    ) -> Run:
        """Run IPOPT once.

        Args:
            start: initial guess, a value per variable.
            parameters: the problem's numbers.
            bounds: lowest and highest value of every variable.
            constraint_bounds: lowest and highest value of every constraint.
        """
        with _interruptible():
            result = self._solver(
                x0=start,
                p=parameters,
                lbx=bounds[0],
                ubx=bounds[1],
                lbg=constraint_bounds[0],
                ubg=constraint_bounds[1],
            )
        stats = self._solver.stats()
        x = np.asarray(result["x"]).ravel()
        success = bool(stats["success"]) and bool(np.isfinite(x).all())
        return Run(x, str(stats["return_status"]), success)

    def linear(self, x: Array, parameters: Array) -> tuple[Array, scipy.sparse.csr_array]:
        """Return all constraints at a point, and their derivatives by the variables."""
        import scipy  # late: planners that are only listed need none of it

        derivatives = self._solver.get_function("nlp_jac_g")
        constraints, jacobian = derivatives(x, parameters)
        values = np.asarray(constraints).ravel()
        return values, scipy.sparse.csr_array(jacobian.sparse())

    def depends(self, x: Array, parameters: Array, variables: Bools) -> Bools:
        """Return which constraints have a derivative by some variables at a point."""
        derivatives = self._solver.get_function("nlp_jac_g")
        _, jacobian = derivatives(x, parameters)
        rows, columns = (np.array(own) for own in jacobian.sparsity().get_triplet())
        nonzero = np.array(jacobian.nonzeros()) != 0
        found = np.zeros(jacobian.shape[0], dtype=bool)
        found[rows[nonzero & variables[columns]]] = True
        return found


@contextmanager
def _interruptible() -> Iterator[None]:
    """Raise `KeyboardInterrupt` after a run in which Ctrl-C was pressed.

    CasADi catches it, ends the run, and returns as if IPOPT had failed; the next run would begin.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    pressed = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        pressed = True
        handler(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
    if pressed:
        raise KeyboardInterrupt


def program(
    name: str,
    variables: Iterable[Any],
    parameters: Iterable[Any],
    objective: Any,
    constraints: Iterable[Any],
    options: Options,
) -> Program:
    """Return a program made of tables of CasADi's symbols.

    Building a program takes longer than solving it, so callers keep it.

    Args:
        name: CasADi's name for it.
        variables: tables that IPOPT chooses.
        parameters: tables of numbers that each run is given.
        objective: what is minimised.
        constraints: tables whose bounds each run is given.
        options: IPOPT's own, such as `tol`; printing is off.
    """
    ca = backend("casadi")

    def vector(tables: Iterable[Any]) -> Any:
        return ca.vertcat(*map(ca.vec, tables))

    nlp = {
        "x": vector(variables),
        "p": vector(parameters),
        "f": objective,
        "g": vector(constraints),
    }
    solver_options = {"print_time": False, "error_on_fail": False, "ipopt": {**_QUIET, **options}}
    return Program(ca.nlpsol(name, "ipopt", nlp, solver_options))


def flat(*tables: Array) -> Array:
    """Return all tables of numbers in one vector, in CasADi's order."""
    return np.concatenate([table.ravel(order="F") for table in tables])


def unflat(x: Array, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    """Return the tables of these shapes with which `x` begins; the inverse of `flat`."""
    tables = []
    begin = 0
    for shape in shapes:
        end = begin + int(np.prod(shape))
        tables.append(x[begin:end].reshape(shape, order="F"))
        begin = end
    return tables
