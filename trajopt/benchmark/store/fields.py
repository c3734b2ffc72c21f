"""Every field of a trial, declared once: its name, type, unit, meaning, and where it comes from.

The trial's text, the columns of `results.h5`, frames, CSV files and pages follow this list. To
store another value, give `Trial` the attribute and add a line here.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from operator import attrgetter
from typing import Any, Literal

import numpy as np

from trajopt.benchmark.store.document import Malformed, pack
from trajopt.benchmark.trial import MAX_LABEL, Trial
from trajopt.core.numerals import is_number

Kind = Literal["line", "text", "time", "time or none", "integer", "number", "object"]

SEED_MAX = 2**63 - 1  # the largest integer of an HDF5 column
_YEARS = range(1970, 2262)  # the years that pandas' nanoseconds hold


@dataclass(frozen=True)
class Field:
    """A named value of each trial.

    Attributes:
        name: In JSON, in columns and in tables.
        kind: `line` (text without newlines), `text`, `time` (UTC, ISO 8601), `time or none` (empty
            for none), `integer` (64 bits, 0 or more), `number` (finite where a text states it; None
            where there is none), `object`.
        unit: SI; "1" for a pure number, empty for texts.
        meaning: In words.
        path: Of the trial's attribute, where that is not called `name`.
    """

    name: str
    kind: Kind
    unit: str
    meaning: str
    path: str = ""


def _is_integer(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int):
        return False
    return 0 <= value <= SEED_MAX


def is_line(value: Any) -> bool:
    """Return whether a value is a text of one line, as a planner's name with its options."""
    return isinstance(value, str) and value.isprintable() and len(value) <= MAX_LABEL


def _is_time(value: Any) -> bool:
    try:
        time = datetime.fromisoformat(value)
    except (TypeError, ValueError):
        return False
    return time.tzinfo is not None and time.year in _YEARS


_TIME = "a time like 2026-01-31T12:00:00+00:00"
_KINDS: dict[Kind, tuple[str, Callable[[Any], bool]]] = {
    "line": (f"a line of at most {MAX_LABEL} characters", is_line),
    "text": ("text", lambda value: isinstance(value, str)),
    "time": (_TIME, _is_time),
    "time or none": (f"{_TIME}, or nothing", lambda value: value == "" or _is_time(value)),
    "integer": ("a whole number from 0 to 2^63 - 1", _is_integer),
    "number": ("a finite number", is_number),
    "object": ("a JSON object", lambda value: isinstance(value, Mapping)),
}

DTYPES = {"number": float, "integer": np.int64}

FIELDS = (
    Field("id", "line", "", "identity: problem, planner, options, seed, code"),
    Field("problem", "line", "", "problem name", "problem.name"),
    Field("source", "text", "", "where the problem's numbers come from", "problem.source"),
    Field("joint_names", "text", "", "joint names, one a line", "problem.joint_names"),
    Field("joint_units", "text", "", "rad or m, one joint a line", "problem.joint_units"),
    Field("digest", "line", "", "SHA-256 of the problem's numbers"),
    Field("planner", "line", "", "planner name"),
    Field("label", "line", "", "planner name with the options that differ from its defaults"),
    Field("options", "object", "", "all planner options"),
    Field("seed", "integer", "1", "seed of the random stream; 0 for deterministic planners"),
    Field("relation", "line", "", "how the planner relates to the minimum-time problem"),
    Field("status", "line", "", "verdict"),
    Field("message", "text", "", "reason, if not solved"),
    Field("planner_status", "line", "", "what the planner reported", "solution.status"),
    Field("planner_message", "text", "", "the planner's own message", "solution.message"),
    Field("claimed_duration", "number", "s", "duration of the trajectory as returned"),
    Field("certified_duration", "number", "s", "max(1, dilation) x claimed; NaN: beyond mending"),
    Field("lower_bound", "number", "s", "no trajectory is faster, as the planner proved"),
    Field(
        "dilation",
        "number",
        "1",
        "exact cheapest dilation that meets the limits; between moving ends certified / claimed",
    ),
    Field("position_excess", "number", "rad or m", "largest distance beyond a position limit"),
    Field("feasible", "number", "1", "1 if every limit is kept as claimed; NaN: no trajectory"),
    Field("jerk_integral", "number", "rad^2/s^5", "integral of squared jerk; inf: a jump"),
    Field("acceleration_integral", "number", "rad^2/s^3", "integral of squared acceleration"),
    Field("jerk_rms_sum", "number", "rad/s^3", "sum of the joints' root mean square jerks"),
    Field("evaluations", "number", "1", "objective evaluations", "solution.evaluations"),
    Field("setup_time", "number", "s", "wall time to load, and to build what later calls reuse"),
    Field("solve_time", "number", "s", "other wall time to the answer; a batch's, by its runs"),
    Field("library_time", "number", "s", "of solve_time, in calls of a library that plans"),
    Field("batch", "integer", "1", "runs that were solved together"),
    Field("started", "time", "", "start time, UTC, ISO 8601"),
    Field("asked", "time or none", "", "when a later comparison kept the trial; empty: none did"),
    Field("provenance", "object", "", "versions, commit and machine of the trial"),
)
"""Every field; `as_dict`, columns and tables follow their order."""

PROVENANCE = FIELDS[-1]

_ATTRIBUTES = {attribute.name for attribute in dataclasses.fields(Trial)}
_NAMED = [field for field in FIELDS if not field.path]
OWN_FIELDS = tuple(field for field in _NAMED if field.name in _ATTRIBUTES)
"""The fields that a trial's text states; the others follow from its problem, solution, verdict."""


def columns(trials: Sequence[Trial]) -> dict[str, Any]:
    """Return the values of every field by name, one a trial.

    Numbers are arrays, with NaN for a missing one. The others are texts: several in a field, one a
    line; an object as JSON.
    """
    return {field.name: column(field, trials) for field in FIELDS}


def column(field: Field, trials: Sequence[Trial]) -> Any:
    """Return the values of one field, one a trial, as `columns` does."""
    items = list(map(attrgetter(field.path or field.name), trials))
    if field.kind in DTYPES:
        return np.array(items, dtype=DTYPES[field.kind])
    return [_as_text(item) for item in items]


def _as_text(item: Any) -> str:
    plain = item if isinstance(item, str) else pack(item)
    if isinstance(plain, list):
        return "\n".join(plain)
    return str(plain) if isinstance(plain, str) else json.dumps(plain, ensure_ascii=False)


def check(stated: Mapping[str, Any]) -> None:
    """Raise `Malformed` unless each field that a text states is of its kind."""
    for field in OWN_FIELDS:
        expected, is_right = _KINDS[field.kind]
        value = stated[field.name]
        if not is_right(value):
            raise Malformed(f"{field.name}: expected {expected}, found {value!r:.80}")
