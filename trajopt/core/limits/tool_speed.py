"""A limit on the speed of a robot's tool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.chain import LinkChain, LinkPoint
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.fields import Quantity
from trajopt.core.limits.limit import Limit
from trajopt.core.limits.link_frames import FRAMES
from trajopt.core.limits.point_speed import PointSpeed
from trajopt.core.numerals import is_number


@dataclass(frozen=True, eq=False)
class ToolSpeed(PointSpeed):
    """Speed of the tool's origin, m/s, by the arm's link frames.

    A problem file states a number where the link frames are known, or a list with that of each
    segment; else a table with the number and the frames of `trajopt.core.chain.LinkChain`:
    `origins` (upper three rows of each pose), `axes`, `slides` (1 where a joint slides, else 0),
    `tool` (place in the last joint's frame, m).
    """

    key = "tool_speed"
    short = "tool"
    flag = "Limit of the tool's speed, m/s, by the robot's link frames."
    fields = (
        Quantity("speed", metres=1, time=-1, common=True, widens=1),
        *FRAMES,
        Quantity("tool", metres=1, count=3, common=True),
    )

    @classmethod
    def read_one(cls, value: Any, joints: int) -> Self:
        """Return the limit of a number, or of a table with the link frames.

        `inf` is no limit.
        """
        if not is_number(value) and value != np.inf:
            if not isinstance(value, Mapping):
                names = ", ".join(field.name for field in cls.fields)
                right = f"a number, or a table with {names}"
                raise InvalidInput(f"limits.{cls.key}", right, value=value)
            return super().read_one(value, joints)
        columns = sum(field.columns for field in cls.fields)
        numbers = np.full((joints, columns), np.nan)
        numbers[:, 0] = value if np.isfinite(value) else np.nan
        return cls(numbers)

    @classmethod
    def unlimited(cls, numbers: Array) -> Bools:
        """Return whether the speed is infinite, for every joint."""
        return np.asarray(numbers[:, 0] == np.inf)

    def stated(self, column: Array) -> float:
        return float(np.nan_to_num(column[0], nan=np.inf))

    @property
    def points(self) -> list[tuple[LinkPoint, int | None]]:
        return [(LinkPoint(len(self.bounds) - 1, self.column("tool")[0]), None)]

    def for_chain(self, chain: LinkChain | None) -> Limit:
        """Return the limit with an arm's link frames, if it has none yet."""
        if self.is_complete or not self.bounds.any():
            return self
        tool = np.zeros(3) if chain is None else chain.tool[:3, 3]
        return type(self)(
            self.with_frames(self.numbers, chain, np.tile(tool, (len(self.bounds), 1)))
        )
