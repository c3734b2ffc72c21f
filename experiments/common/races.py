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
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from baselines.lower_bound import certify
from trajopt import Problem, verify
from trajopt.benchmark.analysis import statistics
from trajopt.benchmark.figures import plots, style
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.exceptions import TrajoptError
from trajopt.swarm_planner import SwarmPlanner

Array = NDArray[np.float64]

TARGETS = {"1 %": 1e-2, "0.1 %": 1e-3, "0.01 %": 1e-4}


def problems(random: int) -> list[Problem]:
    """The six-axis problem, then `random_problem(seed, waypoints=4)` for the first seeds."""
    drawn = [random_problem(seed, waypoints=4) for seed in range(random)]
    return [suite.load("six-axis"), *drawn]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came out: `gaps` `(problems, entrants, seeds)`, +inf without an answer within limits.

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
    def medians(self) -> Array:
        """Over the seeds, `(entrants, problems)`."""
        return np.asarray(statistics.median(self.gaps)).T


def run(
    entrants: Mapping[str, SwarmPlanner], field: Sequence[Problem], seeds: int, evaluations: int,
    folder: Path,
) -> Outcome:  # fmt: skip
    """Every cell that `folder` does not have yet, problem by problem; then all of them.

    Raises `TrajoptError` if a run is below the proved bound: a bug, never a result.
    """
    proofs, cells = [], []
    with console.progress(len(field) * len(entrants)) as advance:
        for problem in field:
            proofs.append(kept(folder / "optima", problem.name, partial(proved, problem)))
            bound = float(proofs[-1]["lower_bound"].iloc[0])
            for name, planner in entrants.items():
                cell = partial(measured, problem, planner, seeds, bound)
                cells.append(kept(folder / "runs", f"{problem.name} {name}", cell))
                advance(1)
    optima, rows = pd.concat(proofs, ignore_index=True), pd.concat(cells)
    if (rows["gap"] < 0).any():
        raise TrajoptError(f"a run is below the proved bound: relative gap {rows['gap'].min():.2g}")
    shape = len(field), len(entrants), seeds
    gaps = rows["gap"].to_numpy().reshape(shape)
    gaps = np.maximum(gaps, optima["width"].to_numpy()[:, None, None])
    hits = np.stack([rows[target].to_numpy().reshape(shape) for target in TARGETS])
    return Outcome(list(entrants), optima, gaps, hits, evaluations)


def kept(folder: Path, name: str, make: partial[pd.DataFrame]) -> pd.DataFrame:
    """The table that `make` gives, made only once: written to `folder` and renamed into place.

    Its file's name ends in a digest of the arguments of `make`: other options, another file.
    """
    digest = hashlib.sha256(repr(make.args).encode()).hexdigest()[:10]
    file = folder / f"{name} {digest}.csv"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        part = file.with_suffix(".part")
        make().to_csv(part, index=False)
        part.replace(file)
    return pd.read_csv(file)


def proved(problem: Problem) -> pd.DataFrame:
    """Bounds on the best 3-5-3 (s), their relative width, how they ended, seconds spent."""
    bound = certify(problem, "spline353", gap=1e-6, time_limit=20.0)
    found = {"problem": problem.name, "joints": problem.joints, "lower_bound": bound.lower_bound}
    found |= {"upper_bound": bound.upper_bound, "width": bound.upper_bound / bound.lower_bound - 1}
    return pd.DataFrame([found | {"status": bound.status, "seconds": bound.solve_time}])


def measured(problem: Problem, planner: SwarmPlanner, seeds: int, bound: float) -> pd.DataFrame:
    """A row per seed: the gap to a lower bound (s), and evaluations to each target."""
    found = planner.solve_batch(problem, range(seeds))
    histories = [np.asarray(solution.history) for solution in found]
    feasible = [not np.isnan(history[-1, 1]) for history in histories]
    durations = [verify(problem, s.trajectory).certified_duration for s in found if s.trajectory]
    gaps = np.where(feasible, np.array(durations, dtype=float) / bound - 1, np.inf)
    hits = statistics.evaluations_to_target(histories, bound * (1 + np.array([*TARGETS.values()])))
    return pd.DataFrame({"seed": range(seeds), "gap": gaps} | dict(zip(TARGETS, hits, strict=True)))


def summary(outcome: Outcome) -> pd.DataFrame:
    """A row per entrant: gaps (%), success rates, expected evaluations to each target, mean rank.

    Gap quartiles are of the medians per problem. Success rates are over all runs, with a bootstrap
    interval over problems; expected evaluations too are over all runs of all problems.
    """
    medians = outcome.medians
    quartiles = 100 * np.asarray(statistics.quantile(medians, [0.25, 0.5, 0.75, 1]))
    columns = {"six-axis median gap (%)": 100 * medians[:, 0]}
    heads = ("first quartile (%)", "median gap (%)", "third quartile (%)", "worst problem (%)")
    columns |= dict(zip(heads, quartiles.T, strict=True))
    for target, hits in zip(TARGETS, outcome.hits, strict=True):
        rates = np.isfinite(hits).mean(axis=-1).T
        found = [statistics.bootstrap(mean, rate) for rate in rates]
        columns[f"success {target}"] = np.array([f.value for f in found])
        columns[f"success {target} low"] = np.array([f.low for f in found])
        columns[f"success {target} high"] = np.array([f.high for f in found])
    for target, hits in zip(TARGETS, outcome.hits, strict=True):
        flat = hits.swapaxes(0, 1).reshape(len(outcome.names), -1)
        spent = statistics.expected_running_time(flat, outcome.evaluations)
        columns[f"evaluations to {target}"] = np.asarray(spent)
    columns["mean rank"] = statistics.friedman(medians.T).mean_ranks
    return pd.DataFrame(columns, index=pd.Index(outcome.names, name="entrant"))


def against(outcome: Outcome, reference: str) -> pd.DataFrame:
    """Every other entrant compared with `reference`, as `compared` does."""
    return compared(outcome, [(n, reference) for n in outcome.names if n != reference])


def compared(outcome: Outcome, pairs: Sequence[tuple[str, str]]) -> pd.DataFrame:
    """A row per `(entrant, reference)`; A12 below ½: the entrant is better.

    Over problems: Wilcoxon's test of the pairs of median gaps, one pair per problem, and the mean
    over problems of A12 (all seeds against all), its interval a bootstrap over problems. On the
    six-axis problem: the same test, paired by seed, and A12. Holm's family is a column.
    """
    rows = [_compared(outcome, *map(outcome.names.index, pair)) for pair in pairs]
    table = pd.DataFrame(rows, pd.MultiIndex.from_tuples(pairs, names=["entrant", "reference"]))
    for head in ("p", "six-axis p"):
        place = list(table).index(head) + 1
        table.insert(place, f"{head} (Holm)", statistics.holm(table[head]))
    return table


def _compared(outcome: Outcome, own: int, other: int) -> dict[str, float]:
    a, b = outcome.gaps[:, own], outcome.gaps[:, other]
    over = statistics.wilcoxon(outcome.medians[own], outcome.medians[other])
    effect = statistics.bootstrap(mean, np.asarray(statistics.a12(a, b)))
    six = statistics.bootstrap(statistics.a12, a[0], b[0])
    row = {"better": over.wins, "equal": over.ties, "worse": over.losses, "p": over.pvalue}
    row |= {"A12": effect.value, "A12 low": effect.low, "A12 high": effect.high}
    row |= {"six-axis p": statistics.wilcoxon(a[0], b[0]).pvalue, "six-axis A12": six.value}
    return row | {"six-axis A12 low": six.low, "six-axis A12 high": six.high}


def mean(values: Array) -> Array:
    """Over the last axis, as `statistics.bootstrap` wants it."""
    return np.asarray(values.mean(axis=-1))


@plots.styled
def gap_rows(outcome: Outcome, reference: str) -> Figure:
    """Per entrant, the smallest on top: each problem's median gap, their median, and A12."""
    order = np.argsort(np.asarray(statistics.median(outcome.medians)))[::-1]
    figure = Figure(figsize=(7.2, 1.3 + 0.19 * len(order)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    for row, i in enumerate(order):
        _gap_row(left, row, 100 * outcome.medians[i], label=row == 0)
    table = against(outcome, reference).droplevel("reference")
    table = table.reindex([outcome.names[i] for i in order])
    y, effect = np.arange(len(order)), table["A12"].to_numpy(dtype=float)
    right.hlines(y, table["A12 low"], table["A12 high"], color=style.BLUE, lw=1.2)
    right.plot(effect, y, "o", ms=3.5, mfc=style.BLUE, mec=style.BLUE)
    clear = (table["p (Holm)"] < 0.05).to_numpy()
    right.plot(effect[~clear], y[~clear], "o", ms=3.5, mfc="white", mec=style.BLUE,
               label="Holm's p ≥ 0.05")  # fmt: skip
    right.axvline(0.5, color=style.BLACK, lw=0.8, ls=(0, (3, 2)))
    left.set_yticks(y, [outcome.names[i] for i in order])
    left.set(xscale="log", xlabel="gap to the proved 3-5-3 optimum (%)", title=outcome.title)
    right.set(xlim=(-0.03, 1.03), xlabel=f"A12 against {reference} (below ½: better)")
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _gap_row(axes: Axes, y: int, gaps: Array, label: bool) -> None:
    """A dot per problem, the six-axis one marked, and the median with its bootstrap interval."""
    middle = statistics.bootstrap(statistics.median, gaps)
    names = ["a problem's median", "six-axis", "median of all, 95 %"] if label else [None] * 3
    axes.plot(gaps[1:], np.full(len(gaps) - 1, y), "o", ms=2.5, mew=0, color=style.GREY,
              alpha=0.6, label=names[0])  # fmt: skip
    axes.plot(gaps[0], y, "^", ms=4, mfc="white", mec=style.BLACK, mew=0.8, label=names[1])
    ends = [[middle.value - middle.low], [middle.high - middle.value]]
    axes.errorbar(middle.value, y, xerr=np.maximum(ends, 0), fmt="D", ms=3.5, lw=1.2,
                  color=style.VERMILION, label=names[2])  # fmt: skip
