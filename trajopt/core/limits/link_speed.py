"""A limit on the speed of named links of an arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.chain import LinkChain, LinkPoint
from trajopt.core.exceptions import InvalidInput
from trajopt.core.files import check_keys
from trajopt.core.limits.fields import Quantity
from trajopt.core.limits.joint_limit import of_one_segment
from trajopt.core.limits.limit import Limit
from trajopt.core.limits.link_frames import FRAMES
from trajopt.core.limits.point_speed import PointSpeed
from trajopt.core.numerals import is_number, parsed
from trajopt.core.tables import is_list

Asked = Mapping[str, tuple[float, list[float]]]
"""The speed of a point, m/s, and its place in the link's frame, m, by the link's name."""


@dataclass(frozen=True, eq=False)
class LinkSpeed(PointSpeed):
    """Speed of points of links, m/s, by the arm's link frames: one point for each joint.

    A problem file states it by the links' names: a number, of the link's origin, or a table with
    `speed` and `xyz`, a point in the link's frame, m. A link has the name that a URDF gives it, or
    that of the joint that moves it, at whose frame it begins. Where frames are not known from
    elsewhere a table has, per joint, `speed` (`inf`: none), the frames of
    `trajopt.core.chain.LinkChain` and `place`, of the point in the joint's frame, m.

    Attributes:
        asked: What a file states, of all segments or of each, until the arm is known (`for_chain`).
    """

    asked: tuple[Asked, ...] = ()

    key = "link_speed"
    short = "link"
    flag = "Limits of links' speeds, m/s, by their names: forearm_link=0.5,flange=0.25."
    flag_is_text = True
    fields = (
        Quantity("speed", metres=1, time=-1, widens=1),
        *FRAMES,
        Quantity("place", metres=1, count=3),
    )

    def __post_init__(self) -> None:
        numbers = np.array(self.numbers)
        numbers[..., 0][numbers[..., 0] == np.inf] = np.nan  # stores have one sign of no limit
        object.__setattr__(self, "numbers", numbers)
        super().__post_init__()

    @classmethod
    def is_of_each(cls, value: Any) -> bool:
        tables = is_list(value) and all(is_list(own) or isinstance(own, Mapping) for own in value)
        return super().is_of_each(value) and tables

    @classmethod
    def read_one(cls, value: Any, joints: int) -> Self:
        """Return the limit of a table by names, of a number per joint, or of a table with frames.

        A number per joint is of the origin of the link that it moves; `inf` is no limit.
        """
        key = f"limits.{cls.key}"
        if isinstance(value, str):  # on the command line
            value = _by_name(key, value)
        if isinstance(value, Mapping) and "origins" in value:
            return super().read_one(value, joints)
        numbers = np.full((joints, sum(field.columns for field in cls.fields)), np.nan)
        if isinstance(value, Mapping) and value:
            return cls(numbers, ({name: _point(key, name, own) for name, own in value.items()},))
        if not is_list(value) or len(value) != joints:
            right = f"a table of links' names and speeds, m/s, or {joints} numbers, one per joint"
            raise InvalidInput(key, right, value=value)
        for joint, own in enumerate(value):
            if not _is_speed(own):
                raise InvalidInput(key, _SPEED, value=own, joint=joint)
        numbers[:, 0] = value
        return cls(numbers)

    @classmethod
    def read_segment(cls, segment: int, value: Any, joints: int) -> Self:
        if not isinstance(value, Mapping) or "origins" in value:
            return super().read_segment(segment, value, joints)
        with of_one_segment(segment):
            return cls.read_one(value, joints)

    @classmethod
    def of_each(cls, each: Sequence[Self | None]) -> Self:
        asked = [own.asked[0] if own is not None and own.asked else {} for own in each]
        return cls(super().of_each(each).numbers, tuple(asked) if any(asked) else ())

    @property
    def segments(self) -> int | None:
        return len(self.asked) if len(self.asked) > 1 else super().segments

    @property
    def bounds(self) -> Bools:
        return np.full(len(super().bounds), True) if any(self.asked) else super().bounds

    @classmethod
    def unlimited(cls, numbers: Array) -> Bools:
        """Return whether no joint has a finite speed, for every joint."""
        return np.full(len(numbers), not np.isfinite(numbers[:, 0]).any())

    def table(self) -> Any:
        return dict(self.asked[0]) if self.asked else super().table()

    @property
    def points(self) -> list[tuple[LinkPoint, int | None]]:
        places = self.column("place")
        limited = np.flatnonzero(self.bounds).tolist()
        return [(LinkPoint(joint, places[joint]), joint) for joint in limited]

    def for_chain(self, chain: LinkChain | None) -> Limit:
        """Return the limit with an arm's link frames, if it has none yet.

        Raises:
            InvalidInput: The frames or a link are not known, or two of its points move together.
        """
        if not self.asked and (self.is_complete or not self.bounds.any()):
            return self
        joints = len(self.bounds)
        whole = self.with_frames(self.numbers, chain, np.zeros((joints, 3)))
        if len(self.asked) > 1:
            whole = np.array(np.broadcast_to(whole, (len(self.asked), *whole.shape[-2:])))
        links = {} if chain is None else chain.links
        names: dict[int, tuple[str, list[float]]] = {}
        for segment, stated in enumerate(self.asked):
            own = whole[segment] if whole.ndim == 3 else whole
            for name, (speed, place) in stated.items():
                if name not in links:
                    right = f"a link or joint of the arm: {', '.join(links)}"
                    raise InvalidInput(f"limits.{self.key}", right, value=name)
                joint, pose = links[name]
                before = names.setdefault(joint, (name, place))
                if before != (name, place):
                    right = f"one point that moves with a joint; {before[0]} does so, too"
                    raise InvalidInput(f"limits.{self.key}.{name}", right)
                own[joint, 0] = speed
                whole[..., joint, -3:] = (pose @ [*place, 1.0])[:3]
        return type(self)(whole)


_SPEED = "a positive number, m/s, or inf"


def _is_speed(value: Any) -> bool:
    return (is_number(value) and value > 0) or value == np.inf


def _point(key: str, name: str, value: Any) -> tuple[float, list[float]]:
    """Return the speed of a link's point, m/s, and the point in the link's frame, m."""
    own = f"{key}.{name}"
    if isinstance(value, Mapping):
        check_keys(f"{own}.", value, ("speed", "xyz"), ("speed",))
        speed, place = value["speed"], value.get("xyz", [0, 0, 0])
    else:
        speed, place = value, [0, 0, 0]
    if not _is_speed(speed):
        raise InvalidInput(own, f"{_SPEED}, or a table with speed and xyz", value=speed)
    if not is_list(place) or len(place) != 3 or not all(map(is_number, place)):
        raise InvalidInput(f"{own}.xyz", "three finite numbers, m", value=place)
    return float(speed), [float(x) for x in place]


def _by_name(key: str, text: str) -> dict[str, Any]:
    """Return the speeds that a text states by links' names, `forearm_link=0.5,flange=0.25`."""
    found: dict[str, Any] = {}
    for part in text.split(","):
        name, sign, number = (own.strip() for own in part.partition("="))
        if not name or not sign or name in found:
            raise InvalidInput(
                key, "links, each once, as in forearm_link=0.5,flange=0.25", value=text
            )
        found[name] = np.inf if number == "inf" else parsed(number)
        if found[name] is None:
            raise InvalidInput(f"{key}.{name}", _SPEED, value=number)
    return found
