"""Mixed demands: two to five at once, and parts of optimal motions.

A drawn problem combines tolerances that may overlap, least or given times, waits, a closed motion,
states in motion at either end, and limits per segment. Every other one has jerk limits. The index
and `VERSION` determine a problem on every machine.

A part is an optimal motion of a drawn problem, cut at a controller's cycle in the state that the
motion has there. Its numbers depend on a planner's last digits, so the files that
`experiments.mixes` wrote are stored.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from trajopt.benchmark.suites.suite import made_and_drawn, source
from trajopt.core import built_in
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners.rest_to_rest import stop_times

# Raise it whenever a problem changes.
VERSION = 1
DRAWN = 12  # by default
_MOST_CELLS = 24  # segments times joints
# Tolerances, relative to each joint's largest displacement; with the larger ones boxes overlap.
_SHARES = (0.001, 0.02, 0.1, 0.3)
_MOST_VELOCITY = 0.6  # largest velocity at an end, relative to its limit
_LEAST_LIMIT = 0.3  # least limit of a segment, relative to the whole problem's
# Demands that exclude each other: a closed motion has no ends, and given times fix all times.
_APART = (
    {"closed", "start"},
    {"closed", "end"},
    {"closed", "dwell"},
    {"given_times", "least_times"},
    {"given_times", "start"},
    {"given_times", "end"},
)
# How often each demand is drawn, relative to the others.
_WEIGHTS = {
    "tolerance": 5,
    "segments": 4,
    "start": 4,
    "end": 4,
    "least_times": 3,
    "dwell": 1,
    "closed": 1,
    "given_times": 1,
}

Generator = np.random.Generator


def draw(index: int) -> Problem:
    """Draw problem number `index`: 2 to 7 joints, 2 to 12 waypoints; odd ones have jerk limits."""
    rng = np.random.default_rng([VERSION, 60, index])
    joints = int(rng.integers(2, 8))
    segments = int(rng.integers(1, 1 + min(11, _MOST_CELLS // joints)))
    steps = np.vstack([rng.uniform(-1, 1, joints), rng.normal(0, 0.8, (segments, joints))])
    V, A = (np.round(rng.uniform(low, high, joints), 2) for low, high in ((0.5, 3), (1, 8)))
    J = np.round(A * rng.uniform(4, 30, joints), 1) if index % 2 else None
    base = Problem(np.round(np.cumsum(steps, axis=0), 4), Limits(V, A, J))
    drawn = mixed(base, rng, f"mixes-random-{index:02}")
    return replace(drawn, source=source("mixes", f"version {VERSION}, index {index}"))


def mixed(base: Problem, rng: Generator, name: str) -> Problem:
    """Return a problem from rest to rest with two to five demands more."""
    chosen = _chosen(rng, base.segments)
    points = base.waypoints
    if "closed" in chosen:
        points = np.vstack([points, points[:1]])
    limits = base.limits
    segments, joints = len(points) - 1, base.joints
    if "segments" in chosen:
        shares = _LEAST_LIMIT + (1 - _LEAST_LIMIT) * rng.random((3, segments, joints, 1))
        pairs = zip((limits.velocity, limits.acceleration, limits.jerk), shares, strict=True)
        velocity, acceleration, jerk = (own * share for own, share in pairs)
        limits = Limits(velocity, acceleration, jerk if base.has("jerk") else None)
    plain = replace(base, waypoints=points, limits=limits)
    stops = stop_times(plain)
    demands: dict[str, Any] = {}
    if "closed" in chosen:
        demands["closed"] = True
    if "tolerance" in chosen:
        row = rng.choice(_SHARES) * base.largest_displacements
        demands["tolerance"] = _short(row)
    if "least_times" in chosen:
        some = rng.random(segments) < 0.5
        demands["least_times"] = _short(some * stops * (0.3 + rng.random(segments)))
    if "given_times" in chosen:
        demands["given_times"] = _short(stops * (1 + 0.5 * rng.random(segments)))
    if "dwell" in chosen:
        waits = 0.2 * stops.mean() * rng.random(segments - 1)
        demands["dwell"] = np.array([0.0, *_short(waits * (rng.random(segments - 1) < 0.5)), 0.0])
        if "tolerance" in chosen:  # a motion waits at its waypoint exactly
            rows = np.tile(demands["tolerance"], (segments + 1, 1))
            demands["tolerance"] = np.where(demands["dwell"][:, None] > 0, 0.0, rows)
            demands["tolerance"][[0, -1]] = 0.0
    for end, segment in (("start", 0), ("end", -1)):
        if end in chosen:
            demands |= _state(plain, end, segment, rng)
    return replace(plain, name=name, demands=demands)


def _chosen(rng: Generator, segments: int) -> set[str]:
    """Draw two to five demands that go together."""
    weights = np.array(list(_WEIGHTS.values())) / sum(_WEIGHTS.values())
    order = rng.choice(list(_WEIGHTS), len(weights), replace=False, p=weights).tolist()
    count = 2 + int(rng.integers(4))
    between = {"tolerance", "dwell"}  # they ask for a waypoint between the ends
    chosen: set[str] = set()
    for key in order:
        possible = (segments > 1 or key not in between) and not (segments == 1 and key == "closed")
        if possible and not any(own <= chosen | {key} for own in _APART) and len(chosen) < count:
            chosen.add(key)
    return chosen


def _state(problem: Problem, end: str, segment: int, rng: Generator) -> dict[str, Array]:
    """Draw a velocity and an acceleration at an end from which the joint exceeds no limit."""
    limits = problem.limits
    V, A, J = (
        np.abs(own.reshape(-1, problem.joints, 2)[segment]).min(axis=1)
        for own in (limits.velocity, limits.acceleration, limits.jerk)
    )
    velocity = _MOST_VELOCITY * V * (2 * rng.random(len(V)) - 1)
    found = {f"{end}_velocity": velocity}
    if problem.has("jerk"):
        room = 0.8 * (V - np.abs(velocity))
        most = np.minimum(A, np.sqrt(2 * J * room))
        found[f"{end}_acceleration"] = 0.5 * most * (2 * rng.random(len(V)) - 1)
    return found


def _short(numbers: Array) -> Array:
    """Return the numbers in three digits, rounded up: the same on every machine."""
    found = [
        float(f"{np.ceil(own / unit - 1e-6) * unit:.3g}")
        for own in np.ravel(numbers)
        for unit in [10.0 ** (np.floor(np.log10(own or 1.0)) - 2)]
    ]
    return np.reshape(found, np.shape(numbers))


def inherited(problem: Problem) -> dict[str, Array]:
    """Return the demands that a part of a motion keeps: all but loops, waits and given times."""
    lost = ("closed", "dwell", "given_times")
    return {key: own for key, own in problem.demands.items() if key not in lost}


def halves(problem: Problem, motion: Trajectory, time: float) -> tuple[Problem, Problem]:
    """Return the problems before and after a time within a segment, in the motion's state."""
    times = motion.waypoint_times
    segment = int(np.searchsorted(times, time)) - 1
    limits = problem.limits.of_segments(np.array([segment]))
    rates = {"velocity": limits.velocity, "acceleration": limits.acceleration}
    inside = {
        kind: np.clip(motion(time, order), *own.reshape(problem.joints, 2).T)
        for order, (kind, own) in enumerate(rates.items(), start=1)
        if order == 1 or problem.has("jerk")
    }
    found = []
    for end, other, kept, first in (
        ("end", "start", times < time, True),
        ("start", "end", times > time, False),
    ):
        own = {
            f"{other}_{kind}": problem.route.demand(f"{other}_{kind}")
            for kind in inside
            if f"{other}_{kind}" in problem.demands
        }
        own |= {f"{end}_{kind}": state for kind, state in inside.items()}
        rows = [problem.waypoints[kept], motion(time)[None]]
        exact = np.zeros((1, problem.joints))
        boxes = [problem.route.demand("tolerance")[kept], exact]
        numbers = np.arange(segment + 1) if first else np.arange(segment, problem.segments)
        least = np.where(numbers == segment, 0.0, problem.route.demand("least_times")[numbers])
        order = slice(None) if first else slice(None, None, -1)
        own |= {"tolerance": np.vstack(boxes[order]), "least_times": least}
        part = problem.limits.of_segments(numbers)
        name = f"{problem.name} {'before' if first else 'after'} {time:.6g} s"
        found.append(Problem(np.vstack(rows[order]), part, name, demands=own))
    return found[0], found[1]


def _part(key: str) -> Problem:
    return Problem.from_toml(built_in.files("mixes")[f"mixes-{key}"])


SUITE = made_and_drawn(
    "mixes",
    "two to five demands at once, and parts of optimal motions",
    VERSION,
    {
        name.removeprefix("mixes-"): partial(_part, name.removeprefix("mixes-"))
        for name in built_in.files("mixes")
    },
    draw,
    DRAWN,
)
