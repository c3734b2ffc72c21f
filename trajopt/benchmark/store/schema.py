"""What is kept of a trial: a row of plain values, the problem's numbers, and arrays.

A row holds what JSON can say, with NaN and infinity spelled out as `{"$float": "nan"}`; floats
come back bit by bit. `trial_file.py` and `results_file.py` say how rows and arrays lie in HDF5.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from functools import lru_cache
from math import isfinite
from numbers import Integral, Real
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.store.columns import (
    ARRAYS,
    COLUMNS,
    PROBLEM,
    SEED_MAX,
    Array,
    Malformed,
    harmless,
    naming,
)
from trajopt.benchmark.trial import DEGREE_MAX, Trial, verdict
from trajopt.core.exceptions import InvalidTrajectory, StoreError
from trajopt.core.problem import LIMIT_NAMES, Limits, Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import WORST_KINDS, Certificate, Tolerance, Worst
from trajopt.planners.planner import Relation

_PLAIN = (type(None), str, bool, int)  # what JSON says as it is
_TRAJECTORY = ("breaks", "coefficients", "waypoint_times")


@dataclass(frozen=True)
class Encoded:
    """A trial as it is kept: a `row` of JSON values by `COLUMNS`, and arrays by their names."""

    row: dict[str, Any]
    problem: dict[str, Array]
    arrays: dict[str, Array]


def encode(trial: Trial) -> Encoded:
    """Everything there is to keep.

    Raises:
        TypeError: for what no file can hold.
        StoreError: for a seed beyond 64 bits.
    """
    problem = trial.problem
    solution = trial.solution
    certificate = trial.certificate
    if not 0 <= trial.seed <= SEED_MAX:
        raise StoreError(f"seed {trial.seed} cannot be stored: expected 0 to {SEED_MAX}")
    stats = {}
    stat_arrays = {}
    for name, value in solution.stats.items():
        if isinstance(value, np.ndarray) and _is_plain(value):
            stat_arrays[name] = value
        else:
            stats[name] = value
    options = json.dumps(dict(trial.options), default=str)
    row = {
        "id": trial.id,
        "problem": problem.name,
        "source": problem.source,
        "joint_names": "\n".join(problem.joint_names),
        "joint_units": "\n".join(problem.joint_units),
        "digest": problem.digest(),
        "planner": trial.planner,
        "label": trial.label,
        "options": json.loads(options),
        "seed": trial.seed,
        "relation": trial.relation.name,
        "status": str(trial.status),
        "message": trial.message,
        "planner_status": str(solution.status),
        "planner_message": solution.message,
        "claimed_duration": trial.claimed_duration,
        "certified_duration": trial.certified_duration,
        "lower_bound": trial.lower_bound,
        "dilation": certificate.dilation if certificate else None,
        "feasible": float(certificate.feasible) if certificate else None,
        "evaluations": solution.evaluations,
        "setup_time": trial.setup_time,
        "solve_time": trial.solve_time,
        "batch": trial.batch,
        "started": trial.started,
        "asked": trial.asked,
        "certificate": _certificate_row(certificate) if certificate else None,
        "stats": stats,
        "provenance": dict(trial.provenance),
    }
    for name, column in COLUMNS.items():
        if column.kind in ("name", "text"):
            row[name] = harmless(row[name], lines=column.lines)
    numbers = {"waypoints": problem.waypoints}
    for limit in LIMIT_NAMES:
        numbers[limit] = getattr(problem.limits, limit)
    arrays = _solution_arrays(solution)
    for name, array in stat_arrays.items():
        arrays[f"stats/{quote(name, safe=' ')}"] = array
    return Encoded(pack(row), numbers, arrays)


def decode(kept: Encoded, *, anew: bool = False) -> Trial:
    """The trial as it was judged; its verdict is the recorded one, or that of today, `anew`.

    A trajectory that is none (any more) leaves an invalid trial without a certificate.

    Raises:
        Malformed: naming the column or array that is not what it should be.
    """
    return decoded(recorded(kept), kept, anew=anew)


def decoded(row: Mapping[str, Any], kept: Encoded, *, anew: bool = False) -> Trial:
    """`decode` of a trial whose row is checked already."""
    arrays = kept.arrays
    problem = _problem(row, kept.problem)
    trajectory, damage = _trajectory(arrays)
    solution = Solution(
        status=Status(row["planner_status"]),
        trajectory=trajectory,
        message=row["planner_message"],
        lower_bound=_absent_if_nan(row["lower_bound"]),
        evaluations=_count(row["evaluations"]),
        history=_history(arrays),
        setup_time=_nan_if_absent(row["setup_time"]) * row["batch"],
        stats=row["stats"] | _stat_arrays(arrays),
    )
    status = Status(row["status"])
    message = row["message"]
    certificate = _certificate(row["certificate"], problem.joints)
    if damage:
        status = Status.INVALID
        message = f"the stored trajectory: {damage}"
    elif anew:
        status, _, certificate = verdict(problem, solution)
    if trajectory is None:
        certificate = None
    return Trial(
        problem=problem,
        planner=row["planner"],
        label=row["label"],
        options=row["options"],
        seed=row["seed"],
        relation=Relation[row["relation"]],
        status=status,
        message=message,
        solution=solution,
        certificate=certificate,
        setup_time=_nan_if_absent(row["setup_time"]),
        solve_time=_nan_if_absent(row["solve_time"]),
        batch=row["batch"],
        started=row["started"],
        provenance=row["provenance"],
        asked=row["asked"],
    )


def recorded(kept: Encoded) -> dict[str, Any]:
    """The row as it was recorded, checked; raises `Malformed` as `decode` does."""
    return _checked_row(kept.row)


def pack(value: Any) -> Any:
    """The value in JSON's terms; raises `TypeError` where it has none."""
    kind = type(value)
    if kind in _PLAIN or (kind is float and isfinite(value)):  # nearly all
        return value
    if isinstance(value, str | bool):
        return value
    if isinstance(value, list | tuple):
        return [pack(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): pack(item) for key, item in value.items()}
    if isinstance(value, np.generic):
        return pack(value.item())
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        number = float(value)
        return number if isfinite(number) else {"$float": repr(number)}
    if isinstance(value, np.ndarray):
        items = pack(value.tolist())
        if value.ndim == 0:
            return items
        return {"$array": items, "dtype": value.dtype.str}
    raise TypeError(f"a result cannot hold {value!r:.200}")


def unpack(value: Any) -> Any:
    """What `pack` made plain; tuples come back as lists."""
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
    items = unpack(value["$array"])
    dtype = np.dtype(str(value.get("dtype")))
    if dtype.kind == "U":
        dtype = np.dtype(str)  # as wide as the longest text, whatever the file says
    if dtype.kind not in "biufUmM":
        raise Malformed(f"an array of {dtype}, which no result holds")
    return np.array(items, dtype=dtype)


def _checked_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """The values of all columns, checked and harmless to print."""
    checked = {}
    for name, column in COLUMNS.items():
        with naming(name):
            value = harmless(row[name], lines=column.lines)
            checked[name] = column.checked(unpack(value))
    if checked["batch"] < 1:
        raise Malformed("batch: expected 1 or more")
    _check_provenance(checked["provenance"])
    return checked


def _check_provenance(provenance: Mapping[str, Any]) -> None:
    """A trial's identity is made from it."""
    for name, text in provenance.items():
        if not isinstance(text, str):
            raise Malformed(f"provenance: {name}: expected text, found {text!r:.80}")
    if "trajopt" not in provenance:
        raise Malformed("provenance: trajopt, the package's version, is missing")


def _is_plain(array: NDArray[Any]) -> bool:
    return array.ndim > 0 and array.dtype == np.float64


def _solution_arrays(solution: Solution) -> dict[str, Array]:
    found = {}
    if solution.trajectory is not None:
        for name in _TRAJECTORY:
            found[f"trajectory/{name}"] = getattr(solution.trajectory, name)
    if solution.history is not None:
        evaluations, duration = np.asarray(solution.history, dtype=float).T
        found["history/evaluations"] = evaluations
        found["history/duration"] = duration
    return found


def _trajectory(arrays: Mapping[str, Array]) -> tuple[Trajectory | None, str]:
    """The stored trajectory, or what is wrong with it."""
    names = [f"trajectory/{name}" for name in _TRAJECTORY]
    stored = [arrays[name] for name in names if name in arrays]
    if not stored:
        return None, ""
    if len(stored) < len(names):
        return None, f"expected {', '.join(names)}"
    degree = len(stored[1]) - 1
    if degree > DEGREE_MAX:
        return None, f"degree {degree}, expected at most {DEGREE_MAX}"
    try:
        return Trajectory(*stored), ""
    except InvalidTrajectory as error:
        return None, str(error)


def _history(arrays: Mapping[str, Array]) -> Array | None:
    names = [name for name in ARRAYS if name.startswith("history/")]
    columns = [arrays[name] for name in names if name in arrays]
    if not columns:
        return None
    lengths = {len(column) for column in columns}
    if len(columns) < len(names) or len(lengths) > 1:
        raise Malformed(f"{' and '.join(names)}: expected arrays of one length")
    return np.stack(columns, axis=1)


def _stat_arrays(arrays: Mapping[str, Array]) -> dict[str, Array]:
    found = {}
    for name, array in arrays.items():
        group, _, quoted = name.partition("/")
        if group == "stats":
            found[harmless(unquote(quoted), lines=False)] = array
    return found


def _nan_if_absent(value: float | None) -> float:
    return np.nan if value is None else float(value)


def _absent_if_nan(value: float | None) -> float | None:
    if value is None or np.isnan(value):
        return None
    return float(value)


def _count(value: float | None) -> int | None:
    if value is None or not np.isfinite(value):
        return None
    return int(value)


def _problem(row: Mapping[str, Any], numbers: Mapping[str, Array]) -> Problem:
    raw = []
    for name in PROBLEM:
        array = np.asarray(numbers[name], dtype=float)
        if array.ndim != 2:
            raise Malformed(f"{name}: expected a table, found shape {array.shape}")
        raw.append((array.tobytes(), array.shape[1]))
    names = tuple(row["joint_names"].splitlines())
    units = tuple(row["joint_units"].splitlines())
    return _problem_of(row["problem"], row["source"], names, units, *raw)


@lru_cache(maxsize=1024)
def _problem_of(
    name: str,
    source: str,
    joint_names: tuple[str, ...],
    joint_units: tuple[str, ...],
    *raw: tuple[bytes, int],
) -> Problem:
    """One object for the trials of one problem, however many they are."""
    tables = []
    for data, width in raw:
        numbers = np.frombuffer(data)
        tables.append(numbers.reshape(-1, width))
    waypoints, *limits = tables
    return Problem(waypoints, Limits(*limits), name, source, joint_names, joint_units)


def _certificate_row(certificate: Certificate) -> dict[str, Any]:
    row = _fields(certificate)
    row["tolerance"] = _fields(certificate.tolerance)
    for name in WORST_KINDS:
        worst: Worst | None = row[name]
        if worst is not None:
            row[name] = _fields(worst) | {"joint": worst.joint + 1}
    return row


def _fields(value: Certificate | Tolerance | Worst) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(value)}


def _certificate(row: Mapping[str, Any] | None, joints: int) -> Certificate | None:
    """The recorded certificate; fields that it was recorded without have their defaults."""
    if row is None:
        return None
    values: dict[str, Any] = {}
    for field in fields(Certificate):
        if field.name in row:
            values[field.name] = row[field.name]
        elif field.default is MISSING and field.default_factory is MISSING:
            raise Malformed(f"certificate: {field.name} is missing")
    for name in WORST_KINDS:
        if values[name] is not None:
            values[name] = _worst(name, values[name], joints)
    values["flaws"] = _flaws(values["flaws"])
    tolerance = _numbers("tolerance", values["tolerance"])
    values["tolerance"] = Tolerance(**tolerance)
    for name in ("duration", "dilation"):
        values[name] = _number(name, values[name])
    return Certificate(**values)


def _flaws(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise Malformed("certificate: flaws: expected a list")
    for flaw in value:
        if not isinstance(flaw, str):
            raise Malformed(f"certificate: flaws: expected texts, found {flaw!r:.80}")
    return tuple(value)


def _worst(name: str, row: Any, joints: int) -> Worst:
    values = _numbers(name, row)
    joint = values["joint"]
    order = values["order"]
    if joint not in range(1, joints + 1):
        raise Malformed(f"certificate: {name}: joint {joint:g} of {joints}")
    if order not in range(3):
        raise Malformed(f"certificate: {name}: order {order:g}")
    return Worst(values["value"], int(joint) - 1, values["time"], int(order))


def _numbers(name: str, row: Any) -> dict[str, float]:
    """Values that must all be numbers."""
    if not isinstance(row, Mapping):
        raise Malformed(f"certificate: {name}: expected a JSON object")
    return {key: _number(f"{name} {key}", value) for key, value in row.items()}


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Malformed(f"certificate: {name}: expected a number, found {value!r:.80}")
    return float(value)
