"""A record: the best known motion of a problem and a lower bound with its proof, in a JSON file.

The file says all there is to check: the problem's numbers, the motion as
`trajopt.formats.own_breaks` has it, and the proof, one row of numbers a line. Floats come back bit
by bit.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.core import files
from trajopt.core.exceptions import InvalidInput
from trajopt.core.numerals import is_number
from trajopt.core.problem import LIMIT_NAMES, Limits, Problem
from trajopt.core.trajectory import Trajectory
from trajopt.formats import own_breaks

Array = NDArray[np.float64]

SCHEMA = 1
CLOSED_WITHIN = 1e-3
"""A best known duration this close to its proved lower bound leaves no question open."""

CLOSED_FORM = "closed form"
"""What proves a bound that needs no stored proof: `rest_to_rest.end_to_end_bound`."""

_KEYS = ("schema", "problem", "duration", "lower_bound", "motion", "bound", "trajectory", "proof")
_PROBLEM_KEYS = ("name", "source", "joint_names", "digest", "waypoints", "limits")
_PROOF_PREFIX = "proof_"  # of the arrays by which a planner's solution carries its proof
_TEXT_MAX = 300


@dataclass(frozen=True)
class Origin:
    """Where a motion or a bound comes from.

    Attributes:
        method: The planner with its options, or whatever its submitter calls it.
        version: Of that planner's package; may be empty.
        date: On which it was recorded, ISO 8601.
        submitter: Who sent it; empty where this project computed it.
    """

    method: str
    version: str
    date: str
    submitter: str = ""

    def __str__(self) -> str:
        name = " ".join(filter(None, [self.method, self.version]))
        return ", ".join(filter(None, [name, self.submitter, self.date]))


@dataclass(frozen=True, eq=False)
class Record:
    """What is known of a problem.

    Attributes:
        problem: Which counts as the same by its numbers alone.
        duration: Certified, of `trajectory`, s.
        lower_bound: No motion is briefer, s.
        motion: Where the trajectory comes from.
        bound: Where the lower bound comes from.
        trajectory: The best known motion as it was planned: certified, it may take longer.
        proof: Of the lower bound, arrays by name; empty where its method is `CLOSED_FORM`.
    """

    problem: Problem
    duration: float
    lower_bound: float
    motion: Origin
    bound: Origin
    trajectory: Trajectory
    proof: Mapping[str, Array]

    @property
    def proved_within(self) -> float:
        """By how much the duration may exceed the optimum, as a ratio minus 1."""
        return self.duration / self.lower_bound - 1

    @property
    def closed(self) -> bool:
        """Whether the best known motion is the optimum, but for `CLOSED_WITHIN`."""
        return self.proved_within < CLOSED_WITHIN

    @property
    def proof_stats(self) -> dict[str, Array]:
        """The proof among a solution's `stats`, as the planner that found it had it."""
        return {_PROOF_PREFIX + name: array for name, array in self.proof.items()}

    @property
    def file_name(self) -> str:
        """The problem's name for people, its digest for lookup."""
        safe = re.sub(r"[^\w.-]", "_", self.problem.name, flags=re.ASCII)
        return f"{safe[:80]}{ending(self.problem)}"


def ending(problem: Problem) -> str:
    """How the file name of a problem's record ends, whatever the problem is called."""
    return f".{problem.digest()[:16]}.json"


def proof_of(stats: Mapping[str, Any]) -> dict[str, Array]:
    """The arrays of a proof among a solution's `stats`, by their names in a record."""
    found = {}
    for name, value in stats.items():
        if name.startswith(_PROOF_PREFIX) and isinstance(value, np.ndarray):
            found[name.removeprefix(_PROOF_PREFIX)] = np.asarray(value, dtype=float)
    return found


# --- writing ---


def text(record: Record, rtol: float = own_breaks.SAME_RTOLS[0]) -> str:
    """The file's text; `rtol` says what the motion leaves out (`own_breaks.table`)."""
    said = {
        "schema": SCHEMA,
        "duration": record.duration,
        "lower_bound": record.lower_bound,
        "motion": vars(record.motion),
        "bound": vars(record.bound),
        "problem": _problem_table(record.problem),
        "trajectory": own_breaks.table(record.trajectory, rtol),
        "proof": _lists(record.proof),
    }
    return "".join(_lines(said)) + "\n"


def _problem_table(problem: Problem) -> dict[str, Any]:
    limits = problem.limits.by_name()
    for name in LIMIT_NAMES:
        if not problem.has(name):
            del limits[name]
    return {
        "name": problem.name,
        "source": problem.source,
        "joint_names": list(problem.joint_names),
        "digest": problem.digest(),
        "waypoints": problem.waypoints.tolist(),
        "limits": _lists(limits),
    }


def _lists(arrays: Mapping[str, Array]) -> dict[str, Any]:
    return {name: array.tolist() for name, array in arrays.items()}


def _lines(value: Any) -> Iterator[str]:
    """JSON with a line for every key, and for every row of numbers."""
    if isinstance(value, dict) and value:
        yield "{\n"
        for number, (key, item) in enumerate(value.items()):
            yield ",\n" if number else ""
            yield f"{json.dumps(key)}: "
            yield from _lines(item)
        yield "\n}"
    elif isinstance(value, list) and value and isinstance(value[0], list):
        yield "[\n"
        for number, item in enumerate(value):
            yield ",\n" if number else ""
            yield from _lines(item)
        yield "\n]"
    elif isinstance(value, list):
        yield "[" + ",".join(map(_said, value)) + "]"
    else:
        yield _said(value)


def _said(value: Any) -> str:
    """A number as short as it comes back the same, or text; an infinite limit is null."""
    if not isinstance(value, float):
        return json.dumps(value, ensure_ascii=False)
    if not np.isfinite(value):
        return "null"
    return repr(value).removesuffix(".0")


# --- reading ---


def read(path: Path) -> Record:
    """The record in a file, checked for its form; `verification` checks what it says.

    Raises:
        InvalidInput: It is none; names the file, the key and what would be right.
    """
    try:
        return _of(files.json(path, "record"))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def parsed(content: str) -> Record:
    """The record in a file's text.

    Raises:
        InvalidInput: It is none.
    """
    try:
        said = files.parsed_json(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInput("record", f"JSON, but {error}") from None
    return _of(said)


def _of(said: Any) -> Record:
    table = _table("record", said, _KEYS)
    if table["schema"] != SCHEMA:
        raise InvalidInput("schema", f"{SCHEMA}, which this version reads", value=table["schema"])
    return Record(
        problem=_problem(table["problem"]),
        duration=_positive("duration", table["duration"]),
        lower_bound=_positive("lower_bound", table["lower_bound"]),
        motion=_origin("motion", table["motion"]),
        bound=_origin("bound", table["bound"]),
        trajectory=own_breaks.trajectory(table["trajectory"]),
        proof=_proof(table["proof"]),
    )


def _table(key: str, value: Any, names: Sequence[str]) -> Mapping[str, Any]:
    """An object with exactly these names."""
    if not isinstance(value, dict) or value.keys() != set(names):
        raise InvalidInput(key, f"an object with {', '.join(names)}")
    return value


def _positive(key: str, value: Any) -> float:
    if not is_number(value) or not value > 0:
        raise InvalidInput(key, "a positive number, s", value=value)
    return float(value)


def _line(key: str, value: Any) -> str:
    right = f"one printable line of at most {_TEXT_MAX} characters"
    if not isinstance(value, str):
        raise InvalidInput(key, right, value=value)
    if len(value) > _TEXT_MAX or not value.isprintable():
        raise InvalidInput(key, right, value=value)
    return value


def _origin(key: str, value: Any) -> Origin:
    names = [field.name for field in fields(Origin)]
    prefix = f"{key}."
    lines = {}
    for name, item in _table(key, value, names).items():
        lines[name] = _line(prefix + name, item)
    return origin(**lines, prefix=prefix)


def origin(
    method: str,
    version: str,
    date: str,
    submitter: str = "",
    *,
    prefix: str = "motion.",
) -> Origin:
    """Where a motion comes from.

    Args:
        method, version, date, submitter: As in `Origin`.
        prefix: Before these names in errors.

    Raises:
        InvalidInput: A record cannot hold it.
    """
    lines = {
        "method": method,
        "version": version,
        "submitter": submitter,
    }
    for name, value in lines.items():
        _line(f"{prefix}{name}", value)
    if not method.strip():
        raise InvalidInput(f"{prefix}method", "a name")
    _check_date(f"{prefix}date", date)
    return Origin(method, version, date, submitter)


def _check_date(key: str, value: str) -> None:
    try:
        date.fromisoformat(value)
    except ValueError:
        raise InvalidInput(key, "a date like 2026-11-22", value=value) from None


def _problem(value: Any) -> Problem:
    table = _table("problem", value, _PROBLEM_KEYS)
    names = table["joint_names"]
    if not isinstance(names, list):
        raise InvalidInput("problem.joint_names", "a list of names")
    problem = Problem(
        waypoints=table["waypoints"],
        limits=_limits(table["limits"]),
        name=_line("problem.name", table["name"]),
        source=_line("problem.source", table["source"]),
        joint_names=[_line("problem.joint_names", name) for name in names],
    )
    if table["digest"] != problem.digest():
        right = f"{problem.digest()}, that of its numbers"
        raise InvalidInput("problem.digest", right, value=table["digest"])
    return problem


def _limits(value: Any) -> Limits:
    required = {"velocity", "acceleration"}
    if not isinstance(value, dict) or not required <= value.keys() <= set(LIMIT_NAMES):
        right = "an object with velocity, acceleration, and jerk or position where there are any"
        raise InvalidInput("problem.limits", right)
    pairs = {}
    for name, rows in value.items():
        pairs[name] = _pairs(name, rows)
    return Limits(**pairs)


def _pairs(name: str, value: Any) -> list[Any]:
    """Pairs of limits; null is no limit."""
    if not isinstance(value, list):
        raise InvalidInput(f"problem.limits.{name}", "a pair [low, high] per joint")
    pairs = []
    for item in value:
        if not isinstance(item, list) or len(item) != 2:
            raise InvalidInput(f"problem.limits.{name}", "pairs [low, high]", value=item)
        low, high = item
        low = -np.inf if low is None else low
        high = np.inf if high is None else high
        pairs.append([low, high])
    return pairs


def _proof(value: Any) -> dict[str, Array]:
    if not isinstance(value, dict):
        raise InvalidInput("proof", "an object of arrays, empty where there is no proof")
    found = {}
    for name, rows in value.items():
        key = f"proof.{_line('proof', name)}"
        right = "a list of finite numbers, or of rows of them of one length"
        found[name] = own_breaks.array(key, rows, right)
    return found
