"""URDF: names of the joints that move, position and velocity limits, in the order of the file.

A URDF has no acceleration limits; `joint_limits.yaml` adds them (`trajopt.formats.joint_limits`).
Meshes are not opened. The parser is ROS's own, `urdf_parser_py`, the extra `ros`.
"""

from __future__ import annotations

import io
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.exceptions import InvalidInput, MissingBackend
from trajopt.formats.robot_limits import Bounds, JointBounds, RobotLimits
from trajopt.problem import LimitName

_MOVING = ("revolute", "continuous", "prismatic")
_UNLIMITED = (-np.inf, np.inf)


def read(path: str | Path) -> RobotLimits:
    """The limits of a robot description, rad and s (m for a prismatic joint).

    Joints that are fixed, or mimic another, are left out. A velocity limit of 0, as generators
    write where nobody said one, is none.

    Raises:
        InvalidInput: Names the file, the joint, the value, and what would be right.
        MissingBackend: The parser is not installed.
    """
    file = Path(path)
    try:
        content = file.read_bytes()
    except OSError as error:
        right = "a readable URDF file"
        raise InvalidInput("robot", right, value=error.strerror, file=str(path)) from None
    if b"<xacro:" in content:
        right = f"a URDF; make one of this xacro file: xacro {file.name} > robot.urdf"
        raise InvalidInput("robot", right, file=str(path))
    try:
        return RobotLimits(_joints(content), source=str(path))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def _joints(content: bytes) -> dict[str, JointBounds]:
    joints = {}
    for joint in _parsed(content).joints:
        if joint.type not in _MOVING or joint.mimic is not None:
            continue
        if joint.name in joints:
            raise InvalidInput("joint", "names that differ", value=joint.name)
        joints[joint.name] = _bounds(joint)
    if not joints:
        raise InvalidInput("robot", "at least one joint that moves")
    return joints


def _parsed(content: bytes) -> Any:
    """The robot as `urdf_parser_py` has it; what it says of tags that it does not know is noise."""
    try:
        from urdf_parser_py.urdf import URDF
    except ImportError as error:
        raise MissingBackend("urdf_parser_py", "ros") from error
    try:
        with redirect_stderr(io.StringIO()):
            return URDF.from_xml_string(content)
    except Exception as error:  # the parser has no error of its own for all of them
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInput("robot", "a URDF", value=reason) from None


def _bounds(joint: Any) -> JointBounds:
    bounds: dict[LimitName, Bounds] = {}
    if joint.type == "continuous":
        bounds["position"] = _UNLIMITED
    if joint.limit is None:
        return bounds
    velocity = joint.limit.velocity
    if not 0 <= velocity < np.inf:
        right = "0 (no limit) or a positive number"
        raise InvalidInput(f"{joint.name}: limit velocity", right, value=velocity)
    if velocity > 0:
        bounds["velocity"] = (-velocity, velocity)
    if joint.type != "continuous":
        bounds["position"] = _range(joint)
    return bounds


def _range(joint: Any) -> Bounds:
    """The joint's range, narrowed by soft limits where a safety controller keeps it in those."""
    low = joint.limit.lower
    high = joint.limit.upper
    safety = joint.safety_controller
    if safety is not None and safety.soft_lower_limit < safety.soft_upper_limit:
        low = max(low, safety.soft_lower_limit)
        high = min(high, safety.soft_upper_limit)
    if not low < high:
        raise InvalidInput(f"{joint.name}: limit", "lower below upper", value=[low, high])
    return low, high
