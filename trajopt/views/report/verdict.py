"""The first part of a report: a sentence, and for one problem durations and motions."""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from math import isfinite, isnan
from typing import Any

from trajopt.benchmark.best_known.records import CLOSED_WITHIN
from trajopt.benchmark.trial import Trial
from trajopt.explain.references import PROVERS, REFERENCES
from trajopt.views import table_cells
from trajopt.views.analysis.results import Line, Tables
from trajopt.views.figures import draw
from trajopt.views.figures.draw import LOOKED_FOR
from trajopt.views.figures.style import SPOKEN

NAMED = 4  # planners that a sentence names at most


def of_problem(results: Tables) -> str:
    """Return how far planners are above the optimum: "toppra 8.3 %, issa 190.9 % (median)"."""
    lines = results.lines()
    compared = [line for line in lines if _name(line) not in {*REFERENCES, *PROVERS}]
    answered = [line for line in compared if isfinite(line.gap)]
    first = lines[0]
    if first.kind is None:
        return "No optimum is known for this problem, so gaps are unknown."
    known = f"{first.reference:.4f} s"
    optimum = f"the best known {known}, not proved"
    if first.reference < first.proved * (1 + CLOSED_WITHIN):
        optimum = f"the proved {known}"
    if not answered:
        return f"No other planner has an answer; the optimum is {optimum.removeprefix('the ')}."
    return f"{', '.join(_above(line) for line in _named(answered))} above {optimum}."


def _named(lines: Sequence[Line]) -> list[Line]:
    """Return the lines of a sentence, by gap: other people's planners, and those looked for."""
    wanted = [line for line in lines if _name(line) in LOOKED_FOR]
    others = [line for line in lines if _name(line) not in LOOKED_FOR]
    chosen = (wanted + others)[:NAMED]
    return sorted(chosen, key=lambda line: line.gap)


def _name(line: Line) -> str:
    """Return the planner's name, without its options."""
    return str(line.label).partition(":")[0]


def _above(line: Line) -> str:
    percent = table_cells.percent(line.gap).removeprefix("+")
    return f"{_spoken(line.label)} {percent}{' (median)' if line.runs > 1 else ''}"


def _spoken(label: str) -> str:
    """Return a planner's name in a sentence, its options in brackets."""
    name, _, options = label.partition(":")
    spoken = SPOKEN.get(name, name).removesuffix(" + 3-5-3")
    return f"{spoken} ({options})" if options else spoken


def of_suite(results: Tables) -> str:
    """Return the median gaps of the planners over the problems that they answer."""
    references = {*REFERENCES, *PROVERS}
    rows = [row for row in results.planners().itertuples() if isfinite(row.gap)]
    compared = [row for row in rows if str(row.Index).partition(":")[0] not in references] or rows
    if not rows:
        return "No optimum is known for these problems, so gaps are unknown."
    said = []
    for row in compared[:NAMED]:
        problems = f"{row.counted} problem{'s' if row.counted > 1 else ''}"
        said.append(f"{_spoken(row.Index)} {table_cells.percent(row.gap)} ({problems})")
    more = f", and {len(compared) - NAMED} more below" if len(compared) > NAMED else ""
    return f"Median gap to the optimum: {', '.join(said)}{more}."


def durations(results: Tables, labels: Sequence[str]) -> list[dict[str, Any]]:
    """Return a line per planner of one problem: its duration, and where its bar ends, %."""
    lines = sorted(results.lines(), key=lambda line: (isnan(line.median), line.median))
    finite = [line.max for line in lines if isfinite(line.max)]
    longest = max(finite, default=1.0)
    found = []
    for line in lines:
        own = table_cells.of_summary(line)
        width = line.median / longest if isfinite(line.median) else 0.0
        within = (end / line.median if width else 0.0 for end in (line.min, line.max))
        low, high = (round(100 * share, 2) for share in within)
        found.append(
            {
                "planner": labels.index(line.label),
                "label": line.label,
                "width": round(100 * width, 2),
                "low": low,
                "high": high if line.runs > 1 else low,
                "median": own["median"],
                "gap": own["gap"],
                "runs": line.runs,
            }
        )
    return found


def overlaid(trials: Sequence[Trial]) -> str:
    """Return the motions of a few planners on one time axis, as SVG; empty without two."""
    from trajopt.views.figures import plots

    figure = draw.overlaid(trials)
    if figure is None:
        return ""
    content = StringIO()
    plots.save_svg(figure, content)
    text = content.getvalue()
    return text[text.index("<svg") :]
