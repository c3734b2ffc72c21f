"""One line of a table of the report each: numbers in, their texts out."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from trajopt.benchmark.analysis import statistics
from trajopt.benchmark.analysis.pairwise import mean_ranks
from trajopt.benchmark.analysis.results import competing, median_gap
from trajopt.benchmark.figures.style import percent
from trajopt.benchmark.trial import Trial
from trajopt.solution import Status

COLUMNS = {  # of the table of problems and planners: what its heading says, and its unit
    "solved": "solved", "kept": "kept limits", "median": "certified (s)", "quartiles": "quartiles",
    "gap": "gap (%)", "dilation": "dilation", "evaluations": "evaluations",
    "solve_time": "time (s)",
}  # fmt: skip
NUMBER = re.compile(r"(?<![\w.+−-])[-−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w-])")  # not of 3-5-3
MESSAGE_LENGTH = 10_000  # characters of a message in the table of failures
REASON_LENGTH = 500


@dataclass(frozen=True, eq=False)
class Cell:
    """A number as it is read, and at full precision, by which it is sorted; None: there is none."""

    text: str
    value: float | None = None


def cells(row: Any) -> dict[str, Cell]:
    """The cells of a row of `Results.summary()`."""
    some, several = row.median == row.median, row.runs > 1
    bound = f"≥ {row.lower_bound:.4f}" if row.lower_bound == row.lower_bound else "–"
    return {
        "solved": Cell(f"{row.solved} of {row.runs}", row.solved / row.runs),
        "kept": Cell(f"{100 * row.kept:.0f} %", float(row.kept)),
        "median": Cell(f"{row.median:.4f}" if some else bound, _number(row.median)),
        "quartiles": Cell(f"{row.q1:.4f}–{row.q3:.4f}" if some and several else "–",
                          _number(row.q3 - row.q1) if several else None),
        "gap": Cell(percent(row.gap).removesuffix(" %"), row.gap) if row.gap == row.gap
        else Cell("–"),
        "dilation": _cell(row.dilation, "×{:.4f}" if row.dilation > 1.0001 else "×{:.7f}"),
        "evaluations": _cell(row.evaluations, "{:.0f}"),
        "solve_time": _cell(row.solve_time, "{:.3f}"),
    }  # fmt: skip


def _cell(value: float, form: str) -> Cell:
    return Cell(form.format(value), float(value)) if value == value else Cell("–")


def _number(value: float) -> float | None:
    return float(value) if value == value else None


def reference(row: Any) -> str:
    reference, proved = row["reference"], row["proved"]
    within = f"proved within {100 * (reference / proved - 1):.3f} % (nothing is faster than "
    known = f"{within}{proved:.6f} s)" if proved > 0 else "the best known, not proved"
    what = {
        "exact": "Gaps are to the exact optimum, {:.6f} s: {}.",
        "refined": "Gaps are to refined collocation, {:.6f} s, its own error below 0.01 %: {}.",
        "lower bound": "Gaps are to a lower bound, {:.6f} s, the optimum without some of the "
                       "limits, so they may be overstated: {}.",
    }  # fmt: skip
    return what[row["kind"]].format(reference, known)


def failures(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """What did not come out solved, by planner, status and kind of reason, the most frequent first.

    Reasons are of one kind where they differ in numbers only.
    """
    kinds: dict[tuple[str, str, str], list[Trial]] = {}
    for trial in trials:
        if trial.status is not Status.SOLVED:
            kind = NUMBER.sub("#", _reason(trial))
            kinds.setdefault((trial.label, str(trial.status), kind), []).append(trial)
    rows = [_failure(label, status, own) for (label, status, _), own in kinds.items()]
    return sorted(rows, key=lambda row: -int(row["count"]))


def _failure(label: str, status: str, trials: Sequence[Trial]) -> dict[str, Any]:
    first = trials[0]
    message = _clipped(first.message.strip(), MESSAGE_LENGTH)
    reason = spread([_reason(trial) for trial in trials])
    problems = dict.fromkeys(trial.problem.name for trial in trials)
    bounded = any(trial.lower_bound is not None for trial in trials)
    return {
        "label": label,
        "status": status,
        "count": len(trials),
        "first": first.id,
        "message": message,
        "reason": _clipped(reason, REASON_LENGTH) or "no reason was given",
        "long": "\n" in message,
        "problems": list(problems),
        "bound": bounded,
    }


def _reason(trial: Trial) -> str:
    """The last line of its message: a traceback says last what happened."""
    lines = trial.message.strip().splitlines()
    return lines[-1] if lines else ""


def spread(reasons: Sequence[str]) -> str:
    """Reasons that differ in numbers only as one, each number from the smallest to the largest."""
    words = NUMBER.split(reasons[0])
    numbers = zip(*[NUMBER.findall(reason) for reason in reasons], strict=True)
    said = words[0]
    for column, word in zip(numbers, words[1:], strict=True):
        ordered = sorted(column, key=_value)
        low = ordered[0]
        high = ordered[-1]
        said += low if _value(low) == _value(high) else f"{low} to {high}"
        said += word
    return said


def _value(number: str) -> float:
    return float(number.replace("−", "-"))


def _clipped(text: str, most: int) -> str:
    """The end of a text: a traceback says last what happened. Each trial has all of it."""
    return text if len(text) <= most else f"…{text[-most:]}"


def over_all(runs: pd.DataFrame, rank: float | None) -> dict[str, Any]:
    """One planner's line, over the problems that it supports."""
    tried = competing(runs)
    middle, worst = median_gap(tried), tried["gap"].max()
    return {
        "problems": tried["digest"].nunique(), "runs": len(tried),
        "solved": _share(tried["status"] == str(Status.SOLVED)), "kept": _share(tried["feasible"]),
        "gap": Cell(percent(middle), middle) if np.isfinite(middle)
        else Cell("–" if np.isnan(middle) else "no answer"),
        "worst": Cell(percent(worst), float(worst)) if worst == worst else Cell("–"),
        "rank": Cell("–") if rank is None else Cell(f"{rank:.2f}", rank),
        "time": _cell(tried["solve_time"].median(), "{:.3f}"),
    }  # fmt: skip


def _share(outcomes: pd.Series[bool]) -> dict[str, Any]:
    """A share with Wilson's 95 % interval."""
    if not len(outcomes):
        return {"text": "–", "interval": "–", "value": np.nan}
    found = statistics.success_rate(outcomes.to_numpy())
    interval = f"{100 * found.low:.0f}–{100 * found.high:.0f}"
    return {"text": f"{100 * found.value:.0f} %", "interval": interval, "value": found.value}


def ranks(runs: pd.DataFrame) -> dict[str, float]:
    """Mean ranks of the planners that compete on every problem."""
    found = mean_ranks(competing(runs))
    return dict(zip(found.index, found.tolist(), strict=True))


def provenance(items: Sequence[Trial]) -> list[tuple[str, str]]:
    """Each fact once; where trials differ, every value with its number of trials."""
    found: dict[str, Counter[str]] = {}
    for trial in items:
        for key, value in trial.provenance.items():
            found.setdefault(key, Counter())[value or "not installed"] += 1
    return [(key, _counted(values)) for key, values in found.items()]


def commit(name: str) -> str:
    return f"commit {name[:10]}{'-dirty' * name.endswith('-dirty')}"


def _counted(values: Counter[str]) -> str:
    several = "; ".join(f"{value} ({count} trials)" for value, count in values.items())
    return several if len(values) > 1 else next(iter(values))


def ranges(seeds: Sequence[int]) -> str:
    """`0–5, 9`."""
    parts: list[list[int]] = []
    for seed in seeds:
        if parts and parts[-1][-1] == seed - 1:
            parts[-1].append(seed)
        else:
            parts.append([seed])
    return ", ".join(f"{p[0]}–{p[-1]}" if len(p) > 1 else str(p[0]) for p in parts)
