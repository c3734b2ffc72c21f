"""Values, solutions and problems as JSON, for files and messages.

Trials, best known answers and the messages of planners' processes share these functions. Numbers
come back bit for bit. NaN and infinity are spelled out as `{"$float": "nan"}`; null stands for NaN
in arrays of numbers, and for no limit in limits.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from enum import Enum
from math import isfinite
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.store import own_breaks
from trajopt.benchmark.trial import well_formed
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import InvalidInput, TrajoptError, shown
from trajopt.core.files import MAX_DIGITS, check_keys
from trajopt.core.harmless import harmless
from trajopt.core.limits import Limit, Limits, named
from trajopt.core.limits.strangers import registered
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory

_TRAJECTORY = ("breaks", "coefficients", "waypoint_times")
_SOLUTION = ("status", "message", "lower_bound", "evaluations", "setup_time", "stats")
_PROBLEM = ("name", "source", "joint_names", "digest", "waypoints", "limits")
_ARRAY_KINDS = "biufUmM"  # NumPy's letters for numbers, truth values, texts and times


class Malformed(ValueError):
    """A stored value of the wrong kind for its key."""


class UnknownKind(TrajoptError, LookupError):
    """A stored problem has a kind of limit that is not known here, or that cannot be imported."""

    def __init__(self, key: str, error: Exception) -> None:
        told = f" ({error})" if key in registered() else ""
        super().__init__(
            f"a problem has {key!r} limits, a kind that is not known here: install the package "
            f"that brings it, or name its file with --kind FILE.py:NAME{told}"
        )


# --- values ---


def pack(value: Any) -> Any:
    """Return a value for JSON; control characters in texts are spelled out.

    Raises:
        TypeError: JSON cannot hold the value.
    """
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, float):
        number = float(value)
        return number if isfinite(number) else {"$float": repr(number)}
    if isinstance(value, str):
        return _printable(value)
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, list | tuple):
        return [pack(item) for item in value]
    if isinstance(value, Mapping):
        return {_printable(str(key)): pack(item) for key, item in value.items()}
    if isinstance(value, np.generic):
        return pack(value.item())
    if isinstance(value, Integral) and abs(value) < 10**MAX_DIGITS:
        return int(value)
    if isinstance(value, Real) and not isinstance(value, Integral):
        return pack(float(value))
    if isinstance(value, np.ndarray) and value.dtype.kind in _ARRAY_KINDS:
        return _packed_array(value)
    raise TypeError(f"a result cannot hold {shown(value)}")


def _printable(text: str) -> str:
    return text if text.isprintable() else harmless(text)


def _packed_array(array: NDArray[Any]) -> Any:
    if array.ndim == 0:
        return pack(array.item())
    items = array.tolist()
    if array.dtype.kind == "f" and np.isnan(array).any():
        items = np.where(np.isnan(array), None, array).tolist()  # type: ignore[call-overload]
    if array.dtype.kind != "f" or np.isinf(array).any():
        items = pack(items)
    return {"$array": items, "dtype": array.dtype.str, "shape": list(array.shape)}


def unpack(value: Any) -> Any:
    """Return what `pack` wrote; tuples come back as lists.

    Raises:
        Malformed: The value holds an impossible array.
    """
    if isinstance(value, list):
        return [unpack(item) for item in value]
    if not isinstance(value, dict):
        return value
    if "$float" in value:
        return float(value["$float"])
    if "$array" in value:
        return _unpacked_array(value)
    return {key: unpack(item) for key, item in value.items()}


def _unpacked_array(value: Mapping[str, Any]) -> NDArray[Any]:
    dtype = np.dtype(str(value.get("dtype")))
    if dtype.kind not in _ARRAY_KINDS:
        raise Malformed(f"an array of {dtype}, which no result holds")
    items = value["$array"]
    if dtype.kind == "U":
        dtype = np.dtype(str)  # as wide as the longest text, whatever the file says
    try:
        array = np.array(items, dtype=dtype)
    except TypeError:  # a number in it is spelled out
        array = np.array(unpack(items), dtype=dtype)
    return array.reshape(value["shape"])


# --- solutions ---


def packed_solution(solution: Solution, *, brief: bool = False) -> dict[str, Any]:
    """Return a planner's answer for JSON; raises `TypeError` as `pack` does.

    With `brief`, its trajectory is stated joint by joint (`own_breaks`), if the lengths of its
    pieces are the differences of its breaks.
    """
    table = {name: pack(getattr(solution, name)) for name in _SOLUTION}
    table["trajectory"] = None
    trajectory = solution.trajectory
    if trajectory is not None:
        is_brief = brief and _says_lengths(trajectory)
        as_table = own_breaks.table if is_brief else trajectory_table
        table["trajectory"] = as_table(trajectory)
    table["history"] = pack(solution.history)
    if solution.library_time is not None:
        table["library_time"] = pack(solution.library_time)
    return table


def trajectory_table(trajectory: Trajectory) -> dict[str, Any]:
    """Return a trajectory's arrays by name; lengths only if they differ from those of breaks."""
    table = {name: getattr(trajectory, name).tolist() for name in _TRAJECTORY}
    if not _says_lengths(trajectory):
        table["lengths"] = trajectory.lengths.tolist()
    return table


def _says_lengths(trajectory: Trajectory) -> bool:
    """Return whether the differences of the breaks are the lengths of the pieces."""
    return np.array_equal(trajectory.lengths, np.diff(trajectory.breaks))


def solution_of(table: Any) -> Solution:
    """Return the answer that `packed_solution` wrote.

    Raises:
        ValueError, TypeError: The table holds no answer that a planner may give.
    """
    check_table("solution", table, (*_SOLUTION, "trajectory", "history"), ["library_time"])
    values = {name: unpack(table[name]) for name in (*_SOLUTION, "history")}
    values["library_time"] = table.get("library_time")
    values["status"] = Status(values["status"])
    solution = Solution(trajectory=_trajectory(table["trajectory"]), **values)
    checked = well_formed(solution)
    if checked is not solution:
        raise Malformed(checked.message)
    return solution


def _trajectory(table: Any) -> Trajectory | None:
    if table is None:
        return None
    if "joints" in table:
        check_table("trajectory", table, ("waypoint_times", "joints"))
        return own_breaks.trajectory(table)
    check_table("trajectory", table, _TRAJECTORY, ("lengths",))
    arrays = {name: np.array(numbers, dtype=float) for name, numbers in table.items()}
    return Trajectory(**arrays)


# --- problems ---


def problem_table(problem: Problem) -> dict[str, Any]:
    """Return a problem's numbers and names for JSON; null is no limit."""
    limits = {key: _finite(own.numbers.tolist()) for key, own in problem.limits.kinds.items()}
    table = {
        "name": harmless(problem.name, lines=False),
        "source": harmless(problem.source),
        "joint_names": pack(problem.joint_names),
        "digest": problem.digest(),
        "waypoints": problem.waypoints.tolist(),
        "limits": limits,
    }
    for key, numbers in problem.demands.items():
        table[key] = DEMANDS[key].table(numbers)
    if problem.joint_units:
        table["joint_units"] = pack(problem.joint_units)
    return table


def _finite(numbers: Any) -> Any:
    """Numbers in nested lists, None for those that are not finite."""
    if isinstance(numbers, list):
        return [_finite(item) for item in numbers]
    return numbers if isfinite(numbers) else None


def problem_of(table: Any) -> Problem:
    """Return the problem that `problem_table` wrote.

    Raises:
        ValueError, TypeError: The table holds no problem, or another digest than its numbers'.
    """
    check_table("problem", table, _PROBLEM, optional=["joint_units", *DEMANDS])
    joint_names = table["joint_names"]
    joint_units = table.get("joint_units", [])
    for text in (table["name"], table["source"], *joint_names, *joint_units):
        if not isinstance(text, str):
            raise Malformed(f"problem: expected text, found {text!r:.80}")
    if not isinstance(table["limits"], dict):
        raise Malformed("problem.limits: expected a table of limits")
    limits = Limits(**{key: _limit(key, rows) for key, rows in table["limits"].items()})
    demands = {key: table[key] for key in DEMANDS if key in table}
    problem = Problem(
        table["waypoints"],
        limits,
        table["name"],
        table["source"],
        joint_names,
        joint_units,
        demands,
    )
    if table["digest"] != problem.digest():
        right = f"{problem.digest()}, that of its numbers"
        raise InvalidInput("problem.digest", right, value=table["digest"])
    return problem


def _limit(key: str, rows: Any) -> Limit:
    """Return a limit from stored numbers; null is no limit."""
    try:
        kind = named(key)
    except TrajoptError as error:
        raise UnknownKind(key, error) from error
    try:
        numbers = np.array(rows, dtype=float)
        return kind.of_numbers(numbers)
    except (TypeError, ValueError, IndexError):
        raise Malformed(f"problem.limits.{key}: expected numbers, a row per joint") from None


# --- tables ---


def check_table(
    key: str, value: Any, required: Collection[str], optional: Collection[str] = ()
) -> None:
    """Raise `InvalidInput` unless a value is a table of these keys."""
    if not isinstance(value, dict):
        raise InvalidInput(key, f"an object with {', '.join(required)}")
    if value.keys() == set(required):
        return
    check_keys(f"{key}: ", value, {*required, *optional}, required)
