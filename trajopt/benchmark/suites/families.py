"""Random families of problems, seeded and versioned.

A family, an index and `VERSION` mean the same numbers on every machine: only uniform numbers,
integers and the exactly rounded `+ - * /` are used, since powers and sines differ in their last
digit between processors.

    families.draw("zigzag", 3)              # its size and whether jerk is limited are drawn too
    families.draw("zigzag", 3, joints=6)
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np

from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.core.problem import Array, Limits, Problem

if TYPE_CHECKING:
    from numpy.random import Generator

# Raise it whenever a family and an index come to mean other numbers.
VERSION = 1

JOINTS = 12  # at most
WAYPOINTS = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 30, 50)

_TINY_SHARES = np.array([1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
_HUGE_SHARES = np.array([1.0, 10.0, 100.0, 1e3, 1e4])
_LIMIT_SHARES = np.array([1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0])
_JERK_SHARES = np.array([1.0, 10.0, 100.0])
_NAME = re.compile(
    r"random-(?P<family>[a-z]+)-j(?P<joints>\d+)-w(?P<waypoints>\d+)(?P<jerk>-jerk)?-(?P<index>\d+)"
)


@dataclass(frozen=True)
class Family:
    """How to draw waypoints `(segments + 1, joints)`, rad, and velocity and acceleration limits,
    each `(joints,)`, rad/s and rad/s²."""

    description: str
    path: Callable[[Generator, int, int], Array]
    limits: Callable[[Generator, int], tuple[Array, Array]]


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
    1000 times the acceleration's.

    Raises:
        UnknownName: there is no such family.
        InvalidInput: a size that no problem can have.
    """
    if family not in FAMILIES:
        raise UnknownName("random family", family, FAMILIES)
    _check("index", index, lowest=0)
    _check("joints", joints, lowest=1)
    _check("waypoints", waypoints, lowest=2)
    key = crc32(family.encode())
    rng = np.random.default_rng([VERSION, key, index])
    # Drawn also where given, so that a size changes nothing else.
    drawn_joints = 1 + int(rng.integers(JOINTS))
    size = rng.integers(len(WAYPOINTS))
    drawn_waypoints = WAYPOINTS[size]
    drawn_jerk = bool(rng.integers(2))
    n = joints or drawn_joints
    w = waypoints or drawn_waypoints
    limited = drawn_jerk if jerk is None else jerk
    ending = "-jerk" if limited else ""
    drawn = FAMILIES[family]
    path = drawn.path(rng, w - 1, n)
    limits = _limits(rng, drawn, n, limited)
    return Problem(
        path,
        limits,
        name=f"random-{family}-j{n}-w{w}{ending}-{index:02}",
        source=(
            f"trajopt.benchmark.suites.families, random family {family}, "
            f"version {VERSION}, index {index}"
        ),
    )


def _check(key: str, value: int | None, lowest: int) -> None:
    if value is not None and value < lowest:
        raise InvalidInput(key, f"{lowest} or more", value=value)


def stream(*families: str) -> Iterator[Problem]:
    """The problems of these families (of all, if none is named) without end, by turns."""
    for index in itertools.count():
        for family in families or FAMILIES:
            yield draw(family, index)


def named(name: str) -> Problem | None:
    """The problem of this name, or None."""
    match = _NAME.fullmatch(name)
    if match is None or match["family"] not in FAMILIES:
        return None
    joints = int(match["joints"])
    waypoints = int(match["waypoints"])
    if joints < 1 or waypoints < 2:
        return None
    problem = draw(
        match["family"],
        int(match["index"]),
        joints=joints,
        waypoints=waypoints,
        jerk=match["jerk"] is not None,
    )
    return problem if problem.name == name else None


def _between(rng: Generator, low: float, high: float, shape: Any) -> Array:
    # Not Generator.uniform: it may round once or twice, as the compiler likes.
    unit = rng.random(shape)
    values = low + (high - low) * unit
    return np.asarray(values)


def _signs(rng: Generator, k: int, n: int) -> Array:
    lots = rng.random((k, n))
    return np.where(lots < 0.5, -1.0, 1.0)


def _steps(rng: Generator, k: int, n: int) -> Array:
    """Displacements `(k, n)` of 0.2 to 1.5 rad, either way."""
    signs = _signs(rng, k, n)
    return signs * _between(rng, 0.2, 1.5, (k, n))


def _walk(rng: Generator, h: Array) -> Array:
    """Waypoints `(k + 1, n)` at displacements `h` from a random start."""
    joints = h.shape[1]
    start = _between(rng, -1.0, 1.0, joints)
    travelled = np.cumsum(h, axis=0)
    return np.vstack([start, start + travelled])


def _smooth(rng: Generator, k: int, n: int) -> Array:
    """Along one random cubic, by de Casteljau."""
    control = _between(rng, -np.pi, np.pi, (4, 1, n))
    even = np.arange(k + 1) / k
    s = even[:, None]
    while len(control) > 1:
        left = control[:-1]
        right = control[1:]
        control = left * (1 - s) + right * s
    return np.asarray(control[0])


def _zigzag(rng: Generator, k: int, n: int) -> Array:
    odd = np.arange(k) % 2
    turns = np.where(odd, -1.0, 1.0)
    signs = turns[:, None] * _signs(rng, 1, n)
    sizes = _between(rng, 0.2, 1.5, (k, n))
    return _walk(rng, signs * sizes)


def _collinear(rng: Generator, k: int, n: int) -> Array:
    """Uneven shares of a straight line, off by a millionth to a hundredth of a radian."""
    start = _between(rng, -np.pi, np.pi, n)
    h = 3 * _steps(rng, 1, n)
    lengths = _between(rng, 0.5, 1.5, k)
    from_start = np.concatenate([[0.0], lengths])
    along = np.cumsum(from_start)[:, None]
    digits = _between(rng, 1.0, 10.0, ())
    off = digits * rng.choice(_TINY_SHARES[-4:])
    straight = start + along / along[-1] * h
    noise = _between(rng, -1, 1, (k + 1, n))
    return np.asarray(straight + off * noise)


def _ordinary(rng: Generator, k: int, n: int) -> Array:
    h = _steps(rng, k, n)
    return _walk(rng, h)


def _tiny(rng: Generator, k: int, n: int) -> Array:
    return _scaled(rng, k, n, _TINY_SHARES)


def _huge(rng: Generator, k: int, n: int) -> Array:
    return _scaled(rng, k, n, _HUGE_SHARES)


def _scaled(rng: Generator, k: int, n: int, shares: Array) -> Array:
    """Segments times numbers drawn from `shares`, every other one on average."""
    lots = rng.random(k)
    drawn = rng.choice(shares, k)
    factors = np.where(lots < 0.5, drawn, 1.0)
    # One at least.
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
    shares = rng.choice(_LIMIT_SHARES, (2, n))
    velocity, acceleration = ordinary * shares
    return velocity, acceleration


def _limits(rng: Generator, family: Family, n: int, jerk: bool) -> Limits:
    high_velocity, high_acceleration = family.limits(rng, n)
    velocity = _pairs(rng, high_velocity)
    acceleration = _pairs(rng, high_acceleration)
    # Drawn also without jerk limits, as everything else is.
    digits = _between(rng, 1.0, 10.0, n)
    stiffness = digits * rng.choice(_JERK_SHARES, n)
    if not jerk:
        return Limits(velocity, acceleration)
    tighter = np.abs(acceleration).min(axis=1)
    return Limits(velocity, acceleration, jerk=stiffness * tighter)


def _pairs(rng: Generator, high: Array) -> Array:
    """`[low, high]` per joint, one in four asymmetric."""
    joints = len(high)
    lots = rng.random(joints)
    drawn = _between(rng, 1 / 3, 3.0, joints)
    ratio = np.where(lots < 0.25, drawn, 1.0)
    return np.stack([-high * ratio, high], axis=1)


FAMILIES = {
    "smooth": Family(
        "waypoints along a cubic of each joint",
        path=_smooth,
        limits=_moderate,
    ),
    "zigzag": Family(
        "every joint turns back at every waypoint",
        path=_zigzag,
        limits=_moderate,
    ),
    "collinear": Family(
        "uneven waypoints near a straight line",
        path=_collinear,
        limits=_moderate,
    ),
    "tiny": Family(
        "segments of 1e-9 rad to 1e-3 rad among ordinary ones",
        path=_tiny,
        limits=_moderate,
    ),
    "huge": Family(
        "segments of up to 15 000 rad among ordinary ones",
        path=_huge,
        limits=_moderate,
    ),
    "unequal": Family(
        "limits up to a million to one apart",
        path=_ordinary,
        limits=_unequal,
    ),
}
"""The random families by name."""
