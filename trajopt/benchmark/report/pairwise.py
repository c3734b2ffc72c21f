"""Planners against each other, and what a search costs: frames in, texts of the tables out.

A cell is its text, and what stands small behind it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from trajopt.benchmark.trial import Trial

Cell = tuple[str, str]

SURE = 0.05  # an adjusted p below it is called real
BETWEEN = "\u202f"  # thousands


def first(trials: Sequence[Trial], labels: Sequence[str]) -> int:
    """Whom to compare with at first, by its place: a search with several seeds, if there is one.

    Of several the one with the most runs, then the first; a search is what keeps a history.
    """
    searched = [trial for trial in trials if trial.solution.history is not None]
    runs = Counter(trial.label for trial in searched)
    seeds: dict[str, set[int]] = {}
    for trial in searched:
        seeds.setdefault(trial.label, set()).add(trial.seed)
    several: dict[str, int] = {}
    for label, own in seeds.items():
        if len(own) > 1:
            several[label] = runs[label]
    most = max(labels, key=lambda label: several.get(label, 0))
    return labels.index(most)


def pairs(table: pd.DataFrame, labels: Sequence[str]) -> list[dict[str, Any]]:
    """Per planner to compare with, by its place, the line of each other that it met, by its own."""
    place = {label: i for i, label in enumerate(labels)}
    found: list[dict[str, Any]] = [{} for _ in labels]
    for row in table.reset_index().itertuples():
        against = found[place[row.against]]
        own = str(place[row.planner])
        against[own] = _line(row)
    return found


def _line(row: Any) -> dict[str, Any]:
    """`whisker`: the estimate and the ends of its interval, for the drawing of it."""
    alone = np.isnan(row.low)
    low = row.a12 if alone else row.low
    high = row.a12 if alone else row.high
    interval = "[–]" if alone else f"[{low:.2f}–{high:.2f}]"
    cells = [
        (str(row.problems), ""),
        (str(row.better), ""),
        (str(row.tied), ""),
        (str(row.worse), ""),
        (ratio(row.ratio), ""),
        (f"{row.a12:.2f}", interval),
        (probability(row.holm), ""),
    ]
    whisker = [round(value, 4) for value in (row.a12, low, high)]
    return {"real": bool(row.holm < SURE), "whisker": whisker, "cells": cells}


def ratio(value: float) -> str:
    if np.isnan(value):
        return "–"
    if np.isinf(value):
        return "∞"
    return f"{value:.5f}" if value else "0"


def probability(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"{value:.3g}"


def times(table: pd.DataFrame, labels: Sequence[str]) -> dict[str, list[Cell]]:
    """Per search, by its place: expected evaluations to each target, and how many runs met it."""
    lines = {}
    for label, own in table.groupby(level="label"):
        cells = []
        for row in own.itertuples():
            met = f"{row.successes} of {row.runs}"
            cells.append((count(row.ert), met))
        lines[str(labels.index(label))] = cells
    return lines


def count(value: float) -> str:
    if not np.isfinite(value):
        return "∞"
    return f"{value:,.0f}".replace(",", BETWEEN)
