"""Is a swarm needed? PSO, SSA and ISSA beside CMA-ES, differential evolution and the NLP.

    python -m experiments.swarms                # 21 problems, 25 seeds, ten minutes
    python -m experiments.swarms --quick

Each optimiser searches the 3-5-3 times with the paper's kind of fitness (a penalty) and with every
candidate scaled to the limits, at equal evaluation budgets; `spline353-nlp` solves the same
problems. Written to `--output`: `summary`, `compared`, `nlp`, `speed` and two figures.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import cyclopts
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from baselines.evolution import CMAES, DE
from baselines.spline353_nlp import Spline353NLP
from experiments.common import races
from experiments.common.output import save_table
from trajopt import Problem, verify
from trajopt.benchmark.analysis import statistics
from trajopt.benchmark.figures import plots, style
from trajopt.cli import console
from trajopt.swarm import ISSA, PSO, SSA, Optimiser
from trajopt.swarm_planner import SwarmPlanner

OPTIMISERS: dict[str, Optimiser] = {
    "pso": PSO(), "ssa": SSA(), "issa": ISSA(), "cmaes": CMAES(), "de": DE(),
}  # fmt: skip
FITNESS: tuple[Literal["penalty"], Literal["scaled"]] = ("penalty", "scaled")
NLP, BATCH = "spline353-nlp", 25
DIMENSION = 3  # segment times


def entrants(evaluations: int) -> dict[str, SwarmPlanner]:
    """Every optimiser with either fitness."""
    found = {name: SwarmPlanner(o, evaluations=evaluations) for name, o in OPTIMISERS.items()}
    return {f"{n} {f}": replace(p, fitness=f) for f in FITNESS for n, p in found.items()}


def cpu(work: Callable[[], object]) -> float:
    """Processor time of a call in this process, s."""
    began = time.process_time()
    work()
    return time.process_time() - began


def speed(problem: Problem, evaluations: int, repeats: int) -> pd.DataFrame:
    """Processor time per evaluation (µs) of a run alone and of 25 together, the least of repeats.

    All in one process, in turns, so that their ratios outlast the machine and its load.
    """
    planners, best = entrants(evaluations), dict[tuple[str, int], float]()
    cells = itertools.product(range(repeats), planners.items(), (1, BATCH))
    for _, (name, planner), seeds in cells:
        spent = cpu(partial(planner.solve_batch, problem, range(seeds)))
        cost = 1e6 * spent / seeds / evaluations
        best[name, seeds] = min(cost, best.get((name, seeds), np.inf))
    rows = [(name, best[name, 1], best[name, BATCH]) for name in planners]
    return pd.DataFrame(rows, columns=["entrant", "alone (µs)", "batched (µs)"])


def nlp(problem: Problem, bound: float, repeats: int) -> pd.DataFrame:
    """The NLP's gap on one problem and its processor time (s), compiling not counted."""
    solved = Spline353NLP().solve(problem)
    if solved.trajectory is None:
        return pd.DataFrame([{"problem": problem.name, "gap": np.inf, "seconds": np.nan}])
    gap = (verify(problem, solved.trajectory).certified_duration or np.inf) / bound - 1
    spent = min(cpu(partial(Spline353NLP().solve, problem)) for _ in range(repeats))
    return pd.DataFrame([{"problem": problem.name, "gap": gap, "seconds": spent}])


def seconds(outcome: races.Outcome, costs: pd.DataFrame, solved: pd.DataFrame) -> np.ndarray:
    """Expected processor time to 0.1 %, `(problems, solvers)`, the NLP last; +inf where never.

    A swarm's is its expected evaluations times what one costs, alone, on the six-axis problem.
    """
    hits = outcome.hits[list(races.TARGETS).index("0.1 %")]
    spent = np.asarray(statistics.expected_running_time(hits, outcome.evaluations))
    own = np.where(solved["gap"] <= races.TARGETS["0.1 %"], solved["seconds"], np.inf)
    return np.column_stack([spent * costs["alone (µs)"].to_numpy() / 1e6, own])


def summary(outcome: races.Outcome, costs: pd.DataFrame, solved: pd.DataFrame) -> pd.DataFrame:
    """`races.summary` with costs, and the NLP as its last row."""
    table, timed = races.summary(outcome), costs.set_index("entrant")
    table[list(timed)] = timed
    table["cost ratio, alone"] = timed["alone (µs)"] / timed.loc["pso penalty", "alone (µs)"]
    gaps = np.maximum(solved["gap"], outcome.proof["width"]).to_numpy()
    row = dict(zip(list(table)[1:5], 100 * statistics.summary(gaps)[1:], strict=True))
    row |= {"six-axis median gap (%)": 100 * gaps[0]}
    row |= {f"success {name}": (gaps <= target).mean() for name, target in races.TARGETS.items()}
    table.loc[NLP] = pd.Series(row)
    spent = 1e3 * np.asarray(statistics.median(seconds(outcome, costs, solved).T))
    table["median over problems of expected CPU to 0.1 % (ms)"] = spent
    return table


@plots.styled
def profiles(outcome: races.Outcome, cost: np.ndarray) -> Figure:
    """Data profiles at the three targets, and the performance profile of processor time."""
    figure = Figure(figsize=(6.8, 4.8), layout="constrained")
    grid = figure.subplots(2, 2, sharey=True).ravel()
    for axes, (target, hits) in zip(grid, zip(races.TARGETS, outcome.hits, strict=True),
                                    strict=False):  # fmt: skip
        runs = hits.swapaxes(1, 2).reshape(-1, len(outcome.names))
        _curves(axes, *statistics.data_profile(runs, DIMENSION), outcome.names)
        axes.set(title=f"to {target} of the proved optimum", xlabel="evaluations / 4",
                 xlim=(4, outcome.evaluations / 4))  # fmt: skip
    _curves(grid[3], *statistics.performance_profile(cost), [*outcome.names, NLP])
    grid[3].set(title="to 0.1 %, in processor time", xlabel="time over the quickest's (ratio)")
    for axes in grid[::2]:
        axes.set_ylabel("share of runs")
    grid[2].set_ylabel("share of runs (right: of problems)")
    figure.legend(*grid[3].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle(outcome.title, fontsize=9)
    return figure


def _curves(axes: Axes, x: np.ndarray, shares: np.ndarray, names: Sequence[str]) -> None:
    """Colour and marker say which optimiser, dashes which fitness."""
    for name, share in zip(names, shares.T, strict=True):
        kind, _, fitness = name.partition(" ")
        which = [*OPTIMISERS, NLP].index(kind)
        axes.step(x, share, where="post", color=style.CURVES[which], label=name,
                  ls=style.DASHES[fitness == "penalty"], marker=style.MARKERS[which],
                  markevery=(0.05 + 0.02 * which, 0.2), mfc="white")  # fmt: skip
    axes.set(xscale="log", ylim=(-0.03, 1.03))


def pairs() -> list[tuple[str, str]]:
    """Scaled with penalty; at the same fitness, everyone with PSO, and ISSA with SSA."""
    rivals = [(name, "pso") for name in OPTIMISERS if name != "pso"] + [("issa", "ssa")]
    same = [(f"{own} {f}", f"{other} {f}") for f in FITNESS for own, other in rivals]
    return [(f"{name} scaled", f"{name} penalty") for name in OPTIMISERS] + same


def main(
    *, problems: int = 20, seeds: int = 25, evaluations: int = 4000,
    output: Path = Path("results/swarms"), quick: bool = False,
) -> None:  # fmt: skip
    """Race the optimisers on the six-axis problem and on random ones."""
    if quick:
        problems, seeds, evaluations = 1, 2, 100
    repeats, field = 1 if quick else 3, races.problems(problems)
    outcome = races.run(entrants(evaluations), field, seeds, evaluations, output)
    solved = []
    with console.progress(len(field)) as advance:
        for problem, bound in zip(field, outcome.proof["lower_bound"], strict=True):
            run = partial(nlp, problem, bound, repeats)
            solved.append(races.kept(output / "nlp", problem.name, run))
            advance(1)
    costs = partial(speed, field[0], min(evaluations, 1000), repeats)
    report(
        outcome, races.kept(output, "speed", costs), pd.concat(solved, ignore_index=True), output
    )


def report(outcome: races.Outcome, costs: pd.DataFrame, solved: pd.DataFrame, output: Path) -> None:
    """Write the tables and figures, and print the first two."""
    stem = output / outcome.title.replace(", ", "-").replace(" ", "-")
    tables = {"summary": summary(outcome, costs, solved)}
    tables |= {"compared": races.compared(outcome, pairs())}
    for name, table in (tables | {"nlp": solved, "speed": costs, "optima": outcome.proof}).items():
        save_table(table, stem / name)
    plots.save(profiles(outcome, seconds(outcome, costs, solved)), stem / "profiles")
    plots.save(races.gap_rows(outcome, "pso penalty"), stem / "gaps")
    for table in tables.values():
        print(table.to_string(float_format="{:.4g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
