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
GAP_FLOOR = 1e-4  # %: differences below it count as at it, where a log axis ends


def everywhere(durations: pd.DataFrame) -> list[str]:
    """The planners that were run on every problem, of `pairwise.medians`."""
    return [str(label) for label in durations if durations[label].notna().all()]


def profile(durations: pd.DataFrame) -> Curves:
    """Share of problems solved within `x` times the shortest median (Dolan and Moré 2002).

    Args:
        durations: columns of `pairwise.medians`, s.
    """
    if durations.empty:
        return {}
    table = durations.to_numpy()
    with np.errstate(invalid="ignore"):
        ratios = table / table.min(axis=1, keepdims=True)
    worst = ratios[np.isfinite(ratios)].max(initial=1.0)
    taus = np.geomspace(1, max(1.1, 1.02 * worst), POINTS)
    shares = statistics.performance_profile(table, taus)
    return {str(label): (taus, y) for label, y in zip(durations, shares.T, strict=True)}


def gap_shares(gaps: pd.DataFrame, labels: Sequence[str]) -> Curves:
    """Share of problems within a gap of `x` %, of each the share of its runs that are.

    Gaps below `GAP_FLOOR` count as at it.

    Args:
        gaps: `Results.gaps()`; problems without a reference are left out.
        labels: The planners, by their names with options.
    """
    known = gaps[gaps["reference"].notna()]
    by_problem = {}
    worst = 1.0
    for label in labels:
        own = known[known["label"] == label]
        percent = 100 * own["gap"]
        drawn = np.maximum(percent, GAP_FLOOR)  # NaN stays NaN
        if len(own):
            problems = drawn.groupby(own["digest"])
            by_problem[label] = [runs.to_numpy() for _, runs in problems]
            worst = np.nanmax(drawn.to_numpy(), initial=worst)
    return mean_shares(by_problem, np.geomspace(GAP_FLOOR, 1.1 * worst, POINTS))


def mean_shares(values: Mapping[str, Sequence[Array]], grid: Array) -> Curves:
    """Per planner the share of values up to each of the grid, as a mean over groups of values."""
    curves = {}
    for label, groups in values.items():
        shares = [statistics.ecdf(own, grid) for own in groups]
        curves[label] = (grid, np.mean(shares, axis=0))
    return curves


def anytime(relative: Mapping[str, Sequence[Array]]) -> Curves:
    """Quartiles of the gap (%) over all runs, by what was spent, on one grid for all planners.

    Args:
        relative: Histories of `searches.over_optimum`.

    Returns:
        What was spent `(POINTS,)`, and quartiles `(3, POINTS)`, +inf where too few have an answer.
    """
    spent = np.concatenate([run[:, 0] for runs in relative.values() for run in runs])
    first = spent[spent > 0].min()
    grid = np.geomspace(first, spent.max(), POINTS)
    grid[-1] = spent.max()  # as rounding must not cut the last answer off
    curves = {}
    for label, runs in relative.items():
        quartiles = statistics.quartiles_over_runs(runs, grid)
        curves[label] = (grid, 100 * (quartiles - 1))
    return curves
