"""Select the trials to show: of each planner those of the version that was compared last.

    shown = newest(store.read("results"))
    shown.trials, shown.left_out

A label is a planner's name with its options, without its code. Trials of several versions of a
planner's code are not trials of one planner.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Protocol, TypeVar

from trajopt.benchmark.trial import Trial

K = TypeVar("K")
Version = tuple[str, str, str]  # planner, options and code


class Versioned(Protocol):
    """A trial with the version of its planner: a `Trial`, or its row of a table."""

    @property
    def id(self) -> str: ...
    @property
    def label(self) -> str: ...
    @property
    def planner(self) -> str: ...
    @property
    def options(self) -> Mapping[str, Any]: ...
    @property
    def code(self) -> str: ...
    @property
    def started(self) -> str: ...
    @property
    def asked(self) -> str: ...


V = TypeVar("V", bound=Versioned)


@dataclass(frozen=True)
class Kept:
    """The number of a comparison's trials that are from an earlier run, and their first start."""

    count: int
    total: int
    since: datetime

    def __str__(self) -> str:
        when = self.since.astimezone().strftime("%d %b %H:%M")
        return f"{self.count} of {self.total} trials kept from {when}"


@dataclass(frozen=True)
class Newest:
    """The trials of each label's last version, each once, and how many others it has, by label."""

    trials: Sequence[Trial]
    left_out: Mapping[str, int]

    def __str__(self) -> str:
        """Say in a sentence which trials are left out, if any are."""
        if not self.left_out:
            return ""
        labels = [f"{label} ({own})" for label, own in sorted(self.left_out.items())]
        return (
            f"Left out, as the planner's code changed since: trials of {', '.join(labels)}. "
            "`trajopt diff OLD NEW` compares two versions, a folder each."
        )


def by_problem(trials: Iterable[Trial]) -> dict[str, list[Trial]]:
    """Return each problem's trials, by its digest."""
    return by(trials, lambda trial: trial.problem.digest())


def by_label(trials: Iterable[Trial]) -> dict[str, list[Trial]]:
    """Return each planner's trials, by its name with its options."""
    return by(trials, lambda trial: trial.label)


def by(trials: Iterable[Trial], key: Callable[[Trial], K]) -> dict[K, list[Trial]]:
    """Return the trials of each value of a key, in their order."""
    groups: dict[K, list[Trial]] = {}
    for trial in trials:
        own = groups.setdefault(key(trial), [])
        own.append(trial)
    return groups


def version(trial: Versioned) -> Version:
    """Return the planner, options and code of a trial."""
    options = json.dumps(dict(trial.options), sort_keys=True, default=str)
    return trial.planner, options, trial.code


def newest(trials: Iterable[Trial]) -> Newest:
    """Return for each label the trials of its last version.

    The last version ran last, or was asked for last by a comparison.

    The last of several trials with one identity counts, as from two copies of a folder.
    """
    return Newest(*last_versions(trials))


def last_versions(trials: Iterable[V]) -> tuple[list[V], Counter[str]]:
    """Return the trials of each label's last version, and how many others there are, by label."""
    once: dict[str, V] = {}
    for trial in trials:
        known = once.setdefault(trial.id, trial)
        if _time(trial) > _time(known):
            once[trial.id] = trial
    last: dict[str, tuple[datetime, Version]] = {}
    for trial in once.values():
        own = (_time(trial), version(trial))
        last[trial.label] = max(own, last.get(trial.label, own))
    shown = []
    left_out: Counter[str] = Counter()
    for trial in once.values():
        _, kept = last[trial.label]
        if version(trial) == kept:
            shown.append(trial)
        else:
            left_out[trial.label] += 1
    return shown, left_out


def _time(trial: Versioned) -> datetime:
    """Return when a trial ran, or when a later comparison kept it."""
    return datetime.fromisoformat(trial.asked or trial.started)
