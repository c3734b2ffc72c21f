"""The 3-5-3 segment times by two established optimisers, to compare the swarms with.

CMA-ES (Hansen's own library, `cma`) and differential evolution (SciPy) have the interface of the
swarms: the same box, fitness and budget, and every evaluation is counted. Both search the unit
cube, mapped linearly to the box. When they have converged they start again until the budget is
spent.

    from baselines.evolution import cmaes, de
    solution = cmaes.solve(problem, seed=1)
    print(solution.trajectory.duration, solution.evaluations)
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import backend
from trajopt.planners.swarm import Box, Optimiser, Streams
from trajopt.planners.swarm.optimiser import Search, require
from trajopt.planners.swarm_planner import SwarmPlanner

if TYPE_CHECKING:
    from numpy.random import Generator as Random

Run = Generator[Array, Array, None]

# Replaces an infinite or NaN fitness; its square is still finite.
_INFINITE_FITNESS = 1e100


@dataclass(frozen=True)
class Evolution(Optimiser):
    """A library's optimiser in the unit cube, one independent search per run."""

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population

    @abstractmethod
    def run(self, random: Random, dim: int) -> Run:
        """Yield candidates `(population, dim)` without end, and receive their fitness by `send`."""

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        dim = box.low.shape[-1]
        seeds = np.ldexp(streams.uniform(1)[:, 0], 53).astype(np.int64)
        runs = [self.run(np.random.Generator(np.random.PCG64(int(seed))), dim) for seed in seeds]
        unit = np.stack([next(run) for run in runs])
        for _ in range(iterations):
            fitness = _finite((yield box.spread(unit)))
            unit = np.stack([run.send(own) for run, own in zip(runs, fitness, strict=True)])
        yield box.spread(unit)


@dataclass(frozen=True)
class CMAES(Evolution):
    """CMA-ES with increasing population (Auger and Hansen, CEC 2005), by the library `cma`.

    - `population`: of the first descent; 30 is the paper's (the library's rule, 4 + ⌊3 ln dim⌋, is
      7 for three times); `growth`: what multiplies it at every restart (1 keeps it);
    - `sigma0`: the first standard deviation, as a fraction of the box; the library allows a third.

    Every descent starts at a point drawn uniformly and ends by the library's own tests. Bounds are
    kept by the library's default, `BoundTransform`, a smooth map of all numbers into the box.

    Raises `InvalidInput` for bad options and, in the search, for a single dimension, which the
    library does not support; `MissingBackend`, in the search, where `cma` is not installed.
    """

    sigma0: float = 0.3
    growth: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        require("sigma0", self.sigma0, 0 < self.sigma0 <= 1 / 3, "a number above 0, at most 1/3")
        require("growth", self.growth, self.growth >= 1, "at least 1")

    def run(self, random: Random, dim: int) -> Run:
        require("dimensions", dim, dim >= 2, "at least 2")
        population = self.population
        while True:
            yield from self._descent(random, dim, population)
            population *= self.growth

    def _descent(self, random: Random, dim: int, population: int) -> Run:
        """Run one descent until it has converged; a large population is yielded in batches."""
        options = {"popsize": population, "randn": lambda *shape: random.standard_normal(shape)}
        start = random.random(dim)
        with inside_library():
            strategy = backend("cma", "cma").CMAEvolutionStrategy(
                start, self.sigma0, options | _QUIET
            )
        while not strategy.stop():
            with inside_library():
                asked: list[Array] = strategy.ask()
            told: list[float] = []
            batches = np.reshape(asked, (-1, self.population, dim))
            for batch in batches:
                told.extend((yield batch))
            with inside_library():
                strategy.tell(asked, told)


_QUIET: dict[str, Any] = {
    "bounds": [0, 1],
    "seed": np.nan,  # leaves NumPy's global stream alone
    "verbose": -10,  # no messages, and no commands from a file in the working folder
    "verb_disp": 0,
    "verb_log": 0,
}


@dataclass(frozen=True)
class DE(Evolution):
    """Differential evolution (Storn and Price, 1997), by SciPy's `differential_evolution`.

    - `strategy`, `recombination`: SciPy's, with SciPy's defaults; its mutation factor is dithered
      from 0.5 to 1;
    - `tolerance`: a population whose fitness differs by no more than this fraction of the best has
      converged, and a new one is drawn.

    Raises `InvalidInput` for bad options.
    """

    strategy: Literal[
        "best1bin",
        "best1exp",
        "best2bin",
        "best2exp",
        "rand1bin",
        "rand1exp",
        "rand2bin",
        "rand2exp",
        "randtobest1bin",
        "randtobest1exp",
        "currenttobest1bin",
        "currenttobest1exp",
    ] = "best1bin"
    recombination: float = 0.7
    tolerance: float = 1e-10

    def __post_init__(self) -> None:
        super().__post_init__()
        require("population", self.population, self.population >= 6, "at least 6")
        probability = 0 <= self.recombination <= 1
        require("recombination", self.recombination, probability, "a number from 0 to 1")
        require("tolerance", self.tolerance, 0 <= self.tolerance < 1, "a number from 0 to below 1")

    def run(self, random: Random, dim: int) -> Run:
        while True:
            x = random.random((self.population, dim))
            f = yield x
            while np.ptp(f) > self.tolerance * abs(f.min()):
                x, f, trials = self._trials(x, f, random)
                told = yield trials
                better = told <= f
                x = np.where(better[:, None], trials, x)
                f = np.where(better, told, f)

    def _trials(self, x: Array, f: Array, random: Random) -> tuple[Array, Array, Array]:
        """Return the population, its fitness (the best first, as SciPy orders it) and its trials.

        SciPy calls the objective itself and does not return its trial vectors. So each generation
        is a call of SciPy of its own. In that call the first evaluation is already known, and the
        second one shows the trial vectors before any of them is accepted.
        """
        import scipy  # late: planners that are only listed need none of it

        seen: list[Array] = []

        def objective(columns: Array) -> Array:
            seen.append(columns.T.copy())
            return f if len(seen) == 1 else np.full(len(f), np.inf)

        with inside_library():
            generation = scipy.optimize.differential_evolution(
                objective,
                [(0.0, 1.0)] * x.shape[1],
                init=x,
                maxiter=1,
                rng=random,
                strategy=self.strategy,
                recombination=self.recombination,
                vectorized=True,
                updating="deferred",
                polish=False,
                tol=0.0,
            )
        return generation.population, generation.population_energies, seen[1]


def _finite(fitness: Array) -> Array:
    """Replace NaN and infinite fitness by a large number."""
    known = np.where(np.isnan(fitness), np.inf, fitness)
    return np.clip(known, -_INFINITE_FITNESS, _INFINITE_FITNESS)


@dataclass(frozen=True)
class EvolutionPlanner(SwarmPlanner):
    """A `SwarmPlanner` that runs on request, to compare the swarms with."""

    on_request = True


@dataclass(frozen=True)
class CMAESPlanner(EvolutionPlanner):
    """A `SwarmPlanner` that requires `cma`; importing it is part of the setup time."""

    optimiser: Optimiser = field(default_factory=CMAES)
    requires = ("cma",)
    extra = "cma"

    def solve_batch(self, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
        """Return one answer per seed; raises `MissingBackend` where `cma` is not installed."""
        began = time.perf_counter()
        backend("cma", "cma")
        setup_time = time.perf_counter() - began
        return [replace(s, setup_time=setup_time) for s in super().solve_batch(problem, seeds)]


cmaes = CMAESPlanner()
de = EvolutionPlanner(DE())
