"""Why trials failed, grouped by kind of reason: `33 leave position limits, worst 2.06 rad`.

table = failures(Results("results"))    # one row per planner and kind, the most frequent first
in_words(table.loc["toppra"])           # the line of one planner
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from trajopt.benchmark.trial import Trial
from trajopt.core.solution import Status
from trajopt.views.analysis.overview import competing
from trajopt.views.analysis.results import Tables
from trajopt.views.analysis.versions import by

COLUMNS = ["label", "kind", "count", "worst", "unit"]

_KINDS = {  # the verifier's words for one trial, and the table's words for many
    "leaves its position limits": "leave position limits",
    "misses the waypoint": "miss a waypoint",
    "position jumps": "jump in position",
    "velocity jumps": "jump in velocity",
    "acceleration jumps": "jump in acceleration",
}
# a flaw starts with a joint's number or name: `panda_joint6 at 1.2 s: leaves its … by 0.3 rad`
_FLAW = re.compile(r".+ at \S+ s: (?P<what>.+) by (?P<size>\S+) (?P<unit>\S+)")
_NUMBER = re.compile(r"(?<![\w.+−-])[-−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w-])")  # not of 3-5-3


class Reason(NamedTuple):
    """The kind of one trial's failure, and by how much (NaN and no unit where there is no size)."""

    kind: str
    size: float = np.nan
    unit: str = ""


class Failure(NamedTuple):
    """Trials of a planner that failed for one kind of reason, and the worst of their reasons."""

    trials: Sequence[Trial]
    worst: Reason

    def __str__(self) -> str:
        """Say the kind, and the largest size if it has one."""
        kind, size, unit = self.worst
        return kind + worst(size, unit)


def failures(results: Tables) -> pd.DataFrame:
    """Count the failures of every planner by kind; the index is the planner with its options.

    Failures are counted as in `overview`: not what a planner refused, nor what is relaxed. Each
    trial counts once, by its `reason`.

    Columns:
        kind: in words that follow a number of trials.
        count: of trials, the most frequent first.
        worst: the largest size of a flaw in `unit`, or NaN.
        unit: such as `rad`, or nothing.
    """
    trials = results.trials()
    status = competing(trials)["status"]
    failed = [results.items[rank] for rank in status.index[status != str(Status.SOLVED)]]
    rows = []
    for own in grouped(failed):
        first = own.trials[0]
        kind, size, unit = own.worst
        said = kind if unit else f"{first.status}: {kind}"
        rows.append((first.label, said.removesuffix(": "), len(own.trials), size, unit))
    table = pd.DataFrame(rows, columns=COLUMNS).astype({"worst": float, "count": int})
    return table.sort_values("label", kind="stable").set_index("label")


def grouped(trials: Iterable[Trial]) -> list[Failure]:
    """Group trials by planner, status and kind of reason, the most frequent first."""
    found = []
    for own in by(trials, lambda trial: (trial.label, trial.status, reason(trial).kind)).values():
        reasons = [reason(trial) for trial in own]
        largest = max(reasons, key=lambda one: one.size)
        found.append(Failure(own, largest))
    return sorted(found, key=lambda own: -len(own.trials))


def in_words(reasons: pd.DataFrame) -> str:
    """Write some rows of `failures`, such as one planner's, as a line."""
    rows = reasons.itertuples()
    return "; ".join(f"{row.count} {row.kind}{worst(row.worst, row.unit)}" for row in rows)


def worst(size: float, unit: str) -> str:
    """Write the largest size of a kind of flaw, if it has a size."""
    if np.isnan(size):
        return ""
    return f", worst {size:.3g} {unit}"


def reason(trial: Trial) -> Reason:
    """Return the first flaw that the verifier names, or else the last line of the message.

    Every number of the message is written `…`, so that messages of one kind are equal.
    """
    flaws = trial.certificate.flaws if trial.certificate else ()
    if trial.status is not Status.INVALID or not flaws:
        return Reason(_NUMBER.sub("…", last_line(trial)))
    found = _FLAW.fullmatch(flaws[0])
    if not found:
        return Reason(_NUMBER.sub("…", flaws[0]))
    what = found["what"]
    return Reason(_KINDS.get(what, what), size=float(found["size"]), unit=found["unit"])


def last_line(trial: Trial) -> str:
    """Return the last line of a trial's message: a traceback says last what happened."""
    lines = trial.message.strip().splitlines()
    return lines[-1] if lines else ""
