"""`trajopt diff OLD NEW`: which medians moved between two results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pandas as pd
from cyclopts import Parameter

from trajopt.cli import console, kinds
from trajopt.cli.against import paired_row
from trajopt.core.exceptions import InvalidInput
from trajopt.views import table_cells
from trajopt.views.analysis.changes import SIGNIFICANCE, by_planner, changes
from trajopt.views.results import Results

_MEANING = (
    "A median of several runs moved if Mann and Whitney's test says so, adjusted for all tests "
    f"(Holm, p < {SIGNIFICANCE}); one of a single run, if it differs in 6 digits."
)
_PAIRED_MEANING = (
    "Shorter, tied, longer: on how many problems the new median is so. Ratio: median of new to "
    "old. p: Wilcoxon's signed ranks over groups of problems, by Holm for the rows. Chance: that "
    "a new run is shorter than an old one, with its 95 % interval."
)
_Folder = Annotated[Path, Parameter(help="Results folder of a comparison, or its results.h5.")]


def diff(old: _Folder, new: _Folder) -> int:
    """Show which median durations moved between two results of the same problems and planners.

    Exit code 1: a median got longer.
    """
    with kinds.reading(old, "results"):
        before = Results(old)
    with kinds.reading(new, "results"):
        after = Results(new)
    table = changes(before, after)
    if table.empty:
        raise InvalidInput(str(new), f"a problem and planner that {old} has too")
    moved = table[table["moved"]]
    numbers = ("runs", "old s", "new s", "change %", "p")
    grid = console.table("problem", "planner", numbers=numbers)
    for row in moved.itertuples():
        grid.row(
            row.problem,
            console.option_lines(row.label),
            row.runs,
            table_cells.number(row.old, ".6g"),
            table_cells.number(row.new, ".6g"),
            table_cells.number(100 * (row.ratio - 1), "+.3g"),
            table_cells.number(row.holm, ".2g"),
        )
    if len(moved):
        console.OUT.print(grid)
    console.paragraph(f"{len(moved)} of {len(table)} medians moved.{_largest(table)} {_MEANING}")
    if table["problem"].nunique() > 1:
        _show_planners(before, after)
    _show_unmatched(old, new, before, after)
    return int((moved["ratio"] > 1).any())


def _largest(table: pd.DataFrame) -> str:
    """Name the median that differs most; empty where all are equal."""
    row = table.loc[(table["ratio"] - 1).abs().idxmax()]
    if row["ratio"] == 1:
        return ""
    change = table_cells.number(100 * (row["ratio"] - 1), "+.3g")
    return f" Largest difference: {change} %, {row['label']} on {row['problem']}."


def _show_planners(old: Results, new: Results) -> None:
    """Print a line per planner: its new medians against its old ones, over the problems."""
    numbers = ("problems", "shorter", "tied", "longer", "ratio", "p", "chance")
    grid = console.table("planner", numbers=numbers)
    for row in by_planner(old, new).itertuples():
        grid.row(console.option_lines(row.Index), *paired_row(row))
    console.paragraph()
    console.OUT.print(grid)
    console.paragraph(_PAIRED_MEANING)


def _show_unmatched(old: Path, new: Path, before: Results, after: Results) -> None:
    """Name the planners that only one of the results has."""
    labels = {old: set(before.trials()["label"]), new: set(after.trials()["label"])}
    for path, other in ((old, new), (new, old)):
        alone = sorted(labels[path] - labels[other])
        if alone:
            console.paragraph(f"Only in {path}: {', '.join(alone)}.")
