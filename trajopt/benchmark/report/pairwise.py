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
    searched = [t for t in trials if t.solution.history is not None]
    runs = Counter(t.label for t in searched)
    seeds = Counter(label for label, _ in {(t.label, t.seed) for t in searched})
    return max(range(len(labels)), key=lambda i: (seeds[labels[i]] > 1) * runs[labels[i]])


def pairs(table: pd.DataFrame, labels: Sequence[str]) -> list[dict[str, Any]]:
    """Per planner to compare with, by its place, the line of each other that it met, by its own."""
    place = {label: i for i, label in enumerate(labels)}
    found: list[dict[str, Any]] = [{} for _ in labels]
    for row in table.reset_index().itertuples():
        found[place[row.against]][str(place[row.planner])] = _line(row)
    return found


def _line(row: Any) -> dict[str, Any]:
    """`whisker`: the estimate and the ends of its interval, for the drawing of it."""
    alone = np.isnan(row.low)
    interval = "[–]" if alone else f"[{row.low:.2f}–{row.high:.2f}]"
    whisker = [row.a12] * 3 if alone else [row.a12, row.low, row.high]
    return {
        "real": bool(row.holm < SURE), "whisker": [round(v, 4) for v in whisker],
        "cells": [(str(row.problems), ""), (str(row.better), ""), (str(row.tied), ""),
                  (str(row.worse), ""), (ratio(row.ratio), ""), (f"{row.a12:.2f}", interval),
                  (probability(row.holm), "")],
    }  # fmt: skip


def ratio(value: float) -> str:
    return "–" if np.isnan(value) else "∞" if np.isinf(value) else f"{value:.5f}" if value else "0"


def probability(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"{value:.3g}"


def times(table: pd.DataFrame, labels: Sequence[str]) -> dict[str, list[Cell]]:
    """Per search, by its place: expected evaluations to each target, and how many runs met it."""
    return {
        str(labels.index(label)): [
            (count(row.ert), f"{row.successes} of {row.runs}") for row in own.itertuples()
        ]
        for label, own in table.groupby(level="label")
    }


def count(value: float) -> str:
    return f"{value:,.0f}".replace(",", BETWEEN) if np.isfinite(value) else "∞"
