"""Curves and tables of a suite: profiles, ECDFs, searches, pairs.

A missing answer is worse than every answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.views.analysis import statistics
from trajopt.views.analysis.curves import POINTS, Curves, counted, gap_shares, mean_shares, profile
from trajopt.views.analysis.overview import competing, measured
from trajopt.views.analysis.pairwise import medians, paired_tests, pairs_by_problem, shortest
from trajopt.views.analysis.searches import Histories, over_best, running_times
from trajopt.views.figures import sampling
from trajopt.views.packing import rounded
from trajopt.views.report import rivals
from trajopt.views.report.content import Page, limit_kinds, suites_of

Curve = dict[str, Any]  # planner (its place), x, y or low, middle and high

BAND_POINTS = 60
SEED_PAIRS = 30  # largest number of pairs of planners that are compared on each of several problems
TARGET = 1.01  # a run within this factor of the best of its family counts as a success


def suites(page: Page) -> list[dict[str, Any]]:
    """The curves and pairs of all problems, of each suite, and of each kind of limits."""
    problems = dict(zip(page.digests, page.problems, strict=True))
    histories = page.results.histories()
    pairs = pairs_by_problem(competing(page.gaps), page.results.references()["proved"])
    found = []
    for name, members in groups(problems).items():
        ran = page.gaps["digest"].isin(members)
        met = pairs["digest"].isin(members)
        gaps = page.gaps[ran]
        tests = paired_tests(pairs[met])
        suite = {"name": name, "problems": len(members)}
        own = [histories[digest] for digest in members]
        suite |= _suite(gaps, own, page.labels)
        suite |= {"paired": rivals.pairs(tests, page.labels)}
        found.append(suite)
    return found


def between_seeds(page: Page) -> list[dict[str, Any]]:
    """Compare planners with several runs on each problem, if the page has few of them."""
    pairs = _seed_pairs(page)
    if len(page.problems) > 1 and pairs.sum() > SEED_PAIRS:
        return []
    found = []
    for problem in page.problems:
        if not pairs.get(problem.digest(), 0):
            continue
        tests = page.results.between_seeds(problem.digest())
        if len(tests):
            lines = rivals.seeds(tests, page.labels)
            first = next(place for place, own in enumerate(lines) if own)
            found.append({"name": problem.name, "paired": lines, "first": first})
    return found


def _seed_pairs(page: Page) -> pd.Series[int]:
    """Count the pairs of planners with several runs each, by the problem's digest."""
    runs = competing(page.gaps).groupby(["digest", "label"]).size()
    several = runs[runs > 1]
    planners = several.groupby("digest").size()
    return planners * (planners - 1) // 2


def groups(problems: Mapping[str, Problem]) -> dict[str, list[str]]:
    """Named groups of digests: all, then those of 2 problems or more that are not all of them."""
    found: dict[str, list[str]] = {}
    for digest, problem in problems.items():
        names = [f"limits: {limit_kinds(problem)}", *suites_of(problem)]
        for name in names:
            found.setdefault(name, []).append(digest)
    parts = {"all problems": list(problems)}
    for name, members in found.items():
        if 1 < len(members) < len(problems):
            parts[name] = members
    return parts


def bands(runs: Mapping[str, Sequence[Array]], labels: Sequence[str]) -> list[Curve]:
    """Per planner, quartiles over its runs of the best by so many evaluations."""
    curves = []
    for label, own in runs.items():
        spent, quartiles = sampling.over_runs(own, BAND_POINTS)
        low, middle, high = quartiles
        curves.append(
            {
                "planner": labels.index(label),
                "x": spent.tolist(),
                "runs": len(own),
                "low": rounded(low, 6),
                "middle": rounded(middle, 6),
                "high": rounded(high, 6),
            }
        )
    return curves


def _suite(gaps: pd.DataFrame, found: Sequence[Histories], labels: Sequence[str]) -> dict[str, Any]:
    ran = medians(gaps).notna().sum()
    durations = medians(competing(gaps))
    every = gaps["digest"].nunique()
    whole = [label for label in labels if ran.get(label) == every and label in durations]
    partly = {label: int(count) for label, count in ran.items() if count < every}
    relative = over_best(found)
    problems = gaps.drop_duplicates("digest")
    kinds = problems["kind"].value_counts()
    known = [own for own in found if np.isfinite(own.best)]
    return {
        "partly": partly,
        "counted": counted(durations[whole]),
        "kinds": {str(kind): int(count) for kind, count in kinds.items()},
        "unknown": int(problems["reference"].isna().sum()),
        "profile": _drawn(profile(durations[whole], shortest(gaps)), labels),
        "ecdf": _drawn(gap_shares(measured(gaps), whole), labels),
        "searched": len(known),
        "times": _times(relative, labels),
        "convergence": bands(relative, labels),
        "ert": rivals.times(running_times(relative), labels),
    }


def _times(relative: Mapping[str, list[Array]], labels: Sequence[str]) -> list[Curve]:
    """Share of runs within `TARGET` of the best 3-5-3, against evaluations spent."""
    hits = {}
    longest = 2.0
    for label, runs in relative.items():
        hits[label] = [statistics.evaluations_to_target(runs, TARGET)]
        longest = max(longest, *(run[-1, 0] for run in runs))
    grid = np.geomspace(1, longest, POINTS)
    return _drawn(mean_shares(hits, grid), labels)


def _drawn(curves: Curves, labels: Sequence[str]) -> list[Curve]:
    return [_steps(labels.index(label), x, y) for label, (x, y) in curves.items()]


def _steps(planner: int, x: Array, y: Array) -> Curve:
    """Return a staircase without the points at which it does not step."""
    changes = np.diff(y, prepend=np.nan) != 0  # the first point too
    changes[-1] = True
    return {"planner": planner, "x": rounded(x[changes], 7), "y": rounded(y[changes], 4)}
