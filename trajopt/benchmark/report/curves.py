"""Curves of a suite: profiles, ECDFs, running times, convergence. No answer is worse than any."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trajopt.benchmark import statistics
from trajopt.benchmark.figures import BEST_353
from trajopt.benchmark.plots import FLOOR
from trajopt.benchmark.report import lines
from trajopt.benchmark.report.content import Page, limit_kinds, suites_of
from trajopt.benchmark.report.packing import rounded
from trajopt.benchmark.results import TOLERANCE
from trajopt.benchmark.trial import Trial
from trajopt.problem import Problem

Array = NDArray[np.float64]
Found = tuple[float, dict[str, list[Array]]]  # the best known (s), and histories by label
Curve = dict[str, Any]  # planner (its place), x, y or low, middle and high

POINTS = 160
TARGET = 1.01  # times the best known of its family: what counts as found


def suites(page: Page) -> list[dict[str, Any]]:
    """The curves of all problems, of each suite, and of each kind of limits."""
    problems = dict(zip(page.digests, page.problems, strict=True))
    found = dict(zip(page.digests, map(histories, page.trials_by_problem), strict=True))
    return [
        {"name": name, "problems": len(members)}
        | _suite(page.gaps[page.gaps["digest"].isin(members)], [found[d] for d in members],
                 page.labels)
        for name, members in groups(problems).items()
    ]  # fmt: skip


def groups(problems: Mapping[str, Problem]) -> dict[str, list[str]]:
    """Named groups of digests: all, then those of 2 problems or more that are not all of them."""
    found: dict[str, list[str]] = {}
    for digest, problem in problems.items():
        names = [f"limits: {limit_kinds(problem)}", *suites_of(problem)]
        for name in names:
            found.setdefault(name, []).append(digest)
    return {"all problems": list(problems)} | {
        name: members for name, members in found.items() if 1 < len(members) < len(problems)
    }


def histories(trials: Sequence[Trial]) -> Found:
    """One problem's best 3-5-3 (s; NaN if unknown), and per planner the history of every run."""
    best = min((t.certified_duration or np.inf for t in trials if t.planner == BEST_353),
               default=np.inf)  # fmt: skip
    runs: dict[str, list[Array]] = {}
    for trial in trials:
        runs.setdefault(trial.label, []).append(_certified(trial))
    return (best if best < np.inf else np.nan), runs


def searches(found: Sequence[Found]) -> set[str]:
    """Planners that kept a history on any of the problems and beat the best 3-5-3 on none.

    The evaluations of those that beat it are of something else.
    """
    least = [(label, min(np.nanmin(h[:, 1], initial=np.inf) for h in own), best)
             for best, runs in found for label, own in runs.items()]  # fmt: skip
    beaten = {label for label, duration, best in least if duration < best * (1 - TOLERANCE)}
    return {label for label, duration, _ in least if duration < np.inf} - beaten


def _certified(trial: Trial) -> Array:
    """A run's history times its own dilation; without a certified answer it found nothing."""
    history = trial.solution.history
    if history is None or trial.certified_duration is None or trial.certificate is None:
        return np.array([[0.0, np.nan]])
    return np.array(history) * [1.0, max(1.0, trial.certificate.dilation)]


def bands(runs: Mapping[str, Sequence[Array]], labels: Sequence[str]) -> list[Curve]:
    """Per planner, quartiles over its runs of the best by so many evaluations."""
    curves = []
    for label, own in runs.items():
        spent = np.unique(np.geomspace(1, max(2.0, *(h[-1, 0] for h in own)), 60).round())
        quartiles = statistics.quantile(statistics.fixed_budget(own, spent), [0.25, 0.5, 0.75])
        parts = dict(zip(("low", "middle", "high"), np.asarray(quartiles).T, strict=True))
        curves.append({"planner": labels.index(label), "x": spent.tolist(), "runs": len(own)}
                      | {k: rounded(v, 6) for k, v in parts.items()})  # fmt: skip
    return curves


def _suite(gaps: pd.DataFrame, found: Sequence[Found], labels: Sequence[str]) -> dict[str, Any]:
    medians = lines.medians(gaps, "certified_duration")
    ran = medians.notna().sum()
    whole = [label for label in labels if ran.get(label) == len(medians)]
    partly = {label: int(n) for label, n in ran.items() if n < len(medians)}
    known = [(best, runs) for best, runs in found if np.isfinite(best)]
    stacked = {
        label: [h / [1.0, best] for best, runs in known for h in runs.get(label, [])]
        for label in sorted(searches(known))
    }
    kinds = gaps.drop_duplicates("digest")["kind"].value_counts()
    return {
        "partly": partly, "kinds": {str(k): int(n) for k, n in kinds.items()},
        "unknown": int(gaps.drop_duplicates("digest")["reference"].isna().sum()),
        "profile": _profile(medians, whole, labels), "ecdf": _ecdf(gaps, whole, labels),
        "searched": len(known), "times": _times(stacked, labels),
        "convergence": bands(stacked, labels),
    }  # fmt: skip


def _profile(medians: pd.DataFrame, whole: Sequence[str], labels: Sequence[str]) -> list[Curve]:
    """Performance profiles of the median certified durations."""
    if not whole:
        return []
    table = medians[whole].to_numpy()
    with np.errstate(invalid="ignore"):
        ratios = table / table.min(axis=1, keepdims=True)
    top = ratios[np.isfinite(ratios)].max(initial=1.0)
    taus = np.geomspace(1, max(1.1, 1.02 * top), POINTS)
    x, shares = statistics.performance_profile(table, taus)
    return [_steps(labels.index(k), x, y) for k, y in zip(whole, shares.T, strict=True)]


def _ecdf(gaps: pd.DataFrame, whole: Sequence[str], labels: Sequence[str]) -> list[Curve]:
    """Share of runs within a gap (%); those below `FLOOR`, negative ones too, are drawn at it."""
    known = gaps[gaps["reference"].notna()]
    runs = {k: 100 * known.loc[known["label"] == k, "gap"].to_numpy() for k in whole}
    runs = {k: np.maximum(v, FLOOR) for k, v in runs.items() if len(v)}  # NaN stays NaN
    top = max((np.nanmax(v, initial=1.0) for v in runs.values()), default=1.0)
    grid = np.geomspace(FLOOR, 1.1 * top, POINTS)
    return [_steps(labels.index(k), *statistics.ecdf(v, grid)) for k, v in runs.items()]


def _times(stacked: Mapping[str, list[Array]], labels: Sequence[str]) -> list[Curve]:
    """Share of runs within `TARGET` of the best 3-5-3, against evaluations spent."""
    hits = {k: statistics.evaluations_to_target(runs, TARGET) for k, runs in stacked.items()}
    top = max((run[-1, 0] for runs in stacked.values() for run in runs), default=2.0)
    grid = np.geomspace(1, max(2.0, top), POINTS)
    return [_steps(labels.index(k), *statistics.ecdf(v, grid)) for k, v in hits.items()]


def _steps(planner: int, x: Array, y: Array) -> Curve:
    """A staircase, without the points at which nothing happens."""
    kept = np.r_[True, np.diff(y) != 0] | (np.arange(len(y)) == len(y) - 1)
    return {"planner": planner, "x": rounded(x[kept], 7), "y": rounded(y[kept], 4)}
