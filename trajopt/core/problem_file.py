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

Known robots bring their limits and their joints' names (`arm_file`); what the file says of
a kind of limit itself counts instead, and joint names choose from the robot's joints:

    robot = "ur5e"                       # in place of some or all limits; `trajopt list` has more
    joint_names = ["elbow_joint", ...]   # one per column of the waypoints; optional everywhere

A table `published` belongs to `trajopt.benchmark.suites.literature` and is left to it.

`angle_unit = "deg"` (or `"rad"`) in place of `units` means both. Where a joint is prismatic, say a
unit per joint, "m" or "mm" for that one:

    units.waypoints = ["deg", "deg", "m"]
    units.limits = ["rad", "rad", "m"]   # "rad" alone means the same: a single unit is of angles
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from trajopt.core import arm_file, files
from trajopt.core.arm_file import ArmFile, FallingVelocity
from trajopt.core.exceptions import InvalidInput
from trajopt.core.files import check_keys, text_at

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
_ANGLES = {"deg": pi / 180, "rad": 1.0}  # rad
_LENGTHS = {"m": 1.0, "mm": 1e-3}  # m
UNITS = _ANGLES | _LENGTHS

# What tells degrees from radians in the numbers of an arm's problem (`mixed_units`).
# Ranges are what the makers of arms write.
_WAYPOINTS_DEG = (4 * pi, 720.0)  # from where they would be more than two turns in radians
_VELOCITY_RAD = (0.05, 4 * pi)  # rad/s
_WAYPOINTS_RAD = (0.0, 2 * pi)
_VELOCITY_DEG = (30.0, 1000.0)  # deg/s
_ACCELERATION_DEG = (30.0, 1e5)  # deg/s²
_SLOW_SEGMENT_S = 3.0  # at full velocity; slower than that, the units are hardly the same
_SPAN_RAD = 4 * pi  # of one joint: where samples are dense no segment is slow
_FAST_SEGMENT_S = 0.05  # faster than that in every segment, neither


@dataclass(frozen=True)
class ProblemFile:
    """What a problem file says, not yet checked as a problem.

    `waypoints` and `limits` are as written; times `waypoint_unit` and `limit_unit`, one number or
    one per joint, they are radians (metres for a prismatic joint). `joint_units` are "rad" or "m"
    per joint, empty where the file gives no unit per joint. `units_said` tells whether each unit
    was written on its own. `robot_limits` are a known robot's, rad and s, for those joints that the
    file means, and `falling_velocity` its own.
    """

    name: str
    source: str
    waypoints: Any
    limits: Mapping[str, Any]
    waypoint_unit: float | Array
    limit_unit: float | Array
    units_said: bool
    joint_names: Sequence[Any] = ()
    joint_units: Sequence[str] = ()
    robot_limits: Mapping[str, Array] = field(default_factory=dict)
    falling_velocity: Sequence[FallingVelocity] = ()


def read(path: Path, limit_names: tuple[str, ...]) -> ProblemFile:
    """Read a problem file, whose limits may be those named.

    Raises:
        InvalidInput: It is no TOML file, or a key is missing, unknown or of the wrong type.
    """
    table = files.toml(path, "problem")
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
    joint_units = _joint_units(units)
    joint_names, chosen = _chosen_joints(table, arm)
    robot_limits: dict[str, Array] = {}
    falling_velocity: list[FallingVelocity] = []
    if arm is not None:
        if "m" in joint_units:
            joint = joint_units.index("m")
            right = f'"deg" or "rad": the joints of {arm.name} turn'
            raise InvalidInput("units", right, value="m", joint=joint)
        robot_limits = {kind: values[chosen] for kind, values in arm.limits.items()}
        joint_units = joint_units or ["rad"] * len(chosen)
        falling_velocity = [arm.falling_velocity[n] for n in chosen if arm.falling_velocity]
    return ProblemFile(
        name=text_at(table, "name", path.stem),
        source=text_at(table, "source", "" if arm is None else arm.description),
        waypoints=table["waypoints"],
        limits=limits,
        waypoint_unit=_sizes(units["waypoints"], joint_units),
        limit_unit=_sizes(units["limits"], joint_units),
        units_said="units" in table,
        joint_names=joint_names,
        joint_units=joint_units,
        robot_limits=robot_limits,
        falling_velocity=falling_velocity,
    )


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
) -> tuple[Sequence[Any], list[int]]:
    """The names of the file's joints, and which joints of the robot these are."""
    names = table.get("joint_names", ())
    if not isinstance(names, list | tuple):
        raise InvalidInput("joint_names", "a list of names, one per joint", value=names)
    if arm is None:
        return names, []
    chosen = []
    for joint, name in enumerate(names or arm.joint_names):
        if name not in arm.joint_names:
            known = ", ".join(arm.joint_names)
            right = f"a joint of {arm.name}: {known}"
            raise InvalidInput("joint_names", right, value=name, joint=joint)
        chosen.append(arm.joint_names.index(name))
    return names or arm.joint_names, chosen


def text(
    name: str,
    source: str,
    waypoints: Array,
    limits: Mapping[str, Array],
    joint_names: Sequence[str],
    joint_units: Sequence[str],
) -> str:
    """A problem file in rad and m; reading it back gives the same numbers to the last bit."""
    table: dict[str, Any] = {"name": name, "source": source}
    if joint_names:
        table["joint_names"] = list(joint_names)
    table["waypoints"] = waypoints.tolist()
    unit = list(joint_units) if "m" in joint_units else "rad"
    table["units"] = {"waypoints": unit, "limits": unit}
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
    with np.errstate(over="ignore"):  # a limit of 1e-320
        longest = (steps[:, moving] / speed).max()
    span = np.ptp(waypoints[:, moving], axis=0).max()

    sizes = f"waypoints up to {angle:.4g} beside velocity limits of {speed.min():.4g}"
    if speed.max() > speed.min():
        sizes += f" to {speed.max():.4g}"
    sizes += f" ({longest:.2g} s for the longest segment at full velocity)"
    degrees_beside_radians = (
        (longest > _SLOW_SEGMENT_S or span > _SPAN_RAD)
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


def _units(table: Mapping[str, Any], *, limits_said: bool) -> dict[str, Any]:
    """The units in which waypoints and limits are written: one of angles, or a list, one per joint.

    Limits that a file leaves to the robot need no unit.
    """
    keys = ("waypoints", "limits")
    if "units" not in table:
        unit = _angle_unit("angle_unit", table.get("angle_unit"))
        return dict.fromkeys(keys, unit)
    units = table["units"]
    if "angle_unit" in table:
        right = "left out beside units, which says it for waypoints and limits"
        raise InvalidInput("angle_unit", right, value=table["angle_unit"])
    if not isinstance(units, Mapping):
        raise InvalidInput("units", "a table with waypoints and limits", value=units)
    required = keys if limits_said else ("waypoints",)
    check_keys("units.", units, keys, required)
    checked: dict[str, Any] = {}
    for key in keys:
        unit = units.get(key, "rad")
        check = _units_of_joints if isinstance(unit, list) else _angle_unit
        checked[key] = check(f"units.{key}", unit)
    return checked


def _angle_unit(key: str, unit: Any) -> str:
    if not isinstance(unit, str) or unit not in _ANGLES:
        right = '"deg" or "rad"'
        if key == "angle_unit":
            right += ", or units.waypoints and units.limits in its place"
        else:
            right += ', or a unit per joint like ["deg", "m"]'
        raise InvalidInput(key, right, value=unit)
    return unit


def _units_of_joints(key: str, units: list[Any]) -> list[str]:
    if not units:
        raise InvalidInput(key, "a unit per joint", value=units)
    for joint, unit in enumerate(units):
        if not isinstance(unit, str) or unit not in UNITS:
            raise InvalidInput(key, " or ".join(UNITS), value=unit, joint=joint)
    return units


def _joint_units(units: Mapping[str, Any]) -> list[str]:
    """Each joint's SI unit, "rad" or "m"; empty where no list says it.

    Raises:
        InvalidInput: One list says that a joint turns, the other that it slides.
    """
    lists = [own for own in units.values() if isinstance(own, list)]
    said = [["m" if unit in _LENGTHS else "rad" for unit in own] for own in lists]
    if len(said) == 2 and said[0] != said[1]:
        right = f"the same kinds of units as units.waypoints, {units['waypoints']}"
        raise InvalidInput("units.limits", right, value=units["limits"])
    return said[0] if said else []


def _sizes(unit: Any, joint_units: Sequence[str]) -> float | Array:
    """The size of a unit, rad or m; one per joint where the file has a unit per joint."""
    if isinstance(unit, list):
        return np.array([UNITS[own] for own in unit])
    if not joint_units:
        return _ANGLES[unit]
    return np.array([1.0 if own == "m" else _ANGLES[unit] for own in joint_units])
