"""Problems with limits of one segment: closed forms, edges, the paper's problem, random ones.

The random ones are those of `families`, in which every segment has limits of its own, by a number
and `VERSION` the same on every machine: of velocity from a fifth of the family's on, of
acceleration and jerk from 0.3 on.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from trajopt.benchmark.suites import families
from trajopt.benchmark.suites.suite import made_and_drawn, source
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

# Raise it whenever a problem changes.
VERSION = 1

RANDOM = 80  # by default, every other one with jerk limits
_LEAST_VELOCITY = 0.2  # of the family's
_LEAST_ACCELERATION = 0.3

# Ma et al.'s six axes (Machines 12(7):490, Tables 2 and 3), a quarter of the speed in one segment.
_SIX_AXIS = [
    [0, 0, -45, 0, 0, 0],
    [0, -30, -30, 30, 0, 0],
    [0, -45, -20, 45, 30, 0],
    [0, -50, -20, 60, 60, 30],
]
_VELOCITY = [150, 180, 210, 360, 360, 450]
_ACCELERATION = [93, 120, 160, 170, 260, 330]
_SLOWED = 0.25

# Waypoints; velocity, acceleration and jerk limits of each segment; what it is.
_MADE: dict[str, tuple[list[list[float]], list[float], list[float], list[float], str]] = {
    # p² = (1 + 2 A h)/2: T = p/A + (p − 1)/A + (h − 1/(2 A)) + 1/A
    "slow": ([[0.0], [1.0], [2.0]], [10, 1], [2, 2], [], "closed form"),
    "slow-first": ([[0.0], [1.0], [2.0]], [1, 10], [2, 2], [], "closed form: the first mirrored"),
    "slow-middle": ([[0.0], [1.0], [2.0], [3.0]], [10, 1, 10], [2, 2, 2], [], "closed form"),
    "fast-middle": ([[0.0], [1.0], [2.0], [3.0]], [1, 10, 1], [2, 2, 2], [], "closed form"),
    # it passes the waypoint at √(2 A h) of the second segment, at most
    "gentle": ([[0.0], [1.0], [2.0]], [10, 10], [8, 1], [], "closed form"),
    "gentle-jerk": ([[0.0], [1.0], [2.0]], [10, 10], [8, 1], [80, 4], "acceleration and jerk"),
    "turn": ([[0.0], [1.0], [0.0]], [2, 0.5], [2, 4], [], "it turns at the waypoint"),
    "crawl": ([[0.0], [1.0], [1.1], [2.0]], [2, 1e-3, 2], [4, 4, 4], [], "2,000 times slower"),
    "tiny": ([[0.0], [1.0], [1.0 + 1e-6], [2.0]], [2, 0.1, 2], [4, 4, 4], [], "a tiny segment"),
    "stiff": ([[0.0], [1.0], [2.0]], [2, 0.5], [4, 4], [4e4, 4e2], "100 times the jerk"),
    "still": ([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]], [2, 0.5], [4, 4], [], "a joint waits"),
    "repeated": ([[0.0], [1.0], [1.0], [2.0]], [10, 1e-3, 1], [2, 2, 2], [], "a waypoint twice"),
}


def _made(key: str) -> Problem:
    waypoints, *sizes, words = _MADE[key]
    joints = len(waypoints[0])
    limits = {
        name: [-1, 1] * np.repeat(np.array(own, dtype=float)[:, None, None], joints, axis=1)
        for name, own in zip(("velocity", "acceleration", "jerk"), sizes, strict=True)
        if own
    }
    return Problem(
        waypoints, Limits(**limits), name=f"sections-{key}", source=source("sections", words)
    )


def _six_axis() -> Problem:
    degree = np.pi / 180
    velocity = np.tile(degree * np.array(_VELOCITY)[:, None] * [-1, 1], (3, 1, 1))
    velocity[1] *= _SLOWED
    limits = Limits(velocity, degree * np.array(_ACCELERATION))
    paper = "Ma et al. 2024, Machines 12(7):490 (CC BY), slower through its second segment"
    return Problem(degree * np.array(_SIX_AXIS), limits, name="sections-six-axis", source=paper)


def draw(index: int) -> Problem:
    """Draw random problem number `index`: 1 to 4 joints, 3 to 6 waypoints."""
    base = families.for_suite("sections", VERSION, index, fewest_waypoints=3)
    rng = np.random.default_rng([VERSION, 52, index])

    def own(pairs: Array, least: float) -> Array:
        return pairs * rng.uniform(least, 1.0, (base.segments, base.joints, 1))

    known = base.limits
    limits = Limits(
        own(known.velocity, _LEAST_VELOCITY),
        own(known.acceleration, _LEAST_ACCELERATION),
        own(known.jerk, _LEAST_ACCELERATION) if base.has("jerk") else None,
        known.position,
    )
    return replace(base, limits=limits)


SUITE = made_and_drawn(
    "sections",
    "problems with limits of one segment",
    VERSION,
    {key: partial(_made, key) for key in _MADE} | {"six-axis": _six_axis},
    draw,
    RANDOM,
)
