"""Problems made in code: random families, seeded and versioned, and degenerate problems.

A family, an index and `VERSION` mean the same numbers on every machine: only uniform numbers,
integers and the exactly rounded `+ - * /` are used, since powers and sines differ in their last
digit between processors.

    families.draw("zigzag", 3)              # its size and whether jerk is limited are drawn too
    families.draw("zigzag", 3, joints=6)
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np

from trajopt.exceptions import InvalidInput, UnknownName
from trajopt.problem import Array, Limits, Problem

# Raise it whenever a family and an index come to mean other numbers.
VERSION = 1
# Raise it whenever a degenerate problem changes.
EDGES_VERSION = 1

JOINTS = 12  # at most
WAYPOINTS = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 30, 50)

_TINY = np.array([1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
_HUGE = np.array([1.0, 10.0, 100.0, 1e3, 1e4])
_UNEQUAL = np.array([1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0])
_JERK = np.array([1.0, 10.0, 100.0])


@dataclass(frozen=True)
class Family:
    """How to draw waypoints `(segments + 1, joints)`, rad, and velocity and acceleration limits,
    each `(joints,)`, rad/s and rad/s²."""

    description: str
    path: Callable[[np.random.Generator, int, int], Array]
    limits: Callable[[np.random.Generator, int], tuple[Array, Array]]


def draw(
    family: str,
    index: int,
    *,
    joints: int | None = None,
    waypoints: int | None = None,
    jerk: bool | None = None,
) -> Problem:
    """Problem number `index` of a family; what is not given is drawn: 1–12 joints, 2–50 waypoints,
    jerk limits in every other problem.

    Velocity limits are 0.5 to 5 rad/s and acceleration limits 1 to 20 rad/s², unless the family is
    about limits; one joint in four is asymmetric, by up to a factor of three. Jerk limits are 1 to
    1000 times the acceleration's. Raises `UnknownName` or `InvalidInput`.
    """
    if family not in FAMILIES:
        raise UnknownName("random family", family, FAMILIES)
    sizes = [("index", index, 0), ("joints", joints, 1), ("waypoints", waypoints, 2)]
    for key, value, least in sizes:
        if value is not None and value < least:
            raise InvalidInput(key, f"{least} or more", value=value)
    rng = np.random.default_rng([VERSION, crc32(family.encode()), index])
    drawn = 1 + int(rng.integers(JOINTS)), WAYPOINTS[int(rng.integers(len(WAYPOINTS)))]
    n, w, coin = joints or drawn[0], waypoints or drawn[1], bool(rng.integers(2))
    limited = coin if jerk is None else jerk
    path = FAMILIES[family].path(rng, w - 1, n)
    name = f"random-{family}-j{n}-w{w}{'-jerk' if limited else ''}-{index:02}"
    source = f"trajopt.benchmark.families, random family {family}, version {VERSION}, index {index}"
    return Problem(path, _limits(rng, FAMILIES[family], n, limited), name, source)


def stream(*families: str) -> Iterator[Problem]:
    """The problems of these families (of all, if none is named) without end, by turns."""
    for index in itertools.count():
        for family in families or FAMILIES:
            yield draw(family, index)


def _between(rng: np.random.Generator, low: float, high: float, shape: Any) -> Array:
    # Not Generator.uniform: it may round once or twice, as the compiler likes.
    return np.asarray(low + (high - low) * rng.random(shape))


def _signs(rng: np.random.Generator, k: int, n: int) -> Array:
    return np.where(rng.random((k, n)) < 0.5, -1.0, 1.0)


def _steps(rng: np.random.Generator, k: int, n: int) -> Array:
    """Displacements `(k, n)` of 0.2 to 1.5 rad, either way."""
    return _signs(rng, k, n) * _between(rng, 0.2, 1.5, (k, n))


def _walk(rng: np.random.Generator, h: Array) -> Array:
    start = _between(rng, -1.0, 1.0, h.shape[1])
    return np.vstack([start, start + np.cumsum(h, axis=0)])


def _smooth(rng: np.random.Generator, k: int, n: int) -> Array:
    """Along one random cubic, by de Casteljau."""
    control, s = _between(rng, -np.pi, np.pi, (4, 1, n)), (np.arange(k + 1) / k)[:, None]
    while len(control) > 1:
        control = control[:-1] * (1 - s) + control[1:] * s
    return np.asarray(control[0])


def _zigzag(rng: np.random.Generator, k: int, n: int) -> Array:
    turns = np.where(np.arange(k) % 2, -1.0, 1.0)[:, None]
    return _walk(rng, turns * _signs(rng, 1, n) * _between(rng, 0.2, 1.5, (k, n)))


def _collinear(rng: np.random.Generator, k: int, n: int) -> Array:
    """Uneven shares of a straight line, off by a millionth to a hundredth of a radian."""
    start, h = _between(rng, -np.pi, np.pi, n), 3 * _steps(rng, 1, n)
    along = np.cumsum(np.r_[0.0, _between(rng, 0.5, 1.5, k)])[:, None]
    off = _between(rng, 1.0, 10.0, ()) * rng.choice(_TINY[-4:])
    return np.asarray(start + along / along[-1] * h + off * _between(rng, -1, 1, (k + 1, n)))


def _scaled(scales: Array, rng: np.random.Generator, k: int, n: int) -> Array:
    """Segments times scales drawn from `scales`, every other one on average."""
    each = np.where(rng.random(k) < 0.5, rng.choice(scales, k), 1.0)
    each[rng.integers(k)] = rng.choice(scales)
    return _walk(rng, _steps(rng, k, n) * each[:, None])


def _moderate(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    return _between(rng, 0.5, 5.0, n), _between(rng, 1.0, 20.0, n)


def _unequal(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    velocity, acceleration = _between(rng, 1.0, 10.0, (2, n)) * rng.choice(_UNEQUAL, (2, n))
    return velocity, acceleration


def _limits(rng: np.random.Generator, family: Family, n: int, jerk: bool) -> Limits:
    velocity, acceleration = (_pairs(rng, high) for high in family.limits(rng, n))
    stiffness = _between(rng, 1.0, 10.0, n) * rng.choice(_JERK, n)
    least = np.abs(acceleration).min(axis=1)
    return Limits(velocity, acceleration, stiffness * least if jerk else None)


def _pairs(rng: np.random.Generator, high: Array) -> Array:
    ratio = np.where(rng.random(len(high)) < 0.25, _between(rng, 1 / 3, 3.0, len(high)), 1.0)
    return np.stack([-high * ratio, high], axis=1)


def _tiny(rng: np.random.Generator, k: int, n: int) -> Array:
    return _scaled(_TINY, rng, k, n)


def _huge(rng: np.random.Generator, k: int, n: int) -> Array:
    return _scaled(_HUGE, rng, k, n)


def _ordinary(rng: np.random.Generator, k: int, n: int) -> Array:
    return _walk(rng, _steps(rng, k, n))


FAMILIES = {
    "smooth": Family("waypoints along a cubic of each joint", _smooth, _moderate),
    "zigzag": Family("every joint turns back at every waypoint", _zigzag, _moderate),
    "collinear": Family("uneven waypoints near a straight line", _collinear, _moderate),
    "tiny": Family("segments of 1e-9 rad to 1e-3 rad among ordinary ones", _tiny, _moderate),
    "huge": Family("segments of up to 15 000 rad among ordinary ones", _huge, _moderate),
    "unequal": Family("limits up to a million to one apart", _ordinary, _unequal),
}
"""The random families by name."""


def edges() -> Iterator[Problem]:
    """Degenerate problems, one kind each and tiny, but for the two that are about size."""
    unit: dict[str, Any] = {"velocity": 1.0, "acceleration": 2.0}
    for name, (what, waypoints, limits) in _EDGES.items():
        rows = np.array(waypoints, dtype=float)
        full = {key: _each(value, rows.shape[1]) for key, value in (unit | limits).items()}
        source = f"trajopt.benchmark.families, degenerate on purpose: {what}"
        yield Problem(rows, Limits(**full), f"edges-{name}", source)


def _each(value: Any, joints: int) -> Any:
    return [value] * joints if isinstance(value, float | tuple) else value


_ABC = [[0.0, 0.0], [1.0, -0.5], [0.4, 0.6]]  # an ordinary path, where the path is not the point
_STEP = [[0.0, 0.0], [1.0, 1.0]]
_SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
_TURN = np.arange(50) % 7  # a sawtooth: six steps one way, one back
_INF = float("inf")

# What it is, waypoints, and the limits that differ from 1 rad/s and 2 rad/s²; a single number or
# pair is every joint's.
_EDGES: dict[str, tuple[str, Any, dict[str, Any]]] = {
    "two-waypoints": ("one segment, from rest to rest", [[0, 0], [1, -0.5]], {}),
    "one-joint-two-waypoints": ("as little as there can be", [[0], [1]], {}),
    "twelve-joints": (
        "twelve joints, each with its own pattern",
        [[(j * k * k + 2 * k) % 13 / 4 for j in range(1, 13)] for k in range(4)],
        {},
    ),
    "fifty-waypoints": ("forty-nine segments", np.stack([_TURN, np.arange(50)], 1) / 4, {}),
    "repeated-first": ("the first waypoint twice", [_ABC[0], *_ABC], {}),
    "repeated-last": ("the last waypoint twice", [*_ABC, _ABC[-1]], {}),
    "repeated-all-but-last": ("one waypoint four times, then another", [[0, 0]] * 4 + [[1, 1]], {}),
    "out-and-back": ("there and back to the first waypoint", [[0, 0], [1, 0.5], [0, 0]], {}),
    "palindrome": ("a path and the same one backwards", [*_ABC, *_ABC[1::-1]], {}),
    "path-twice": ("a closed path twice over", [*_SQUARE, *_SQUARE, [0, 0]], {}),
    "one-of-six-moves": (
        "five joints never move",
        [[0.3, -1, q, 0, 2, 0.5] for q in (0, 1, 0.2, 0.7)],
        {},
    ),
    "one-segment-each": ("each joint moves in one segment only", [[0, 0], [1, 0], [1, 1]], {}),
    "twins": ("two joints do the same", [[q, q] for q in (0, 1, 0.4)], {}),
    "mirrored": ("two joints do the opposite", [[q, -q] for q in (0, 1, 0.4)], {}),
    "straight": ("a straight line in equal steps", [[q, 2 * q] for q in (0, 0.5, 1, 1.5)], {}),
    "zigzag": ("both joints turn back at every waypoint", [[0, 1], [1, 0]] * 4, {}),
    "tiny": ("every displacement is 1e-9 rad or less", 1e-9 * np.array(_ABC), {}),
    "huge": ("displacements of 1e4 rad", 1e4 * np.array(_ABC), {}),
    "tiny-beside-huge": ("1e-9 rad, then 1e4 rad", [[0, 0], [1e-9, 1e-9], [1e4, 5e3]], {}),
    "one-ulp": ("a displacement of one rounding unit", [[0], [1], [np.nextafter(1, 2)], [2]], {}),
    "far-from-zero": ("ordinary displacements, 1e6 rad away", 1e6 + np.array(_ABC), {}),
    "million-to-one": (
        "limits a million to one apart",
        _ABC,
        {"velocity": [1e-3, 1e3], "acceleration": [1e-3, 1e3]},
    ),
    "slow": ("limits of 1e-6", _ABC, {"velocity": 1e-6, "acceleration": 1e-6}),
    "fast": ("limits of 1e6", _ABC, {"velocity": 1e6, "acceleration": 1e6}),
    "velocity-never-reached": ("velocity limits without effect", _ABC, {"velocity": 1e3}),
    "velocity-always-reached": ("velocity is reached at once", _ABC, {"acceleration": 1e6}),
    "asymmetric": (
        "limits a hundred times tighter one way",
        _ABC,
        {"velocity": (-0.05, 5.0), "acceleration": (-0.1, 10.0)},
    ),
    "jerk-soft": ("jerk limits so soft that no other is reached", _ABC, {"jerk": 0.5}),
    "jerk-stiff": ("jerk limits almost without effect", _ABC, {"jerk": 2e5}),
    "jerk-one-joint": ("jerk limits on one joint only", _ABC, {"jerk": [10.0, _INF]}),
    "jerk-asymmetric": ("jerk limits ten times tighter one way", _ABC, {"jerk": (-4.0, 40.0)}),
    "jerk-one-side": ("jerk limits one way only: no optimum", _ABC, {"jerk": (-10.0, _INF)}),
    "jerk-at-rest": (
        "a jerk limit on a joint that never moves",
        [[0, 0], [1, 0], [2, 0]],
        {"jerk": [_INF, 10.0]},
    ),
    "at-position-limit": (
        "waypoints on the position limits",
        _ABC,
        {"position": [[0.0, 1.0], [-0.5, 0.6]]},
    ),
    "corridor": (
        "position limits so near that no joint can overshoot",
        [[0, 0], [1, 1e-6], [0.5, 0]],
        {"position": [[-1e-6, 1 + 1e-6], [-1e-6, 2e-6]]},
    ),
    "position-one-side": (
        "a position limit one way only",
        _ABC,
        {"position": [[-_INF, 1.0], [-_INF, _INF]]},
    ),
    "jerk-and-position": (
        "every kind of limit",
        _ABC,
        {"jerk": 20.0, "position": [[0.0, 1.0], [-0.5, 0.6]]},
    ),
}
