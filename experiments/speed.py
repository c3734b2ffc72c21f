"""How fast is it beside its peers? Ratios side by side, in one process, in CPU seconds.

    python -m experiments.speed            # a minute
    python -m experiments.speed --quick    # seconds, and no numbers to believe

Each row is one way to do a task; `times the first` is its cost over that of the task's first row.
The tasks: an evaluation of the real 3-5-3 fitness within a search (`[bench]` installs the peers;
mealpy is left out, since it needs NumPy below 2; only ours say what a candidate is compared with,
so that its limits need no peaks); the minimum time, with the error reached; a
verdict on a trajectory, exact, or sampled densely enough for the verifier's tolerance; and what
wrapping TOPP-RA and Ruckig costs. CPU seconds are the least of several repeats. The table goes to
`speed.csv` and `.md` in `--output`.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import cyclopts
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PPoly
from scipy.optimize import differential_evolution

from baselines.ruckig_ import Sections
from experiments.common.minimisers import NiaPy
from experiments.common.output import save_table
from trajopt.benchmark.suites import catalogue
from trajopt.core.problem import Problem
from trajopt.judging.verification import Tolerance, verify
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.planners.swarm import Compared, minimise
from trajopt.planners.swarm_planner import SegmentTimes, SwarmPlanner

Array = NDArray[np.float64]

POPULATION = 30  # the paper's
SEEDS_TOGETHER = 30  # as a comparison advances them
INTERVALS: tuple[int, ...] = (20, 80, 160)  # of collocation, per segment
REPEATS = 3  # of long tasks; of short ones ten times as many
_SECONDS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6}


@dataclass(frozen=True)
class Row:
    """One way to do a task: `unit` says what is counted, `note` what it reached or lacks."""

    task: str
    way: str
    cost: float
    unit: str
    note: str = ""


class Way(NamedTuple):
    """A call to be timed; it does its task so many times (`times`)."""

    name: str
    call: Callable[[], object]
    note: str = ""
    times: int = 1


def side_by_side(task: str, ways: Sequence[Way], unit: str, repeats: int) -> Iterator[Row]:
    """The least CPU time of each way, all taking turns: a machine is not always equally fast."""
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
        yield Row(task, way.name, cost, unit, way.note)


# --- searches ---


@dataclass(frozen=True)
class Fitness:
    """The 3-5-3 fitness of a problem, as PSO, SSA and ISSA have it: of `(m, 3)` segment times."""

    task: SegmentTimes

    @classmethod
    def of(cls, problem: Problem) -> Fitness:
        return cls(SegmentTimes.of(problem, load_swarm("pso")))

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
    ways = []
    for runs in (1, SEEDS_TOGETHER):
        for name in ("pso", "ssa", "issa"):
            search = _ours(fitness, name, runs, iterations)
            ways.append(_counted(f"{name}, {_in_words(runs)}", search))
    ways.append(_counted("SciPy's DE, vectorised", _scipy(fitness, iterations)))
    for runs in (1, SEEDS_TOGETHER):
        ways.append(_alone(fitness, POPULATION * runs))
    missing = []
    for package, peer in (("pymoo", _pymoo), ("pygmo", _pygmo), ("niapy", _niapy)):
        try:
            importlib.import_module(package)
        except ImportError:
            note = f"not installed: pip install 'trajopt[bench]' ({package})"
            missing.append(Row(task, package, np.nan, "µs", note))
        else:
            ways.append(_counted(f"{package}'s PSO", peer(fitness, iterations)))
    yield from side_by_side(task, ways, "µs", repeats)
    yield from missing


def _alone(fitness: Fitness, candidates: int) -> Way:
    """The fitness without a search, of candidates anywhere in the box."""
    drawn = np.random.default_rng(0).uniform(fitness.low, fitness.high, (candidates, 3))
    note = f"{candidates} candidates a call"
    return Way("the fitness alone", lambda: fitness(drawn), note, candidates)


def _counted(name: str, search: Callable[[], int]) -> Way:
    """`search` returns how many evaluations it made."""
    evaluations = search()
    return Way(name, search, f"{evaluations} evaluations", evaluations)


def _in_words(runs: int) -> str:
    return "one run" if runs == 1 else f"{runs} runs together"


def _ours(fitness: Fitness, name: str, seeds: int, iterations: int) -> Callable[[], int]:
    def search() -> int:
        found = minimise(
            load_swarm(name).optimiser,
            Compared(fitness.task.fitness),
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


def _niapy(fitness: Fitness, iterations: int) -> Callable[[], int]:
    """It asks for one candidate at a time, so a tenth of the evaluations are enough to measure."""
    size = fitness.high - fitness.low
    evaluations = POPULATION * max(1, iterations // 10)
    swarm = NiaPy("ParticleSwarmOptimization")

    def of_unit_cube(x: Array) -> float:
        times = fitness.low + x * size
        return float(fitness(times[None])[0])

    def search() -> int:
        swarm(of_unit_cube, dimension=3, evaluations=evaluations, seed=0)
        return evaluations

    return search


# --- the optimum, the verifier, the wrappers ---


def optima(problem: Problem, intervals: tuple[int, ...], repeats: int) -> Iterator[Row]:
    """A planner's CPU time, and how far above the exact minimum time its answer is."""
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
    """The verifier; and peaks of samples so close that none misses a peak by its tolerance.

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


def topp_ra(problem: Problem, repeats: int) -> Iterator[Row]:
    """One cubic spline cut into 1000 intervals, with and without this package around it.

    The answer is the same where the limits hold on whole intervals (the package's "interpolation"
    scheme) and the trajectory is a piecewise polynomial. By itself the package puts a cubic spline
    through the gridpoints, which keeps the limits there only.
    """
    import toppra
    import toppra.algorithm
    import toppra.constraint

    planner = load("toppra:knots=chord,ends=clamped")
    chords = np.linalg.norm(problem.displacements, axis=1)
    knots = np.r_[0.0, np.cumsum(chords)]
    on_intervals = toppra.constraint.DiscretizationType.Interpolation

    def timing() -> tuple[Any, Array]:
        path = toppra.SplineInterpolator(knots, problem.waypoints, bc_type="clamped")
        limits = [
            toppra.constraint.JointVelocityConstraint(problem.limits.velocity),
            toppra.constraint.JointAccelerationConstraint(
                problem.limits.acceleration,
                discretization_scheme=on_intervals,
            ),
        ]
        grid = np.linspace(0.0, path.duration, 1001)
        return toppra.algorithm.TOPPRA(limits, path, gridpoints=grid), grid

    def direct() -> object:
        algorithm, _ = timing()
        return algorithm.compute_trajectory(0, 0)

    def polynomial() -> object:
        algorithm, grid = timing()
        algorithm.compute_parameterization(0, 0)
        spline = CubicSpline(knots, problem.waypoints, bc_type="clamped")
        return retimed(spline, grid, algorithm.problem_data.sd_vec)

    solve = partial(planner.solve, problem)
    inside = share_inside(toppra.algorithm.TOPPRA, "compute_parameterization", solve)
    inside += share_inside(toppra.algorithm.TOPPRA, "compute_controllable_sets", solve)
    ours = f"limits in the middle too, units of its own; {100 * inside:.0f} % of it in toppra"
    ways = [
        Way("toppra, as polynomials", polynomial, "limits at both ends of every interval"),
        Way("our planner", solve, ours),
        Way("toppra, its own spline", direct, "limits at both ends, a spline through gridpoints"),
    ]
    yield from side_by_side("TOPP-RA on a spline", ways, "ms", repeats)


def share_inside(kind: type, method: str, work: Callable[[], object]) -> float:
    """The share of `work`'s CPU time that it spends in a method of a class."""
    spent = 0.0
    original = getattr(kind, method)

    def timed(*arguments: Any, **options: Any) -> Any:
        nonlocal spent
        began = time.process_time()
        found = original(*arguments, **options)
        spent += time.process_time() - began
        return found

    work()
    with patch.object(kind, method, timed):
        began = time.process_time()
        work()
        whole = time.process_time() - began
    return spent / whole


def retimed(path: CubicSpline, grid: Array, speeds: Array) -> PPoly:
    """A cubic path at `s(t)`, quadratic on each interval of the grid: of degree six."""
    durations = 2 * np.diff(grid) / (speeds[1:] + speeds[:-1])
    v = speeds[:-1, None]
    a = (np.diff(speeds) / durations)[:, None]
    # q = c0 + c1 u + c2 u² + c3 u³ with u = v t + a t²/2
    begins = grid[:-1]
    c0 = path(begins)
    c1 = path(begins, 1)
    c2 = path(begins, 2) / 2
    c3 = path(begins, 3) / 6
    powers = [
        c3 * a**3 / 8,
        c3 * 3 / 4 * v * a**2,
        c2 * a**2 / 4 + c3 * 3 / 2 * v**2 * a,
        c2 * v * a + c3 * v**3,
        c1 * a / 2 + c2 * v**2,
        c1 * v,
        c0,
    ]
    breaks = np.r_[0.0, np.cumsum(durations)]
    return PPoly(np.array(powers), breaks)


def ruckig_stop(problem: Problem, repeats: int) -> Iterator[Row]:
    """Ruckig from waypoint to waypoint, with and without this package around it.

    The library returns a joint's phases; an answer here is one trajectory of all joints, checked.
    What that takes is the same few milliseconds however little Ruckig itself does.
    """
    import ruckig

    planner = load("ruckig-stop")
    limits = problem.limits

    def sections() -> Iterator[Any]:
        generator = ruckig.Ruckig(problem.joints)
        for here, there in pairwise(problem.waypoints.tolist()):
            given = ruckig.InputParameter(problem.joints)
            given.current_position = here
            given.target_position = there
            given.max_velocity = limits.velocity[:, 1].tolist()
            given.max_acceleration = limits.acceleration[:, 1].tolist()
            trajectory = ruckig.Trajectory(problem.joints)
            generator.calculate(given, trajectory)
            yield trajectory

    def durations() -> float:
        spent = [trajectory.duration for trajectory in sections()]
        return float(np.sum(spent))

    def polynomials() -> list[PPoly]:
        profiles = [trajectory.profiles[0] for trajectory in sections()]
        return [cubics(own) for own in zip(*profiles, strict=True)]

    solve = partial(planner.solve, problem)
    ways = [
        Way("ruckig, as polynomials", polynomials, "a joint at a time"),
        Way("our planner", solve, "all joints on common breaks, input and answer checked"),
        Way("of it, limits and units", partial(Sections, problem), "checked, for every section"),
        Way("ruckig, durations only", durations),
    ]
    yield from side_by_side("Ruckig, stopping at waypoints", ways, "ms", repeats)


def cubics(profiles: Sequence[Any]) -> PPoly:
    """One joint's motion from Ruckig's profiles of it, one after another."""
    durations = []
    pieces = []
    for profile in profiles:
        phases = zip(profile.t, profile.j, profile.a, profile.v, profile.p, strict=False)
        for t, j, a, v, p in phases:
            if t > 0:
                durations.append(t)
                # q = p + v t + a t²/2 + j t³/6
                pieces.append([j / 6, a / 2, v, p])
    if not pieces:
        durations = [1.0]
        pieces = [[0.0, 0.0, 0.0, profiles[0].pf]]
    breaks = np.r_[0.0, np.cumsum(durations)]
    return PPoly(np.array(pieces).T, breaks)


def main(
    problem: str = "six-axis",
    *,
    quick: bool = False,
    output: Path = Path("results/speed"),
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
    rows = [
        *searches(loaded, iterations, repeats),
        *verdicts(loaded, 10 * repeats),
        *topp_ra(loaded, 10 * repeats),
        *ruckig_stop(loaded, 10 * repeats),
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
