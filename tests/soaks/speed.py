"""How fast is it beside its peers? Ratios side by side, in one process, in CPU seconds.

    python tests/soak.py speed            # a minute
    python tests/soak.py speed --quick    # seconds; the numbers are not accurate

Each row is one way to do a task; `times the first` is its cost over that of the task's first row.
There are three tasks. One is an evaluation of the 3-5-3 fitness within a search; only our searches
pass the incumbent, so that most candidates need no exact peaks. The second is the minimum time,
with the error reached. The third is a verdict on a trajectory, exact, or with samples as dense as
the verifier's tolerance requires. CPU seconds are the least of several repeats. The table goes to
`speed.csv` and `.md` in `--output`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.interpolate import PPoly
from scipy.optimize import differential_evolution

from experiments.common.output import save_table, say
from trajopt.benchmark.suites import catalogue
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.judging.certificate import Tolerance
from trajopt.judging.verification import verify
from trajopt.planners.objective import Objective
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.planners.swarm import Compared, minimise
from trajopt.planners.swarm_planner import SegmentTimes, SwarmPlanner

POPULATION = 30  # the paper's
SEEDS_TOGETHER = 30  # as a comparison advances them
INTERVALS: tuple[int, ...] = (20, 80, 160)  # of collocation, per segment
REPEATS = 3  # repeats of long tasks; short ones have ten times as many
_SECONDS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6}


Row = dict[str, Any]  # task, way, cost, unit (what is counted), note (what it reached or lacks)


class Way(NamedTuple):
    """A call to be timed, which does its task `times` times."""

    name: str
    call: Callable[[], object]
    note: str = ""
    times: int = 1


def side_by_side(task: str, ways: Sequence[Way], unit: str, repeats: int) -> Iterator[Row]:
    """Return the least CPU time of each way; they take turns, as a machine's speed varies."""
    for way in ways:
        way.call()
    least = [np.inf] * len(ways)
    for _ in range(repeats):
        for number, way in enumerate(ways):
            began = time.process_time()
            way.call()
            spent = time.process_time() - began
            least[number] = min(least[number], spent)
    for way, seconds in zip(ways, least, strict=True):
        cost = seconds / way.times / _SECONDS[unit]
        yield {"task": task, "way": way.name, "cost": cost, "unit": unit, "note": way.note}


# --- searches ---


def searches(problem: Problem, iterations: int, repeats: int) -> Iterator[Row]:
    """Return the CPU time per evaluation of searches, and of the fitness alone."""
    planners = {name: load_swarm(name) for name in ("pso", "ssa", "issa")}
    objective = SegmentTimes.of(problem, planners["pso"])
    ways = []
    for runs in (1, SEEDS_TOGETHER):
        for name, planner in planners.items():
            search = _ours(objective, planner, runs, iterations)
            ways.append(_counted(f"{name}, {runs} runs together", search))
    ways.append(_counted("SciPy's DE, vectorised", _scipy(objective, iterations)))
    for runs in (1, SEEDS_TOGETHER):
        ways.append(_alone(objective, POPULATION * runs))
    ways += _compiled(problem)
    yield from side_by_side("evaluation of the 3-5-3 fitness", ways, "µs", repeats)


def load_swarm(name: str) -> SwarmPlanner:
    planner = load(name)
    assert isinstance(planner, SwarmPlanner)
    return planner


def _alone(objective: SegmentTimes, candidates: int) -> Way:
    """Return the way that evaluates the fitness of random candidates, without a search."""
    low, high = objective.box(1)
    drawn = np.random.default_rng(0).uniform(low, high, (candidates, 3))
    note = f"{candidates} candidates a call"
    fitness = partial(objective.fitness, drawn[None])
    return Way("the fitness alone", fitness, note, candidates)


def _compiled(problem: Problem) -> Iterator[Way]:
    """Return the ways of any other optimiser: one candidate a call, and many."""
    own = Objective(problem)
    drawn = np.random.default_rng(0).uniform(own.low, own.high, (POPULATION * SEEDS_TOGETHER, 3))

    def one_by_one() -> list[float]:
        return [own(candidate) for candidate in drawn]

    yield Way("trajopt.objective", one_by_one, "one candidate a call", len(drawn))
    together = partial(own, drawn)
    yield Way("trajopt.objective", together, f"{len(drawn)} candidates a call", len(drawn))


def _counted(name: str, search: Callable[[], int]) -> Way:
    """`search` returns how many evaluations it made."""
    evaluations = search()
    return Way(name, search, f"{evaluations} evaluations", evaluations)


def _ours(
    objective: SegmentTimes, planner: SwarmPlanner, runs: int, iterations: int
) -> Callable[[], int]:
    def search() -> int:
        found = minimise(
            planner.optimiser,
            Compared(objective.fitness),
            *objective.box(runs),
            range(runs),
            iterations=iterations,
        )
        return found.evaluations * runs

    return search


def _scipy(objective: SegmentTimes, iterations: int) -> Callable[[], int]:
    low, high = objective.box(1)

    def search() -> int:
        found = differential_evolution(
            lambda columns: objective.fitness(columns.T[None])[0],
            np.column_stack([low[0], high[0]]),
            maxiter=iterations,
            popsize=POPULATION // 3,  # per dimension
            tol=0.0,
            rng=0,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
        # vectorised calls count once each
        return POPULATION * (int(found.nit) + 1)

    return search


# --- the optimum, the verifier, the wrappers ---


def optima(problem: Problem, intervals: tuple[int, ...], repeats: int) -> Iterator[Row]:
    """Return a planner's CPU time, and the excess of its answer over the minimum time."""
    task = "minimum time"
    specs = ["exact", *(f"collocation:intervals={count}" for count in intervals)]
    best = certified_duration(problem, load("exact"))
    ways = []
    for spec in specs:
        planner = load(spec)
        error = certified_duration(problem, planner) / best - 1
        solve = partial(planner.solve, problem)
        ways.append(Way(spec, solve, f"error {100 * error:.4f} %"))
    yield from side_by_side(task, ways, "s", repeats)


def certified_duration(problem: Problem, planner: Planner) -> float:
    trajectory = planner.solve(problem).trajectory
    assert trajectory is not None
    duration = verify(problem, trajectory).certified_duration
    assert duration is not None
    return duration


def verdicts(problem: Problem, repeats: int) -> Iterator[Row]:
    """Return the CPU times of the verifier, and of samples as accurate as its tolerance.

    Between samples `d` apart a peak exceeds both by at most `M d² / 8`, where `M` bounds the second
    derivative (error of linear interpolation).
    """
    task = "verdict on a 3-5-3"
    trajectory = load("unoptimised").solve(problem).trajectory
    assert trajectory is not None
    motion = PPoly(trajectory.coefficients, trajectory.breaks)
    at = np.linspace(0.0, trajectory.duration, 10_000)
    spacing = np.inf
    for order, limits in ((1, problem.limits.velocity), (2, problem.limits.acceleration)):
        bend = abs(motion(at, order + 2)).max(axis=0)
        smallest = abs(limits).min(axis=1)
        allowed = Tolerance().limit * smallest
        own = np.sqrt(8 * allowed / np.maximum(bend, 1e-300))
        spacing = min(spacing, own.min())
    count = int(np.ceil(trajectory.duration / spacing)) + 1

    def sample() -> list[Array]:
        times = np.linspace(0.0, trajectory.duration, count)
        return [abs(motion(times, order)).max(axis=0) for order in (1, 2)]

    exact = partial(verify, problem, trajectory)
    ways = [
        Way("verify", exact, "exact, also of waypoints and jumps"),
        Way("sampled, velocity and acceleration", sample, f"{count} points"),
    ]
    yield from side_by_side(task, ways, "ms", repeats)


def main(
    problem: str = "six-axis", *, quick: bool = False, output: Path = Path("results/speed")
) -> None:
    """Measure every task and print the table."""
    loaded = catalogue.load(problem)
    iterations = 200
    intervals = INTERVALS
    repeats = REPEATS
    if quick:
        iterations = 5
        intervals = ()
        repeats = 1
    say("searches, verdicts and optima, each several times")
    rows = [*searches(loaded, iterations, repeats), *verdicts(loaded, 10 * repeats)]
    if intervals:
        rows += optima(loaded, intervals, repeats)
    table = pd.DataFrame(rows)
    first = table.groupby("task")["cost"].transform("first")
    table["times the first"] = table["cost"] / first
    save_table(table, output / "speed")
    print(table.to_string(index=False, float_format="{:.3g}".format))
