"""What does the choice of the swarm decide, and what the family of curves?

    python -m experiments.recipes                # some minutes
    python -m experiments.recipes --only zhao    # the tasks whose names hold that
    python -m experiments.recipes --quick        # seconds, and no numbers to believe

The literature gives a swarm the segment times of a 3-5-3, or of a quintic B-spline, and compares
it with other swarms. Here every swarm gets the same fitness (every candidate dilated to the limits,
from exact peaks) and the same evaluations, beside one local search (Nelder and Mead from equal
times, one run, the same budget), the family's NLP, and the optimum over all motions. Every
answer is certified by the verifier. Written to `--output`: `recipes.csv` and `.md` (quartiles over
seeds), `shares.csv` and `.md` (the two questions), and a figure.

NiaPy gives PSO, GWO, GA, DE, HHO and ABC, ours are SSA, ISSA and CMA-ES. WOA and DBO are in no
library that installs beside NumPy 2 (mealpy has the first, and asks for NumPy below 2): they are
written from their papers in `experiments.common`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator
from numpy.typing import NDArray

from baselines.evolution import CMAES
from experiments.common import races
from experiments.common.beetles import DBO
from experiments.common.minimisers import Minimiser, NiaPy, Ours, local_search
from experiments.common.output import save_table
from experiments.common.spline_times import FamilyName, SplineTimes
from experiments.common.whales import WOA
from trajopt import verify
from trajopt.benchmark.suites import catalogue
from trajopt.cli import console
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.explain.claims import survey
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.swarm import ISSA, SSA
from trajopt.views.figures import plots, style

Array = NDArray[np.float64]

SWARMS: dict[str, Minimiser] = {
    "PSO": NiaPy("ParticleSwarmAlgorithm"),
    "GWO": NiaPy("GreyWolfOptimizer"),
    "GA": NiaPy("GeneticAlgorithm"),
    "DE": NiaPy("DifferentialEvolution"),
    "HHO": NiaPy("HarrisHawksOptimization"),
    "ABC": NiaPy("ArtificialBeeColonyAlgorithm"),
    "WOA": Ours(WOA()),
    "DBO": Ours(DBO()),
    "SSA": Ours(SSA()),
    "ISSA": Ours(ISSA()),
    "CMA-ES": Ours(CMAES()),
}
LOCAL = "local search"
# A family's own, or the one that holds it.
NLP_FAMILIES: dict[FamilyName, str] = {"3-5-3": "3-5-3", "quintic B-spline": "quintic spline"}
TASKS: tuple[tuple[str, FamilyName], ...] = (
    ("six-axis", "3-5-3"),
    ("yu2025-task4-jerk", "3-5-3"),
    ("six-axis", "quintic B-spline"),
    ("yu2025-task4-jerk", "quintic B-spline"),
    ("zhao2022-iwoa-pso", "quintic B-spline"),
)


@dataclass(frozen=True)
class Task:
    """A family on a problem, with what it is measured by; durations in seconds.

    Attributes:
        times: the family as a function of its segment times.
        optimum: over all motions, the best known.
        stopping: at rest at every waypoint.
        nlp: the family's best by a local NLP with gradients, NaN without an answer; for the quintic
            B-spline that of all C² quintic splines, which it cannot beat.
    """

    times: SplineTimes
    optimum: float
    stopping: float
    nlp: float

    @property
    def name(self) -> str:
        return f"{self.times.problem.name}, {self.times.family}"


def task(name: str, family: FamilyName) -> Task:
    """The task and its optimum over all motions, the best known."""
    problem = catalogue.load(name)
    known = survey(problem, [NLP_FAMILIES[family]], time_limit=1.0)
    if known.best is None:
        raise TrajoptError(f"{name}: {known.best_by}")
    return Task(
        SplineTimes(problem, family),
        known.best,
        known.stopping,
        nlp=known.best_of_family.get(NLP_FAMILIES[family], np.nan),
    )


def certified(times: SplineTimes, x: Array) -> float:
    """What the verifier certifies of a candidate, s.

    Raises:
        TrajoptError: it certifies nothing, or anything but the fitness.
    """
    trajectory = times.trajectory(x)
    certificate = verify(times.problem, trajectory)
    fitness = times.fitness(x)
    duration = certificate.dilation * certificate.duration
    if certificate.flaws or not np.isclose(duration, fitness, rtol=1e-6):
        raise TrajoptError(f"{times.problem.name}: {fitness} s claimed, {duration} s certified")
    return duration


def runs(own: Task, swarm: Minimiser, seeds: int, evaluations: int) -> pd.DataFrame:
    """One duration per seed, s."""
    found = []
    for seed in range(seeds):
        x = swarm(own.times.fitness, own.times.dimension, evaluations, seed)
        found.append(certified(own.times, x))
    return pd.DataFrame({"seed": range(seeds), "duration": found})


def locally(own: Task, evaluations: int) -> pd.DataFrame:
    """The local search from equal times, s."""
    longest = stop_times(own.times.problem).max()
    start = own.times.coordinates(np.full(own.times.dimension, longest))
    x = local_search(own.times.fitness, start, evaluations)
    return pd.DataFrame({"seed": [0], "duration": [certified(own.times, x)]})


def measured(own: Task, seeds: int, evaluations: int, folder: Path) -> pd.DataFrame:
    """Every run on a task that `folder` does not have yet; then all of them."""
    cells = []
    for name, swarm in SWARMS.items():
        run = partial(runs, own, swarm, seeds, evaluations)
        cell = races.stored(folder, f"{own.name} {name}", run)
        cells.append(cell.assign(optimiser=name))
    alone = races.stored(folder, f"{own.name} {LOCAL}", partial(locally, own, evaluations))
    cells.append(alone.assign(optimiser=LOCAL))
    rows = pd.concat(cells, ignore_index=True)
    return rows.assign(
        problem=own.times.problem.name,
        family=own.times.family,
        optimum=own.optimum,
        stopping=own.stopping,
        nlp=own.nlp,
    )


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Quartiles over seeds, s, and the median over the family's best found and the optimum, %."""
    found = []
    for (problem, family), own in rows.groupby(["problem", "family"], sort=False):
        best = own["duration"].min()
        optimum = own["optimum"].iloc[0]
        for optimiser, cell in own.groupby("optimiser", sort=False):
            first, median, third = cell["duration"].quantile([0.25, 0.5, 0.75])
            row = {
                "problem": problem,
                "family": family,
                "optimiser": optimiser,
                "runs": len(cell),
                "first quartile s": first,
                "median s": median,
                "third quartile s": third,
                "median over the family's best %": 100 * (median / best - 1),
                "median over the optimum %": 100 * (median / optimum - 1),
            }
            found.append(row)
    return pd.DataFrame(found)


def shares(rows: pd.DataFrame, table: pd.DataFrame) -> pd.DataFrame:
    """Per task: what the choice of the swarm is worth, and what the family costs, %."""
    found = []
    for (problem, family), own in rows.groupby(["problem", "family"], sort=False):
        here = table.query("problem == @problem and family == @family")
        swarms = here[here["optimiser"] != LOCAL]
        alone = here[here["optimiser"] == LOCAL]
        medians = swarms["median s"]
        best = own["duration"].min()
        optimum = own["optimum"].iloc[0]
        stopping = own["stopping"].iloc[0]
        row = {
            "problem": problem,
            "family": family,
            "optimum s": optimum,
            "stopping s": stopping,
            "NLP s": own["nlp"].iloc[0],
            "family's best found s": best,
            "best swarm's median over it %": 100 * (medians.min() / best - 1),
            "worst swarm's median over it %": 100 * (medians.max() / best - 1),
            "local search over it %": 100 * (alone["median s"].iloc[0] / best - 1),
            "family over the optimum %": 100 * (best / optimum - 1),
            "family over stopping %": 100 * (best / stopping - 1),
        }
        found.append(row)
    return pd.DataFrame(found)


@plots.styled
def figure(rows: pd.DataFrame) -> Figure:
    """A panel per task: every run over the optimum, by optimiser; stopping is marked."""
    groups = list(rows.groupby(["problem", "family"], sort=False))
    drawn = Figure(figsize=(6.8, 2.1 * ((len(groups) + 1) // 2)), layout="constrained")
    grid = drawn.subplots((len(groups) + 1) // 2, 2, squeeze=False).ravel()
    for axes, ((problem, family), own) in zip(grid, groups, strict=False):
        _panel(axes, own)
        axes.set_title(f"{problem}, {family}")
    for axes in grid[len(groups) :]:
        axes.set_axis_off()
    handles, names = grid[0].get_legend_handles_labels()
    drawn.legend(handles, names, loc="outside lower center", ncols=3)
    return drawn


def _panel(axes: Axes, own: pd.DataFrame) -> None:
    optimum = own["optimum"].iloc[0]
    names = list(dict.fromkeys(own["optimiser"]))
    axes.axvline(1.0, color=style.BLUE, lw=1.8, label="best known motion")
    axes.axvline(
        own["stopping"].iloc[0] / optimum,
        color=style.VERMILION,
        ls=style.DASHES[1],
        label="stopping at every waypoint",
    )
    for row, name in enumerate(names):
        ratios = own.loc[own["optimiser"] == name, "duration"] / optimum
        axes.plot(ratios, np.full(len(ratios), row), ls="none", marker=".", color=style.GREY)
        label = "median (runs: dots)" if row == 0 else None
        axes.plot(
            ratios.median(),
            row,
            ls="none",
            marker="o",
            mfc="white",
            color=style.BLACK,
            label=label,
        )
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel="duration over the best known (ratio, log)")
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(style.plain)


def main(
    *,
    seeds: int = 9,
    evaluations: int = 600,
    only: str = "",
    output: Path = Path("results/recipes"),
    quick: bool = False,
) -> None:
    """Give every family to every swarm.

    Args:
        seeds: runs of each swarm.
        evaluations: of each run.
        only: tasks whose problem and family, as "six-axis, 3-5-3", hold this text.
        output: folder of the tables and the figure; what is in it already is not run again.
        quick: one task, hardly searched.
    """
    tasks = [own for own in TASKS if only in ", ".join(own)]
    if not tasks:
        known = "; ".join(", ".join(own) for own in TASKS)
        raise InvalidInput("--only", f"a part of one of {known}", value=only)
    if quick:
        seeds = 2
        evaluations = 60
        tasks = tasks[:1]
    folder = output / f"{seeds}-seeds-{evaluations}-evaluations"
    parts = []
    with console.progress(len(tasks), "tasks") as advance:
        for name, family in tasks:
            rows = measured(task(name, family), seeds, evaluations, folder)
            parts.append(rows)
            advance(1)
    rows = pd.concat(parts, ignore_index=True)
    table = summary(rows)
    decided = shares(rows, table)
    save_table(table, output / "recipes")
    save_table(decided, output / "shares")
    plots.save(figure(rows), output / "recipes")
    print(table.to_string(index=False, float_format="{:.4g}".format))
    print(decided.to_string(index=False, float_format="{:.4g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
