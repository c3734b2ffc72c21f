"""Is a swarm needed? PSO, SSA and ISSA beside CMA-ES, differential evolution and the NLP.

    python -m experiments.swarms                # 21 problems, 25 seeds, ten minutes
    python -m experiments.swarms --quick

Each optimiser searches the 3-5-3 times with the paper's kind of fitness (a penalty) and with every
candidate scaled to the limits, at equal evaluation budgets; `spline353-nlp` solves the same
problems. Written to `--output`: `summary`, `compared`, `nlp`, `speed`.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Literal

import cyclopts
import numpy as np
import pandas as pd

from baselines.evolution import CMAES, DE
from baselines.spline353_nlp import Spline353NLP
from experiments.common import races
from experiments.common.kept import Rows, chosen, kept
from experiments.common.output import save_table
from trajopt import Problem, verify
from trajopt.planners.swarm import ISSA, PSO, SSA, Optimiser
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.analysis import statistics

OPTIMISERS: dict[str, Optimiser] = {
    "pso": PSO(),
    "ssa": SSA(),
    "issa": ISSA(),
    "cmaes": CMAES(),
    "de": DE(),
}
FITNESS: tuple[Literal["penalty"], Literal["scaled"]] = ("penalty", "scaled")
NLP = "spline353-nlp"
BATCH = 25  # runs at once


def entrants(evaluations: int) -> dict[str, SwarmPlanner]:
    """Every optimiser with either fitness."""
    planners = {}
    for fitness in FITNESS:
        for name, optimiser in OPTIMISERS.items():
            planner = SwarmPlanner(optimiser, fitness=fitness, evaluations=evaluations)
            planners[f"{name} {fitness}"] = planner
    return planners


def cpu(work: Callable[[], object]) -> float:
    """Processor time of a call in this process, s."""
    began = time.process_time()
    work()
    return time.process_time() - began


def speed(
    problem: Problem,
    evaluations: int,
    repeats: int,
) -> pd.DataFrame:
    """Processor time per evaluation (µs) of a run alone and of 25 together, the least of repeats.

    All in one process, in turns, so that their ratios outlast the machine and its load.
    """
    planners = entrants(evaluations)
    alone = dict.fromkeys(planners, np.inf)
    batched = dict.fromkeys(planners, np.inf)
    for _, name in itertools.product(range(repeats), planners):
        solve = planners[name].solve_batch
        for best, seeds in ((alone, 1), (batched, BATCH)):
            spent = cpu(partial(solve, problem, range(seeds)))
            cost = 1e6 * spent / seeds / evaluations
            best[name] = min(cost, best[name])
    columns = {
        "entrant": list(planners),
        "alone (µs)": list(alone.values()),
        "batched (µs)": list(batched.values()),
    }
    return pd.DataFrame(columns)


def nlp(
    problem: Problem,
    bound: float,
    repeats: int,
) -> Rows:
    """The NLP's gap on one problem and its processor time (s), compiling not counted."""
    solve = partial(Spline353NLP().solve, problem)
    gap = np.inf
    least = np.nan
    trajectory = solve().trajectory
    if trajectory is not None:
        certificate = verify(problem, trajectory)
        duration = certificate.certified_duration or np.inf
        gap = duration / bound - 1
        least = min(cpu(solve) for _ in range(repeats))
    return [{"gap": gap, "seconds": least}]


def seconds(
    outcome: races.Outcome,
    costs: pd.DataFrame,
    solved: pd.DataFrame,
) -> np.ndarray:
    """Expected processor time to 0.1 %, `(problems, solvers)`, the NLP last; +inf where never.

    A swarm's is its expected evaluations times what one costs, alone, on the six-axis problem.
    """
    target = list(races.TARGETS).index("0.1 %")
    hits = outcome.hits[target]
    spent = statistics.expected_running_time(hits, outcome.evaluations)
    cost = costs["alone (µs)"].to_numpy()
    swarms = np.asarray(spent) * cost / 1e6
    reached = solved["gap"] <= races.TARGETS["0.1 %"]
    own = np.where(reached, solved["seconds"], np.inf)
    return np.column_stack([swarms, own])


def summary(
    outcome: races.Outcome,
    costs: pd.DataFrame,
    solved: pd.DataFrame,
) -> pd.DataFrame:
    """`races.summary` with costs, and the NLP as its last row."""
    table = races.summary(outcome)
    timed = costs.set_index("entrant")
    alone = timed["alone (µs)"]
    table[list(timed)] = timed
    table["cost ratio, alone"] = alone / alone["pso penalty"]
    table.loc[NLP] = nlp_row(outcome, solved)
    expected = seconds(outcome, costs, solved)
    medians = np.asarray(statistics.median(expected.T))
    table["median over problems of expected CPU to 0.1 % (ms)"] = 1e3 * medians
    return table


def nlp_row(outcome: races.Outcome, solved: pd.DataFrame) -> pd.Series[float]:
    """The NLP's gaps (%) and success rates, in the columns of `races.summary`."""
    widths = outcome.proof["width"]
    gaps = np.maximum(solved["gap"], widths).to_numpy()
    row = races.gaps(gaps[None]).loc[0]
    for name, target in races.TARGETS.items():
        row[f"success {name}"] = (gaps <= target).mean()
    return row


def pairs() -> list[tuple[str, str]]:
    """Scaled with penalty; at the same fitness, everyone with PSO, and ISSA with SSA."""
    found = [(f"{name} scaled", f"{name} penalty") for name in OPTIMISERS]
    rivals = [(name, "pso") for name in OPTIMISERS if name != "pso"]
    rivals.append(("issa", "ssa"))
    for fitness in FITNESS:
        for own, other in rivals:
            pair = (f"{own} {fitness}", f"{other} {fitness}")
            found.append(pair)
    return found


def main(
    *,
    problems: int = 20,
    seeds: int = 25,
    evaluations: int = 4000,
    output: Path = Path("results/swarms"),
    quick: bool = False,
) -> None:
    """Race the optimisers on the six-axis problem and on random ones."""
    repeats = 3
    if quick:
        problems = 1
        seeds = 2
        evaluations = 100
        repeats = 1
    field = races.problems(problems)
    outcome = races.run(
        entrants(evaluations),
        field,
        seeds,
        evaluations,
        output,
    )
    cells = {}
    for problem, bound in zip(field, outcome.proof["lower_bound"], strict=True):
        cells[problem.name,] = partial(nlp, problem, bound, repeats)
    solved = chosen(kept(output / "nlp.csv", ["problem"], cells), ["problem"], cells)
    timed = min(evaluations, 1000)
    timing = {(field[0].name,): partial(speed, field[0], timed, repeats)}
    costs = kept(output / f"speed-{timed}-evaluations.csv", ["problem"], timing)
    report(
        outcome,
        costs.drop(columns="problem"),
        solved,
        output,
    )


def report(
    outcome: races.Outcome,
    costs: pd.DataFrame,
    solved: pd.DataFrame,
    output: Path,
) -> None:
    """Write the tables, and print the first two."""
    stem = output / outcome.stem
    tables = {
        "summary": summary(outcome, costs, solved),
        "compared": races.compared(outcome, pairs()),
    }
    for name, table in tables.items():
        save_table(table, stem / name)
    save_table(solved, stem / "nlp")
    save_table(costs, stem / "speed")
    save_table(outcome.proof, stem / "optima")
    for table in tables.values():
        print(table.to_string(float_format="{:.4g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
