"""Trials as tables: one row per trial, gaps to the reference, one line per planner.

    results = Results("results")   # a folder, a results.h5, or trials
    results.gaps()                 # a pandas frame, one row per trial
    results.summary()              # a pandas frame, one row per problem and planner
    results.profile()              # a pandas frame, one column per planner
    results.paired()               # a pandas frame, one row per planner and rival
    results.running_times()        # a pandas frame, one row per search and target

Durations and times are in seconds, gaps are ratios minus 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from trajopt.benchmark.analysis import pairwise as paired
from trajopt.benchmark.analysis import statistics
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.trial import Trial
from trajopt.explain.decomposition import REFERENCES
from trajopt.solution import Status

Array = NDArray[np.float64]
Found = tuple[float, dict[str, list[Array]]]  # a problem's best 3-5-3 (s), histories by label

BEST_353 = "spline353-nlp"  # the planner whose answer is the best 3-5-3
TARGETS = (0.1, 0.01, 0.001, 0.0001)  # above the best 3-5-3, relative: what counts as found
PROOF = "certify"  # the planner whose lower bound is proved
TOLERANCE = 1e-6  # a planner below the reference by more than this, relative, is a bug to hunt
REFINED = 1e-4  # what refined collocation may itself be above the optimum, relative


@dataclass(frozen=True, init=False)
class Results:
    """The trials of a run, ready for tables and figures.

    `source`: the trials, or the path of a results folder, a `results.h5` or a trial file, which
    `store.read` reads; it raises `StoreError` naming the file if that cannot be done.
    """

    items: Sequence[Trial]

    def __init__(self, source: Sequence[Trial] | Path | str) -> None:
        items = store.read(source) if isinstance(source, str | Path) else source
        object.__setattr__(self, "items", items)

    def trials(self) -> pd.DataFrame:
        """One row per trial; durations and times in seconds, NaN where there is none."""
        return pd.DataFrame([_row(t) for t in self.items], columns=list(_COLUMNS)).astype(_COLUMNS)

    def references(self) -> pd.DataFrame:
        """Per problem the `reference` that gaps are measured against (s), its `kind`, and `proved`.

        `exact`: the shortest certified answer of the exact planners, or of the proof. `refined`:
        that of refined collocation, above the optimum by at most `REFINED`. `lower bound`: where
        none knows all limits, the largest of what they found without the limits that they ignore.
        No trajectory is faster than `proved` (s); NaN where nothing was proved.
        """
        exact = self.trials().query("planner in @REFERENCES or planner == @PROOF")
        table = exact.groupby("digest").agg({"certified_duration": "min", "lower_bound": "max"})
        bounds = exact.query("planner == @PROOF").groupby("digest")["lower_bound"].max()
        reference = table["certified_duration"].fillna(table["lower_bound"])
        columns = {"reference": reference, "kind": _kinds(exact), "proved": bounds}
        return pd.DataFrame(columns, index=table.index).dropna(subset="reference")

    def gaps(self) -> pd.DataFrame:
        """`trials()` with the columns of `references()` and `gap` = certified / reference − 1."""
        table = self.trials().merge(
            self.references(), how="left", left_on="digest", right_index=True
        )
        table["gap"] = table["certified_duration"] / table["reference"] - 1
        return table

    def summary(self) -> pd.DataFrame:
        """One row per problem and planner with its options, by median certified duration."""
        groups = self.gaps().groupby(["problem", "digest", "label"], sort=False)
        table = pd.DataFrame([_summarised(key, group) for key, group in groups])
        return table.sort_values(["problem", "median"], kind="stable", na_position="last")

    def profile(self, taus: ArrayLike | None = None) -> pd.DataFrame:
        """Performance profiles: the share of problems solved within `tau` times the best.

        One row per `tau` (by default wherever a profile steps), one column per planner with its
        options, of the median certified durations, +inf where half of the runs have none (Dolan &
        Moré 2002). Compared are the planners that were run on every problem; `attrs["left_out"]`
        says of each other on how many it was. Raises `InvalidInput` if a tau is NaN.
        """
        table = paired.medians(self.trials(), "certified_duration")
        ran = table.notna().sum()
        whole = table.loc[:, ran == len(table)]
        x, shares = statistics.performance_profile(whole, taus) if whole.size else ([], None)
        frame = pd.DataFrame(shares, pd.Index(x, name="tau", dtype=float), whole.columns, float)
        frame.attrs["left_out"] = ran[ran < len(table)].to_dict()
        return frame

    def paired(self) -> pd.DataFrame:
        """Every planner against every other, over the problems that both support.

        One row per `planner` and `against`, both with their options: `analysis.pairwise`
        explains the columns. `.loc["issa", "ssa"]` is one row, `.xs("ssa", level="against")` all
        against one.
        """
        return paired.paired(paired.duels(competing(self.trials())))

    def histories(self) -> dict[str, Found]:
        """Per problem (its digest) the best 3-5-3, s, NaN if unknown, and every run's history."""
        groups: dict[str, list[Trial]] = {}
        for trial in self.items:
            groups.setdefault(trial.problem.digest(), []).append(trial)
        return {digest: histories(trials) for digest, trials in groups.items()}

    def running_times(self, targets: ArrayLike = TARGETS) -> pd.DataFrame:
        """Expected evaluations until a search is within `target` of the best 3-5-3, and how often.

        One row per search, with its options, and target (a ratio minus 1): `ert`, `successes`,
        `runs`, pooled over the problems whose best 3-5-3 is known, on which it was run.
        """
        return running_times(over_best(list(self.histories().values())), targets)

    def data_profile(self, target: float = 0.01, dimension: float = 3) -> pd.DataFrame:
        """Share of problems on which a search is within `target` of the best 3-5-3 in `alpha`.

        `alpha` (rows) counts simplex gradients, `dimension + 1` evaluations each (Moré & Wild
        2009); a 3-5-3 has 3 times to find. One column per search with its options, of the median
        evaluations over its runs, +inf where half of them miss. Compared are those that were run on
        every problem whose best 3-5-3 is known.
        """
        known = {k: f for k, f in self.histories().items() if np.isfinite(f[0])}
        chosen = sorted(searches(list(known.values())))
        chosen = [label for label in chosen if all(label in own for _, own in known.values())]
        hits = [
            [_median_hit(own[label], best * (1 + target)) for label in chosen]
            for best, own in known.values()
        ]
        x, shares = statistics.data_profile(hits, dimension) if chosen else ([], None)
        return pd.DataFrame(shares, pd.Index(x, name="alpha", dtype=float), chosen, float)

    def suspicious(self) -> pd.DataFrame:
        """Trials below the reference by more than its tolerance: each is a bug to hunt."""
        table = self.gaps()
        tolerance = np.where(table["kind"] == "refined", REFINED, TOLERANCE)
        below_proof = table["certified_duration"] < table["proved"] * (1 - TOLERANCE)
        return table[(table["gap"] < -tolerance) | below_proof]


def competing(trials: pd.DataFrame) -> pd.DataFrame:
    """Without those that were refused, or whose answer ignores a limit on purpose (a bound)."""
    refused = trials["status"] == str(Status.UNSUPPORTED)
    return trials[~refused & (trials["certified_duration"].notna() | trials["lower_bound"].isna())]


def typical(trials: pd.DataFrame) -> float:
    """Median over problems of median gaps to a known optimum, of one planner's `gaps()`.

    +inf: on half of them it has no answer; NaN: there is no such problem.
    """
    known = trials[trials["kind"].isin(["exact", "refined"])]
    gaps = [statistics.median(own.fillna(np.inf)) for _, own in known.groupby("digest")["gap"]]
    return float(statistics.median(gaps)) if gaps else np.nan


def histories(trials: Sequence[Trial]) -> Found:
    """One problem's best 3-5-3 (s; NaN if unknown), and per planner the history of every run."""
    best = min((t.certified_duration or np.inf for t in trials if t.planner == BEST_353),
               default=np.inf)  # fmt: skip
    runs: dict[str, list[Array]] = {}
    for trial in trials:
        runs.setdefault(trial.label, []).append(trial.certified_history)
    return (best if best < np.inf else np.nan), runs


def searches(found: Sequence[Found]) -> set[str]:
    """Planners that kept a history on any of the problems and beat the best 3-5-3 on none.

    The evaluations of those that beat it are of something else.
    """
    least = [(label, min(np.nanmin(h[:, 1], initial=np.inf) for h in own), best)
             for best, runs in found for label, own in runs.items()]  # fmt: skip
    beaten = {label for label, duration, best in least if duration < best * (1 - TOLERANCE)}
    return {label for label, duration, _ in least if duration < np.inf} - beaten


def over_best(found: Sequence[Found]) -> dict[str, list[Array]]:
    """Per search, every run's history over the best 3-5-3 of its problem, where that is known."""
    known = [(best, runs) for best, runs in found if np.isfinite(best)]
    return {
        label: [h / [1.0, best] for best, runs in known for h in runs.get(label, [])]
        for label in sorted(searches(known))
    }


def running_times(
    stacked: Mapping[str, Sequence[Array]], targets: ArrayLike = TARGETS
) -> pd.DataFrame:
    """`Results.running_times()` of histories `over_best`.

    A run that ended without a word of what it spent is charged its planner's longest run.
    """
    goals = np.atleast_1d(np.asarray(targets, dtype=float))
    rows = []
    for label, runs in stacked.items():
        hits = statistics.evaluations_to_target(runs, 1 + goals)
        spent = np.array([run[-1, 0] for run in runs])
        budgets = np.where(spent > 0, spent, max(1.0, spent.max()))
        ert = np.asarray(statistics.expected_running_time(hits, budgets))
        found = zip(goals, ert, np.isfinite(hits).sum(axis=-1), strict=True)
        rows += [(label, goal, time, int(count), len(runs)) for goal, time, count in found]
    columns = ["label", "target", "ert", "successes", "runs"]
    return pd.DataFrame(rows, columns=columns).set_index(["label", "target"])


def _median_hit(runs: Sequence[Array], target: float) -> float:
    return float(statistics.median(statistics.evaluations_to_target(runs, target)))


def _kinds(exact: pd.DataFrame) -> pd.Series[str]:
    """Per problem, what its reference is."""
    certified = exact.dropna(subset="certified_duration")
    refined = certified["planner"] == REFERENCES[-1]
    only_refined = refined.groupby(certified["digest"]).all().map({True: "refined", False: "exact"})
    return only_refined.reindex(exact["digest"].unique(), fill_value="lower bound")


_COLUMNS = {
    "id": "str", "problem": "str", "digest": "str", "planner": "str", "label": "str", "seed": int,
    "status": "str", "message": "str", "relation": "str", "claimed_duration": float,
    "certified_duration": float, "lower_bound": float, "feasible": bool, "dilation": float,
    "evaluations": float, "setup_time": float, "solve_time": float,
}  # fmt: skip


def _row(t: Trial) -> tuple[Any, ...]:
    c = t.certificate
    return (
        t.id, t.problem.name, t.problem.digest(), t.planner, t.label, t.seed,
        str(t.status), t.message, t.relation.name, t.claimed_duration,
        t.certified_duration, t.lower_bound, bool(c and c.feasible), c.dilation if c else None,
        t.solution.evaluations, t.setup_time, t.solve_time,
    )  # fmt: skip


def _summarised(key: tuple[str, str, str], group: pd.DataFrame) -> dict[str, Any]:
    """Median, quartiles and extremes of the certified durations; shares; costs."""
    certified = group["certified_duration"]
    low, first, median, third, high = (
        certified.quantile([0, 0.25, 0.5, 0.75, 1]) if certified.notna().any() else [np.nan] * 5
    )
    worst = group.loc[(group["status"] == str(Status.SOLVED)).idxmin()]  # the first not solved
    broke = group[~group["feasible"] & certified.notna()]
    return dict(zip(("problem", "digest", "label"), key, strict=True)) | {
        "median": median, "q1": first, "q3": third, "min": low, "max": high,
        "gap": group["gap"].median(), "kind": group["kind"].iloc[0],
        "reference": group["reference"].iloc[0], "proved": group["proved"].iloc[0],
        "runs": len(group),
        "solved": int((group["status"] == str(Status.SOLVED)).sum()),
        "kept": group["feasible"].mean(), "dilation": broke["dilation"].median(),
        "lower_bound": group["lower_bound"].min(), "evaluations": group["evaluations"].median(),
        "solve_time": group["solve_time"].median(), "setup_time": group["setup_time"].max(),
        "status": worst["status"], "message": worst["message"],
    }  # fmt: skip
