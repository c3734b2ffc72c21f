"""Degenerate problems, one kind each: tiny, but for the two that are about size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trajopt.core.problem import Limits, Problem

# Raise it whenever a degenerate problem changes.
EDGES_VERSION = 1

_PREFIX = "edges-"
# rad/s and rad/s², where a problem has no limits of its own
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
    edge = _EDGES[name]
    rows = np.array(edge.waypoints, dtype=float)
    joints = rows.shape[1]
    limits = _UNIT | edge.limits
    pairs = {kind: _each(value, joints) for kind, value in limits.items()}
    return Problem(
        rows,
        Limits(**pairs),
        name=f"{_PREFIX}{name}",
        source=f"trajopt.benchmark.suites.edges, degenerate on purpose: {edge.description}",
    )


def _each(value: Any, joints: int) -> Any:
    """A single number or pair is every joint's."""
    if isinstance(value, float | tuple):
        return [value] * joints
    return value


@dataclass(frozen=True)
class _Edge:
    """What is degenerate, waypoints in rad, and the limits that differ from `_UNIT`."""

    description: str
    waypoints: Any
    limits: dict[str, Any] = field(default_factory=dict)


# An ordinary path, where the path is not the point.
_ABC = [[0.0, 0.0], [1.0, -0.5], [0.4, 0.6]]
_SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
_COUNT = np.arange(50)
_SAWTOOTH = _COUNT % 7  # six steps one way, one back
_NEXT_TO_ONE = np.nextafter(1, 2)
_INF = float("inf")


def _pattern(joint: int, row: int) -> float:
    return (joint * row * row + 2 * row) % 13 / 4


_EDGES: dict[str, _Edge] = {
    "two-waypoints": _Edge(
        "one segment, from rest to rest",
        waypoints=[[0, 0], [1, -0.5]],
    ),
    "one-joint-two-waypoints": _Edge(
        "as little as there can be",
        waypoints=[[0], [1]],
    ),
    "twelve-joints": _Edge(
        "twelve joints, each with its own pattern",
        waypoints=[[_pattern(joint, row) for joint in range(1, 13)] for row in range(4)],
    ),
    "fifty-waypoints": _Edge(
        "forty-nine segments",
        waypoints=np.stack([_SAWTOOTH, _COUNT], axis=1) / 4,
    ),
    "repeated-first": _Edge(
        "the first waypoint twice",
        waypoints=[_ABC[0], *_ABC],
    ),
    "repeated-last": _Edge(
        "the last waypoint twice",
        waypoints=[*_ABC, _ABC[-1]],
    ),
    "repeated-all-but-last": _Edge(
        "one waypoint four times, then another",
        waypoints=[[0, 0]] * 4 + [[1, 1]],
    ),
    "out-and-back": _Edge(
        "there and back to the first waypoint",
        waypoints=[[0, 0], [1, 0.5], [0, 0]],
    ),
    "palindrome": _Edge(
        "a path and the same one backwards",
        waypoints=[*_ABC, *_ABC[1::-1]],
    ),
    "path-twice": _Edge(
        "a closed path twice over",
        waypoints=[*_SQUARE, *_SQUARE, [0, 0]],
    ),
    "one-of-six-moves": _Edge(
        "five joints never move",
        waypoints=[[0.3, -1, q, 0, 2, 0.5] for q in (0, 1, 0.2, 0.7)],
    ),
    "one-segment-each": _Edge(
        "each joint moves in one segment only",
        waypoints=[[0, 0], [1, 0], [1, 1]],
    ),
    "twins": _Edge(
        "two joints do the same",
        waypoints=[[q, q] for q in (0, 1, 0.4)],
    ),
    "mirrored": _Edge(
        "two joints do the opposite",
        waypoints=[[q, -q] for q in (0, 1, 0.4)],
    ),
    "straight": _Edge(
        "a straight line in equal steps",
        waypoints=[[q, 2 * q] for q in (0, 0.5, 1, 1.5)],
    ),
    "zigzag": _Edge(
        "both joints turn back at every waypoint",
        waypoints=[[0, 1], [1, 0]] * 4,
    ),
    "tiny": _Edge(
        "every displacement is 1e-9 rad or less",
        waypoints=1e-9 * np.array(_ABC),
    ),
    "huge": _Edge(
        "displacements of 1e4 rad",
        waypoints=1e4 * np.array(_ABC),
    ),
    "tiny-beside-huge": _Edge(
        "1e-9 rad, then 1e4 rad",
        waypoints=[[0, 0], [1e-9, 1e-9], [1e4, 5e3]],
    ),
    "one-ulp": _Edge(
        "a displacement of one rounding unit",
        waypoints=[[0], [1], [_NEXT_TO_ONE], [2]],
    ),
    "far-from-zero": _Edge(
        "ordinary displacements, 1e6 rad away",
        waypoints=1e6 + np.array(_ABC),
    ),
    "million-to-one": _Edge(
        "limits a million to one apart",
        waypoints=_ABC,
        limits={
            "velocity": [1e-3, 1e3],
            "acceleration": [1e-3, 1e3],
        },
    ),
    "slow": _Edge(
        "limits of 1e-6",
        waypoints=_ABC,
        limits={
            "velocity": 1e-6,
            "acceleration": 1e-6,
        },
    ),
    "fast": _Edge(
        "limits of 1e6",
        waypoints=_ABC,
        limits={
            "velocity": 1e6,
            "acceleration": 1e6,
        },
    ),
    "velocity-never-reached": _Edge(
        "velocity limits without effect",
        waypoints=_ABC,
        limits={
            "velocity": 1e3,
        },
    ),
    "velocity-always-reached": _Edge(
        "velocity is reached at once",
        waypoints=_ABC,
        limits={
            "acceleration": 1e6,
        },
    ),
    "asymmetric": _Edge(
        "limits a hundred times tighter one way",
        waypoints=_ABC,
        limits={
            "velocity": (-0.05, 5.0),
            "acceleration": (-0.1, 10.0),
        },
    ),
    "jerk-soft": _Edge(
        "jerk limits so soft that no other is reached",
        waypoints=_ABC,
        limits={
            "jerk": 0.5,
        },
    ),
    "jerk-stiff": _Edge(
        "jerk limits almost without effect",
        waypoints=_ABC,
        limits={
            "jerk": 2e5,
        },
    ),
    "jerk-one-joint": _Edge(
        "jerk limits on one joint only",
        waypoints=_ABC,
        limits={
            "jerk": [10.0, _INF],
        },
    ),
    "jerk-asymmetric": _Edge(
        "jerk limits ten times tighter one way",
        waypoints=_ABC,
        limits={
            "jerk": (-4.0, 40.0),
        },
    ),
    "jerk-one-side": _Edge(
        "jerk limits one way only: no optimum",
        waypoints=_ABC,
        limits={
            "jerk": (-10.0, _INF),
        },
    ),
    "jerk-at-rest": _Edge(
        "a jerk limit on a joint that never moves",
        waypoints=[[0, 0], [1, 0], [2, 0]],
        limits={
            "jerk": [_INF, 10.0],
        },
    ),
    "at-position-limit": _Edge(
        "waypoints on the position limits",
        waypoints=_ABC,
        limits={
            "position": [[0.0, 1.0], [-0.5, 0.6]],
        },
    ),
    "corridor": _Edge(
        "position limits so near that no joint can overshoot",
        waypoints=[[0, 0], [1, 1e-6], [0.5, 0]],
        limits={
            "position": [[-1e-6, 1 + 1e-6], [-1e-6, 2e-6]],
        },
    ),
    "position-one-side": _Edge(
        "a position limit one way only",
        waypoints=_ABC,
        limits={
            "position": [[-_INF, 1.0], [-_INF, _INF]],
        },
    ),
    "jerk-and-position": _Edge(
        "every kind of limit",
        waypoints=_ABC,
        limits={
            "jerk": 20.0,
            "position": [[0.0, 1.0], [-0.5, 0.6]],
        },
    ),
}
