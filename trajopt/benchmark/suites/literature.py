"""Published problems with the times that were published for them, each with its source.

    published = literature.published("fang2020-task1")
    for claim in published.claims:
        print(claim.method, claim.duration, claim.table)

A file of data/literature is a problem file with a table `published` more: what the source
optimised, what it leaves open and how it is read here, how the digits were read, and its times as
claims. Where a source can be read in two ways, each reading is a file. Problems that cannot be
stated here wait in data/literature/beyond, with the reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from itertools import starmap
from math import pi
from pathlib import Path
from typing import Any

from trajopt.benchmark.suites.suite import Suite
from trajopt.core import built_in, numerals
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.files import check_keys, text_at, toml
from trajopt.core.problem import Problem
from trajopt.explain.verdicts import Claim

# Raise it whenever a file changes, or one is added.
VERSION = 2

_SECONDS = {"s": Decimal(1), "ms": Decimal("1e-3")}
_JERK_UNITS = {"deg": pi / 180, "rad": 1.0}  # rad
_TEXTS = ("doi", "family", "objective", "reading", "note", "transcription", "checked")
_CLAIM_TEXTS = ("method", "table", "objective", "family")


@dataclass(frozen=True, eq=False)
class Published:
    """A published problem, and what is known of its publication.

    Attributes:
        name: of the file.
        source: paper and tables.
        problem: as it is read here; None where it cannot be stated.
        beyond: why it cannot be stated.
        doi: of the paper, empty if not known.
        family: of trajectories, and the method.
        objective: what the source optimised.
        reading: how it is read here where the source leaves it open.
        unsaid: what the source does not state, or what was not read in it.
        note: anything else.
        transcription: how the digits were read.
        checked: who compared them with the publisher's page.
        claims: the published times.
    """

    name: str
    source: str
    problem: Problem | None
    beyond: str
    doi: str
    family: str
    objective: str
    reading: str
    unsaid: tuple[str, ...]
    note: str
    transcription: str
    checked: str
    claims: tuple[Claim, ...]

    @property
    def families(self) -> list[str]:
        """Families of the claims whose best member the toolkit knows."""
        named = {claim.family for claim in self.claims if claim.family}
        return sorted(named)


def files() -> dict[str, Path]:
    """Return the files of published problems that can be stated, by name."""
    return built_in.files("literature")


def files_beyond() -> dict[str, Path]:
    """Return the files of published problems that cannot be stated, by name."""
    return built_in.files("literature/beyond")


def stream() -> Iterator[Problem]:
    """Yield the published problems in alphabetical order."""
    for file in files().values():
        yield Problem.from_toml(file)


def refuse_beyond(name: str) -> None:
    """Refuse the name of a published problem that cannot be stated here.

    Raises:
        InvalidInput: The name is that of such a problem; gives the reason.
    """
    file = files_beyond().get(name)
    if file is None:
        return
    reason = published(file).beyond
    raise InvalidInput("problem", f"one that can be stated here, but {reason}", value=name)


def published(name_or_path: str | Path) -> Published:
    """Return a published problem by name or path.

    Raises:
        UnknownName: There is no such problem; names those that exist.
        InvalidInput: The file cannot be used; names the file, the key and what would be right.
    """
    known = files() | files_beyond()
    path = known.get(str(name_or_path), Path(name_or_path))
    if not path.is_file():
        raise UnknownName("published problem", str(name_or_path), files())
    try:
        return _published(path)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def _published(path: Path) -> Published:
    table = toml(path, "published problem", number=_printed)
    beyond = text_at(table, "beyond")
    problem = None
    if not beyond:
        problem = Problem.from_toml(path)
    facts = _table(table.get("published", {}), "published")
    check_keys("published.", facts, (*_TEXTS, "unsaid", "claims"))
    texts = {key: text_at(facts, key) for key in _TEXTS}
    unsaid = facts.get("unsaid", [])
    if not isinstance(unsaid, list):
        raise InvalidInput("published.unsaid", "a list of texts", value=unsaid)
    claims = facts.get("claims", [])
    if not isinstance(claims, list):
        raise InvalidInput("published.claims", "tables [[published.claims]]", value=claims)
    return Published(
        name=text_at(table, "name") or path.stem,
        source=text_at(table, "source"),
        problem=problem,
        beyond=beyond,
        unsaid=tuple(map(str, unsaid)),
        claims=tuple(starmap(_claim, enumerate(claims, start=1))),
        **texts,
    )


def _printed(text: str) -> Decimal | float:
    """Return a decimal, which keeps the number of printed digits, or a float for infinity."""
    with suppress(ValueError):
        return numerals.exact(text)
    return float(text)


def _claim(number: int, entry: Any) -> Claim:
    """Read one `[[published.claims]]`: `time` and `unit`; `peak_jerk` needs `jerk_unit`."""
    key = f"published.claims, claim {number}"
    table = _table(entry, key)
    check_keys(f"{key}, ", table, (*_CLAIM_TEXTS, "time", "unit", "peak_jerk", "jerk_unit"))
    texts = {name: text_at(table, name) for name in _CLAIM_TEXTS}
    time = table.get("time")
    if not isinstance(time, Decimal | int) or isinstance(time, bool):
        raise InvalidInput(f"{key}, time", "a finite number", value=time)
    unit = table.get("unit")
    if unit not in _SECONDS:
        raise InvalidInput(f"{key}, unit", '"s" or "ms"', value=unit)
    seconds = _SECONDS[unit]
    printed = Decimal(time)
    # 4.717 has the exponent −3: half a unit of its last digit is 0.0005
    exponent = int(printed.as_tuple().exponent)
    half = Decimal(5).scaleb(exponent - 1)
    try:
        return Claim(
            duration=float(printed * seconds),
            rounding=float(half * seconds),
            peak_jerk=_peak_jerk(key, table),
            **texts,
        )
    except InvalidInput as error:
        raise InvalidInput(f"{key}, {error.key}", error.expected, value=error.value) from None


def _peak_jerk(key: str, table: Mapping[str, Any]) -> tuple[float, ...] | None:
    """Return the peak jerks that the source prints beside a time, rad/s³."""
    if "peak_jerk" not in table:
        return None
    unit = table.get("jerk_unit")
    if unit not in _JERK_UNITS:
        raise InvalidInput(f"{key}, jerk_unit", '"deg" or "rad"', value=unit)
    peaks = table["peak_jerk"]
    numbers = isinstance(peaks, list) and all(isinstance(p, Decimal | int) for p in peaks)
    if not numbers:
        raise InvalidInput(f"{key}, peak_jerk", "one number per joint", value=str(peaks))
    size = _JERK_UNITS[unit]
    return tuple(float(peak) * size for peak in peaks)


def _table(value: Any, key: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InvalidInput(key, "a table", value=value)
    return value


SUITE = Suite(
    "literature", "published problems, with the times published for them", VERSION, stream
)
