"""Waypoints from a file, a row each: CSV with or without a header, NumPy's .npy, JSON.

    elbow_joint [deg], wrist_1_joint [deg]      # a header names the joints, perhaps with units
    0, 0
    90, -45

Cells are separated by commas, semicolons, tabs or spaces; lines that start with # are no rows. JSON
is a list of rows, or an object with `waypoints` and, if known, `joint_names` and `unit`.

A prismatic joint is in metres: the robot's limits state which joints slide, and a header may have
[m] or [mm]. The unit "deg", as argument or as key `unit`, is for angles only.
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trajopt.core import files, keys
from trajopt.core.arrays import Array
from trajopt.core.chain import chain_of
from trajopt.core.exceptions import FileNote, InvalidInput, UnitWarning
from trajopt.core.keys import Key, note
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.tables import waypoint_table
from trajopt.core.units import ANGLES, LENGTHS, UNITS, asked, completed, contradicted, mixed_units
from trajopt.formats import csv_file
from trajopt.formats.robot_limits import RobotLimits
from trajopt.formats.samples import known_as

ENDINGS = (".csv", ".txt", ".npy", ".json")

TABLE = {
    "waypoints": Key(keys.a_list, "a row each"),
    "joint_names": Key(keys.a_list, "one per column"),
    "unit": Key(keys.anything, "deg or rad, or a unit per joint"),
}
"""The keys of a JSON file of waypoints."""

_TIMES = ("t", "time", "times", "time_from_start")


@dataclass(frozen=True)
class Waypoints:
    """Waypoints as a file has them, in its units.

    Attributes:
        rows: `(waypoints, joints)`.
        joint_names: One per column, or empty where the file does not say.
        units: One per column, None where its heading says none; or empty.
        angle_unit: Of the angles, where the file says it once for all columns.
    """

    rows: Array
    joint_names: tuple[str, ...] = ()
    units: tuple[str | None, ...] = ()
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


def problem(
    path: Path,
    robot: RobotLimits,
    unit: str | None = None,
    *,
    unwrap: bool = True,
    start: Callable[[Sequence[str], int], Sequence[Array]] | None = None,
) -> Problem:
    """The problem of waypoints under a robot's limits.

    Columns belong to the joints that the header names, in any order; without names, to the robot's
    joints in their order.

    Args:
        path: The file of waypoints.
        robot: The limits.
        unit: Units of columns whose header says none, like "deg" or "deg,mm"; by default radians,
            with a `UnitWarning` where they look like degrees, and metres.
        unwrap: Whether joints that turn without end take the nearest way to a waypoint; a
            `FileNote` names them.
        start: Returns position, velocity and acceleration, SI units, of the named joints, where the
            motion begins; the waypoints of the file, one is enough, follow. By default it begins
            at rest at the first of them.

    Raises:
        InvalidInput: Names the file, the row, the joint, the value, and what would be right.
    """
    waypoints = read(path)
    try:
        return _problem(waypoints, robot, unit, path, unwrap=unwrap, start=start)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def begins(limits: Limits, velocity: Array, acceleration: Array) -> dict[str, Array]:
    """Return the demands of a start in motion; joints without a jerk limit have no acceleration."""
    smooth = np.where(limits.jerk_limited, acceleration, 0.0)
    return {"start_velocity": velocity, "start_acceleration": smooth}


def units(path: Path, robot: RobotLimits, unit: str | None = None) -> list[str]:
    """The unit of each column, where `problem` reads the same file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FileNote)
        waypoints = read(path)
    names = _names(waypoints, robot)
    return [own or "rad" for own in _units(waypoints, names, robot, asked(unit))]


def _names(waypoints: Waypoints, robot: RobotLimits) -> tuple[str, ...]:
    names = waypoints.joint_names or robot.names_of(waypoints.rows.shape[1])
    return known_as(names, robot.joint_names, ordered=robot.ordered)


def _problem(
    waypoints: Waypoints,
    robot: RobotLimits,
    unit: str | None,
    path: Path,
    *,
    unwrap: bool,
    start: Callable[[Sequence[str], int], Sequence[Array]] | None,
) -> Problem:
    wanted = asked(unit)
    names = _names(waypoints, robot)
    limits = robot.limits(names)
    units = _units(waypoints, names, robot, wanted)
    state = start(names, waypoints.rows.shape[1]) if start else []
    sizes = [UNITS[own or "rad"] for own in units]
    stated = [state[0] / sizes, *waypoints.rows] if start else waypoints.rows
    # Before scaling: errors show what the file says.
    written = Problem(stated, limits.without("position"), joint_names=names)
    turning = np.array([own not in LENGTHS for own in units])
    said = set(units) & ANGLES.keys()
    if not said and (turning & written.moving).any():
        angles = written.only(turning)
        mixed = mixed_units(angles.waypoints, angles.limits.velocity, angles.limits.acceleration)
        if mixed:
            message = f"{path}: {mixed}; say unit=deg if they are"
            warnings.warn(UnitWarning(message), stacklevel=4)
    described = robot.described(names)
    if not turning.all():
        described["joint_units"] = np.where(turning, "rad", "m").tolist()
    rows = written.waypoints * sizes
    continuous = [joint for joint, name in enumerate(names) if name in robot.continuous]
    if unwrap:
        nearest = np.unwrap(rows[:, continuous], axis=0)
        moved = np.abs(nearest - rows[:, continuous]).max(axis=0, initial=0.0) > 1
        rows[:, continuous] = np.where(moved, nearest, rows[:, continuous])
        turned = [names[joint] for joint, own in zip(continuous, moved, strict=True) if own]
        note(path.name, "the nearest way is taken (not with --no-unwrap) by continuous ", turned)
    return Problem(
        rows,
        limits,
        demands=begins(limits, *state[1:]) if start else {},
        name=path.stem,
        source=f"{path.name}, limits of {robot.source}",
        chain=chain_of(robot.frames, names),
        **described,
    )


def _units(
    waypoints: Waypoints, names: Sequence[str], robot: RobotLimits, wanted: dict[str, str]
) -> list[str | None]:
    """Each column's unit: its header's, else that of other columns, or None for a bare angle.

    Raises:
        InvalidInput: The header, `unit` and the robot contradict each other.
    """
    own_angle = waypoints.angle_unit
    if own_angle and wanted.setdefault("angle", own_angle) != own_angle:
        raise contradicted(own_angle, wanted["angle"])
    stated = waypoints.units or [None] * len(names)
    if len(stated) != len(names):
        right = f"{len(names)} units, one per joint"
        raise InvalidInput("unit", right, value=list(stated))
    slides = []
    for joint, (name, own) in enumerate(zip(names, stated, strict=True)):
        kind = robot.units.get(name)
        if own not in (None, *UNITS):
            raise InvalidInput("unit", " or ".join(UNITS), value=own, joint=joint)
        slide = kind == "m" if own is None else own in LENGTHS
        if kind is not None and slide != (kind == "m"):
            does = "m or mm: {} slides" if kind == "m" else "deg or rad: {} turns"
            right = f"{does.format(name)}, as {robot.source} says"
            raise InvalidInput("unit", right, value=own, joint=joint)
        slides.append(slide)
    found = completed(stated, slides, wanted)
    return [own or ("m" if slide else None) for own, slide in zip(found, slides, strict=True)]


def _read_csv(path: Path) -> Waypoints:
    table = csv_file.table(files.text(path, "waypoints", path.suffix))
    texts = table.texts() if any(table.headings) else set()
    columns = [
        column for column in range(table.indexed, len(table.headings)) if column not in texts
    ]
    columns = columns or list(range(len(table.headings)))
    names = []
    units = []
    for column in columns:
        cell = table.headings[column]
        name, unit = csv_file.heading(cell)
        if name.lower() in _TIMES:
            right = (
                "waypoints, without times (remove the column to plan through them); "
                "`trajopt judge` takes motions"
            )
            raise InvalidInput(f"column {column + 1}", right, value=cell)
        if not name and any(table.headings):
            raise InvalidInput(f"column {column + 1}", "the name of a joint", value=cell)
        names.append(name)
        units.append(unit)
    left_out = [
        table.headings[column] if column in texts else f"column {column + 1}"
        for column in range(len(table.headings))
        if column not in columns
    ]
    if left_out:
        warnings.warn(FileNote(f"{path.name}: left out: {', '.join(left_out)}"), stacklevel=2)
    return Waypoints(
        waypoint_table(table.numbers(columns).tolist(), 1), tuple(filter(None, names)), tuple(units)
    )


def _read_npy(path: Path) -> Waypoints:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            files.opened(path).close()  # a pipe would never end
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
    return Waypoints(waypoint_table(array.astype(float), 1))


def _read_json(path: Path) -> Waypoints:
    table = files.json(path, "waypoints")
    if not isinstance(table, Mapping):
        table = {"waypoints": table}
    others = keys.unread("", table, TABLE, ("waypoints",), strictness="ours")
    keys.note_unread(path.name, others)
    rows = waypoint_table(table["waypoints"], 1)
    names = tuple(files.names_at(table, "joint_names"))
    unit = table.get("unit")
    if isinstance(unit, list):
        return Waypoints(rows, names, tuple(map(str, unit)))
    if unit not in (None, "deg", "rad"):
        raise InvalidInput("unit", '"deg" or "rad", or a unit per joint', value=unit)
    return Waypoints(rows, names, angle_unit=unit)


_READERS = {".csv": _read_csv, ".txt": _read_csv, ".npy": _read_npy, ".json": _read_json}
