"""Many problems at a glance: one line per planner, for a terminal or a paper.

    overview(Results("results"))                          # of all problems
    overview(Results("results"), by=suite_of)             # one line per suite and planner

What a planner does not support does not count against it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd

from trajopt.benchmark.analysis.results import Results, competing, typical
from trajopt.solution import Status


def overview(results: Results, by: Callable[[str], str] | None = None) -> pd.DataFrame:
    """Per planner with its options, by median gap:

    - `problems` that it supports, `trials` on them: `solved`, `bounds` (it ignores a limit on
      purpose: its answer is a lower bound) and `failed`; trials that it refused are `unsupported`;
    - `kept`: share of the solved ones that kept every limit as claimed;
    - `gap`, the median over problems of median gaps to a known optimum (an answer that is missing
      is worse than any), and `worst`, of any solved trial, as ratios minus 1;
    - `time`: median wall time of a trial, s.

    With `by`, a function of a problem's name, one line per group and planner.
    """
    table = results.gaps()
    keys = ["label"]
    if by:
        table["group"], keys = table["problem"].map(by), ["group", "label"]
    rows = {key: _line(own) for key, own in table.groupby(keys if by else "label", sort=False)}
    frame = pd.DataFrame.from_dict(rows, orient="index")
    if by:
        frame.index = pd.MultiIndex.from_tuples(frame.index, names=keys)
        return frame.sort_values(["group", "gap"], kind="stable")
    return frame.rename_axis("label").sort_values("gap", kind="stable")


def _line(runs: pd.DataFrame) -> dict[str, Any]:
    refused = runs["status"] == str(Status.UNSUPPORTED)
    tried, answers = runs[~refused], competing(runs)
    solved = answers[answers["status"] == str(Status.SOLVED)]
    return {
        "problems": tried["digest"].nunique(), "trials": len(tried), "solved": len(solved),
        "bounds": len(tried) - len(answers), "failed": len(answers) - len(solved),
        "unsupported": int(refused.sum()), "kept": solved["feasible"].mean(),
        "gap": typical(answers), "worst": solved["gap"].max(),
        "time": tried["solve_time"].median(),
    }  # fmt: skip
