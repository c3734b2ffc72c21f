"""What `trajopt compare` says of many problems: a line per planner, and why it failed."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite
from pathlib import Path
from typing import Any

from trajopt.cli import console
from trajopt.views import report
from trajopt.views.analysis.failures import failures, in_words
from trajopt.views.analysis.overview import overview
from trajopt.views.analysis.results import Results

_MEANING = """\
Problems: as supported. Relaxed: motions that break limits which their planner
ignores.
Gap: median over problems of the median gap to a known optimum (none: on half of
them it has no answer). Worst: of any solved trial."""
_KINDS_SHOWN = 3  # of a planner's failures


def show(results: Results, folder: Path) -> Path:
    """Print a line per planner, and write the report unless it is there; returns its path."""
    page = folder / "report.html"
    if not report.is_of(results, page):
        with console.waiting("writing the report"):
            report.write(results, page, command=f"trajopt report {folder}")
    numbers = ("problems", "solved", "failed", "relaxed", "gap %", "worst %", "time s")
    table = console.table("planner", *numbers, numbers=numbers)
    for row in overview(results).itertuples():
        table.add_row(*_overview_cells(row))
    console.OUT.print(table)
    for sentence in _why_failed(results):
        console.paragraph(sentence)
    console.paragraph(_MEANING)
    console.paragraph()
    return page


def _overview_cells(row: Any) -> list[str]:
    gap = "none" if row.gap == inf else _percent(row.gap)
    return [
        console.option_lines(row.Index),
        str(row.problems),
        f"{row.solved} of {row.trials}",
        str(row.failed),
        str(row.relaxed),
        gap,
        _percent(row.worst),
        f"{row.time:.3f}",
    ]


def _why_failed(results: Results) -> Iterator[str]:
    """What kept each planner's trials from being solved, the most frequent kinds by their size."""
    reasons = failures(results)
    for label, own in reasons.groupby(level="label", sort=False):
        sentence = f"{label}: {own['count'].sum()} failed: {in_words(own.head(_KINDS_SHOWN))}"
        others = own["count"].iloc[_KINDS_SHOWN:].sum()
        if others:
            sentence += f"; {others} in other ways"
        yield sentence


def _percent(gap: float) -> str:
    return f"{100 * gap:+.2f}" if isfinite(gap) else ""
