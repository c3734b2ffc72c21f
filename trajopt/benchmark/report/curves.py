"""Curves and tables of a suite: profiles, ECDFs, searches, pairs. No answer is worse than any."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trajopt.benchmark.analysis import statistics
from trajopt.benchmark.analysis.pairwise import medians, paired_tests, pairs_by_problem
from trajopt.benchmark.analysis.results import competing
from trajopt.benchmark.analysis.searches import Histories, over_best, running_times
from trajopt.benchmark.figures import sampling
from trajopt.benchmark.figures.style import GAP_FLOOR
from trajopt.benchmark.report import pairwise as rivals
from trajopt.benchmark.report.packing import rounded
from trajopt.benchmark.report.page import Page, limit_kinds, suites_of
from trajopt.problem import Problem

Array = NDArray[np.float64]
Curve = dict[str, Any]  # planner (its place), x, y or low, middle and high

POINTS = 160
BAND_POINTS = 60
TARGET = 1.01  # times the best known of its family: what counts as found


def suites(page: Page) -> list[dict[str, Any]]:
    """The curves and pairs of all problems, of each suite, and of each kind of limits."""
    problems = dict(zip(page.digests, page.problems, strict=True))
    found, met = page.results.histories(), pairs_by_problem(competing(page.gaps))
    return [
        {"name": name, "problems": len(members)}
        | _suite(page.gaps[page.gaps["digest"].isin(members)], [found[d] for d in members],
                 page.labels)
        | {"paired": rivals.pairs(paired_tests(met[met["digest"].isin(members)]), page.labels)}
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


def bands(runs: Mapping[str, Sequence[Array]], labels: Sequence[str]) -> list[Curve]:
    """Per planner, quartiles over its runs of the best by so many evaluations."""
    curves = []
    for label, own in runs.items():
        spent, quartiles = sampling.over_runs(own, BAND_POINTS)
        low, middle, high = (rounded(quartile, 6) for quartile in quartiles)
        curves.append(
            {
                "planner": labels.index(label),
                "x": spent.tolist(),
                "runs": len(own),
                "low": low,
                "middle": middle,
                "high": high,
            }
        )
    return curves


def _suite(gaps: pd.DataFrame, found: Sequence[Histories], labels: Sequence[str]) -> dict[str, Any]:
    durations = medians(gaps, "certified_duration")
    ran = durations.notna().sum()
    whole = [label for label in labels if ran.get(label) == len(durations)]
    partly = {label: int(n) for label, n in ran.items() if n < len(durations)}
    stacked = over_best(found)
    kinds = gaps.drop_duplicates("digest")["kind"].value_counts()
    return {
        "partly": partly, "kinds": {str(k): int(n) for k, n in kinds.items()},
        "unknown": int(gaps.drop_duplicates("digest")["reference"].isna().sum()),
        "profile": _profile(durations, whole, labels), "ecdf": _ecdf(gaps, whole, labels),
        "searched": sum(bool(np.isfinite(best)) for best, _ in found),
        "times": _times(stacked, labels), "convergence": bands(stacked, labels),
        "ert": rivals.times(running_times(stacked), labels),
    }  # fmt: skip


def _profile(durations: pd.DataFrame, whole: Sequence[str], labels: Sequence[str]) -> list[Curve]:
    """Performance profiles of the median certified durations."""
    if not whole:
        return []
    table = durations[whole].to_numpy()
    with np.errstate(invalid="ignore"):
        ratios = table / table.min(axis=1, keepdims=True)
    top = ratios[np.isfinite(ratios)].max(initial=1.0)
    taus = np.geomspace(1, max(1.1, 1.02 * top), POINTS)
    x, shares = statistics.performance_profile(table, taus)
    return [_steps(labels.index(k), x, y) for k, y in zip(whole, shares.T, strict=True)]


def _ecdf(gaps: pd.DataFrame, whole: Sequence[str], labels: Sequence[str]) -> list[Curve]:
    """Share of runs within a gap (%); gaps below `GAP_FLOOR` are drawn at it."""
    known = gaps[gaps["reference"].notna()]
    runs = {k: 100 * known.loc[known["label"] == k, "gap"].to_numpy() for k in whole}
    runs = {k: np.maximum(v, GAP_FLOOR) for k, v in runs.items() if len(v)}  # NaN stays NaN
    top = max((np.nanmax(v, initial=1.0) for v in runs.values()), default=1.0)
    grid = np.geomspace(GAP_FLOOR, 1.1 * top, POINTS)
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
