"""One line of a table of the report each: numbers in, their texts out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trajopt.core.solution import Status
from trajopt.views import table_cells
from trajopt.views.analysis import statistics
from trajopt.views.analysis.failures import Failure, grouped, last_line
from trajopt.views.analysis.overview import competing
from trajopt.views.analysis.results import Tables

COLUMNS = {  # headings, with units, of the table of problems and planners
    "solved": "solved",
    "kept": "kept limits",
    "median": "certified (s)",
    "quartiles": "quartiles",
    "gap": "gap (%)",
    "dilation": "dilation",
    "jerk_integral": "∫ jerk²",
    "times_least": "× least",
    "evaluations": "evaluations",
    "solve_time": "time (s)",
    "library_time": "in lib (s)",
}
_OF_A_PLANNER = ("problems", "not_applicable", "gap", "worst", "rank", "time", "library")
MESSAGE_LENGTH = 10_000  # characters of a message in the table of failures
REASON_LENGTH = 500


@dataclass(frozen=True, eq=False)
class NumberCell:
    """A number as text, and at full precision for sorting; None without a number."""

    text: str
    value: float | None = None


def of_row(row: Any, times_least: float | None) -> dict[str, NumberCell]:
    """The cells of a row of `Results.summary()`, and of `least_jerk.times_the_least`."""
    values = row._asdict()
    values["times_least"] = times_least
    values["solved"] = row.solved / row.runs
    values["quartiles"] = row.q3 - row.q1
    found = {}
    cells = table_cells.of_summary(row) | {"times_least": table_cells.times(times_least)}
    for name, text in cells.items():
        known = (table_cells.TO_ROUNDING, table_cells.INFINITE)
        ranked = text in known or any(map(str.isdigit, text))
        found[name] = NumberCell(text, values[name]) if ranked else NumberCell(table_cells.MISSING)
    return found


def reasons(results: Tables, *, apply: bool) -> list[dict[str, Any]]:
    """Group the trials that are not solved by planner, status and kind of reason.

    The most frequent come first.

    Args:
        results: All of the page.
        apply: True for those that failed; false for those that do not compete (`competing`).
    """
    competes = set(competing(results.trials()).index)
    wanted = [
        trial
        for row, trial in enumerate(results.items)
        if trial.status is not Status.SOLVED and (row in competes) is apply
    ]
    return [_failure(own) for own in grouped(wanted)]


def _failure(failure: Failure) -> dict[str, Any]:
    """Return the line of trials that failed for one kind of reason.

    A flaw is given with its worst size; another reason as it is written, if all trials agree.
    """
    trials = failure.trials
    first = trials[0]
    message = _clipped(first.message.strip(), MESSAGE_LENGTH)
    said = str(failure)
    lines = {last_line(trial) for trial in trials}
    if len(lines) == 1:
        said = lines.pop()
    problems = dict.fromkeys(trial.problem.name for trial in trials)
    return {
        "label": first.label,
        "status": str(first.status),
        "count": len(trials),
        "first": first.id,
        "message": message,
        "reason": _clipped(said, REASON_LENGTH) or "no reason was given",
        "long": "\n" in message,
        "problems": list(problems),
    }


def _clipped(text: str, length: int) -> str:
    """The end of a text: a traceback says last what happened. Each trial has all of it."""
    if len(text) <= length:
        return text
    return f"…{text[-length:]}"


def over_all(row: Any) -> dict[str, Any]:
    """The cells of a row of `Results.planners()`; shares are of the runs that count."""
    runs = row.solved + row.failed
    kept = round(row.kept * row.solved) if row.solved else 0
    own = table_cells.of_planner(row)
    shown = _share(kept, runs)
    if table_cells.kept(row.kept, row.dilation) == table_cells.TO_ROUNDING:
        shown |= {"text": table_cells.TO_ROUNDING, "interval": ""}
    return {
        "runs": runs,
        "solved": _share(row.solved, runs),
        "kept": shown,
        "dilation": table_cells.dilation(row.dilation),
        **{name: own[name] for name in _OF_A_PLANNER},
    }


def _share(count: int, runs: int) -> dict[str, Any]:
    """A share with Wilson's 95 % interval; a single run has none."""
    if not runs:
        return {"text": "–", "interval": "–", "value": np.nan}
    found = statistics.success_rate(np.arange(runs) < count)
    interval = f"{100 * found.low:.0f}–{100 * found.high:.0f}" if runs > 1 else ""
    return {"text": f"{100 * found.value:.0f} %", "interval": interval, "value": found.value}
