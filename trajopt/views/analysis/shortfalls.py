"""Sentences above the medians: which planners did not run everywhere, failed, or are slowed down.

    sentences(results)     # "Failed: exact (15 of 42 runs), toppra (9 of 42 runs)."

References and proofs are named too, as every planner.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence

import pandas as pd

from trajopt.core.solution import Status
from trajopt.views import table_cells
from trajopt.views.analysis.overview import competing
from trajopt.views.analysis.results import Tables

LISTED = 6  # planners that a sentence lists at most
DISTRIBUTION = "mintime"  # that this package's planners come with


def sentences(results: Tables, spoken: Callable[[str], str] = str) -> Iterator[str]:
    """Yield up to three sentences; none where every planner keeps every limit everywhere.

    What a planner refused is no failure, and neither is a proof without a motion.

    Args:
        results: The trials.
        spoken: A planner's name in a sentence, of its name with options.
    """
    trials = results.trials()
    own = users(results)
    every = trials["digest"].nunique()
    ran = trials.groupby("label")["digest"].nunique()
    partly = {label: f"{count} of {every}" for label, count in ran.items() if count < every}
    yield from _sentence("Not run on all problems", partly, own, spoken)
    tried = competing(trials)
    solved = tried["status"] == str(Status.SOLVED)
    slow = solved & ~tried["feasible"] & (tried["dilation"] >= 1 + table_cells.ROUNDING)
    yield from _sentence("Failed", _counts(tried, ~solved), own, spoken)
    slower = tried[slow].groupby("label")["dilation"].median()
    counts = _counts(tried, slow)
    by = {label: f"{said}, × {slower[label]:.4g}" for label, said in counts.items()}
    yield from _sentence("Slowed down to keep the limits", by, own, spoken)


def users(results: Tables) -> set[str]:
    """Return the planners that do not come with this package."""
    made = {own.label: own.provenance.get("planner_distribution", "") for own in results.items}
    return {label for label, distribution in made.items() if distribution != DISTRIBUTION}


def listed(said: Sequence[str]) -> str:
    """Join what is said of planners; of more than `LISTED` it says how many more."""
    shown = [*said[:LISTED], *([f"{len(said) - LISTED} more"] if len(said) > LISTED else [])]
    return ", ".join(shown)


def _counts(trials: pd.DataFrame, are: pd.Series[bool]) -> dict[Hashable, str]:
    """Say how many of each planner's runs are so; nothing of those that have none."""
    every = trials.groupby("label").size()
    some = trials[are].groupby("label").size()
    return {label: f"{count} of {every[label]} runs" for label, count in some.items()}


def _sentence(
    what: str,
    said: Mapping[Hashable, str],
    own: Collection[str],
    spoken: Callable[[str], str],
) -> Iterator[str]:
    """Yield a sentence that names planners, a user's own ones first; none without any."""
    labels = sorted(map(str, said), key=lambda label: (label not in own, label))
    if labels:
        yield f"{what}: {listed([f'{spoken(label)} ({said[label]})' for label in labels])}."
