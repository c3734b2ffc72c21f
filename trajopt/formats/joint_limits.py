"""MoveIt's `joint_limits.yaml`: limits of joints by name, flags that switch them, scaling factors.

    default_velocity_scaling_factor: 0.5       # optional: the share that MoveIt plans with
    default_acceleration_scaling_factor: 0.5
    joint_limits:
      elbow_joint:
        has_velocity_limits: true
        max_velocity: 3.14                     # rad/s; `!degrees 180` is read too
        has_acceleration_limits: true
        max_acceleration: 5.0                  # rad/s²
        has_jerk_limits: false                 # no jerk limit, whatever another source says

Keys of nodes and launch files around this table (`/**:`, `move_group:`, `ros__parameters:`,
`robot_description_planning:`) are removed. The scaling factors are defaults of
a request, not limits of the robot: planning applies them, judging does not (`RobotLimits.scaled`).

Also read are `min_position` and `max_position` with `has_position_limits`; `min_velocity`,
`min_acceleration` and `min_jerk`, negative, the lower side of a pair beside the `max_…`; and
`max_deceleration`. The smaller of deceleration and acceleration limit bounds accelerations of both
signs, because limits here depend on the direction, not on whether a joint brakes; a `FileNote` says
so where they differ. Joints whose names are numbered are in that order, others in none. Limits that
are not in the file keep their values (`RobotLimits.updated`), so
a file of the two scaling factors alone goes with a robot. Efforts, soft limits, limits of the tool,
rates under unknown sections and unknown keys of a joint are not read, which a `FileNote` says; a
misspelt key is refused (`trajopt.core.keys`).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.core import keys
from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.core.keys import Key
from trajopt.core.limits import LimitName
from trajopt.core.out_of_scope import out_of_scope
from trajopt.formats import yaml_file
from trajopt.formats.robot_limits import (
    Bounds,
    JointBounds,
    RobotLimits,
    note_braking,
)
from trajopt.formats.samples import numbers

_WHAT = "joint limits"
_RATES: tuple[LimitName, ...] = ("velocity", "acceleration", "jerk")
_SCALINGS = ("default_velocity_scaling_factor", "default_acceleration_scaling_factor")
TABLE = {
    "joint_limits": Key(keys.table, "the joints by name"),
    _SCALINGS[0]: Key(keys.number, "share of the velocity limits that MoveIt plans with"),
    _SCALINGS[1]: Key(keys.number, "share of the acceleration limits that MoveIt plans with"),
    "cartesian_limits": Key(keys.table, "the tool's, which is not judged"),
    "robot_description_planning": Key(keys.table, "what ROS puts around the table"),
}
"""The keys of a file."""

_PER_S = {"velocity": "rad/s", "acceleration": "rad/s²", "deceleration": "rad/s²", "jerk": "rad/s³"}
JOINT = {
    "has_position_limits": Key(keys.flag, "whether the range counts"),
    "min_position": Key(keys.number, "lower end of the range, rad (m)", ("lower",)),
    "max_position": Key(keys.number, "upper end of the range, rad (m)", ("upper",)),
    **{f"has_{kind}_limits": Key(keys.flag, "whether it is limited") for kind in _PER_S},
    **{
        f"max_{kind}": Key(keys.number, f"largest {kind}, {unit}", (kind,))
        for kind, unit in _PER_S.items()
    },
    **{
        f"min_{kind}": Key(keys.number, f"lower side of the {kind} limit, {_PER_S[kind]}")
        for kind in _RATES
    },
    "has_effort_limits": Key(keys.flag, "whether the effort is limited"),
    "min_effort": Key(keys.number, "lower side of the effort limit"),
    "max_effort": Key(keys.number, "largest effort, N m (N), for limits of torque", ("effort",)),
    # Of other uses: ros2_control's soft limits.
    "angle_wraparound": Key(keys.flag, "whether the joint turns without end"),
    "has_soft_limits": Key(keys.flag, "whether the soft limits count"),
    "k_position": Key(keys.number, "gain of the position in the soft limits"),
    "k_velocity": Key(keys.number, "gain of the velocity in the soft limits"),
    "soft_lower_limit": Key(keys.number, "lower soft limit, rad (m)"),
    "soft_upper_limit": Key(keys.number, "upper soft limit, rad (m)"),
}
"""The keys of a joint."""
_READ = {
    f"{side}_{kind}" for side in ("min", "max") for kind in (*_RATES, "position", "effort")
} | {"has_effort_limits"}
_SOFT = ("k_position", "soft_lower_limit", "soft_upper_limit")
_WRAPPERS_MAX = 5  # a namespace, a node, ros__parameters, robot_description_planning
_UNLIMITED = (-np.inf, np.inf)
_WIDE = 8 * np.pi  # rad: four turns to either side


def read(path: str | Path) -> RobotLimits:
    """The limits of a `joint_limits.yaml`, rad and s.

    Raises:
        InvalidInput: Names the file, the joint, the key, the value, and what would be right.
    """
    file = Path(path)
    table = yaml_file.read(file, _WHAT)
    try:
        inner = _unwrapped(table)
        limits = _limits(inner, str(path))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    sentences = {out_of_scope(key): key for key in _limit_keys(inner) if key not in _READ}
    for sentence, key in sentences.items():
        if sentence:
            warnings.warn(FileNote(f"{path}: {key} is left out: {sentence}"), stacklevel=2)
    keys.note_unread(str(path), _unread(table, inner))
    wide = f"ranges beyond {_WIDE:.0f} rad; an angle in degrees is written `!degrees 170`: "
    keys.note(str(path), wide, _wide(limits))
    asked = "efforts, which count where a limit of torque asks for them (--torque urdf), of "
    keys.note(str(path), asked, [own for own in limits.efforts if limits.efforts[own] < np.inf])
    note_braking(str(path), _braking_otherwise(inner))
    return limits


def _unread(table: Any, inner: Mapping[str, Any]) -> Iterator[str]:
    """Keys that bound a rate outside of the joints' table, and soft limits within."""
    joints = inner.get("joint_limits") or {}
    yield from keys.unread("", inner, TABLE, shared=True)
    for name, entry in joints.items():
        yield from keys.unread(f"joint_limits.{name}.", entry, JOINT)
        if entry.get("has_soft_limits", True):
            yield from (f"{key} of {name}" for key in _SOFT if key in entry)
    levels = [("", table)]
    while levels:
        where, own = levels.pop(0)
        for key, value in own.items() if isinstance(own, Mapping) else ():
            if value is joints or (key not in _READ and out_of_scope(key)):  # a line of its own
                continue
            if isinstance(value, Mapping):
                levels.append((f"{where}{key}.", value))
            elif keys.bounds_rate(key) and key not in _SCALINGS and not isinstance(value, bool):
                yield f"{where}{key}"


def _wide(limits: RobotLimits) -> Iterator[str]:
    """The joints that could turn four times and more, as a robot's in degrees could."""
    for name, own in limits.joints.items():
        ends = np.abs(own.get("position", _UNLIMITED))
        if (ends[np.isfinite(ends)] > _WIDE).any():
            yield name


def _braking_otherwise(table: Mapping[str, Any]) -> Iterator[str]:
    """The joints whose deceleration limit differs from their acceleration limit."""
    for name, entry in (table.get("joint_limits") or {}).items():
        braking = _rate("", entry, "deceleration")
        if braking is not None and braking not in (np.inf, _rate("", entry, "acceleration")):
            yield name


def _limit_keys(table: Mapping[str, Any]) -> Iterator[str]:
    """The keys of limits that are not switched off, of the file and of its joints."""
    yield from map(str, table)
    for entry in (table.get("joint_limits") or {}).values():
        for key in filter(JOINT.__contains__, entry):
            kind = key.partition("_")[2].removesuffix("_limits")
            if entry.get(f"has_{kind}_limits", True):
                yield key


def _unwrapped(table: Any) -> Any:
    """Remove the names of nodes and the keys that ROS puts around the table."""
    levels = [[table]]
    for _ in range(_WRAPPERS_MAX):
        tables = [own for own in levels[-1] if isinstance(own, Mapping)]
        levels.append([inner for own in tables for inner in own.values()])
    for wanted in ({"joint_limits"}, set(_SCALINGS)):
        for level in levels:
            found = [own for own in level if isinstance(own, Mapping) and wanted & own.keys()]
            if len(found) > 1:
                raise InvalidInput("joint_limits", "this key once, not for several nodes")
            if found:
                return found[0]
    return table


def _limits(table: Any, source: str) -> RobotLimits:
    table = table if isinstance(table, Mapping) else {}
    said = table.get("joint_limits")
    factors = not table.keys().isdisjoint(_SCALINGS)
    if factors and said is None:
        said = {}
    if not isinstance(said, Mapping):
        raise InvalidInput(_WHAT, "a mapping joint_limits: of joints by their names")
    keys.unread("", table, TABLE, shared=True)
    joints = {}
    for name, entry in said.items():
        key = f"joint_limits.{name}"
        if name in _SCALINGS:
            raise InvalidInput(key, "this key one level up, beside joint_limits:", value=entry)
        if not isinstance(entry, Mapping):
            raise InvalidInput(key, "a mapping with max_velocity: and others", value=entry)
        joints[str(name)] = _bounds(key, entry)
    if not joints and not factors:
        raise InvalidInput("joint_limits", "at least one joint")
    numbered = dict(zip(joints, numbers(list(joints)), strict=False))
    joints = {name: joints[name] for name in sorted(joints, key=lambda own: numbered.get(own, 0))}
    velocity_scaling, acceleration_scaling = [_scaling(table, key) for key in _SCALINGS]
    return RobotLimits(
        joints=joints,
        source=source,
        ordered=bool(numbered),
        velocity_scaling=velocity_scaling,
        acceleration_scaling=acceleration_scaling,
        efforts=dict(_efforts(said)),
    )


def _efforts(joints: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the smaller side of each effort limit, N m (N), infinite where it is switched off.

    A number that is none is left out: efforts count for limits of torque alone.
    """
    for name, entry in joints.items():
        low, high = (yaml_file.number(entry.get(f"{side}_effort")) for side in ("min", "max"))
        if entry.get("has_effort_limits") is False:
            yield str(name), np.inf
        elif high is not None and high > 0:
            yield str(name), min(high, abs(low or high))


def _scaling(table: Mapping[str, Any], key: str) -> float:
    """A scaling factor; by default 1."""
    factor = yaml_file.number(table.get(key, 1.0))
    if factor is None or not 0 < factor <= 1:
        raise InvalidInput(key, "a number above 0, at most 1", value=table[key])
    return factor


def _bounds(key: str, entry: Mapping[str, Any]) -> JointBounds:
    """One joint's limits, by kind."""
    keys.unread(f"{key}.", entry, JOINT)
    bounds: dict[LimitName, Bounds] = {}
    for kind in _RATES:
        high = _rate(key, entry, kind)
        low = _lower(key, entry, kind, high)
        if high is not None:
            bounds[kind] = (low, high)
    braking = _rate(key, entry, "deceleration")
    if braking is not None:
        if "acceleration" not in bounds:
            raise InvalidInput(f"{key}.max_deceleration", "max_acceleration beside it")
        low, high = bounds["acceleration"]
        bounds["acceleration"] = (max(low, -braking), min(high, braking))
    position = _position(key, entry)
    if position is not None:
        bounds["position"] = position
    return bounds


def _has(key: str, entry: Mapping[str, Any], kind: str) -> bool | None:
    """Return the flag of a kind of limit; None where it is missing."""
    flag = f"has_{kind}_limits"
    value = entry.get(flag)
    if value is not None and not isinstance(value, bool):
        raise InvalidInput(f"{key}.{flag}", "true or false", value=value)
    return value


def _rate(key: str, entry: Mapping[str, Any], kind: str) -> float | None:
    """A symmetric limit's size, infinite if it is switched off, None if it is missing."""
    limited = _has(key, entry, kind)
    if limited is False:
        return np.inf
    name = f"max_{kind}"
    if name not in entry:
        return None
    size = yaml_file.number(entry[name])
    if size is not None and kind == "deceleration":
        size = abs(size)  # some files write it as a negative acceleration
    if size is None or size <= 0:
        right = f"a positive number, or has_{kind}_limits: false"
        if "$(" in str(entry[name]) or "${" in str(entry[name]):
            right = "a number; this is a template, which a launch file or xacro fills in"
        raise InvalidInput(f"{key}.{name}", right, value=entry[name])
    return size


def _lower(key: str, entry: Mapping[str, Any], kind: str, high: float | None) -> float:
    """The lower side of a limit: that of its own key, else minus the upper side."""
    name = f"min_{kind}"
    if name not in entry or high == np.inf:
        return -(high or 0.0)
    low = yaml_file.number(entry[name])
    if low is None or low >= 0 or high is None:
        right = f"a negative number, beside max_{kind}"
        raise InvalidInput(f"{key}.{name}", right, value=entry[name])
    return low


def _position(key: str, entry: Mapping[str, Any]) -> Bounds | None:
    limited = _has(key, entry, "position")
    if limited is False:
        return _UNLIMITED
    if not {"min_position", "max_position"} & entry.keys():
        return None
    low = _end(key, entry, "min_position", -np.inf)
    high = _end(key, entry, "max_position", np.inf)
    if not low < high:
        right = "min_position below max_position"
        raise InvalidInput(f"{key}.min_position", right, value=low)
    return low, high


def _end(key: str, entry: Mapping[str, Any], name: str, default: float) -> float:
    value = yaml_file.number(entry.get(name, 0))
    if value is None:
        raise InvalidInput(f"{key}.{name}", "a finite number", value=entry[name])
    return value if name in entry else default
