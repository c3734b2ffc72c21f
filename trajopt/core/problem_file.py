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

    [limits.falling_velocity]            # optional: `FallingVelocity`; inf: no such limit
    offset = [0.3, 0.0]
    deceleration = [6.0, inf]
    position = [[-2.75, 2.75], [-inf, inf]]

    [[limits.segment]]                   # optional: a segment's own limits, of most kinds
    number = 1                           # from 1: between the first waypoint and the second
    velocity = [0.5, 0.6]                # in place of [limits], also where it is larger

What else is asked of the way stands beside the waypoints (`trajopt.core.demand.DEMANDS`), in the
unit of the limits where it is a rate, else in that of the waypoints:

    start_velocity = [0.5, 0]            # optional: one number per joint; also end_velocity, and
                                         # with jerk limits start_acceleration, end_acceleration
    tolerance = 0.01                     # ±, of inner waypoints; or a row per joint, or a table
    least_times = [0, 1.5]               # s, per segment; given_times says all of them exactly
    least_duration = 4                   # s, of the whole motion; duration says it exactly
    dwell = [0, 0.4, 0]                  # s at rest, per waypoint
    closed = true                        # the last waypoint is the first, with the same velocity

In place of a limit, `true` is the robot's own, which must have one, and `false` none.

A known robot has its limits and joint names in its own file (`arm_file`). Limits in the problem
file replace the robot's of the same kind, and joint names choose from the robot's joints:

    robot = "ur5e"                       # in place of some or all limits; `trajopt list` has more
    joint_names = ["elbow_joint", ...]   # one per column of the waypoints; optional everywhere

The link frames of the joints, in place of the robot's, for limits that need them (`tool_speed`,
`link_speed`):

    chain.xyz = [[0, 0, 0.16], ...]      # m, as in a URDF's <origin>, of each joint
    chain.rpy = [[0, 0, 0], ...]         # rad
    chain.axis = [[0, 0, 1], ...]
    chain.tool_xyz = [0, 0, 0.1]         # optional, behind the last joint; tool_rpy too

What each joint moves, in place of the robot's, for limits that need it (`torque`), and what the
tool carries (`trajopt.core.bodies`):

    dynamics.mass = [3.7, ...]           # kg; also centre (m), inertia (kg m²) per joint, and where
                                         # they are known damping, effort, payload, gravity
    payload.mass = 2.5                   # kg; also centre (m) in the tool's frame, and inertia

A table `published` is read by `trajopt.benchmark.suites.literature`.

`angle_unit = "deg"` (or `"rad"`) in place of `units` means both. For a prismatic joint write a unit
per joint, "m" or "mm" for that joint:

    units.waypoints = ["deg", "deg", "m"]
    units.limits = ["rad", "rad", "m"]   # "rad" alone means the same: a single unit is of angles
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trajopt.core import arm_file, bodies, chain, files, keys
from trajopt.core.arm_file import Arm
from trajopt.core.arrays import Array, Bools
from trajopt.core.bodies import Masses
from trajopt.core.chain import LinkChain, chain_of, frames_of
from trajopt.core.demand import DEMANDS, Demand
from trajopt.core.exceptions import InvalidInput, UnitWarning
from trajopt.core.files import text_at
from trajopt.core.keys import Key, Keys
from trajopt.core.limits import KINDS, Limit, Limits, named, segment_tables, strangers
from trajopt.core.tables import check_joint_names, waypoint_table
from trajopt.core.units import ANGLES, LENGTHS, UNITS, mixed_units

if TYPE_CHECKING:
    from trajopt.core.problem import Problem

KEYS = {
    "name": Key(keys.text, "the problem's name"),
    "source": Key(keys.text, "where it comes from"),
    "robot": Key(keys.text, "a known robot, for its limits and joints"),
    "joint_names": Key(keys.numbers, "one per column of the waypoints"),
    "angle_unit": Key(keys.text, "deg or rad, of waypoints and limits"),
    "units": Key(keys.table, "the unit of the waypoints and that of the limits"),
    "waypoints": Key(keys.numbers, "a row each"),
    **{key: Key(keys.anything, demand.meaning) for key, demand in DEMANDS.items()},
    "limits": Key(keys.table, "the limits by kind"),
    "chain": Key(keys.table, "the link frames, m and rad"),
    "dynamics": Key(keys.table, "masses, centres and inertias of what each joint moves, SI units"),
    "payload": Key(keys.table, "mass, centre and inertia of what the tool carries, SI units"),
    "published": Key(keys.table, "what was published for it"),
}
"""The keys of a problem file."""
UNITS_KEYS = {
    "waypoints": Key(keys.anything, "the unit of waypoints, or one per joint"),
    "limits": Key(keys.anything, "the unit of limits, or one per joint"),
}
"""The keys of its units."""
_UNIT_KEYS = tuple(UNITS_KEYS)


def read(path: Path, make: Callable[..., Problem]) -> Problem:
    """Read a problem file.

    Args:
        path: the file.
        make: `Problem`, which this module does not import: problems read themselves with it.

    Warns with `UnitWarning` where one unit is given for everything, but waypoints and limits look
    as if they were written in different ones.

    Raises:
        InvalidInput: Names the file, the key, the joint, the value, and what would be right.
    """
    try:
        return _problem(files.toml(path, "problem"), path, make)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def units(path: Path) -> list[str]:
    """The unit of each joint's waypoints in a problem file, as `read` reads them."""
    table = files.toml(path, "problem")
    said = _said_units(table)
    return _units(said, waypoint_table(table["waypoints"]).shape[1])["waypoints"]


def limit_keys() -> Keys:
    """Return the keys of its limits: each kind that there is now, a new one too."""
    kinds = {key: Key(keys.anything, kind.name()) for key, kind in KINDS.items()}
    others = {key: Key(keys.anything, "a limit of a package") for key in strangers.registered()}
    return {**others, **kinds, segment_tables.KEY: Key(keys.anything, "limits of one segment")}


def _problem(table: Mapping[str, Any], path: Path, make: Callable[..., Problem]) -> Problem:
    arm = _arm(table)
    required = ("waypoints",) if arm else ("limits", "waypoints")
    for key in (*KINDS, *strangers.registered()):
        if key in table:
            raise InvalidInput(key, f"this key under [limits], as {key} = [...]", value=table[key])
    others = keys.unread("", table, KEYS, required, strictness="ours")
    given = table.get("limits", {})
    if not isinstance(given, Mapping):
        raise InvalidInput("limits", "a table of limits", value=given)
    needed = () if arm else ("acceleration", "velocity")
    known = limit_keys()
    of_limits = keys.unread("limits.", given, known, needed, strictness="ours")
    given = {key: value for key, value in given.items() if key in known}
    keys.note_unread(path.name, [*others, *(f"limits.{key}" for key in of_limits)])
    waypoints = waypoint_table(table["waypoints"])
    demands = {
        key: demand.read(table[key], *waypoints.shape)
        for key, demand in DEMANDS.items()
        if key in table
    }
    said = _said_units(table)
    of_segments = given.get(segment_tables.KEY, [])
    given = {key: value for key, value in given.items() if key != segment_tables.KEY}
    units = _units(said, waypoints.shape[1])
    kinds = ["m" if unit in LENGTHS else "rad" for unit in units["waypoints"]]
    names = files.names_at(table, "joint_names")
    of_robot: dict[str, Limit] = {}
    if arm:
        if "m" in kinds:
            right = f'"deg" or "rad": the joints of {arm.name} turn'
            raise InvalidInput("units", right, value="m", joint=kinds.index("m"))
        names = names or arm.joint_names
        check_joint_names(names, len(kinds))
        numbered = enumerate(names)
        chosen = [_index(arm, joint, name) for joint, name in numbered]
        of_robot = dict(arm.limits.only(chosen).kinds)
    given = _without_words(given, of_robot, arm)
    # Before scaling: errors show what the file says.
    written = Limits(**(of_robot | dict(given)))
    if written.joints != len(kinds):
        right = f"{len(kinds)} values, one per joint of the waypoints"
        raise InvalidInput("limits.velocity", right, value=written.joints)
    of_each = segment_tables.read(of_segments, len(waypoints) - 1, len(kinds))
    size = {}
    for key, unit_names in units.items():
        sizes = [UNITS[unit] for unit in unit_names]
        size[key] = np.array(sizes)
    scaled = written.converted(size["limits"]).kinds
    kept = {key: limit for key, limit in of_robot.items() if key not in given}
    demands = {key: values * _unit_size(DEMANDS[key], size) for key, values in demands.items()}
    limits = Limits(**{**scaled, **kept})
    for key, stated in of_each.items():
        own_limits = {
            segment: limits.converted(size["limits"]) for segment, limits in stated.items()
        }
        limits = limits.in_segments(key, own_limits, len(waypoints) - 1)
    units_known = arm is not None or list in map(type, said.values())
    problem = make(
        waypoints * size["waypoints"],
        limits,
        name=text_at(table, "name", path.stem),
        source=text_at(table, "source", arm.description if arm else ""),
        joint_names=names,
        joint_units=kinds if units_known else (),
        demands=demands,
        chain=_chain(table, arm, names, np.array([kind == "m" for kind in kinds])),
    )
    if "units" not in table:
        as_written = problem.limits.in_all_segments().converted(1 / size["limits"])
        mixed = mixed_units(waypoints, as_written.velocity, as_written.acceleration)
        if mixed:
            message = f"{path}: {mixed}; say units.waypoints and units.limits"
            warnings.warn(UnitWarning(message), stacklevel=4)
    return problem


def _chain(
    table: Mapping[str, Any], arm: Arm | None, names: Sequence[str], slides: Bools
) -> LinkChain | None:
    """Return link frames and masses that the file states, else the robot's of these joints."""
    stated = {key: table.get(key) for key in ("chain", "dynamics", "payload")}
    for key, part in stated.items():
        if part is not None and not isinstance(part, Mapping):
            known = {"chain": chain.KEYS, "dynamics": bodies.KEYS, "payload": bodies.PAYLOAD_KEYS}
            raise InvalidInput(key, f"a table with {', '.join(known[key])}", value=part)
    frames, moved, payload = stated.values()
    if moved is not None:
        files.check_keys("dynamics.", moved, bodies.KEYS, bodies.REQUIRED)
    found: LinkChain | None
    if frames is not None:
        files.check_keys("chain.", frames, chain.KEYS, chain.REQUIRED)
        found = LinkChain.read(frames, len(slides), slides, moved)
    else:
        found = chain_of(frames_of(arm.chain, arm.joint_names), names) if arm else None
        if found is not None and moved is not None:
            found = replace(found, masses=Masses.read(moved, len(slides)))
    if moved is not None and found is not None and isinstance(found.masses, Masses):
        labels = names or [f"joint {joint + 1}" for joint in range(found.joints)]
        keys.note_unreal("dynamics", [labels[joint] for joint in found.masses.unreal])
    for key in ("dynamics", "payload"):
        if found is None and stated[key] is not None:
            raise InvalidInput(key, "link frames beside it: a robot's, or [chain]", value=None)
    return found if found is None or payload is None else found.carrying(payload)


def _without_words(
    given: Mapping[str, Any], of_robot: dict[str, Limit], arm: Arm | None
) -> dict[str, Any]:
    """Return the limits that the file states; `true` is the robot's own, `false` removes it."""
    stated = {
        key: value
        for key, value in given.items()
        if not isinstance(value, bool) or (value and named(key).of_chain)
    }
    for key in given.keys() - stated.keys():
        if given[key] and key not in of_robot:
            robot = f"of the robot, but {arm.name} has none" if arm else "beside a robot"
            raise InvalidInput(f"limits.{key}", f"a limit; true is the one {robot}", value=True)
        if not given[key]:
            of_robot.pop(key, None)
    return stated


def _arm(table: Mapping[str, Any]) -> Arm | None:
    """The robot that the file names, if it does."""
    if "robot" not in table:
        return None
    name = text_at(table, "robot")
    if name not in arm_file.arm_files():
        known = ", ".join(arm_file.arm_files())
        raise InvalidInput("robot", f"one of {known}", value=name)
    return arm_file.read(name)


def _index(arm: Arm, joint: int, name: str) -> int:
    """The index of a robot's joint of this name."""
    if name not in arm.joint_names:
        known = ", ".join(arm.joint_names)
        right = f"a joint of {arm.name}: {known}"
        raise InvalidInput("joint_names", right, value=name, joint=joint)
    return arm.joint_names.index(name)


def text(problem: Problem, units: Sequence[str] = ()) -> str:
    """A problem file; reading it back gives the same numbers to the last bit.

    Limits are in rad and m, and so are waypoints, unless each joint's unit is given ("deg"): those
    are rounded to 12 decimals.
    """
    import tomli_w  # late: judging needs NumPy and SciPy only

    table: dict[str, Any] = {"name": problem.name, "source": problem.source}
    if problem.joint_names:
        table["joint_names"] = list(problem.joint_names)
    table["waypoints"] = problem.waypoints.tolist()
    unit = list(problem.joint_units) if "m" in problem.joint_units else "rad"
    table["units"] = dict.fromkeys(_UNIT_KEYS, unit)
    size = {key: np.ones(problem.joints) for key in _UNIT_KEYS}
    if "deg" in units:
        size["waypoints"] = np.array([UNITS[unit] for unit in units])
        table["waypoints"] = np.round(problem.waypoints / size["waypoints"], 12).tolist()
        table["units"]["waypoints"] = "deg" if len(set(units)) == 1 else list(units)
    for key, numbers in problem.demands.items():
        demand = DEMANDS[key]
        table[key] = demand.table(numbers / _unit_size(demand, size))
    table["limits"] = {key: limit.table() for key, limit in problem.limits.kinds.items()}
    of_segments = segment_tables.tables(problem.limits)
    if of_segments:
        table["limits"][segment_tables.KEY] = of_segments
    return tomli_w.dumps(table)


def _unit_size(demand: Demand, size: Mapping[str, Array]) -> Array:
    """The unit of a demand's numbers in SI: a rate counts in that of the limits."""
    return demand.unit_size(size["limits" if demand.time else "waypoints"])


def _said_units(table: Mapping[str, Any]) -> dict[str, Any]:
    """The units of waypoints and limits as written: a text, or a list with one per joint.

    A file without limits and rates of its own needs no unit for them.
    """
    rates = [
        key for key, demand in DEMANDS.items() if demand.length and demand.time and key in table
    ]
    limits = table.get("limits", {})
    numbers = [value for value in limits.values() if not isinstance(value, bool)]
    limits_given = bool(numbers or rates)
    if "units" not in table:
        unit = table.get("angle_unit")
        if unit not in tuple(ANGLES):
            right = '"deg" or "rad", or units.waypoints and units.limits in its place'
            raise InvalidInput("angle_unit", right, value=unit)
        return dict.fromkeys(_UNIT_KEYS, unit)
    units = table["units"]
    if "angle_unit" in table:
        right = "left out beside units, which says it for waypoints and limits"
        raise InvalidInput("angle_unit", right, value=table["angle_unit"])
    if not isinstance(units, Mapping):
        raise InvalidInput("units", "a table with waypoints and limits", value=units)
    needed = _UNIT_KEYS if limits_given else ("waypoints",)
    others = keys.unread("units.", units, UNITS_KEYS, needed, strictness="ours")
    return {"limits": "rad"} | {key: unit for key, unit in units.items() if key not in others}


def _units(said: Mapping[str, Any], joints: int) -> dict[str, list[str]]:
    """The unit of each joint's waypoints and limits.

    Raises:
        InvalidInput: A unit is unknown, or one list says that a joint turns, the other that it
            slides.
    """
    units: dict[str, list[str]] = {}
    for key, unit in said.items():
        if not isinstance(unit, list):
            if unit not in tuple(ANGLES):
                right = '"deg" or "rad", or a unit per joint like ["deg", "m"]'
                raise InvalidInput(f"units.{key}", right, value=unit)
            unit = [unit] * joints
        for joint, name in enumerate(unit):
            if name not in tuple(UNITS):
                right = " or ".join(UNITS)
                raise InvalidInput(f"units.{key}", right, value=name, joint=joint)
        if len(unit) != joints:
            raise InvalidInput(f"units.{key}", f"{joints} units, one per joint", value=unit)
        units[key] = unit
    for key, other in (_UNIT_KEYS, reversed(_UNIT_KEYS)):
        if not isinstance(said[key], list):  # a single unit is of angles
            pairs = zip(units[key], units[other], strict=True)
            units[key] = ["m" if length in LENGTHS else name for name, length in pairs]
    kinds = [[unit in LENGTHS for unit in units[key]] for key in _UNIT_KEYS]
    if kinds[0] != kinds[1]:
        right = f"the same kinds of units as units.waypoints, {said['waypoints']}"
        raise InvalidInput("units.limits", right, value=said["limits"])
    return units
