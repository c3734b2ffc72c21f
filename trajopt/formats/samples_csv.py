"""Samples of a motion as CSV: the time, then every joint's position, velocity and acceleration.

    time [s],elbow_joint [rad],wrist_1_joint [rad],elbow_joint [rad/s],wrist_1_joint [rad/s]
    0.0,0.0,0.0,0.0,0.0

The unit says which of them a column is. Accelerations are there where a controller should use them:
where it should join the samples with quintic pieces (`trajopt.interpolation`).
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from trajopt import numerals
from trajopt.exceptions import InvalidInput
from trajopt.formats.samples import Samples

TIME = "time [s]"
UNITS = ("rad", "rad/s", "rad/s^2")  # of positions and their derivatives

_HEADING = re.compile(r"(?P<name>.+) \[(?P<unit>[^\]]+)\]")


def write(path: Path, samples: Samples) -> None:
    """Write samples; every number comes back to the last bit."""
    header = [TIME]
    columns = [samples.times]
    tables = (samples.positions, samples.velocities, samples.accelerations)
    for unit, table in zip(UNITS, tables, strict=True):
        if table is not None:
            header += [f"{name} [{unit}]" for name in samples.joint_names]
            columns += list(table.T)
    values = np.column_stack(columns)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(header)
        rows.writerows(values.tolist())


def read(path: Path) -> Samples:
    """Read what `write` wrote.

    Raises:
        InvalidInput: Names the file, the row, the column, the value, and what would be right.
    """
    try:
        return _samples(path.read_text(encoding="utf-8-sig"))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        right = "a readable CSV file"
        raise InvalidInput("samples", right, value=reason, file=str(path)) from None


def _samples(text: str) -> Samples:
    header, *table = list(csv.reader(text.splitlines())) or [[]]
    if not header or header[0] != TIME:
        raise InvalidInput("header", f"{TIME}, then columns like elbow [rad]", value=header)
    names: dict[str, list[str]] = {unit: [] for unit in UNITS}
    for heading in header[1:]:
        match = _HEADING.fullmatch(heading)
        if match is None or match["unit"] not in names:
            units = ", ".join(UNITS)
            raise InvalidInput("header", f"a name and one of [{units}]", value=heading)
        names[match["unit"]].append(match["name"])
    values = _values(header, table)
    joint_names = tuple(names["rad"])
    tables: list[np.ndarray | None] = []
    for unit in UNITS:
        columns = []
        for name in joint_names:
            if names[unit]:
                columns.append(header.index(f"{name} [{unit}]"))
        tables.append(values[:, columns] if columns else None)
    positions, velocities, accelerations = tables
    if positions is None:
        raise InvalidInput("header", "positions, like elbow [rad]", value=header)
    return Samples(joint_names, values[:, 0], positions, velocities, accelerations)


def _values(header: list[str], table: list[list[str]]) -> np.ndarray:
    rows = []
    for number, cells in enumerate(table, start=1):
        if len(cells) != len(header):
            right = f"{len(header)} numbers, one per column of the header"
            raise InvalidInput(f"sample {number}", right, value=len(cells))
        row = []
        for heading, cell in zip(header, cells, strict=True):
            try:
                row.append(numerals.decimal(cell))
            except ValueError:
                key = f"sample {number}, {heading}"
                raise InvalidInput(key, "a finite number", value=cell) from None
        rows.append(row)
    return np.array(rows, dtype=float).reshape(len(rows), len(header))
