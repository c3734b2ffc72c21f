"""The table of `trajopt compare` for many problems: a line per planner, and reasons of failure."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from trajopt.cli import console
from trajopt.core.exceptions import MissingBackend
from trajopt.views import report, table_cells
from trajopt.views.analysis.failures import failures, in_words
from trajopt.views.analysis.shortfalls import sentences
from trajopt.views.results import Results

_MEANING = """\
Problems: those that count for a planner. Not those that do not apply (n/a): it
refuses them, or proves a lower bound without a motion. Solved, failed: runs.
Gap: median over problems of the median gap to a known optimum (none: on half of
them it has no answer). Worst: of any solved trial."""
_PAIRED = "There: the gap of {} on the same problems. It tells how hard the problems of a line are."
_CELLS = {
    "problems": "problems",
    "not_applicable": "n/a",
    "solved": "solved",
    "failed": "failed",
    "gap": "gap %",
    "there": "there %",
    "worst": "worst %",
    "time": "time s",
    "library": "in lib",
}
# Columns that are not shown, where all planners support the same problems or do not: what failed
# is the rest, and why is said below the table.
_REPLACED = {False: ("there",), True: ("failed",)}
MAX_FAILURE_KINDS = 3  # shown of each planner


def show(results: Results, folder: Path) -> Path | None:
    """Print a line per planner, and write the report unless it is there.

    Returns:
        The report's path; None where the extra `report` is not installed.
    """
    page: Path | None = folder / "report.html"
    try:
        _write_report(results, folder / "report.html")
    except MissingBackend as error:
        page = None
        console.note(f"no report: {error}")
    for sentence in sentences(results):
        console.paragraph(sentence)
    planners = results.planners()
    paired = planners["there"].nunique() > 1
    wraps = bool(planners["library"].notna().any())
    left_out = (*_REPLACED[paired], *(() if wraps else ("library",)))
    cells = {name: heading for name, heading in _CELLS.items() if name not in left_out}
    table = console.table("planner", numbers=tuple(cells.values()))
    for row in planners.itertuples():
        own = table_cells.of_planner(row)
        table.row(console.option_lines(row.Index), *(own[name] for name in cells))
    console.OUT.print(table)
    for sentence in _why_failed(results):
        console.paragraph(sentence)
    console.paragraph(_MEANING)
    if wraps:
        console.paragraph(f"Time: of a run, s; in lib: {table_cells.LIBRARY} (medians).")
    if paired:
        console.paragraph(_PAIRED.format(planners["yardstick"].iloc[0]))
    console.paragraph()
    return page


def _write_report(results: Results, page: Path) -> None:
    """Write the report unless it is there and of these trials."""
    if not report.is_of(results, page):
        with console.waiting("writing the report"):
            report.write(results, page, command=f"trajopt report {page.parent}")


def _why_failed(results: Results) -> Iterator[str]:
    """Yield a sentence per planner with failed trials: the most frequent kinds of failure."""
    reasons = failures(results)
    for label, own in reasons.groupby(level="label", sort=False):
        counts = own["count"]
        most = in_words(own.head(MAX_FAILURE_KINDS))
        sentence = f"{label}: {counts.sum()} failed: {most}"
        others = counts.iloc[MAX_FAILURE_KINDS:].sum()
        if others:
            sentence += f"; {others} in other ways"
        yield sentence
