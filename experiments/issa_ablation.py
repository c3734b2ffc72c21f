"""Which of ISSA's ingredients help, which reading matters, and are the formulas biased?

    python -m experiments.issa_ablation               # 21 problems, 50 seeds, half an hour
    python -m experiments.issa_ablation --quick
    python -m experiments.issa_ablation --problems 0 --evaluations 30030    # as long as the paper's

Every subset of the four ingredients (none is SSA, all is ISSA) searches the 3-5-3 times at equal
evaluation budgets. So does ISSA with each alternative choice on which public sparrow codes differ.
Then objectives with their minimum at many positions of many boxes show which variants are biased
towards the origin.
`--output` keeps the trials, and holds the tables `summary`, `against-issa`, `against-ssa`,
`ingredients`, `optima` and `origin`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd

from baselines.evolution import CMAES
from experiments.common import races
from experiments.common.kept import Rows, kept
from trajopt.core.arrays import Array
from trajopt.planners.swarm import ISSA, PSO, SSA, Optimiser, minimise
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.analysis import statistics

Subset = tuple[str, ...]  # names of ingredients
Cell = tuple[str, str, float, str]  # function, where the origin is, place of the minimum, optimiser

INGREDIENTS = ("chaos", "levy", "weight", "opposition")
CHOICES: dict[str, Any] = {
    "acceptance": "always",
    "boundary": "reflect",
    "sorting": "phase",
    "watch": "first",
    "vigilantes": 0.2,
    "step": "elementwise",
    "eq41": "printed",
    "eq43": "printed",
    "eq49": "printed",
    "eq50": "printed",
}
OPTIMISERS: dict[str, Optimiser] = {"PSO": PSO(), "SSA": SSA(), "ISSA": ISSA(), "CMA-ES": CMAES()}
FUNCTIONS = {"sphere": np.ones(3), "ellipsoid": np.array([1.0, 10.0, 100.0])}
WIDTH = 10.0  # width of a box
# Position of the origin in the box, and the box's low end.
FRAMES = {"at its low end": 0.0, "in its middle": -5.0, "far away": 100.0}
PLACES = (0.0, 0.1, 0.37, 0.5, 0.9, 1.0)


def subset(switched_on: Subset) -> str:
    """A subset's name; `issa` and `ssa` for all and none."""
    if not switched_on:
        return "ssa"
    if len(switched_on) == len(INGREDIENTS):
        return "issa"
    return "+".join(switched_on)


def subsets(names: Sequence[str]) -> list[Subset]:
    """Every subset, the smaller first."""
    found: list[Subset] = []
    for size in range(len(names) + 1):
        found += itertools.combinations(names, size)
    return found


def entrants(evaluations: int) -> dict[str, SwarmPlanner]:
    """Every subset of the ingredients, and one choice at a time beside the default ISSA."""
    options: dict[str, dict[str, Any]] = {}
    for switched_on in subsets(INGREDIENTS):
        options[subset(switched_on)] = {name: name in switched_on for name in INGREDIENTS}
    for key, value in CHOICES.items():
        options[f"issa {key}={value}"] = {key: value}
    planners = {}
    for name, own in options.items():
        planners[name] = SwarmPlanner(ISSA(**own), evaluations=evaluations)
    for name in ("ssa", "issa"):
        planners[f"{name} space=unit"] = replace(planners[name], space="unit")
    planners["issa fitness=scaled"] = replace(planners["issa"], fitness="scaled")
    return planners


def ingredients(outcome: races.RaceResult) -> pd.DataFrame:
    """Per ingredient, the gap with it over the gap without it: one alone, to all others, overall.

    Ratios are geometric means over problems of median gaps (over the eight settings of the other
    three too, for `overall`, on whose logarithms, one pair per problem, the test is).
    """
    logs = np.log(outcome.medians)
    rows = []
    for one in INGREDIENTS:
        others = [name for name in INGREDIENTS if name != one]
        without = subsets(others)
        on = logs.loc[[subset(_with(one, some)) for some in without]].to_numpy()
        off = logs.loc[[subset(some) for some in without]].to_numpy()
        difference = on - off
        ratio = np.exp(difference.mean(axis=1))
        overall = statistics.bootstrap(races.mean, difference.mean(axis=0))
        test = statistics.wilcoxon(on.mean(axis=0), off.mean(axis=0))
        row = {
            "ingredient": one,
            "alone": ratio[0],
            "to the others": ratio[-1],
            "overall": np.exp(overall.value),
            "low": np.exp(overall.low),
            "high": np.exp(overall.high),
            "better": test.wins,
            "worse": test.losses,
            "p": test.pvalue,
        }
        rows.append(row)
    table = pd.DataFrame(rows)
    return table.assign(**{"p (Holm)": statistics.holm(table["p"])})


def _with(ingredient: str, some: Subset) -> Subset:
    """A subset and one more, in the order of `INGREDIENTS`."""
    wanted = {ingredient, *some}
    return tuple(name for name in INGREDIENTS if name in wanted)


def origin(seeds: int, evaluations: int, folder: Path) -> pd.DataFrame:
    """Error at the end, per function, box and place of the minimum: quartiles over seeds.

    The error is the function's value, 0 at best, with the box's width as the unit of length.
    CMA-ES searches the unit cube, so the box cannot matter to it: it runs in one only.
    """
    one_frame = next(iter(FRAMES))
    cells = []
    for cell in itertools.product(FUNCTIONS, FRAMES, PLACES, OPTIMISERS):
        _, frame, _, name = cell
        if name != "CMA-ES" or frame == one_frame:
            cells.append(cell)
    file = folder / f"origin-{seeds}-seeds-{evaluations}-evaluations.csv"
    runs = {cell: partial(biased, cell, seeds, evaluations) for cell in cells}
    return kept(file, ["function", "origin", "place", "optimiser"], runs)


def biased(cell: Cell, seeds: int, evaluations: int) -> Rows:
    """One cell of the table `origin`."""
    function, frame, place, name = cell
    low = np.full(3, FRAMES[frame])
    best = low + WIDTH * place
    scales = FUNCTIONS[function]

    def error(x: Array) -> Array:
        offset = (x - best) / WIDTH
        return np.asarray((scales * offset**2).sum(axis=-1))

    result = minimise(
        OPTIMISERS[name], error, low, low + WIDTH, range(seeds), evaluations=evaluations
    )
    quartiles = statistics.quantile(result.fitness, [0.25, 0.5, 0.75])
    first, middle, third = np.asarray(quartiles)
    near = result.fitness < 1e-6
    row = {
        "first quartile": first,
        "median error": middle,
        "third quartile": third,
        "share below 1e-6": near.mean(),
    }
    return [row]


def main(
    *,
    problems: int = 20,
    seeds: int = 50,
    evaluations: int = 4000,
    output: Path = Path("results/issa_ablation"),
    quick: bool = False,
) -> None:
    """Race the variants on the six-axis problem and on random ones."""
    if quick:
        problems = 1
        seeds = 2
        evaluations = 100
    outcome = races.run(entrants(evaluations), races.problems(problems), seeds, output)
    tables = {
        "summary": races.summary(outcome),
        "ingredients": ingredients(outcome),
        "against-issa": races.against(outcome, "issa"),
        "against-ssa": races.against(outcome, "ssa"),
    }
    bias = origin(seeds, min(evaluations // 2, 2000), output)
    races.report(tables | {"optima": outcome.proof, "origin": bias}, output)


if __name__ == "__main__":
    cyclopts.run(main)
