"""All limits of a problem."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.beside_resting import BesideResting
from trajopt.core.limits.joint_limit import UNLIMITED, Velocity, pairs_of
from trajopt.core.limits.limit import KINDS, Limit, Use, named
from trajopt.core.trajectory import Trajectory

if TYPE_CHECKING:
    from trajopt.core.chain import LinkChain

LimitName = Literal["velocity", "acceleration", "jerk", "position"]
LIMIT_ORDERS: dict[LimitName, int] = {"velocity": 1, "acceleration": 2, "jerk": 3, "position": 0}
"""Which derivative of position each limit bounds."""
LIMIT_NAMES: tuple[LimitName, ...] = tuple(LIMIT_ORDERS)


@dataclass(frozen=True, eq=False)
class Limits:
    """All limits of a robot's motion: intervals of each joint, and limits of any other kind.

    The first four are `(joints, 2)` arrays of `[low, high]`. Each is given as one number per joint
    (symmetric: `[-x, x]`), or a `[low, high]` pair, or a mixture. Velocity, acceleration and jerk
    may be `(segments, joints, 2)`: each segment its own, between two waypoints (other kinds by
    `in_segments`). Units: rad/s, rad/s², rad/s³, rad (metres for a prismatic joint). Velocity and
    acceleration are finite; `jerk` and `position` default to none (infinite), and may be infinite
    for some joints only.

    `others` has limits of other kinds by their keys (`trajopt.core.limits.KINDS`); they may also be
    given by name, as objects or as a problem file has them.

    Limits are equal if all their numbers are.

    Raises `InvalidInput` naming the key, joint and value.
    """

    velocity: Array
    acceleration: Array
    jerk: Array
    position: Array
    others: Mapping[str, Limit]
    _held: ClassVar[Mapping[str, Limit]]  # every limit, also those that bound no joint

    def __init__(
        self,
        velocity: ArrayLike | Sequence[Any] | Limit | None = None,
        acceleration: ArrayLike | Sequence[Any] | Limit | None = None,
        jerk: ArrayLike | Sequence[Any] | Limit | None = None,
        position: ArrayLike | Sequence[Any] | Limit | None = None,
        others: Any = MappingProxyType({}),
        **by_key: Any,
    ) -> None:
        for key in by_key:
            named(key)  # says what another tool's name is called here
        if velocity is None or acceleration is None:
            key = "velocity" if velocity is None else "acceleration"
            raise InvalidInput(f"limits.{key}", "this limit; it is missing")
        if not isinstance(velocity, Limit):
            velocity = Velocity(pairs_of("velocity", velocity))
        joints = len(velocity.bounds)
        unlimited = np.tile(UNLIMITED, (joints, 1))
        given = {
            "velocity": velocity,
            "acceleration": acceleration,
            "jerk": unlimited if jerk is None else jerk,
            "position": unlimited if position is None else position,
            **others,
            **by_key,
        }
        read = {}
        for key, value in given.items():
            limit = value if isinstance(value, Limit) else named(key).read(value, joints)
            if len(limit.bounds) != joints:
                right = f"limits of {joints} joints, as velocity has"
                raise InvalidInput(f"limits.{key}", right, value=len(limit.bounds))
            read[key] = limit
        _check_segments(read)
        for name in LIMIT_NAMES:
            self.__dict__[name] = read[name].numbers
        others = {key: limit for key, limit in read.items() if key not in LIMIT_NAMES}
        self.__dict__["others"] = {
            key: limit for key, limit in others.items() if limit.bounds.any()
        }
        self.__dict__["_held"] = {key: read[key] for key in KINDS if key in read}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Limits):
            return NotImplemented
        if self.kinds.keys() != other.kinds.keys():
            return False
        pairs = zip(self.kinds.values(), other.kinds.values(), strict=True)
        return all(np.array_equal(a.numbers, b.numbers, equal_nan=True) for a, b in pairs)

    def __hash__(self) -> int:
        return hash(self.velocity.tobytes())

    @property
    def joints(self) -> int:
        return int(self.velocity.shape[-2])

    @property
    def segments(self) -> int | None:
        """Return the number of segments; None where every limit is the same in all segments."""
        return next((limit.segments for limit in self._held.values() if limit.segments), None)

    @property
    def changes(self) -> Bools:
        """Return at which inner waypoints a limit changes, `(segments - 1,)`.

        It is a single False where limits are the same in all segments.
        """
        found = np.zeros((self.segments or 2) - 1, dtype=bool)
        for limit in self._held.values():
            if limit.segments is not None:
                rows = limit.numbers.reshape(limit.segments, -1)
                found |= [
                    not np.array_equal(*both, equal_nan=True) for both in itertools.pairwise(rows)
                ]
        return found

    def in_segments(self, key: str, stated: Mapping[int, Limit], segments: int) -> Limits:
        """Return the limits, where some segments have their own of one kind.

        Args:
            key: The kind's.
            stated: The limits of these segments, by index.
            segments: The number of all segments.

        Raises:
            InvalidInput: Each segment has its own already.
        """
        usual = self._held.get(key)
        if usual is not None and usual.segments is not None:
            right = "the same in all segments, beside [[limits.segment]]"
            raise InvalidInput(f"limits.{key}", right, value=f"{usual.segments} segments")
        each = [stated.get(segment, usual) for segment in range(segments)]
        return self.with_limit(named(key).of_each(each))

    def of_segments(self, numbers: Indices) -> Limits:
        """Return the limits of some segments, by index."""
        return (
            self if self.segments is None else self._each(lambda limit: limit.of_segments(numbers))
        )

    def in_all_segments(self, *, tightest: bool = True) -> Limits:
        """Return limits for all segments together: the tightest, or the widest, of each."""
        if self.segments is None:
            return self
        return self._each(lambda limit: limit.in_all_segments(tightest=tightest))

    @cached_property
    def kinds(self) -> Mapping[str, Limit]:
        """The limits that bound at least one joint, by key."""
        return {key: limit for key, limit in self._held.items() if limit.bounds.any()}

    @property
    def beyond_rates(self) -> list[str]:
        """Return the keys of all limits but those of velocity, acceleration and jerk."""
        return [key for key in self.kinds if not LIMIT_ORDERS.get(key)]  # type: ignore[call-overload]

    @cached_property
    def smooth(self) -> Indices:
        """The highest derivative of each joint that must be continuous, `(joints,)`."""
        highest = np.zeros(self.joints, dtype=np.intp)
        for limit in self.kinds.values():
            highest = np.where(limit.bounds, np.maximum(highest, limit.smooth), highest)
        return highest

    def worst(self, key: str, motion: Trajectory) -> Use:
        """Return the exact worst use of one limit by a motion, rounded towards more use.

        The limits of segments that take no time count too, for what does not jump there: velocity,
        and acceleration of joints with a jerk limit.
        """
        limit = self.kinds[key]
        found, passed = limit.worst(motion), limit.at_instants(motion, self.smooth)
        return max(found, passed or found, key=lambda use: use.value)

    @property
    def jerk_limited(self) -> Bools:
        """Return which joints have a jerk limit, on at least one side, `(joints,)`."""
        return self._held["jerk"].bounds

    @property
    def coupled(self) -> bool:
        """Return whether a limit depends on several joints together."""
        alone = self.only([0])._held
        return self.joints > 1 and any(key not in alone for key in self.kinds)

    def without(self, *keys: str) -> Limits:
        """Return these limits without the named ones: any but velocity and acceleration."""
        return Limits(**{key: limit for key, limit in self._held.items() if key not in keys})

    def only(self, joints: ArrayLike, rest: Array | None = None) -> Limits:
        """Return the limits of some joints, by index (from 0) or mask.

        A limit that also depends on other joints needs their places, `rest`, rad, `(joints,)`, if
        they rest there. Without these it is left out.
        """
        chosen = np.arange(self.joints)[np.asarray(joints)]
        moving = np.isin(np.arange(self.joints), chosen)

        def part(limit: Limit) -> Limit | None:
            found = limit.only(chosen)
            if found is None and rest is not None and limit.has_rows():
                return BesideResting(limit, moving, rest)
            return found

        return self._each(part)

    def converted(self, sizes: Array) -> Limits:
        """Return the limits in rad (or m), whose lengths were written in units of these sizes.

        `sizes` has one of each joint, `(joints,)`.
        """
        if (sizes == 1.0).all():
            return self
        return self._each(lambda limit: limit.converted(sizes))

    def in_units(self, time: float, lengths: Array | float) -> Limits:
        """Return the limits with times in units of `time`, s, and positions in `lengths`, rad.

        `lengths` is one number for all joints, or `(joints, 1)`.
        """
        return self._each(lambda limit: limit.in_units(time, lengths))

    def widened(self, key: str, joint: int | None, by: float, segment: int | None = None) -> Limits:
        """Return the limits, one of them wider by the fraction `by` for one joint.

        `segment` widens it in one segment only, by index, where segments differ.
        """
        limit = self._held[key]
        part = () if limit.segments is None else (segment,)
        return self.with_limit(limit.widened(joint, by, *part))

    def for_chain(self, chain: LinkChain | None) -> Limits:
        """Return the limits of an arm with these link frames.

        Raises:
            InvalidInput: A limit needs link frames, and there are none.
        """
        made = [limit.for_chain(chain) for limit in self._held.values()]
        same = all(limit is before for limit, before in zip(made, self._held.values(), strict=True))
        return self if same else Limits(**{limit.key: limit for limit in made})

    def with_limit(self, limit: Limit) -> Limits:
        """Return the limits with one added, or replaced where there is one of its kind."""
        return Limits(**{**self._held, limit.key: limit})

    def by_name(self) -> dict[str, Array]:
        """Return velocity, acceleration, jerk and position limits, by name.

        `(joints, 2)` each, `(segments, joints, 2)` where segments differ.
        """
        return {name: getattr(self, name) for name in LIMIT_NAMES}

    def _each(self, change: Callable[[Limit], Limit | None]) -> Limits:
        changed = {key: change(limit) for key, limit in self._held.items()}
        return Limits(**{key: limit for key, limit in changed.items() if limit is not None})


def _check_segments(kinds: Mapping[str, Limit]) -> None:
    """Refuse limits with different numbers of segments."""
    counts = {key: limit.segments for key, limit in kinds.items() if limit.segments is not None}
    for key, count in counts.items():
        first, expected = next(iter(counts.items()))
        if count != expected:
            raise InvalidInput(f"limits.{key}", f"{expected} segments, as {first} has", value=count)
