"""IPOPT through CasADi, as every planner that uses it does: options, one run, several starts.

A program's variables, parameters and constraints are tables (segments × joints, say). CasADi wants
vectors: all tables one after another, each column by column. `program` and `flat` keep to that
order, for symbols and for numbers; `unflat` leads back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from trajopt.core.arrays import Array
from trajopt.planners.planner import backend

if TYPE_CHECKING:
    import scipy

Options = Mapping[str, float | str]
Bounds = tuple[Array | float, Array | float]  # low, high

# Two local optima whose durations differ by no more are one: both are IPOPT's to its tolerance.
AGREEMENT_RTOL = 1e-9

_QUIET: Options = {"print_level": 0, "sb": "yes"}


@dataclass(frozen=True, eq=False)
class Run:
    """Where IPOPT ended.

    Attributes:
        x: the variables, as `flat` orders them.
        status: IPOPT's own word, `Solve_Succeeded` for one.
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
        """One run of IPOPT.

        Args:
            start: where it starts, a value per variable.
            parameters: the problem's numbers.
            bounds: lowest and highest value of every variable.
            constraint_bounds: lowest and highest value of every constraint.
        """
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
        """All constraints at a point, and their derivatives by the variables."""
        import scipy  # late: planners that are only listed need none of it

        derivatives = self._solver.get_function("nlp_jac_g")
        constraints, jacobian = derivatives(x, parameters)
        values = np.asarray(constraints).ravel()
        return values, scipy.sparse.csr_array(jacobian.sparse())


def program(
    name: str,
    variables: Iterable[Any],
    parameters: Iterable[Any],
    objective: Any,
    constraints: Iterable[Any],
    options: Options,
) -> Program:
    """An NLP from tables of CasADi's symbols; building one costs more than solving it: keep it.

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
    """All tables of numbers in one vector, in CasADi's order."""
    return np.concatenate([table.ravel(order="F") for table in tables])


def unflat(x: Array, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    """The tables of these shapes that `x` begins with: the inverse of `flat`."""
    tables = []
    begin = 0
    for shape in shapes:
        end = begin + int(np.prod(shape))
        tables.append(x[begin:end].reshape(shape, order="F"))
        begin = end
    return tables


class Timed(Protocol):
    """What one start led to."""

    @property
    def duration(self) -> float:
        """Infinite where there is no answer."""


Start = TypeVar("Start")
TimedT = TypeVar("TimedT", bound=Timed)


def optima_together(
    solve: Callable[[Sequence[Start]], Sequence[TimedT]],
    starts: Iterable[Start],
    count: int,
    agreeing: int,
    rtol: float = AGREEMENT_RTOL,
) -> list[TimedT]:
    """Local optima: of `count` starts, of fewer that agree, of more while none has succeeded.

    Args:
        solve: leads from some starts to a local optimum each: from as many as are missing for
            agreement.
        starts: where to start from, in order.
        count: no more starts than these, unless all of them fail.
        agreeing: no more starts once so many share the shortest duration.
        rtol: what durations may differ by and count as one, relative.

    Returns:
        The optima in the order of their starts.
    """
    results: list[TimedT] = []
    remaining = iter(starts)
    while True:
        durations = np.array([result.duration for result in results])
        shortest = durations.min(initial=np.inf)
        as_short = durations <= shortest * (1 + rtol)
        agreed = 0
        if shortest < np.inf:
            agreed = int(as_short.sum())
        missing = agreeing - agreed
        untried = count - len(results)
        if agreed > 0 and min(missing, untried) <= 0:
            return results
        wanted = min(missing, max(untried, 1))
        batch = list(islice(remaining, wanted))
        if not batch:
            return results
        results += solve(batch)


def no_start_succeeded(statuses: Iterable[str]) -> str:
    """The message of a planner whose starts have all failed."""
    different = sorted(set(statuses))
    return f"no start succeeded: {', '.join(different)}"
