"""Results as a console and a notebook show them: three lines of text, and a table in HTML."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from trajopt.views.figures.style import percent

if TYPE_CHECKING:
    from trajopt.views.analysis.results import Results

NOTHING = "Results of no trials"
MAX_PLANNERS = 4  # named in a line of text
_USES = "Tables: planners(), summary(), gaps(), trials(), paired(). Figures: plot()."
_COLUMNS = {  # of the table, by their names in `Results.planners()`
    "problems": "problems",
    "solved": "solved",
    "gap": "median gap",
    "worst": "worst gap",
    "rank": "mean rank",
    "duration": "duration (s)",
    "time": "computing (s)",
}


def text(results: Results) -> str:
    """Return three lines: how many of what, the smallest median gaps, and what to call."""
    if not results.items:
        return NOTHING
    gaps = results.planners()["gap"].head(MAX_PLANNERS)
    best = [f"{label} {_gap(gap)}" for label, gap in gaps.items()]
    return "\n".join([_counts(results), f"Median gap: {', '.join(best)}", _USES])


def html(results: Results) -> str:
    """Return the counts over a table with a row per planner, the smallest median gap first."""
    if not results.items:
        return NOTHING
    table = results.planners()
    solved = table["solved"].astype(str) + " of " + table["trials"].astype(str)
    summary = results.summary()
    if summary["digest"].nunique() == 1:
        table["duration"] = summary.set_index("label")["median"]
    shown = table.assign(solved=solved).filter(list(_COLUMNS))
    shown = shown.rename(columns=_COLUMNS).rename_axis(None)
    forms = {
        _COLUMNS["gap"]: _gap,
        _COLUMNS["worst"]: _gap,
        _COLUMNS["rank"]: "{:.2f}".format,
        _COLUMNS["duration"]: "{:.4f}".format,
        _COLUMNS["time"]: "{:.3f}".format,
    }
    rows = shown.to_html(formatters=forms, na_rep="–", border=0)
    return f"<p>{escape(_counts(results))}</p>\n{rows}"


def _counts(results: Results) -> str:
    trials = results.trials()
    problems = trials.drop_duplicates("digest")["problem"]
    said = f"{len(problems)} problems"
    if len(problems) == 1:
        said = problems.iloc[0]
    planners = trials["label"].nunique()
    solved = (trials["status"] == "solved").sum()
    return f"Results of {len(trials)} trials: {planners} planners on {said}, {solved} solved"


def _gap(gap: float) -> str:
    """Write a gap; infinite is that of a planner without an answer, NaN where nothing is known."""
    if np.isnan(gap):
        return "–"
    return percent(gap) if np.isfinite(gap) else "no answer"
