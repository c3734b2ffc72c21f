"""Why trials failed, grouped by kind of reason: `33 leave position limits, worst 2.06 rad`.

table = failures(Results("results"))    # one row per planner and kind, the most frequent first
in_words(table.loc["toppra"])           # the line of one planner
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trajopt.benchmark.trial import Trial
from trajopt.core.solution import Status
from trajopt.views.analysis.results import Results, competing

COLUMNS = ["label", "kind", "count", "worst", "unit"]

# What the verifier says of one joint, and of many trials.
_KINDS = {
    "leaves its position limits": "leave position limits",
    "misses the waypoint": "miss a waypoint",
    "position jumps": "jump in position",
    "velocity jumps": "jump in velocity",
    "acceleration jumps": "jump in acceleration",
}
# of a joint by its number or its name: `panda_joint6 at 1.2 s: leaves its … by 0.3 rad`
_FLAW = re.compile(r".+ at \S+ s: (?P<what>.+) by (?P<size>\S+) (?P<unit>\S+)")
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d+)?([eE][-+]?\d+)?")


@dataclass(frozen=True)
class Reason:
    """The kind of one trial's failure, and by how much (NaN and no unit where there is no size)."""

    kind: str
    size: float = np.nan
    unit: str = ""


def failures(results: Results) -> pd.DataFrame:
    """One row per planner (the index, with its options) and kind of failure.

    Failures are counted as in `overview`: not what a planner refused, nor what is relaxed. Each
    trial counts once, by the first flaw that the verifier names, or else by its status and the last
    line of its message, in which every number is written `…`.

    Columns:
        kind: in words that follow a number of trials.
        count: of trials, the most frequent first.
        worst: the largest size of a flaw, NaN where there is none; in `unit`.
        unit: such as `rad`, or nothing.
    """
    trials = results.trials()
    status = competing(trials)["status"]
    failed = status != str(Status.SOLVED)
    rows = []
    for place in failed.index[failed]:
        trial = results.items[place]
        reason = _reason(trial)
        row = (trial.label, reason.kind, 1, reason.size, reason.unit)
        rows.append(row)
    table = pd.DataFrame(rows, columns=COLUMNS)
    table = table.astype({"worst": float, "count": int})
    groups = table.groupby(["label", "kind", "unit"], sort=False, as_index=False)
    counted = groups.agg({"count": "sum", "worst": "max"})[COLUMNS]
    ordered = counted.sort_values("count", ascending=False, kind="stable")
    return ordered.sort_values("label", kind="stable").set_index("label")


def in_words(reasons: pd.DataFrame) -> str:
    """Some rows of `failures`, such as one planner's, as a line."""
    parts = []
    for row in reasons.itertuples():
        words = f"{row.count} {row.kind}"
        if np.isfinite(row.worst):
            words += f", worst {row.worst:.3g} {row.unit}"
        parts.append(words)
    return "; ".join(parts)


def _reason(trial: Trial) -> Reason:
    flaws = trial.certificate.flaws if trial.certificate else ()
    if trial.status is Status.INVALID and flaws:
        return _of_flaw(flaws[0])
    lines = trial.message.strip().splitlines()
    if not lines:
        return Reason(str(trial.status))
    without_numbers = _NUMBER.sub("…", lines[-1])
    return Reason(f"{trial.status}: {without_numbers}")


def _of_flaw(flaw: str) -> Reason:
    found = _FLAW.fullmatch(flaw)
    if not found:
        return Reason(_NUMBER.sub("…", flaw))
    what = found["what"]
    return Reason(
        _KINDS.get(what, what),
        size=float(found["size"]),
        unit=found["unit"],
    )
