"""A file in a results folder while a run is on: what was asked for. A stopped run leaves it.

begin(folder, 99, {"a trial's id": "toppra"})
end(folder)
read(folder, trials)       # None, or how many of the trials are missing, by planner
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from trajopt.benchmark.store import atomic
from trajopt.benchmark.trial import Trial
from trajopt.core import files
from trajopt.core.exceptions import InvalidInput

FILE = Path("trials", "unfinished")  # without an ending, as no trial has


@dataclass(frozen=True)
class Stopped:
    """A run that ended before its trials were done.

    Attributes:
        total: Number of trials that it was asked for.
        missing: Number of trials that are not there, by planner.
    """

    total: int
    missing: Mapping[str, int]

    def __str__(self) -> str:
        gone = sum(self.missing.values())
        of_each = ", ".join(f"{label} {count}" for label, count in sorted(self.missing.items()))
        there = f"{self.total - gone} of {self.total} trials are there"
        return f"The last run has not ended: {there}. Missing: {of_each}."

    @classmethod
    def together(cls, runs: Sequence[Self]) -> Self:
        """Return several runs as one."""
        missing: Counter[str] = Counter()
        for run in runs:
            missing.update(run.missing)
        return cls(sum(run.total for run in runs), missing)


def begin(folder: Path, total: int, waiting: Mapping[str, str]) -> None:
    """Write which trials a run waits for, in place of what an earlier run wrote.

    Args:
        folder: Of the results.
        total: Number of trials that were asked for.
        waiting: The planner of each trial that is to run, by the trial's identity.

    Raises:
        StoreError: The file cannot be written.
    """
    text = json.dumps({"total": total, "waiting": dict(waiting)})
    atomic.write(folder / FILE, text.encode())


def end(folder: Path) -> None:
    """Remove the file: the run has done what it was asked for."""
    (folder / FILE).unlink(missing_ok=True)


def read(folder: Path, trials: Iterable[Trial]) -> Stopped | None:
    """Return what is missing of a folder's last run; None where nothing is, or none was stopped."""
    try:
        table = json.loads(files.text(folder / FILE, "unfinished run", "JSON"))
        total = int(table["total"])
        waiting = {str(own): str(label) for own, label in table["waiting"].items()}
    except (InvalidInput, ValueError, KeyError, TypeError, AttributeError):
        return None  # there is none, or it is nobody's
    there = {trial.id for trial in trials}
    missing = Counter(label for own, label in waiting.items() if own not in there)
    if not missing or total < missing.total():
        return None
    return Stopped(total, missing)
