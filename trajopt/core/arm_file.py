"""Robot arms, read from files: joint names and limits, and who published each limit.

name = "ur5e"
description = "Universal Robots UR5e, six joints"
joint_names = ["shoulder_pan_joint", ...]    # optional

[velocity]                                   # the same for acceleration, jerk, position
angle_unit = "deg"
values = [180, 180, 180, 180, 180, 180]
status = "published"
source = "the maker's manual, page 12"
checked = "against what, and with which result; or why not"

[falling_velocity]                           # its values as in a problem file
angle_unit = "rad"
values.offset = [0.3, 0.2, 0.2, 0.3, 0.35, 0.35]
values.deceleration = [6, 2.6, 3.5, 4, 17, 5.5]
values.position = [[-2.75, 2.75], ...]
status = "published"
source = "the maker's manual, page 12"

[chain]                                      # optional: the link frames, m and rad
xyz = [[0, 0, 0.1625], ...]                  # of each joint's <origin>, as in a URDF
rpy = [[0, 0, 0], ...]
axis = [[0, 0, 1], ...]
tool_xyz = [0, 0, 0.1]                       # optional, behind the last joint; tool_rpy too
status = "configuration"
source = "a model of the arm"

[dynamics]                                   # optional: what each joint moves (`core.bodies`)
mass = [3.7, ...]                            # kg
centre = [[0, 0, 0.1], ...]                  # its centre of mass in the joint's frame, m
inertia = [[0.01, 0, 0, 0.01, 0, 0.01], ...] # about it, kg m²: xx, xy, xz, yy, yz, zz
damping = [0, ...]                           # optional, viscous, N m s/rad
effort = [150, ...]                          # optional, the drives' largest torques, N m
payload = 5                                  # optional, what it may carry, kg
status = "configuration"
source = "a model of the arm"
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from trajopt.core import bodies, built_in, chain, files
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.limits import KINDS, Limit, Limits
from trajopt.core.tables import check_joint_names, is_list
from trajopt.core.units import ANGLES

_REQUIRED = ("name", "description", "velocity", "acceleration")

OriginStatus = Literal["published", "configuration", "quoted", "assumed", "memory"]


@dataclass(frozen=True)
class LimitOrigin:
    """The origin of an arm's limits of one kind. `status` is

    - `published`: the maker's own document, which was read;
    - `configuration`: a robot model or configuration in a public repository, which was read;
    - `quoted`: a book or paper, as somebody else quotes it;
    - `assumed`: not published; `rule` gives the assumption;
    - `memory`: remembered, not checked.

    `checked` gives the source that the numbers were compared with in November 2026, and the result,
    or the reason why they could not be compared.
    """

    status: OriginStatus
    source: str
    address: str = ""
    rule: str = ""
    checked: str = ""


_TEXTS = tuple(field.name for field in fields(LimitOrigin))


@dataclass(frozen=True, eq=False)
class Arm:
    """A real robot arm, as its file describes it.

    Attributes:
        joint_names: As the arm's ROS description has them, in its order; `joint_1` and so on where
            no description is known.
        limits: rad and s.
        origins: The origin of each kind of limit.
        chain: Its link frames; None where none are known.
        chain_origin: Where these come from.
        dynamics_origin: Where its masses and torques (`LinkChain.masses`) come from.
    """

    name: str
    description: str
    joint_names: tuple[str, ...]
    limits: Limits
    origins: Mapping[str, LimitOrigin]
    chain: LinkChain | None = None
    chain_origin: LimitOrigin | None = None
    dynamics_origin: LimitOrigin | None = None


def arm_files() -> dict[str, Path]:
    """Every built-in arm file by name."""
    return built_in.files("robots")


def read(name_or_path: str) -> Arm:
    """An arm by built-in name or path; raises `UnknownName`, or `InvalidInput` naming the key."""
    path = arm_files().get(name_or_path, Path(name_or_path))
    if not path.is_file():
        raise UnknownName("robot", name_or_path, arm_files())
    try:
        return _arm(files.toml(path, "robot"))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def _arm(table: Mapping[str, Any]) -> Arm:
    known = (*_REQUIRED, "joint_names", "chain", "dynamics", *KINDS)
    files.check_keys("", table, known, _REQUIRED)
    given = [key for key in KINDS if key in table]
    values = {key: _values(key, table[key]) for key in given}
    joints = len(values["velocity"]) if is_list(values["velocity"]) else 0
    limits = Limits(**{key: _limit(key, table[key], joints) for key in given})
    numbered = [f"joint_{joint + 1}" for joint in range(limits.joints)]
    names = files.names_at(table, "joint_names", numbered)
    check_joint_names(names, limits.joints)
    stated = table.get("chain")
    if stated is not None:
        required = ("status", "source", *chain.REQUIRED)
        files.check_keys("chain.", stated, (*chain.KEYS, *_TEXTS), required)
    moved = table.get("dynamics")
    if moved is not None:
        required = ("status", "source", *bodies.REQUIRED)
        files.check_keys("dynamics.", moved, (*bodies.KEYS, *_TEXTS), required)
    return Arm(
        name=files.text_at(table, "name"),
        description=files.text_at(table, "description"),
        joint_names=tuple(names),
        limits=limits,
        origins={key: _origin(key, table[key]) for key in given},
        chain=None if stated is None else LinkChain.read(stated, limits.joints, moved=moved),
        chain_origin=None if stated is None else _origin("chain", stated),
        dynamics_origin=None if moved is None else _origin("dynamics", moved),
    )


def _values(key: str, entry: Any) -> Any:
    """Return the numbers of a kind of limit, in the unit that its table states."""
    if not isinstance(entry, Mapping):
        raise InvalidInput(key, "a table", value=entry)
    required = ("values", "angle_unit", "status", "source")
    files.check_keys(f"{key}.", entry, (*required, *_TEXTS), required)
    unit = entry["angle_unit"]
    if not isinstance(unit, str) or unit not in ANGLES:
        raise InvalidInput(f"{key}.angle_unit", '"deg" or "rad"', value=unit)
    values = entry["values"]
    if is_list(values) and any(is_list(item) and len(item) != 2 for item in values):
        right = "a number, or a pair [low, high], per joint"
        raise InvalidInput(f"{key}.values", right, value=values)
    return values


def _limit(key: str, entry: Mapping[str, Any], joints: int) -> Limit:
    """The limit that a kind's table states, rad and s."""
    written = KINDS[key].read(entry["values"], joints)
    return written.converted(np.full(joints, ANGLES[entry["angle_unit"]]))


def _origin(kind: str, entry: Mapping[str, Any]) -> LimitOrigin:
    texts: dict[str, Any] = {key: files.text_at(entry, key) for key in _TEXTS}
    statuses = get_args(OriginStatus)
    if texts["status"] not in statuses:
        right = " or ".join(statuses)
        raise InvalidInput(f"{kind}.status", right, value=texts["status"])
    return LimitOrigin(**texts)
