"""What crosses from the process that runs a planner to the one that judges it: plain data.

A text in JSON, whose arrays are base64 of little-endian float64. Reading it runs no code of
whoever wrote it, as a pickle would; `unpacked` checks it like any file of a stranger.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np

from trajopt.benchmark.store.schema import pack, unpack
from trajopt.benchmark.trial import Answers, Array, crash, well_formed
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Relation

LARGEST = 2**26  # bytes of one message: far more than any answer has

_TRAJECTORY = ("breaks", "coefficients", "waypoint_times")


class TooLarge(ValueError):
    """An answer that no message holds."""

    def __init__(self) -> None:
        super().__init__(f"its answer is larger than {LARGEST >> 20} MiB")


def packed(answers: Answers) -> bytes:
    """The answers as a message; one that cannot be said in plain data is a crash that says why."""
    table = {
        "solutions": [_packed(solution) for solution in answers.solutions],
        "relation": answers.relation.name,
        "loading_time": answers.loading_time,
        "wall_time": answers.wall_time,
    }
    message = json.dumps(table).encode()
    if len(message) > LARGEST:
        lost = crash(str(TooLarge()))
        return packed(answers.instead(lost))
    return message


def unpacked(message: bytes, count: int) -> Answers:
    """The answers of a message, `count` of them.

    Raises:
        ValueError: it is not what `packed` makes. (Or another `Exception`: it is a stranger's.)
    """
    table = json.loads(message)
    solutions = [_unpacked(row) for row in table["solutions"]]
    if len(solutions) != count:
        raise ValueError(f"expected {count} answers, found {len(solutions)}")
    return Answers(
        solutions,
        Relation[table["relation"]],
        loading_time=_seconds(table["loading_time"]),
        wall_time=_seconds(table["wall_time"]),
    )


def _packed(solution: Solution) -> Mapping[str, Any]:
    try:
        return _plain(solution)
    except Exception as error:
        return _plain(crash(f"{type(error).__name__}: {error}"))


def _plain(solution: Solution) -> Mapping[str, Any]:
    """A well-formed solution as JSON has it."""
    trajectory = None
    if solution.trajectory is not None:
        trajectory = {name: _text(getattr(solution.trajectory, name)) for name in _TRAJECTORY}
    history = None if solution.history is None else _text(solution.history)
    arrays = {}
    others = {}
    for name, value in solution.stats.items():
        if isinstance(value, np.ndarray) and value.dtype == np.float64 and value.ndim > 0:
            arrays[str(name)] = _text(value)
        else:
            others[str(name)] = pack(value)
    row = {
        "status": str(solution.status),
        "trajectory": trajectory,
        "message": solution.message,
        "lower_bound": pack(solution.lower_bound),
        "evaluations": pack(solution.evaluations),
        "history": history,
        "setup_time": pack(solution.setup_time),
        "stats": others,
        "arrays": arrays,
    }
    json.dumps(row)
    return row


def _unpacked(row: Mapping[str, Any]) -> Solution:
    trajectory = None
    if row["trajectory"] is not None:
        trajectory = Trajectory(*(_array(row["trajectory"][name]) for name in _TRAJECTORY))
    history = None if row["history"] is None else _array(row["history"])
    arrays = {name: _array(text) for name, text in row["arrays"].items()}
    solution = Solution(
        status=Status(row["status"]),
        trajectory=trajectory,
        message=row["message"],
        lower_bound=unpack(row["lower_bound"]),
        evaluations=unpack(row["evaluations"]),
        history=history,
        setup_time=unpack(row["setup_time"]),
        stats=unpack(row["stats"]) | arrays,
    )
    return well_formed(solution)


def _text(array: Array) -> list[Any]:
    """An array's shape and values."""
    plain = np.asarray(array, dtype="<f8")
    if plain.nbytes > LARGEST:
        raise TooLarge
    return [list(plain.shape), base64.b64encode(plain.tobytes()).decode()]


def _array(text: list[Any]) -> Array:
    shape, values = text
    array = np.frombuffer(base64.b64decode(values, validate=True), dtype="<f8")
    if prod(shape) != array.size:
        raise ValueError(f"an array of {array.size} numbers cannot have the shape {shape}")
    return array.reshape(shape).astype(float)


def _seconds(value: Any) -> float:
    seconds = float(value)
    if not 0 <= seconds < np.inf:
        raise ValueError(f"{seconds} s is no time that anything took")
    return seconds
