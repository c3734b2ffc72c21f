"""Is an answer to mixed demands certified, monotone, and as short as the parts of its motion?

    python tests/soak.py mixes           # 1000 problems, hours on a core
    python tests/soak.py mixes --quick   # 6 problems

Random problems ask for two to five things at once: tolerances that may overlap, least or given
times, waits, a loop, states in motion at either end, limits per segment; every other one has jerk
limits. Three relations are checked:

- An answer is `solved` if and only if the judge certifies its motion.
- A wider tolerance, wider limits and smaller least times never take longer.
- The motion is cut in its own state: at a random instant, at a controller's cycle, a millisecond
  after its start and before its end. Each part is planned anew, and takes no longer than it took.

Exit code 1 if a relation does not hold.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from experiments.common.output import say
from soaks import soak_report
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.core.solution import Solution, Status
from trajopt.planners.rest_to_rest import stop_times

THEOREM = 1e-6  # relative; tolerance of solvers
CYCLE_S = 1e-3
WIDER = 1.3
# Tolerances of each joint, of its largest displacement; with the larger ones boxes overlap.
_SHARES = (0.001, 0.02, 0.1, 0.3)
_MOST_VELOCITY = 0.6  # of its limit
_LEAST_LIMIT = 0.3  # of a segment, of the whole problem's
# What excludes each other: a loop has no ends, and given times leave no others open.
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
_CUT = ("tolerance", "least_times")  # demands that a part of a motion inherits, beside its ends

Generator = np.random.Generator
Check = tuple[str, str, float]  # relation, problem, relative excess


def drawn(seed: int) -> Problem:
    """Return random problem number `seed`: 1 to 3 joints, 3 to 5 waypoints."""
    rng = np.random.default_rng([777, seed])
    joints, segments = int(rng.integers(1, 4)), int(rng.integers(2, 5))
    steps = np.vstack([rng.uniform(-1, 1, joints), rng.normal(0, 0.8, (segments, joints))])
    V, A = rng.uniform(0.5, 3, joints), rng.uniform(1, 8, joints)
    J = A * rng.uniform(4, 30, joints) if seed % 2 else None
    return mixed(Problem(np.cumsum(steps, axis=0), Limits(V, A, J)), rng, f"mix-{seed}")


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
    """Draw a state within the limits of an end's segment, which leads beyond no limit."""
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


def solved(problem: Problem) -> tuple[Solution, float]:
    """Return the answer and its certified duration, s; NaN without one."""
    planner = ExactJerk() if problem.has("jerk") else Exact()
    solution = planner.solve(problem)
    if solution.trajectory is None:
        return solution, np.nan
    return solution, verify(problem, solution.trajectory).certified_duration or np.nan


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


def checks(seed: int) -> Iterator[Check]:
    """Yield every check of a problem."""
    problem = drawn(seed)
    solution, duration = solved(problem)
    is_solved = solution.status is Status.SOLVED
    yield "solved is certified", problem.name, 0.0 if is_solved != np.isnan(duration) else np.inf
    if np.isnan(duration):
        is_proved = solution.status is Status.INFEASIBLE
        yield "answered, or proved infeasible", problem.name, 0.0 if is_proved else np.inf
        return
    for key, wider in _wider(problem):
        yield f"a wider {key} never lengthens", problem.name, solved(wider)[1] / duration - 1
    cut_off = {key: own for key, own in problem.demands.items() if key in _CUT or _is_end(key)}
    whole = replace(problem, demands=cut_off)
    motion, duration = solved(whole)[0].trajectory, solved(whole)[1]
    if motion is None or abs(motion.duration / duration - 1) > THEOREM:
        return
    rng = np.random.default_rng([778, seed])
    instant, cycle = rng.uniform(0.02, 0.98, 2) * motion.duration
    cuts = {
        "at random": instant,
        "at a controller's cycle": round(cycle / CYCLE_S) * CYCLE_S,
        "a cycle after the start": CYCLE_S,
        "a cycle before the end": motion.duration - CYCLE_S,
    }
    for words, time in cuts.items():
        if np.abs(motion.waypoint_times - time).min() < 1e-6 or not 0 < time < motion.duration:
            continue
        try:
            parts = halves(whole, motion, time)
        except InvalidInput:  # a part that stands still is no problem
            continue
        for part, own in zip(parts, (time, motion.duration - time), strict=True):
            yield f"cut {words}", part.name, solved(part)[1] / own - 1


def _is_end(key: str) -> bool:
    return key.startswith(("start_", "end_"))


def _wider(problem: Problem) -> Iterator[tuple[str, Problem]]:
    """Yield the problem with one demand or limit that asks less."""
    for key, factor in (("tolerance", WIDER), ("least_times", 1 / WIDER)):
        if key in problem.demands:
            demands = {**problem.demands, key: factor * problem.demands[key]}
            yield key, replace(problem, demands=demands)
    for key in ("velocity", "acceleration"):
        yield key, replace(problem, limits=problem.limits.widened(key, None, WIDER - 1))


def main(problems: int = 1000, output: Path = Path("results/mixes"), quick: bool = False) -> None:
    """Check every relation on each problem, 6 at most if `quick`; write the table and print it."""
    problems = min(problems, 6) if quick else problems
    say(f"{problems} problems in all")
    rows = [check for seed in range(problems) for check in checks(seed)]
    found = pd.DataFrame(rows, columns=["family", "problem", "excess"])
    broken = ~(found["excess"] <= THEOREM)
    soak_report.conclude(found, broken, output / "mixes")
