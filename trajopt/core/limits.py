"""Limits of each joint: velocity, acceleration, jerk, position, and the falling velocity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array, Bools
from trajopt.core.exceptions import InvalidInput
from trajopt.core.numerals import is_number
from trajopt.core.tables import frozen, is_list, is_table

LimitName = Literal["velocity", "acceleration", "jerk", "position"]
LIMIT_ORDERS: dict[LimitName, int] = {"velocity": 1, "acceleration": 2, "jerk": 3, "position": 0}
"""Which derivative of position each limit bounds."""
LIMIT_NAMES: tuple[LimitName, ...] = tuple(LIMIT_ORDERS)


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


def _pairs(name: str, value: Any) -> Array:
    """One `[low, high]` pair per joint, from numbers (symmetric) or pairs."""
    if is_table(value) and value.shape[1] == 2:
        return value
    key = f"limits.{name}"
    if not is_list(value) or len(value) == 0:
        raise InvalidInput(
            key, "a list with a number, or a pair [low, high], for every joint", value=value
        )
    pairs = []
    for joint, item in enumerate(value):
        pair = item if is_list(item) else (item, item)
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


def _is_bound(value: Any) -> bool:
    """Return whether this is a number, or infinite."""
    return is_number(value) or (isinstance(value, float) and math.isinf(value))
