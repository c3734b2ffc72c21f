"""A limit of several joints, some of which rest: it depends on where they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.limit import Interval, Limit, Use
from trajopt.core.limits.rows import JointState, Row
from trajopt.core.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class BesideResting(Limit):
    """The limit of the joints that move, beside joints that stay where they are.

    Attributes:
        whole: the limit of all joints, which has rows.
        moving: which joints move, `(all joints,)`.
        place: where all joints are at the start, rad, `(all joints,)`.
    """

    whole: Limit
    moving: Bools
    place: Array

    def __post_init__(self) -> None:
        for name in ("key", "degree", "power", "is_ratio", "smooth", "forgiven", "monotone"):
            object.__setattr__(self, name, getattr(self.whole, name))
        rest = np.where(self.moving, np.nan, self.place)
        rows = self.whole.numbers.reshape(self.whole.segments or 1, -1)
        tiled = np.tile(rest, (len(rows), 1))
        object.__setattr__(self, "numbers", np.hstack([rows, tiled]))

    @classmethod
    def of_numbers(cls, numbers: Array) -> Self:
        raise NotImplementedError

    @classmethod
    def read(cls, value: Any, joints: int) -> Self:
        raise NotImplementedError

    def table(self) -> Any:
        right = "a problem of all joints: this limit depends on joints that were left out"
        raise InvalidInput(f"limits.{self.key}", right)

    @property
    def bounds(self) -> Bools:
        return self.whole.bounds[self.moving]

    @property
    def segments(self) -> int | None:
        return self.whole.segments

    def of_segments(self, numbers: Indices) -> Self:
        return type(self)(self.whole.of_segments(numbers), self.moving, self.place)

    def in_all_segments(self, *, tightest: bool) -> Self:
        whole = self.whole.in_all_segments(tightest=tightest)
        return type(self)(whole, self.moving, self.place)

    def at_instants(self, motion: Trajectory, smooth: Indices) -> Use | None:
        every = np.zeros(len(self.moving), dtype=np.intp)
        every[self.moving] = smooth
        use = self.whole.at_instants(self._beside(motion), every)
        return use and use._replace(joint=self._own(use.joint))

    def only(self, joints: Array) -> None:
        return None

    def converted(self, sizes: Array) -> Self:
        raise NotImplementedError

    def widened(self, joint: int | None, by: float, segment: int | None = None) -> Self:
        own = None if joint is None else int(np.flatnonzero(self.moving)[joint])
        return type(self)(self.whole.widened(own, by, segment), self.moving, self.place)

    def rows(self, at: JointState) -> Iterator[Row]:
        orders = []
        for order, place in zip(range(4), (self.place, *[0 * self.place] * 3), strict=True):
            every = place.tolist()
            for joint, own in zip(np.flatnonzero(self.moving), at[order], strict=True):
                every[joint] = own
            orders.append(every)
        q, v, a, j = orders
        for row in self.whole.rows(JointState(q, v, a, j, at.segments)):
            yield row._replace(joint=self._own(row.joint))

    def worst(self, motion: Trajectory) -> Use:
        use = self.whole.worst(self._beside(motion))
        return use._replace(joint=self._own(use.joint))

    def dilation(self, use: Use, motion: Trajectory) -> float:
        return self.whole.dilation(use, self._beside(motion))

    def keeps(self, use: Use, rtol: float) -> bool:
        return self.whole.keeps(use, rtol)

    def active(self, motion: Trajectory, share: float) -> Iterator[Interval]:
        for interval in self.whole.active(self._beside(motion), share):
            yield interval._replace(joint=self._own(interval.joint))

    def along(self, motion: Trajectory, times: Array) -> Mapping[int | None, Array]:
        found: dict[int | None, Array] = {}
        for joint, use in self.whole.along(self._beside(motion), times).items():
            moving = self._own(joint)
            found[moving] = np.maximum(use, found.get(moving, use))
        return found

    def _beside(self, motion: Trajectory) -> Trajectory:
        return motion.beside(self.place, self.moving)

    def _own(self, joint: int | None) -> int | None:
        """Return the number of a joint among those that move; None where it rests."""
        if joint is None or not self.moving[joint]:
            return None
        return int(np.count_nonzero(self.moving[:joint]))
