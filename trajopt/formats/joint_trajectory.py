"""`trajectory_msgs/JointTrajectory` of ROS, as JSON or YAML.

    joint_names: [shoulder, elbow]
    points:
    - positions: [0.0, 0.0]                     # rad
      velocities: [0.0, 0.0]                    # rad/s; in every point, or in none
      time_from_start: {sec: 0, nanosec: 0}     # or {secs, nsecs}, or seconds
    - ...

It may be inside another message: a `RobotTrajectory` of MoveIt (`joint_trajectory`), or a goal of
`FollowJointTrajectory` (`trajectory`, perhaps in `goal`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.core import files
from trajopt.core.exceptions import InvalidInput
from trajopt.formats import digits, yaml_file
from trajopt.formats.samples import Samples

_WHAT = "JointTrajectory"
# Keys that hold the message, from the outside in: of action goals, of MoveIt and the controller.
_CARRIERS = ("goal", "trajectory", "joint_trajectory")
_CARRIER_KEYS = (
    *_CARRIERS,
    "component_goal_tolerance",
    "component_path_tolerance",
    "controller_names",
    "error_code",
    "goal_id",
    "goal_time_tolerance",
    "goal_tolerance",
    "group_name",
    "header",
    "model_id",
    "multi_dof_joint_trajectory",
    "multi_dof_trajectory",
    "path_tolerance",
    "planning_time",
    "trajectory_start",
)
_MESSAGE_KEYS = ("header", "joint_names", "points")
_FIELDS = ("positions", "velocities", "accelerations")
_POINT_KEYS = (*_FIELDS, "effort", "time_from_start")
_DURATIONS = (("sec", "nanosec"), ("secs", "nsecs"))  # of ROS 2 and ROS 1
_NANOSECONDS = 10**9  # in a second
_DURATION_MAX = (2**31 - 1, _NANOSECONDS - 1)  # seconds, nanoseconds
_CUT_SHORT = "..."  # printed by `ros2 topic echo` in place of a long array's rest


def read(path: Path) -> Samples:
    """Read a message; a name ending in .json is JSON, any other YAML, of which JSON is a part.

    Raises:
        InvalidInput: Names the file, the point, the joint, the value, and what would be right.
    """
    try:
        return from_message(_table(path))
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


def from_message(message: Any) -> Samples:
    """Samples of a message, or of a message that contains it, as dictionaries and lists.

    Raises:
        InvalidInput: Names the point (from 1), the joint, the value, and what would be right.
    """
    table = _uncarried(message)
    names = files.names_at(table, "joint_names")
    points = table["points"]
    if not names:
        raise InvalidInput("joint_names", "a list of names, one per joint", value=names)
    if not _is_list(points) or len(points) < 2:
        right = "at least two points: the first is where the robot starts, at time 0"
        raise InvalidInput("points", right, value=points)
    times = []
    columns: dict[str, list[list[float]]] = {field: [] for field in _FIELDS}
    for number, point in enumerate(points, start=1):
        key = f"points, point {number}"
        if not isinstance(point, Mapping):
            raise InvalidInput(key, "a table", value=point)
        files.check_keys(f"{key}: ", point, _POINT_KEYS, ["time_from_start"])
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
    tables: dict[str, Any] = {name: own for name, own in columns.items() if own}
    return digits.known(Samples(tuple(names), np.array(times), **tables))


def _table(path: Path) -> Any:
    if path.suffix == ".json":
        return files.json(path, _WHAT)
    documents = yaml_file.documents(path, _WHAT)
    if len(documents) != 1:
        raise InvalidInput(_WHAT, "one message in the file", value=len(documents))
    return documents[0]


def _uncarried(message: Any) -> Mapping[str, Any]:
    """The table that has the points."""
    table = message
    for _ in range(len(_CARRIERS) + 1):
        if _is_list(table) and len(table) == 1:  # a DisplayTrajectory lists its trajectories
            table = table[0]
        if not isinstance(table, Mapping):
            break
        if "points" in table:
            files.check_keys("", table, _MESSAGE_KEYS)
            return table
        carried = [table[key] for key in _CARRIERS if key in table]
        if not carried:
            break
        files.check_keys("", table, _CARRIER_KEYS)
        table = carried[0]
    right = "a JointTrajectory, or a RobotTrajectory or FollowJointTrajectory goal that holds one"
    raise InvalidInput(_WHAT, f"{right}: joint_names and points")


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
    if _is_list(row) and _CUT_SHORT in row:
        right = "all numbers; `ros2 topic echo --full-length` does not cut arrays short"
        raise InvalidInput(key, right, value=_CUT_SHORT)
    if not _is_list(row) or len(row) != joints:
        raise InvalidInput(key, f"{joints} numbers, one per joint", value=row)
    return [_number(key, item, joint) for joint, item in enumerate(row)]


def _number(key: str, item: Any, joint: int | None = None) -> float:
    value = yaml_file.number(item)
    if value is None:
        raise InvalidInput(key, "a finite number", value=item, joint=joint)
    return value


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)
