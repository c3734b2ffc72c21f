"""Curves over many problems, per planner: performance profile, gaps, searches.

A missing answer is worse than every answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from trajopt.core.arrays import Array
from trajopt.views.analysis import statistics

Curves = dict[str, tuple[Array, Array]]  # x and y of each planner

POINTS = 160
GAP_FLOOR = 1e-4  # %: smaller gaps are drawn at this value, the end of the log axis


def everywhere(durations: pd.DataFrame) -> list[str]:
    """The planners that were run on every problem, of `pairwise.medians`."""
    return [str(label) for label in durations if durations[label].notna().all()]


def counted(durations: pd.DataFrame) -> dict[str, str]:
    """Return how many problems each planner does not refuse, for those that refuse some."""
    every = len(durations)
    counts = durations.notna().sum()
    return {str(label): f"{n} of {every}" for label, n in counts.items() if n < every}


def profile(durations: pd.DataFrame, shortest: pd.Series[float] | None = None) -> Curves:
    """Share of problems solved within `x` times the shortest duration (Dolan and Moré 2002).

    All shares are of the same problems, so that curves can be compared. A problem that a
    planner refuses counts as not solved by it.

    Args:
        durations: columns of `pairwise.medians`, s. NaN where a planner does not compete.
        shortest: the shortest certified duration of any planner, s, by problem; by default the
            shortest of `durations`.
    """
    best = durations.min(axis=1) if shortest is None else shortest
    costs = durations.fillna(np.inf)
    pairs = {
        str(label): np.stack([costs[label], best[costs.index]], axis=-1)
        for label in durations
        if durations[label].notna().any()
    }
    if not pairs:
        return {}
    with np.errstate(invalid="ignore"):
        ratios = np.concatenate([own / least for own, least in (p.T for p in pairs.values())])
    worst = ratios[np.isfinite(ratios)].max(initial=1.0)
    taus = np.geomspace(1, max(1.1, 1.02 * worst), POINTS)
    shares = {label: statistics.performance_profile(own, taus) for label, own in pairs.items()}
    return {label: (taus, of_both[:, 0]) for label, of_both in shares.items()}


def gap_shares(gaps: pd.DataFrame, labels: Sequence[str]) -> Curves:
    """Return the share of problems within a gap of `x` %: of each, the share of its runs.

    All shares are of the same problems, those with a known optimum; a planner that refuses one is
    within no gap on it. Gaps below `GAP_FLOOR` are drawn at `GAP_FLOOR`.

    Args:
        gaps: `overview.measured(Results.gaps())`; problems without a reference are left out.
        labels: The planners, by their names with options.
    """
    known = gaps[gaps["reference"].notna()]
    by_problem = {}
    every = known["digest"].nunique()
    worst = 1.0
    for label in labels:
        own = known[known["label"] == label]
        percent = 100 * own["gap"]
        drawn = np.maximum(percent, GAP_FLOOR)  # NaN stays NaN
        if len(own):
            problems = drawn.groupby(own["digest"])
            found = [runs.to_numpy() for _, runs in problems]
            by_problem[label] = found + [np.array([np.nan])] * (every - len(found))
            worst = np.nanmax(drawn.to_numpy(), initial=worst)
    return mean_shares(by_problem, np.geomspace(GAP_FLOOR, 1.1 * worst, POINTS))


def mean_shares(values: Mapping[str, Sequence[Array]], grid: Array) -> Curves:
    """Return, per planner, the share of values up to each grid value, as a mean over groups."""
    curves = {}
    for label, groups in values.items():
        shares = [statistics.ecdf(own, grid) for own in groups]
        curves[label] = (grid, np.mean(shares, axis=0))
    return curves


def anytime(relative: Mapping[str, Sequence[Array]]) -> Curves:
    """Quartiles of the gap (%) over all runs, by what was spent, on one grid for all planners.

    A planner whose runs all answer once, at their end, is a point: the median of what they spent.

    Args:
        relative: Histories of `searches.over_optimum`.

    Returns:
        The cost `(POINTS,)`, or `(1,)` for a point, and quartiles `(3, POINTS)`, +inf where too few
        runs have an answer.
    """
    spent = np.concatenate([run[:, 0] for runs in relative.values() for run in runs])
    first = spent[spent > 0].min()
    grid = np.geomspace(first, spent.max(), POINTS)
    grid[-1] = spent.max()  # exactly: rounding must not exclude the last answer
    curves = {}
    for label, runs in relative.items():
        quartiles = 100 * (statistics.quartiles_over_runs(runs, grid) - 1)
        curves[label] = (grid, quartiles)
        if all(len(run) == 1 for run in runs):
            middle = np.median([run[0, 0] for run in runs], keepdims=True)
            curves[label] = (middle, quartiles[:, -1:])
    return curves
