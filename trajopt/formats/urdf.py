"""URDF: names of the joints that move, position and velocity limits, in the order of the file.

A URDF has no acceleration limits; `joint_limits.yaml` adds them (`trajopt.formats.joint_limits`).
Only joints are read; meshes, transmissions and other elements may be faulty. So may joints that no
waypoint names: the error of a joint is raised when its limits are needed.

Franka's own element is read too (libfranka, `test/fr3.urdf` and `src/joint_velocity_limits.cpp`):

    <position_based_velocity_limits velocity_offset="0.30" deceleration_limit="6.0"/>

It belongs to the range of the joint's `<limit>`; soft limits do not move it
(`trajopt.core.arm_file.FallingVelocity`).
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from trajopt.core import files, numerals
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import FallingVelocity, LimitName
from trajopt.formats.robot_limits import Bounds, JointBounds, RobotLimits

_UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}  # of joints that move
_MAX_TAGS = 400_000  # some 200 MB once parsed; a large robot has 10,000
_UNLIMITED = (-np.inf, np.inf)
_ATTRIBUTES = {
    "limit": ("lower", "upper", "velocity", "effort"),
    "safety_controller": ("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"),
    "position_based_velocity_limits": ("velocity_offset", "deceleration_limit"),
    "mimic": ("joint", "multiplier", "offset"),
}
_OTHER_ELEMENTS = ("axis", "calibration", "child", "dynamics", "origin", "parent")
_INFINITIES = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf}


def read(path: str | Path) -> RobotLimits:
    """Read the limits of a robot description, rad and s (m for a prismatic joint).

    Joints that are fixed, or mimic another, are left out. A velocity limit of 0 is ignored:
    generators write it where the limit is unknown.

    Raises:
        InvalidInput: Names the file and what would be right. The error of a faulty joint is raised
            when its limits are needed (`RobotLimits.limits`).
    """
    try:
        return _robot(_parsed(Path(path)), str(path))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None


def _parsed(file: Path) -> Element:
    try:
        content = files.content(file)
        files.check_bounds(content.decode("latin-1"))  # for any declared encoding
    except (OSError, ValueError) as error:
        raise files.unreadable(file, "robot", "URDF", error) from None
    if b"<!ENTITY" in content:
        raise InvalidInput("robot", "a URDF without entities of its own")
    tags = content.count(b"<")
    if tags > _MAX_TAGS:
        raise InvalidInput("robot", f"a URDF of at most {_MAX_TAGS} tags", value=tags)
    xacro = InvalidInput(
        "robot", f"a URDF; make one: xacro {file.name} > robot.urdf", value="xacro"
    )
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        if "unbound prefix" in str(error) and b"<xacro:" in content:
            raise xacro from None
        raise InvalidInput("robot", "a URDF", value=str(error)) from None
    if any("xacro}" in element.tag for element in root.iter()):
        raise xacro
    if root.tag != "robot":
        raise InvalidInput("robot", "a URDF, whose first tag is robot", value=root.tag)
    return root


def _robot(root: Element, source: str) -> RobotLimits:
    joints: dict[str, JointBounds] = {}
    unsound: dict[str, InvalidInput] = {}
    units: dict[str, str] = {}
    falling: dict[str, FallingVelocity] = {}
    for joint in root.findall("joint"):
        unit = _UNITS.get(joint.get("type", ""))
        if unit is None or joint.find("mimic") is not None:
            continue
        name = joint.get("name", "")
        try:
            if name in joints:
                raise InvalidInput("joint", "names that differ", value=name)
            joints[name] = {}
            units[name] = unit
            _check_elements(joint)
            joints[name] = _bounds(joint)
            own = _falling_velocity(joint)
            if own is not None:
                falling[name] = own
        except InvalidInput as error:
            key = f"{name}: {error.key}"
            unsound[name] = InvalidInput(key, error.expected, value=error.value, file=source)
    if not joints:
        raise InvalidInput("robot", "at least one joint that moves")
    return RobotLimits(
        joints, source=source, units=units, falling_velocity=falling, unsound=unsound
    )


def _check_elements(joint: Element) -> None:
    """Refuse misspelt elements and attributes, and limits that are there twice."""
    seen = set()
    for element in joint:
        tag = element.tag
        if tag in _ATTRIBUTES and tag in seen:
            raise InvalidInput(tag, "this element once")
        seen.add(tag)
        if tag in _ATTRIBUTES:
            files.check_keys(f"{tag} ", element.attrib, _ATTRIBUTES[tag], others=True)
        elif tag not in _OTHER_ELEMENTS:
            files.check_keys("", {tag: None}, _ATTRIBUTES, others=True)


def _bounds(joint: Element) -> JointBounds:
    bounds: dict[LimitName, Bounds] = {}
    continuous = joint.get("type") == "continuous"
    if continuous:
        bounds["position"] = _UNLIMITED
    limit = joint.find("limit")
    if limit is None:
        return bounds
    velocity = _number(limit, "velocity")
    if velocity < 0:
        raise InvalidInput("limit velocity", "0 (no limit) or a positive number", value=velocity)
    if 0 < velocity < np.inf:
        bounds["velocity"] = (-velocity, velocity)
    if not continuous:
        bounds["position"] = _range(joint, limit)
    return bounds


def _range(joint: Element, limit: Element) -> Bounds:
    """The joint's range, narrowed by soft limits where a safety controller keeps it in those."""
    low = _number(limit, "lower")
    high = _number(limit, "upper")
    safety = joint.find("safety_controller")
    if safety is not None:
        soft_low = _number(safety, "soft_lower_limit")
        soft_high = _number(safety, "soft_upper_limit")
        if soft_low < soft_high:
            low = max(low, soft_low)
            high = min(high, soft_high)
    if not low < high:
        raise InvalidInput("limit", "lower below upper", value=[low, high])
    return low, high


def _falling_velocity(joint: Element) -> FallingVelocity | None:
    """Franka's element, beside the range of the joint's `<limit>`."""
    own = joint.find("position_based_velocity_limits")
    if own is None:
        return None
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        raise InvalidInput(
            "position_based_velocity_limits", "a limit with lower and upper beside it"
        )
    return FallingVelocity(
        offset=_number(own, "velocity_offset"),
        deceleration=_number(own, "deceleration_limit"),
        low=_number(limit, "lower"),
        high=_number(limit, "upper"),
    )


def _number(element: Element, name: str) -> float:
    """An attribute as a number; 0 where it is missing, as in ROS's parser."""
    text = element.get(name, "0").strip()
    try:
        return _INFINITIES.get(text) or numerals.decimal(text)
    except ValueError:
        key = f"{element.tag} {name}"
        raise InvalidInput(key, "a number", value=text) from None
