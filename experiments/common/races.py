"""Races on the 3-5-3 segment times: equal budgets, shared seeds, gaps to the proved optimum.

A cell is one entrant on one problem, all its seeds. Its runs go to a file of their own, renamed
into place, so that an interrupted race goes on where it stopped.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from baselines.lower_bound.bound import certify
from trajopt import Problem, verify
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.core.exceptions import TrajoptError
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.analysis import statistics

Array = NDArray[np.float64]

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
    """Every cell that `folder` does not have yet, problem by problem; then all of them.

    Raises:
        TrajoptError: a run is below the proved bound: a bug, never a result.
    """
    proofs = []
    cells = []
    with console.progress(len(field) * len(entrants)) as advance:
        for problem in field:
            proof = stored(folder / "optima", problem.name, partial(proved, problem))
            proofs.append(proof)
            bound = float(proof["lower_bound"].iloc[0])
            for name, planner in entrants.items():
                measure = partial(measured, problem, planner, seeds, bound)
                cell = stored(folder / "runs", f"{problem.name} {name}", measure)
                cells.append(cell)
                advance(1)
    optima = pd.concat(proofs, ignore_index=True)
    rows = pd.concat(cells)
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


def stored(
    folder: Path,
    name: str,
    make: partial[pd.DataFrame],
) -> pd.DataFrame:
    """The table that `make` gives, made only once: written to `folder` and renamed into place.

    Its file's name ends in a digest of the arguments of `make`: other options, another file.
    """
    arguments = repr(make.args).encode()
    digest = hashlib.sha256(arguments).hexdigest()[:10]
    file = folder / f"{name} {digest}.csv"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        part = file.with_suffix(".part")
        make().to_csv(part, index=False)
        part.replace(file)
    return pd.read_csv(file)


def proved(problem: Problem) -> pd.DataFrame:
    """Bounds on the best 3-5-3 (s), their relative width, how they ended, seconds spent."""
    bound = certify(problem, "spline353", within=1e-6, time_limit=20.0)
    row = {
        "problem": problem.name,
        "joints": problem.joints,
        "lower_bound": bound.lower_bound,
        "upper_bound": bound.upper_bound,
        "width": bound.upper_bound / bound.lower_bound - 1,
        "status": bound.status,
        "seconds": bound.solve_time,
    }
    return pd.DataFrame([row])


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
    """A row per entrant: gaps (%), success rates, expected evaluations to each target, mean rank.

    Gap quartiles are of the medians per problem. Success rates are over all runs, with a bootstrap
    interval over problems; expected evaluations too are over all runs of all problems.
    """
    medians = outcome.medians
    quartiles = np.asarray(statistics.quantile(medians, [0.25, 0.5, 0.75, 1]))
    first, middle, third, worst = 100 * quartiles.T
    columns = {
        "six-axis median gap (%)": 100 * medians[:, 0],
        "first quartile (%)": first,
        "median gap (%)": middle,
        "third quartile (%)": third,
        "worst problem (%)": worst,
    }
    for target, hits in zip(TARGETS, outcome.hits, strict=True):
        # `(entrants, problems)`
        rates = np.isfinite(hits).mean(axis=-1).T
        estimates = [statistics.bootstrap(mean, rate) for rate in rates]
        columns[f"success {target}"] = np.array([e.value for e in estimates])
        columns[f"success {target} low"] = np.array([e.low for e in estimates])
        columns[f"success {target} high"] = np.array([e.high for e in estimates])
    for target, hits in zip(TARGETS, outcome.hits, strict=True):
        by_entrant = hits.swapaxes(0, 1)
        flat = by_entrant.reshape(len(outcome.names), -1)
        spent = statistics.expected_running_time(flat, outcome.evaluations)
        columns[f"evaluations to {target}"] = np.asarray(spent)
    columns["mean rank"] = statistics.mean_ranks(medians.T)
    index = pd.Index(outcome.names, name="entrant")
    return pd.DataFrame(columns, index=index)


def against(outcome: Outcome, reference: str) -> pd.DataFrame:
    """Every other entrant compared with `reference`, as `compared` does."""
    pairs = [(name, reference) for name in outcome.names if name != reference]
    return compared(outcome, pairs)


def compared(outcome: Outcome, pairs: Sequence[tuple[str, str]]) -> pd.DataFrame:
    """A row per `(entrant, reference)`; "shorter" is the chance that a run of the entrant is.

    Over problems: Wilcoxon's test of the pairs of median gaps, one pair per problem, and the mean
    over problems of that chance (all seeds against all), with `statistics.mean_interval`. On the
    six-axis problem: the same test, paired by seed, and that chance. Holm's family is a column.
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
    chance = statistics.mean_interval(chances, np.arange(len(chances)))
    six_axis_test = statistics.wilcoxon(a[0], b[0])
    six_axis = statistics.shorter_interval(float(chances[0]), a.shape[1], b.shape[1])
    return {
        "better": over_problems.wins,
        "equal": over_problems.ties,
        "worse": over_problems.losses,
        "p": over_problems.pvalue,
        "shorter": chance.value,
        "shorter low": chance.low,
        "shorter high": chance.high,
        "six-axis p": six_axis_test.pvalue,
        "six-axis shorter": six_axis.value,
        "six-axis shorter low": six_axis.low,
        "six-axis shorter high": six_axis.high,
    }


def mean(values: Array) -> Array:
    """Over the last axis, as `statistics.bootstrap` wants it."""
    return np.asarray(values.mean(axis=-1))
