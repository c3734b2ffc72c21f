"""Is a swarm needed? PSO, SSA and ISSA beside CMA-ES, differential evolution and the NLP.

    python -m experiments.swarms                # 21 problems, 25 seeds, ten minutes
    python -m experiments.swarms --quick

Each optimiser searches the 3-5-3 times with the paper's kind of fitness (a penalty) and with every
candidate scaled to the limits, at equal evaluation budgets; `spline353-nlp` solves the same
problems. Written to `--output`: `summary`, `compared`, `nlp`. `experiments.speed` measures what an
evaluation costs.
"""

from __future__ import annotations

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

OPTIMISERS: dict[str, Optimiser] = {
    "pso": PSO(),
    "ssa": SSA(),
    "issa": ISSA(),
    "cmaes": CMAES(),
    "de": DE(),
}
FITNESS: tuple[Literal["penalty"], Literal["scaled"]] = ("penalty", "scaled")
NLP = "spline353-nlp"


def entrants(evaluations: int) -> dict[str, SwarmPlanner]:
    """Every optimiser with either fitness."""
    planners = {}
    for fitness in FITNESS:
        for name, optimiser in OPTIMISERS.items():
            planner = SwarmPlanner(optimiser, fitness=fitness, evaluations=evaluations)
            planners[f"{name} {fitness}"] = planner
    return planners


def nlp(problem: Problem, bound: float) -> Rows:
    """The NLP's gap on one problem, to a proved bound, s."""
    gap = np.inf
    trajectory = Spline353NLP().solve(problem).trajectory
    if trajectory is not None:
        certificate = verify(problem, trajectory)
        duration = certificate.certified_duration or np.inf
        gap = duration / bound - 1
    return [{"gap": gap}]


def summary(outcome: races.Outcome, solved: pd.DataFrame) -> pd.DataFrame:
    """`races.summary` with the NLP's gaps (%) and success rates as its last row."""
    widths = outcome.proof["width"]
    gaps = np.maximum(solved["gap"], widths).to_numpy()
    row = races.gaps(gaps[None]).loc[0]
    for name, target in races.TARGETS.items():
        row[f"success {name}"] = (gaps <= target).mean()
    table = races.summary(outcome)
    table.loc[NLP] = row
    return table


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
    if quick:
        problems = 1
        seeds = 2
        evaluations = 100
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
        cells[problem.name,] = partial(nlp, problem, bound)
    solved = chosen(kept(output / "nlp.csv", ["problem"], cells), ["problem"], cells)
    report(outcome, solved, output)


def report(outcome: races.Outcome, solved: pd.DataFrame, output: Path) -> None:
    """Write the tables, and print the first two."""
    stem = output / outcome.stem
    tables = {
        "summary": summary(outcome, solved),
        "compared": races.compared(outcome, pairs()),
    }
    for name, table in tables.items():
        save_table(table, stem / name)
    save_table(solved, stem / "nlp")
    save_table(outcome.proof, stem / "optima")
    for table in tables.values():
        print(table.to_string(float_format="{:.4g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
