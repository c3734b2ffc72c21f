"""Samples of a motion as CSV: the time, then every joint's position, velocity and acceleration.

    time [s],elbow_joint [rad],wrist_1_joint [rad],elbow_joint [rad/s],wrist_1_joint [rad/s]
    0.0,0.0,0.0,0.0,0.0

The unit says which of the three a column is. Columns of accelerations make a controller join the
samples with quintic pieces (`trajopt.core.interpolation`).
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.core import files
from trajopt.core.exceptions import InvalidInput
from trajopt.core.units import LENGTHS, UNITS
from trajopt.formats import csv_file
from trajopt.formats.samples import Samples

TIME = "time [s]"

Array = NDArray[np.float64]

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
# The units' ends for positions, velocities and accelerations; the first is written.
_RATES = (("",), ("/s",), ("/s^2", "/s²", "/s2", "/s/s"))
_FIELDS = ("positions", "velocities", "accelerations")
_SUFFIXES = (("_position", "_pos"), ("_velocity", "_vel"), ("_acceleration", "_acc"))


def write(path: Path, samples: Samples) -> None:
    """Write samples; every number comes back to the last bit."""
    header = [TIME]
    columns = [samples.times[:, None]]
    units = samples.joint_units or ["rad"] * len(samples.joint_names)
    for (rate, *_), field in zip(_RATES, _FIELDS, strict=True):
        table = getattr(samples, field)
        if table is not None:
            for name, unit in zip(samples.joint_names, units, strict=True):
                header.append(f"{name} [{unit}{rate}]")
            columns.append(table)
    values = np.hstack(columns)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(header)
        rows.writerows(values.tolist())


def read(path: Path) -> Samples:
    """Read samples, as `write` wrote them, or with other units and spellings.

    Cells are separated by commas, semicolons or tabs. Empty lines and lines that start with # are
    ignored (but a header may start with it). A column of derivatives has its joint's name, or a
    name like `elbow_velocity` or `elbow_acceleration`. Time may start anywhere; it is read exactly
    and counted from the first sample.

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
    """A column: its heading as written, and what the heading says.

    Attributes:
        index: The column's index, from 0.
        name: The joint's name.
        order: The derivative's order; None for the column of times.
        size: The unit's size, in SI units.
        length: "m" for a prismatic joint, else "rad".
    """

    heading: str
    index: int
    name: str
    order: int | None
    size: float
    length: str


def _samples(text: str) -> Samples:
    lines = csv_file.lines(text)
    if not lines:
        raise InvalidInput("line 1", f"a header: {TIME}, then columns like elbow [rad]")
    (first, header), *others = lines
    separator = csv_file.separator_of(header) or ","
    headings = csv_file.cells(header.lstrip("# "), separator)
    columns = []
    for index, cell in enumerate(headings):
        columns.append(_column(first, index, cell))
    time, joints = _by_joint(first, columns)

    rows = []
    times: list[float] = []
    start = Decimal()
    for line, content in others:
        if csv_file.is_comment(content):
            continue
        cells = csv_file.cells(content, separator)
        rows.append(csv_file.numbers(line, cells, headings))
        # Of times like 1.7e9 the difference keeps every digit.
        exact = Decimal(cells[time.index])
        start = start if times else exact
        elapsed = float(exact - start) * time.size
        if times and elapsed <= times[-1]:
            key = csv_file.place(line, time.index + 1, time.heading)
            raise InvalidInput(key, "a time after that of the line before", value=float(exact))
        times.append(elapsed)
    if len(rows) < 2:
        raise InvalidInput("samples", "at least two lines of numbers", value=len(rows))
    values = np.array(rows)
    tables: dict[str, Any] = {}
    for field, own in zip(_FIELDS, joints, strict=True):
        if own:
            places = [column.index for column in own]
            sizes = [column.size for column in own]
            tables[field] = values[:, places] * sizes
    names = [column.name for column in joints[0]]
    units = [column.length for column in joints[0]]
    return Samples(
        joint_names=tuple(names),
        times=np.array(times),
        joint_units=tuple(units),
        **tables,
    )


def _column(line: int, index: int, heading: str) -> _Column:
    name, said = csv_file.heading(heading)
    unit = (said or "").replace(" ", "").replace("°", "deg")
    if name and unit in _SECONDS:
        return _Column(heading, index, name, None, _SECONDS[unit], "")
    for order, rates in enumerate(_RATES):
        for rate in rates:
            length = unit.removesuffix(rate)
            if name and length in UNITS and unit == length + rate:
                for suffix in _SUFFIXES[order]:
                    name = name.removesuffix(suffix)
                kind = "m" if length in LENGTHS else "rad"
                return _Column(heading, index, name, order, UNITS[length], kind)
    right = "a name and a unit, like time [s], elbow [rad] or elbow_velocity [deg/s]"
    raise InvalidInput(csv_file.place(line, index + 1, ""), right, value=heading)


def _by_joint(line: int, columns: Sequence[_Column]) -> tuple[_Column, list[list[_Column]]]:
    """The column of times, and each derivative's columns, in the order of the positions' joints.

    Raises:
        InvalidInput: A column is missing, is there twice, or has another kind of unit.
    """
    where = f"line {line}"
    found: dict[tuple[int | None, str], _Column] = {}
    for column in columns:
        key = (column.order, "" if column.order is None else column.name)
        if key in found:
            own = csv_file.place(line, column.index + 1, "")
            raise InvalidInput(own, "a column that is not there twice", value=column.heading)
        found[key] = column
    time = found.pop((None, ""), None)
    if time is None:
        raise InvalidInput(where, f"{TIME}, then columns like elbow [rad]")
    names = [name for order, name in found if order == 0]
    if not names:
        raise InvalidInput(where, "columns of positions, like elbow [rad]")
    by_order: list[list[_Column]] = []
    for order in range(len(_RATES)):
        own_names = {name for own, name in found if own == order}
        if own_names and own_names != set(names):
            odd = min(own_names ^ set(names))
            right = f"a column [rad{_RATES[order][0]}] for each joint that has positions"
            raise InvalidInput(where, f"{right}, and no other: {odd}")
        by_order.append([found[order, name] for name in names if own_names])
        for column, position in zip(by_order[order], by_order[0], strict=False):
            if column.length != position.length:
                own = csv_file.place(line, column.index + 1, "")
                right = f"a unit that goes with {position.heading}"
                raise InvalidInput(own, right, value=column.heading)
    return time, by_order
