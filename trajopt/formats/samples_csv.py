"""Samples of a motion as CSV: the time, then every joint's position, velocity and acceleration.

    time [s],elbow_joint [rad],wrist_1_joint [rad],elbow_joint [rad/s],wrist_1_joint [rad/s]
    0.0,0.0,0.0,0.0,0.0

The unit says which of them a column is. Accelerations are there where a controller should use them:
where it should join the samples with quintic pieces (`trajopt.core.interpolation`).
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.core import files, numerals
from trajopt.core.exceptions import InvalidInput
from trajopt.formats import waypoints
from trajopt.formats.samples import Samples

TIME = "time [s]"
_RATES = ("", "/s", "/s^2")  # of positions and their derivatives

Array = NDArray[np.float64]

_TIME = -1  # in place of a derivative's order
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_LENGTHS = {"rad": 1.0, "deg": pi / 180, "°": pi / 180, "m": 1.0, "mm": 1e-3}  # rad or m
_PER_TIME = (("",), ("/s",), ("/s^2", "/s²", "/s2", "/s/s"))  # of each derivative
_SUFFIXES = {
    0: ("_position", "_pos"),
    1: ("_velocity", "_vel"),
    2: ("_acceleration", "_acc"),
}


def _sizes() -> dict[str, tuple[int, float]]:
    """The derivative's order and the size in SI units of every unit."""
    sizes = {unit: (_TIME, size) for unit, size in _SECONDS.items()}
    for order, rates in enumerate(_PER_TIME):
        for rate in rates:
            for unit, size in _LENGTHS.items():
                sizes[unit + rate] = order, size
    return sizes


_SIZES = _sizes()


def write(path: Path, samples: Samples) -> None:
    """Write samples; every number comes back to the last bit."""
    header = [TIME]
    columns = [samples.times]
    tables = (samples.positions, samples.velocities, samples.accelerations)
    units = samples.joint_units or ["rad"] * len(samples.joint_names)
    for rate, table in zip(_RATES, tables, strict=True):
        if table is not None:
            names = zip(samples.joint_names, units, strict=True)
            header += [f"{name} [{unit}{rate}]" for name, unit in names]
            columns += list(table.T)
    values = np.column_stack(columns)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(header)
        rows.writerows(values.tolist())


def read(path: Path) -> Samples:
    """Read samples: what `write` wrote, and what others write in other units.

    Cells are separated by commas, semicolons or tabs; empty lines and lines that start with # are
    no samples (but a header may start with it). A column of derivatives may be called as its joint
    is, or `elbow_velocity`, `elbow_acceleration`. Time may start anywhere; it is read exactly and
    counted from the first sample.

    Raises:
        InvalidInput: Names the file, the line, the column, the value, and what would be right.
    """
    text = files.text(path, "samples", "CSV")
    try:
        return _samples(text)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    except csv.Error as error:
        raise files.unreadable(path, "samples", "CSV", error) from None


@dataclass(frozen=True)
class _Column:
    """A column: its heading as written, the joint's name, the derivative's order, the unit's size.

    `length` is "m" where the unit is one of lengths, else "rad".
    Of the column of times the order is `_TIME`.
    """

    heading: str
    name: str
    order: int
    size: float
    length: str


def _samples(text: str) -> Samples:
    number, heading, lines = _split(text)
    separator = next((own for own in ";\t" if own in heading), ",")
    cells = _cells(heading.lstrip("# "), separator)
    columns = []
    for place, cell in enumerate(cells, start=1):
        columns.append(_column(f"line {number}, column {place}", cell))
    layout = _layout(number, columns)
    rows = []
    for line, content in lines:
        rows.append(_row(line, _cells(content, separator), columns))
    if len(rows) < 2:
        raise InvalidInput("samples", "at least two lines of numbers", value=len(rows))
    times = _times(lines, rows, columns)
    values = np.array(rows, dtype=float)
    tables: list[Array | None] = []
    for order in range(len(_RATES)):
        own = layout[order]
        sizes = np.array([columns[place].size for place in own])
        tables.append(values[:, own] * sizes if own else None)
    positions, velocities, accelerations = tables
    if positions is None:
        raise InvalidInput(f"line {number}", "columns of positions, like elbow [rad]")
    names = tuple(columns[place].name for place in layout[0])
    units = tuple(columns[place].length for place in layout[0])
    return Samples(names, times, positions, velocities, accelerations, units)


def _split(text: str) -> tuple[int, str, list[tuple[int, str]]]:
    """The header with its line's number, and the lines of samples with theirs."""
    header = None
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip(" ,;\t"):
            continue
        if header is None:
            header = number, line
        elif not line.lstrip().startswith("#"):
            lines.append((number, line))
    if header is None:
        raise InvalidInput("line 1", f"a header: {TIME}, then columns like elbow [rad]")
    return *header, lines


def _cells(line: str, separator: str) -> list[str]:
    (row,) = csv.reader([line], delimiter=separator)
    return [cell.strip() for cell in row]


def _column(where: str, heading: str) -> _Column:
    name, said = waypoints.heading(heading)
    unit = (said or "").replace(" ", "")
    if not name or unit not in _SIZES:
        right = "a name and a unit, like time [s], elbow [rad] or elbow_velocity [deg/s]"
        raise InvalidInput(where, right, value=heading)
    order, size = _SIZES[unit]
    for suffix in _SUFFIXES.get(order, ()):
        name = name.removesuffix(suffix)
    length = "m" if unit.startswith("m") else "rad"
    return _Column(heading, name, order, size, length)


def _layout(line: int, columns: Sequence[_Column]) -> dict[int, list[int]]:
    """Where each order's columns are, all in the order of the positions' joints."""
    places: dict[int, dict[str, int]] = {order: {} for order in (_TIME, *range(len(_RATES)))}
    for place, column in enumerate(columns):
        own = places[column.order]
        if column.name in own or (own and column.order == _TIME):
            where = f"line {line}, column {place + 1}"
            raise InvalidInput(where, "a column that is not there twice", value=column.heading)
        own[column.name] = place
    if not places[_TIME]:
        raise InvalidInput(f"line {line}", f"{TIME}, then columns like elbow [rad]")
    joints = list(places[0])
    for order, rate in enumerate(_RATES):
        own = places[order]
        if own and set(own) != set(joints):
            odd = sorted(set(own) ^ set(joints))[0]
            right = f"a column [rad{rate}] for each joint that has positions, and no other: {odd}"
            raise InvalidInput(f"line {line}", right)
        for name, place in own.items():
            if columns[place].length != columns[places[0][name]].length:
                where = f"line {line}, column {place + 1}"
                right = f"a unit that goes with {columns[places[0][name]].heading}"
                raise InvalidInput(where, right, value=columns[place].heading)
    layout = {_TIME: list(places[_TIME].values())}
    for order in range(len(_RATES)):
        layout[order] = [places[order][name] for name in joints if places[order]]
    return layout


def _row(line: int, cells: Sequence[str], columns: Sequence[_Column]) -> list[Any]:
    if len(cells) != len(columns):
        right = f"{len(columns)} cells, one per column of the header"
        raise InvalidInput(f"line {line}", right, value=len(cells))
    numbers = []
    for place, (cell, column) in enumerate(zip(cells, columns, strict=True), start=1):
        number = numerals.parsed(cell)
        if not numerals.is_number(number):
            key = f"line {line}, column {place}, {column.heading},"
            raise InvalidInput(key, "a finite number, like -1.5e-3", value=cell)
        numbers.append(Decimal(cell) if column.order == _TIME else number)
    return numbers


def _times(
    lines: Sequence[tuple[int, str]],
    rows: Sequence[Sequence[Any]],
    columns: Sequence[_Column],
) -> Array:
    """Since the first sample, s: of times like 1.7e9 the difference keeps every digit."""
    place = next(n for n, column in enumerate(columns) if column.order == _TIME)
    column = columns[place]
    first = rows[0][place]
    times: list[float] = []
    for (line, _), row in zip(lines, rows, strict=True):
        time = float(row[place] - first) * column.size
        if times and time <= times[-1]:
            key = f"line {line}, column {place + 1}, {column.heading},"
            right = "a time after that of the line before"
            raise InvalidInput(key, right, value=float(row[place]))
        times.append(time)
    return np.array(times)
