"""Samples of a motion, as a CSV file or a ROS message holds them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from trajopt.core import interpolation as between
from trajopt.core.arrays import Array
from trajopt.core.interpolation import Interpolation
from trajopt.core.tables import check_joint_names, frozen
from trajopt.core.trajectory import Trajectory

_TABLES = ("positions", "velocities", "accelerations", "half_digits", "velocity_half_digits")


@dataclass(frozen=True, eq=False)
class Samples:
    """Positions of named joints at some times, perhaps with their derivatives.

    Attributes:
        joint_names: one per joint.
        times: strictly increasing, s, `(samples,)`.
        positions: rad (metres for a prismatic joint), `(samples, joints)`.
        velocities: rad/s, `(samples, joints)`, or None.
        accelerations: rad/s², `(samples, joints)`, or None.
        joint_units: "rad", or "m" for a prismatic joint; empty if unknown.
        half_digits: Half a unit of the last digit of each position, as its text had them, rad,
            `(samples, joints)`; None for samples that were not read from a text.
        time_half_digit: Half a unit of the last digit of the times, s; 0 where they are on an even
            grid.
        decimals: Number of decimals of each joint's column, in its unit; empty without
            `half_digits`.
        velocity_half_digits: As `half_digits`, of the velocities, rad/s.
        commanded: Whether these were sent to a robot, not measured: then the digits are all that is
            unknown.

    Raises:
        InvalidInput: These do not fit together, are not finite, or times do not increase.
    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array | None = None
    accelerations: Array | None = None
    joint_units: tuple[str, ...] = ()
    half_digits: Array | None = None
    time_half_digit: float = 0.0
    decimals: tuple[int, ...] = ()
    velocity_half_digits: Array | None = None
    commanded: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        for name in ("times", *_TABLES):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, frozen(values))
        between.check(self.times, self.positions, self.velocities, self.accelerations)
        check_joint_names(self.joint_names, self.positions.shape[1])

    def for_joints(self, joints: Sequence[int]) -> Samples:
        """The samples of some joints, by index, in this order."""
        own: dict[str, Any] = {}
        for name in _TABLES:
            table = getattr(self, name)
            own[name] = None if table is None else table[:, joints]
        for name in ("joint_names", "joint_units", "decimals"):
            values = getattr(self, name)
            own[name] = tuple(values[joint] for joint in joints if values)
        return replace(self, **own)

    def interpolation(self, wanted: Interpolation = "auto") -> Interpolation:
        """Return the interpolation; for `auto`, the controller's.

        Raises:
            InvalidInput: The samples lack what it needs.
        """
        return between.chosen(wanted, self.velocities, self.accelerations)

    def trajectory(self, interpolation: Interpolation = "auto") -> Trajectory:
        """The motion as executed, from time 0 on (`Trajectory.from_samples`)."""
        return Trajectory.from_samples(
            self.times,
            self.positions,
            self.velocities,
            self.accelerations,
            interpolation=interpolation,
        )


def known_as(own: Sequence[str], known: Sequence[str], *, ordered: bool = True) -> tuple[str, ...]:
    """The names by which a robot knows the joints of a file, or the file's own names.

    A namespace that all joints of one side share (`left/elbow`) is ignored, and so is a prefix
    (`gen3_joint_1` beside `joint_1`) where it leaves no choice. Numbered columns (`q0`, `q1`, ...)
    of other names are the robot's joints in their order, if it is known (`ordered`).
    """
    by_name = dict(zip(_without_namespace(known), known, strict=True))
    bare = _without_namespace(own)
    found = [by_name.get(name) for name in bare]
    if not any(found):
        found = _without_prefix(bare, by_name)
    if all(found):
        return tuple(filter(None, found))
    if known and set(known) <= set(found):  # and further joints
        return tuple(joint or name for joint, name in zip(found, own, strict=True))
    in_order = ordered and numbers(own) == sorted(numbers(own)) and len(own) == len(known)
    return tuple(known if in_order and numbers(own) else own)


def numbers(names: Sequence[str]) -> list[int]:
    """The numbers of names that differ in them alone, all from 0 or 1 on; else none."""
    numbered = [re.fullmatch(r"(.*?)([0-9]{1,3})\]?", name) for name in names]
    stems = {match[1] for match in numbered if match}
    found = [int(match[2]) for match in numbered if match]
    first = min(found, default=2)
    whole = first < 2 and sorted(found) == list(range(first, first + len(names)))
    return found if whole and len(stems) == 1 else []


def _without_prefix(own: Sequence[str], by_name: Mapping[str, str]) -> list[str | None]:
    """The known names that differ from these by one prefix, the same for all, on either side.

    There are none where several prefixes would do.
    """
    readings = set()
    for name in own:
        for known in by_name:
            longer, shorter = max(name, known, key=len), min(name, known, key=len)
            prefix = longer.removesuffix(shorter)
            if prefix and longer.endswith(shorter) and prefix[-1] in "_-./":
                readings.add((prefix, longer == name))
    found = set()
    for prefix, is_own in readings:
        changed = [
            by_name.get(name.removeprefix(prefix) if is_own else f"{prefix}{name}")
            if name.startswith(prefix) or not is_own
            else None
            for name in own
        ]
        named = {name for name in changed if name}
        if named == set(by_name.values()) or None not in changed:
            found.add(tuple(changed))
    return list(found.pop()) if len(found) == 1 else [None] * len(own)


def _without_namespace(names: Sequence[str]) -> list[str]:
    """The names of joints, without the namespace that all of them share."""
    namespaces = {name.rpartition("/")[0] for name in names}
    if len(namespaces) > 1:
        return list(names)
    return [name.rpartition("/")[2] for name in names]
