"""Real robot arms as files: joint names and limits, with the origin of every kind of limit.

name = "ur5e"
description = "Universal Robots UR5e, six joints"
joint_names = ["shoulder_pan_joint", ...]    # optional

[velocity]                                   # the same for acceleration, jerk, position
angle_unit = "deg"
values = [180, 180, 180, 180, 180, 180]
status = "published"
source = "who says so"
checked = "against what, and with which result; or why not"

[falling_velocity]                           # optional: `FallingVelocity`, a number per joint
angle_unit = "rad"
offset = [0.3, 0.2, 0.2, 0.3, 0.35, 0.35]
deceleration = [6, 2.6, 3.5, 4, 17, 5.5]
position = [[-2.75, 2.75], ...]
status = "published"
source = "who says so"
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import pi
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from trajopt.core import built_in, files
from trajopt.core.exceptions import InvalidInput, UnknownName

Array = NDArray[np.float64]

_UNITS = {"deg": pi / 180, "rad": 1.0}  # rad
_KINDS = ("velocity", "acceleration", "jerk", "position")
_FALLING = "falling_velocity"
_FALLING_COLUMNS = {"offset": (0,), "deceleration": (0,), "position": (2,)}
_REQUIRED = ("name", "description", "velocity", "acceleration")

Status = Literal["published", "configuration", "quoted", "assumed", "memory"]


@dataclass(frozen=True)
class Origin:
    """Where an arm's limits of one kind come from. `status` is

    - `published`: the maker's own document, which was read;
    - `configuration`: a robot model or configuration in a public repository, which was read;
    - `quoted`: a book or paper, as somebody else quotes it;
    - `assumed`: nobody publishes it, `rule` says what was assumed instead;
    - `memory`: remembered, not checked.

    `checked` says against which source the numbers were compared in November 2026, and with which
    result, or why they could not be.
    """

    status: Status
    source: str
    address: str = ""
    rule: str = ""
    checked: str = ""


_TEXTS = tuple(field.name for field in fields(Origin))


@dataclass(frozen=True)
class FallingVelocity:
    """A velocity limit that falls to zero towards the ends of a joint's range.

    The joint at `q` may move upwards no faster than `max(0, sqrt(2 d max(0, high − q)) − o)`, and
    downwards no faster than `max(0, sqrt(2 d max(0, q − low)) − o)`. This is Franka's form
    (libfranka, `include/franka/rate_limiting.h`; `<position_based_velocity_limits>` in a URDF).

    Attributes:
        offset: `o`, rad/s (m/s for a prismatic joint).
        deceleration: `d`, rad/s².
        low, high: Where the roots end, rad: not always the joint's position limits.
    """

    offset: float
    deceleration: float
    low: float
    high: float

    def __post_init__(self) -> None:
        if not 0 <= self.offset < np.inf:
            raise InvalidInput("velocity_offset", "a number from 0", value=self.offset)
        if not 0 < self.deceleration < np.inf:
            right = "a positive number"
            raise InvalidInput("deceleration_limit", right, value=self.deceleration)
        if not -np.inf < self.low < self.high < np.inf:
            right = "a finite range, lower below upper"
            raise InvalidInput("position range", right, value=[self.low, self.high])


@dataclass(frozen=True, eq=False)
class ArmFile:
    """What an arm's file says.

    Attributes:
        joint_names: As the arm's ROS description has them, in its order; `joint_1` and so on where
            no description is known.
        limits: By kind, rad and s, `(joints,)` or `(joints, 2)`.
        origins: By kind.
        falling_velocity: One per joint, or empty where the arm has no such limits.
    """

    name: str
    description: str
    joint_names: tuple[str, ...]
    limits: Mapping[str, Array]
    origins: Mapping[str, Origin]
    falling_velocity: tuple[FallingVelocity, ...] = ()


def arm_files() -> dict[str, Path]:
    """Every built-in arm file by name."""
    return built_in.files("robots")


def read(name_or_path: str) -> ArmFile:
    """An arm by built-in name or path; raises `UnknownName`, or `InvalidInput` naming the key."""
    path = arm_files().get(name_or_path, Path(name_or_path))
    if not path.is_file():
        raise UnknownName("robot", name_or_path, arm_files())
    try:
        return _arm(files.toml(path, "robot"))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def _arm(table: Mapping[str, Any]) -> ArmFile:
    known = (*_REQUIRED, "joint_names", *_KINDS, _FALLING)
    files.check_keys("", table, known, _REQUIRED)
    limits: dict[str, Array] = {}
    origins = {}
    for kind in _KINDS:
        if kind in table:
            (limits[kind],) = _columns(kind, table[kind], {"values": (0, 2)})
            origins[kind] = _origin(kind, table[kind])
    falling: tuple[FallingVelocity, ...] = ()
    if _FALLING in table:
        columns = _columns(_FALLING, table[_FALLING], _FALLING_COLUMNS)
        _origin(_FALLING, table[_FALLING])
        rows = np.column_stack(columns).tolist()
        falling = tuple(FallingVelocity(*row) for row in rows)
    joints = len(limits["velocity"])
    names = table.get("joint_names", [f"joint_{joint + 1}" for joint in range(joints)])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InvalidInput("joint_names", "a list of names", value=names)
    counts = {key: len(limits[key]) for key in limits}
    counts |= {"joint_names": len(names), _FALLING: len(falling) or joints}
    for key, count in counts.items():
        if count != joints:
            raise InvalidInput(key, f"{joints}, one per joint of velocity", value=count)
    return ArmFile(
        files.text_at(table, "name"),
        files.text_at(table, "description"),
        tuple(names),
        limits,
        origins,
        falling,
    )


def _columns(kind: str, entry: Any, widths: Mapping[str, tuple[int, ...]]) -> list[Array]:
    """The numbers of one kind of limit, a row per joint, rad and s.

    `widths` says of each key how long its rows may be; 0 means plain numbers.
    """
    if not isinstance(entry, Mapping):
        raise InvalidInput(kind, "a table", value=entry)
    required = (*widths, "angle_unit", "status", "source")
    files.check_keys(f"{kind}.", entry, (*required, *_TEXTS), required)
    unit = entry["angle_unit"]
    if unit not in tuple(_UNITS):
        raise InvalidInput(f"{kind}.angle_unit", '"deg" or "rad"', value=unit)
    columns: list[Array] = []
    for name, allowed in widths.items():
        try:
            values = np.array(entry[name])
        except ValueError:  # ragged
            values = np.array(None)
        width = sum(values.shape[1:])
        if values.dtype.kind not in "if" or values.ndim not in (1, 2) or width not in allowed:
            right = "a number, or a pair [low, high], per joint"
            raise InvalidInput(f"{kind}.{name}", right, value=entry[name])
        if columns and len(values) != len(columns[0]):
            right = f"{len(columns[0])}, one per joint"
            raise InvalidInput(f"{kind}.{name}", right, value=len(values))
        columns.append(values * _UNITS[unit])
    return columns


def _origin(kind: str, entry: Mapping[str, Any]) -> Origin:
    texts: dict[str, Any] = {}
    for key in _TEXTS:
        texts[key] = files.text_at(entry, key)
    statuses = get_args(Status)
    if texts["status"] not in statuses:
        right = " or ".join(statuses)
        raise InvalidInput(f"{kind}.status", right, value=texts["status"])
    return Origin(**texts)
