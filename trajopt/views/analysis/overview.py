"""Many problems at a glance: one line per planner, for a terminal or a paper.

    overview(Results("results"))                          # of all problems
    overview(Results("results"), by=suite_of)             # one line per suite and planner

Problems that a planner does not support do not count against it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd

from trajopt.benchmark.best_known.record import CLOSED_WITHIN
from trajopt.core.solution import Status
from trajopt.views.analysis.gap_reference import OPTIMA
from trajopt.views.analysis.results import Results, competing, median_gap


def overview(
    results: Results,
    by: Callable[[str], str] | None = None,
) -> pd.DataFrame:
    """One line per planner with its options, by median gap.

    Args:
        results: of any number of problems.
        by: a function of a problem's name: one line per group and planner.

    Columns:
        problems: that it supports.
        proved: of these problems, those whose reference is proved: no motion is faster by 0.1 % or
            more, by this run's proof or that of a record.
        trials, solved, relaxed, failed: trials on them; of these those that are solved, those whose
            motion breaks limits that the planner ignores (or that are a lower bound and no motion),
            and the others.
        unsupported: trials that it refused.
        kept: share of the solved ones that kept every limit as claimed.
        dilation: median of the solved ones that did not.
        position_excess: how far the worst trial leaves its position limits, rad.
        gap: median over problems of median gaps to a known optimum, a ratio minus 1; an answer that
            is missing is worse than any.
        worst: gap of any solved trial, a ratio minus 1.
        time: median wall time of a trial, s.
    """
    table = results.gaps()
    keys = ["label"]
    if by is not None:
        table["group"] = table["problem"].map(by)
        keys = ["group", "label"]
    rows = []
    for key, runs in table.groupby(keys, sort=False):
        names = dict(zip(keys, key, strict=True))
        rows.append(names | _line(runs))
    lines = pd.DataFrame(rows).set_index(keys)
    order = [*keys[:-1], "gap"]
    return lines.sort_values(order, kind="stable")


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
        "proved": _proved(tried),
        "trials": len(tried),
        "solved": len(solved),
        "relaxed": len(tried) - len(answers),
        "failed": len(answers) - len(solved),
        "unsupported": int(refused.sum()),
        "kept": kept.mean(),
        "dilation": broke_limits["dilation"].median(),
        "position_excess": tried["position_excess"].max(),
        "gap": median_gap(answers),
        "worst": solved["gap"].max(),
        "time": tried["solve_time"].median(),
    }


def _proved(runs: pd.DataFrame) -> int:
    """Count the problems whose reference is the optimum, to within `CLOSED_WITHIN`."""
    gaps = runs["reference"] / runs["proved"] - 1
    has_motion = runs["kind"].isin(OPTIMA)
    closed = runs[has_motion & (gaps < CLOSED_WITHIN)]
    return int(closed["digest"].nunique())
