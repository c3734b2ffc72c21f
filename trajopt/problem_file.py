"""The problem file: TOML with waypoints, limits, and the units in which each of them is written.

    name = "two joints"                  # optional: the file's name without it
    source = "where it comes from"       # optional
    waypoints = [[0, 0], [30, -45]]      # one row per waypoint, one number per joint
    units.waypoints = "deg"              # "deg" or "rad"
    units.limits = "rad"                 # the same for rad/s, rad/s², rad/s³ and position limits

    [limits]                             # a number or a [low, high] pair per joint
    velocity = [2.6, 3.1]
    acceleration = [1.6, [-2.1, 2.4]]
    jerk = [20, inf]                     # optional, like position

Known robots bring their limits and their joints' names (`trajopt.arm_file`); what the file says of
a kind of limit itself counts instead, and joint names choose from the robot's joints:

    robot = "ur5e"                       # in place of some or all limits; `trajopt list` has more
    joint_names = ["elbow_joint", ...]   # one per column of the waypoints; optional everywhere

A table `published` belongs to `trajopt.benchmark.suites.literature` and is left to it.

`angle_unit = "deg"` (or `"rad"`) in place of `units` means both. A prismatic joint is written in
metres: leave the units at "rad" then, with which every number is taken as it stands.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from trajopt import arm_file
from trajopt.arm_file import ArmFile
from trajopt.exceptions import InvalidInput

Array = NDArray[np.float64]

_KEYS = (
    "name",
    "source",
    "robot",
    "joint_names",
    "angle_unit",
    "units",
    "waypoints",
    "limits",
    "published",
)
_UNITS = {"deg": pi / 180, "rad": 1.0}  # rad

# What tells degrees from radians in the numbers of an arm's problem (`mixed_units`).
# Ranges are what the makers of arms write.
_WAYPOINTS_DEG = (4 * pi, 720.0)  # from where they would be more than two turns in radians
_VELOCITY_RAD = (0.05, 4 * pi)  # rad/s
_WAYPOINTS_RAD = (0.0, 2 * pi)
_VELOCITY_DEG = (30.0, 1000.0)  # deg/s
_ACCELERATION_DEG = (30.0, 1e5)  # deg/s²
_SLOW_SEGMENT_S = 3.0  # at full velocity; slower than that, the units are hardly the same
_FAST_SEGMENT_S = 0.05  # faster than that in every segment, neither


@dataclass(frozen=True)
class ProblemFile:
    """What a problem file says, not yet checked as a problem.

    `waypoints` and `limits` are as written; times `waypoint_unit` and `limit_unit` they are
    radians. `units_said` tells whether each unit was written on its own. `robot_limits` are a known
    robot's, rad and s, for those joints that the file means.
    """

    name: str
    source: str
    waypoints: Any
    limits: Mapping[str, Any]
    waypoint_unit: float
    limit_unit: float
    units_said: bool
    joint_names: Sequence[Any] = ()
    robot_limits: Mapping[str, Array] = field(default_factory=dict)


def read(path: Path, limit_names: tuple[str, ...]) -> ProblemFile:
    """Read a problem file, whose limits may be those named.

    Raises:
        InvalidInput: It is no TOML file, or a key is missing, unknown or of the wrong type.
    """
    table = toml(path)
    arm = _arm(table)
    required: tuple[str, ...] = ("waypoints",)
    required_limits: tuple[str, ...] = ()
    if arm is None:
        required = ("limits", "waypoints")
        required_limits = ("acceleration", "velocity")
    check_keys("", table, _KEYS, required)
    limits = table.get("limits", {})
    if not isinstance(limits, Mapping):
        raise InvalidInput("limits", "a table of limits", value=limits)
    check_keys("limits.", limits, limit_names, required_limits)
    units = _units(table, limits_said=bool(limits))
    joint_names, robot_limits = _chosen_joints(table, arm)
    return ProblemFile(
        name=text_at(table, "name", path.stem),
        source=text_at(table, "source", "" if arm is None else arm.description),
        waypoints=table["waypoints"],
        limits=limits,
        waypoint_unit=units["waypoints"],
        limit_unit=units["limits"],
        units_said="units" in table,
        joint_names=joint_names,
        robot_limits=robot_limits,
    )


def toml(path: Path, number: Callable[[str], Any] = float) -> dict[str, Any]:
    """A TOML file as it stands; `number` reads what has a decimal point or an exponent.

    Raises:
        InvalidInput: It cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"), parse_float=number)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidInput("problem", "a readable TOML file", value=reason) from None


def _arm(table: Mapping[str, Any]) -> ArmFile | None:
    """The robot that the file names, if it does."""
    if "robot" not in table:
        return None
    name = text_at(table, "robot", "")
    if name not in arm_file.arm_files():
        known = ", ".join(arm_file.arm_files())
        raise InvalidInput("robot", f"one of {known}", value=name)
    return arm_file.read(name)


def _chosen_joints(
    table: Mapping[str, Any],
    arm: ArmFile | None,
) -> tuple[Sequence[Any], Mapping[str, Array]]:
    """The names of the file's joints, and the robot's limits of these."""
    names = table.get("joint_names", ())
    if not isinstance(names, list | tuple):
        raise InvalidInput("joint_names", "a list of names, one per joint", value=names)
    if arm is None:
        return names, {}
    if not names:
        return arm.joint_names, arm.limits
    rows = []
    for joint, name in enumerate(names):
        if name not in arm.joint_names:
            known = ", ".join(arm.joint_names)
            right = f"a joint of {arm.name}: {known}"
            raise InvalidInput("joint_names", right, value=name, joint=joint)
        rows.append(arm.joint_names.index(name))
    return names, {kind: values[rows] for kind, values in arm.limits.items()}


def text(
    name: str,
    source: str,
    waypoints: Array,
    limits: Mapping[str, Array],
    joint_names: Sequence[str],
) -> str:
    """A problem file in radians; reading it back gives the same numbers to the last bit."""
    table: dict[str, Any] = {"name": name, "source": source}
    if joint_names:
        table["joint_names"] = list(joint_names)
    table["waypoints"] = waypoints.tolist()
    table["units"] = {"waypoints": "rad", "limits": "rad"}
    table["limits"] = {kind: pairs.tolist() for kind, pairs in limits.items()}
    return tomli_w.dumps(table)


def mixed_units(waypoints: Array, velocity: Array, acceleration: Array) -> str | None:
    """Why waypoints and limits look as if one was written in degrees and one in radians, or None.

    The numbers of joints that move, as a file has them under one unit. Both signs are asked for:
    sizes that the supposed unit makes usual for an arm, and durations that only a mixture explains.

    Args:
        waypoints: `(waypoints, joints)`.
        velocity: `(joints, 2)`, `[low, high]`.
        acceleration: `(joints, 2)`, `[low, high]`.
    """
    steps = np.abs(np.diff(waypoints, axis=0))
    moving = steps.any(axis=0)
    angle = np.abs(waypoints[:, moving]).max()
    speed = np.abs(velocity[moving]).min(axis=1)
    thrust = np.abs(acceleration[moving]).min(axis=1)
    # the longest a joint needs for a segment at full velocity: max h / v
    longest = (steps[:, moving] / speed).max()

    sizes = f"waypoints up to {angle:.4g} beside velocity limits of {speed.min():.4g}"
    if speed.max() > speed.min():
        sizes += f" to {speed.max():.4g}"
    sizes += f" ({longest:.2g} s for the longest segment at full velocity)"
    degrees_beside_radians = (
        longest > _SLOW_SEGMENT_S
        and _all_within(angle, _WAYPOINTS_DEG)
        and _all_within(speed, _VELOCITY_RAD)
    )
    if degrees_beside_radians:
        return f"{sizes} look like degrees beside radians"
    radians_beside_degrees = (
        longest < _FAST_SEGMENT_S
        and _all_within(angle, _WAYPOINTS_RAD)
        and _all_within(speed, _VELOCITY_DEG)
        and _all_within(thrust, _ACCELERATION_DEG)
    )
    if radians_beside_degrees:
        return f"{sizes} look like radians beside degrees"
    return None


def _all_within(values: Array, ends: tuple[float, float]) -> bool:
    low, high = ends
    return bool(np.all((values >= low) & (values <= high)))


def _units(table: Mapping[str, Any], *, limits_said: bool) -> dict[str, float]:
    """The size of a unit, rad, in which waypoints and limits are written.

    Limits that a file leaves to the robot need no unit.
    """
    if "units" not in table:
        size = _size("angle_unit", table.get("angle_unit"))
        return {"waypoints": size, "limits": size}
    units = table["units"]
    if "angle_unit" in table:
        right = "left out beside units, which says it for waypoints and limits"
        raise InvalidInput("angle_unit", right, value=table["angle_unit"])
    if not isinstance(units, Mapping):
        raise InvalidInput("units", "a table with waypoints and limits", value=units)
    keys = ("waypoints", "limits")
    required = keys if limits_said else ("waypoints",)
    check_keys("units.", units, keys, required)
    return {key: _size(f"units.{key}", units.get(key, "rad")) for key in keys}


def _size(key: str, unit: Any) -> float:
    if not isinstance(unit, str) or unit not in _UNITS:
        right = '"deg" or "rad"'
        if key == "angle_unit":
            right += ", or units.waypoints and units.limits in its place"
        raise InvalidInput(key, right, value=unit)
    return _UNITS[unit]


def text_at(table: Mapping[str, Any], key: str, default: str = "") -> str:
    """The text under a key; raises `InvalidInput` where it is none."""
    value = table.get(key, default)
    if not isinstance(value, str):
        raise InvalidInput(key, "a string", value=value)
    return value


def check_keys(
    prefix: str,
    table: Mapping[str, Any],
    known: tuple[str, ...],
    required: tuple[str, ...] = (),
) -> None:
    """Refuse keys that nobody knows, and missing ones; `prefix` stands before them in errors."""
    for key, value in table.items():
        if key not in known:
            names = ", ".join(sorted(known))
            raise InvalidInput(prefix + key, f"one of the keys {names}", value=value)
    for key in required:
        if key not in table:
            raise InvalidInput(prefix + key, "this key; it is missing")
