"""A log of ROS's `sensor_msgs/JointState`, as `ros2 topic echo /joint_states` prints it: YAML.

    header: {stamp: {sec: 10, nanosec: 0}, frame_id: ''}
    name: [shoulder, elbow]
    position: [0.0, -1.57]
    velocity: [0.0, 0.0]
    ---

Times count from the first message. Efforts are ignored.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.core import files, keys
from trajopt.core.exceptions import InvalidInput
from trajopt.core.keys import Key
from trajopt.formats import digits, yaml_file
from trajopt.formats.joint_trajectory import duration, numbers
from trajopt.formats.samples import Samples

STATE = {
    "header": Key(keys.table, "its stamp is the time"),
    "name": Key(keys.a_list, "one per joint"),
    "position": Key(keys.a_list, "rad (m), one per joint"),
    "velocity": Key(keys.a_list, "rad/s (m/s), one per joint"),
    "effort": Key(keys.a_list, "torques: the judge computes them"),
}
"""The keys of a message."""


def read(path: Path) -> Samples | None:
    """Read a log; None for a file of anything else.

    Raises:
        InvalidInput: Names the file, the message (from 1), the value, and what would be right.
    """
    if path.suffix == ".json":
        return None
    messages = yaml_file.documents(path, "JointState")
    if not messages or not all(map(_is_state, messages)):
        return None
    try:
        return _samples(messages, path.name)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def _is_state(message: Any) -> bool:
    return isinstance(message, Mapping) and {"name", "position"} <= message.keys()


def _samples(messages: list[Any], file: str) -> Samples:
    unread: list[str] = []
    names = files.names_at(messages[0], "name")
    times: list[float] = []
    tables: dict[str, list[list[float]]] = {"position": [], "velocity": []}
    first: Mapping[str, Any] = {}
    for number, message in enumerate(messages, start=1):
        key = f"message {number}"
        unread += keys.unread(f"{key}: ", message, STATE, ("header",))
        if message["name"] != names:
            right = f"the joints of the first message, {', '.join(names)}"
            raise InvalidInput(f"{key}: name", right, value=message["name"])
        header = message["header"]
        stamp = header.get("stamp") if isinstance(header, Mapping) else None
        if not isinstance(stamp, Mapping):
            raise InvalidInput(f"{key}: header.stamp", "{sec, nanosec}", value=stamp)
        first = first or stamp
        times.append(duration(f"{key}: header.stamp", _since(stamp, first)))
        for name, table in tables.items():
            if message.get(name):
                table.append(numbers(f"{key}: {name}", message[name], len(names)))
            if len(table) not in (0, number):
                right = "numbers in every message, or in none"
                raise InvalidInput(f"{key}: {name}", right, value=message.get(name))
    keys.note_unread(file, unread)
    velocities = np.array(tables["velocity"]) if tables["velocity"] else None
    elapsed = np.array(times) - times[0]
    samples = Samples(tuple(names), elapsed, np.array(tables["position"]), velocities)
    return digits.known(samples)


def _since(stamp: Mapping[str, Any], first: Mapping[str, Any]) -> Any:
    """A stamp less the whole seconds of the first one, so that a float keeps its nanoseconds."""
    whole = "sec" if "sec" in first else "secs"
    if not isinstance(stamp.get(whole), int) or not isinstance(first.get(whole), int):
        return stamp
    return {**stamp, whole: stamp[whole] - first[whole]}
