"""What is stored of a trial: every column and array with its type, axes, units and meaning.

The one declaration that files are written by, checked against when read, and documented from.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from trajopt.core.solution import Status
from trajopt.planners.planner import Relation

Array = NDArray[np.float64]
Kind = Literal["name", "text", "time", "integer", "number", "object"]

SEED_MAX = 2**63 - 1  # what an HDF5 integer column holds
YEARS = range(1970, 2262)  # what pandas' nanoseconds hold


class Malformed(ValueError):
    """A stored value that is not of the type, shape or size that its column has."""


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Let what is wrong with a value be `Malformed`, with the name of its column or dataset."""
    try:
        yield
    except (ValueError, TypeError, KeyError, ArithmeticError, RecursionError) as error:
        raise Malformed(f"{name}: {error}") from error


@dataclass(frozen=True)
class Column:
    """One value per trial.

    Kinds: `name` (a line of text), `text`, `time` (UTC, ISO 8601), `integer` (64 bits, 0 or more),
    `number` (float; NaN or `None` where there is none), `object` (a JSON object, or `None` where
    `optional`). A `name` must match `pattern` where there is one. Files from before there was this
    column lack it where it is `newer`: a text, empty then.
    """

    kind: Kind
    units: str
    description: str
    pattern: str = ""
    optional: bool = False
    newer: bool = False

    @property
    def text(self) -> str:
        """What the files say of it."""
        return self.description

    @property
    def lines(self) -> bool:
        """Whether its text may have several lines."""
        return self.kind != "name"

    def checked(self, value: Any) -> Any:
        """The value; raises `Malformed` if it is not of this column's kind."""
        if value is None and self.optional:
            return None
        if not _IS_KIND[self.kind](value):
            raise Malformed(f"expected {_EXPECTED[self.kind]}, found {value!r:.80}")
        if self.pattern and not re.fullmatch(self.pattern, value):
            raise Malformed(f"expected {self.pattern}, found {value!r:.80}")
        return value


@dataclass(frozen=True)
class Block:
    """An array per trial or problem: the meaning of its axes, or any axes where that is `None`."""

    axes: tuple[str, ...] | None
    units: str
    description: str

    @property
    def text(self) -> str:
        """What the files say of it: its meaning and its axes."""
        return f"{self.description}: ({', '.join(self.axes)})" if self.axes else self.description


def harmless(value: Any, *, lines: bool = True) -> Any:
    """Text, or what holds text, with every character spelt out that could steer a terminal.

    Those are control characters but tab and newline (these too, unless `lines`), marks that turn
    the direction of writing, and lone surrogates.
    """
    if isinstance(value, str):
        if value.isprintable():  # no control character, mark or surrogate is; quickly seen
            return value
        unsafe = _UNSAFE if lines else _UNSAFE_IN_LINE
        return unsafe.sub(_spelt, value)
    if isinstance(value, dict):
        return {harmless(key): harmless(item) for key, item in value.items()}
    if isinstance(value, list):
        return [harmless(item) for item in value]
    return value


def _spelt(match: re.Match[str]) -> str:
    return match[0].encode("unicode_escape").decode()


_STEERING = "\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_UNSAFE = re.compile(f"[{_STEERING}]")
_UNSAFE_IN_LINE = re.compile(f"[\t\n{_STEERING}]")


def _is_number(value: Any) -> bool:
    return value is None or (isinstance(value, float | int) and not isinstance(value, bool))


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= SEED_MAX


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_object(value: Any) -> bool:
    return isinstance(value, Mapping)


def _is_time(value: Any) -> bool:
    try:
        time = datetime.fromisoformat(value)
    except (TypeError, ValueError):
        return False
    return time.tzinfo is not None and time.year in YEARS


_IS_KIND = {
    "name": _is_text,
    "text": _is_text,
    "time": _is_time,
    "integer": _is_integer,
    "number": _is_number,
    "object": _is_object,
}
_EXPECTED = {
    "name": "text",
    "text": "text",
    "time": "a time as in 2026-01-31T12:00:00+00:00",
    "integer": "a whole number from 0 to 2^63 - 1",
    "number": "a number",
    "object": "a JSON object",
}

_DIGEST = "[0-9a-f]{64}"
_ASKED = r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00)?"
_STATUS = "|".join(Status)
_RELATION = "|".join(relation.name for relation in Relation)

COLUMNS = {
    "id": Column("name", "", "identity: problem, planner, options, seed, code", "[0-9a-f]{20}"),
    "problem": Column("name", "", "problem name"),
    "source": Column("text", "", "where the problem's numbers come from"),
    "joint_names": Column("text", "", "the joints' names, one a line, if any", newer=True),
    "joint_units": Column("text", "", "rad or m, one joint a line, if said", newer=True),
    "digest": Column("name", "", "SHA-256 of the problem's numbers", _DIGEST),
    "planner": Column("name", "", "planner name"),
    "label": Column("name", "", "planner name with the options that differ from its defaults"),
    "options": Column("object", "", "all planner options, as JSON"),
    "seed": Column("integer", "1", "seed of the random stream; 0 for deterministic planners"),
    "relation": Column("name", "", "how it relates to the minimum-time problem", _RELATION),
    "status": Column("name", "", "verdict", _STATUS),
    "message": Column("text", "", "why, if not solved"),
    "planner_status": Column("name", "", "what the planner itself reported", _STATUS),
    "planner_message": Column("text", "", "what the planner itself said"),
    "claimed_duration": Column("number", "s", "duration of the trajectory as returned"),
    "certified_duration": Column("number", "s", "max(1, dilation) x claimed; NaN: beyond mending"),
    "lower_bound": Column("number", "s", "no trajectory beats this, as the planner proved"),
    "dilation": Column("number", "1", "exact cheapest time dilation that meets the limits"),
    "feasible": Column("number", "1", "1 if it keeps every limit as claimed; NaN: no trajectory"),
    "evaluations": Column("number", "1", "objective evaluations; NaN if not counted"),
    "setup_time": Column("number", "s", "wall time for building what later calls reuse"),
    "solve_time": Column("number", "s", "wall time besides; a batch's divided by its runs"),
    "batch": Column("integer", "1", "runs that were solved together"),
    "started": Column("time", "", "start time, UTC, ISO 8601"),
    "asked": Column("name", "", "when a later comparison kept it, if so", _ASKED, newer=True),
    "certificate": Column(
        "object", "", "the verifier's worst values as JSON, joints from 1", optional=True
    ),
    "stats": Column("object", "", "reported by the planner, as JSON (SI units); see also stats/"),
    "provenance": Column("object", "", "versions, commit and machine of this trial, as JSON"),
}

_METRES = "m for rad where joint_units says so"
_POWERS = f"highest power first, time from the piece's start; {_METRES}"
ARRAYS = {
    "trajectory/breaks": Block(("pieces + 1",), "s", "start of each piece, and the end"),
    "trajectory/coefficients": Block(
        ("power", "piece", "joint"), "rad/s^power", f"{_POWERS}; {_METRES}"
    ),
    "trajectory/waypoint_times": Block(("waypoint",), "s", "when each waypoint is passed"),
    "history/evaluations": Block(("row",), "1", "evaluations spent"),
    "history/duration": Block(
        ("row",), "s", "shortest duration claimed by then; NaN before the first"
    ),
}
STATS = Block(None, "", "reported by the planner (SI units)")

_LIMIT = f"limits, low and high; infinite where there is none; {_METRES}"
_SIDES = ("joint", "side")
PROBLEM = {
    "waypoints": Block(("waypoint", "joint"), "rad", f"positions to pass in order; {_METRES}"),
    "velocity": Block(_SIDES, "rad/s", f"velocity {_LIMIT}"),
    "acceleration": Block(_SIDES, "rad/s^2", f"acceleration {_LIMIT}"),
    "jerk": Block(_SIDES, "rad/s^3", f"jerk {_LIMIT}"),
    "position": Block(_SIDES, "rad", f"position {_LIMIT}"),
}
