"""One line of a table of the report each: numbers in, their texts out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from trajopt.benchmark.trial import Trial
from trajopt.core.solution import Status
from trajopt.views import table_cells
from trajopt.views.analysis import statistics
from trajopt.views.analysis.failures import last_line, reason, worst
from trajopt.views.analysis.overview import competing, median_gap
from trajopt.views.analysis.pairwise import mean_ranks

COLUMNS = {  # headings, with units, of the table of problems and planners
    "solved": "solved",
    "kept": "kept limits",
    "median": "certified (s)",
    "quartiles": "quartiles",
    "gap": "gap (%)",
    "dilation": "dilation",
    "evaluations": "evaluations",
    "solve_time": "time (s)",
}
MESSAGE_LENGTH = 10_000  # characters of a message in the table of failures
REASON_LENGTH = 500


@dataclass(frozen=True, eq=False)
class Cell:
    """A number as text, and at full precision for sorting; None without a number."""

    text: str
    value: float | None = None


def of_row(row: Any) -> dict[str, Cell]:
    """The cells of a row of `Results.summary()`."""
    values = row._asdict()
    values["solved"] = row.solved / row.runs
    values["quartiles"] = row.q3 - row.q1
    found = {}
    for name, text in table_cells.of_summary(row).items():
        has_number = any(map(str.isdigit, text))
        found[name] = Cell(text, values[name]) if has_number else Cell(table_cells.MISSING)
    return found


def failures(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Group the trials that are not solved by planner, status and kind of reason.

    The most frequent come first.
    """
    kinds: dict[tuple[str, str, str], list[Trial]] = {}
    for trial in trials:
        if trial.status is Status.SOLVED:
            continue
        kind = (trial.label, str(trial.status), reason(trial).kind)
        own = kinds.setdefault(kind, [])
        own.append(trial)
    rows = [_failure(own) for own in kinds.values()]
    return sorted(rows, key=lambda row: -int(row["count"]))


def _failure(trials: Sequence[Trial]) -> dict[str, Any]:
    """Return the line of trials that failed for one kind of reason.

    A flaw is given with its worst size; another reason as it is written, if all trials agree.
    """
    first = trials[0]
    message = _clipped(first.message.strip(), MESSAGE_LENGTH)
    found = [reason(trial) for trial in trials]
    sizes = [own.size for own in found]
    said = found[0].kind + worst(np.max(sizes), found[0].unit)
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


def over_all(runs: pd.DataFrame, rank: float) -> dict[str, Any]:
    """One planner's line, over the problems that it supports."""
    tried = competing(runs)
    solved = tried["status"] == str(Status.SOLVED)
    broke_limits = tried[solved & ~tried["feasible"]]
    return {
        "problems": tried["digest"].nunique(),
        "runs": len(tried),
        "solved": _share(solved),
        "kept": _share(tried["feasible"]),
        "dilation": table_cells.dilation(broke_limits["dilation"].median()),
        "gap": table_cells.gap(median_gap(tried)),
        "worst": table_cells.gap(tried["gap"].max()),
        "rank": table_cells.number(rank, ".2f"),
        "time": table_cells.number(tried["solve_time"].median(), ".3f"),
    }


def _share(outcomes: pd.Series[bool]) -> dict[str, Any]:
    """A share with Wilson's 95 % interval."""
    if not len(outcomes):
        return {"text": "–", "interval": "–", "value": np.nan}
    found = statistics.success_rate(outcomes.to_numpy())
    return {
        "text": f"{100 * found.value:.0f} %",
        "interval": f"{100 * found.low:.0f}–{100 * found.high:.0f}",
        "value": found.value,
    }


def ranks(runs: pd.DataFrame) -> dict[str, float]:
    """Mean ranks of the planners that compete on every problem."""
    found = mean_ranks(competing(runs))
    return dict(zip(found.index, found.tolist(), strict=True))
