"""A trial as one sealed JSON text, and back: the only format in which trials are kept.

    {
    "schema": "trajopt-4",
    "sha256": "8d8a…",
    "id": "0123456789abcdef0123",
    "problem": {"name": …, "waypoints": …, "limits": …},
    "planner": "exact",
    …
    "certificate": {…},
    "solution": {"status": …, "trajectory": {"breaks": …, "coefficients": …}, "history": …}
    }

Its first three lines are the head. The SHA-256 is that of all bytes after the line that states it.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

from trajopt.benchmark.store import fields
from trajopt.benchmark.store.document import (
    Malformed,
    check_table,
    pack,
    packed_solution,
    problem_of,
    problem_table,
    solution_of,
    unpack,
)
from trajopt.benchmark.store.fields import SEED_MAX
from trajopt.benchmark.trial import Trial
from trajopt.core import files
from trajopt.core.exceptions import StoreError
from trajopt.core.harmless import harmless
from trajopt.core.limits import KINDS, LIMIT_NAMES, Use
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.judging.certificate import Certificate, Tolerance, Worst
from trajopt.planners.planner import Relation

SCHEMA = 4  # raise it whenever a reader of this version could misread a text or `results.h5`
MAX_BYTES = files.MAX_BYTES
START = b'{\n"schema": "trajopt-'

_NAMES = [field.name for field in fields.OWN_FIELDS]
_KEYS = ("schema", "sha256", "id", "problem", *_NAMES, "certificate", "solution")
_VERDICT = ("duration", "dilation", "flaws")
_ERRORS = ("waypoint", "continuity")
_WORST = tuple(field.name for field in dataclasses.fields(Worst))
_LEAST = "least_times"  # a use, of problems that ask for least times
_HEAD = re.compile(
    rb'\{\n"schema": "trajopt-(?P<schema>\d{1,9})",\n'
    rb'"sha256": "(?P<sha256>[0-9a-f]{64})",\n'
    rb'(?P<body>"id": "(?P<id>[0-9a-f]{20})",\n)'
)
_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False, separators=(",", ":"))
_ESCAPE = re.compile(r"(?<!\\)(?:\\\\)*\\[ubfr]")  # escapes of control characters


class WrongSchema(StoreError):
    """A file that another version wrote and this one does not read."""

    def __init__(self, place: str) -> None:
        words = "written by another version of trajopt; run again into another folder"
        super().__init__(f"{place}: {words}")


def stated_id(text: bytes) -> str:
    """Return the identity that a text states, without checking the rest."""
    return _head(text)["id"].decode()


def _head(text: bytes) -> re.Match[bytes]:
    found = _HEAD.match(text)
    if found is None:
        raise Malformed("it does not start as a trial's text does")
    if int(found["schema"]) != SCHEMA:
        raise WrongSchema("a trial")
    return found


def write(trial: Trial, *, brief: bool = False) -> bytes:
    """Return the trial's text; brief: its trajectory is stated joint by joint.

    Raises:
        TypeError, ValueError, StoreError: As `written` does.
    """
    return written(trial, brief=brief)[0]


def written(trial: Trial, *, brief: bool = False) -> tuple[bytes, Trial]:
    """Return the trial's text, and the trial that it states: every text can be read back.

    Raises:
        TypeError, ValueError: No text can hold the trial.
        StoreError: The seed is negative or has more than 63 bits.
    """
    if not 0 <= trial.seed <= SEED_MAX:
        raise StoreError(f"seed {trial.seed} cannot be stored: expected 0 to {SEED_MAX}")
    table: dict[str, Any] = {"id": trial.id}
    table["problem"] = problem_table(trial.problem)
    table |= pack({name: getattr(trial, name) for name in _NAMES})
    table["certificate"] = None
    if trial.solution.trajectory is not None:
        table["certificate"] = certificate_table(trial.certificate)
    table["solution"] = packed_solution(trial.solution, brief=brief)
    text = sealed(table)
    return text, read(text)


def sealed(table: Mapping[str, Any]) -> bytes:
    """Return the text of what a trial states, `id` first, with its seal."""
    lines = [f'"{name}": {_ENCODER.encode(value)}' for name, value in table.items()]
    body = ",\n".join(lines) + "\n}\n"
    return seal(body.encode())


def seal(body: bytes) -> bytes:
    """Return the whole text, for all of it after its checksum."""
    digest = hashlib.sha256(body).hexdigest()
    head = f'{{\n"schema": "trajopt-{SCHEMA}",\n"sha256": "{digest}",\n'
    return head.encode() + body


def read(text: bytes) -> Trial:
    """Return the trial of a text, with the verdict that the text states.

    Raises:
        ValueError, TypeError: The text is damaged, edited, or no trial's.
        WrongSchema: Another version wrote it.
    """
    table = row(text)
    check_table("trial", table, _KEYS)
    own = {name: table[name] for name in _NAMES}
    own["options"] = unpack(own["options"])
    fields.check(own)
    _check_provenance(own["provenance"])
    if own["batch"] < 1:
        raise Malformed("batch: expected 1 or more")
    own["relation"] = Relation[own["relation"]]
    own["status"] = Status(own["status"])
    problem = _problem(table["problem"])
    solution = solution_of(table["solution"])
    certificate = certificate_of(table["certificate"], problem)
    if certificate is not None and solution.trajectory is None:
        raise Malformed("certificate: there is no trajectory")
    trial = Trial(problem=problem, solution=solution, certificate=certificate, **own)
    if trial.id != table["id"]:
        raise Malformed(f"id: {table['id']}, but its content makes it {trial.id}")
    return trial


def problem(text: bytes) -> Problem:
    """Return the problem of a text; raises as `read` does."""
    return _problem(row(text)["problem"])


def row(text: bytes) -> dict[str, Any]:
    """Return what a whole text states, by name; its seal is checked, its values are not."""
    found = _head(text)
    if len(text) > MAX_BYTES:
        raise Malformed(f"it has more than {MAX_BYTES / 1e6:g} MB")
    digest = hashlib.sha256(memoryview(text)[found.start("body") :]).hexdigest()
    if digest.encode() != found["sha256"]:
        raise Malformed("its checksum differs: it was damaged or edited")
    said = text.decode()
    if said.count(",") > files.MAX_VALUES:
        raise Malformed(f"it has more than {files.MAX_VALUES} values")
    _check_characters(said)
    table: dict[str, Any] = files.strict_json(said)
    return table


def _check_characters(said: str) -> None:
    """Refuse control characters, written as they are or as JSON's escapes."""
    lines = said.replace("\n", "")
    escaped = "\\" in said and _ESCAPE.search(said)
    if escaped or harmless(lines, lines=False) != lines:
        raise Malformed("a text with control characters")


def _problem(table: Any) -> Problem:
    """One object for the trials of one problem, however many there are."""
    digest = table["digest"]
    known = _PROBLEMS.get(digest)
    if known is None or known.table != table:
        known = _StatedProblem(table, problem_of(table))
        _PROBLEMS[digest] = known
    return known.problem


class _StatedProblem(NamedTuple):
    """A problem, and the table that states it."""

    table: Any
    problem: Problem


_PROBLEMS: dict[str, _StatedProblem] = {}  # by their digests


def _check_provenance(provenance: Mapping[str, Any]) -> None:
    """Check what a trial's identity is computed from."""
    for name, text in provenance.items():
        if not isinstance(text, str):
            raise Malformed(f"provenance: {name}: expected text, found {text!r:.80}")
    if "mintime" not in provenance:
        raise Malformed("provenance: trajopt, the package's version, is missing")


def certificate_table(certificate: Certificate | None) -> Any:
    """Return a certificate in JSON's terms; joints count from 1."""
    if certificate is None:
        return None
    table: dict[str, Any] = {name: getattr(certificate, name) for name in _VERDICT}
    worst: dict[str, Any] = dict.fromkeys(LIMIT_NAMES)
    worst |= {key: use._asdict() for key, use in certificate.uses.items()}
    worst |= {name: asdict(getattr(certificate, name)) for name in _ERRORS}
    if certificate.least_times is not None:
        worst[_LEAST] = certificate.least_times._asdict()
    for own in worst.values():
        if own is not None and own["joint"] is not None:
            own["joint"] += 1
    table |= worst
    table["tolerance"] = asdict(certificate.tolerance)
    return pack(table)


def certificate_of(table: Any, problem: Problem) -> Certificate | None:
    """Return the stated certificate.

    Raises:
        ValueError, TypeError: The table states no certificate, or uses of unknown limits.
    """
    if table is None:
        return None
    check_table("certificate", table, (*_VERDICT, *_ERRORS, "tolerance"), (*KINDS, _LEAST))
    stated = unpack(table)
    flaws = stated["flaws"]
    if not isinstance(flaws, list) or not all(isinstance(flaw, str) for flaw in flaws):
        raise Malformed("certificate: flaws: expected texts")
    uses = {key: _use(key, stated[key], problem) for key in KINDS if stated.get(key)}
    errors = {name: _worst(name, stated[name], problem) for name in _ERRORS}
    certificate = Certificate(
        duration=stated["duration"],
        dilation=stated["dilation"],
        uses=uses,
        flaws=tuple(flaws),
        tolerance=Tolerance(**stated["tolerance"]),
        least_times=_use(_LEAST, stated[_LEAST], problem) if stated.get(_LEAST) else None,
        waypoint=errors["waypoint"],
        continuity=errors["continuity"],
    )
    numbers = (certificate.duration, certificate.dilation)
    _check_numbers("certificate", (*numbers, *vars(certificate.tolerance).values()))
    return certificate


def _use(key: str, table: Any, problem: Problem) -> Use:
    numbers = {name: table[name] for name in Use._fields}
    joint = numbers.pop("joint")
    _check_numbers(key, numbers.values())
    return Use(joint=None if joint is None else _joint(key, joint, problem), **numbers)


def _worst(name: str, table: Any, problem: Problem) -> Worst:
    check_table(f"certificate: {name}", table, _WORST)
    _check_numbers(name, table.values())
    if table["order"] not in range(3):
        raise Malformed(f"certificate: {name}: order {table['order']:g}")
    return Worst(**{**table, "joint": _joint(name, table["joint"], problem)})


def _joint(name: str, joint: Any, problem: Problem) -> int:
    """The index of a joint that is stated by its number from 1."""
    if type(joint) is not int or joint - 1 not in range(problem.joints):
        raise Malformed(f"certificate: {name}: joint {joint!r:.80}")
    return joint - 1


def _check_numbers(name: str, values: Iterable[Any]) -> None:
    for value in values:
        if type(value) not in (int, float):
            raise Malformed(f"certificate: {name}: expected numbers, found {value!r:.80}")
