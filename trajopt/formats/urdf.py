"""URDF: names of the joints that move, position and velocity limits, in the order of the file.

Limits of acceleration, deceleration and jerk are read where `<limit>` has them (URDF 1.2); mostly a
`joint_limits.yaml` adds them (`trajopt.formats.joint_limits`). A deceleration limit that differs
from the acceleration limit: the smaller one bounds accelerations of both signs, which a `FileNote`
says. Other numbers that bound a rate, of other programs, are named in a `FileNote`.

Only joints are read; meshes, transmissions and other elements may be faulty. So may joints that no
waypoint names: the error of a joint is raised when its limits are needed.

Franka's own element is read too (libfranka, `test/fr3.urdf` and `src/joint_velocity_limits.cpp`):

    <position_based_velocity_limits velocity_offset="0.30" deceleration_limit="6.0"/>

It belongs to the range of the joint's `<limit>`; soft limits do not move it
(`trajopt.core.limits.FallingVelocity`).

Link frames are those of `<origin>` and `<axis>` (`trajopt.core.chain`); joints that are fixed, or
mimic another, stay where they are at 0. A joint with a faulty number on its way to the base has
none: motions are judged without it.

Masses are those of `<inertial>`, of all links that move with a joint; `effort` of `<limit>` and
`damping` and `friction` of `<dynamics>` belong to the joint (`trajopt.core.bodies`). The error of a
faulty one is raised where a limit needs masses.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from trajopt.core import bodies, files, keys, numerals
from trajopt.core.arrays import Array
from trajopt.core.chain import JointFrame, origin_poses, unit_axes
from trajopt.core.exceptions import InvalidInput
from trajopt.core.keys import Key, Keys
from trajopt.core.limits import FallingVelocity, LimitName
from trajopt.formats.robot_limits import (
    Bounds,
    JointBounds,
    RobotLimits,
    note_braking,
)

_UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}  # of joints that move
_RATES: tuple[LimitName, ...] = ("velocity", "acceleration", "jerk")
_MAX_TAGS = 400_000  # some 200 MB once parsed; a large robot has 10,000
_UNLIMITED = (-np.inf, np.inf)
LIMIT = {
    "lower": Key(keys.number, "lower end of the range, rad (m)"),
    "upper": Key(keys.number, "upper end of the range, rad (m)"),
    "velocity": Key(keys.number, "largest velocity, rad/s (m/s)"),
    "effort": Key(keys.number, "largest torque, N m (force, N), for limits of torque"),
    "acceleration": Key(keys.number, "largest acceleration, rad/s² (m/s²)"),
    "deceleration": Key(keys.number, "the same for braking"),
    "jerk": Key(keys.number, "largest jerk, rad/s³ (m/s³)"),
}
SAFETY = {
    "soft_lower_limit": Key(keys.number, "lower soft limit, rad (m)"),
    "soft_upper_limit": Key(keys.number, "upper soft limit, rad (m)"),
    "k_position": Key(keys.number, "gain of the position in the soft limits"),
    "k_velocity": Key(keys.number, "gain of the velocity in the soft limits"),
}
FALLING = {
    "velocity_offset": Key(keys.number, "velocity at the ends of the range, rad/s"),
    "deceleration_limit": Key(keys.number, "deceleration towards the ends, rad/s²"),
}
MIMIC = {
    "joint": Key(keys.text, "the joint that it follows"),
    "multiplier": Key(keys.number, "how much it moves with it"),
    "offset": Key(keys.number, "where it is when the other is at 0"),
}
ATTRIBUTES: Mapping[str, Keys] = {
    "limit": LIMIT,
    "safety_controller": SAFETY,
    "position_based_velocity_limits": FALLING,
    "mimic": MIMIC,
}
"""The attributes of each element of a joint that is read."""
ELEMENTS = {tag: Key(keys.holding(names), f"<{tag}>") for tag, names in ATTRIBUTES.items()} | {
    tag: Key(keys.table, f"<{tag}>, which bounds nothing")
    for tag in ("axis", "calibration", "child", "dynamics", "origin", "parent")
}
"""The elements of a joint."""
_HARMLESS_XACRO = ("arg", "property")  # they define what may be used in ${} and $()
_PREFIX = re.compile(rb"[<\s]([A-Za-z_][\w.-]*):[A-Za-z_]")
_TEMPLATE = re.compile(r"\$[({]")
_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_INFINITIES = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf}


def read(path: str | Path) -> RobotLimits:
    """Read the limits of a robot description, rad and s (m for a prismatic joint).

    Joints that are fixed, or mimic another, are left out. A limit of 0 of a velocity, an
    acceleration or a jerk is ignored: generators write it where the limit is unknown. Properties
    and arguments of xacro are ignored; a joint that uses one is refused.

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
        root = ElementTree.fromstring(_declared(content))
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise InvalidInput("robot", "a URDF", value=str(error)) from None
    namespace = root.tag.partition("}")[0] + "}"
    for element in root.iter():
        prefix, _, tag = element.tag.rpartition("}")
        if "xacro" in prefix and tag not in _HARMLESS_XACRO:
            raise xacro
        element.tag = element.tag.removeprefix(namespace)
        if element.tag == "limit":
            for key in [key for key in element.attrib if key.startswith("{")]:
                rate = key.rpartition("}")[2]
                if rate in _RATES and rate not in element.attrib:  # drake:acceleration
                    element.set(rate, element.attrib.pop(key))
    if any(_TEMPLATE.search(joint.get("name", "")) for joint in root.findall("joint")):
        raise xacro
    if root.tag != "robot":
        raise InvalidInput("robot", "a URDF, whose first tag is robot", value=root.tag)
    return root


def _declared(content: bytes) -> bytes:
    """Declare the prefixes of names that the file does not, as ROS's parser knows none."""
    used = sorted(set(_PREFIX.findall(content)) - {b"xml", b"xmlns"})
    unknown = [prefix for prefix in used if b"xmlns:" + prefix not in content]
    said = b"".join(b' xmlns:%s="%s"' % (prefix, prefix) for prefix in unknown)
    return re.sub(rb"<robot\b", rb"<robot" + said, content, count=1)


def _robot(root: Element, source: str) -> RobotLimits:
    joints: dict[str, JointBounds] = {}
    unsound: dict[str, InvalidInput] = {}
    units: dict[str, str] = {}
    falling: dict[str, Array] = {}
    unread: list[str] = []
    braking: list[str] = []
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
            left = [*_other_keys(joint), *_unread(joint)]
            unread += (f"{key} of {name}" for key in left)
            joints[name] = _bounds(joint)
            if _brakes_otherwise(joint):
                braking.append(name)
            curve = _falling_velocity(joint)
            if curve is not None:
                falling[name] = curve
        except InvalidInput as error:
            key = f"{name}: {error.key}"
            unsound[name] = InvalidInput(key, error.expected, value=error.value, file=source)
    if not joints:
        raise InvalidInput("robot", "at least one joint that moves")
    unread += _of_interfaces(root, joints)
    keys.note_unread(source, unread)
    note_braking(source, braking)
    others = {FallingVelocity.key: falling} if falling else {}
    turning = root.findall("joint[@type='continuous']")
    return RobotLimits(
        joints,
        source=source,
        units=units,
        others=others,
        unsound=unsound,
        continuous=frozenset(joint.get("name", "") for joint in turning),
        frames=_frames(root, joints, source),
    )


def _frames(root: Element, moving: Collection[str], source: str) -> dict[str, JointFrame]:
    """Return the frames of the joints that move, by name; a joint that is not sound has none."""
    above: dict[str, Element] = {}
    below: dict[str, list[Element]] = {}
    for joint in root.iterfind("joint"):
        above.setdefault(_link(joint, "child"), joint)
        below.setdefault(_link(joint, "parent"), []).append(joint)
    found: dict[str, JointFrame] = {}
    moved: dict[str, Element] = {}
    for joint in above.values():
        if joint.get("name") in moving:
            moved.setdefault(joint.get("name", ""), joint)
    for name, joint in moved.items():
        try:
            axis = unit_axes("axis", _triple(joint, "axis", "xyz", "1 0 0")[None])[0]
            before, origin = _before(joint, above, moving)
            tool = _behind(joint, below, moving)
        except InvalidInput:
            continue
        found[name] = JointFrame(before, origin, axis, joint.get("type") == "prismatic", tool)
    links = {link.get("name", ""): link for link in root.iterfind("link")}
    for name, frame in found.items():
        fixed: dict[str, Array] = {}
        try:
            for link, pose in _fixed(moved[name], below, found):
                fixed[link] = pose
            body = np.zeros((4, 4))
            for link in [name for name in fixed if name in links]:
                body += fixed[link] @ _inertial(links[link]) @ fixed[link].T
            damping, friction, effort = _drive(moved[name])
            found[name] = frame._replace(
                body=body, damping=damping, friction=friction, effort=effort
            )
        except InvalidInput as error:
            found[name] = frame._replace(body=error.in_file(source))
        found[name] = found[name]._replace(links=fixed)
    return found


def _fixed(
    joint: Element, below: Mapping[str, list[Element]], moving: Collection[str]
) -> Iterator[tuple[str, Array]]:
    """Yield the links that move with a joint, and their poses in its frame.

    Joints behind it that move have their own.

    Raises:
        InvalidInput: Names a joint behind it without a frame.
    """
    left = [(_link(joint, "child"), np.eye(4))]
    seen = set()
    while left:
        name, pose = left.pop()
        if name in seen:
            continue
        seen.add(name)
        yield name, pose
        for following in below.get(name, []):
            if following.get("name") in moving:
                continue
            if following.get("type") in _UNITS and following.find("mimic") is None:
                right = "a joint whose frame is sound, as it moves a mass"
                raise InvalidInput("joint", right, value=following.get("name"))
            left.append((_link(following, "child"), pose @ _origin(following)))


def _inertial(link: Element) -> Array:
    """Return the body of a link, in its frame; 0 for one without `<inertial>`."""
    element = link.find("inertial")
    if element is None:
        return np.zeros((4, 4))
    key = f"link {link.get('name')}, inertial"
    mass, tensor = element.find("mass"), element.find("inertia")
    try:
        if mass is None:
            raise InvalidInput("mass", "<mass value=…/>, kg")
        numbers = [0.0] * 6 if tensor is None else [_number(tensor, key) for key in _TENSOR]
        body = bodies.body(_number(mass, "value"), (0, 0, 0), numbers)
        pose = _origin(element)
    except InvalidInput as error:
        raise InvalidInput(f"{key}: {error.key}", error.expected, value=error.value) from None
    return np.asarray(pose @ body @ pose.T)


def _drive(joint: Element) -> tuple[float, float, float]:
    """Return viscous and Coulomb friction and largest torque of a joint; NaN if none is stated.

    Raises:
        InvalidInput: Names the joint and what would be right.
    """
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    found = []
    for key in ("damping", "friction"):
        number = 0.0 if dynamics is None else _number(dynamics, key)
        if number < 0:
            name = f"{joint.get('name')}: dynamics {key}"
            raise InvalidInput(name, "0 or more", value=number)
        found.append(number)
    damping, friction = found
    effort = 0.0 if limit is None else _number(limit, "effort")
    return damping, friction, effort if effort > 0 else np.nan


def _before(
    joint: Element, above: Mapping[str, Element], moving: Collection[str]
) -> tuple[str | None, Array]:
    """Return the joint before this one that moves, and this one's pose in its frame."""
    origin = _origin(joint)
    for _ in above:  # no longer than the robot, even in a loop
        before = above.get(_link(joint, "parent"))
        if before is None:
            return None, origin
        if before.get("name") in moving:
            return before.get("name"), origin
        joint = before
        origin = _origin(joint) @ origin
    raise InvalidInput("joint", "a way to the base", value=joint.get("name"))


def _behind(joint: Element, below: Mapping[str, list[Element]], moving: Collection[str]) -> Array:
    """Return the pose of the last link that is fixed to a joint's link, as long as it is one."""
    pose = np.eye(4)
    for _ in below:
        following = below.get(_link(joint, "child"), [])
        if len(following) != 1 or following[0].get("name") in moving:
            break
        (joint,) = following
        pose = pose @ _origin(joint)
    return pose


def _link(joint: Element, side: str) -> str:
    element = joint.find(side)
    return "" if element is None else element.get("link", "")


def _origin(joint: Element) -> Array:
    """Return the pose of a joint's frame on the link before it."""
    at, turned = (_triple(joint, "origin", key, "0 0 0") for key in ("xyz", "rpy"))
    return origin_poses(at, turned)


def _triple(joint: Element, tag: str, key: str, default: str) -> Array:
    """Return three numbers of an element's attribute."""
    element = joint.find(tag)
    text = default if element is None else element.get(key, default)
    numbers = [numerals.parsed(number) for number in text.split()]
    if len(numbers) != 3 or not all(
        number is not None and np.isfinite(number) for number in numbers
    ):
        raise InvalidInput(f"{tag} {key}", "three numbers", value=text)
    return np.array(numbers, dtype=float)


def _other_keys(joint: Element) -> Iterator[str]:
    """The elements and attributes that resemble known ones and are not read.

    Raises:
        InvalidInput: One of them is misspelt, or an element is there twice.
    """
    given: dict[str, Mapping[str, str]] = {}
    for element in joint:
        tag = element.tag
        if tag in given and tag in ATTRIBUTES:
            raise InvalidInput(tag, "this element once")
        given[tag] = element.attrib
        if tag in ATTRIBUTES:
            near = keys.unread(f"{tag} ", element.attrib, ATTRIBUTES[tag], shared=True)
            yield from (f"{tag} {key}" for key in near)
    yield from keys.unread("", given, ELEMENTS, shared=True)


def _unread(joint: Element) -> Iterator[str]:
    """The attributes of a joint's elements that bound a rate and are not read."""
    for element in joint:
        known = ATTRIBUTES.get(element.tag, {})
        if element.tag != "axis":
            for key, value in element.attrib.items():
                bounds = keys.bounds_rate(key) or (keys.bounds_rate(element.tag) and not known)
                if key not in known and bounds and _is_positive(value):
                    yield f"{element.tag} {key}"
    # It bounds the velocity by the distance from a soft limit.
    safety = joint.find("safety_controller")
    if safety is not None and _is_positive(safety.get("k_position", "0")):
        yield "safety_controller k_position"


def _of_interfaces(root: Element, joints: Mapping[str, JointBounds]) -> Iterator[str]:
    """The rates' ranges of ros2_control's interfaces that are narrower than what is read."""
    for joint in root.iterfind("ros2_control/joint"):
        name = joint.get("name", "")
        for interface in joint.iterfind("command_interface"):
            kind = interface.get("name", "")
            low, high = joints.get(name, {}).get(kind, _UNLIMITED)  # type: ignore[call-overload]
            for param in interface.iterfind("param"):
                value = numerals.parsed((param.text or "").strip())
                if not keys.bounds_rate(kind) or value is None:
                    continue
                side = param.get("name", "")
                if (side == "min" and value > low) or (side == "max" and value < high):
                    yield f"ros2_control {kind} {side} of {name}"


def _is_positive(text: str) -> bool:
    value = numerals.parsed(text.strip())
    return value is None or value > 0


def _brakes_otherwise(joint: Element) -> bool:
    """Return whether a deceleration limit differs from the acceleration limit."""
    limit = joint.find("limit")
    if limit is None:
        return False
    braking = abs(_number(limit, "deceleration"))
    return braking not in (0, _number(limit, "acceleration"))


def _bounds(joint: Element) -> JointBounds:
    bounds: dict[LimitName, Bounds] = {}
    continuous = joint.get("type") == "continuous"
    if continuous:
        bounds["position"] = _UNLIMITED
    limit = joint.find("limit")
    if limit is None:
        return bounds
    for kind in _RATES:
        size = _number(limit, kind)
        if size < 0:
            raise InvalidInput(f"limit {kind}", "0 (no limit) or a positive number", value=size)
        if kind == "acceleration":
            braking = abs(_number(limit, "deceleration"))  # some write it as an acceleration
            size = min(size or np.inf, braking or np.inf)
        if 0 < size < np.inf:
            bounds[kind] = (-size, size)
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


def _falling_velocity(joint: Element) -> Array | None:
    """The numbers of Franka's element, beside the range of the joint's `<limit>`."""
    curve = joint.find("position_based_velocity_limits")
    if curve is None:
        return None
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        raise InvalidInput(
            "position_based_velocity_limits", "a limit with lower and upper beside it"
        )
    row = [_number(curve, name) for name in FALLING]
    row += [_number(limit, name) for name in ("lower", "upper")]
    try:
        (numbers,) = FallingVelocity(np.array([row])).numbers
    except InvalidInput as error:
        _, _, name = error.key.rpartition(".")
        attributes = dict(zip(("offset", "deceleration"), FALLING, strict=True))
        key = attributes.get(name, "position range")
        raise InvalidInput(key, error.expected, value=error.value) from None
    return numbers


def _number(element: Element, name: str) -> float:
    """An attribute as a number; 0 where it is missing, as in ROS's parser."""
    text = element.get(name, "0").strip()
    try:
        return _INFINITIES.get(text) or numerals.decimal(text)
    except ValueError:
        key = f"{element.tag} {name}"
        right = "a number"
        if _TEMPLATE.search(text):
            right += "; xacro or a launch file puts it in the template's place"
        raise InvalidInput(key, right, value=text) from None
