"""Limits of each joint by itself: an interval for its position or one of its derivatives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import peaks
from trajopt.core.limits.limit import Interval, Limit, Use, where
from trajopt.core.numerals import is_number
from trajopt.core.tables import frozen, is_list, is_table
from trajopt.core.trajectory import Trajectory

if TYPE_CHECKING:
    from trajopt.core.problem import Problem

UNLIMITED = np.array([-np.inf, np.inf])


@dataclass(frozen=True, eq=False)
class JointLimit(Limit):
    """An interval `[low, high]` for one derivative of each joint, the same all the time.

    Attributes:
        order: of the derivative.
        pairs: rad/s^order (m/s^order for a prismatic joint), `(joints, 2)`.
    """

    order: ClassVar[int]
    finite: ClassVar[bool] = False
    forgiven = True

    pairs: Array

    def __post_init__(self) -> None:
        self._check()
        object.__setattr__(self, "pairs", frozen(self.pairs))

    @property
    def numbers(self) -> Array:
        return self.pairs

    @classmethod
    def of_numbers(cls, numbers: Array) -> Self:
        return cls(np.where(np.isnan(numbers), UNLIMITED, numbers))

    @classmethod
    def read(cls, value: Any, joints: int) -> Self:
        """From a number per joint (symmetric: `[-x, x]`), or a `[low, high]` pair, or a mixture."""
        pairs = pairs_of(cls.key, value)
        if len(pairs) != joints:
            expected = f"{joints} values, one per joint"
            raise InvalidInput(f"limits.{cls.key}", expected, value=len(pairs))
        return cls(pairs)

    def table(self) -> Any:
        return [high if low == -high else [low, high] for low, high in self.pairs.tolist()]

    @property
    def bounds(self) -> Bools:
        finite = np.isfinite(self.pairs)
        return np.any(finite, axis=1)

    def only(self, joints: Array) -> Self:
        return type(self)(self.pairs[joints])

    def scaled(self, factors: Array) -> Self:
        return type(self)(factors[..., None] * self.pairs)

    def in_units(self, time: float, lengths: Array | float) -> Self:
        if self.order == 0:
            return type(self)(self.pairs / lengths)
        rate = time / lengths
        return type(self)(self.pairs * rate * time ** (self.order - 1))

    def widened(self, joint: int | None, by: float) -> Self:
        pairs = self.pairs.copy()
        pairs[joint] += by * (pairs - self._zero)[joint]
        return type(self)(pairs)

    def worst(self, motion: Trajectory) -> Use:
        return peaks.peak(motion, self.order, self.pairs, peaks.ratio)

    def active(self, motion: Trajectory, share: float) -> Iterator[Interval]:
        """A side's use is `(p − zero)/(full − zero)`: 0 at `zero` and 1 at `full`."""
        full = self.pairs.T
        zero = self._zero.T
        span = full - zero
        limited = np.isfinite(span)[:, None]
        # Polynomials (degree + 1, side, piece, joint), positive where the limit is active.
        unit = motion.pieces(self.order)[:, None]
        over = np.repeat(unit, 2, axis=1)
        over[-1] -= np.where(limited, zero[:, None], 0.0)
        over /= np.where(limited, span[:, None], 1.0)
        over[-1] -= share
        over = np.where(limited, over, -1.0)
        begins, ends, (_, piece, joint) = polynomials.positive_intervals(over)
        at = motion.breaks[piece]
        length = motion.lengths[piece]
        found = zip(joint.tolist(), at + begins * length, at + ends * length, strict=True)
        for one, start, end in found:
            yield Interval(one, float(start), float(end))

    def along(self, motion: Trajectory, times: Array) -> Mapping[int | None, Array]:
        """For a joint with both limits; of a position, its place in the range."""
        values = motion(times, self.order)
        found: dict[int | None, Array] = {}
        both_finite = np.isfinite(self.pairs).all(axis=1)
        for joint in np.flatnonzero(both_finite).tolist():
            low, high = self.pairs[joint]
            zero = self._zero[joint]
            down = (values[:, joint] - zero[0]) / (low - zero[0])
            up = (values[:, joint] - zero[1]) / (high - zero[1])
            found[joint] = np.maximum(up, down)
        return found

    def unit(self, problem: Problem) -> str:
        return problem.shared_unit(self.order)

    def of_joint(self, joint: int, problem: Problem) -> str:
        if not self.bounds[joint]:
            return "–"
        low, high = self.pairs[joint]
        ends = [f"{end:.6g}" if np.isfinite(end) else "–" for end in (low, high)]
        span = f"± {ends[1]}" if low == -high else " … ".join(ends)
        return f"{span} {problem.unit(joint, self.order)}"

    @property
    def _zero(self) -> Array:
        """The values that use nothing of the low and of the high limit, `(joints, 2)`."""
        return np.zeros_like(self.pairs)

    def _check(self) -> None:
        """Refuse infinite limits where these must be finite, and limits without rest."""
        low, high = self.pairs.T
        right = (low < 0) & (high > 0)
        expected = "a positive number, or low < 0 < high"
        if self.finite:
            right &= np.isfinite(low) & np.isfinite(high)
            expected += ", finite"
        for joint in np.flatnonzero(~right):
            value: Any = self.pairs[joint].tolist()
            if low[joint] == -high[joint]:
                value = float(high[joint])
            raise InvalidInput(f"limits.{self.key}", expected, value=value, joint=int(joint))


class Velocity(JointLimit):
    """Velocity limits, rad/s."""

    key = "velocity"
    short = "vel."
    order = degree = 1
    finite = True


class Acceleration(JointLimit):
    """Acceleration limits, rad/s²: velocity does not jump."""

    key = "acceleration"
    short = "acc."
    order = degree = 2
    smooth = 1
    finite = True


class Jerk(JointLimit):
    """Jerk limits, rad/s³: acceleration does not jump."""

    key = "jerk"
    order = degree = 3
    smooth = 2


class Position(JointLimit):
    """Position limits, rad: a repair keeps them, no dilation changes what is beyond."""

    key = "position"
    order = 0
    degree = None
    is_ratio = False

    @property
    def _zero(self) -> Array:
        return self.pairs[:, ::-1]

    def worst(self, motion: Trajectory) -> Use:
        return peaks.peak(motion, self.order, self.pairs, peaks.excess)

    @classmethod
    def amount(cls, use: Use, problem: Problem) -> str:
        joint = use.joint or 0
        excess = use.value if abs(use.value) > problem.rounding[joint] else 0.0
        side = "beyond" if excess > 0 else "margin"
        return f"{abs(excess):.3g} {problem.unit(joint)} {side}"

    def flaw(self, use: Use, tolerated: Array, problem: Problem) -> str | None:
        joint = use.joint or 0
        if not use.value > tolerated[joint]:
            return None
        unit = problem.unit(joint)
        return f"{where(use, problem)}: leaves its position limits by {use.value:.3g} {unit}"

    def _check(self) -> None:
        low, high = self.pairs.T
        for joint in np.flatnonzero(~(low < high)):
            value = self.pairs[joint].tolist()
            raise InvalidInput("limits.position", "low < high", value=value, joint=int(joint))


def pairs_of(key: str, value: Any) -> Array:
    """One `[low, high]` pair per joint, from numbers (symmetric) or pairs.

    Raises:
        InvalidInput: Names the key, the joint, the value, and what would be right.
    """
    if is_table(value) and value.shape[1] == 2:
        return value
    key = f"limits.{key}"
    if not is_list(value) or len(value) == 0:
        raise InvalidInput(
            key, "a list with a number, or a pair [low, high], for every joint", value=value
        )
    pairs = []
    for joint, item in enumerate(value):
        pair = item if is_list(item) else (item, item)
        if len(pair) != 2 or not all(map(is_bound, pair)):
            raise InvalidInput(key, "a number or a [low, high] pair", value=item, joint=joint)
        low, high = map(float, pair)
        pairs.append((low if pair is item else -high, high))
    return np.array(pairs)


def is_bound(value: Any) -> bool:
    """Return whether this is a number, or infinite."""
    return is_number(value) or (isinstance(value, float) and math.isinf(value))
