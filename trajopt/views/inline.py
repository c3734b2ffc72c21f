"""Results as a console and a notebook show them: a few lines of text, and a table in HTML."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from trajopt.views import table_cells
from trajopt.views.analysis.shortfalls import sentences

if TYPE_CHECKING:
    from trajopt.views.analysis.results import Tables

NOTHING = "Results of no trials"
MAX_PLANNERS = 4  # named in a line of text
_USES = "Tables: planners(), summary(), gaps(), trials(), paired(). Figures: plot()."
_COLUMNS = {  # columns of the table, by their names in `Results.planners()`
    "problems": "problems",
    "solved": "solved",
    "gap": "median gap",
    "worst": "worst gap",
    "rank": "mean rank",
    "time": "computing (s)",
    "library": "in a library (s)",
}


def text(results: Tables) -> str:
    """Return the numbers of trials, what fell short, the smallest median gaps, the next calls.

    A line each; the second only where something did (`shortfalls`).
    """
    if not results.items:
        return NOTHING
    found = results.common()
    best = [f"{label} {_percent(gap)}" for label, gap in found.gaps.head(MAX_PLANNERS).items()]
    on = f" on the {len(found.problems)} problems that all answer" if found.every > 1 else ""
    few = f" (not compared: {', '.join(found.left_out)})" if found.left_out else ""
    gaps = f"Median gap{on}: {', '.join(best)}{few}"
    return "\n".join([*_first(results), gaps, _USES])


def html(results: Tables) -> str:
    """Return the counts over a table with a row per planner, the smallest median gap first."""
    if not results.items:
        return NOTHING
    rows = {}
    for row in results.planners().itertuples():
        own = table_cells.of_planner(row)
        own["gap"] = _percent(row.gap)
        own["worst"] = _percent(row.worst)
        rows[row.Index] = {heading: own[name] for name, heading in _COLUMNS.items()}
    table = pd.DataFrame.from_dict(rows, orient="index")
    if results.trials()["library_time"].isna().all():
        del table[_COLUMNS["library"]]
    summary = results.summary()
    if summary["digest"].nunique() == 1:
        table["duration (s)"] = summary.set_index("label")["median"].map(table_cells.number)
    said = "".join(f"<p>{escape(line)}</p>\n" for line in _first(results))
    return f"{said}{table.to_html(border=0)}"


def _first(results: Tables) -> list[str]:
    """Return the counts, and a line of what fell short if anything did."""
    return list(filter(None, [_counts(results), " ".join(sentences(results))]))


def _counts(results: Tables) -> str:
    trials = results.trials()
    problems = trials.drop_duplicates("digest")["problem"]
    said = f"{len(problems)} problems"
    if len(problems) == 1:
        said = problems.iloc[0]
    planners = trials["label"].nunique()
    solved = (trials["status"] == "solved").sum()
    counts = f"Results of {len(trials)} trials: {planners} planners on {said}, {solved} solved"
    stopped = str(results.stopped or "")
    return ". ".join(filter(None, [counts, stopped, str(results.newest)]))


def _percent(gap: float) -> str:
    """Return a gap in percent; it is infinite for a planner without an answer."""
    return table_cells.percent(gap) if np.isfinite(gap) else table_cells.gap(gap)
