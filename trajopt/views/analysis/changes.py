"""Compare two results of the same problems and planners: which medians changed significantly.

changes(Results("old"), Results("new"))            # one row per problem and planner
by_planner(Results("old"), Results("new"))         # one row per planner, over the problems
"""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from trajopt.views.analysis.overview import competing
from trajopt.views.analysis.pairwise import between_seeds, medians, paired_tests, pairs_by_problem
from trajopt.views.analysis.results import Tables
from trajopt.views.analysis.statistics import holm

SIGNIFICANCE = 0.05
_NEW = ("new", "old")  # the pair of `pairwise` tables: `new` against `old`
_COLUMNS = ["problem", "label", "old", "new", "runs", "ratio", "pvalue"]


def changes(old: Tables, new: Tables) -> pd.DataFrame:
    """One row per problem and planner that both have, by problem and planner.

    Columns:
        problem, label: the problem, and the planner with its options.
        old, new: median certified durations, s; +inf where half of the runs have no answer.
        runs: number of the new runs.
        ratio: new to old.
        pvalue: of Mann and Whitney's test between the runs, NaN unless both have several.
        holm: the same, adjusted for all rows that have one (Holm 1979).
        moved: True if `holm` is below `SIGNIFICANCE`. Without runs to test, as with deterministic
            planners: True if the medians differ in 6 digits.
    """
    rows = []
    for label, both in _shared(old, new):
        for _, runs in both.groupby("digest", sort=False):
            middle = medians(runs).iloc[0]
            tests = between_seeds(runs)
            pvalue = tests["pvalue"].get(_NEW, float("nan"))
            count = (runs["label"] == "new").sum()
            durations = (middle["old"], middle["new"])
            ratio = _ratio(*durations)
            rows.append((runs["problem"].iloc[0], label, *durations, count, ratio, pvalue))
    table = pd.DataFrame(rows, columns=_COLUMNS)
    tested = table["pvalue"].notna()
    table["holm"] = table["pvalue"]
    table.loc[tested, "holm"] = holm(table.loc[tested, "pvalue"])
    differ = table["old"] != table["new"]
    table["moved"] = (table["holm"] < SIGNIFICANCE).where(tested, differ)
    return table.sort_values(["problem", "label"], ignore_index=True)


def by_planner(old: Tables, new: Tables) -> pd.DataFrame:
    """One row per planner that both have: the new medians against the old, over the problems.

    The columns are those of `pairwise.paired_tests`; `holm` counts the planners.
    """
    rows = {}
    for label, both in _shared(old, new):
        tests = paired_tests(pairs_by_problem(both))
        rows[label] = tests.loc[[_NEW]]
    if not rows:
        return pd.DataFrame()
    table = pd.concat(rows).droplevel(["planner", "against"])
    return table.assign(holm=holm(table["pvalue"]))


def _shared(old: Tables, new: Tables) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield each planner that both have, and its runs on the problems that both have.

    The runs are labelled `old` and `new`.
    """
    keys = ["label", "digest"]
    frames = {"old": competing(old.trials()), "new": competing(new.trials())}
    # each pair once before the merge, which would have a row for every two runs
    named = [frame[keys].drop_duplicates() for frame in frames.values()]
    common = named[0].merge(named[1])
    parts = [frame.merge(common).assign(side=side) for side, frame in frames.items()]
    for label, runs in pd.concat(parts).groupby("label"):
        yield str(label), runs.assign(label=runs["side"])


def _ratio(old: float, new: float) -> float:
    """Return the ratio of two durations; 1 where neither has an answer."""
    return 1.0 if old == new else new / old
