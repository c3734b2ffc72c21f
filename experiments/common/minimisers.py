"""One call for any minimiser: ours, every algorithm of NiaPy by its class, and a local search.

NiaPy (`pip install 'trajopt[bench]'`) is the library of swarms that installs beside NumPy 2; its
algorithms run with their own default parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from trajopt.planners.planner import backend
from trajopt.planners.swarm import Optimiser, minimise

Array = NDArray[np.float64]
Fitness = Callable[[Array], float]
Minimiser = Callable[[Fitness, int, int, int], Array]

POPULATION = 30


@dataclass(frozen=True)
class Ours:
    """A swarm of `trajopt`, or CMA-ES and differential evolution of `baselines`."""

    optimiser: Optimiser

    def __call__(self, fitness: Fitness, dimension: int, evaluations: int, seed: int) -> Array:
        """The best point of the unit cube that one run finds."""

        def of_runs(x: Array) -> Array:
            flat = x.reshape(-1, dimension)
            values = np.array([fitness(candidate) for candidate in flat])
            return values.reshape(x.shape[:2])

        found = minimise(
            self.optimiser,
            of_runs,
            np.zeros(dimension),
            np.ones(dimension),
            seeds=[seed],
            evaluations=evaluations,
        )
        best: Array = found.position[0]
        return best


@dataclass(frozen=True)
class NiaPy:
    """An algorithm of NiaPy, by the name of its class in `niapy.algorithms.basic`."""

    algorithm: str

    def __call__(self, fitness: Fitness, dimension: int, evaluations: int, seed: int) -> Array:
        """The best point of the unit cube that one run finds.

        Raises:
            MissingBackend: NiaPy is not installed.
        """
        problems = backend("niapy.problems")
        algorithms = backend("niapy.algorithms.basic")

        class UnitCube(problems.Problem):  # type: ignore[misc, name-defined]
            def _evaluate(self, x: Array) -> float:
                return fitness(x)

        task = backend("niapy.task").Task(
            problem=UnitCube(dimension, 0.0, 1.0),
            max_evals=evaluations,
        )
        kind: Any = getattr(algorithms, self.algorithm)
        best, _ = kind(population_size=POPULATION, seed=seed).run(task)
        return np.asarray(best, dtype=float)


def local_search(fitness: Fitness, start: Array, evaluations: int) -> Array:
    """Nelder and Mead's simplex from one start in the unit cube, within a budget."""
    bounds = [(0.0, 1.0)] * len(start)
    found = minimize(
        fitness,
        start,
        method="Nelder-Mead",
        bounds=bounds,
        options={"maxfev": evaluations, "xatol": 1e-9, "fatol": 1e-9},
    )
    best: Array = found.x
    return best
