"""How fast is it beside its peers? Ratios side by side, in one process, in CPU seconds.

    python -m experiments.speed            # a minute
    python -m experiments.speed --quick    # seconds, and no numbers to believe

Each row is one way to do a task; `times the first` is its cost over that of the task's first row.
The tasks: an evaluation of the real 3-5-3 fitness within a search (`[bench]` installs the peers;
mealpy is left out, since it needs NumPy below 2); the minimum time, with the error reached; a
verdict on a trajectory, exact, or sampled densely enough for the verifier's tolerance; and what
wrapping TOPP-RA and Ruckig costs. CPU seconds are the least of several repeats. The table goes to
`speed.csv` and `.md` in `--output`.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import PPoly
from scipy.optimize import differential_evolution

from experiments.common.output import save_table
from trajopt.benchmark.suites import catalogue
from trajopt.planner import Planner
from trajopt.problem import Problem
from trajopt.registry import load
from trajopt.swarm.optimiser import minimise
from trajopt.swarm_planner import SwarmPlanner, _Task
from trajopt.verification import Tolerance, verify

Array = NDArray[np.float64]

POPULATION = 30  # the paper's
SEEDS_TOGETHER = 15  # as a comparison advances them
INTERVALS = (20, 80, 160)  # of collocation, per segment


@dataclass(frozen=True)
class Row:
    """One way to do a task: `unit` says what is counted, `note` what it reached or lacks."""

    task: str
    way: str
    cost: float
    unit: str
    note: str = ""


def cpu_seconds(call: Callable[[], object], repeats: int) -> float:
    """The least CPU time of several calls, after one that is not counted."""
    call()
    spent = []
    for _ in range(repeats):
        began = time.process_time()
        call()
        spent.append(time.process_time() - began)
    return min(spent)


# --- searches ---


@dataclass(frozen=True)
class Fitness:
    """The 3-5-3 fitness of a problem, as PSO, SSA and ISSA have it: of `(m, 3)` segment times."""

    task: _Task

    @classmethod
    def of(cls, problem: Problem) -> Fitness:
        return cls(_Task.of(problem, load_swarm("pso")))

    @property
    def low(self) -> Array:
        low: Array = self.task.low[0]
        return low

    @property
    def high(self) -> Array:
        high: Array = self.task.high[0]
        return high

    def __call__(self, candidates: Array) -> Array:
        values: Array = self.task.fitness(candidates[None])[0]
        return values


def load_swarm(name: str) -> SwarmPlanner:
    planner = load(name)
    assert isinstance(planner, SwarmPlanner)
    return planner


def searches(problem: Problem, iterations: int, repeats: int) -> Iterator[Row]:
    """CPU time per evaluation, the fitness included."""
    task = "evaluation of the 3-5-3 fitness"
    fitness = Fitness.of(problem)
    for seeds in (1, SEEDS_TOGETHER):
        for name in ("pso", "ssa", "issa"):
            search = _ours(fitness, name, seeds, iterations)
            yield _per_evaluation(task, f"{name}, {seeds} at a time", search, repeats)
    scipys = _scipy(fitness, iterations)
    yield _per_evaluation(task, "SciPy's DE, vectorised", scipys, repeats)
    for package, peer in (("pymoo", _pymoo), ("pygmo", _pygmo)):
        try:
            importlib.import_module(package)
        except ImportError:
            missing = f"not installed: pip install 'trajopt[bench]' ({package})"
            yield Row(task, package, np.nan, "µs", missing)
        else:
            yield _per_evaluation(task, f"{package}'s PSO", peer(fitness, iterations), repeats)


def _per_evaluation(task: str, way: str, search: Callable[[], int], repeats: int) -> Row:
    """`search` returns how many evaluations it made."""
    evaluations = search()
    seconds = cpu_seconds(search, repeats)
    return Row(task, way, 1e6 * seconds / evaluations, "µs", f"{evaluations} evaluations")


def _ours(fitness: Fitness, name: str, seeds: int, iterations: int) -> Callable[[], int]:
    def search() -> int:
        found = minimise(
            load_swarm(name).optimiser,
            fitness.task.fitness,
            *fitness.task.box(seeds),
            range(seeds),
            iterations=iterations,
        )
        return found.evaluations * seeds

    return search


def _scipy(fitness: Fitness, iterations: int) -> Callable[[], int]:
    def search() -> int:
        found = differential_evolution(
            lambda columns: fitness(columns.T),
            np.column_stack([fitness.low, fitness.high]),
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


def _pymoo(fitness: Fitness, iterations: int) -> Callable[[], int]:
    swarm = importlib.import_module("pymoo.algorithms.soo.nonconvex.pso")
    core = importlib.import_module("pymoo.core.problem")
    optimize = importlib.import_module("pymoo.optimize")

    class SegmentTimes(core.Problem):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            super().__init__(n_var=3, n_obj=1, xl=fitness.low, xu=fitness.high)

        def _evaluate(self, x: Array, out: dict[str, Any], *_: Any, **__: Any) -> None:
            out["F"] = fitness(x)

    def search() -> int:
        found = optimize.minimize(
            SegmentTimes(),
            swarm.PSO(pop_size=POPULATION, adaptive=False),
            ("n_gen", iterations),
            seed=0,
        )
        return int(found.algorithm.evaluator.n_eval)

    return search


@dataclass
class _PygmoProblem:
    evaluate: Fitness

    def fitness(self, x: Array) -> Array:
        return self.evaluate(x[None])

    def batch_fitness(self, flat: Array) -> Array:
        return self.evaluate(flat.reshape(-1, 3))

    def get_bounds(self) -> tuple[Array, Array]:
        return self.evaluate.low, self.evaluate.high


def _pygmo(fitness: Fitness, iterations: int) -> Callable[[], int]:
    pygmo = importlib.import_module("pygmo")

    def search() -> int:
        swarm = pygmo.pso_gen(gen=iterations, seed=0)
        swarm.set_bfe(pygmo.bfe())
        problem = pygmo.problem(_PygmoProblem(fitness))
        population = pygmo.population(problem, size=POPULATION, b=pygmo.bfe(), seed=0)
        evolved = pygmo.algorithm(swarm).evolve(population)
        return int(evolved.problem.get_fevals())

    return search


# --- the optimum, the verifier, the wrappers ---


def optima(problem: Problem, intervals: tuple[int, ...], repeats: int) -> Iterator[Row]:
    """A planner's CPU time, and how far above the exact minimum time its answer is."""
    task = "minimum time"
    specs = ["exact", *(f"collocation:intervals={count}" for count in intervals)]
    best = certified_duration(problem, load("exact"))
    for spec in specs:
        planner = load(spec)
        error = certified_duration(problem, planner) / best - 1
        seconds = cpu_seconds(lambda own=planner: own.solve(problem), repeats)  # type: ignore[misc]
        yield Row(task, spec, seconds, "s", f"error {100 * error:.4f} %")


def certified_duration(problem: Problem, planner: Planner) -> float:
    trajectory = planner.solve(problem).trajectory
    assert trajectory is not None
    duration = verify(problem, trajectory).certified_duration
    assert duration is not None
    return duration


def verdicts(problem: Problem, repeats: int) -> Iterator[Row]:
    """The verifier; and peaks of samples so close that none misses a peak by its tolerance.

    Between samples `d` apart a peak exceeds both by at most `M d² / 8`, where `M` bounds the second
    derivative (error of linear interpolation).
    """
    task = "verdict on a 3-5-3"
    trajectory = load("unoptimised").solve(problem).trajectory
    assert trajectory is not None
    seconds = cpu_seconds(lambda: verify(problem, trajectory), repeats)
    yield Row(task, "verify", 1e3 * seconds, "ms", "exact, also of waypoints and jumps")
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

    seconds = cpu_seconds(sample, repeats)
    yield Row(task, "sampled, velocity and acceleration", 1e3 * seconds, "ms", f"{count} points")


def topp_ra(problem: Problem, repeats: int) -> Iterator[Row]:
    """One cubic spline, 1000 grid intervals, with and without this package around it."""
    import toppra
    import toppra.algorithm
    import toppra.constraint

    planner = load("toppra:knots=chord,ends=clamped")
    chords = np.linalg.norm(problem.displacements, axis=1)
    knots = np.r_[0.0, np.cumsum(chords)]

    def direct() -> object:
        path = toppra.SplineInterpolator(knots, problem.waypoints, bc_type="clamped")
        limits = [
            toppra.constraint.JointVelocityConstraint(problem.limits.velocity),
            toppra.constraint.JointAccelerationConstraint(problem.limits.acceleration),
        ]
        grid = np.linspace(0.0, path.duration, 1001)
        timing = toppra.algorithm.TOPPRA(limits, path, gridpoints=grid)
        return timing.compute_trajectory(0, 0)

    task = "TOPP-RA on a spline"
    yield Row(task, "toppra", 1e3 * cpu_seconds(direct, repeats), "ms")
    ours = cpu_seconds(lambda: planner.solve(problem), repeats)
    yield Row(task, "our planner", 1e3 * ours, "ms", "with the trajectory as polynomials")


def ruckig_stop(problem: Problem, repeats: int) -> Iterator[Row]:
    """Ruckig from waypoint to waypoint, with and without this package around it."""
    import ruckig

    planner = load("ruckig-stop")
    limits = problem.limits

    def direct() -> float:
        generator = ruckig.Ruckig(problem.joints)
        duration = 0.0
        for here, there in zip(problem.waypoints, problem.waypoints[1:], strict=False):
            given = ruckig.InputParameter(problem.joints)
            given.current_position = here.tolist()
            given.target_position = there.tolist()
            given.max_velocity = limits.velocity[:, 1].tolist()
            given.max_acceleration = limits.acceleration[:, 1].tolist()
            trajectory = ruckig.Trajectory(problem.joints)
            generator.calculate(given, trajectory)
            duration += trajectory.duration
        return duration

    task = "Ruckig, stopping at waypoints"
    yield Row(task, "ruckig", 1e3 * cpu_seconds(direct, repeats), "ms", "durations only")
    ours = cpu_seconds(lambda: planner.solve(problem), repeats)
    yield Row(task, "our planner", 1e3 * ours, "ms", "with the trajectory as polynomials")


def main(
    problem: str = "six-axis",
    *,
    quick: bool = False,
    output: Path = Path("results/speed"),
) -> None:
    """Measure every task and print the table."""
    loaded = catalogue.load(problem)
    iterations = 200
    repeats = 3
    intervals: tuple[int, ...] = INTERVALS
    if quick:
        iterations = 5
        repeats = 1
        intervals = ()
    rows = [
        *searches(loaded, iterations, repeats),
        *verdicts(loaded, repeats),
        *topp_ra(loaded, repeats),
        *ruckig_stop(loaded, repeats),
    ]
    if intervals:
        rows += optima(loaded, intervals, repeats)
    table = pd.DataFrame([asdict(row) for row in rows])
    first = table.groupby("task")["cost"].transform("first")
    table["times the first"] = table["cost"] / first
    save_table(table, output / "speed")
    print(table.to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
