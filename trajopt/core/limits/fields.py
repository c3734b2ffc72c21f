"""The numbers of a kind of limit, declared once: names, units, shapes and defaults.

    fields = (Quantity("links", metres=1), Quantity("power", length=2, time=-3))

From them follow a limit's form in files, its numbers, and how these change with units.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.exceptions import InvalidInput
from trajopt.core.files import check_keys
from trajopt.core.limits.limit import Limit
from trajopt.core.numerals import is_number
from trajopt.core.tables import frozen, is_list


@dataclass(frozen=True)
class Quantity:
    """Some numbers of a limit, in the unit `u^length m^metres s^time`.

    Attributes:
        name: its key in files.
        length: power of the joint's own unit `u`, rad (or m). A file may state it in degrees.
        metres: power of metres, which a file states as they are.
        time: power of seconds.
        pair: whether these are two numbers, `[low, high]`.
        count: how many numbers these are, in a list, where it is more than one.
        common: whether it is one for all joints, not one per joint.
        widens: power of `1 + by` by which it grows where the limit is wider by the fraction `by`.
            That does not follow from units.
        none: the number in files of a joint without the limit.
    """

    name: str
    length: int = 0
    metres: int = 0
    time: int = 0
    pair: bool = False
    count: int = 1
    common: bool = False
    widens: int = 0
    none: float = math.inf

    @property
    def columns(self) -> int:
        """Return how many numbers a joint has of it."""
        return 2 if self.pair else self.count

    def read(self, key: str, value: Any, joints: int) -> Array:
        """Return its numbers, `(joints, columns)`.

        Raises:
            InvalidInput: Names the key, the joint, the value, and what would be right.
        """
        right = "a pair [low, high]" if self.pair else "a number"
        if self.count > 1:
            right = f"a list of {self.count} numbers"
        if not self.common:
            right += " per joint"
            if not is_list(value) or len(value) != joints:
                raise InvalidInput(key, f"{joints} values, {right}", value=value)
        for joint, item in enumerate([value] if self.common else value):
            parts = item if self.columns > 1 and is_list(item) else [item]
            if len(parts) != self.columns or not all(map(is_bound, parts)):
                at = None if self.common else joint
                raise InvalidInput(key, right, value=item, joint=at)
        numbers = np.array(value, dtype=float)
        return np.tile(numbers, (joints, 1)) if self.common else numbers.reshape(joints, -1)

    def written(self, columns: Array) -> Any:
        """Return its numbers, `(joints, columns)`, in the form that `read` takes."""
        values = columns.tolist() if self.columns > 1 else columns[:, 0].tolist()
        return values[0] if self.common else values


@dataclass(frozen=True, eq=False)
class FieldsLimit(Limit):
    """A limit whose numbers are declared.

    Attributes:
        fields: names, units, shapes and defaults of the numbers.
        numbers: the columns of all fields, `(joints, columns)`; a row of NaN is a joint without the
            limit.
    """

    fields: ClassVar[tuple[Quantity, ...]]

    numbers: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", frozen(self.numbers))

    @classmethod
    def of_numbers(cls, numbers: Array) -> Self:
        count = sum(field.columns for field in cls.fields)
        if numbers.ndim != 2 or numbers.shape[1] != count:
            right = f"{_COUNTS.get(count, count)} number{'s' * (count > 1)} per joint"
            raise InvalidInput(f"limits.{cls.key}", right)
        return cls(numbers)

    @classmethod
    def read(cls, value: Any, joints: int) -> Self:
        """Return the limit of a table with its fields."""
        key, names = f"limits.{cls.key}", [field.name for field in cls.fields]
        if not isinstance(value, Mapping):
            raise InvalidInput(key, f"a table with {', '.join(names)}", value=value)
        check_keys(f"{key}.", value, names, names)
        columns = [
            field.read(f"{key}.{field.name}", value[field.name], joints) for field in cls.fields
        ]
        numbers = np.column_stack(columns)
        return cls(np.where(cls.unlimited(numbers)[:, None], np.nan, numbers))

    @classmethod
    def unlimited(cls, numbers: Array) -> Bools:
        """Return which joints have no such limit, by the numbers of a file: `(joints,)`."""
        return np.zeros(len(numbers), dtype=bool)

    def table(self) -> dict[str, Any]:
        none = [end for field in self.fields for end in _ends(field)]
        whole = np.where(self.bounds[:, None], self.numbers, none)
        found, begin = {}, 0
        for field in self.fields:
            found[field.name] = field.written(whole[:, begin : begin + field.columns])
            begin += field.columns
        return found

    @property
    def bounds(self) -> Bools:
        return np.asarray(np.isfinite(self.numbers).all(axis=1))

    def column(self, name: str) -> Array:
        """Return the numbers of a field, `(joints,)`, or `(joints, columns)` of several."""
        begin = 0
        for field in self.fields:
            own = self.numbers[..., begin : begin + field.columns]
            if field.name == name:
                return own if field.columns > 1 else own[..., 0]
            begin += field.columns
        raise KeyError(name)

    def only(self, joints: Array) -> Self | None:
        return type(self)(self.numbers[joints]) if self.separate else None

    def converted(self, sizes: Array) -> Self:
        return type(self)(self.numbers * sizes[:, None] ** self._powers("length"))

    def in_units(self, time: float, lengths: Array | float) -> Self:
        if not self.separate:
            return super().in_units(time, lengths)
        numbers = self.numbers * time ** -self._powers("time").astype(float)
        return type(self)(numbers / lengths ** self._powers("length"))

    def widened(self, joint: int | None, by: float, segment: int | None = None) -> Self:
        numbers = self.numbers.copy()
        own = slice(None) if joint is None or not self.separate else joint
        numbers[own] *= (1 + by) ** self._powers("widens")
        return type(self)(numbers)

    def _powers(self, attribute: str) -> Array:
        """Return an attribute of the fields, an entry for each column."""
        return np.array([getattr(field, attribute) for field in self.fields for _ in _ends(field)])


_COUNTS = {1: "one", 2: "two", 3: "three", 4: "four"}


def _ends(field: Quantity) -> list[float]:
    return [-field.none, field.none] if field.pair else [field.none] * field.count


def is_bound(value: Any) -> bool:
    """Return whether this is a number, or infinite."""
    return is_number(value) or (isinstance(value, float) and math.isinf(value))
