"""Chunks and episodes of learned policies, from the files in which they are kept.

- `.csv`, `.txt`, `.npz`, `.npy`, `.json`: as a motion's (`trajopt.formats.motion`), where a column
  `chunk` or `episode_index` tells several apart, an array has a further axis for them, or a list
  has a table for each.

What is wrong with one of them does not hinder the others: it has its error in place of samples.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.core import files
from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.core.units import ANGLES, asked
from trajopt.formats import arrays, csv_file, samples_csv
from trajopt.formats.csv_file import Table
from trajopt.formats.samples import Samples

ENDINGS = (".csv", ".txt", ".npz", ".npy", ".json")
"""Endings of the files that `read` takes."""

# Headings of columns that say to which episode and to which chunk a line belongs.
_KEYS = (
    re.compile(r"episode(?:[_ ]?(?:index|id|idx|nr))?", re.IGNORECASE),
    re.compile(r"chunk(?:[_ ]?(?:index|id|idx|nr))?", re.IGNORECASE),
)


@dataclass(frozen=True, eq=False)
class Episode:
    """An episode or a chunk of a file.

    Attributes:
        name: the file's name, with the number of the part where there are several.
        samples: None where they cannot be used.
        error: what is wrong then.
    """

    name: str
    samples: Samples | None
    error: InvalidInput | None = None


def read(
    path: Path,
    unit: str | None = None,
    joint_units: Mapping[str, str] = MappingProxyType({}),
    *,
    rate: float | None = None,
    size: int | None = None,
) -> list[Episode]:
    """Read the chunks or episodes of a file.

    Args:
        path: the file.
        unit: units of columns whose heading says none, like "deg" or "deg,mm,ms"; by default rad.
        joint_units: "rad" or "m" by the names of the robot's joints, where known.
        rate: targets per second, where the file has no times.
        size: number of targets of a chunk, where the file does not tell chunks apart; the last
            chunk of an episode may be shorter.

    Raises:
        InvalidInput: The file cannot be read, or has no samples; names it and what would be right.
    """
    wanted = asked(unit)
    try:
        whole = list(_tables(path, rate))
        every = [own for name, table in whole for own in _told_apart(name, table)]
        if size is not None:
            every = [own for name, table in every for own in _of_size(name, table, size)]
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    headings = [own for _, table in every if isinstance(table, Table) for own in table.headings]
    if "angle" not in wanted:
        wanted["angle"] = "rad"
        if not any(csv_file.heading(own)[1] in ANGLES for own in headings):
            note = f"{path.name}: angles are read in rad; unit=deg if not"
            warnings.warn(FileNote(note), stacklevel=2)
    parts: list[Episode] = []
    for number, (name, table) in enumerate(every, start=1):
        own_name = name or (f"{path.stem}-{number}" if len(every) > 1 else path.stem)
        with warnings.catch_warnings():
            if parts:  # what was said of the first one
                warnings.simplefilter("ignore", FileNote)
            parts.append(_part(own_name, table, path.name, wanted, joint_units, rate))
    return parts


def _part(
    name: str,
    table: Table | InvalidInput,
    file: str,
    wanted: Mapping[str, str],
    joint_units: Mapping[str, str],
    rate: float | None,
) -> Episode:
    """Return the samples of a table, or what is wrong with it."""
    try:
        if isinstance(table, InvalidInput):
            raise table
        timed = _timed(table, rate)
        return Episode(name, samples_csv.of_table(timed, file, wanted, joint_units))
    except InvalidInput as error:
        return Episode(name, None, error)


def _tables(path: Path, rate: float | None) -> Iterator[tuple[str, Table | InvalidInput]]:
    """Yield the tables of a file with their names, which are empty where it has none."""
    if path.suffix in (".csv", ".txt"):
        text = files.text(path, "samples", "CSV")
        yield "", csv_file.parted(csv_file.table(text, commented=True))
        return
    for name, held in _held(path):
        try:
            own = dict(held)
            for key, value in own.items():
                array = _array(value)
                if array is not None and array.ndim == 2 and len(array) == 1:
                    raise InvalidInput(key, "at least two targets", value=1)
            if rate is not None:
                own = {"fps": rate, **{key: value for key, value in own.items() if key != "fps"}}
            yield name, arrays.table(own, path.name)
        except InvalidInput as error:
            yield name, error


def _held(path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the arrays of each chunk of a file of arrays, with its name where it has one."""
    if path.suffix == ".json":
        given = files.json(path, "samples")
    elif path.suffix in (".npz", ".npy"):
        given = arrays.load(path)
    else:
        right = f"a file ending in {', '.join(ENDINGS)}"
        raise InvalidInput("PATH", right, value=str(path))
    if isinstance(given, Mapping) and len(given) == 1:  # {"chunks": [...]}
        (only,) = given.values()
        given = only if _is_list_of_tables(only) else given
    if _is_list_of_tables(given):
        for own in given:
            yield str(own.get("name", "")), own
        return
    if isinstance(given, np.ndarray):
        given = {"action": given}
    if not isinstance(given, Mapping):
        raise InvalidInput("samples", "a table of arrays, or a list with a table for each chunk")
    sizes = {len(own) for own in map(_array, given.values()) if own is not None and own.ndim == 3}
    if len(sizes) != 1:
        yield "", given
        return
    (count,) = sizes
    for number in range(count):
        yield "", {key: _of_chunk(value, number, count) for key, value in given.items()}


def _is_list_of_tables(given: Any) -> bool:
    """Return whether this is a list of tables, each with an array of two axes."""
    if not isinstance(given, list) or not given:
        return False
    if not all(isinstance(own, Mapping) for own in given):
        return False
    two = [own for own in map(_array, given[0].values()) if own is not None and own.ndim == 2]
    return bool(two)


def _array(value: Any) -> NDArray[Any] | None:
    try:
        return np.asarray(value)
    except ValueError:  # of several lengths
        return None


def _of_chunk(value: Any, number: int, count: int) -> Any:
    """Return what one chunk has of an array: its part of one with an axis for the chunks."""
    array = _array(value)
    if array is None or array.dtype.kind not in "iuf" or array.ndim < 2 or len(array) != count:
        return value
    return array[number]


def _told_apart(
    name: str, table: Table | InvalidInput
) -> Iterator[tuple[str, Table | InvalidInput]]:
    """Yield the parts of a table that its columns of episodes and chunks tell apart."""
    if isinstance(table, InvalidInput):
        yield name, table
        return
    keys = [
        index
        for pattern in _KEYS
        for index, own in enumerate(table.headings)
        if pattern.fullmatch(csv_file.heading(own)[0].strip())
    ]
    if not keys:
        yield name, table
        return
    rows = [*zip(*(table.columns[index] for index in keys), strict=True)]
    words = [re.split(r"[_ ]", table.headings[index])[0].lower() for index in keys]
    headings = list(table.headings)
    for index, word in zip(keys, words, strict=True):
        headings[index] = f"{word}_index"  # it is no joint's
    table = replace(table, headings=headings, cells=table.columns)
    for key in dict.fromkeys(rows):
        own_rows = [row for row, other in enumerate(rows) if other == key]
        said = "-".join(f"{word}-{value}" for word, value in zip(words, key, strict=True))
        yield "-".join(filter(None, [name, said])), _rows(table, own_rows)


def _of_size(
    name: str, table: Table | InvalidInput, size: int
) -> Iterator[tuple[str, Table | InvalidInput]]:
    """Yield parts of as many lines; a single line left over joins the part before it."""
    if isinstance(table, InvalidInput):
        yield name, table
        return
    count = len(table.columns[0])
    firsts = list(range(0, max(count - 1, 1), size))
    for number, (first, last) in enumerate(zip(firsts, [*firsts[1:], count], strict=True), 1):
        said = f"{name}-{number}" if name and len(firsts) > 1 else name
        yield said, _rows(table, range(first, last))


def _rows(table: Table, rows: Sequence[int]) -> Table:
    """Return some lines of a table."""
    return replace(
        table,
        lines=[table.lines[row] for row in rows],
        cells=[[own[row] for row in rows] for own in table.columns],
    )


def _timed(table: Table, rate: float | None) -> Table:
    """Return the table with a column of times, at a rate, in place of what it has of times.

    Columns without headings are joints in their order.
    """
    headings, cells = list(table.headings), list(table.columns)
    if not any(headings):
        headings = [f"joint_{index + 1}" for index in range(len(headings))]
    clocks = [i for i, own in enumerate(headings) if samples_csv.kind(own) == "time"]
    if rate is None and not clocks:
        raise InvalidInput("times", "a column of times, or --rate, targets per second")
    if rate is not None:
        step = 1 / Decimal(str(rate))
        for index in reversed(clocks):
            del headings[index], cells[index]
        headings.append("time [s]")
        cells.append([str(step * row) for row in range(len(table.columns[0]))])
    return replace(table, headings=headings, cells=cells)
