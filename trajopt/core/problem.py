"""The problem: waypoints to pass in order, starting and ending at rest, within joint limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput, WrongType, shown
from trajopt.core.numerals import is_number

LimitName = Literal["velocity", "acceleration", "jerk", "position"]
LIMIT_ORDERS: dict[LimitName, int] = {"velocity": 1, "acceleration": 2, "jerk": 3, "position": 0}
"""Which derivative of position each limit bounds."""
LIMIT_NAMES: tuple[LimitName, ...] = tuple(LIMIT_ORDERS)
_PER_TIME = ("", "/s", "/s²", "/s³")  # units of the derivatives, order by order

# A coordinate is known to some units in its last place.
COORDINATE_RTOL = 16 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Limits:
    """Bounds of each joint, as `(joints, 2)` arrays of `[low, high]`.

    Each argument is one number per joint (symmetric: `[-x, x]`), or a `[low, high]` pair, or a
    mixture. Units: rad/s, rad/s², rad/s³, rad (metres for a prismatic joint). Velocity and
    acceleration are finite; `jerk` and `position` default to none (infinite), and may be infinite
    for some joints only.

    Limits are equal if all their numbers are.

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
        joints = len(_pairs("velocity", velocity))
        unlimited = np.tile([-np.inf, np.inf], (joints, 1))
        self.__dict__.update(
            velocity=velocity,
            acceleration=acceleration,
            jerk=unlimited if jerk is None else jerk,
            position=unlimited if position is None else position,
        )
        for name, value in self.by_name().items():
            pairs = _pairs(name, value)
            if len(pairs) != joints:
                expected = f"{joints} values, one per joint"
                raise InvalidInput(f"limits.{name}", expected, value=len(pairs))
            _check_signs(name, pairs)
            self.__dict__[name] = frozen(pairs)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Limits):
            return NotImplemented
        theirs = other.by_name()
        return all(np.array_equal(own, theirs[name]) for name, own in self.by_name().items())

    def __hash__(self) -> int:
        return hash(self.velocity.tobytes())

    @property
    def joints(self) -> int:
        return len(self.velocity)

    @property
    def jerk_limited(self) -> Bools:
        """Which joints have a jerk limit, on one side at least, `(joints,)`."""
        finite = np.isfinite(self.jerk)
        return np.any(finite, axis=1)

    def without(self, *names: LimitName) -> Limits:
        """Return these limits without the named ones: jerk, position, or both."""
        remaining = self.by_name()
        for name in names:
            remaining.pop(name, None)
        return Limits(**remaining)

    def only(self, joints: ArrayLike) -> Limits:
        """The limits of some joints, by index (from 0) or mask."""
        chosen = np.asarray(joints)
        pairs = {}
        for name, own in self.by_name().items():
            pairs[name] = own[chosen]
        return Limits(**pairs)

    def scaled(self, factor: ArrayLike) -> Limits:
        """Every limit times a positive factor, or one per joint, as another unit needs it."""
        factors = np.asarray(factor, dtype=float)[..., None]
        pairs = {}
        for name, own in self.by_name().items():
            pairs[name] = factors * own
        return Limits(**pairs)

    def in_units(self, time: float, lengths: Array | float) -> Limits:
        """These limits where times count in `time`, s, and positions in `lengths`, rad.

        `lengths` is one for all joints, or `(joints, 1)`.
        """
        rate = time / lengths
        pairs = {"position": self.position / lengths}
        for name, order in LIMIT_ORDERS.items():
            if order > 0:
                pairs[name] = getattr(self, name) * rate * time ** (order - 1)
        return Limits(**pairs)

    def by_name(self) -> dict[str, Array]:
        """Every limit, `(joints, 2)`, by its name."""
        return {name: getattr(self, name) for name in LIMIT_NAMES}


@dataclass(frozen=True)
class FallingVelocity:
    """A velocity limit that falls to zero towards the ends of a joint's range.

    The joint at `q` may move upwards no faster than `max(0, sqrt(2 d max(0, high − q)) − o)`, and
    downwards no faster than `max(0, sqrt(2 d max(0, q − low)) − o)`. This is Franka's form
    (libfranka, `include/franka/rate_limiting.h`; `<position_based_velocity_limits>` in a URDF).

    Attributes:
        offset: `o`, rad/s (m/s for a prismatic joint).
        deceleration: `d`, rad/s².
        low, high: Positions where the roots end, rad; they may differ from the position limits.
    """

    offset: float
    deceleration: float
    low: float
    high: float

    def __post_init__(self) -> None:
        if not 0 <= self.offset < np.inf:
            raise InvalidInput("velocity_offset", "a number from 0", value=self.offset)
        if not 0 < self.deceleration < np.inf:
            right = "a positive number"
            raise InvalidInput("deceleration_limit", right, value=self.deceleration)
        if not -np.inf < self.low < self.high < np.inf:
            right = "a finite range, lower below upper"
            raise InvalidInput("position range", right, value=[self.low, self.high])


@dataclass(frozen=True, eq=False)
class Problem:
    """Pass every waypoint in order, from rest to rest, as fast as the limits allow.

    `waypoints` is `(waypoints, joints)` in radians: one row per waypoint. All joints pass a
    waypoint at the same time. Consecutive identical waypoints are one waypoint, passed once;
    waypoints that differ by no more than rounding are identical.

    `joint_names` has one name per joint, or is empty. `joint_units` has "rad", or "m" for a
    prismatic joint; empty means radians. `falling_velocity` has velocity limits that planners do
    not keep: `judge` and `verify` check them (`trajopt.judging.falling_velocity`). None of the
    three is part of the digest.

    Problems are equal if their waypoints and limits are: names do not count.

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
        self.__dict__.update(
            waypoints=frozen(waypoint_table(waypoints)),
            limits=limits,
            name=name,
            source=source,
            joint_names=tuple(joint_names),
            joint_units=tuple(joint_units),
            falling_velocity=tuple(falling_velocity),
        )
        if limits.joints != self.joints:
            expected = f"{self.joints} values, one per joint of the waypoints"
            raise InvalidInput("limits.velocity", expected, value=limits.joints)
        _check_joint_units(self.joint_units, self.joints)
        self._check_waypoints()
        if self.joint_names:
            check_joint_names(self.joint_names, self.joints)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Problem):
            return NotImplemented
        return self.digest() == other.digest()

    def __hash__(self) -> int:
        return hash(self.digest())

    def __repr__(self) -> str:
        limits = ", ".join(name for name in LIMIT_NAMES if self.has(name))
        size = f"{len(self.waypoints)} waypoints, {self.joints} joint{'s' * (self.joints > 1)}"
        return f"Problem({self.name!r}, {size}, limits: {limits})"

    @property
    def joints(self) -> int:
        return int(self.waypoints.shape[1])

    @property
    def joint_labels(self) -> tuple[str, ...]:
        """A label of each joint: its name, or its number from 1."""
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
    def moving(self) -> Bools:
        """Which joints move at all, `(joints,)`."""
        return np.any(self.displacements, axis=0)

    @cached_property
    def largest_displacements(self) -> Array:
        """Largest `|h_k|` of each joint, rad, `(joints,)`; a joint at rest gets the largest."""
        distances = np.abs(self.displacements)
        own = distances.max(axis=0)
        return np.where(self.moving, own, distances.max())

    @cached_property
    def rounding(self) -> Array:
        """Some units in the last place of each joint's largest coordinate, rad, `(joints,)`."""
        return _rounding(self.waypoints)

    def merged(self) -> tuple[Problem, Indices]:
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
        own = {
            "joint_names": self.joint_names,
            "joint_units": self.joint_units,
            "falling_velocity": self.falling_velocity,
        }
        described: dict[str, Any] = {}
        for name, values in own.items():
            described[name] = [values[joint] for joint in kept if values]
        return replace(
            self, waypoints=self.waypoints[:, chosen], limits=self.limits.only(chosen), **described
        )

    def has(self, name: LimitName) -> bool:
        """Return whether any joint has a finite limit of this name."""
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
        from trajopt.core import problem_file  # which makes problems

        return problem_file.read(Path(path))

    def to_toml(self) -> str:
        """The problem file, in radians; reading it back gives the same digest."""
        from trajopt.core import problem_file  # which makes problems

        return problem_file.text(self)

    def _check_waypoints(self) -> None:
        if not _differing(self.waypoints)[1:].any():
            raise InvalidInput("waypoints", "at least two different ones; these never move")
        lows, highs = self.limits.position.T
        outside = (self.waypoints < lows) | (self.waypoints > highs)
        for row, joint in np.argwhere(outside):
            low = lows[joint]
            high = highs[joint]
            range_ = f"[{low:.9g}, {high:.9g}] {self.unit(joint)}"
            right = f"a value inside limits.position {range_}"
            raise InvalidInput(
                f"waypoints, waypoint {row + 1}",
                right,
                value=float(self.waypoints[row, joint]),
                joint=int(joint),
            )


def check_problem(value: object) -> Problem:
    """Return a problem as it is; raise `WrongType`, which says how one is made, for the rest."""
    if isinstance(value, Problem):
        return value
    raise WrongType(
        f"expected a trajopt.Problem, got {shown(value)}: make one with "
        "Problem(waypoints, Limits(velocity, acceleration)) or Problem.from_toml(file)"
    )


def _pairs(name: str, value: Any) -> Array:
    """One `[low, high]` pair per joint, from numbers (symmetric) or pairs."""
    if _is_table(value) and value.shape[1] == 2:
        return value
    key = f"limits.{name}"
    if not _is_list(value) or len(value) == 0:
        raise InvalidInput(
            key, "a list with a number, or a pair [low, high], for every joint", value=value
        )
    pairs = []
    for joint, item in enumerate(value):
        pair = item if _is_list(item) else (item, item)
        if len(pair) != 2 or not all(map(_is_bound, pair)):
            raise InvalidInput(key, "a number or a [low, high] pair", value=item, joint=joint)
        low, high = map(float, pair)
        pairs.append((low if pair is item else -high, high))
    return np.array(pairs)


def _check_signs(name: str, pairs: Array) -> None:
    """Refuse infinite velocities and accelerations, rates without rest, unordered positions."""
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
        value: Any = pairs[joint].tolist()
        if name != "position" and low[joint] == -high[joint]:
            value = float(high[joint])
        raise InvalidInput(f"limits.{name}", expected, value=value, joint=int(joint))


def waypoint_table(rows: Any) -> Array:
    """Waypoints as a table; errors name the waypoint and the joint, counted from 1.

    Raises:
        InvalidInput: Fewer than two rows, rows of different lengths, a value that is not finite.
    """
    if _is_table(rows) and len(rows) > 1 and np.isfinite(rows).all():
        return rows
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
            if not is_number(item):
                raise InvalidInput(key, "a finite number", value=item, joint=joint)
    return np.array(rows, dtype=float)


def check_joint_names(names: Sequence[Any], joints: int) -> None:
    """Refuse names that are not one printable text per joint, or not unique.

    Raises:
        InvalidInput: Names the joint and the value.
    """
    if len(names) != joints:
        right = f"{joints} names, one per joint"
        raise InvalidInput("joint_names", right, value=list(names))
    seen = set()
    for joint, name in enumerate(names):
        if not isinstance(name, str) or not name.isprintable() or not name.strip():
            raise InvalidInput("joint_names", "a name", value=name, joint=joint)
        if name in seen:
            raise InvalidInput("joint_names", "names that differ", value=name, joint=joint)
        seen.add(name)


def _check_joint_units(units: Sequence[str], joints: int) -> None:
    if len(units) not in (0, joints):
        right = f"{joints} units, one per joint of the waypoints"
        raise InvalidInput("units", right, value=list(units))
    for joint, unit in enumerate(units):
        if unit not in ("rad", "m"):
            raise InvalidInput("joint_units", '"rad" or "m"', value=unit, joint=joint)


def _rounding(waypoints: Array) -> Array:
    largest = np.abs(waypoints).max(axis=0)
    return COORDINATE_RTOL * largest


def _differing(waypoints: Array) -> Bools:
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


def _is_table(value: Any) -> TypeGuard[Array]:
    """Return whether this is a table of floats, whose items need no check of their types."""
    if not isinstance(value, np.ndarray) or value.dtype != float:
        return False
    return value.ndim == 2 and value.size > 0


def _is_list(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _is_bound(value: Any) -> bool:
    """Return whether this is a number, or infinite."""
    return is_number(value) or (isinstance(value, float) and math.isinf(value))


def frozen(values: ArrayLike) -> Array:
    """Return a read-only copy."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
