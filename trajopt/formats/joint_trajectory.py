"""`trajectory_msgs/JointTrajectory` of ROS, as JSON or YAML.

    joint_names: [shoulder, elbow]
    points:
    - positions: [0.0, 0.0]                     # rad
      velocities: [0.0, 0.0]                    # rad/s; in every point, or in none
      time_from_start: {sec: 0, nanosec: 0}     # or {secs, nsecs}, or seconds
    - ...

It may be anywhere inside another message: a `RobotTrajectory` of MoveIt, its answer to a request, a
goal of `FollowJointTrajectory`, a message of rosbridge. Of several in one message a reader has to
be told which one is meant (`found`). A motion of `play_motion` is one too: it calls the names
`joints`, and `play_motion2` has the positions of all points in one list, with `times_from_start`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.core import files, keys
from trajopt.core.exceptions import InvalidInput
from trajopt.core.keys import Key
from trajopt.core.tables import is_list
from trajopt.formats import digits, yaml_file
from trajopt.formats.samples import Samples

_WHAT = "JointTrajectory"
_FIELDS = ("positions", "velocities", "accelerations")
MESSAGE = {
    "header": Key(keys.table, "when it begins"),
    "joint_names": Key(keys.a_list, "one per joint"),
    "points": Key(keys.a_list, "the samples"),
    "meta": Key(keys.anything, "what `play_motion` shows of a motion"),
}
"""The keys of a message."""
POINT = {
    "positions": Key(keys.a_list, "rad (m), one per joint"),
    "velocities": Key(keys.a_list, "rad/s (m/s), one per joint"),
    "accelerations": Key(keys.a_list, "rad/s² (m/s²), one per joint"),
    "effort": Key(keys.a_list, "torques: the judge computes them"),
    "time_from_start": Key(keys.anything, "{sec, nanosec}, {secs, nsecs} or seconds"),
}
"""The keys of a point."""
_DURATIONS = (("sec", "nanosec"), ("secs", "nsecs"))  # of ROS 2 and ROS 1
_NANOSECONDS = 10**9  # in a second
_DURATION_MAX = (2**31 - 1, _NANOSECONDS - 1)  # seconds, nanoseconds
_OWN = {"points", "joint_names", "times_from_start"}  # a table with one of these is a trajectory
_CUT_SHORT = "..."  # printed by `ros2 topic echo` in place of a long array's rest


def read(path: Path) -> Samples:
    """Read a message; a name ending in .json is JSON, any other YAML, of which JSON is a part.

    Raises:
        InvalidInput: Names the file, the point, the joint, the value, and what would be right.
    """
    try:
        return from_message(_table(path), path.name)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def write(path: Path, samples: Samples, *, goal: bool = False) -> None:
    """Write a message as JSON (.json) or YAML (.yaml, .yml).

    Times are rounded to nanoseconds, which is what the message holds.

    Args:
        path: The file.
        samples: What is written, in rad and s.
        goal: True for a goal of `FollowJointTrajectory`, which holds the message.

    Raises:
        InvalidInput: The file's name ends otherwise.
    """
    message = to_message(samples)
    if goal:
        message = {"trajectory": message}
    if path.suffix == ".json":
        text = json.dumps(message, indent=1) + "\n"
    elif path.suffix in (".yaml", ".yml"):
        text = yaml_file.text(message)
    else:
        right = "a file ending in .json, .yaml or .yml"
        raise InvalidInput(_WHAT, right, value=str(path))
    path.write_text(text, encoding="utf-8")


def to_message(samples: Samples) -> dict[str, Any]:
    """The message as dictionaries and lists."""
    tables = {field: getattr(samples, field) for field in _FIELDS}
    points = []
    for sample, time in enumerate(samples.times):
        point: dict[str, Any] = {}
        for field, table in tables.items():
            if table is not None:
                point[field] = table[sample].tolist()
        total = round(float(time) * _NANOSECONDS)
        seconds, nanoseconds = divmod(total, _NANOSECONDS)
        point["time_from_start"] = {"sec": seconds, "nanosec": nanoseconds}
        points.append(point)
    return {"joint_names": list(samples.joint_names), "points": points}


def from_message(message: Any, name: str = _WHAT) -> Samples:
    """Samples of a message, or of a message that contains it, as dictionaries and lists.

    Args:
        message: The message.
        name: Its file's, for a `FileNote` about keys that are not read.

    Raises:
        InvalidInput: Names the point (from 1), the joint, the value, and what would be right.
    """
    inside = found(message)
    if len(inside) > 1:
        places = ", ".join(inside)
        right = "one trajectory in the file: save each of them in a file of its own"
        raise InvalidInput(_WHAT, right, value=places)
    (table,) = inside.values()
    if "points" not in table:
        raise InvalidInput(_WHAT, f"{_RIGHT}; points is missing")
    unread = keys.unread("", table, MESSAGE)
    names = files.names_at(table, "joint_names")
    points = table["points"]
    if not names:
        raise InvalidInput("joint_names", "a list of names, one per joint", value=names)
    if not is_list(points) or len(points) < 2:
        right = "at least two points: the first is where the robot starts, at time 0"
        raise InvalidInput("points", right, value=points)
    times = []
    columns: dict[str, list[list[float]]] = {field: [] for field in _FIELDS}
    for number, point in enumerate(points, start=1):
        key = f"points, point {number}"
        if not isinstance(point, Mapping):
            raise InvalidInput(key, "a table", value=point)
        unread += keys.unread(f"{key}: ", point, POINT, ["time_from_start"])
        times.append(duration(f"{key}: time_from_start", point["time_from_start"]))
        for field in _FIELDS:
            row = point.get(field)
            if row:
                own = numbers(f"{key}: {field}", row, len(names))
                columns[field].append(own)
            if len(columns[field]) not in (0, number):
                right = "numbers in every point, or in none"
                raise InvalidInput(f"{key}: {field}", right, value=row)
    if not columns["positions"]:
        raise InvalidInput("points", "positions in every point")
    if times[0] != 0:
        right = (
            "0, with the state that the robot starts from as the first point: the motion before "
            "the first point depends on it"
        )
        raise InvalidInput("points, point 1: time_from_start", right, value=times[0])
    keys.note_unread(name, unread)
    tables: dict[str, Any] = {field: own for field, own in columns.items() if own}
    return digits.known(Samples(tuple(names), np.array(times), commanded=True, **tables))


def _table(path: Path) -> Any:
    if path.suffix == ".json":
        return files.json(path, _WHAT)
    documents = yaml_file.documents(path, _WHAT)
    if len(documents) != 1:
        raise InvalidInput(_WHAT, "one message in the file", value=len(documents))
    return documents[0]


_RIGHT = "a JointTrajectory, or a message that holds one: joint_names and points"


def found(message: Any) -> dict[str, Mapping[str, Any]]:
    """Return every JointTrajectory inside a message, by its place there.

    Those without points are returned only if there are no others. A trajectory of poses
    (`MultiDOFJointTrajectory`) does not count. Motions of `play_motion` are returned as messages.

    Raises:
        InvalidInput: The message has no JointTrajectory, or a motion's positions do not fit its
            times.
    """
    tables: dict[str, Mapping[str, Any]] = {}
    level = [("", message)]
    while level:
        place, value = level.pop(0)
        if isinstance(value, Mapping) and _OWN & value.keys():
            value = _of_play_motion(place, value)
            points = value.get("points") or []
            of_poses = is_list(points) and any(
                isinstance(point, Mapping) and "transforms" in point for point in points
            )
            if not of_poses and not place.endswith("multi_dof_joint_trajectory"):
                tables[place or "."] = value
        elif isinstance(value, Mapping):
            start = f"{place}." if place else ""
            level += [(f"{start}{key}", own) for key, own in value.items()]
        elif is_list(value):
            level += [(f"{place}[{index}]", own) for index, own in enumerate(value)]
    with_points = {place: table for place, table in tables.items() if table.get("points")}
    if not tables:
        raise InvalidInput(_WHAT, _RIGHT)
    return with_points or dict(list(tables.items())[:1])


def _of_play_motion(place: str, table: Mapping[str, Any]) -> Mapping[str, Any]:
    """A motion of `play_motion` or `play_motion2` as a message; a message as it is."""
    if "joint_names" in table or not is_list(table.get("joints")):
        return table
    own = {"joint_names": table["joints"], **table}
    del own["joints"]
    times = own.pop("times_from_start", None)
    if times is None:
        return own
    positions, joints = own.pop("positions", None), len(table["joints"])
    if not is_list(times) or not is_list(positions) or len(positions) != joints * len(times):
        key = f"{place}.positions" if place else "positions"
        raise InvalidInput(key, f"{joints} numbers, one per joint, for each of times_from_start")
    rows = [positions[row * joints : (row + 1) * joints] for row in range(len(times))]
    points = zip(rows, times, strict=True)
    return own | {"points": [{"positions": row, "time_from_start": time} for row, time in points]}


def duration(key: str, stated: Any) -> float:
    """A duration as ROS 2 or ROS 1 writes it, or a number of seconds."""
    if not isinstance(stated, Mapping):
        return _number(key, stated)
    for names in _DURATIONS:
        if stated and stated.keys() <= set(names):
            whole = []
            for name, most in zip(names, _DURATION_MAX, strict=True):
                own = f"{key}.{name}"
                value = _number(own, stated.get(name, 0))
                if not 0 <= value <= most or value != int(value):
                    raise InvalidInput(own, f"a whole number from 0 to {most}", value=value)
                whole.append(int(value))
            seconds, nanoseconds = whole
            return seconds + nanoseconds / _NANOSECONDS
    raise InvalidInput(key, "{sec, nanosec}, {secs, nsecs} or seconds", value=dict(stated))


def numbers(key: str, row: Any, joints: int) -> list[float]:
    """A list of numbers, one per joint."""
    if is_list(row) and _CUT_SHORT in row:
        right = "all numbers; `ros2 topic echo --full-length` does not cut arrays short"
        raise InvalidInput(key, right, value=_CUT_SHORT)
    if not is_list(row) or len(row) != joints:
        raise InvalidInput(key, f"{joints} numbers, one per joint", value=row)
    return [_number(key, item, joint) for joint, item in enumerate(row)]


def _number(key: str, item: Any, joint: int | None = None) -> float:
    value = yaml_file.number(item)
    if value is None:
        raise InvalidInput(key, "a finite number", value=item, joint=joint)
    return value
