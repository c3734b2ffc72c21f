"""The cost of an answer: evaluations of searches of the best 3-5-3, or any planner's seconds.

    problems = [histories(trials) for trials in by_problem]
    running_times(over_best(problems))                         # expected evaluations to each target
    running_times(over_optimum(trials, optima, "seconds"))     # of any planner, to the optimum

A history is `(m, 2)`: evaluations spent, and the best certified duration by then, s.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from trajopt.benchmark.trial import Trial
from trajopt.core.arrays import Array
from trajopt.explain.references import BEST_353
from trajopt.views.analysis import statistics

Cost = Literal["evaluations", "seconds"]

TARGETS = (0.1, 0.01, 0.001, 0.0001)  # above the optimum or the best 3-5-3, relative
BEATEN_RTOL = 1e-6  # a search that is below the best 3-5-3 by more is no search of 3-5-3 splines


class Histories(NamedTuple):
    """One problem's best 3-5-3 (s; NaN if unknown), and per planner the history of every run."""

    best: float
    runs: Mapping[str, Sequence[Array]]


def histories(trials: Sequence[Trial]) -> Histories:
    """The histories of one problem's trials."""
    best = np.nan
    runs: dict[str, list[Array]] = {}
    for trial in trials:
        own = runs.setdefault(trial.label, [])
        own.append(trial.certified_history)
        duration = trial.certified_duration
        if trial.planner == BEST_353 and duration is not None:
            best = np.fmin(best, duration)
    return Histories(float(best), runs)


def searches(problems: Sequence[Histories]) -> set[str]:
    """Return the planners with a history that are below the best 3-5-3 on no problem.

    A planner below the best 3-5-3 searches other motions.
    """
    searching = set()
    beating = set()
    for best, runs in problems:
        for label, own in runs.items():
            durations = np.vstack(own)[:, 1]
            shortest = np.nanmin(durations, initial=np.inf)
            if shortest < np.inf:
                searching.add(label)
            if shortest < best * (1 - BEATEN_RTOL):
                beating.add(label)
    return searching - beating


def over_best(problems: Sequence[Histories]) -> dict[str, list[Array]]:
    """Per search, every run's history over the best 3-5-3 of its problem, where that is known."""
    known = _known(problems)
    relative: dict[str, list[Array]] = {}
    for label in sorted(searches(known)):
        own = relative.setdefault(label, [])
        for best, runs in known:
            units = [1.0, best]
            for history in runs.get(label, []):
                own.append(history / units)
    return relative


def over_optimum(
    trials: Sequence[Trial], optima: Mapping[str, float], cost: Cost
) -> dict[str, list[Array]]:
    """Per planner, every run's history over the optimum of its problem.

    A run without a history has one row: its answer, after all that it spent. Seconds are spread
    evenly over a run's evaluations.

    Args:
        trials: Answers of any planners.
        optima: Durations by the problem's digest, s; other problems are left out.
        cost: Seconds or evaluations. For evaluations, runs that do not count them are left out.
    """
    relative: dict[str, list[Array]] = {}
    for trial in trials:
        history = trial.certified_history
        spent = history[-1, 0]
        if trial.digest not in optima or (cost == "evaluations" and spent == 0):
            continue
        if len(history) == 1:
            history[0, 1] = trial.certified_duration or np.nan
        if cost == "seconds":
            shares = history[:, 0] / spent if spent else np.ones(len(history))
            history[:, 0] = shares * trial.solve_time
        own = relative.setdefault(trial.label, [])
        own.append(history / [1.0, optima[trial.digest]])
    return relative


def running_times(
    relative: Mapping[str, Sequence[Array]], targets: ArrayLike = TARGETS
) -> pd.DataFrame:
    """`Results.running_times()` of histories `over_best` or `over_optimum`.

    A run that does not state its cost gets the cost of its planner's longest run.
    """
    goals = np.atleast_1d(np.asarray(targets, dtype=float))
    rows = []
    for label, runs in relative.items():
        hits = statistics.evaluations_to_target(runs, 1 + goals)
        last = [run[-1, 0] for run in runs]
        spent = np.array(last)
        longest = max(1.0, spent.max())
        budgets = np.where(spent > 0, spent, longest)
        times = statistics.expected_running_time(hits, budgets)
        ert = np.atleast_1d(times)
        successes = np.isfinite(hits).sum(axis=-1)
        for goal, time, count in zip(goals, ert, successes, strict=True):
            row = {
                "label": label,
                "target": goal,
                "ert": time,
                "successes": count,
                "runs": len(runs),
            }
            rows.append(row)
    columns = ["label", "target", "ert", "successes", "runs"]
    table = pd.DataFrame(rows, columns=columns)
    return table.set_index(["label", "target"])


def _known(problems: Sequence[Histories]) -> list[Histories]:
    return [problem for problem in problems if np.isfinite(problem.best)]
