"""What is kept of a trial: a row of plain values, the problem's numbers, and arrays.

A row holds what JSON can say, with NaN and infinity spelled out as `{"$float": "nan"}`; floats
come back bit by bit. `trialfile.py` and `columns.py` say how rows and arrays lie in HDF5.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from numbers import Integral, Real
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.trial import Trial, verdict
from trajopt.exceptions import InvalidTrajectory, StoreError
from trajopt.planner import Relation
from trajopt.problem import LIMIT_NAMES, Limits, Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import Certificate, Tolerance, Worst

SCHEMA = 2  # raise it whenever a reader of this version could misread the file

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """One value per trial: its dtype (`str` for text, `object` for JSON), units and meaning."""

    kind: type
    units: str
    description: str


COLUMNS = {
    "id": Column(str, "", "identity: problem digest, planner, options, seed, package version"),
    "problem": Column(str, "", "problem name"),
    "source": Column(str, "", "where the problem's numbers come from"),
    "digest": Column(str, "", "SHA-256 of the problem's numbers"),
    "planner": Column(str, "", "planner name"),
    "label": Column(str, "", "planner name with the options that differ from its defaults"),
    "options": Column(object, "", "all planner options, as JSON"),
    "seed": Column(int, "1", "seed of the random stream; 0 for deterministic planners"),
    "relation": Column(str, "", "how the answer relates to the minimum-time problem"),
    "status": Column(str, "", "verdict"),
    "message": Column(str, "", "why, if not solved"),
    "planner_status": Column(str, "", "what the planner itself reported"),
    "planner_message": Column(str, "", "what the planner itself said"),
    "claimed_duration": Column(float, "s", "duration of the trajectory as returned"),
    "certified_duration": Column(float, "s", "max(1, dilation) x claimed; NaN: beyond mending"),
    "lower_bound": Column(float, "s", "no trajectory beats this, according to the planner"),
    "dilation": Column(float, "1", "exact cheapest time dilation that meets the limits"),
    "feasible": Column(float, "1", "1 if it keeps every limit as claimed; NaN: no trajectory"),
    "evaluations": Column(float, "1", "objective evaluations; NaN if not counted"),
    "setup_time": Column(float, "s", "wall time for building what later calls reuse"),
    "solve_time": Column(float, "s", "wall time besides; a batch's divided by its runs"),
    "batch": Column(int, "1", "runs that were solved together"),
    "started": Column(str, "", "start time, UTC, ISO 8601"),
    "certificate": Column(object, "", "the verifier's worst values as JSON, joints from 1"),
    "stats": Column(object, "", "reported by the planner, as JSON (SI units); see also stats/"),
    "provenance": Column(object, "", "versions, commit and machine of this trial, as JSON"),
}

ARRAYS = {
    "trajectory/breaks": ("s", "start of each piece, and the end: (pieces + 1,)"),
    "trajectory/coefficients": (
        "rad/s^power", "highest power first, time from the piece's start: (power, piece, joint)"),
    "trajectory/waypoint_times": ("s", "when each waypoint is passed: (waypoints,)"),
    "history/evaluations": ("1", "evaluations spent"),
    "history/duration": ("s", "best duration by then; NaN before the first"),
}  # fmt: skip
STATS = ("", "reported by the planner (SI units)")

_LIMIT = "limits, low and high; infinite where there is none: (joint, side)"
PROBLEM = {
    "waypoints": ("rad", "positions to pass in order, from rest to rest: (waypoint, joint)"),
    "velocity": ("rad/s", f"velocity {_LIMIT}"),
    "acceleration": ("rad/s^2", f"acceleration {_LIMIT}"),
    "jerk": ("rad/s^3", f"jerk {_LIMIT}"),
    "position": ("rad", f"position {_LIMIT}"),
}


class WrongSchema(StoreError):
    """A file that another version wrote and this one does not read."""


@dataclass(frozen=True)
class Encoded:
    """A trial as it is kept: a `row` of JSON values by `COLUMNS`, and arrays by their names."""

    row: dict[str, Any]
    problem: dict[str, Array]
    arrays: dict[str, Array]


def encode(t: Trial) -> Encoded:
    """Everything there is to keep; raises `TypeError` for what it cannot say."""
    s, c, problem = t.solution, t.certificate, t.problem
    arrays = {n: v for n, v in s.stats.items() if isinstance(v, np.ndarray) and _is_plain(v)}
    row = {
        "id": t.id, "problem": problem.name, "source": problem.source, "digest": problem.digest(),
        "planner": t.planner, "label": t.label,
        "options": json.loads(json.dumps(dict(t.options), default=str)),
        "seed": t.seed, "relation": t.relation.name, "status": str(t.status), "message": t.message,
        "planner_status": str(s.status), "planner_message": s.message,
        "claimed_duration": t.claimed_duration, "certified_duration": t.certified_duration,
        "lower_bound": t.lower_bound, "dilation": c and c.dilation,
        "feasible": c and float(c.feasible), "evaluations": s.evaluations,
        "setup_time": t.setup_time, "solve_time": t.solve_time, "batch": t.batch,
        "started": t.started, "certificate": c and _certificate_row(c),
        "stats": {n: v for n, v in s.stats.items() if n not in arrays},
        "provenance": dict(t.provenance),
    }  # fmt: skip
    texts = {n: _storable(row[n]) for n, column in COLUMNS.items() if column.kind is str}
    numbers = {"waypoints": problem.waypoints}
    numbers |= {name: getattr(problem.limits, name) for name in LIMIT_NAMES}
    stats = {f"stats/{quote(n, safe=' ')}": v for n, v in arrays.items()}
    return Encoded(pack(row | texts), numbers, _arrays(s) | stats)


def decode(kept: Encoded, *, anew: bool = False) -> Trial:
    """The trial as it was judged; its certificate is the recorded one, or computed `anew`.

    A trajectory that is none (any more) leaves an invalid trial without one.
    """
    row, arrays = unpack(kept.row), kept.arrays
    trajectory, damage = _trajectory(arrays)
    if damage:
        row = row | {"status": "invalid", "message": f"the stored trajectory: {damage}"}
    history = [arrays[n] for n in ARRAYS if n.startswith("history/") and n in arrays]
    stats = {unquote(n[6:]): v for n, v in arrays.items() if n.startswith("stats/")}
    number = {n: _number(row[n]) for n, column in COLUMNS.items() if column.kind is float}
    batch, setup_time = int(row["batch"]), number["setup_time"]
    solution = Solution(
        Status(row["planner_status"]), trajectory, row["planner_message"],
        lower_bound=None if np.isnan(number["lower_bound"]) else number["lower_bound"],
        evaluations=int(number["evaluations"]) if np.isfinite(number["evaluations"]) else None,
        history=np.stack(history, axis=1) if history else None,
        setup_time=setup_time * batch, stats=row["stats"] | stats,
    )  # fmt: skip
    problem = _problem(row["problem"], row["source"], *(_raw(kept.problem[n]) for n in PROBLEM))
    certificate = None
    if anew and not damage:
        status, _, certificate = verdict(problem, solution)
        row = row | {"status": str(status)}
    elif trajectory is not None:
        certificate = _certificate(row["certificate"])
    return Trial(
        problem, row["planner"], row["label"], row["options"], int(row["seed"]),
        Relation[row["relation"]], Status(row["status"]), row["message"], solution, certificate,
        setup_time, number["solve_time"], batch, row["started"], row["provenance"],
    )  # fmt: skip


def pack(value: Any) -> Any:
    """The value in JSON's terms; raises `TypeError` where it has none."""
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return pack(value.item())
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        number = float(value)
        return number if np.isfinite(number) else {"$float": repr(number)}
    if isinstance(value, Mapping):
        return {str(key): pack(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return {"$array": pack(value.tolist()), "dtype": value.dtype.str}
    if isinstance(value, list | tuple):
        return [pack(item) for item in value]
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
        return np.array(unpack(value["$array"]), dtype=value["dtype"])
    return {key: unpack(item) for key, item in value.items()}


def check_schema(schema: int | None, file: str) -> None:
    """Raise `WrongSchema` for what another version wrote, `ValueError` for what none did."""
    if schema is None:
        raise ValueError("it has no schema")
    mend = "upgrade trajopt" if schema > SCHEMA else "run again into another folder"
    if schema != SCHEMA:
        raise WrongSchema(f"{file}: written with schema {schema}, this reads {SCHEMA}; {mend}")


def _is_plain(array: NDArray[Any]) -> bool:
    return array.ndim > 0 and array.dtype == np.float64


def _arrays(solution: Solution) -> dict[str, Array]:
    found = {}
    if solution.trajectory is not None:
        for name in ("breaks", "coefficients", "waypoint_times"):
            found[f"trajectory/{name}"] = getattr(solution.trajectory, name)
    if solution.history is not None:
        columns = np.asarray(solution.history, dtype=float).T
        found |= {"history/evaluations": columns[0], "history/duration": columns[1]}
    return found


def _trajectory(arrays: Mapping[str, Array]) -> tuple[Trajectory | None, str]:
    names = [name for name in ARRAYS if name.startswith("trajectory/")]
    if not any(name in arrays for name in names):
        return None, ""
    try:
        return Trajectory(*(arrays[name] for name in names)), ""
    except InvalidTrajectory as error:
        return None, str(error)


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)


def _raw(numbers: Any) -> tuple[bytes, int]:
    array = np.asarray(numbers, dtype=float)
    return array.tobytes(), array.shape[1]


@lru_cache(maxsize=1024)
def _problem(name: str, source: str, *raw: tuple[bytes, int]) -> Problem:
    """One object for the trials of one problem, however many they are."""
    waypoints, *limits = (np.frombuffer(data).reshape(-1, width) for data, width in raw)
    return Problem(waypoints, Limits(*limits), name, source)


def _certificate_row(c: Certificate) -> dict[str, Any]:
    row = asdict(c)
    for worst in filter(None, map(row.get, _WORST)):
        worst["joint"] += 1
    return row


def _certificate(row: Mapping[str, Any] | None) -> Certificate | None:
    if row is None:
        return None
    worst: dict[str, Any] = {
        n: row[n] and Worst(**row[n] | {"joint": row[n]["joint"] - 1}) for n in _WORST
    }
    rest = {"flaws": tuple(row["flaws"]), "tolerance": Tolerance(**row["tolerance"])}
    return Certificate(**dict(row) | worst | rest)


_WORST = ("velocity", "acceleration", "jerk", "position", "waypoint", "continuity")


def _storable(text: str) -> str:
    """HDF5 text holds neither NUL nor lone surrogates."""
    return text.replace("\0", "\\0").encode("utf-8", "backslashreplace").decode()
