"""The problem: waypoints to pass in order, starting and ending at rest, within joint limits."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w
from numpy.typing import ArrayLike, NDArray

from trajopt.exceptions import InvalidInput

Array = NDArray[np.float64]
LimitName = Literal["velocity", "acceleration", "jerk", "position"]
LIMIT_NAMES: tuple[LimitName, ...] = ("velocity", "acceleration", "jerk", "position")
_FILE_KEYS = {"name", "source", "angle_unit", "waypoints", "limits"}


@dataclass(frozen=True, eq=False)
class Limits:
    """Bounds of each joint, as `(joints, 2)` arrays of `[low, high]`.

    Each argument is one number per joint (symmetric: `[-x, x]`), or a `[low, high]` pair, or a
    mixture. Units: rad/s, rad/s², rad/s³, rad (metres for a prismatic joint). Velocity and
    acceleration are finite; `jerk` and `position` default to none (infinite), and may be infinite
    for some joints only.

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
        given = {
            "velocity": velocity,
            "acceleration": acceleration,
            "jerk": jerk,
            "position": position,
        }
        joints = len(_pairs("velocity", velocity))
        for name, value in given.items():
            pairs = (
                np.tile([-np.inf, np.inf], (joints, 1)) if value is None else _pairs(name, value)
            )
            if len(pairs) != joints:
                raise InvalidInput(
                    f"limits.{name}", f"{joints} values, one per joint", value=len(pairs)
                )
            _check_signs(name, pairs)
            object.__setattr__(self, name, _frozen(pairs))

    @property
    def joints(self) -> int:
        return len(self.velocity)

    def without(self, *names: LimitName) -> Limits:
        """The same limits with the named ones lifted (only jerk and position can be)."""
        kept: dict[str, Any] = {n: getattr(self, n) for n in LIMIT_NAMES if n not in names}
        return Limits(**kept)


@dataclass(frozen=True, eq=False)
class Problem:
    """Pass every waypoint in order, from rest to rest, as fast as the limits allow.

    `waypoints` is `(waypoints, joints)` in radians: one row per waypoint. All joints pass a
    waypoint at the same instant. Consecutive identical waypoints are one waypoint, passed once.

    Raises `InvalidInput` where the waypoints do not fit the limits, are not finite, or do not move.
    """

    waypoints: Array
    limits: Limits
    name: str = "unnamed"
    source: str = ""

    def __init__(
        self,
        waypoints: ArrayLike | Sequence[Any],
        limits: Limits,
        name: str = "unnamed",
        source: str = "",
    ) -> None:
        fields = {"waypoints": _frozen(_table(waypoints)), "limits": limits}
        for key, value in (fields | {"name": name, "source": source}).items():
            object.__setattr__(self, key, value)
        _check_waypoints(self.waypoints, self.limits)

    @property
    def joints(self) -> int:
        return int(self.waypoints.shape[1])

    @property
    def segments(self) -> int:
        return len(self.waypoints) - 1

    @property
    def displacements(self) -> Array:
        """`h_k = q_k − q_{k−1}`, `(segments, joints)`, rad."""
        return np.diff(self.waypoints, axis=0)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Which joints move at all, `(joints,)`."""
        return np.asarray(self.displacements.any(axis=0))

    def merged(self) -> tuple[Problem, NDArray[np.intp]]:
        """This problem with consecutive identical waypoints merged, and where each one went.

        `times[index]` expands the merged problem's waypoint times to this one's.
        """
        moves = np.r_[True, self.displacements.any(axis=1)]
        return replace(self, waypoints=self.waypoints[moves]), np.cumsum(moves) - 1

    def without(self, *names: LimitName) -> Problem:
        """This problem with the named limits lifted: a relaxation of it."""
        return replace(self, limits=self.limits.without(*names))

    def has(self, name: LimitName) -> bool:
        """Whether any joint has a finite limit of this name."""
        return bool(np.isfinite(getattr(self.limits, name)).any())

    def digest(self) -> str:
        """SHA-256 of the numbers (not of the name): a changed problem has another digest."""
        arrays = [self.waypoints, *(getattr(self.limits, n) for n in LIMIT_NAMES)]
        text = b"".join(repr(a.shape).encode() + (a + 0.0).astype("<f8").tobytes() for a in arrays)
        return hashlib.sha256(text).hexdigest()

    @classmethod
    def from_toml(cls, path: str | Path) -> Problem:
        """Read a problem file; every error names the file, key, joint and value."""
        try:
            return _parsed(tomllib.loads(Path(path).read_text(encoding="utf-8")), Path(path).stem)
        except InvalidInput as error:
            raise error.in_file(str(path)) from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InvalidInput(
                "problem", "a readable TOML file", value=reason, file=str(path)
            ) from None

    def to_toml(self) -> str:
        """The problem file, in radians; reading it back gives the same digest."""
        limits = {n: getattr(self.limits, n).tolist() for n in LIMIT_NAMES if self.has(n)}
        head = {"name": self.name, "source": self.source, "angle_unit": "rad"}
        return tomli_w.dumps(head | {"waypoints": self.waypoints.tolist(), "limits": limits})


def _parsed(table: Mapping[str, Any], stem: str) -> Problem:
    _check_keys("", table, _FILE_KEYS, required={"waypoints", "limits"})
    limits = table["limits"]
    if not isinstance(limits, Mapping):
        raise InvalidInput("limits", "a table of limits", value=limits)
    _check_keys("limits.", limits, set(LIMIT_NAMES), required={"velocity", "acceleration"})
    unit = table.get("angle_unit")
    if unit not in ("deg", "rad"):
        raise InvalidInput("angle_unit", '"deg" or "rad"', value=unit)
    scale = np.pi / 180 if unit == "deg" else 1.0
    given = {name: _pairs(name, value) for name, value in limits.items()}
    for name, pairs in given.items():  # before scaling: errors show what the file says
        _check_signs(name, pairs)
    scaled = {name: pairs * scale for name, pairs in given.items()}
    for text in ("name", "source"):
        if not isinstance(table.get(text, ""), str):
            raise InvalidInput(text, "a string", value=table[text])
    return Problem(
        _table(table["waypoints"]) * scale,
        Limits(**scaled),
        table.get("name", stem),
        table.get("source", ""),
    )


def _check_keys(prefix: str, table: Mapping[str, Any], known: set[str], required: set[str]) -> None:
    for key in table:
        if key not in known:
            raise InvalidInput(
                prefix + key, f"one of the keys {', '.join(sorted(known))}", value=table[key]
            )
    for key in sorted(required):
        if key not in table:
            raise InvalidInput(prefix + key, "this key; it is missing")


def _pairs(name: str, value: Any) -> Array:
    """One `[low, high]` pair per joint, from numbers (symmetric) or pairs."""
    key = f"limits.{name}"
    if not _is_list(value) or len(value) == 0:
        raise InvalidInput(key, "one number or [low, high] pair per joint", value=value)
    pairs = []
    for joint, item in enumerate(value):
        if _is_number(item):
            pairs.append((-float(item), float(item)))
        elif _is_list(item) and len(item) == 2 and all(map(_is_number, item)):
            pairs.append((float(item[0]), float(item[1])))
        else:
            raise InvalidInput(key, "a number or a [low, high] pair", value=item, joint=joint)
    return np.array(pairs)


def _check_signs(name: str, pairs: Array) -> None:
    finite = name in ("velocity", "acceleration")
    for joint, (low, high) in enumerate(pairs):
        one = name != "position" and (low == -high or np.isnan([low, high]).all())
        value = float(high) if one else [float(low), float(high)]
        signs = low < high if name == "position" else low < 0 < high
        if not signs or (finite and not np.isfinite([low, high]).all()):
            kind = "low < high" if name == "position" else "a positive number, or low < 0 < high"
            expected = f"{kind}{', finite' if finite else ''}"
            raise InvalidInput(f"limits.{name}", expected, value=value, joint=joint)


def _table(rows: Any) -> Array:
    """Waypoints as a table; errors name the waypoint and the joint, counted from 1."""
    if not _is_list(rows) or len(rows) < 2:
        raise InvalidInput("waypoints", "at least two rows, one per waypoint", value=rows)
    for number, row in enumerate(rows, start=1):
        if not _is_list(row) or len(row) == 0:
            raise InvalidInput(
                f"waypoints, waypoint {number}", "a row of numbers, one per joint", value=row
            )
        if len(row) != len(rows[0]):
            raise InvalidInput(
                f"waypoints, waypoint {number}", f"{len(rows[0])} numbers", value=list(row)
            )
        for joint, item in enumerate(row):
            if not _is_number(item) or not np.isfinite(float(item)):
                raise InvalidInput(
                    f"waypoints, waypoint {number}", "a finite number", value=item, joint=joint
                )
    return np.array(rows, dtype=float)


def _check_waypoints(waypoints: Array, limits: Limits) -> None:
    if waypoints.shape[1] != limits.joints:
        expected = f"{waypoints.shape[1]} values, one per joint of the waypoints"
        raise InvalidInput("limits.velocity", expected, value=limits.joints)
    if not np.diff(waypoints, axis=0).any():
        raise InvalidInput("waypoints", "at least two different ones; these never move")
    low, high = limits.position.T
    for row, joint in np.argwhere((waypoints < low) | (waypoints > high))[:1]:
        inside = f"a value inside limits.position [{low[joint]:.9g}, {high[joint]:.9g}] rad"
        value = float(waypoints[row, joint])
        raise InvalidInput(f"waypoints, waypoint {row + 1}", inside, value=value, joint=int(joint))


def _is_list(value: Any) -> bool:
    array = isinstance(value, np.ndarray) and value.ndim > 0
    return array or (isinstance(value, Sequence) and not isinstance(value, str | bytes))


def _is_number(value: Any) -> bool:
    """Whether `float` takes it: no truth value, no complex number, no integer beyond 1e308."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    return not isinstance(value, int) or abs(value) < 2**1023


def _frozen(array: Array) -> Array:
    array = np.array(array, dtype=float)
    array.setflags(write=False)
    return array
