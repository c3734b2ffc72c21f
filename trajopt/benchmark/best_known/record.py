"""A record: the best known motion of a problem and a lower bound with its proof, in a JSON file.

The file states all there is to check: the problem's numbers, the motion as
`trajopt.formats.own_breaks` writes it, and the proof, one row of numbers a line. Floats come back
bit for bit.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.benchmark.store.document import check_table, json_lines, problem_of, problem_table
from trajopt.core import files
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.core.numerals import is_number
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.formats import own_breaks

SCHEMA = 1
CLOSED_WITHIN = 1e-3
"""A best known duration this close to its proved lower bound leaves no question open."""

CLOSED_FORM = "closed form"
"""The method of a bound without a stored proof: `rest_to_rest.end_to_end_bound`."""

_HEAD = ("schema", "duration", "lower_bound", "motion", "bound", "problem")
_EVIDENCE = ("trajectory", "proof")
_EVIDENCE_START = '\n"trajectory": '  # a text that the package wrote has it once
_PROOF_PREFIX = "proof_"  # names of a proof's arrays among a solution's stats
_MAX_TEXT_LENGTH = 300  # characters of a line


@dataclass(frozen=True)
class Origin:
    """The source of a motion or a bound.

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
    """The best known motion and bound of a problem.

    Attributes:
        problem: Two problems are the same where their numbers are.
        duration: Certified, of `trajectory`, s.
        lower_bound: No motion is faster, s.
        motion: Where the trajectory comes from.
        bound: Where the lower bound comes from.
        evidence: JSON of `trajectory` and `proof`, which are read when they are needed.
    """

    problem: Problem
    duration: float
    lower_bound: float
    motion: Origin
    bound: Origin
    evidence: str

    @cached_property
    def trajectory(self) -> Trajectory:
        """The best known motion as it was planned: certified, it may take longer."""
        return own_breaks.trajectory(self._stated["trajectory"])

    @cached_property
    def proof(self) -> Mapping[str, Array]:
        """The proof of the lower bound, arrays by name; empty for `CLOSED_FORM`."""
        table = self._stated["proof"]
        if not isinstance(table, dict):
            raise InvalidInput("proof", "an object of arrays, empty where there is no proof")
        right = "a list of finite numbers, or of rows of them of one length"
        found = {}
        for name, rows in table.items():
            key = f"proof.{_line('proof', name)}"
            found[name] = own_breaks.array(key, rows, right)
        return found

    @cached_property
    def _stated(self) -> Mapping[str, Any]:
        return _json_of(self.evidence, _EVIDENCE)

    @property
    def proved_within(self) -> float:
        """By how much the duration may exceed the optimum, as a ratio minus 1."""
        return self.duration / self.lower_bound - 1

    @property
    def closed(self) -> bool:
        """True if the duration is proved to be optimal within `CLOSED_WITHIN`."""
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
    """Return how the file name of a problem's record ends, whatever the problem is called."""
    return f".{problem.digest()[:16]}.json"


def proof_of(stats: Mapping[str, Any]) -> dict[str, Array]:
    """Return the arrays of a proof among a solution's `stats`, by their names in a record."""
    found = {}
    for name, value in stats.items():
        if name.startswith(_PROOF_PREFIX) and isinstance(value, np.ndarray):
            found[name.removeprefix(_PROOF_PREFIX)] = np.asarray(value, dtype=float)
    return found


# --- writing ---


def evidence(
    trajectory: Trajectory,
    proof: Mapping[str, Array],
    rtol: float = own_breaks.SAME_RTOLS[0],
) -> str:
    """Return a record's evidence; `rtol` decides what the motion leaves out."""
    stated = {
        "trajectory": own_breaks.table(trajectory, rtol),
        "proof": {name: array.tolist() for name, array in proof.items()},
    }
    return "".join(json_lines(stated))


def text(record: Record) -> str:
    """Return the file's text."""
    head = {
        "schema": SCHEMA,
        "duration": record.duration,
        "lower_bound": record.lower_bound,
        "motion": asdict(record.motion),
        "bound": asdict(record.bound),
        "problem": problem_table(record.problem),
    }
    lines = "".join(json_lines(head)).removesuffix("\n}")
    return f"{lines},{record.evidence.removeprefix('{')}\n"


# --- reading ---


def read(path: Path) -> Record:
    """Read a record, checked for its form; `verification` checks what it states.

    Raises:
        InvalidInput: The file holds none; names the file, the key and what would be right.
    """
    content = files.text(path, "record", "JSON")
    try:
        return parsed(content)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def parsed(content: str) -> Record:
    """Return the record in a file's text; its evidence is read when it is needed.

    Raises:
        InvalidInput: The text holds none.
    """
    head, mark, rest = content.partition(_EVIDENCE_START)
    if not mark:  # not as this package writes it
        stated = _json_of(content, (*_HEAD, *_EVIDENCE))
        head = json.dumps({name: stated[name] for name in _HEAD}).removesuffix("}") + ","
        rest = json.dumps({name: stated[name] for name in _EVIDENCE}).removeprefix("{")
        mark = ""
    table = _json_of(head.rstrip().removesuffix(",") + "}", _HEAD)
    if table["schema"] != SCHEMA:
        raise InvalidInput("schema", f"{SCHEMA}, which this version reads", value=table["schema"])
    return Record(
        problem=_problem(table["problem"]),
        duration=_positive("duration", table["duration"]),
        lower_bound=_positive("lower_bound", table["lower_bound"]),
        motion=_origin("motion", table["motion"]),
        bound=_origin("bound", table["bound"]),
        evidence=f"{{{mark}{rest.rstrip()}",
    )


def _json_of(content: str, keys: tuple[str, ...]) -> Mapping[str, Any]:
    """The object in a JSON text, with exactly these keys."""
    try:
        stated = files.parsed_json(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInput("record", f"JSON, but {error}") from None
    check_table("record", stated, keys)
    table: Mapping[str, Any] = stated
    return table


def _positive(key: str, value: Any) -> float:
    if not is_number(value) or not value > 0:
        raise InvalidInput(key, "a positive number, s", value=value)
    return float(value)


def _line(key: str, value: Any) -> str:
    right = f"one printable line of at most {_MAX_TEXT_LENGTH} characters"
    if not isinstance(value, str):
        raise InvalidInput(key, right, value=value)
    if len(value) > _MAX_TEXT_LENGTH or not value.isprintable():
        raise InvalidInput(key, right, value=value)
    return value


def _origin(key: str, table: Any) -> Origin:
    check_table(key, table, [field.name for field in fields(Origin)])
    return origin(**table, prefix=f"{key}.")


def origin(
    method: str,
    version: str,
    date: str,
    submitter: str = "",
    *,
    prefix: str = "motion.",
) -> Origin:
    """Return where a motion comes from.

    Args:
        method, version, date, submitter: As in `Origin`.
        prefix: Before these names in errors.

    Raises:
        InvalidInput: A record cannot hold it.
    """
    found = Origin(method, version, date, submitter)
    for name, value in asdict(found).items():
        _line(f"{prefix}{name}", value)
    if not method.strip():
        raise InvalidInput(f"{prefix}method", "a name")
    _check_date(f"{prefix}date", date)
    return found


def _check_date(key: str, value: str) -> None:
    try:
        date.fromisoformat(value)
    except ValueError:
        raise InvalidInput(key, "a date like 2026-11-22", value=value) from None


def _problem(table: Any) -> Problem:
    problem = problem_of(table)
    for name in (problem.name, problem.source, *problem.joint_names):
        _line("problem.name, source or joint_names", name)
    return problem
