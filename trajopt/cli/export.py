"""`trajopt export`: the trials of a folder for other tools, and for a paper."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from trajopt.benchmark.run.runner import profiled
from trajopt.benchmark.run.tasks import Allowance
from trajopt.cli import console, kinds
from trajopt.cli.parameters import Writing, beside
from trajopt.core.exceptions import InvalidInput, UnknownName
from trajopt.views.export import latex, tables
from trajopt.views.figures import draw
from trajopt.views.results import Results

_NAMES = {
    "csv": "trials.csv",
    "parquet": "trials.parquet",
    "latex": "latex",
    "svg": "svg",
    "pdf": "pdf",
}
_FOLDERS = ("latex", "svg", "pdf")


def export(
    folder: Path,
    *,
    to: Literal["csv", "parquet", "latex", "svg", "pdf"],
    out: Writing[Path | None] = None,
    output: Writing[Path | None] = None,
    planner: list[str] | None = None,
    common: bool = False,
    against: str | None = None,
    each_problem: bool = False,
    dark: bool = False,
) -> int:
    """Write the trials of a folder for other tools.

    Args:
        folder: Results folder of a comparison, or its results.h5.
        to: Trials as CSV or Parquet, tables in LaTeX, or the figures.
        out: File of csv or parquet; by default in the folder.
        output: Folder of latex, svg or pdf; by default in the folder.
        planner: Write this planner and the references alone, repeated.
        common: Write only the problems that all planners answer.
        each_problem: With svg and pdf: of several problems the figures of each one too.
        dark: With svg: light lines on a transparent ground, for dark pages.
        against: With latex: planner that all others are tested against in planners.tex.
    """
    wrong, other = (out, "--out") if to in _FOLDERS else (output, "--output")
    if wrong is not None:
        right = "--output with a folder" if to in _FOLDERS else "--out with a file"
        raise InvalidInput(other, f"{right}, since --to is {to}", value=str(wrong))
    if dark and to != "svg":
        raise InvalidInput("--dark", "--to svg: paper is white", value=to)
    with kinds.reading(folder, "results"):
        results = Results(folder).only(planner or [], common=common)
    if to in _FOLDERS and not results.items:
        raise InvalidInput(str(folder), "at least one trial, for tables and figures of trials")
    path = out or output or beside(folder, _NAMES[to])
    rival = "" if against is None else _rival(results, against, to)
    if to == "csv":
        tables.write_csv(results, path)
    elif to == "parquet":
        tables.write_parquet(results, path)
    elif to == "latex":
        latex.write(results, path, rival)
    else:
        draw.write(results, path, to, each_problem=each_problem, for_dark_pages=dark)
    trials = len(results.items)
    console.line(f"exported: {path} ({trials} trials)")
    several = results.trials()["digest"].nunique() > 1
    if to in ("svg", "pdf") and several and not each_problem:
        console.line("The figures of each problem: --each-problem")
    if results.left_out:
        console.paragraph(results.newest)
    return 0


def _rival(results: Results, against: str, to: str) -> str:
    """Return the label of a planner that has trials.

    Raises:
        InvalidInput: The table has no rival.
        UnknownName: No planner with trials has this name.
    """
    if to != "latex":
        raise InvalidInput("--against", "left out, unless it is --to latex", value=against)
    labels = results.planners().index
    label = against
    if ".py:" in against:
        label = profiled(against, [], Allowance()).entrant.label
    if label not in labels:
        raise UnknownName("planner of these trials", label, labels)
    return label
