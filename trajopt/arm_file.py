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

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from trajopt import built_in
from trajopt.exceptions import InvalidInput, UnknownName

Array = NDArray[np.float64]

_UNITS = {"deg": pi / 180, "rad": 1.0}  # rad
_KINDS = ("velocity", "acceleration", "jerk", "position")
_FALLING = "falling_velocity"

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
        return _arm(tomllib.loads(path.read_text(encoding="utf-8")))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InvalidInput(
            "robot",
            "a file like those in data/robots",
            value=f"{type(error).__name__}: {error}",
            file=str(path),
        ) from None


def _arm(table: dict[str, Any]) -> ArmFile:
    name = table.pop("name")
    description = table.pop("description")
    joint_names = table.pop("joint_names", None)
    falling = _falling(table.pop(_FALLING, None))
    limits: dict[str, Array] = {}
    origins = {}
    for kind in table:
        if kind not in _KINDS:
            known = ", ".join(("name", "description", "joint_names", *_KINDS, _FALLING))
            raise InvalidInput(kind, f"one of the keys {known}", value=table[kind])
    for kind, entry in table.items():
        values = np.array(entry.pop("values"), dtype=float)
        limits[kind] = values * _UNITS[entry.pop("angle_unit")]
        origins[kind] = Origin(**entry)
    for kind, origin in origins.items():
        statuses = get_args(Status)
        if origin.status not in statuses:
            raise InvalidInput(f"{kind}.status", " or ".join(statuses), value=origin.status)
    joints = len(limits["velocity"])
    if joint_names is None:
        joint_names = [f"joint_{joint + 1}" for joint in range(joints)]
    if len(joint_names) != joints:
        raise InvalidInput("joint_names", f"{joints} names", value=joint_names)
    if falling and len(falling) != joints:
        raise InvalidInput(_FALLING, f"{joints} values, one per joint", value=len(falling))
    return ArmFile(name, description, tuple(joint_names), limits, origins, falling)


def _falling(entry: dict[str, Any] | None) -> tuple[FallingVelocity, ...]:
    """The table of falling velocity limits; empty where there is none."""
    if entry is None:
        return ()
    unit = _UNITS[entry.pop("angle_unit")]
    columns = [unit * np.array(entry.pop(key)) for key in ("offset", "deceleration", "position")]
    Origin(**entry)
    rows = np.column_stack(columns).tolist()
    return tuple(FallingVelocity(*row) for row in rows)
