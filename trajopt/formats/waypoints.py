"""Waypoints from a file, a row each: CSV with or without a header, NumPy's .npy, JSON.

    elbow_joint [deg], wrist_1_joint [deg]      # a header names the joints, perhaps with units
    0, 0
    90, -45

Cells are separated by commas, semicolons, tabs or spaces; lines that start with # are no rows. JSON
is a list of rows, or an object with `waypoints` and, if known, `joint_names` and `unit`.

A prismatic joint is in metres: the robot says which joints slide, and a header may say [m] or [mm].
"deg" as `--unit` or as `unit` is of the angles only.
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trajopt.core import files, numerals
from trajopt.core.exceptions import InvalidInput, UnitWarning
from trajopt.core.problem import Problem, waypoint_table
from trajopt.core.units import LENGTHS, UNITS, mixed_units
from trajopt.formats import csv_file
from trajopt.formats.robot_limits import RobotLimits

Array = NDArray[np.float64]
Unit = Literal["deg", "rad"]

ENDINGS = (".csv", ".txt", ".npy", ".json")

_ALIASES = {"°": "deg"}
_TIMES = ("t", "time", "times", "time_from_start")


@dataclass(frozen=True)
class Waypoints:
    """Waypoints as a file has them, in its units.

    Attributes:
        rows: `(waypoints, joints)`.
        joint_names: One per column, or empty where the file does not say.
        units: One per column, or empty.
        angle_unit: Of the angles, where the file says it once for all columns.
    """

    rows: Array
    joint_names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    angle_unit: str | None = None


def read(path: Path) -> Waypoints:
    """Read a file of waypoints, by its ending.

    Raises:
        InvalidInput: Names the file, the row, the value, and what would be right.
    """
    if path.suffix not in _READERS:
        endings = ", ".join(ENDINGS)
        raise InvalidInput("waypoints", f"a file ending in {endings}", value=str(path))
    try:
        return _READERS[path.suffix](path)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    except (OSError, ValueError, csv.Error) as error:
        raise files.unreadable(path, "waypoints", path.suffix, error) from None


def problem(path: Path, robot: RobotLimits, unit: Unit | None = None) -> Problem:
    """The problem of waypoints under a robot's limits.

    Columns belong to the joints that the header names, in any order; without names, to the robot's
    joints in their order.

    Args:
        path: The file of waypoints.
        robot: The limits.
        unit: Of angles in the file; by default what its header says, or else radians, with a
            `UnitWarning` where they look like degrees. Metres stay metres.

    Raises:
        InvalidInput: Names the file, the row, the joint, the value, and what would be right.
    """
    waypoints = read(path)
    try:
        return _problem(waypoints, robot, unit, path)
    except InvalidInput as error:
        if error.file is not None:
            raise
        raise error.in_file(str(path)) from None


def _problem(waypoints: Waypoints, robot: RobotLimits, unit: Unit | None, path: Path) -> Problem:
    names = waypoints.joint_names or robot.names_of(waypoints.rows.shape[1])
    limits = robot.limits(names)
    # Before scaling: errors show what the file says.
    written = Problem(waypoints.rows, limits.without("position"), joint_names=names)
    units = _units(waypoints, names, robot, unit)
    turning = np.array([own not in LENGTHS for own in units])
    said = unit or waypoints.angle_unit or waypoints.units
    if not said and (turning & written.moving).any():
        angles = written.only(turning)
        mixed = mixed_units(angles.waypoints, angles.limits.velocity, angles.limits.acceleration)
        if mixed:
            message = f"{path}: {mixed}; say --unit deg if they are"
            warnings.warn(UnitWarning(message), stacklevel=4)
    described = robot.described(names)
    if not turning.all():
        described["joint_units"] = np.where(turning, "rad", "m").tolist()
    return Problem(
        written.waypoints * [UNITS[own] for own in units],
        limits,
        name=path.stem,
        source=f"{path.name}, limits of {robot.source}",
        **described,
    )


def _units(
    waypoints: Waypoints,
    names: Sequence[str],
    robot: RobotLimits,
    asked: Unit | None,
) -> list[str]:
    """Each column's unit: its header's, else that of angles, or metres where the joint slides.

    Raises:
        InvalidInput: The header, `--unit` and the robot contradict each other.
    """
    known = waypoints.angle_unit
    if None not in (asked, known) and asked != known:
        raise InvalidInput("--unit", f"left out, or {known} as the file says", value=asked)
    angle = asked or known or "rad"
    if not waypoints.units:
        return ["m" if robot.units.get(name) == "m" else angle for name in names]
    if len(waypoints.units) != len(names):
        right = f"{len(names)} units, one per joint"
        raise InvalidInput("unit", right, value=list(waypoints.units))
    for joint, (name, own) in enumerate(zip(names, waypoints.units, strict=True)):
        if own not in UNITS:
            raise InvalidInput("unit", " or ".join(UNITS), value=own, joint=joint)
        slides = own in LENGTHS
        kind = robot.units.get(name)
        if kind is not None and slides != (kind == "m"):
            does = "m or mm: {} slides" if kind == "m" else "deg or rad: {} turns"
            right = f"{does.format(name)}, as {robot.source} says"
            raise InvalidInput("unit", right, value=own, joint=joint)
        if asked is not None and not slides and own != asked:
            right = f"--unit left out, or {own} as the header says"
            raise InvalidInput("--unit", right, value=asked)
    return list(waypoints.units)


def _read_csv(path: Path) -> Waypoints:
    text = files.text(path, "waypoints", path.suffix, marks=",;\t\n ")
    every = csv_file.lines(text)
    lines = [(number, line) for number, line in every if not csv_file.is_comment(line)]
    if not lines:
        raise InvalidInput("waypoints", "at least two rows, one per waypoint; it is empty")
    first = lines[0][1]
    separator = csv_file.separator_of(first)
    if separator is None and csv_file.heading(first.strip())[1] is not None:
        separator = ","  # "elbow [deg]" of one joint
    headings = csv_file.cells(first, separator)
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    if all(numerals.parsed(cell) is None for cell in headings):
        names, units = _header(headings)
        lines = lines[1:]
    else:
        headings = [""] * len(headings)
    rows = []
    for number, line in lines:
        cells = csv_file.cells(line, separator)
        rows.append(csv_file.numbers(number, cells, headings))
    return Waypoints(waypoint_table(rows), names, units)


def _header(cells: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The joints' names, and the units, if all columns have one."""
    names = []
    units = []
    for column, cell in enumerate(cells, start=1):
        name, unit = csv_file.heading(cell)
        if name.lower() in _TIMES:
            right = "waypoints, without times; `trajopt judge` takes motions"
            raise InvalidInput(f"column {column}", right, value=cell)
        if not name:
            raise InvalidInput(f"column {column}", "the name of a joint", value=cell)
        names.append(name)
        if unit is not None:
            units.append(_ALIASES.get(unit, unit))
    if len(units) not in (0, len(names)):
        right = "a unit in every column, or in none"
        raise InvalidInput("header", right, value=", ".join(cells))
    return tuple(names), tuple(units)


def _read_npy(path: Path) -> Waypoints:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # Mapped, not read: a header may claim any size.
            array = np.lib.format.open_memmap(path, mode="r")
    except Exception as error:  # of NumPy, of Python's own parser, or of the system
        raise files.unreadable(path, "waypoints", path.suffix, error) from None
    if array.size > files.MAX_VALUES:
        right = f"at most {files.MAX_VALUES} numbers"
        raise InvalidInput("waypoints", right, value=array.size)
    if array.ndim != 2 or array.dtype.kind not in "iuf":
        right = "an array of numbers, (waypoints, joints)"
        raise InvalidInput("waypoints", right, value=f"{array.dtype} {array.shape}")
    return Waypoints(waypoint_table(array.astype(float)))


def _read_json(path: Path) -> Waypoints:
    table = files.json(path, "waypoints")
    if not isinstance(table, Mapping):
        table = {"waypoints": table}
    files.check_keys("", table, ("waypoints", "joint_names", "unit"), ("waypoints",))
    rows = waypoint_table(table["waypoints"])
    names = tuple(files.names_at(table, "joint_names"))
    unit = table.get("unit")
    if isinstance(unit, list):
        return Waypoints(rows, names, tuple(map(str, unit)))
    if unit not in (None, "deg", "rad"):
        raise InvalidInput("unit", '"deg" or "rad", or a unit per joint', value=unit)
    return Waypoints(rows, names, angle_unit=unit)


_READERS = {
    ".csv": _read_csv,
    ".txt": _read_csv,
    ".npy": _read_npy,
    ".json": _read_json,
}
