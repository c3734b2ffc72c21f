"""Problems that begin or end in motion: closed forms, the paper's problem replanned, random ones.

The random ones are those of `families`, in which the motion begins and ends at up to half of its
velocity limits, by a number and `VERSION` the same on every machine. With jerk limits they begin
and end accelerating too, as far as velocity limits leave room for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trajopt.benchmark.suites import families
from trajopt.benchmark.suites.suite import closed_forms, made_and_drawn
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

# Raise it whenever a problem changes.
VERSION = 1

RANDOM = 80  # by default, every other one with jerk limits
_MOST_VELOCITY = 0.5  # of its limit
_MOST_ROOM = 0.8  # of what a velocity leaves to the limit

# Ma et al.'s six axes (Machines 12(7):490, Tables 2 and 3), 0.7 s after the start of the fastest
# motion, rounded: on their way to the second waypoint, which is left out.
_HERE = [0.0, -0.508254, -0.532106, 0.511745, -0.015976, 0.009534]
_THERE = [0.0, -1.264025, 0.699966, 0.980303, 1.274968, -0.760902]
_AHEAD = [[0, -45, -20, 45, 30, 0], [0, -50, -20, 60, 60, 30]]
_VELOCITY = [150, 180, 210, 360, 360, 450]
_ACCELERATION = [93, 120, 160, 170, 260, 330]

_V, _A = [2.0], [1.0]
_CLOSED_FORMS = {
    # p = √(A h + v0²/2), T = (2 p − v0)/A
    "start": ([[0.0], [1.0]], Limits([100.0], _A), {"start_velocity": [0.5]}),
    "against": ([[0.0], [1.0]], Limits([100.0], _A), {"start_velocity": [-0.5]}),
    "end": ([[0.0], [1.0]], Limits([100.0], _A), {"end_velocity": [0.5]}),
    # it cannot stop before: T = v0/A + 2 √(0.3/A)
    "gap": ([[0.0], [0.2]], Limits(_V, _A), {"start_velocity": [1.0]}),
    # through two gaps at once, of 0.2 and 0.21 rad
    "gaps": (
        [[0.0, 0.0], [0.2, 0.21], [1.0, 1.0]],
        Limits([2.0, 2.0], [1.0, 1.0]),
        {"start_velocity": [1.0, 1.0]},
    ),
    # at its velocity limit: T = (3 − V²/(2 A))/V + V/A
    "limit": ([[0.0], [3.0]], Limits([1.0], [2.0]), {"start_velocity": [1.0]}),
    # a joint that starts where it ends
    "stays": (
        [[0.0, 0.0], [1.0, 0.0]],
        Limits([2.0, 2.0], [1.0, 1.0]),
        {"start_velocity": [0.0, 0.5]},
    ),
}


def _replanned() -> Problem:
    degree = np.pi / 180
    limits = Limits(degree * np.array(_VELOCITY), degree * np.array(_ACCELERATION))
    waypoints = np.vstack([_HERE, degree * np.array(_AHEAD)])
    source = "Ma et al. 2024, Machines 12(7):490 (CC BY), replanned in motion"
    return Problem(
        waypoints, limits, "moving-replanned", source, demands={"start_velocity": _THERE}
    )


def draw(index: int) -> Problem:
    """Draw random problem number `index`: 1 to 4 joints, 2 to 6 waypoints."""
    base = families.for_suite("moving", VERSION, index, fewest_waypoints=2)
    joints = base.joints
    rng = np.random.default_rng([VERSION, 51, index])
    demands: dict[str, Array] = {}
    limits = base.limits
    V, A, J = (
        np.abs(own).min(axis=1) for own in (limits.velocity, limits.acceleration, limits.jerk)
    )
    for end in ("start", "end"):
        velocity = _MOST_VELOCITY * V * (2 * rng.random(joints) - 1)
        demands[f"{end}_velocity"] = velocity
        if base.has("jerk"):
            room = _MOST_ROOM * (V - np.abs(velocity))
            most = np.minimum(A, np.sqrt(2 * J * room))
            demands[f"{end}_acceleration"] = 0.5 * most * (2 * rng.random(joints) - 1)
    return replace(base, demands=demands)


SUITE = made_and_drawn(
    "moving",
    "problems that begin or end in motion",
    VERSION,
    closed_forms("moving", _CLOSED_FORMS) | {"replanned": _replanned},
    draw,
    RANDOM,
)
