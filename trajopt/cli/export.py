"""`trajopt export`: the trials of a folder for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from trajopt.benchmark.analysis.results import Results
from trajopt.benchmark.export import all_trials, ioh
from trajopt.cli import console


def export(
    folder: Annotated[Path, Parameter(help="Results folder of a comparison.")],
    *,
    to: Annotated[
        Literal["csv", "parquet", "ioh"],
        Parameter(help="Trials as CSV or Parquet, or convergence histories for IOHanalyzer."),
    ],
    out: Annotated[Path | None, Parameter(help="File, or new folder for ioh.")] = None,
) -> int:
    """Write the trials of a folder for other tools."""
    results = Results(folder)
    name = "ioh" if to == "ioh" else f"trials.{to}"
    path = out or folder / name
    all_trials.write(results, to, path)
    console.line(f"exported: {path} ({len(results.items)} trials)")
    if to == "ioh":
        left_out = ioh.without_history(results)
        if left_out:
            console.line(f"without a history to plot, left out: {', '.join(left_out)}")
    return 0
