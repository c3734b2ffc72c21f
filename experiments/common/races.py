"""Races on the 3-5-3 segment times: equal budgets, shared seeds, gaps to the proved optimum.

A cell is one entrant on one problem, all its seeds. An interrupted race goes on where it stopped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.lower_bound.bound import certify
from experiments.common.kept import Rows, chosen, kept
from trajopt import Problem, verify
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.suites.random import random_problem
from trajopt.core.arrays import Array
from trajopt.core.exceptions import TrajoptError
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.analysis import statistics

TARGETS = {"1 %": 1e-2, "0.1 %": 1e-3, "0.01 %": 1e-4}


def problems(random: int) -> list[Problem]:
    """The six-axis problem, then `random_problem(seed, waypoints=4)` for the first seeds."""
    drawn = [random_problem(seed, waypoints=4) for seed in range(random)]
    return [suite.load("six-axis"), *drawn]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a race: `gaps` `(problems, entrants, seeds)`, +inf without a valid answer.

    They are certified durations over the proved lower bound, less 1, and where they are below the
    `proof`'s own width, that width: differences within it mean nothing. `hits`
    `(targets, problems, entrants, seeds)` are evaluations to each target, NaN where never.
    """

    names: list[str]
    proof: pd.DataFrame
    gaps: Array
    hits: Array
    evaluations: int

    @property
    def title(self) -> str:
        problems, _, seeds = self.gaps.shape
        return f"{problems} problems, {seeds} seeds, {self.evaluations} evaluations"

    @property
    def stem(self) -> str:
        """The title as a folder's name."""
        return self.title.replace(", ", "-").replace(" ", "-")

    @property
    def medians(self) -> Array:
        """Over the seeds, `(entrants, problems)`."""
        return np.asarray(statistics.median(self.gaps)).T


def run(
    entrants: Mapping[str, SwarmPlanner],
    field: Sequence[Problem],
    seeds: int,
    evaluations: int,
    folder: Path,
) -> Outcome:
    """Compute every cell that `folder` does not have yet; return all of them.

    Raises:
        TrajoptError: a run is below the proved bound: a bug, never a result.
    """
    problems = {(problem.name,): partial(proved, problem) for problem in field}
    proofs = kept(folder / "optima.csv", ["problem"], problems)
    optima = chosen(proofs, ["problem"], problems)
    cells = {}
    for problem, bound in zip(field, optima["lower_bound"], strict=True):
        for name, planner in entrants.items():
            cells[problem.name, name] = partial(measured, problem, planner, seeds, bound)
    columns = ["problem", "entrant"]
    file = folder / f"runs-{seeds}-seeds-{evaluations}-evaluations.csv"
    rows = chosen(kept(file, columns, cells), columns, cells)
    lowest = rows["gap"].min()
    if lowest < 0:
        raise TrajoptError(f"a run is below the proved bound: relative gap {lowest:.2g}")
    shape = (len(field), len(entrants), seeds)
    gaps = rows["gap"].to_numpy().reshape(shape)
    widths = optima["width"].to_numpy()
    hits = rows[list(TARGETS)].to_numpy().T
    return Outcome(
        list(entrants),
        optima,
        gaps=np.maximum(gaps, widths[:, None, None]),
        hits=hits.reshape(-1, *shape),
        evaluations=evaluations,
    )


def proved(problem: Problem) -> Rows:
    """Bounds on the best 3-5-3 (s), their relative width, how they ended, seconds spent."""
    bound = certify(problem, "spline353", within=1e-6, time_limit=20.0)
    row = {
        "joints": problem.joints,
        "lower_bound": bound.lower_bound,
        "upper_bound": bound.upper_bound,
        "width": bound.upper_bound / bound.lower_bound - 1,
        "status": bound.status,
        "seconds": bound.solve_time,
    }
    return [row]


def measured(
    problem: Problem,
    planner: SwarmPlanner,
    seeds: int,
    bound: float,
) -> pd.DataFrame:
    """A row per seed: the gap to a lower bound (s), and evaluations to each target."""
    histories = []
    gaps = []
    for solution in planner.solve_batch(problem, range(seeds)):
        assert solution.trajectory is not None
        history = np.asarray(solution.history)
        histories.append(history)
        duration = verify(problem, solution.trajectory).certified_duration
        if duration is None or np.isnan(history[-1, 1]):
            gaps.append(np.inf)
        else:
            gaps.append(duration / bound - 1)
    gap_targets = np.array(list(TARGETS.values()))
    targets = bound * (1 + gap_targets)
    hits = statistics.evaluations_to_target(histories, targets)
    columns = {
        "seed": range(seeds),
        "gap": gaps,
        **dict(zip(TARGETS, hits, strict=True)),
    }
    return pd.DataFrame(columns)


def summary(outcome: Outcome) -> pd.DataFrame:
    """A row per entrant: gaps (%), success rates, expected evaluations to each target.

    Gap quartiles are of the medians per problem. Success rates and expected evaluations are over
    all runs of all problems.
    """
    table = gaps(outcome.medians)
    table.index = pd.Index(outcome.names, name="entrant")
    for target, hits in zip(TARGETS, outcome.hits, strict=True):
        by_entrant = hits.swapaxes(0, 1).reshape(len(outcome.names), -1)
        table[f"success {target}"] = np.isfinite(by_entrant).mean(axis=1)
        spent = statistics.expected_running_time(by_entrant, outcome.evaluations)
        table[f"evaluations to {target}"] = np.asarray(spent)
    return table


def gaps(medians: Array) -> pd.DataFrame:
    """Return the gap on the first problem and the quartiles over problems, %.

    Args:
        medians: Gaps, ratios minus 1, `(entrants, problems)`.
    """
    quartiles = np.asarray(statistics.quantile(medians, [0.25, 0.5, 0.75]))
    columns = {
        "six-axis median gap (%)": medians[:, 0],
        "first quartile (%)": quartiles[:, 0],
        "median gap (%)": quartiles[:, 1],
        "third quartile (%)": quartiles[:, 2],
    }
    return 100 * pd.DataFrame(columns)


def against(outcome: Outcome, reference: str) -> pd.DataFrame:
    """Every other entrant compared with `reference`, as `compared` does."""
    pairs = [(name, reference) for name in outcome.names if name != reference]
    return compared(outcome, pairs)


def compared(outcome: Outcome, pairs: Sequence[tuple[str, str]]) -> pd.DataFrame:
    """A row per `(entrant, reference)`; "shorter" is the chance that a run of the entrant is.

    Over problems: Wilcoxon's test of the pairs of median gaps, one pair per problem, and the mean
    over problems of that chance (all seeds against all). On the six-axis problem: the same test,
    paired by seed. Holm's family is a column.
    """
    rows = [_compared(outcome, *pair) for pair in pairs]
    index = pd.MultiIndex.from_tuples(pairs, names=["entrant", "reference"])
    table = pd.DataFrame(rows, index)
    for head in ("p", "six-axis p"):
        place = list(table).index(head) + 1
        adjusted = statistics.holm(table[head])
        table.insert(place, f"{head} (Holm)", adjusted)
    return table


def _compared(
    outcome: Outcome,
    entrant: str,
    reference: str,
) -> dict[str, float]:
    own = outcome.names.index(entrant)
    other = outcome.names.index(reference)
    a = outcome.gaps[:, own]
    b = outcome.gaps[:, other]
    medians = outcome.medians
    over_problems = statistics.wilcoxon(medians[own], medians[other])
    chances = np.asarray(statistics.shorter_chance(a, b))
    six_axis = statistics.wilcoxon(a[0], b[0])
    return {
        "better": over_problems.wins,
        "equal": over_problems.ties,
        "worse": over_problems.losses,
        "p": over_problems.pvalue,
        "shorter": chances.mean(),
        "six-axis p": six_axis.pvalue,
    }


def mean(values: Array) -> Array:
    """Over the last axis, as `statistics.bootstrap` wants it."""
    return np.asarray(values.mean(axis=-1))
