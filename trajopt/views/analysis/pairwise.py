"""Planners against each other: over the problems that both were run on, or over seeds on one.

    pairs = pairs_by_problem(competing(results.trials()))
    paired_tests(pairs)                  # one row per planner and rival, over the problems
    between_seeds(runs_of_one_problem)   # one row per planner and rival, over their seeds

Planners are compared by certified duration. A missing answer is +inf: worse than every answer, and
equal to another missing one.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trajopt.benchmark.best_known.records import CLOSED_WITHIN
from trajopt.core.arrays import Array
from trajopt.explain.references import OPTIMUM
from trajopt.views.analysis import statistics

TIE_DIGITS = 6  # durations that are equal in this many significant digits are tied
KEYS = ["planner", "against"]
_PROBLEM_COLUMNS = ["digest", "group", *KEYS, "own", "theirs", "chance", "bound"]
_PAIRED_COLUMNS = [
    "problems",
    "groups",
    "better",
    "tied",
    "worse",
    "ratio",
    "chance",
    "low",
    "high",
    "pvalue",
    "proved",
    "decided",
    "both",
    "both_better",
    "both_tied",
    "both_worse",
    "both_ratio",
    "both_pvalue",
]
_SEED_COLUMNS = [
    "runs",
    "rival_runs",
    "median",
    "rival_median",
    "ratio",
    "u",
    "chance",
    "low",
    "high",
    "pvalue",
]
_SWAPPED = {
    "better": "worse",
    "both_better": "both_worse",
    "low": "high",
    "runs": "rival_runs",
    "median": "rival_median",
}
_MIRROR = _SWAPPED | {new: old for old, new in _SWAPPED.items()}


def medians(runs: pd.DataFrame) -> pd.DataFrame:
    """Per problem (rows) and planner (columns) the median certified duration, to `TIE_DIGITS`, s.

    +inf where half of the runs have no answer, NaN where a planner was not run on a problem.
    """
    values = runs["certified_duration"].fillna(np.inf)
    cells = values.groupby([runs["digest"], runs["label"]]).median()
    return cells.map(to_tie_digits).unstack("label")


def shortest(runs: pd.DataFrame) -> pd.Series[float]:
    """Per problem the shortest certified duration of all runs, to `TIE_DIGITS`, s."""
    return runs.groupby("digest")["certified_duration"].min().map(to_tie_digits)


def to_tie_digits(duration: float) -> float:
    """The duration rounded to `TIE_DIGITS` significant digits."""
    return float(f"{duration:.{TIE_DIGITS}g}")


def best_first(table: pd.DataFrame, durations: pd.Series[float]) -> pd.DataFrame:
    """Sort rows by durations; of those equal to `TIE_DIGITS` the optimum is first, then by label.

    Args:
        table: With a column or an index `label`.
        durations: Of each row, s, or relative to the same one.
    """
    ties = durations.map(to_tie_digits)
    labels = table.reset_index()["label"].replace(OPTIMUM, "")
    return table.iloc[np.lexsort([labels, ties])]


def _tie_durations(runs: pd.DataFrame) -> pd.Series[float]:
    """Return certified durations to `TIE_DIGITS` digits, s; +inf for a missing answer."""
    durations = runs["certified_duration"].fillna(np.inf)
    return durations.map(to_tie_digits)


def mean_ranks(runs: pd.DataFrame) -> pd.Series[float]:
    """Mean rank over problems of each planner's median certified duration, 1 the best.

    Ranked are the planners that were run on every problem. Durations equal to `TIE_DIGITS` digits
    share their mean rank; no answer is the last. Empty for fewer than 3 planners.

    Args:
        runs: trials that are `competing`: an answer that ignores a limit on purpose is a lower
            bound, not a slow answer, and has no rank.
    """
    table = medians(runs)
    everywhere = table.notna().all()
    costs = table.loc[:, everywhere]
    if costs.shape[1] < 3:
        return pd.Series(name="rank", dtype=float)
    ranks = statistics.mean_ranks(costs)
    return pd.Series(ranks, costs.columns, name="rank")


def pairs_by_problem(runs: pd.DataFrame, bounds: pd.Series[float] | None = None) -> pd.DataFrame:
    """One row for each problem and each pair of planners that were run on it; a pair has one order.

    Args:
        runs: `Results.trials()`.
        bounds: By digest the duration that no motion beats, s; NaN where none is proved.

    Columns:
        digest, group: the problem, and what it shares with others (`catalogue.group`).
        planner, against: the pair.
        own, theirs: median certified durations of `planner` and of `against`, s.
        chance: that a run of `planner` is shorter than one of `against`, ties counting half.
        bound: that of the problem, s.
    """
    proved = {} if bounds is None else bounds.to_dict()
    durations = _tie_durations(runs)
    problems: dict[str, dict[str, Array]] = {}
    cells = durations.groupby([runs["digest"], runs["label"]])
    for (digest, label), times in cells:
        planners = problems.setdefault(digest, {})
        planners[label] = times.to_numpy()
    groups = runs.drop_duplicates("digest").set_index("digest")["group"]
    rows = []
    for digest, planners in problems.items():
        middle = {label: _median(values) for label, values in planners.items()}
        for a, b in combinations(sorted(planners), 2):
            chance = statistics.shorter_chance(planners[a], planners[b])
            durations = (middle[a], middle[b])
            bound = proved.get(digest, np.nan)
            rows.append((digest, groups[digest], a, b, *durations, float(chance), bound))
    return pd.DataFrame(rows, columns=_PROBLEM_COLUMNS)


def paired_tests(pairs: pd.DataFrame) -> pd.DataFrame:
    """Return one row per ordered pair `planner`, `against`, over the problems of a pair.

    A missing answer is worse than any answer. The columns `both_…` are over those problems on
    which both planners have an answer; only there a ratio of durations exists.

    Columns:
        problems, groups: on which both were run, and of how many groups these are. Problems of one
            arm, paper or random family are one group: they are not independent.
        better, tied, worse: on how many of them `planner` is so, by its median; equal to
            `TIE_DIGITS` digits is tied.
        ratio: median over problems of its duration to the other's, the geometric mean of the two
            in the middle; 0 or +inf where only one has an answer, NaN between the two.
        chance, low, high: mean over groups of the chance that its run is the shorter, and a 95 %
            interval (`statistics.mean_interval`).
        proved: 1 where proved lower bounds decide the difference without a test, else 0: one is
            shorter on all problems where they differ, and each of these problems is `decided`.
        decided: problems on which the shorter one is within `CLOSED_WITHIN` of the proved bound,
            and the ratio of both is larger than that of the shorter one to the bound.
        pvalue: of Wilcoxon's signed-rank test over groups of problems on log ratios; where only one
            has an answer, the ratio is the largest of all.
        holm: the same, adjusted for every pair of the table that is tested, each counted once (Holm
            1979); NaN for what is proved.
        both: problems on which the medians of both are finite; `both_better`, `both_tied`,
            `both_worse`, `both_ratio`, `both_pvalue` and `both_holm` are those above on them;
            without such problems the ratio is NaN and p is 1.
    """
    rows = {key: _paired_row(group) for key, group in pairs.groupby(KEYS)}
    return _both_ways(rows, _PAIRED_COLUMNS)


def between_seeds(runs: pd.DataFrame) -> pd.DataFrame:
    """Return one row per ordered pair `planner`, `against`, over their runs on one problem.

    Runs of different planners are independent samples, even with the same seeds. Planners with a
    single run are left out, since their spread is not known.

    Args:
        runs: `Results.trials()` of one problem.

    Columns:
        runs, rival_runs: how many each has.
        median, rival_median: of the certified durations, s; +inf where half have no answer.
        ratio: of the medians; NaN where neither has one.
        u: pairs of runs of which `planner` has the shorter, ties (to `TIE_DIGITS` digits) counting
            half.
        chance, low, high: `u` over all pairs, and its 95 % interval (Newcombe 2006).
        pvalue: of Mann and Whitney's test, two-sided.
        holm: the same, adjusted for every pair of the table, each counted once (Holm 1979).
    """
    durations = _tie_durations(runs)
    samples = {}
    for label, times in durations.groupby(runs["label"]):
        if len(times) > 1:
            samples[label] = times.to_numpy()
    rows = {}
    for pair in combinations(samples, 2):
        ours, theirs = (samples[label] for label in pair)
        rows[pair] = _seed_row(ours, theirs)
    return _both_ways(rows, _SEED_COLUMNS)


def against(pairs: pd.DataFrame, rival: str) -> pd.DataFrame:
    """The rows of `paired_tests` or `between_seeds` against one rival, the fastest first.

    p is adjusted for those of these rows that are tested; empty if the rival has no pair.
    """
    met = pairs.index.get_level_values("against") == rival
    rows = pairs[met].droplevel("against")
    for name in ("holm", "both_holm"):
        if name in rows:
            rows[name] = _adjusted(rows, name.replace("holm", "pvalue"))
    return rows.sort_values("ratio", kind="stable", na_position="last")


def _both_ways(rows: dict[Any, dict[str, float]], columns: list[str]) -> pd.DataFrame:
    """Return the rows of each pair and of its mirror, with p-values adjusted for all pairs."""
    table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
    if rows:
        table.index = pd.MultiIndex.from_tuples(rows, names=KEYS)
    else:
        table.index = pd.MultiIndex.from_arrays([[], []], names=KEYS)
    for pvalue in [name for name in columns if name.endswith("pvalue")]:
        place = table.columns.get_loc(pvalue) + 1
        table.insert(place, pvalue.replace("pvalue", "holm"), _adjusted(table, pvalue))
    return pd.concat([table, _mirrored(table)]).sort_index()


def _adjusted(table: pd.DataFrame, pvalue: str) -> pd.Series[float]:
    """Return a column of p-values adjusted for the rows that are tested; NaN for those proved."""
    tested = table[pvalue]
    if "proved" in table:
        tested = tested[table["proved"] == 0]
    return pd.Series(statistics.holm(tested), tested.index).reindex(table.index)


def _mirrored(table: pd.DataFrame) -> pd.DataFrame:
    """Return the same table with `planner` and `against` swapped."""
    mirror = table.rename(columns=_MIRROR)
    mirror.index = mirror.index.swaplevel().set_names(KEYS)
    for ratio in ("ratio", "both_ratio"):
        if ratio in mirror:
            mirror[ratio] = 1 / mirror[ratio]
    for share in ("chance", "low", "high"):
        mirror[share] = 1 - mirror[share]
    if "u" in mirror:
        all_pairs = mirror["runs"] * mirror["rival_runs"]
        mirror["u"] = all_pairs - mirror["u"]
    return mirror[table.columns]


def _paired_row(group: pd.DataFrame) -> dict[str, float]:
    ours = np.log(group["own"].to_numpy())
    theirs = np.log(group["theirs"].to_numpy())
    of_group = group["group"].to_numpy()
    test = statistics.wilcoxon(ours, theirs, of_group)
    chance = statistics.mean_interval(group["chance"], of_group)
    answered = np.isfinite(ours) & np.isfinite(theirs)
    decided = _decided(group)
    one_side = min(test.wins, test.losses) == 0 and test.ties < len(group)
    return {
        "problems": len(group),
        "groups": len(set(of_group)),
        "better": test.wins,
        "tied": test.ties,
        "worse": test.losses,
        "ratio": _median_ratio(ours, theirs),
        "chance": chance.value,
        "low": chance.low,
        "high": chance.high,
        "pvalue": test.pvalue,
        "proved": float(one_side and decided == test.wins + test.losses),
        "decided": decided,
    } | _both_answer(ours[answered], theirs[answered], of_group[answered])


def _decided(group: pd.DataFrame) -> int:
    """Count the problems of a pair whose proved bound tells which planner is shorter.

    The shorter median is within `CLOSED_WITHIN` of the bound, and the ratio of both medians is
    larger than that of the shorter one to the bound.
    """
    medians = group[["own", "theirs"]]
    shorter = medians.min(axis=1)
    longer = medians.max(axis=1)
    open_ratio = shorter / group["bound"]
    decided = (open_ratio < 1 + CLOSED_WITHIN) & (longer / shorter > open_ratio)
    return int((decided & (shorter < longer) & np.isfinite(longer)).sum())


def _both_answer(ours: Array, theirs: Array, groups: NDArray[Any]) -> dict[str, float]:
    """Return the columns `both_…` from finite logarithms of durations."""
    if not ours.size:
        nothing = dict.fromkeys(["both", "both_better", "both_tied", "both_worse"], 0)
        return nothing | {"both_ratio": np.nan, "both_pvalue": 1.0}
    test = statistics.wilcoxon(ours, theirs, groups)
    return {
        "both": ours.size,
        "both_better": test.wins,
        "both_tied": test.ties,
        "both_worse": test.losses,
        "both_ratio": _median_ratio(ours, theirs),
        "both_pvalue": test.pvalue,
    }


def _seed_row(ours: Array, theirs: Array) -> dict[str, float]:
    test = statistics.mann_whitney(ours, theirs)
    chance = float(statistics.shorter_chance(ours, theirs))
    interval = statistics.shorter_interval(chance, ours.size, theirs.size)
    median = _median(ours)
    rival_median = _median(theirs)
    ratio = np.nan
    if np.isfinite(median) or np.isfinite(rival_median):
        ratio = median / rival_median
    return {
        "runs": ours.size,
        "rival_runs": theirs.size,
        "median": median,
        "rival_median": rival_median,
        "ratio": ratio,
        "u": test.statistic,
        "chance": chance,
        "low": interval.low,
        "high": interval.high,
        "pvalue": test.pvalue,
    }


def _median_ratio(ours: Array, theirs: Array) -> float:
    """Return the median ratio from logarithms; its inverse is exact for the swapped pair."""
    with np.errstate(invalid="ignore"):
        change = ours - theirs
        equal = ours == theirs
        logs = np.sort(np.where(equal, 0.0, change))
        lower = logs[(logs.size - 1) // 2]
        upper = logs[logs.size // 2]
        middle = (lower + upper) / 2
    return float(np.exp(middle))


def _median(values: Array) -> float:
    middle = float(statistics.median(values))
    return to_tie_digits(middle)
