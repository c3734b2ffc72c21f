"""Lower bounds that proofs prove: the kernel's files asked about a `Problem` and arrays.

`check_proof` derives bounds of the duration, `check_front` bounds of the smoothness integral,
`check_spline353` bounds of the duration of all 3-5-3 splines.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from math import inf, isfinite, nextafter
from typing import Any

from trajopt.core.arrays import Array
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.judging import check_front, check_proof, check_spline353
from trajopt.judging.check_proof import NoProof


def proved_bound(problem: Problem, tables: Mapping[str, Array]) -> float:
    """Return the lower bound that a proof proves, s, rounded down: no motion takes less.

    Args:
        problem: As the proof's author stated it, with every waypoint and joint.
        tables: The proof's tables by their names (`check_proof.TABLES`).

    Raises:
        InvalidInput: The proof is damaged, or belongs to another problem.
    """
    with _refusals():
        proof = check_proof.whole(_exact_tables(tables))
        return rounded_down(check_proof.proved(stated(problem), proof))


def proved_integral(problem: Problem, tables: Mapping[str, Array], claim: float) -> float:
    """Return the lower bound of a smoothness integral that a proof proves, at most a claim.

    Args:
        problem: Without demands; every waypoint and joint.
        tables: The proof's tables by their names (`check_front.TABLES`).
        claim: For the duration of the proof; for 1 s where the proof uses no limits.

    Raises:
        InvalidInput: The proof is damaged, or belongs to another problem.
    """
    with _refusals():
        said = stated(problem) | {"joint_units": list(problem.joint_units)}
        bound = check_front.proved(said, Fraction(claim), _exact_tables(tables))
        return rounded_down(bound)


def proved_spline353(problem: Problem, tables: Mapping[str, Array]) -> float:
    """Return the cut-off that a proof proves, s: no 3-5-3 spline with shared times takes less.

    Args:
        problem: With four waypoints that differ from their neighbours.
        tables: The proof's tables by their names (`check_spline353.TABLES`).

    Raises:
        InvalidInput: The proof is damaged, or belongs to another problem.
    """
    with _refusals():
        return rounded_down(check_spline353.proved(stated(problem), _exact_tables(tables)))


@contextmanager
def _refusals() -> Iterator[None]:
    """Raise the kernel's refusals as `InvalidInput`."""
    try:
        yield
    except NoProof as error:
        key = f"proof {error.part}"
        raise InvalidInput(key, error.expected, value=error.value) from error


def _exact_tables(tables: Mapping[str, Array]) -> dict[str, Any]:
    return {name: exact(table.tolist()) for name, table in tables.items()}


def stated(problem: Problem) -> dict[str, Any]:
    """Return a problem's numbers as a file states them, in fractions; None is no limit."""
    limits = {key: exact(kind.numbers.tolist()) for key, kind in problem.limits.kinds.items()}
    demands = {key: exact(DEMANDS[key].table(numbers)) for key, numbers in problem.demands.items()}
    numbers = {"waypoints": exact(problem.waypoints.tolist()), "limits": limits, **demands}
    return {"digest": problem.digest(), **numbers}


def exact(table: Any) -> Any:
    """Return nested lists of floats as fractions; None for those that are not finite."""
    if isinstance(table, list):
        return [exact(row) for row in table]
    return None if table is None or not isfinite(table) else Fraction(table)


def rounded_down(x: Fraction) -> float:
    """Return the largest float that is no larger."""
    near = float(x)
    return near if Fraction(near) <= x else nextafter(near, -inf)
