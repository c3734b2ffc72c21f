"""Gaps of planners to the best known motion, by groups of problems."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.common.output import say
from trajopt import Problem, compare
from trajopt.cli import console
from trajopt.core.solution import Status
from trajopt.planners.registry import entries, load
from trajopt.views.analysis.gap_reference import OPTIMA

JOBS = 2


def compared(
    problems: Iterable[tuple[str, Problem]], planners: Iterable[tuple[str, str]], folder: Path
) -> pd.DataFrame:
    """Compare planners on problems, each with the name of its group.

    Args:
        problems: Groups and problems.
        planners: Names of the table's rows, and planners as the command line names them. A planner
            that is not installed is left out.
        folder: Where the trials are kept; a second run adds what is missing.

    Returns:
        The trials that these planners did not refuse, where the optimum is known:
        `Results.gaps()`, with the row's name as `planner`, the `group`, and whether there are
        `jerk` limits.
    """
    grouped = list(problems)
    contestants = []
    for name, spec in planners:
        if entries()[spec.partition(":")[0]].missing() is None:
            contestants.append((name, load(spec)))
    say(f"{len(contestants)} planners on {len(grouped)} problems")
    line = console.progress_line()
    own_problems = [own for _, own in grouped]
    trials = compare(own_problems, contestants, folder, jobs=JOBS, progress=line).gaps()
    members = [(own.digest(), group, own.has("jerk")) for group, own in grouped]
    columns = ["digest", "group", "jerk"]
    found = trials.drop(columns="group").merge(pd.DataFrame(members, columns=columns))
    own = found["planner"].isin([name for name, _ in contestants])
    refused = found["status"] == str(Status.UNSUPPORTED)
    return found[own & ~refused & found["kind"].isin(OPTIMA)]


def spread(trials: pd.DataFrame, rows: Sequence[str]) -> pd.DataFrame:
    """Per row and group the median gap in percent, lowest and highest, and how many answer."""
    percent = 100 * trials["gap"]
    grouped = percent.groupby([trials[name] for name in (*rows, "group")])
    cells = grouped.agg(["median", "min", "max", "count", "size"])
    texts = [_cell(row) for row in cells.itertuples(index=False)]
    return pd.Series(texts, index=cells.index).unstack("group")


def _cell(row: Any) -> str:
    """Median, lowest and highest; and how many have an answer, where some have none."""
    if row.count == 0:
        return f"none of {row.size}"
    median = f"{row.median:z.1f}"
    if row.size == 1:
        return median
    solved = f"{row.count}"
    if row.count < row.size:
        solved = f"{row.count} of {row.size}"
    return f"{median} ({row.min:z.1f} to {row.max:z.1f}; {solved})"
