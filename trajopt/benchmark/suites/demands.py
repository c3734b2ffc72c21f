"""Problems of times, waits, loops and waypoints within tolerance: closed forms, and random ones.

The random ones are those of `families` with one demand more, by a number and `VERSION` the same on
every machine.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from trajopt.benchmark.suites import families
from trajopt.benchmark.suites.suite import closed_forms, made_and_drawn
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.planners.rest_to_rest import stop_times

# Raise it whenever a problem changes.
VERSION = 1

KINDS = ("tolerance", "least_times", "dwell", "closed", "given_times")
RANDOM = 200  # by default, 40 of each kind, every other one with jerk limits
_SHARES = (0.001, 0.01, 0.05, 0.2)  # tolerances, of each joint's largest displacement

_FAST, _SLOW = Limits([9.0], [1.0]), Limits([1.0], [2.0])
_CLOSED_FORMS: dict[str, tuple[Any, Limits, dict[str, Any]]] = {
    # there and back between rests, 0.85 rad each way: 2 (0.85 + 0.5) s
    "turn": ([[0.0], [1.0], [0.0]], _SLOW, {"tolerance": 0.15}),
    # boxes that overlap on a straight line: from rest to rest over 2 rad, 3 s
    "instant": (
        [[0.0, 0.0], [1.05, 0.95], [0.95, 1.05], [2.0, 2.0]],
        Limits([1.0, 1.0], [1.0, 1.0]),
        {"tolerance": 0.1},
    ),
    # 2 s where 5 are the least
    "slow": ([[0.0], [1.0]], _FAST, {"least_times": [5.0]}),
    # 2 √(h/A) twice, and the wait: 4.5 s
    "wait": ([[0.0], [1.0], [2.0]], _FAST, {"dwell": [0.0, 0.5, 0.0]}),
    # at rest where it turns, twice: 4 s
    "loop": ([[0.0], [1.0], [0.0]], _FAST, {"closed": True}),
    # the least time is 2.828427 s
    "given": ([[0.0], [1.0], [2.0]], _FAST, {"given_times": [1.5, 1.5]}),
}


def draw(index: int) -> Problem:
    """Draw random problem number `index`: 1 to 4 joints, 3 to 6 waypoints."""
    kinds = len(KINDS)
    base = families.for_suite("demands", VERSION, index, fewest_waypoints=3, kinds=kinds, digits=3)
    rng = np.random.default_rng([VERSION, 50, index])
    points, demand = _demand(KINDS[index % kinds], base, rng)
    return replace(base, waypoints=points, demands=demand)


def _demand(kind: str, base: Problem, rng: np.random.Generator) -> tuple[Array, dict[str, Any]]:
    """The waypoints, and one demand with numbers of three digits."""
    points = base.waypoints
    stops = stop_times(base)
    if kind == "closed":
        return np.vstack([points, points[:1]]), {kind: True}
    if kind == "tolerance":
        row = rng.choice(_SHARES) * base.largest_displacements
        return points, {kind: [_short(own) for own in row]}
    chosen = rng.random(len(stops)) < 0.5
    chosen[0] |= not chosen.any()
    if kind == "least_times":
        return points, {kind: [_short(own) for own in chosen * stops * rng.uniform(0.5, 2)]}
    if kind == "given_times":
        return points, {kind: [_short(own) for own in stops * rng.uniform(1.0, 1.5, len(stops))]}
    waits = 0.2 * stops.mean() * rng.random(len(stops) - 1)
    return points, {kind: [0.0, *(_short(own) for own in waits), 0.0]}


def _short(number: float) -> float:
    """The number in three digits, rounded up: the same on every machine."""
    if not number:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(number)) - 2)
    return float(f"{np.ceil(number / unit - 1e-6) * unit:.3g}")


SUITE = made_and_drawn(
    "demands",
    "problems of times, waits, loops and waypoints within tolerance",
    VERSION,
    closed_forms("demands", _CLOSED_FORMS),
    draw,
    RANDOM,
)
