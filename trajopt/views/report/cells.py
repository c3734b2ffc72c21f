"""One line of a table of the report each: numbers in, their texts out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from trajopt.benchmark.trial import Trial
from trajopt.core.solution import Status
from trajopt.views.analysis import statistics
from trajopt.views.analysis.failures import last_line, reason, worst
from trajopt.views.analysis.overview import competing, median_gap
from trajopt.views.analysis.pairwise import mean_ranks
from trajopt.views.figures.style import dilated, percent

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


NONE = Cell("–")


def cells(row: Any) -> dict[str, Cell]:
    """The cells of a row of `Results.summary()`."""
    kept = Cell(f"{100 * row.kept:.0f} %", float(row.kept))
    return {
        "solved": Cell(f"{row.solved} of {row.runs}", row.solved / row.runs),
        "kept": kept if row.median > 0 else NONE,
        "median": _median(row),
        "quartiles": _quartiles(row),
        "gap": _gap(row.gap),
        "dilation": _dilation(row.dilation),
        "evaluations": _cell(row.evaluations, "{:.0f}"),
        "solve_time": _cell(row.solve_time, "{:.3f}"),
    }


def _median(row: Any) -> Cell:
    """The median certified duration, or the lower bound of what has no duration."""
    if not np.isnan(row.median):
        return Cell(f"{row.median:.4f}", float(row.median))
    if not np.isnan(row.lower_bound):
        return Cell(f"≥ {row.lower_bound:.4f}")
    return NONE


def _quartiles(row: Any) -> Cell:
    if row.runs == 1 or np.isnan(row.median):
        return NONE
    spread = row.q3 - row.q1
    return Cell(f"{row.q1:.4f}–{row.q3:.4f}", float(spread))


def _gap(gap: float, unit: str = "") -> Cell:
    if np.isnan(gap):
        return NONE
    if np.isinf(gap):
        return Cell("no answer")
    number = percent(gap).removesuffix(" %")
    return Cell(number + unit, float(gap))


def _cell(value: float, form: str) -> Cell:
    if np.isnan(value):
        return NONE
    return Cell(form.format(value), float(value))


def _dilation(ratio: float) -> Cell:
    """The median dilation of those that broke a limit."""
    if not ratio > 1:
        return NONE
    return Cell(dilated(ratio), float(ratio))


def reference(row: Any) -> str:
    """Say in a sentence what gaps are measured against, from a row of `Results.references()`."""
    shortest = row["reference"]
    proved = row["proved"]
    known = "the best known, not proved"
    if proved > 0:
        within = 100 * (shortest / proved - 1)
        by = f", {row['recorded_proof']}" if row["recorded_proof"] else ""
        known = f"proved within {within:.3f} % (nothing is faster than {proved:.6f} s{by})"
    kinds = {
        "exact": f"the exact optimum, {shortest:.6f} s",
        "refined": f"refined collocation, {shortest:.6f} s, its own error below 0.01 %",
        "relaxed": f"the best known without some of the limits, {shortest:.6f} s, "
        "so they may be overstated",
        "lower bound": f"a lower bound, {shortest:.6f} s, so they may be overstated",
        "best known": f"the best known, {row['recorded']}, {shortest:.6f} s",
    }
    return f"Gaps are to {kinds[row['kind']]}: {known}."


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
        "dilation": _dilation(broke_limits["dilation"].median()),
        "gap": _gap(median_gap(tried), " %"),
        "worst": _gap(tried["gap"].max(), " %"),
        "rank": _cell(rank, "{:.2f}"),
        "time": _cell(tried["solve_time"].median(), "{:.3f}"),
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
