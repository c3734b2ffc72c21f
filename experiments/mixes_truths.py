"""Does a method that shares no code with `exact` find the same optima of mixed demands?

    python -m experiments.mixes_truths            # half an hour
    python -m experiments.mixes_truths --quick    # two problems, three guesses each
    python -m experiments.mixes_truths --only mixes-part-01 --guesses 60

Each problem of the suite `mixes` is written once more, straight from its numbers: every joint
passes each segment in pieces of constant acceleration (of constant jerk where that is limited), as
long as it likes. Every optimum can be written so, also one that passes two waypoints at one
instant. IPOPT solves this program from random times. The table has what it finds, what `exact` or
`exact-jerk` finds, and the proved lower bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cyclopts
import numpy as np
import pandas as pd

from baselines.ipopt import Options, Program, flat, program
from experiments.common.output import progress, save_table
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import mixes
from trajopt.core import dwell
from trajopt.core.arrays import Array, Indices
from trajopt.core.problem import Problem
from trajopt.judging.verification import verify
from trajopt.planners.planner import backend
from trajopt.planners.registry import load
from trajopt.planners.rest_to_rest import stop_times

AGREES = 1e-6  # relative
PIECES = {False: 3, True: 8}  # of a joint in a segment, without and with jerk limits
_LONGEST = 1e3  # times the unit of time
_SPREAD = (-0.7, 0.7)  # of the logarithm of a guess's times, from half of those of stopping
_SLOWER = (1.0, 2.0)  # than without jerk limits
_UNEVEN = (0.5, 1.5)  # lengths of a guess's pieces, relative
# Of a guess in which a segment takes no time: what each other segment takes besides its cruise, the
# logarithms of a factor of all times and of a factor of each, and its pieces.
_PAUSE_S = 0.15
_SLOW, _NEARLY, _NEARLY_EVEN = (0.5, 1.5), (-0.2, 0.2), (0.8, 1.2)
_OPTIONS: Options = {
    "tol": 1e-10,
    "constr_viol_tol": 1e-12,
    "acceptable_tol": 1e-9,
    "acceptable_constr_viol_tol": 1e-11,
    "bound_relax_factor": 0.0,
    "max_iter": 2000,
}


class Motions(NamedTuple):
    """All motions of a problem without waits, as a program in units of its own.

    Attributes:
        problem: The problem.
        solver: IPOPT on the program.
        low, high: Bounds of the variables: the segments' times come first, then the pieces'
            lengths.
        constraints: Lowest and highest values of the constraints.
        stopping: Times of the segments with stops at both ends.
        at_once: Segments that may take no time, as the boxes of their ends overlap.
        shape: Pieces, segments, joints.
        unit: Of time, s.
        way: Unit of each joint's position.
    """

    problem: Problem
    solver: Program
    low: Array
    high: Array
    constraints: tuple[Array, Array]
    stopping: Array
    at_once: Indices
    shape: tuple[int, int, int]
    unit: float
    way: Array

    def least(
        self, rng: np.random.Generator, times: Array | None = None, no_time: int | None = None
    ) -> Array | None:
        """Return the segments' times of the optimum near a guess, s; None where it fails.

        Args:
            rng: Draws the guess.
            times: Of the segments, s; None: random ones.
            no_time: A segment that takes none; then the guess is slow, with places and velocities.
        """
        pieces, segments, joints = self.shape
        size = pieces * segments * joints
        low, high = self.low.copy(), self.high.copy()
        uneven, moving = _UNEVEN, np.zeros(0)
        if no_time is not None:
            high[[no_time, *range(segments + no_time, segments + size, segments)]] = 0.0
            times, moving = self.slow(rng)
            uneven = _NEARLY_EVEN
        elif times is None:
            times = 0.5 * self.stopping * np.exp(rng.uniform(*_SPREAD, segments))
        else:
            times = times * rng.uniform(*_SLOWER) / self.unit
        times = np.clip(times, self.low[:segments], self.high[:segments])
        lengths = times[:, None] / pieces * rng.uniform(*uneven, self.shape)
        start = np.clip(0.0, low, high)
        start[: segments + size] = flat(times, *lengths)
        after = segments + 2 * size  # lengths, and what is constant in the pieces
        start[after : after + len(moving)] = moving
        start = np.clip(start, low, high)
        run = self.solver(start, np.zeros(0), (low, high), self.constraints)
        return self.unit * run.x[:segments] if run.success else None

    def slow(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return random slow times, and places in the boxes with velocities, without units."""
        route, tolerance = self.problem.route, self.problem.route.demand("tolerance")
        box = route.waypoints - tolerance, route.waypoints + tolerance
        places = route.waypoints + tolerance * rng.uniform(-1, 1, route.waypoints.shape)
        for _ in range(rng.integers(0, 6)):  # towards the chord of the neighbours
            middle = (places[:-2] + places[2:]) / 2
            places[1:-1] = np.clip(middle, box[0][1:-1], box[1][1:-1])
        steps = np.diff(places, axis=0)
        fastest = np.broadcast_to(self.problem.limits.velocity, (*steps.shape, 2))
        times = (np.abs(steps) / np.abs(fastest).min(axis=2)).max(axis=1) + _PAUSE_S
        times *= np.exp(rng.uniform(*_SLOW))
        times *= np.exp(rng.uniform(*_NEARLY, len(times)))
        mean = steps / times[:, None]
        inner = 0.5 * (mean[:-1] + mean[1:]) / 2 * rng.uniform(0, 1)
        velocity = np.vstack([route.start.velocity, inner, route.end.velocity])
        return times / self.unit, flat(places / self.way, velocity * self.unit / self.way)


def motions(problem: Problem) -> Motions:
    """Return the motions of a problem without waits; its joints all have a jerk limit, or none."""
    ca = backend("casadi")
    route, (segments, joints) = problem.route, problem.displacements.shape
    jerky = bool(problem.limits.jerk_limited.all())
    pieces = PIECES[jerky]
    closed = bool(route.demand("closed"))
    given = [
        np.broadcast_to(own, (segments, joints, 2))
        for own in (problem.limits.velocity, problem.limits.acceleration, problem.limits.jerk)
    ][: 2 + jerky]
    unit, way = _units(problem, given)
    rates = [unit**order / way for order in (1, 2, 3)]
    V, A, *J = (own * rate[:, None] for own, rate in zip(given, rates, strict=False))

    variables: list[Any] = []
    lows: list[Array] = []
    highs: list[Array] = []

    def table(low: Array, high: Array) -> Any:
        variables.append(ca.SX.sym("table", *low.shape))
        lows.append(low)
        highs.append(high)
        return variables[-1]

    def states(limits: Array, ends: Sequence[Array]) -> Any:
        """Return a derivative at the waypoints, under the limits of both segments."""
        low, high = limits[..., 0], limits[..., 1]
        low = np.vstack([low[:1], np.maximum(low[:-1], low[1:]), low[-1:]])
        high = np.vstack([high[:1], np.minimum(high[:-1], high[1:]), high[-1:]])
        if not closed:
            low[[0, -1]] = high[[0, -1]] = ends
        return table(low, high)

    least = (route.demand("least_times") + route.demand("given_times"))[:, None] / unit
    timed = "given_times" in route.demands
    times = table(least, least if timed else np.full_like(least, _LONGEST))
    size = np.zeros((segments, joints))
    lengths = [table(size, size + _LONGEST) for _ in range(pieces)]
    constant = [table(*np.moveaxis((J or [A])[0], -1, 0)) for _ in range(pieces)]
    tolerance = route.demand("tolerance")
    place = table((route.waypoints - tolerance) / way, (route.waypoints + tolerance) / way)
    start, end = route.start, route.end
    velocity = states(V, [start.velocity * rates[0], end.velocity * rates[0]])
    bend: Any = (
        states(A, [start.acceleration * rates[1], end.acceleration * rates[1]]) if jerky else 0
    )

    constraints: list[Any] = []
    bounds: list[tuple[Array, Array]] = []

    def within(expression: Any, limits: Array) -> None:
        constraints.append(expression)
        bounds.append((limits[..., 0], limits[..., 1]))

    none = np.zeros((segments, joints, 2))
    q, v = place[:-1, :], velocity[:-1, :]
    a: Any = bend[:-1, :] if jerky else 0
    for d, own in zip(lengths, constant, strict=True):
        if jerky:
            within(v + a * d / 2, V)  # the control point between both ends of the velocity
            q, v, a = (
                q + d * (v + d * (a / 2 + d * own / 6)),
                v + d * (a + d * own / 2),
                a + d * own,
            )
            within(a, A)
        else:
            q, v = q + d * (v + d * own / 2), v + d * own
        within(v, V)
    within(q - place[1:, :], none)
    within(v - velocity[1:, :], none)
    within(sum(lengths) - ca.repmat(times, 1, joints), none)
    if jerky:
        within(a - bend[1:, :], none)
    if closed:
        for own in (velocity, bend) if jerky else (velocity,):
            within(own[0, :] - own[-1, :], none[:1])
    solver = program("truth", variables, [], ca.sum1(times), constraints, _OPTIONS)
    low, high = (flat(*(pair[side] for pair in bounds)) for side in (0, 1))
    shape = (pieces, segments, joints)
    stopping = stop_times(problem.without(*problem.demands)) / unit
    box = [route.waypoints + sign * tolerance for sign in (-1, 1)]
    overlap = np.maximum(box[0][:-1], box[0][1:]) <= np.minimum(box[1][:-1], box[1][1:])
    at_once = np.flatnonzero(overlap.all(axis=1) & (least[:, 0] == 0))
    ends = flat(*lows), flat(*highs), (low, high)
    return Motions(problem, solver, *ends, stopping, at_once, shape, unit, way)


def _units(problem: Problem, limits: Sequence[Array]) -> tuple[float, Array]:
    """Return a time in which a segment is about passed, s, and each joint's way in it, rad."""
    sizes = [np.abs(own).min(axis=(0, 2)) for own in limits]
    far = np.abs(problem.displacements)
    passed = [
        far / sizes[0],
        2 * np.sqrt(far / sizes[1]),
        *(np.cbrt(32 * far / own) for own in sizes[2:]),
    ]
    unit = float(np.max(passed, axis=0).max(axis=1).mean())
    return unit, np.min([own * unit**order for order, own in enumerate(sizes, start=1)], axis=0)


def optima(
    problem: Problem, guesses: int, rng: np.random.Generator, times: Array | None = None
) -> list[Array]:
    """Return the segments' times of the optima that guesses lead to, s, the shortest first.

    Args:
        problem: Without waits.
        guesses: How many.
        rng: Draws them.
        times: Of every other guess, to be slowed; None: of none.
    """
    own = motions(problem)
    # in turn all segments take time, or one of those that may take none does
    none = [None, *own.at_once.tolist()]
    tried = (
        own.least(rng, times if k % 2 else None, none[k // 2 % len(none)]) for k in range(guesses)
    )
    return sorted((found for found in tried if found is not None), key=np.sum)


def found(problem: Problem, guesses: int, rng: np.random.Generator) -> tuple[float, int]:
    """Return the shortest duration, s, and how many guesses lead there, for the hardest part."""
    total, fewest = float(problem.route.demand("dwell").sum()), guesses
    for part in dwell.parts(problem):
        faster = optima(part.without("jerk"), guesses, rng) if part.has("jerk") else []
        known = optima(part, guesses, rng, faster[0] if faster else None)
        durations = np.array([own.sum() for own in known])
        total += durations.min(initial=np.inf)
        fewest = min(fewest, int((durations <= durations.min(initial=np.inf) * (1 + AGREES)).sum()))
    return total, fewest


def row(problem: Problem, guesses: int) -> dict[str, Any]:
    """Return the values of one problem side by side."""
    name = "exact-jerk" if problem.has("jerk") else "exact"
    motion = load(name).solve(problem).trajectory
    certified = np.inf if motion is None else verify(problem, motion).certified_duration or np.inf
    other, agree = found(problem, guesses, np.random.default_rng(0))
    bound = records.bound(problem)
    return {
        "problem": problem.name,
        "planner": name,
        "certified, s": certified,
        "IPOPT above it": other / certified - 1,
        "guesses that lead to IPOPT's": agree,
        "bound below it": None if bound is None else 1 - bound / certified,
    }


def main(
    guesses: int = 12,
    only: tuple[str, ...] = (),
    output: Path = Path("results"),
    quick: bool = False,
) -> None:
    """Write a row per problem of the suite.

    Args:
        guesses: Of IPOPT, for each part between waits.
        only: Names of problems; all by default.
        output: Folder of the table.
        quick: Two problems, three guesses.
    """
    asked = [own for own in mixes.SUITE.problems() if not only or own.name in only]
    asked = [asked[0], asked[-1]] if quick else asked
    with progress(len(asked), "problems") as advance:
        rows = []
        for problem in asked:
            rows.append(row(problem, 3 if quick else guesses))
            save_table(pd.DataFrame(rows), output / "mixes-truths")
            advance(1)


if __name__ == "__main__":
    cyclopts.run(main)
