"""Tables of planners against each other and of the costs of searches: frames in, texts out.

A cell is a text and a smaller text after it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd

from trajopt.benchmark.trial import Trial
from trajopt.views import table_cells

Cell = tuple[str, str]

BETWEEN = "\u202f"  # thousands
RATIO = ".5f"


def first(trials: Sequence[Trial], labels: Sequence[str]) -> int:
    """Return the index of the planner to compare with at first: the one with the most answers.

    Of several, the one with the most runs is taken, then the first.
    """
    runs: Counter[str] = Counter()
    solved: dict[str, set[str]] = {label: set() for label in labels}
    for trial in trials:
        if trial.certified_duration is not None:
            runs[trial.label] += 1
            solved[trial.label].add(trial.problem.digest())

    def shared(label: str) -> tuple[int, int]:
        problems = solved[label]
        return len(problems), runs[label]

    most = max(labels, key=shared)
    return labels.index(most)


def pairs(table: pd.DataFrame, labels: Sequence[str]) -> list[dict[str, Any]]:
    """The lines of `Results.paired()`: see `_by_rival`."""
    return _by_rival(table, labels, _over_problems)


def seeds(table: pd.DataFrame, labels: Sequence[str]) -> list[dict[str, Any]]:
    """The lines of `Results.between_seeds()`: see `_by_rival`."""
    return _by_rival(table, labels, _over_seeds)


def _by_rival(
    table: pd.DataFrame, labels: Sequence[str], line: Callable[[Any], dict[str, Any]]
) -> list[dict[str, Any]]:
    """Per planner to compare with, by its place, the line of each other that it met, by its own."""
    place = {label: i for i, label in enumerate(labels)}
    found: list[dict[str, Any]] = [{} for _ in labels]
    for row in table.reset_index().itertuples():
        rival = place[row.against]
        own = str(place[row.planner])
        found[rival][own] = line(row)
    return found


def _over_problems(row: Any) -> dict[str, Any]:
    """Return a line; `both` is the same on the problems that both answer, if these are a part."""
    line = _line(row, [row.problems, row.better, row.tied, row.worse])
    line["both"] = None
    if 0 < row.both < row.problems:
        counts = [row.both, row.both_better, row.both_tied, row.both_worse]
        rest = [
            table_cells.ratio(row.both_ratio, RATIO),
            "",
            table_cells.probability(row.both_holm),
        ]
        line["both"] = {
            "real": "yes" if row.both_holm < table_cells.SURE else "not shown",
            "cells": [(str(text), "") for text in counts + rest],
        }
    return line


def _over_seeds(row: Any) -> dict[str, Any]:
    medians = [table_cells.duration(row.median), table_cells.duration(row.rival_median)]
    return _line(row, [row.runs, row.rival_runs, *medians])


def _line(row: Any, first: Sequence[object]) -> dict[str, Any]:
    """Return a line: its first cells, the ratio, the chance of a shorter run, and p."""
    own = table_cells.of_pair(row)
    texts = [*map(str, first), table_cells.ratio(row.ratio, RATIO)]
    chance = (own["chance"], f"[{own['interval']}]")
    return {
        "real": table_cells.evidence(row),
        "whisker": [round(end, 4) for end in (row.chance, row.low, row.high)],
        "cells": [*((text, "") for text in texts), chance, (own["holm"], "")],
    }


def times(table: pd.DataFrame, labels: Sequence[str]) -> dict[str, list[Cell]]:
    """Per search, by its place: expected evaluations to each target, and how many runs met it."""
    lines = {}
    for label, own in table.groupby(level="label"):
        place = str(labels.index(label))
        lines[place] = [
            (count(row.ert), f"{row.successes} of {row.runs}") for row in own.itertuples()
        ]
    return lines


def count(value: float) -> str:
    return table_cells.number(value, ",.0f").replace(",", BETWEEN)
