"""Is a swarm needed? PSO, SSA and ISSA beside CMA-ES, differential evolution and the NLP.

    python -m experiments.swarms                # 21 problems, 25 seeds, ten minutes
    python -m experiments.swarms --quick

Each optimiser searches the 3-5-3 times with the paper's kind of fitness (a penalty) and with every
candidate dilated to the limits, at equal evaluation budgets; `spline353-nlp` solves the same
problems. `--output` keeps the trials, and holds the tables `summary`, `compared` and `optima`.
`python tests/soak.py speed` measures what an evaluation costs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cyclopts

from baselines.evolution import CMAES, DE
from baselines.spline353_nlp import Spline353NLP
from experiments.common import races
from trajopt.planners.planner import Planner
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


def entrants(evaluations: int) -> dict[str, Planner]:
    """Every optimiser with either fitness, and the NLP."""
    planners: dict[str, Planner] = {}
    for fitness in FITNESS:
        for name, optimiser in OPTIMISERS.items():
            planner = SwarmPlanner(optimiser, fitness=fitness, evaluations=evaluations)
            planners[f"{name} {fitness}"] = planner
    return planners | {NLP: Spline353NLP()}


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
    outcome = races.run(entrants(evaluations), races.problems(problems), seeds, output)
    tables = {"summary": races.summary(outcome), "compared": races.compared(outcome, pairs())}
    races.report(tables | {"optima": outcome.proof}, output)


if __name__ == "__main__":
    cyclopts.run(main)
