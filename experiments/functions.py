"""Are SSA and ISSA fair ones? Standard functions, as published and with their optimum moved.

    python -m experiments.functions    # half a minute of CPU
    python -m experiments.functions --quick    # two runs of a tenth of the evaluations

Five standard functions of ten variables in their usual boxes, 25 runs of 30,000 evaluations,
population 30. Most publications of sparrow searches have the optimum in the middle of the box, at
the origin. There SSA's factor `exp(−i/(α t_max))` shrinks every coordinate towards it. In the
second column of each optimiser the same function has its optimum elsewhere: a random place within
half of the box. A cell is the median of the errors `f − f_min`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import progress, save_table
from trajopt.core.arrays import Array
from trajopt.planners.swarm import ISSA, PSO, SSA, minimise

DIMENSIONS = 10
OPTIMISERS = {"pso": PSO(), "ssa": SSA(), "issa": ISSA()}
_SHIFT_SEED = 0


class Function(NamedTuple):
    """A function `(…, dim)` to `(…,)` with its least value 0 at `at` in every coordinate."""

    value: Callable[[Array], Array]
    half_width: float
    at: float = 0.0


def _rosenbrock(x: Array) -> Array:
    first, second = x[..., :-1], x[..., 1:]
    return (100 * (second - first**2) ** 2 + (1 - first) ** 2).sum(axis=-1)


def _rastrigin(x: Array) -> Array:
    return (x**2 - 10 * np.cos(2 * np.pi * x) + 10).sum(axis=-1)


def _ackley(x: Array) -> Array:
    far = np.exp(-0.2 * np.sqrt((x**2).mean(axis=-1)))
    waves = np.exp(np.cos(2 * np.pi * x).mean(axis=-1))
    return np.maximum(20 - 20 * far + np.e - waves, 0.0)  # but for rounding


def _griewank(x: Array) -> Array:
    roots = np.sqrt(np.arange(1, x.shape[-1] + 1))
    return 1 + (x**2).sum(axis=-1) / 4000 - np.cos(x / roots).prod(axis=-1)


FUNCTIONS = {
    "sphere": Function(lambda x: (x**2).sum(axis=-1), 100.0),
    "Rosenbrock": Function(_rosenbrock, 30.0, at=1.0),
    "Rastrigin": Function(_rastrigin, 5.12),
    "Ackley": Function(_ackley, 32.0),
    "Griewank": Function(_griewank, 600.0),
}


def median_error(name: str, optimiser: str, moved: bool, runs: int, evaluations: int) -> float:
    """Return the median error of some runs, the optimum moved or where it is published."""
    function = FUNCTIONS[name]
    shift = np.zeros(DIMENSIONS)
    if moved:
        rng = np.random.default_rng(_SHIFT_SEED)
        shift = function.half_width / 2 * rng.uniform(-1, 1, DIMENSIONS) - function.at
    result = minimise(
        OPTIMISERS[optimiser],
        lambda x: function.value(x - shift),
        np.full(DIMENSIONS, -function.half_width),
        np.full(DIMENSIONS, function.half_width),
        range(runs),
        evaluations=evaluations,
    )
    return float(np.median(result.fitness))


def main(*, output: Path = Path("results/functions"), quick: bool = False) -> None:
    """Run all, then write and print the table.

    Args:
        output: The folder of the table.
        quick: Two runs of 3000 evaluations.
    """
    runs, evaluations = (2, 3_000) if quick else (25, 30_000)
    rows = []
    with progress(len(FUNCTIONS) * len(OPTIMISERS) * 2, "medians") as advance:
        for name in FUNCTIONS:
            row: dict[str, str] = {"function": name}
            for optimiser in OPTIMISERS:
                for moved in (False, True):
                    error = median_error(name, optimiser, moved, runs, evaluations)
                    row[f"{optimiser}{', moved' if moved else ''}"] = f"{error:.1e}"
                    advance(1)
            rows.append(row)
    table = pd.DataFrame(rows)
    save_table(table, output / "functions")
    print(table.to_string(index=False))


if __name__ == "__main__":
    cyclopts.run(main)
