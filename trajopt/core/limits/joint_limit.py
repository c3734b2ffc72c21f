"""Limits of each joint by itself: an interval for its position or one of its derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import peaks
from trajopt.core.limits.fields import is_bound
from trajopt.core.limits.limit import Interval, Limit, Use, where
from trajopt.core.limits.rows import JointState, Row
from trajopt.core.tables import frozen, is_list, is_table
from trajopt.core.trajectory import Trajectory

if TYPE_CHECKING:
    from trajopt.core.problem import Problem

UNLIMITED = np.array([-np.inf, np.inf])


ONE_WAY = 1e-9
"""Velocity in the direction in which a joint must not move, relative to that in the other."""


@dataclass(frozen=True, eq=False)
class JointLimit(Limit):
    """An interval `[low, high]` for one derivative of each joint.

    It is the same for the whole motion, or each segment has its own. At a waypoint the limits of
    both neighbouring segments hold.

    Attributes:
        order: of the derivative.
        numbers: rad/s^order (m/s^order for a prismatic joint), `(joints, 2)`, or
            `(segments, joints, 2)` where segments differ.
    """

    order: ClassVar[int]
    finite: ClassVar[bool] = False
    forgiven = True
    separate = True
    by_segment = True

    numbers: Array

    def __post_init__(self) -> None:
        if self.pairs.ndim == 3 and (self.pairs == self.pairs[:1]).all():
            object.__setattr__(self, "numbers", self.pairs[0])
        self._check()
        object.__setattr__(self, "numbers", frozen(self.numbers))

    @property
    def pairs(self) -> Array:
        """Return its numbers."""
        return self.numbers

    @classmethod
    def of_numbers(cls, numbers: Array) -> Self:
        return cls(np.where(np.isnan(numbers), UNLIMITED, numbers))

    @classmethod
    def read(cls, value: Any, joints: int) -> Self:
        """Return the limit of a number `x` per joint, for `[-x, x]`, or a pair `[low, high]`.

        Both may be mixed. An array `(segments, joints, 2)` has the pairs of each segment.
        """
        limit = cls(pairs_of(cls.key, value))
        if len(limit.bounds) != joints:
            expected = f"{joints} values, one per joint"
            raise InvalidInput(f"limits.{cls.key}", expected, value=len(limit.bounds))
        return limit

    @classmethod
    def read_segment(cls, segment: int, value: Any, joints: int) -> Self:
        key = segment_key(cls.key, segment)
        pairs = value_pairs(key, value)
        if len(pairs) != joints:
            raise InvalidInput(key, f"{joints} values, one per joint", value=len(pairs))
        with of_one_segment(segment):
            return cls(pairs)

    @classmethod
    def of_each(cls, each: Sequence[Self | None]) -> Self:
        return cls(np.array([own.pairs for own in each if own is not None]))

    def table(self) -> Any:
        """Return the limit as `read` takes it; where segments differ, that of most segments."""
        return _written(self._usual)

    def of_segment(self, segment: int) -> Any:
        """Return a segment's limit as `read` takes it; None where it is the same as `table`."""
        if self.segments is None or np.array_equal(self.pairs[segment], self._usual):
            return None
        return _written(self.pairs[segment])

    @property
    def _usual(self) -> Array:
        """Return the pairs of most segments, `(joints, 2)`; the first ones where it is a tie."""
        if self.segments is None:
            return self.pairs
        same = (self.pairs[:, None] == self.pairs).all(axis=(2, 3))
        return self.pairs[same.sum(axis=1).argmax()]

    @property
    def segments(self) -> int | None:
        return len(self.pairs) if self.pairs.ndim == 3 else None

    def of_segments(self, numbers: Indices) -> Self:
        return self if self.segments is None else type(self)(self.pairs[numbers])

    def in_all_segments(self, *, tightest: bool) -> Self:
        if self.segments is None:
            return self
        low, high = self.pairs[..., 0], self.pairs[..., 1]
        if tightest:
            ends = [low.max(axis=0), high.min(axis=0)]
        else:
            ends = [low.min(axis=0), high.max(axis=0)]
        return type(self)(np.stack(ends, axis=-1))

    @property
    def bounds(self) -> Bools:
        finite = np.isfinite(self.pairs).any(axis=-1)
        return np.asarray(finite if finite.ndim == 1 else finite.any(axis=0))

    def only(self, joints: Array) -> Self:
        pairs = self.pairs[..., joints, :]
        if pairs.ndim == 3:  # segments may differ in other joints only
            return type(self)(pairs)
        part = object.__new__(type(self))  # what is right for all joints is right for some
        pairs.setflags(write=False)
        part.__dict__["numbers"] = pairs
        return part

    def converted(self, sizes: Array) -> Self:
        return type(self)(sizes[..., None] * self.pairs)

    def in_units(self, time: float, lengths: Array | float) -> Self:
        if self.order == 0:
            return type(self)(self.pairs / lengths)
        rate = time / lengths
        return type(self)(self.pairs * rate * time ** (self.order - 1))

    def widened(self, joint: int | None, by: float, segment: int | None = None) -> Self:
        pairs = self.pairs.copy()
        own = pairs if segment is None or pairs.ndim == 2 else pairs[segment]
        zero = self._zero if own is pairs else self._zero[segment]
        own[..., joint, :] += by * (own - zero)[..., joint, :]
        return type(self)(pairs)

    def rows(self, at: JointState) -> Iterator[Row]:
        pairs = self.pairs if self.segments is None else self.pairs[at.segments]
        for joint in np.flatnonzero(self.bounds).tolist():
            low, high = np.moveaxis(pairs[..., joint, :], -1, 0)
            yield Row(at[self.order][joint], low, high)

    def worst(self, motion: Trajectory) -> Use:
        if self.segments is not None:
            motion = motion.refined(motion.waypoint_times)
        return peaks.peak(motion, self.order, self._along(motion), peaks.ratio)

    def at_instants(self, motion: Trajectory, smooth: Indices) -> Use | None:
        joints = smooth >= self.order
        if self.segments is None or not joints.any():
            return None
        brief = brief_segments(motion, self.segments)
        if not len(brief):
            return None
        times = motion.waypoint_times[brief]
        low, high = np.moveaxis(self.pairs[brief], -1, 0)
        shares = peaks.ratio(motion(times, self.order), np.zeros_like(low), low, high)
        shares = np.where(joints, shares, 0.0)
        instant, joint = np.unravel_index(np.argmax(shares), shares.shape)
        return Use(float(shares[instant, joint]), int(joint), float(times[instant]))

    def _along(self, motion: Trajectory) -> Array:
        """Return the limits of each piece of a motion that has breaks at its waypoints.

        `(joints, 2)` where all pieces have the same, else `(pieces, joints, 2)`.
        """
        if self.segments is None:
            return self.pairs
        middles = (motion.breaks[:-1] + motion.breaks[1:]) / 2
        return self.pairs[motion.segments_at(middles)]

    def active(self, motion: Trajectory, share: float) -> Iterator[Interval]:
        """Yield the intervals where `(p − zero)/(full − zero) > share`, on either side.

        `full` is the limit, and `zero` the value whose use is 0.
        """
        if self.segments is not None:
            motion = motion.refined(motion.waypoint_times)
        pairs = self._along(motion)
        # (side, piece or 1, joint)
        full = np.moveaxis(pairs, -1, 0).reshape(2, -1, pairs.shape[-2])
        zero = np.moveaxis(self._zero_of(pairs), -1, 0).reshape(full.shape)
        span = full - zero
        limited = np.isfinite(span)
        # Polynomials (degree + 1, side, piece, joint), positive where the limit is active.
        unit = motion.pieces(self.order)[:, None]
        over = np.repeat(unit, 2, axis=1)
        over[-1] -= np.where(limited, zero, 0.0)
        over /= np.where(limited, span, 1.0)
        over[-1] -= share
        over = np.where(limited, over, -1.0)
        begins, ends, (_, piece, joint) = polynomials.positive_intervals(over)
        at = motion.breaks[piece]
        length = motion.lengths[piece]
        found = zip(joint.tolist(), at + begins * length, at + ends * length, strict=True)
        for one, start, end in found:
            yield Interval(one, float(start), float(end))

    def along(self, motion: Trajectory, times: Array) -> Mapping[int | None, Array]:
        """Return the use of joints with both limits; for a position, its place in the range."""
        values = motion(times, self.order)
        found: dict[int | None, Array] = {}
        pairs = self.pairs if self.segments is None else self.pairs[motion.segments_at(times)]
        both_finite = np.isfinite(pairs).all(axis=-1)
        for joint in np.flatnonzero(both_finite.reshape(-1, len(self.bounds)).all(axis=0)).tolist():
            low, high = pairs[..., joint, :].T
            zero = self._zero_of(pairs)[..., joint, :].T
            down = (values[:, joint] - zero[0]) / (low - zero[0])
            up = (values[:, joint] - zero[1]) / (high - zero[1])
            found[joint] = np.maximum(up, down)
        return found

    def unit(self, problem: Problem) -> str:
        return problem.shared_unit(self.order)

    def of_joint(self, joint: int, problem: Problem) -> str:
        if not self.bounds[joint]:
            return "–"
        every = [_span(pair) for pair in self.pairs[..., joint, :].reshape(-1, 2).tolist()]
        return f"{by_segment(every)} {problem.unit(joint, self.order)}"

    @property
    def _zero(self) -> Array:
        """Return the values whose use of the low and the high limit is 0, shaped as `pairs`."""
        return self._zero_of(self.pairs)

    def _zero_of(self, pairs: Array) -> Array:
        return np.zeros_like(pairs)

    def _check(self) -> None:
        """Refuse limits that exclude 0, and infinite ones where they must be finite."""
        low, high = self.pairs[..., 0], self.pairs[..., 1]
        right = (low < 0) & (high > 0)
        expected = "a positive number, or low < 0 < high"
        if self.finite:
            right &= np.isfinite(low) & np.isfinite(high)
            expected += ", finite"
        for *segment, joint in np.argwhere(~right).tolist():
            at = (*segment, joint)
            value: Any = self.pairs[at].tolist()
            if low[at] == -high[at]:
                value = float(high[at])
            key = segment_key(self.key, *segment)
            raise InvalidInput(key, expected, value=value, joint=joint)


class Velocity(JointLimit):
    """Velocity limits, rad/s.

    A side of 0 is of a joint that moves one way only. It becomes `ONE_WAY` of the other side: uses
    are ratios to a limit, and an optimum that never moves back stays the same.
    """

    key = "velocity"
    short = "vel."
    order = degree = 1
    finite = True

    def __post_init__(self) -> None:
        low, high = self.pairs[..., 0], self.pairs[..., 1]
        if ((low == 0) != (high == 0)).any():
            sides = (
                np.where((low == 0) & (high > 0), -ONE_WAY * high, low),
                np.where((high == 0) & (low < 0), -ONE_WAY * low, high),
            )
            object.__setattr__(self, "numbers", np.stack(sides, axis=-1))
        super().__post_init__()


class Acceleration(JointLimit):
    """Acceleration limits, rad/s²; velocity must be continuous."""

    key = "acceleration"
    short = "acc."
    order = degree = 2
    smooth = 1
    finite = True


class Jerk(JointLimit):
    """Jerk limits, rad/s³; acceleration must be continuous."""

    key = "jerk"
    order = degree = 3
    smooth = 2


class Position(JointLimit):
    """Position limits, rad. A dilation does not change an excess over them."""

    key = "position"
    by_segment = False
    order = 0
    degree = None
    is_ratio = False

    def _zero_of(self, pairs: Array) -> Array:
        return pairs[..., ::-1]

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
        if self.segments is not None:
            right = "one pair per joint: a range is the same in every segment"
            raise InvalidInput("limits.position", right, value=f"{self.segments} segments")
        low, high = self.pairs.T
        for joint in np.flatnonzero(~(low < high)):
            value = self.pairs[joint].tolist()
            raise InvalidInput("limits.position", "low < high", value=value, joint=int(joint))


def pairs_of(key: str, value: Any) -> Array:
    """Return `[low, high]` pairs, `(joints, 2)` or `(segments, joints, 2)`, of numbers or pairs.

    Raises:
        InvalidInput: Names the key, the segment, the joint, the value, and what would be right.
    """
    if is_table(value) and value.shape[1] == 2:
        return value
    if _is_by_segment(value):
        rows = [value_pairs(segment_key(key, k), own) for k, own in enumerate(value)]
        for k, row in enumerate(rows):
            if len(row) != len(rows[0]):
                right = f"{len(rows[0])} values, as segment 1 has"
                raise InvalidInput(segment_key(key, k), right, value=len(row))
        return np.array(rows)
    return value_pairs(segment_key(key), value)


def _is_by_segment(value: Any) -> bool:
    """Return whether a value is a list of segments, each a list with a pair for every joint."""
    return is_list(value) and any(
        is_list(segment) and any(map(is_list, segment)) for segment in value
    )


@contextmanager
def of_one_segment(segment: int) -> Iterator[None]:
    """Name the segment (from 0) in errors, behind their keys."""
    try:
        yield
    except InvalidInput as error:
        key = segment_key(error.key.removeprefix("limits."), segment)
        raise InvalidInput(key, error.expected, value=error.value, joint=error.joint) from None


def segment_key(key: str, segment: int | None = None) -> str:
    """Return the place of a value, for errors: the limit's key and the segment, from 1."""
    return f"limits.{key}" if segment is None else f"limits.{key}, segment {segment + 1}"


def value_pairs(key: str, value: Any) -> Array:
    """Return one `[low, high]` pair per joint; `key` is for errors."""
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


def _written(pairs: Array) -> Any:
    return [high if low == -high else [low, high] for low, high in pairs.tolist()]


def _span(pair: Sequence[float]) -> str:
    """Return an interval in words: "± 2", or its two ends."""
    low, high = pair
    ends = [f"{end:.6g}" if np.isfinite(end) else "–" for end in pair]
    return f"± {ends[1]}" if low == -high else " … ".join(ends)


def by_segment(spans: Sequence[str]) -> str:
    """Return what each segment has, in words: "± 2 (segments 1, 3), ± 1 (segment 2)"."""
    kinds = dict.fromkeys(spans)
    if len(kinds) == 1:
        return spans[0]
    numbers = {span: np.flatnonzero([other == span for other in spans]) for span in kinds}
    return ", ".join(f"{span} ({_numbers(own)})" for span, own in numbers.items())


def brief_segments(motion: Trajectory, segments: int) -> Indices:
    """Return the segments in which a motion spends no time, by index."""
    own = motion.refined(motion.waypoint_times)
    taking = own.segments_at((own.breaks[:-1] + own.breaks[1:]) / 2)
    return np.flatnonzero(~np.isin(np.arange(segments), taking))


def _numbers(segments: Indices) -> str:
    """Return segments in words, counted from 1: "segments 1, 3–5"."""
    runs = np.split(segments, np.flatnonzero(np.diff(segments) > 1) + 1)
    spans = [f"{run[0] + 1}–{run[-1] + 1}" if len(run) > 1 else f"{run[0] + 1}" for run in runs]
    return f"segment{'s' * (len(segments) > 1)} {', '.join(spans)}"
