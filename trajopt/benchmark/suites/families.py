"""Random families of problems, seeded and versioned.

A family, an index and `VERSION` give the same numbers on every machine: only uniform numbers,
integers and the exactly rounded `+ - * /` are used. Powers and sines differ in their last digit
between processors.

    families.draw("zigzag", 3)              # its size and whether jerk is limited are drawn too
    families.draw("zigzag", 3, joints=6)
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np

from trajopt.benchmark.suites.suite import source
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

if TYPE_CHECKING:
    from numpy.random import Generator

# Raise it whenever a family and an index give other numbers than before.
VERSION = 1

JOINTS = 12  # the largest number of joints
WAYPOINTS = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 30, 50)

_TINY_SHARES = np.array([1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
_HUGE_SHARES = np.array([1.0, 10.0, 100.0, 1e3, 1e4])
_LIMIT_SHARES = np.array([1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0])
_JERK_SHARES = np.array([1.0, 10.0, 100.0])
_NAME = re.compile(
    r"random-(?P<family>[a-z]+)-j(?P<joints>[1-9]\d*)-w(?P<waypoints>[1-9]\d*)"
    r"(?P<jerk>-jerk)?-(?P<index>\d+)"
)


def draw(
    family: str,
    index: int,
    *,
    joints: int | None = None,
    waypoints: int | None = None,
    jerk: bool | None = None,
) -> Problem:
    """Draw problem number `index` of a family.

    Sizes that are not given are drawn too: 1 to 12 joints, 2 to 50 waypoints, jerk limits in every
    other problem. Velocity limits are 0.5 to 5 rad/s and acceleration limits 1 to 20 rad/s², but
    in the family `unequal`. One joint in four is asymmetric, by up to a factor of three. Jerk
    limits are 1 to 1000 times the acceleration limits.

    Raises:
        UnknownName: There is no such family.
        InvalidInput: A size is too small for a problem.
    """
    if family not in FAMILIES:
        raise UnknownName("random family", family, FAMILIES)
    sizes = {"index": (index, 0), "joints": (joints, 1), "waypoints": (waypoints, 2)}
    for key, (size, lowest) in sizes.items():
        if size is not None and size < lowest:
            raise InvalidInput(key, f"{lowest} or more", value=size)
    rng = np.random.default_rng([VERSION, crc32(family.encode()), index])
    # Sizes are drawn even where they are given: a given size changes no later number.
    drawn_joints = 1 + int(rng.integers(JOINTS))
    drawn_waypoints = WAYPOINTS[rng.integers(len(WAYPOINTS))]
    drawn_jerk = bool(rng.integers(2))
    n = joints or drawn_joints
    w = waypoints or drawn_waypoints
    limited = drawn_jerk if jerk is None else jerk
    ending = "-jerk" if limited else ""
    path = FAMILIES[family].path(rng, w - 1, n)
    limits = _limits(rng, FAMILIES[family], n, limited)
    return Problem(
        path,
        limits,
        name=f"random-{family}-j{n}-w{w}{ending}-{index:02}",
        source=source("families", f"random family {family}, version {VERSION}, index {index}"),
    )


def for_suite(
    suite: str, version: int, index: int, *, fewest_waypoints: int, kinds: int = 1, digits: int = 2
) -> Problem:
    """Draw a problem for another suite to add its demands to: families and sizes by turns.

    It has 1 to 4 joints and up to 6 waypoints; jerk limits are in every other one.

    Args:
        suite: Its name.
        version: Of its problems.
        index: Of the problem in it.
        fewest_waypoints: 2 or 3.
        kinds: How many problems follow each other that differ by their demands.
        digits: Of the index in the problem's name, at least.
    """
    turn = index // kinds
    family = sorted(FAMILIES)[turn % len(FAMILIES)]
    drawn = draw(
        family,
        turn,
        joints=1 + turn // 2 % 4,
        waypoints=fewest_waypoints + turn // 8 % (7 - fewest_waypoints),
        jerk=turn % 2 == 1,
    )
    words = f"random family {family}, version {version}, index {index}"
    return replace(drawn, name=f"{suite}-random-{index:0{digits}}", source=source(suite, words))


def stream(*families: str) -> Iterator[Problem]:
    """Yield problems of these families (by default of all) by turns, without end."""
    for index in itertools.count():
        for family in families or FAMILIES:
            yield draw(family, index)


def named(name: str) -> Problem | None:
    """Return the problem of this name, or None."""
    match = _NAME.fullmatch(name)
    if match is None or match["family"] not in FAMILIES or match["waypoints"] == "1":
        return None
    problem = draw(
        match["family"],
        int(match["index"]),
        joints=int(match["joints"]),
        waypoints=int(match["waypoints"]),
        jerk=bool(match["jerk"]),
    )
    return problem if problem.name == name else None


def _between(rng: Generator, low: float, high: float, shape: Any) -> Array:
    # Generator.uniform may round once or twice, depending on the compiler.
    unit = rng.random(shape)
    return np.asarray(low + (high - low) * unit)


def _signs(rng: Generator, k: int, n: int) -> Array:
    return np.where(rng.random((k, n)) < 0.5, -1.0, 1.0)


def _steps(rng: Generator, k: int, n: int) -> Array:
    """Draw displacements `(k, n)` of 0.2 to 1.5 rad in either direction."""
    signs = _signs(rng, k, n)
    return signs * _between(rng, 0.2, 1.5, (k, n))


def _walk(rng: Generator, h: Array) -> Array:
    """Return waypoints `(k + 1, n)` with the displacements `h` from a random start."""
    start = _between(rng, -1.0, 1.0, h.shape[1])
    travelled = np.cumsum(h, axis=0)
    return np.vstack([start, start + travelled])


def _smooth(rng: Generator, k: int, n: int) -> Array:
    """Evaluate one random cubic at even distances, by de Casteljau's algorithm."""
    control = _between(rng, -np.pi, np.pi, (4, 1, n))
    s = np.arange(k + 1)[:, None] / k
    while len(control) > 1:
        control = control[:-1] * (1 - s) + control[1:] * s
    return np.asarray(control[0])


def _zigzag(rng: Generator, k: int, n: int) -> Array:
    turns = 1.0 - 2.0 * (np.arange(k) % 2)
    signs = turns[:, None] * _signs(rng, 1, n)
    sizes = _between(rng, 0.2, 1.5, (k, n))
    return _walk(rng, signs * sizes)


def _collinear(rng: Generator, k: int, n: int) -> Array:
    """Draw uneven shares of a straight line, moved by 1e-6 to 1e-2 rad."""
    start = _between(rng, -np.pi, np.pi, n)
    h = 3 * _steps(rng, 1, n)
    lengths = _between(rng, 0.5, 1.5, k)
    along = np.cumsum([0.0, *lengths])[:, None]
    digits = _between(rng, 1.0, 10.0, ())
    size = digits * rng.choice(_TINY_SHARES[-4:])
    straight = start + along / along[-1] * h
    noise = _between(rng, -1, 1, (k + 1, n))
    return np.asarray(straight + size * noise)


def _ordinary(rng: Generator, k: int, n: int) -> Array:
    h = _steps(rng, k, n)
    return _walk(rng, h)


def _scaled(rng: Generator, k: int, n: int, shares: Array) -> Array:
    """Multiply every other segment on average, and at least one, by a number of `shares`."""
    is_ordinary = rng.random(k) >= 0.5
    factors = rng.choice(shares, k)
    factors[is_ordinary] = 1.0
    share = rng.choice(shares)
    segment = rng.integers(k)
    factors[segment] = share
    h = _steps(rng, k, n)
    return _walk(rng, h * factors[:, None])


def _moderate(rng: Generator, n: int) -> tuple[Array, Array]:
    velocity = _between(rng, 0.5, 5.0, n)
    acceleration = _between(rng, 1.0, 20.0, n)
    return velocity, acceleration


def _unequal(rng: Generator, n: int) -> tuple[Array, Array]:
    ordinary = _between(rng, 1.0, 10.0, (2, n))
    velocity, acceleration = ordinary * rng.choice(_LIMIT_SHARES, (2, n))
    return velocity, acceleration


def _limits(rng: Generator, family: Family, n: int, jerk: bool) -> Limits:
    high_velocity, high_acceleration = family.limits(rng, n)
    velocity = _pairs(rng, high_velocity)
    acceleration = _pairs(rng, high_acceleration)
    # Drawn even if the problem has no jerk limits: `jerk` changes no other number.
    digits = _between(rng, 1.0, 10.0, n)
    stiffness = digits * rng.choice(_JERK_SHARES, n)
    if not jerk:
        return Limits(velocity, acceleration)
    tighter = np.abs(acceleration).min(axis=1)
    return Limits(velocity, acceleration, jerk=stiffness * tighter)


def _pairs(rng: Generator, high: Array) -> Array:
    """Return `[low, high]` per joint, one in four asymmetric."""
    is_symmetric = rng.random(len(high)) >= 0.25
    ratio = _between(rng, 1 / 3, 3.0, len(high))
    ratio[is_symmetric] = 1.0
    return np.stack([-high * ratio, high], axis=1)


@dataclass(frozen=True)
class Family:
    """One kind of random problems.

    Attributes:
        description: One line.
        path: Draws waypoints `(segments + 1, joints)`, rad.
        limits: Draws velocity and acceleration limits, each `(joints,)`, rad/s and rad/s².
    """

    description: str
    path: Callable[[Generator, int, int], Array]
    limits: Callable[[Generator, int], tuple[Array, Array]] = _moderate


FAMILIES = {
    "smooth": Family("waypoints along a cubic of each joint", _smooth),
    "zigzag": Family("every joint turns back at every waypoint", _zigzag),
    "collinear": Family("uneven waypoints near a straight line", _collinear),
    "tiny": Family(
        "segments of 1e-9 rad to 1e-3 rad among ordinary ones",
        partial(_scaled, shares=_TINY_SHARES),
    ),
    "huge": Family(
        "segments of up to 15 000 rad among ordinary ones", partial(_scaled, shares=_HUGE_SHARES)
    ),
    "unequal": Family("limits up to a million to one apart", _ordinary, _unequal),
}
"""The random families by name."""
