"""Arms under limits of the tool's speed and of the torques, through poses that are near.

The poses are a hand's way apart, as of a pick and a place. The tool may move at 250 mm/s, the
reduced speed beside a person (ISO 10218-1), or at 1000 mm/s. The drives have the torques
that their maker states, with and without the maker's payload, or 60 % of them. Acceleration limits
are the maker's; with torques those of the UR5e and the Gen3, which stand in for them, are
40 rad/s². The arm of `six-axis` passes that problem's own waypoints. Its masses are not known, so
it has no problem with torques.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from trajopt.benchmark.suites import robots
from trajopt.benchmark.suites.suite import Suite, source
from trajopt.core import built_in
from trajopt.core.limits import Acceleration, Limits
from trajopt.core.problem import Problem
from trajopt.planners.kinematics import Robot

# Raise it whenever a problem changes.
VERSION = 1

FAST = 40.0
"""Limit of acceleration with which torques alone decide, rad/s²."""

_POSES = {
    "ur5e": [
        [0, -1.2, 1.3, -1.6, -1.57, 0],
        [0.5, -1.0, 1.0, -1.5, -1.4, 0.3],
        [0.9, -1.3, 1.5, -1.8, -1.6, 0.6],
        [1.3, -0.9, 1.1, -1.7, -1.5, 0.2],
    ],
    "franka-panda": [
        [0, -0.5, 0, -2.0, 0, 1.6, 0.8],
        [0.5, -0.2, 0.1, -1.7, 0.1, 1.5, 0.5],
        [0.9, -0.6, 0, -2.2, 0, 1.7, 0.2],
        [1.3, -0.1, 0.2, -1.6, 0.1, 1.4, 0.6],
    ],
    "kinova-gen3": [
        [0, 0.3, 0, 1.8, 0, 1.0, 0],
        [0.5, 0.6, 0.1, 1.5, 0.1, 0.9, 0.3],
        [0.9, 0.2, 0, 2.0, 0, 1.1, 0.6],
        [1.3, 0.7, 0.2, 1.4, 0.1, 0.8, 0.2],
    ],
}
_PAPER = "six-axis"
_STAND_INS = ("ur5e", "kinova-gen3")
_ASKED: dict[str, dict[str, Any]] = {
    "tool-250": {"tool_speed": 0.25},
    "tool-1000": {"tool_speed": 1.0},
    "torque-100": {"torque": "100 %"},
    "torque-60": {"torque": "60 %"},
    "payload": {"torque": "100 %"},
}
_PROBLEMS = [(arm, asked) for arm in _POSES for asked in _ASKED]
_PROBLEMS += [(_PAPER, asked) for asked in _ASKED if "torque" not in _ASKED[asked]]
_NAME = re.compile(rf"arms-(?P<arm>{'|'.join([*_POSES, _PAPER])})-(?P<asked>[\w-]+)")


def near(name: str) -> Problem:
    """Return four poses of a built-in arm that are a hand's way apart, without jerk limits."""
    arm = robots.arm(name)
    return Problem(
        _POSES[name],
        arm.limits.without("jerk"),
        f"{name}-near",
        joint_names=arm.joint_names,
        joint_units=["rad"] * len(arm.joint_names),
        chain=arm.chain,
    )


def paper() -> Problem:
    """Return the problem `six-axis` with the link frames of its paper."""
    problem = Problem.from_toml(built_in.files("problems")[_PAPER])
    return replace(problem, chain=Robot.from_toml(built_in.files("kinematics")[_PAPER]).chain)


def fast(problem: Problem) -> Problem:
    """Return a problem whose acceleration limits are `FAST`."""
    own = Acceleration.read([FAST] * problem.joints, problem.joints)
    return replace(problem, limits=problem.limits.with_limit(own))


def _made(name: str, asked: str) -> Problem:
    problem = paper() if name == _PAPER else near(name)
    if "torque" in _ASKED[asked] and name in _STAND_INS:
        problem = fast(problem)
    chain = problem.chain
    assert chain is not None
    if asked == "payload":
        chain = chain.carrying({"mass": chain.known_masses("masses", name).payload})
    return replace(
        problem,
        limits=Limits(**problem.limits.kinds, **_ASKED[asked]),
        name=f"arms-{name}-{asked}",
        source=source("arms", f"version {VERSION}"),
        chain=chain,
    )


def _stream() -> Iterator[Problem]:
    for name, asked in _PROBLEMS:
        yield _made(name, asked)


def _named(name: str) -> Problem | None:
    match = _NAME.fullmatch(name)
    return _made(*match.groups()) if match and match.groups() in _PROBLEMS else None


SUITE = Suite("arms", "arms with tool speed and torque limits", VERSION, _stream, _named)
