"""Races on the 3-5-3 segment times: equal budgets, shared seeds, gaps to the proved optimum.

A race is a comparison: its folder keeps the trials, and an interrupted race goes on where it
stopped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from experiments.common.output import save_table, say
from trajopt import Problem, Results, compare
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.core.arrays import Array
from trajopt.core.exceptions import TrajoptError
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.views.analysis import pairwise, searches, statistics

TARGETS = {"1 %": 1e-2, "0.1 %": 1e-3, "0.01 %": 1e-4}
FIRST = "six-axis"
PROOF = "prove:family=spline353,within=1e-6,time_limit=20"
JOBS = 2
ROUNDING_RTOL = 1e-9  # of a certified duration


def problems(random: int) -> list[Problem]:
    """The six-axis problem, then `random_problem(seed, waypoints=4)` for the first seeds."""
    drawn = [random_problem(seed, waypoints=4) for seed in range(random)]
    return [suite.load(FIRST), *drawn]


@dataclass(frozen=True, eq=False)
class RaceResult:
    """Result of a race.

    Attributes:
        runs: A row per run: `label` of the entrant, `problem`, `digest` and `group` (each problem
            is its own), and the `gap` of its certified duration to the proved lower bound, +inf
            without a valid answer. A gap below the proof's own width counts as that width.
        histories: Each entrant's histories over the lower bound, as of `searches.over_best`.
        proof: The lower bound (s) and its width, relative, by the problem's name.
    """

    runs: pd.DataFrame
    histories: Mapping[str, Sequence[Array]]
    proof: pd.DataFrame

    @property
    def medians(self) -> pd.DataFrame:
        """Median gaps over the seeds, an entrant per row, a problem per column."""
        gaps = self.runs.groupby(["label", "problem"])["gap"].median().unstack("problem")
        return gaps.loc[list(self.histories)]


def run(
    entrants: Mapping[str, Planner], field: Sequence[Problem], seeds: int, folder: Path
) -> RaceResult:
    """Compare the entrants on problems, and prove the best 3-5-3 of each.

    Raises:
        TrajoptError: a run is below the proved bound: a bug, never a result.
    """
    contestants = [*entrants.items(), ("proof", load(PROOF))]
    say(f"{len(contestants)} planners on {len(field)} problems")
    line = console.progress_line()
    results = compare(field, contestants, folder, seeds=seeds, jobs=JOBS, progress=line)
    return outcome(results, list(entrants))


def outcome(results: Results, entrants: Sequence[str]) -> RaceResult:
    """Return the outcome of a comparison in which `proof` bounds every problem."""
    proofs = {}
    for trial in results.items:
        if trial.planner == "proof":
            stats = trial.solution.stats
            proofs[trial.problem.name] = (stats["lower_bound"], stats["proved_within"])
    rows = []
    histories: dict[str, list[Array]] = {name: [] for name in entrants}
    for trial in results.items:
        if trial.planner not in entrants:
            continue
        bound, width = proofs[trial.problem.name]
        history = trial.certified_history / [1.0, bound]
        if len(history) == 1:
            history[0, 1] = (trial.certified_duration or np.nan) / bound
        histories[trial.planner].append(history)
        _, answer = history[-1]
        if answer < 1 - ROUNDING_RTOL:
            raise TrajoptError(f"{trial.label} is below the proved bound: {answer - 1:.2g} of it")
        row = {
            "label": trial.planner,
            "problem": trial.problem.name,
            "digest": trial.digest,
            "group": trial.digest,
            "gap": np.inf if np.isnan(answer) else max(answer - 1, width),
        }
        rows.append(row)
    columns = ["lower bound s", "width"]
    proof = pd.DataFrame.from_dict(proofs, orient="index", columns=columns)
    return RaceResult(pd.DataFrame(rows), histories, proof.rename_axis("problem"))


def summary(outcome: RaceResult) -> pd.DataFrame:
    """A row per entrant: gaps (%), success rates, expected evaluations to each target.

    Gap quartiles are of the medians per problem. Success rates and expected evaluations are over
    all runs of all problems.
    """
    medians = outcome.medians
    first = outcome.runs[outcome.runs["problem"] == FIRST].groupby("label")["gap"].median()
    quartiles = statistics.quantile(medians, statistics.QUARTILES)
    names = ["first quartile (%)", "median gap (%)", "third quartile (%)"]
    table = 100 * pd.DataFrame(quartiles, medians.index, names)
    table.insert(0, "six-axis median gap (%)", 100 * first)
    costs = searches.running_times(outcome.histories, list(TARGETS.values()))
    for name, target in TARGETS.items():
        own = costs.xs(target, level="target")
        table[f"success {name}"] = own["successes"] / own["runs"]
        table[f"evaluations to {name}"] = own["ert"].where(own["ert"] > 0)  # 0: none are counted
    return table.rename_axis("entrant")


def compared(outcome: RaceResult, pairs: Sequence[tuple[str, str]]) -> pd.DataFrame:
    """A row per `(entrant, reference)`; "shorter" is the chance that a run of the entrant is.

    Over problems: Wilcoxon's test of ratios of median gaps, one per problem, and the mean over
    problems of that chance (all seeds against all). On the six-axis problem: Mann and Whitney's
    test over the seeds. Holm's family is a column.
    """
    # gaps are compared: they differ in digits in which durations are tied
    runs = outcome.runs.assign(certified_duration=outcome.runs["gap"])
    over_problems = pairwise.paired_tests(pairwise.pairs_by_problem(runs)).loc[pairs]
    over_seeds = pairwise.between_seeds(runs[runs["problem"] == FIRST]).loc[pairs]
    columns = {"better": "better", "tied": "equal", "worse": "worse", "pvalue": "p"}
    table = over_problems[list(columns)].rename(columns=columns)
    table["p (Holm)"] = statistics.holm(table["p"])
    table["shorter"] = over_problems["chance"]
    table["six-axis p"] = over_seeds["pvalue"]
    table["six-axis p (Holm)"] = statistics.holm(table["six-axis p"])
    return table.rename_axis(["entrant", "reference"])


def against(outcome: RaceResult, reference: str) -> pd.DataFrame:
    """Every other entrant compared with `reference`, as `compared` does."""
    pairs = [(name, reference) for name in outcome.histories if name != reference]
    return compared(outcome, pairs)


def report(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    """Write the tables, and print them."""
    for name, table in tables.items():
        save_table(table, folder / name)
        print(f"{name}:\n{table.to_string(float_format='{:.4g}'.format)}")


def mean(values: Array) -> Array:
    """Over the last axis, as `statistics.bootstrap` wants it."""
    return np.asarray(values.mean(axis=-1))
