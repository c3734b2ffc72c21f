"""Degenerate problems, one kind each: tiny, but for the two that are about size."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from trajopt.problem import Limits, Problem

# Raise it whenever a degenerate problem changes.
EDGES_VERSION = 1

_PREFIX = "edges-"
_UNIT: dict[str, Any] = {"velocity": 1.0, "acceleration": 2.0}


def stream() -> Iterator[Problem]:
    """All of them, in their order."""
    for name in _EDGES:
        yield _made(name)


def named(name: str) -> Problem | None:
    """The problem of this name, or None."""
    key = name.removeprefix(_PREFIX)
    if not name.startswith(_PREFIX) or key not in _EDGES:
        return None
    return _made(key)


def _made(name: str) -> Problem:
    description, waypoints, own_limits = _EDGES[name]
    rows = np.array(waypoints, dtype=float)
    joints = rows.shape[1]
    limits = {kind: _each(value, joints) for kind, value in (_UNIT | own_limits).items()}
    return Problem(
        rows,
        Limits(**limits),
        name=f"{_PREFIX}{name}",
        source=f"trajopt.benchmark.suites.edges, degenerate on purpose: {description}",
    )


def _each(value: Any, joints: int) -> Any:
    """A single number or pair is every joint's."""
    return [value] * joints if isinstance(value, float | tuple) else value


_ABC = [[0.0, 0.0], [1.0, -0.5], [0.4, 0.6]]  # an ordinary path, where the path is not the point
_STEP = [[0.0, 0.0], [1.0, 1.0]]
_SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
_TURN = np.arange(50) % 7  # a sawtooth: six steps one way, one back
_INF = float("inf")

# What it is, waypoints, and the limits that differ from 1 rad/s and 2 rad/s².
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
