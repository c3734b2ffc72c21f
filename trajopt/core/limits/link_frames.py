"""Limits that depend on where an arm's links are: the link frames among their numbers.

What is limited is the first column; each segment may have its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.fields import Quantity
from trajopt.core.limits.joint_limit import of_one_segment
from trajopt.core.limits.row_limit import RowLimit
from trajopt.core.tables import is_list

FRAMES = (
    Quantity("origins", count=12),
    Quantity("axes", count=3),
    Quantity("slides"),
)
"""The frames of `LinkChain`: the upper three rows of each pose; 1 where a joint slides, else 0."""
_RIGID_ATOL = 1e-6


def frame_columns(chain: LinkChain) -> Array:
    """Return the numbers of `FRAMES`, `(joints, 16)`."""
    origins = chain.origins[:, :3].reshape(chain.joints, 12)
    return np.column_stack([origins, chain.axes, chain.slides])


@dataclass(frozen=True, eq=False)
class FramesLimit(RowLimit):
    """A limit with `FRAMES` among its fields; these are NaN until it has an arm's (`for_chain`).

    Its numbers are `(joints, columns)`, or `(segments, joints, columns)` where segments differ in
    the first column, in which NaN is no limit. The others are the same in all segments.
    """

    by_segment = True

    def __post_init__(self) -> None:
        if self.numbers.ndim == 3:
            first = self.numbers[0]
            if not all(np.array_equal(own[:, 1:], first[:, 1:], True) for own in self.numbers):
                raise InvalidInput(f"limits.{self.key}", "the same frames in all segments")
            if all(np.array_equal(own, first, True) for own in self.numbers):
                object.__setattr__(self, "numbers", first)
        super().__post_init__()
        if self.is_complete:
            turns = self.origins[:, :3, :3]
            apart = np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
            self.refuse("origins", "a pose, whose first three columns turn", apart > _RIGID_ATOL)
            sizes = np.linalg.norm(self.column("axes"), axis=1)
            self.refuse("axes", "a direction of length 1", np.abs(sizes - 1) > _RIGID_ATOL)

    @classmethod
    def of_numbers(cls, numbers: Array) -> Self:
        if numbers.ndim != 3 or not len(numbers):
            return super().of_numbers(numbers)
        return cls(np.array([super(FramesLimit, cls).of_numbers(own).numbers for own in numbers]))

    @classmethod
    def read(cls, value: Any, joints: int) -> Self:
        """Return the limit of a value (`read_one`), or of a list with that of each segment."""
        if not cls.is_of_each(value):
            return cls.read_one(value, joints)
        return cls.of_each([cls.read_segment(k, own, joints) for k, own in enumerate(value)])

    @classmethod
    def read_one(cls, value: Any, joints: int) -> Self:
        """Return the limit of a value that is the same in all segments; by default a table."""
        return super().read(value, joints)

    @classmethod
    def is_of_each(cls, value: Any) -> bool:
        """Return whether a value is a list with that of each segment."""
        return is_list(value) and len(value) > 0

    @classmethod
    def read_segment(cls, segment: int, value: Any, joints: int) -> Self:
        with of_one_segment(segment):
            if isinstance(value, Mapping):
                right = "its limit alone: the link frames are those under [limits]"
                raise InvalidInput(f"limits.{cls.key}", right, value=value)
            return cls.read_one(value, joints)

    @classmethod
    def of_each(cls, each: Sequence[Self | None]) -> Self:
        given = [own.numbers for own in each if own is not None]
        frames = next((own[:, 1:] for own in given if np.isfinite(own[:, 1:]).all()), np.nan)
        numbers = np.full((len(each), *given[0].shape), np.nan)
        numbers[..., 1:] = frames
        for own, limit in zip(numbers, each, strict=True):
            own[:, 0] = np.nan if limit is None else limit.numbers[:, 0]
        return cls(numbers)

    @property
    def segments(self) -> int | None:
        return len(self.numbers) if self.numbers.ndim == 3 else None

    @property
    def usual(self) -> Self:
        """The limit of most segments that have one; the first of these where it is a tie."""
        if self.segments is None:
            return self
        each = np.nan_to_num(self.numbers[..., 0], nan=np.inf)
        same = (each[:, None] == each).all(axis=2).sum(axis=1)
        same[np.isinf(each).all(axis=1)] = 0
        return type(self)(self.numbers[same.argmax()])

    def of_segment(self, segment: int) -> Any:
        if self.segments is None:
            return None
        each, usual = self.numbers[segment, :, 0], self.usual.numbers[:, 0]
        return None if np.array_equal(each, usual, True) else self.stated(each)

    def table(self) -> Any:
        if self.segments is not None:
            return self.usual.table()
        limited = self.stated(self.numbers[:, 0])
        if not self.is_complete:
            return limited
        begin, found = 0, {}
        for field in self.fields:
            found[field.name] = field.written(self.numbers[:, begin : begin + field.columns])
            begin += field.columns
        return {**found, self.fields[0].name: limited}

    def converted(self, sizes: Array) -> Self:
        return self  # its lengths are metres

    def stated(self, column: Array) -> Any:
        """Return its first column, `(joints,)`, as a file states it."""
        raise NotImplementedError

    def of_segments(self, numbers: Indices) -> Self:
        return self if self.segments is None else type(self)(self.numbers[numbers])

    def in_all_segments(self, *, tightest: bool) -> Self:
        if self.segments is None:
            return self
        each = np.nan_to_num(self.numbers[..., 0], nan=np.inf)
        numbers = self.numbers[0].copy()
        numbers[:, 0] = each.min(axis=0) if tightest else each.max(axis=0)
        numbers[np.isinf(numbers[:, 0]), 0] = np.nan
        return type(self)(numbers)

    def widened(self, joint: int | None, by: float, segment: int | None = None) -> Self:
        numbers = self.numbers.copy()
        own = numbers if segment is None or self.segments is None else numbers[segment]
        chosen = slice(None) if joint is None or self.fields[0].common else joint
        own[..., chosen, 0] *= 1 + by
        return type(self)(numbers)

    @property
    def bounds(self) -> Bools:
        finite = np.isfinite(self.numbers[..., 0])
        return np.asarray(finite if finite.ndim == 1 else finite.any(axis=0))

    def column(self, name: str) -> Array:
        """Return the numbers of a field, as `FieldsLimit`; where segments differ, of each first."""
        found = super().column(name)
        return found if self.segments is None or name == self.fields[0].name else found[0]

    def within(self, joint: int, segments: Indices) -> tuple[float, Any]:
        """Return a joint's tightest limit, and how many times as wide it is in given segments."""
        each = self.numbers[..., joint, 0]
        least = float(np.nanmin(each))
        if self.segments is None:
            return least, 1.0
        return least, np.nan_to_num(each / least, nan=np.inf)[segments]

    @property
    def is_complete(self) -> bool:
        """Return whether it has link frames."""
        return bool(np.isfinite(self.numbers[..., 1:]).all())

    @property
    def origins(self) -> Array:
        """The poses of the joints' frames, `(joints, 4, 4)`."""
        last = np.tile([[0.0, 0.0, 0.0, 1.0]], (len(self.bounds), 1, 1))
        return np.concatenate([self.column("origins").reshape(-1, 3, 4), last], axis=1)

    def refuse(self, column: str, right: str, wrong: Bools) -> None:
        """Raise `InvalidInput` that names the first joint whose numbers of a field are wrong."""
        for joint in np.flatnonzero(wrong).tolist():
            value = self.column(column)[joint].tolist()
            raise InvalidInput(f"limits.{self.key}.{column}", right, value=value, joint=joint)
