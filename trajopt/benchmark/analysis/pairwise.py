"""Planners against each other, on the problems that both were run on.

    met = duels(competing(results.trials()))   # one row per problem and pair of planners
    paired(met)                                # one row per planner and rival, over the problems

What counts is the certified duration. No answer is +inf: worse than any, and equal to another.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trajopt.benchmark.analysis import statistics

Array = NDArray[np.float64]

TIED = 6  # significant digits of durations that mean something: equal ones are tied
RESAMPLES = 1999  # of the problems: an interval is then good to two digits
KEYS = ["planner", "against"]
COLUMNS = ("problems", "better", "tied", "worse", "ratio", "a12", "low", "high", "pvalue", "holm")


def medians(runs: pd.DataFrame, column: str) -> pd.DataFrame:
    """Per problem (rows) and planner (columns) the median over runs; +inf if half have no answer.

    NaN where a planner was not run on a problem.
    """
    cells = runs.groupby(["digest", "label"])[column].agg(lambda v: float(statistics.median(v)))
    return cells.unstack("label")


def distinct(duration: float) -> float:
    """The duration to the digits that mean something, `TIED` of them."""
    return float(f"{duration:.{TIED}g}")


def duels(runs: pd.DataFrame) -> pd.DataFrame:
    """One row per problem and pair of planners run on it, each pair once, of `Results.trials()`.

    `own` and `theirs`, median certified durations (s) of `planner` and `against`; `a12`, how
    probable it is that a run of `planner` is shorter than one of `against`, ties counting half.
    """
    durations = runs["certified_duration"].fillna(np.inf).map(distinct)
    met: dict[str, dict[str, Array]] = {}
    for (digest, label), own in durations.groupby([runs["digest"], runs["label"]]):
        met.setdefault(digest, {})[label] = own.to_numpy()
    rows = []
    for digest, own in met.items():
        middle = {label: _median(values) for label, values in own.items()}
        rows += [
            (digest, a, b, middle[a], middle[b], float(statistics.a12(own[b], own[a])))
            for a, b in combinations(sorted(own), 2)
        ]
    return pd.DataFrame(rows, columns=["digest", *KEYS, "own", "theirs", "a12"])


def paired(duels: pd.DataFrame) -> pd.DataFrame:
    """One row per `planner` and `against`, both ways, over the problems of their duels.

    `problems`, and on how many of them `planner` is `better`, `tied` or `worse`, by its median,
    equal to `TIED` digits tied. `ratio`: the median over problems of its duration to the other's,
    the geometric mean of the two in the middle; 0 or +inf where only one has an answer, NaN
    between the two. `a12`, the mean over problems, and `low` to `high`, its 95 % bootstrap interval
    over problems (NaN if there is one only). `pvalue` of Wilcoxon's signed-rank test over problems
    on log ratios: where only one has an answer, the ratio is the largest of all. `holm`: the same,
    adjusted for every pair of the table, each counted once (Holm 1979).
    """
    rows = {key: _row(group) for key, group in duels.groupby(KEYS)}
    table = pd.DataFrame.from_dict(rows, orient="index", columns=list(COLUMNS[:-1]))
    table.index = pd.MultiIndex.from_tuples(rows, names=KEYS) if rows else _NOBODY
    table["holm"] = statistics.holm(table["pvalue"])
    return pd.concat([table, _mirrored(table)]).sort_index()


_NOBODY = pd.MultiIndex.from_arrays([[], []], names=KEYS)


def _row(group: pd.DataFrame) -> tuple[Any, ...]:
    own, theirs = np.log(group["own"].to_numpy()), np.log(group["theirs"].to_numpy())
    test = statistics.wilcoxon(own, theirs)
    shorter = statistics.bootstrap(_mean, group["a12"], resamples=RESAMPLES)
    return (
        len(group), test.wins, test.ties, test.losses, _middle(own, theirs),
        shorter.value, shorter.low, shorter.high, test.pvalue,
    )  # fmt: skip


def _middle(own: Array, theirs: Array) -> float:
    """The median ratio, from logarithms; the same both ways, but for its inverse."""
    with np.errstate(invalid="ignore"):
        logs = np.sort(np.where(own == theirs, 0.0, own - theirs))
        return float(np.exp((logs[(len(logs) - 1) // 2] + logs[len(logs) // 2]) / 2))


def _mirrored(table: pd.DataFrame) -> pd.DataFrame:
    """The same, as the other planner of each pair sees it."""
    swapped = {"better": "worse", "worse": "better", "low": "high", "high": "low"}
    found = table.rename(columns=swapped)
    found.index = found.index.swaplevel().set_names(KEYS)
    found["ratio"] = 1 / found["ratio"]
    found[["a12", "low", "high"]] = 1 - found[["a12", "low", "high"]]
    return found[table.columns]


def _mean(values: Array) -> Array:
    return np.asarray(values.mean(axis=-1))


def _median(values: Array) -> float:
    return distinct(float(statistics.median(values)))
