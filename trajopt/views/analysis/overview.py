"""Many problems at a glance: one line per planner, for a terminal, a notebook or a paper.

    Results("results").planners()

A planner does not compete on problems that it refuses, and a proof without a motion does not
compete at all: there it is neither solved nor failed, in tables and in curves (`competing`).
Everything else counts by what the motion does: within its limits, slowed down until it is, or none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from trajopt.benchmark.best_known.records import CLOSED_WITHIN
from trajopt.core.solution import Status
from trajopt.explain.references import PROVERS
from trajopt.views.analysis import statistics
from trajopt.views.analysis.gap_reference import OPTIMA
from trajopt.views.analysis.pairwise import best_first, mean_ranks


def competing(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the trials of competing planners: neither refused, nor a proof without a motion."""
    refused = trials["status"] == str(Status.UNSUPPORTED)
    return trials[~refused & ~_only_bound(trials)]


def _only_bound(trials: pd.DataFrame) -> pd.Series[bool]:
    """Mark the proofs of lower bounds that come without a certified motion."""
    proof = trials["planner"].isin(PROVERS) & trials["lower_bound"].notna()
    return proof & trials["certified_duration"].isna()


def measured(gaps: pd.DataFrame) -> pd.DataFrame:
    """Return the competing trials on problems whose optimum is known, of `Results.gaps()`."""
    return competing(gaps)[lambda trials: trials["kind"].isin(OPTIMA)]


def median_gap(gaps: pd.DataFrame) -> float:
    """Median over problems of median gaps to a known optimum, of one planner's `gaps()`.

    The median is +inf if the planner has no answer on half of these problems, NaN without any.
    """
    known = measured(gaps)
    if known.empty:
        return np.nan
    medians = known["gap"].fillna(np.inf).groupby(known["digest"]).median()
    return float(statistics.median(medians))


def overview(gaps: pd.DataFrame) -> pd.DataFrame:
    """One line per planner with its options, by median gap, of `Results.gaps()`.

    Columns:
        problems: that it supports.
        counted: of these, those on which it competes.
        not_applicable: problems that it refused, or has only a lower bound for.
        proved: of these problems, those whose reference is proved within 0.1 %, by this run's
            proof or that of a record.
        trials, solved, bounds, failed: trials on them; of these those that are solved, those that
            are a lower bound without a motion, and the others.
        unsupported: trials that it refused.
        kept: share of the solved ones that kept every limit as claimed.
        dilation: median of the solved ones that did not.
        position_excess: how far the worst trial leaves its position limits, rad.
        gap: median over problems of median gaps to a known optimum, a ratio minus 1; an answer that
            is missing is worse than any.
        worst: gap of any solved trial, a ratio minus 1.
        yardstick, there: a planner that competes on the most problems (of several the one with the
            largest median gap), and its median gap on those problems of this line on which both
            compete. It makes the gaps of lines with different problems comparable.
        rank: mean rank over all problems (`pairwise.mean_ranks`), NaN where it has none.
        time: median wall time of a trial, s.
        library: median part of it inside the calls of a library that plans, s; NaN without one.
    """
    lines = {label: _line(runs) for label, runs in gaps.groupby("label", sort=False)}
    table = pd.DataFrame.from_dict(lines, orient="index")
    table["rank"] = mean_ranks(competing(gaps))
    known = measured(gaps)
    table["yardstick"] = yardstick = _yardstick(known, table["gap"])
    own = known[known["label"] == yardstick]
    for label, runs in known.groupby("label"):
        table.loc[label, "there"] = median_gap(own[own["digest"].isin(runs["digest"])])
    table["there"] = table.get("there", np.nan)
    return best_first(table.rename_axis("label"), 1 + table["gap"])


def _yardstick(known: pd.DataFrame, gap: pd.Series[float]) -> str:
    """Return the planner that competes on most problems; of several, that of largest gap."""
    counts = known.groupby("label")["digest"].nunique()
    most = counts[counts == counts.max()].index
    return str(gap[most].replace(np.inf, -np.inf).idxmax()) if len(most) else ""


def _line(runs: pd.DataFrame) -> dict[str, Any]:
    refused = runs["status"] == str(Status.UNSUPPORTED)
    tried = runs[~refused]
    answers = competing(runs)
    has_answer = answers["status"] == str(Status.SOLVED)
    solved = answers[has_answer]
    kept = solved["feasible"]
    broke_limits = solved[~kept]
    return {
        "problems": tried["digest"].nunique(),
        "counted": answers["digest"].nunique(),
        "not_applicable": runs["digest"].nunique() - answers["digest"].nunique(),
        "proved": _proved(tried),
        "trials": len(tried),
        "solved": len(solved),
        "bounds": len(tried) - len(answers),
        "failed": len(answers) - len(solved),
        "unsupported": int(refused.sum()),
        "kept": kept.mean(),
        "dilation": broke_limits["dilation"].median(),
        "position_excess": tried["position_excess"].max(),
        "gap": median_gap(answers),
        "worst": solved["gap"].max(),
        "time": tried["solve_time"].median(),
        "library": tried["library_time"].median(),
    }


def _proved(runs: pd.DataFrame) -> int:
    """Count the problems whose reference is the optimum, to within `CLOSED_WITHIN`."""
    gaps = runs["reference"] / runs["proved"] - 1
    has_motion = runs["kind"].isin(OPTIMA)
    closed = runs[has_motion & (gaps < CLOSED_WITHIN)]
    return int(closed["digest"].nunique())
