"""Which of ISSA's ingredients help, which reading matters, and are the formulas biased?

    python -m experiments.issa_ablation               # 21 problems, 50 seeds, half an hour
    python -m experiments.issa_ablation --quick
    python -m experiments.issa_ablation --problems 0 --evaluations 30030    # as long as the paper's

Every subset of the four ingredients (none is SSA, all is ISSA), and ISSA with one other choice of
those on which public sparrow codes differ, race for the 3-5-3 times at equal evaluation budgets.
Then objectives with their minimum at many places of many boxes show what draws to the origin.
Written to `--output`: `summary`, `against-issa`, `against-ssa`, `ingredients`, `origin`.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from baselines.evolution import CMAES
from experiments.common import races
from experiments.common.output import save_table
from trajopt.benchmark.analysis import statistics
from trajopt.benchmark.figures import plots, style
from trajopt.cli import console
from trajopt.swarm import ISSA, PSO, SSA, Optimiser, minimise
from trajopt.swarm_planner import SwarmPlanner

Cell = tuple[str, str, float, str]  # function, where the origin is, place of the minimum, optimiser

INGREDIENTS = ("chaos", "levy", "weight", "opposition")
CHOICES: dict[str, Any] = {
    "acceptance": "always", "boundary": "reflect", "sorting": "phase", "watch": "first",
    "vigilantes": 0.2, "step": "elementwise", "eq41": "printed", "eq43": "printed",
    "eq49": "printed", "eq50": "printed",
}  # fmt: skip
OPTIMISERS: dict[str, Optimiser] = {"PSO": PSO(), "SSA": SSA(), "ISSA": ISSA(), "CMA-ES": CMAES()}
FUNCTIONS = {"sphere": np.ones(3), "ellipsoid": np.array([1.0, 10.0, 100.0])}
FRAMES = {"at its low end": 0.0, "in its middle": -5.0, "far away": 100.0}  # a box 10 wide
PLACES = (0.0, 0.1, 0.37, 0.5, 0.9, 1.0)


def subset(kept: tuple[str, ...]) -> str:
    """A subset's name; `issa` and `ssa` for all and none."""
    return {0: "ssa", len(INGREDIENTS): "issa"}.get(len(kept), "+".join(kept))


def entrants(evaluations: int) -> dict[str, SwarmPlanner]:
    """Every subset of the ingredients, and one choice at a time beside the default ISSA."""
    sizes = range(len(INGREDIENTS) + 1)
    subsets = [s for size in sizes for s in itertools.combinations(INGREDIENTS, size)]
    options: dict[str, dict[str, Any]] = {
        subset(s): {name: name in s for name in INGREDIENTS} for s in subsets
    }
    options |= {f"issa {key}={value}": {key: value} for key, value in CHOICES.items()}
    planners = {k: SwarmPlanner(ISSA(**v), evaluations=evaluations) for k, v in options.items()}
    for name in ("ssa", "issa"):
        planners[f"{name} space=unit"] = replace(planners[name], space="unit")
    return planners | {"issa fitness=scaled": replace(planners["issa"], fitness="scaled")}


def ingredients(outcome: races.Outcome) -> pd.DataFrame:
    """Per ingredient, the gap with it over the gap without it: one alone, to all others, overall.

    Ratios are geometric means over problems of median gaps (over the eight settings of the other
    three too, for `overall`, on whose logarithms, one pair per problem, the test is).
    """
    logs = dict(zip(outcome.names, np.log(outcome.medians), strict=True))
    rows = []
    for one in INGREDIENTS:
        rest = [name for name in INGREDIENTS if name != one]
        settings = [s for size in range(4) for s in itertools.combinations(rest, size)]
        within = [tuple(n for n in INGREDIENTS if n in (*s, one)) for s in settings]
        on = np.array([logs[subset(s)] for s in within])
        off = np.array([logs[subset(s)] for s in settings])
        ratio = np.exp((on - off).mean(axis=1))
        test = statistics.wilcoxon(on.mean(axis=0), off.mean(axis=0))
        overall = statistics.bootstrap(races.mean, (on - off).mean(axis=0))
        rows.append((one, ratio[0], ratio[-1], *np.exp([overall.value, overall.low, overall.high]),
                     test.wins, test.losses, test.pvalue))  # fmt: skip
    heads = ["ingredient", "alone", "to the others", "overall", "low", "high", "better", "worse"]
    table = pd.DataFrame(rows, columns=[*heads, "p"])
    return table.assign(**{"p (Holm)": statistics.holm(table["p"])})


def origin(seeds: int, evaluations: int, folder: Path) -> pd.DataFrame:
    """Error at the end, per function, box and place of the minimum: quartiles over seeds.

    The error is the function's value, 0 at best, with the box's width as the unit of length.
    CMA-ES searches the unit cube, so the box cannot matter to it: it runs in one only.
    """
    cells = list(itertools.product(FUNCTIONS, FRAMES, PLACES, OPTIMISERS))
    cells = [c for c in cells if c[3] != "CMA-ES" or c[1] == next(iter(FRAMES))]
    rows = []
    with console.progress(len(cells)) as advance:
        for cell in cells:
            run = partial(biased, cell, seeds, evaluations)
            rows.append(races.kept(folder / "origin", " ".join(map(str, cell)), run))
            advance(1)
    return pd.concat(rows, ignore_index=True)


def biased(cell: Cell, seeds: int, evaluations: int) -> pd.DataFrame:
    """One cell of the table `origin`."""
    function, frame, place, name = cell
    low = np.full(3, FRAMES[frame])
    best, scales = low + 10 * place, FUNCTIONS[function]
    found = minimise(
        OPTIMISERS[name], lambda x: (scales * ((x - best) / 10) ** 2).sum(axis=-1), low, low + 10,
        range(seeds), evaluations=evaluations,
    )  # fmt: skip
    keys = dict(zip(("function", "origin", "place", "optimiser"), cell, strict=True))
    quartiles = np.asarray(statistics.quantile(found.fitness, [0.25, 0.5, 0.75]))
    heads = ("first quartile", "median error", "third quartile")
    success = {"share below 1e-6": (found.fitness < 1e-6).mean()}
    return pd.DataFrame([keys | dict(zip(heads, quartiles, strict=True)) | success])


@plots.styled
def origin_figure(table: pd.DataFrame, evaluations: int) -> Figure:
    """Median error against the minimum's place, a row per function, a column per box."""
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    grid = figure.subplots(len(FUNCTIONS), len(FRAMES), sharex=True, sharey=True)
    looks = dict(zip(OPTIMISERS, zip(style.CURVES, style.DASHES, style.MARKERS, strict=False),
                     strict=False))  # fmt: skip
    for (function, frame, name), rows in table.groupby(["function", "origin", "optimiser"]):
        axes = grid[list(FUNCTIONS).index(function), list(FRAMES).index(frame)]
        colour, dash, marker = looks[name]
        low, middle, high = (np.maximum(rows[c], 1e-20) for c in rows.columns[4:7])
        axes.fill_between(rows["place"], low, high, color=colour, alpha=0.15, lw=0)
        axes.plot(rows["place"], middle, marker=marker, ls=dash, color=colour, mfc="white",
                  label=name if axes is grid[0, 0] else None)  # fmt: skip
        axes.set(yscale="log", xlim=(-0.05, 1.05))
    for axes, (frame, low_end) in zip(grid[0], FRAMES.items(), strict=True):
        axes.set_title(f"origin {frame}\nbox [{low_end:g}, {low_end + 10:g}]³".replace("-", "−"))
    for axes, function in zip(grid[:, 0], FUNCTIONS, strict=True):
        axes.set_ylabel(f"{function}: error (box widths²)")
    grid[-1, 1].set_xlabel("place of the minimum in the box (0: low end, 1: high end)")
    title = f"median and quartiles after {evaluations} evaluations"
    figure.legend(loc="outside lower center", ncols=4, title=title)
    return figure


def main(
    *, problems: int = 20, seeds: int = 50, evaluations: int = 4000,
    output: Path = Path("results/issa_ablation"), quick: bool = False,
) -> None:  # fmt: skip
    """Race the variants on the six-axis problem and on random ones."""
    if quick:
        problems, seeds, evaluations = 1, 2, 100
    outcome = races.run(entrants(evaluations), races.problems(problems), seeds, evaluations, output)
    spent = min(evaluations // 2, 2000)
    report(outcome, origin(seeds, spent, output), spent, output)


def report(outcome: races.Outcome, bias: pd.DataFrame, spent: int, output: Path) -> None:
    """Write the tables and figures, and print those of the race; `spent` is what `bias` cost."""
    stem = output / outcome.title.replace(", ", "-").replace(" ", "-")
    tables = {"summary": races.summary(outcome), "ingredients": ingredients(outcome)}
    tables |= {f"against-{name}": races.against(outcome, name) for name in ("issa", "ssa")}
    for name, table in (tables | {"optima": outcome.proof, "origin": bias}).items():
        save_table(table, stem / name)
    plots.save(races.gap_rows(outcome, "issa"), stem / "gaps")
    plots.save(origin_figure(bias, spent), stem / "origin")
    for table in tables.values():
        print(table.to_string(float_format="{:.4g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
