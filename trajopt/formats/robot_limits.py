"""Limits by the names of joints, put together from several sources: a robot's, then a file's.

    robot = arms.named("ur5e").limits                 # positions and velocities, say
    own = joint_limits.read(Path("joint_limits.yaml"))
    limits = robot.updated(own).limits(["elbow_joint", "wrist_1_joint"])

A source may lack kinds of limits. Only the limits that are needed in the end must be complete.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.bodies import Masses
from trajopt.core.chain import JointFrame, linked
from trajopt.core.exceptions import FileNote, InvalidInput, nearest
from trajopt.core.keys import note, note_unreal
from trajopt.core.limits import LIMIT_NAMES, Limit, LimitName, Limits, named

Bounds = tuple[float, float]
JointBounds = Mapping[LimitName, Bounds]

_REQUIRED: tuple[LimitName, ...] = ("velocity", "acceleration")
_UNLIMITED = (-np.inf, np.inf)


def note_braking(source: str, joint_names: Iterable[str]) -> None:
    """Warn, with one `FileNote`, of deceleration limits that differ from acceleration limits."""
    start = "deceleration and acceleration limits differ, the smaller one holds for both: "
    note(source, start, joint_names)


@dataclass(frozen=True)
class RobotLimits:
    """The limits of a robot's joints, rad and s (metres for a prismatic joint).

    Attributes:
        joints: Each joint's bounds, `(low, high)` by the kind of limit, under its name, in the
            robot's order. A kind may be missing (not stated) or infinite (stated as unlimited).
        source: The source of the limits, for errors and for the problem.
        ordered: True if the joints are in the robot's order; a file of limits is often in
            alphabetical order.
        velocity_scaling: The share of the velocity limits that a planner should use. It is no limit
            of the robot: `limits` ignores it, `scaled` applies it.
        acceleration_scaling: The share of the acceleration limits that a planner should use.
        units: Each joint's SI unit, "rad" or "m", where the source says whether it slides.
        others: Rows of the numbers of other kinds of limits (`Limit.numbers`), by kind and joint.
        unsound: The error of each joint that cannot be used.
        continuous: Joints that turn without end, so that whole turns make no difference.
        completed: Joints whose acceleration limit is that of `with_acceleration`.
        frames: The joints' frames by their names, where the source has them.
        stated: Limits of the whole robot that a number or a text states, by key.
        payload: Mass at the tool, kg.
        efforts: The drives' largest torques, N m (N), where the source has no frames of joints.
    """

    joints: Mapping[str, JointBounds]
    source: str
    ordered: bool = True
    velocity_scaling: float = 1.0
    acceleration_scaling: float = 1.0
    units: Mapping[str, str] = field(default_factory=dict)
    others: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    unsound: Mapping[str, InvalidInput] = field(default_factory=dict)
    continuous: frozenset[str] = frozenset()
    completed: frozenset[str] = frozenset()
    frames: Mapping[str, JointFrame] = field(default_factory=dict)
    stated: Mapping[str, float | str] = field(default_factory=dict)
    payload: float | None = None
    efforts: Mapping[str, float] = field(default_factory=dict)

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(self.joints)

    def updated(self, other: RobotLimits) -> RobotLimits:
        """Return these limits, with those of another source in place of the same kinds.

        Joints that only the other one has (a gripper's, perhaps) are left out, which a `FileNote`
        says.

        Raises:
            InvalidInput: The other source has joints, but none of these.
        """
        if other.joints and self.joints.keys().isdisjoint(other.joints):
            names = ", ".join(self.joints)
            found = ", ".join(other.joints)
            raise InvalidInput("joints", f"some of {names}", value=found, file=other.source)
        self._note_left_out(other)
        joints = {}
        for name, bounds in self.joints.items():
            joints[name] = {**bounds, **other.joints.get(name, {})}
        return RobotLimits(
            joints=joints,
            source=f"{self.source}, {other.source}",
            ordered=self.ordered,
            velocity_scaling=self.velocity_scaling * other.velocity_scaling,
            acceleration_scaling=self.acceleration_scaling * other.acceleration_scaling,
            units={**other.units, **self.units},
            others={**other.others, **self.others},
            unsound={**other.unsound, **self.unsound},
            continuous=self.continuous | other.continuous,
            frames={
                name: frame._replace(effort=other.efforts.get(name, frame.effort))
                for name, frame in {**other.frames, **self.frames}.items()
            },
        )

    def _note_left_out(self, other: RobotLimits) -> None:
        free = [name for name in self.joints if name not in other.joints]
        left_out = []
        for name in other.joints:
            close = nearest(name, free)
            if name not in self.joints:
                left_out.append(f"{name} (perhaps {close})" if close else name)
        if left_out:
            message = f"{other.source}: left out, as {self.source} has no such joint: "
            warnings.warn(FileNote(message + ", ".join(left_out)), stacklevel=3)

    def scaled(self) -> RobotLimits:
        """Return the limits to plan with: multiplied by the scaling factors."""
        factors = {"velocity": self.velocity_scaling, "acceleration": self.acceleration_scaling}
        if set(factors.values()) == {1.0}:
            return self
        joints = {}
        for name, bounds in self.joints.items():
            ranges = dict(bounds)
            for kind in _REQUIRED:
                if kind in ranges:
                    low, high = ranges[kind]
                    factor = factors[kind]
                    ranges[kind] = (factor * low, factor * high)
            joints[name] = ranges
        shares = ", ".join(f"{kind} times {factor:g}" for kind, factor in factors.items())
        return replace(
            self,
            joints=joints,
            source=f"{self.source} ({shares})",
            velocity_scaling=1.0,
            acceleration_scaling=1.0,
        )

    def limits_acceleration(self, joint_names: Sequence[str]) -> bool:
        """Return whether any of these joints has an acceleration limit."""
        known = (self.joints.get(name, {}) for name in joint_names)
        return any(np.isfinite(ranges.get("acceleration", _UNLIMITED)).all() for ranges in known)

    def with_acceleration(self, size: float) -> RobotLimits:
        """Return these limits, with this acceleration limit for joints without one, rad/s²."""
        without = [name for name in self.joints if not self.limits_acceleration([name])]
        added = {name: {**self.joints[name], "acceleration": (-size, size)} for name in without}
        return replace(self, joints={**self.joints, **added}, completed=frozenset(without))

    def limits(self, joint_names: Sequence[str]) -> Limits:
        """The limits of these joints, in this order; scaling factors do not count.

        Raises:
            InvalidInput: A joint is unknown, has no velocity or acceleration limit, or none of the
                link frames that a limit needs.
        """
        bounds = [self._bounds(name) for name in joint_names]
        pairs = {kind: [ranges.get(kind, _UNLIMITED) for ranges in bounds] for kind in LIMIT_NAMES}
        for kind in _REQUIRED:
            by_joint = zip(joint_names, pairs[kind], strict=True)
            absent = [name for name, pair in by_joint if not np.isfinite(pair).all()]
            if absent:
                raise self._absent(kind, absent)
        others = {key: self._other(key, joint_names) for key in self.others}
        bounding = {key: limit for key, limit in others.items() if limit.bounds.any()}
        found = Limits(**pairs, others={**bounding, **self.stated})
        if not self.stated:
            return found
        chain = linked(self.frames, joint_names)
        if self.payload is not None:
            chain = chain.carrying({"mass": self.payload})
        weighed = any(named(key).of_chain for key in self.stated)
        if weighed and isinstance(chain.masses, Masses):
            note_unreal(self.source, [joint_names[joint] for joint in chain.masses.unreal])
        return found.for_chain(chain.named(joint_names))

    def _other(self, key: str, joint_names: Sequence[str]) -> Limit:
        """A limit of another kind, of these joints; NaN for those that it does not bound."""
        rows = self.others[key]
        missing = np.full_like(next(iter(rows.values())), np.nan)
        numbers = np.stack([rows.get(name, missing) for name in joint_names])
        return named(key).of_numbers(numbers)

    def described(self, joint_names: Sequence[str]) -> dict[str, Any]:
        """Arguments of a `Problem` for these joints, beside waypoints and limits, by name."""
        units = [self.units[name] for name in joint_names if name in self.units]
        return {
            "joint_names": joint_names,
            "joint_units": units if len(units) == len(joint_names) else (),
        }

    def names_of(self, count: int) -> tuple[str, ...]:
        """The names of a robot's joints, for `count` columns that carry no names.

        Raises:
            InvalidInput: There are more or fewer joints than columns, or in no known order.
        """
        names = ", ".join(self.joints)
        if count != len(self.joints):
            right = f"{len(self.joints)} columns ({names}), or a header with the joints' names"
            raise InvalidInput("columns", right, value=count)
        if not self.ordered and count > 1:
            right = f"a header with the joints' names ({names}): {self.source} has no order"
            raise InvalidInput("waypoints", right)
        return self.joint_names

    def _bounds(self, name: str) -> JointBounds:
        if name in self.unsound:
            raise self.unsound[name]
        if name in self.joints:
            return self.joints[name]
        known = ", ".join(self.joints)
        right = f"one of the joints of {self.source}: {known}"
        close = nearest(name, self.joints)
        if close:
            right = f"a joint of {self.source}, perhaps {close}"
        raise InvalidInput("joint", right, value=name)

    def _absent(self, kind: LimitName, joint_names: Sequence[str]) -> InvalidInput:
        """An error that says how to add a limit that a problem needs."""
        names = ", ".join(joint_names)
        key = f"{kind} limit is missing"
        if all(kind in self.joints[name] for name in joint_names):
            key = f"{kind} limit is switched off (has_{kind}_limits: false)"
        right = (
            f"one for {names}; add --limits joint_limits.yaml with, under joint_limits: "
            f"{joint_names[0]}:, has_{kind}_limits: true and max_{kind}: a number (per joint)"
        )
        if kind == "acceleration":
            right += ", or --acceleration with a number for all of them"
            key += " (this URDF has none)" if self.source.endswith(".urdf") else ""
        return InvalidInput(key, right, file=self.source)
