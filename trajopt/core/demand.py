"""Demands of a route beside its waypoints, each declared once in `DEMANDS`.

A demand is, for example, a velocity at the start, a least time of a segment, or a wait. Problem
files, Python, digests, stored texts, HDF5 and messages iterate over the declarations. A new demand
is one more declaration. A demand whose form in files is not a plain array is a subclass that
overrides `read` and `table`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.numerals import is_number
from trajopt.core.tables import frozen, is_list

if TYPE_CHECKING:
    from trajopt.core.limits import Limits

Axis = Literal["waypoints", "segments", "joints"]
_EACH = {"waypoints": "waypoint", "segments": "segment", "joints": "joint"}
_PER_TIME = {0: "", -1: "/s", -2: "/s²"}


@lru_cache(maxsize=256)
def _full(shape: tuple[int, ...], value: float) -> Array:
    """Return a constant array that cannot be changed; problems of one size share it."""
    return frozen(np.full(shape, value))


@dataclass(frozen=True)
class Demand:
    """A kind of demand on a route. Its numbers are SI: rad (or m) and s.

    Attributes:
        key: Its name in problem files, Python, JSON and HDF5.
        meaning: What it demands, in words for messages and pages.
        axes: Axes of its numbers; `()` for a single number.
        length: Power of length in its unit: of rad or m, as each joint has it.
        time: Power of time in its unit.
        default: The number that demands nothing.
        example: A line of a problem file, for the UR5e and four waypoints.
        when_reversed: Key of the demand that it becomes where time runs backwards; by default its
            own.
        moves: Whether a number other than 0 means that the joint moves, also between equal
            waypoints.
        dilatable: Whether every dilation of a motion that keeps it keeps it too.
        left_out: How the problem without this demand is related to the problem. "restriction": all
            its motions keep the demand. "relaxation": some do not, and its optimum is a lower
            bound. Empty: neither, and planners must not leave it out.
        separates: Whether a number other than the default keeps two equal waypoints from being
            merged.
        splits: Whether it splits the route into parts from rest to rest, which every planner solves
            one by one (`trajopt.core.dwell`).
        whole: Whether it asks something of the whole motion, and nothing of its parts. Every
            planner solves the problem without it, and its answer is slowed down
            (`trajopt.planners.durations`).
    """

    key: str
    meaning: str
    axes: tuple[Axis, ...]
    length: int = 0
    time: int = 0
    default: float = 0.0
    example: str = ""
    when_reversed: str = ""
    moves: bool = False
    dilatable: bool = True
    left_out: Literal["", "restriction", "relaxation"] = ""
    separates: bool = False
    splits: bool = False
    whole: bool = False

    def shape(self, waypoints: int, joints: int) -> tuple[int, ...]:
        """Return the shape of the demand's numbers in a problem of these waypoints and joints."""
        sizes = {"waypoints": waypoints, "segments": waypoints - 1, "joints": joints}
        return tuple(sizes[axis] for axis in self.axes)

    def none(self, waypoints: int, joints: int) -> Array:
        """Return the numbers that demand nothing."""
        return _full(self.shape(waypoints, joints), self.default)

    # --- read and written ---

    def read(self, value: Any, waypoints: int, joints: int) -> Array:
        """Return the numbers of a value in a problem file or in Python, in an array of `shape`.

        Raises:
            InvalidInput: Names the key, the joint, the value, and what would be right.
        """
        return frozen(self._numbers(self.key, value, self.shape(waypoints, joints)))

    def table(self, numbers: Array) -> Any:
        """Return the numbers in the form that `read` takes, for TOML and JSON."""
        return numbers.tolist()

    def _numbers(self, key: str, value: Any, shape: tuple[int, ...]) -> Any:
        if not shape:
            value = value.item() if isinstance(value, np.ndarray) and not value.ndim else value
            if not self._is_right(value):
                raise InvalidInput(key, self._right, value=value)
            return value
        axis = self.axes[len(self.axes) - len(shape)]
        if not is_list(value) or len(value) != shape[0]:
            part = "number" if len(shape) == 1 else "row"
            parts = part + "s" * (shape[0] != 1)
            raise InvalidInput(key, f"{shape[0]} {parts}, one per {_EACH[axis]}", value=value)
        if len(shape) > 1:
            rows = enumerate(value, start=1)
            return [self._numbers(f"{key}, {_EACH[axis]} {i}", row, shape[1:]) for i, row in rows]
        for index, item in enumerate(value):
            if not self._is_right(item):
                joint = index if axis == "joints" else None
                own = key if axis == "joints" else f"{key}, {_EACH[axis]} {index + 1}"
                raise InvalidInput(own, self._right, value=item, joint=joint)
        return value

    _right = "a finite number"

    def _is_right(self, item: Any) -> bool:
        return is_number(item)

    def check(self, numbers: Array, demands: Mapping[str, Array], limits: Limits) -> None:
        """Raise `InvalidInput` where the numbers contradict the limits or other demands."""

    def check_way(self, numbers: Array, waypoints: Array, rounding: Array) -> None:
        """Raise `InvalidInput` where the numbers contradict the waypoints.

        Args:
            numbers: Its numbers.
            waypoints: `(waypoints, joints)`.
            rounding: Rounding of each joint's coordinates, rad, `(joints,)`.
        """

    def under(self, numbers: Array, limits: Limits) -> Array:
        """Return the numbers under fewer limits; those without effect there become the default."""
        return numbers

    # --- changes of the route ---

    def unit_size(self, lengths: Array | float = 1.0, time: float = 1.0) -> Array:
        """Return its unit in SI, from a unit of time, s, and of length, for all or each joint."""
        if not self.length:
            return np.asarray(time**self.time)
        return np.asarray(lengths, dtype=float) ** self.length * time**self.time

    def of_joints(self, numbers: Array, joints: Indices) -> Array:
        """Return the numbers of some joints, by index."""
        if "joints" not in self.axes:
            return numbers
        return np.take(numbers, joints, axis=self.axes.index("joints"))

    def at(self, numbers: Array, kept: Bools) -> Array:
        """Return the numbers for the waypoints that are kept; merged segments add theirs up."""
        if "waypoints" in self.axes:
            return np.compress(kept, numbers, axis=self.axes.index("waypoints"))
        if "segments" in self.axes:
            axis = self.axes.index("segments")
            return np.add.reduceat(numbers, np.flatnonzero(kept)[:-1], axis=axis)
        return numbers

    def part(self, numbers: Array, first: int, last: int) -> Array:
        """Return the numbers of the part between two waypoints, given by index."""
        for axis, own in enumerate(self.axes):
            if own != "joints":
                stop = last + (own == "waypoints")
                return np.take(numbers, np.arange(first, stop), axis=axis)
        return numbers

    def backwards(self, numbers: Array) -> Array:
        """Return the numbers of the demand `when_reversed`, where time runs backwards."""
        sign = -1.0 if self.length and self.time % 2 else 1.0
        along = (axis for axis, own in enumerate(self.axes) if own != "joints")
        return sign * np.flip(numbers, axis=tuple(along))

    # --- words ---

    @property
    def name(self) -> str:
        """Return the demand's name in words."""
        return self.key.replace("_", " ")

    def unit(self, length: str) -> str:
        """Return its unit in words; `length` is "rad", "m" or both."""
        if not self.length:
            return "s" if self.time else ""
        return length + _PER_TIME[self.time]

    def say(self, numbers: Array, length: str) -> str:
        """Return the demand with its numbers and unit, in words."""
        shown = ", ".join(f"{number:.6g}" for number in np.ravel(numbers))
        return " ".join(filter(None, [self.name, shown, self.unit(length)]))


class _EndAcceleration(Demand):
    """An acceleration at an end, for joints with a jerk limit: theirs may not jump."""

    def check(self, numbers: Array, demands: Mapping[str, Array], limits: Limits) -> None:
        for joint in np.flatnonzero((numbers != 0) & ~limits.jerk_limited).tolist():
            right = "0, or a jerk limit: without one the acceleration may jump at the ends"
            raise InvalidInput(self.key, right, joint=joint)  # a file may say it in degrees

    def under(self, numbers: Array, limits: Limits) -> Array:
        return np.where(limits.jerk_limited, numbers, 0.0)


class _Times(Demand):
    """Times that are not negative."""

    _right = "a time of at least 0, s"

    def _is_right(self, item: Any) -> bool:
        return is_number(item) and item >= 0


class _GivenTimes(_Times):
    """The exact time of each segment; no segment may be left out."""

    _right = "a time above 0, s"

    def check(self, numbers: Array, demands: Mapping[str, Array], limits: Limits) -> None:
        for segment in np.flatnonzero(numbers == 0).tolist():
            raise InvalidInput(f"{self.key}, segment {segment + 1}", self._right, value=0.0)
        if "least_times" in demands:
            right = "given_times or least_times, not both"
            raise InvalidInput(self.key, right, value=numbers.tolist())


class _Duration(_Times):
    """A time of the whole motion, at least or exactly; one demand says how long it takes."""

    def check(self, numbers: Array, demands: Mapping[str, Array], limits: Limits) -> None:
        for key in WHOLE_TIMES:
            if key != self.key and key in demands:
                right = f"left out beside {key}: one of both says how long the motion takes"
                raise InvalidInput(self.key, right, value=float(numbers))


class _Closed(Demand):
    """Whether the motion ends in the state in which it begins: true or false."""

    _right = "true or false"

    @property
    def name(self) -> str:
        """The demand in words: what a planner knows, or does not know."""
        return "closed motions"

    def _is_right(self, item: Any) -> bool:
        return np.ndim(item) == 0 and item in (0, 1)

    def table(self, numbers: Array) -> Any:
        return bool(numbers)

    def say(self, numbers: Array, length: str) -> str:
        return self.key

    def check(self, numbers: Array, demands: Mapping[str, Array], limits: Limits) -> None:
        others = [key for key in (*END_STATES, "dwell") if key in demands]
        if others:
            reason = "a motion that waits begins and ends at rest"
            if others[0] != "dwell":
                reason = "a closed motion begins and ends in the same state, which is free"
            raise InvalidInput(self.key, f"no {others[0]} beside it: {reason}", value=True)

    def check_way(self, numbers: Array, waypoints: Array, rounding: Array) -> None:
        apart = np.abs(waypoints[-1] - waypoints[0]) > 2 * rounding
        for joint in np.flatnonzero(apart).tolist():
            right = "the first waypoint again as the last"
            raise InvalidInput(f"{self.key}, last waypoint", right, joint=joint)


class _WaypointTolerance(Demand):
    """How far inner waypoints may be missed.

    In files: one number, one number per joint, or a row of these per waypoint.
    """

    _right = "a distance of at least 0"

    def _is_right(self, item: Any) -> bool:
        return is_number(item) and item >= 0

    def _numbers(self, key: str, value: Any, shape: tuple[int, ...]) -> Any:
        if len(shape) < len(self.axes):
            return super()._numbers(key, value, shape)
        waypoints, joints = shape
        if not is_number(value) and not is_list(value):
            right = f"a number, {joints} of them, one per joint, or {waypoints} rows"
            raise InvalidInput(key, right, value=value)
        if is_number(value):
            value = [super()._numbers(key, value, ())] * joints
        if is_list(value) and value is not None and all(map(is_number, value)):
            if len(value) != joints:
                right = f"a number, {joints} of them, one per joint, or {waypoints} rows"
                raise InvalidInput(key, right, value=value)
            row = Demand._numbers(_PerJoint, key, value, (joints,))
            value = [[0.0] * joints, *[row] * (waypoints - 2), [0.0] * joints]
        return super()._numbers(key, value, shape)

    def check(self, numbers: Array, demands: Mapping[str, Array], limits: Limits) -> None:
        waits = demands.get("dwell")
        for row in np.flatnonzero(numbers.any(axis=1)).tolist():
            if row in (0, len(numbers) - 1):
                right = "0: the motion begins and ends exactly there"
            elif waits is not None and waits[row]:
                right = "0, where the motion waits"
            else:
                continue
            value = float(numbers[row].max())
            raise InvalidInput(f"{self.key}, waypoint {row + 1}", right, value=value)

    def check_way(self, numbers: Array, waypoints: Array, rounding: Array) -> None:
        away = np.abs(waypoints - waypoints[0]) - numbers
        if (away <= rounding).all():
            right = "less than the displacements: within it no motion is needed"
            raise InvalidInput(self.key, right, value=float(numbers.max()))

    def at(self, numbers: Array, kept: Bools) -> Array:
        """Return the numbers for the waypoints that are kept: the least of those merged."""
        return np.minimum.reduceat(numbers, np.flatnonzero(kept))


class _Dwell(_Times):
    """Waits at waypoints. They split the route; no velocity is given where the motion waits."""

    def check_way(self, numbers: Array, waypoints: Array, rounding: Array) -> None:
        at = sorted({0, len(numbers) - 1, *np.flatnonzero(numbers).tolist()})
        for first, last in pairwise(at):
            if (np.abs(waypoints[first : last + 1] - waypoints[first]) <= rounding).all():
                right = (
                    f"one wait: the motion does not move from waypoint {first + 1} to {last + 1}"
                )
                raise InvalidInput(self.key, right, value=numbers.tolist())

    def check(self, numbers: Array, demands: Mapping[str, Array], limits: Limits) -> None:
        for own, key in ((numbers[0], "start"), (numbers[-1], "end")):
            if own and f"{key}_velocity" in demands:
                right = f"0 at the {'first' if key == 'start' else 'last'} waypoint, where"
                raise InvalidInput(self.key, f"{right} {key}_velocity is given", value=float(own))

    def at(self, numbers: Array, kept: Bools) -> Array:
        """Return the waits at the waypoints that are kept; those of merged ones are added."""
        return np.add.reduceat(numbers, np.flatnonzero(kept))


_PerJoint = _WaypointTolerance("tolerance", "", ("joints",))


def _at_end(key: str, other: str, example: str, time: int, meaning: str) -> Demand:
    return (Demand if time == -1 else _EndAcceleration)(
        key=key,
        meaning=meaning,
        axes=("joints",),
        length=1,
        time=time,
        example=f"{key} = {example}",
        when_reversed=other,
        moves=True,
        dilatable=False,
    )


DEMANDS: Mapping[str, Demand] = {
    demand.key: demand
    for demand in (
        _at_end(
            "start_velocity",
            "end_velocity",
            "[0.2, 0, 0, 0, 0, 0]",
            -1,
            "velocity at the first waypoint, by default at rest",
        ),
        _at_end(
            "end_velocity",
            "start_velocity",
            "[0, 0, 0, 0, 0, -0.1]",
            -1,
            "velocity at the last waypoint, by default at rest",
        ),
        _at_end(
            "start_acceleration",
            "end_acceleration",
            "[1, 0, 0, 0, 0, 0]",
            -2,
            "with jerk limits: acceleration at the first waypoint",
        ),
        _at_end(
            "end_acceleration",
            "start_acceleration",
            "[0, 0, 0, 0, 0, 1]",
            -2,
            "with jerk limits: acceleration at the last waypoint",
        ),
        _Times(
            "least_times",
            "least time of each segment",
            ("segments",),
            time=1,
            example="least_times = [0, 1.5, 0]",
            left_out="relaxation",
            separates=True,
        ),
        _GivenTimes(
            "given_times",
            "time of each segment, exactly",
            ("segments",),
            time=1,
            example="given_times = [1.5, 1.5, 1]",
            left_out="relaxation",
            dilatable=False,
            separates=True,
        ),
        _Dwell(
            "dwell",
            "time at rest at each waypoint",
            ("waypoints",),
            time=1,
            example="dwell = [0, 0.4, 0, 0]",
            left_out="relaxation",
            splits=True,
        ),
        _Duration(
            "least_duration",
            "least time of the whole motion",
            (),
            time=1,
            example="least_duration = 4",
            left_out="relaxation",
            whole=True,
        ),
        _Duration(
            "duration",
            "time of the whole motion, exactly",
            (),
            time=1,
            example="duration = 4",
            left_out="relaxation",
            dilatable=False,
            whole=True,
        ),
        _Closed(
            "closed",
            "ends as it begins, in motion",
            (),
            example="closed = true",
        ),
        _WaypointTolerance(
            "tolerance",
            "how far inner waypoints may be missed",
            ("waypoints", "joints"),
            length=1,
            example="tolerance = 0.5",
            left_out="restriction",
        ),
    )
}
"""Every demand by its key, in the order of problem files."""

WHOLE_TIMES = ("least_duration", "duration", "given_times")
"""Demands of which a problem has one at most: each says how long the whole motion takes."""
END_VELOCITIES = ("start_velocity", "end_velocity")
END_STATES = (*END_VELOCITIES, "start_acceleration", "end_acceleration")
"""The states in which the motion begins and ends."""


def names(keys: Iterable[str]) -> str:
    """Return demands in words, such as "start velocity, end velocity and tolerance"."""
    *others, last = (DEMANDS[key].name for key in keys)
    return " and ".join(filter(None, [", ".join(others), last]))
