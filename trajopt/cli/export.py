"""`trajopt export`: the trials of a folder for other tools, and for a paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from trajopt.cli import console
from trajopt.cli.parameters import beside
from trajopt.views.analysis.results import Results
from trajopt.views.export import all_trials, ioh
from trajopt.views.figures import draw

_NAMES = {
    "csv": "trials.csv",
    "parquet": "trials.parquet",
    "ioh": "ioh",
    "latex": "summary.tex",
    "svg": "svg",
    "pdf": "pdf",
}


def export(
    folder: Annotated[
        Path,
        Parameter(help="Results folder of a comparison, or its results.h5."),
    ],
    *,
    to: Annotated[
        Literal["csv", "parquet", "ioh", "latex", "svg", "pdf"],
        Parameter(
            help="Trials as CSV or Parquet, convergence histories for IOHanalyzer, "
            "the summary as a LaTeX table, or the figures as SVG or PDF."
        ),
    ],
    out: Annotated[
        Path | None,
        Parameter(help="File; for svg and pdf a folder, for ioh a new one."),
    ] = None,
) -> int:
    """Write the trials of a folder for other tools."""
    results = Results(folder)
    path = out or beside(folder, _NAMES[to])
    if to == "svg" or to == "pdf":
        draw.write(results.items, path, to)
    else:
        all_trials.write(results, to, path)
    trials = len(results.items)
    console.line(f"exported: {path} ({trials} trials)")
    if results.left_out:
        console.paragraph(results.newest)
    if to == "ioh":
        left_out = ioh.without_history(results)
        if left_out:
            console.line(f"without a history to plot, left out: {', '.join(left_out)}")
    return 0
