"""Real robot arms, and problems drawn from their joint ranges."""

from __future__ import annotations

import re
from collections.abc import Iterator
from zlib import crc32

import numpy as np

from trajopt.core import arm_file
from trajopt.core.arm_file import Arm
from trajopt.core.arm_file import arm_files as arm_files
from trajopt.core.problem import Problem

# Raise it whenever an arm or its problems change.
VERSION = 2

# The suite's arms, whose problems have records and are in the experiments' tables. The problems of
# other arms are made by name.
SUITE_ARMS = (
    "abb-irb-120",
    "crs-a255",
    "franka-fr3",
    "franka-panda",
    "kinova-gen3",
    "kuka-iisy-3",
    "kuka-iiwa-14",
    "kuka-kr6-r700",
    "puma-560",
    "ur10e",
    "ur5e",
)

_SEED = 1  # of the waypoints

ROBOT_WAYPOINTS = (4, 8, 16)
RANGE_SHARE = 0.95  # the middle part of a joint's range, in which waypoints lie
_NAME = re.compile(r"robots-(?P<arm>.+)-w(?P<waypoints>\d+)(?P<jerk>-jerk)?")

arm = arm_file.read


def robot_problem(real: Arm, waypoints: int, *, jerk: bool = False) -> Problem:
    """Draw an arm's problem: uniform waypoints in its joint ranges, under its own limits.

    Waypoints lie in the middle 95 % of each range, and within one turn. They are the same with and
    without jerk limits.
    """
    key = crc32(real.name.encode())
    rng = np.random.default_rng([_SEED, key, waypoints])
    turn = 2 * np.pi  # some joints have no position limits
    low, high = np.clip(real.limits.position, -turn, turn).T
    half = RANGE_SHARE * (high - low) / 2
    reach = np.minimum(half, np.pi)
    middle = (low + high) / 2
    joints = len(reach)
    unit = 2 * rng.random((waypoints, joints)) - 1
    ending = "-jerk"
    limits = real.limits
    if not jerk:
        ending = ""
        limits = limits.without("jerk")
    return Problem(
        middle + reach * unit,
        limits,
        name=f"robots-{real.name}-w{waypoints}{ending}",
        source=f"{real.description}; data/robots/{real.name}.toml, version {VERSION}",
        joint_names=real.joint_names,
        joint_units=["rad"] * joints,
        chain=real.chain,
    )


def stream() -> Iterator[Problem]:
    """Yield the problems of the suite's arms at every size, with and without jerk limits."""
    for name in SUITE_ARMS:
        real = arm(name)
        for jerk in (False, True):
            if jerk and "jerk" not in real.origins:
                continue
            for count in ROBOT_WAYPOINTS:
                yield robot_problem(real, count, jerk=jerk)


def named(name: str) -> Problem | None:
    """Return the problem of this name, of any size, or None."""
    match = _NAME.fullmatch(name)
    if match is None or match["arm"] not in arm_files():
        return None
    real = arm(match["arm"])
    jerk = match["jerk"] is not None
    waypoints = int(match["waypoints"])
    if waypoints < 2 or (jerk and "jerk" not in real.origins):
        return None
    problem = robot_problem(real, waypoints, jerk=jerk)
    return problem if problem.name == name else None
