"""Trials as tables: one row per trial, gaps to the reference, one line per planner.

    results = Results("results")   # a folder, a results.h5, or trials
    results.gaps()                 # a pandas frame, one row per trial
    results.summary()              # a pandas frame, one row per problem and planner
    results.profile()              # a pandas frame, one column per planner

Durations and times are in seconds, gaps are ratios minus 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from trajopt.benchmark import statistics, store
from trajopt.benchmark.trial import Trial
from trajopt.gap import REFERENCES
from trajopt.solution import Status

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
        cells = self.trials().groupby(["digest", "label"])["certified_duration"]
        table = cells.agg(lambda v: float(statistics.median(v))).unstack("label")
        ran = table.notna().sum()
        whole = table.loc[:, ran == len(table)]
        x, shares = statistics.performance_profile(whole, taus) if whole.size else ([], None)
        frame = pd.DataFrame(shares, pd.Index(x, name="tau", dtype=float), whole.columns, float)
        frame.attrs["left_out"] = ran[ran < len(table)].to_dict()
        return frame

    def suspicious(self) -> pd.DataFrame:
        """Trials below the reference by more than its tolerance: each is a bug to hunt."""
        table = self.gaps()
        tolerance = np.where(table["kind"] == "refined", REFINED, TOLERANCE)
        below_proof = table["certified_duration"] < table["proved"] * (1 - TOLERANCE)
        return table[(table["gap"] < -tolerance) | below_proof]


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
