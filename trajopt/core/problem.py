"""The problem: waypoints to pass in order, starting and ending at rest, within joint limits."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajopt.core import problem_file
from trajopt.core.arm_file import FallingVelocity
from trajopt.core.exceptions import InvalidInput, UnitWarning

Array = NDArray[np.float64]
LimitName = Literal["velocity", "acceleration", "jerk", "position"]
LIMIT_ORDERS: dict[LimitName, int] = {
    "velocity": 1,
    "acceleration": 2,
    "jerk": 3,
    "position": 0,
}
"""Which derivative of position each limit bounds."""
LIMIT_NAMES: tuple[LimitName, ...] = tuple(LIMIT_ORDERS)
_PER_TIME = ("", "/s", "/s²", "/s³")  # of each derivative

# A coordinate is known to some units in its last place.
_COORDINATE_RTOL = 16 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Limits:
    """Bounds of each joint, as `(joints, 2)` arrays of `[low, high]`.

    Each argument is one number per joint (symmetric: `[-x, x]`), or a `[low, high]` pair, or a
    mixture. Units: rad/s, rad/s², rad/s³, rad (metres for a prismatic joint). Velocity and
    acceleration are finite; `jerk` and `position` default to none (infinite), and may be infinite
    for some joints only.

    Raises `InvalidInput` naming the key, joint and value.
    """

    velocity: Array
    acceleration: Array
    jerk: Array
    position: Array

    def __init__(
        self,
        velocity: ArrayLike | Sequence[Any],
        acceleration: ArrayLike | Sequence[Any],
        jerk: ArrayLike | Sequence[Any] | None = None,
        position: ArrayLike | Sequence[Any] | None = None,
    ) -> None:
        given = {
            "velocity": velocity,
            "acceleration": acceleration,
            "jerk": jerk,
            "position": position,
        }
        joints = len(_pairs("velocity", velocity))
        unlimited = np.tile([-np.inf, np.inf], (joints, 1))
        for name, value in given.items():
            pairs = unlimited if value is None else _pairs(name, value)
            if len(pairs) != joints:
                expected = f"{joints} values, one per joint"
                raise InvalidInput(f"limits.{name}", expected, value=len(pairs))
            _check_signs(name, pairs)
            object.__setattr__(self, name, _frozen(pairs))

    @property
    def joints(self) -> int:
        return len(self.velocity)

    @property
    def jerk_limited(self) -> NDArray[np.bool_]:
        """Which joints have a jerk limit, on one side at least, `(joints,)`."""
        finite = np.isfinite(self.jerk)
        return np.asarray(finite.any(axis=1))

    def without(self, *names: LimitName) -> Limits:
        """The same limits with the named ones lifted (only jerk and position can be)."""
        remaining = self.by_name()
        for name in names:
            remaining.pop(name, None)
        return Limits(**remaining)

    def only(self, joints: ArrayLike) -> Limits:
        """The limits of some joints, by index (from 0) or mask."""
        chosen = np.asarray(joints)
        return Limits(
            velocity=self.velocity[chosen],
            acceleration=self.acceleration[chosen],
            jerk=self.jerk[chosen],
            position=self.position[chosen],
        )

    def scaled(self, factor: ArrayLike) -> Limits:
        """Every limit times a positive factor, or one per joint, as another unit needs it."""
        factors = np.asarray(factor, dtype=float)[..., None]
        return Limits(
            velocity=factors * self.velocity,
            acceleration=factors * self.acceleration,
            jerk=factors * self.jerk,
            position=factors * self.position,
        )

    def by_name(self) -> dict[str, Array]:
        """Every limit, `(joints, 2)`, by its name."""
        return {
            "velocity": self.velocity,
            "acceleration": self.acceleration,
            "jerk": self.jerk,
            "position": self.position,
        }


@dataclass(frozen=True, eq=False)
class Problem:
    """Pass every waypoint in order, from rest to rest, as fast as the limits allow.

    `waypoints` is `(waypoints, joints)` in radians: one row per waypoint. All joints pass a
    waypoint at the same instant. Consecutive identical waypoints are one waypoint, passed once;
    waypoints that differ by no more than rounding are identical.
    `joint_names` are the robot's, one per joint, or empty where nobody said them. `joint_units` are
    "rad", or "m" for a prismatic joint, one per joint; empty means radians. `falling_velocity` are
    velocity limits that no planner keeps yet: `judge` and `verify` check them
    (`trajopt.judging.falling_velocity`). None of the three is part of the digest.

    Raises `InvalidInput` where the waypoints do not fit the limits, are not finite, or do not move.
    """

    waypoints: Array
    limits: Limits
    name: str = "unnamed"
    source: str = ""
    joint_names: tuple[str, ...] = ()
    joint_units: tuple[str, ...] = ()
    falling_velocity: tuple[FallingVelocity | None, ...] = ()

    def __init__(
        self,
        waypoints: ArrayLike | Sequence[Any],
        limits: Limits,
        name: str = "unnamed",
        source: str = "",
        joint_names: Sequence[str] = (),
        joint_units: Sequence[str] = (),
        falling_velocity: Sequence[FallingVelocity | None] = (),
    ) -> None:
        rows = _table(waypoints)
        object.__setattr__(self, "waypoints", _frozen(rows))
        object.__setattr__(self, "limits", limits)
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "source", source)
        object.__setattr__(self, "joint_names", tuple(joint_names))
        object.__setattr__(self, "joint_units", tuple(joint_units))
        object.__setattr__(self, "falling_velocity", tuple(falling_velocity))
        _check_count("velocity", self.limits.velocity, self.joints)
        _check_joint_units(joint_units, self.joints)
        self._check_waypoints()
        _check_joint_names(joint_names, self.joints)

    @property
    def joints(self) -> int:
        return int(self.waypoints.shape[1])

    @property
    def joint_labels(self) -> tuple[str, ...]:
        """What to call each joint: by its name, or by its number from 1."""
        numbered = tuple(f"joint {joint + 1}" for joint in range(self.joints))
        return self.joint_names or numbered

    def unit(self, joint: int, order: int = 0) -> str:
        """The unit of a joint's position or of its derivative of this order, rad/s or m/s say."""
        length = self.joint_units[joint] if self.joint_units else "rad"
        return length + _PER_TIME[order]

    def shared_unit(self, order: int = 0) -> str:
        """The unit of all joints together: rad, m, or "rad or m" where there are both."""
        units = {self.unit(joint, order) for joint in range(self.joints)}
        return " or ".join(sorted(units, reverse=True))

    @property
    def segments(self) -> int:
        return len(self.waypoints) - 1

    @property
    def displacements(self) -> Array:
        """`h_k = q_k − q_{k−1}`, `(segments, joints)`, rad."""
        return np.diff(self.waypoints, axis=0)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Which joints move at all, `(joints,)`."""
        return np.asarray(self.displacements.any(axis=0))

    @property
    def largest_displacements(self) -> Array:
        """Of each joint, rad, `(joints,)`; of all where a joint never moves."""
        distances = np.abs(self.displacements)
        largest = np.where(self.moving, distances.max(axis=0), distances.max())
        return np.asarray(largest)

    @property
    def rounding(self) -> Array:
        """How exactly each joint's coordinates are known, rad, `(joints,)`."""
        return _rounding(self.waypoints)

    def merged(self) -> tuple[Problem, NDArray[np.intp]]:
        """This problem with consecutive identical waypoints merged, and where each one went.

        `times[index]` expands the merged problem's waypoint times to this one's.
        """
        differs = _differing(self.waypoints)
        index = np.cumsum(differs) - 1
        if differs.all():
            return self, index
        merged = replace(self, waypoints=self.waypoints[differs])
        return merged, index

    def without(self, *names: LimitName) -> Problem:
        """This problem with the named limits lifted: a relaxation of it."""
        return replace(self, limits=self.limits.without(*names))

    def only(self, joints: ArrayLike) -> Problem:
        """The problem of some joints, by index (from 0) or mask: a relaxation of it.

        Raises:
            InvalidInput: None of these joints moves.
        """
        chosen = np.asarray(joints)
        kept = np.arange(self.joints)[chosen]
        own = (self.joint_names, self.joint_units, self.falling_velocity)
        names, units, falling = [tuple(one[joint] for joint in kept if one) for one in own]
        return replace(
            self,
            waypoints=self.waypoints[:, chosen],
            limits=self.limits.only(chosen),
            joint_names=names,
            joint_units=units,
            falling_velocity=falling,
        )

    def has(self, name: LimitName) -> bool:
        """Whether any joint has a finite limit of this name."""
        pairs = self.limits.by_name()[name]
        finite = np.isfinite(pairs)
        return bool(finite.any())

    def digest(self) -> str:
        """SHA-256 of the numbers (not of names): a changed problem has another digest."""
        return self._digest

    @cached_property
    def _digest(self) -> str:
        import hashlib  # OpenSSL: not where problems are only listed

        digest = hashlib.sha256()
        limits = self.limits.by_name()
        for array in (self.waypoints, *limits.values()):
            numbers = (array + 0.0).astype("<f8")  # −0.0 is 0.0
            digest.update(repr(array.shape).encode())
            digest.update(numbers.tobytes())
        return digest.hexdigest()

    @classmethod
    def from_toml(cls, path: str | Path) -> Problem:
        """Read a problem file (`trajopt.core.problem_file`).

        Warns with `UnitWarning` where one unit is given for everything, but waypoints and limits
        look as if they were written in different ones.

        Raises:
            InvalidInput: Names the file, the key, the joint, the value, and what would be right.
        """
        try:
            return _from_file(Path(path))
        except InvalidInput as error:
            raise error.in_file(str(path)) from None

    def to_toml(self) -> str:
        """The problem file, in radians; reading it back gives the same digest."""
        limits = self.limits.by_name()
        for name in LIMIT_NAMES:
            if not self.has(name):
                del limits[name]
        return problem_file.text(
            self.name,
            self.source,
            self.waypoints,
            limits,
            self.joint_names,
            self.joint_units,
        )

    def _check_waypoints(self) -> None:
        if not _differing(self.waypoints)[1:].any():
            raise InvalidInput("waypoints", "at least two different ones; these never move")
        lows, highs = self.limits.position.T
        outside = (self.waypoints < lows) | (self.waypoints > highs)
        for row, joint in np.argwhere(outside):
            low = lows[joint]
            high = highs[joint]
            right = f"a value inside limits.position [{low:.9g}, {high:.9g}] {self.unit(joint)}"
            raise InvalidInput(
                f"waypoints, waypoint {row + 1}",
                right,
                value=float(self.waypoints[row, joint]),
                joint=int(joint),
            )


def _from_file(path: Path) -> Problem:
    written = problem_file.read(path, LIMIT_NAMES)
    waypoints = _table(written.waypoints)
    limits = _limits_of(written, waypoints.shape[1])
    problem = Problem(
        waypoints * written.waypoint_unit,
        limits,
        written.name,
        written.source,
        written.joint_names,
        written.joint_units,
        written.falling_velocity,
    )
    if not written.units_said:
        as_written = limits.scaled(1 / written.limit_unit)
        mixed = problem_file.mixed_units(waypoints, as_written.velocity, as_written.acceleration)
        if mixed:
            message = f"{path}: {mixed}; say units.waypoints and units.limits"
            warnings.warn(UnitWarning(message), stacklevel=3)
    return problem


def _limits_of(written: problem_file.ProblemFile, joints: int) -> Limits:
    """The robot's limits, rad and s, but for the kinds that the file gives itself."""
    if not written.robot_limits:
        limits = Limits(**written.limits)  # before scaling: errors show what the file says
        _check_count("velocity", limits.velocity, joints)
        _check_joint_units(written.joint_units, joints)
        return limits.scaled(written.limit_unit)
    pairs = dict(written.robot_limits)
    _check_count("velocity", pairs["velocity"], joints)
    _check_joint_units(written.joint_units, joints)
    for kind, value in written.limits.items():
        own = _pairs(kind, value)
        _check_signs(kind, own)
        _check_count(kind, own, joints)
        pairs[kind] = own * np.asarray(written.limit_unit)[..., None]
    return Limits(**pairs)


def _check_count(kind: str, pairs: Array, joints: int) -> None:
    if len(pairs) != joints:
        expected = f"{joints} values, one per joint of the waypoints"
        raise InvalidInput(f"limits.{kind}", expected, value=len(pairs))


def _pairs(name: str, value: Any) -> Array:
    """One `[low, high]` pair per joint, from numbers (symmetric) or pairs."""
    if _is_table(value) and value.shape[1] == 2:
        return np.array(value, dtype=float)
    key = f"limits.{name}"
    if not _is_list(value) or len(value) == 0:
        raise InvalidInput(key, "one number or [low, high] pair per joint", value=value)
    pairs = []
    for joint, item in enumerate(value):
        if _is_number(item):
            high = float(item)
            pairs.append((-high, high))
            continue
        if not _is_pair(item):
            raise InvalidInput(key, "a number or a [low, high] pair", value=item, joint=joint)
        low, high = item
        pairs.append((float(low), float(high)))
    return np.array(pairs)


def _is_pair(item: Any) -> bool:
    if not _is_list(item) or len(item) != 2:
        return False
    low, high = item
    return _is_number(low) and _is_number(high)


def _check_signs(name: str, pairs: Array) -> None:
    """Velocity and acceleration are finite, rates allow rest, positions are in order."""
    low, high = pairs.T
    right = low < high
    expected = "low < high"
    if name != "position":
        right = (low < 0) & (high > 0)
        expected = "a positive number, or low < 0 < high"
    if name in ("velocity", "acceleration"):
        right &= np.isfinite(low) & np.isfinite(high)
        expected += ", finite"
    for joint in np.flatnonzero(~right):
        value = _as_written(name, low[joint], high[joint])
        raise InvalidInput(f"limits.{name}", expected, value=value, joint=int(joint))


def _as_written(name: str, low: float, high: float) -> float | list[float]:
    """A pair, or the one number that it was made of."""
    missing = np.isnan(low) and np.isnan(high)
    symmetric = low == -high or missing
    if symmetric and name != "position":
        return float(high)
    return [float(low), float(high)]


def _table(rows: Any) -> Array:
    """Waypoints as a table; errors name the waypoint and the joint, counted from 1."""
    if _is_table(rows) and len(rows) > 1 and np.isfinite(rows).all():
        return np.array(rows, dtype=float)
    if not _is_list(rows) or len(rows) < 2:
        raise InvalidInput("waypoints", "at least two rows, one per waypoint", value=rows)
    for number, row in enumerate(rows, start=1):
        key = f"waypoints, waypoint {number}"
        if not _is_list(row) or len(row) == 0:
            raise InvalidInput(key, "a row of numbers, one per joint", value=row)
        joints = len(rows[0])
        if len(row) != joints:
            raise InvalidInput(key, f"{joints} numbers", value=list(row))
        for joint, item in enumerate(row):
            if not _is_number(item) or not np.isfinite(float(item)):
                raise InvalidInput(key, "a finite number", value=item, joint=joint)
    return np.array(rows, dtype=float)


def _check_joint_units(units: Sequence[str], joints: int) -> None:
    if len(units) not in (0, joints):
        right = f"{joints} units, one per joint of the waypoints"
        raise InvalidInput("units", right, value=list(units))
    for joint, unit in enumerate(units):
        if unit not in ("rad", "m"):
            raise InvalidInput("joint_units", '"rad" or "m"', value=unit, joint=joint)


def _rounding(waypoints: Array) -> Array:
    """Some units in the last place of each joint's largest coordinate, rad, `(joints,)`."""
    largest = np.abs(waypoints).max(axis=0)
    return np.asarray(_COORDINATE_RTOL * largest)


def _differing(waypoints: Array) -> NDArray[np.bool_]:
    """Which waypoints differ by more than rounding from the last one that did, `(waypoints,)`."""
    rounding = _rounding(waypoints)
    steps = np.abs(np.diff(waypoints, axis=0))
    differs = np.ones(len(waypoints), dtype=bool)
    if (steps > rounding).any(axis=1).all():
        return differs
    last = waypoints[0]
    for row, waypoint in enumerate(waypoints[1:], start=1):
        distance = np.abs(waypoint - last)
        differs[row] = (distance > rounding).any()
        if differs[row]:
            last = waypoint
    return differs


def _check_joint_names(names: Sequence[str], joints: int) -> None:
    if len(names) not in (0, joints):
        right = f"{joints} names, one per joint of the waypoints"
        raise InvalidInput("joint_names", right, value=list(names))
    seen = set()
    for joint, name in enumerate(names):
        if not isinstance(name, str) or not name.isprintable() or not name.strip():
            raise InvalidInput("joint_names", "a name", value=name, joint=joint)
        if name in seen:
            raise InvalidInput("joint_names", "names that differ", value=name, joint=joint)
        seen.add(name)


def _is_table(value: Any) -> TypeGuard[Array]:
    """Whether it is rows of Python's own floats, in which nothing else can hide."""
    if not isinstance(value, np.ndarray) or value.dtype != float:
        return False
    return value.ndim == 2 and value.size > 0


def _is_list(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _is_number(value: Any) -> bool:
    """Whether `float` takes it: no truth value, no complex number, no integer beyond 1e308."""
    if isinstance(value, bool):
        return False
    if isinstance(value, int):
        return abs(value) < 2**1023
    return isinstance(value, float | np.integer | np.floating)


def _frozen(array: Array) -> Array:
    array = np.array(array, dtype=float)
    array.setflags(write=False)
    return array
