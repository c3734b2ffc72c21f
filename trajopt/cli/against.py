"""The tables of `trajopt compare … --against PLANNER`: every planner against that one.

Planners are paired by problem where there are several; on one problem their seeds are compared.
"""

from __future__ import annotations

from typing import Any

import pandas as pd

from trajopt.cli import console
from trajopt.cli.console import PlainTable
from trajopt.views import table_cells
from trajopt.views.analysis.pairwise import against
from trajopt.views.results import Results
from trajopt.views.table_cells import Cells

_PAIRED_MEANING = (
    "Better, tied, worse: on how many problems. Ratio: median of its duration to the other's. "
    "Both answer: without the problems on which one has no answer. p: Wilcoxon's signed ranks, "
    "problems of one arm, paper or random family counting as one; by Holm for the rows of this "
    "table. Proved: a lower bound decides, on all problems or on so many. Families: fewer than six "
    "cannot be tested. Shorter: chance that a run of it is shorter, with its 95 % interval."
)
_SEEDS_MEANING = (
    "Ratio: of the medians. p: Mann and Whitney's, over runs; Holm: the same, adjusted for the "
    "rows of this table. Shorter: chance that a run of it is shorter, with its 95 % interval. "
    "Alone: only it has a median, none: only the other has."
)


def show(results: Results, rival: str) -> None:
    """Print the comparison of every planner with one rival.

    Args:
        results: Trials of one problem or of several.
        rival: A planner's name with the options that differ from its defaults.
    """
    trials = results.trials()
    one_problem = trials["digest"].nunique() == 1
    rows = against(results.between_seeds() if one_problem else results.paired(), rival)
    others = sorted(set(trials["label"]) - {rival, *rows.index})
    if len(rows):
        console.OUT.print(_seeds_table(rows, rival) if one_problem else _paired_table(rows, rival))
        console.paragraph(_SEEDS_MEANING if one_problem else _PAIRED_MEANING)
    if others and one_problem:
        console.paragraph(
            f"Not tested against {rival}: {', '.join(others)}. On one problem runs are compared, "
            "which takes several of both planners. Give more problems, or a --suite."
        )
    elif rows.empty:
        console.paragraph(f"Against {rival}: no other planner was run on a problem it supports.")
    console.paragraph()


def _paired_table(rows: pd.DataFrame, rival: str) -> PlainTable:
    numbers = ("problems", "better", "tied", "worse", "ratio", "p", "shorter")
    title = f"Against {rival}, problem by problem"
    table = console.table("planner", numbers=numbers, title=title)
    for row in rows.itertuples():
        table.row(console.option_lines(row.Index), *paired_row(row))
        if row.both == 0:
            table.row("  both answer", 0)
        elif row.both < row.problems:
            counts = (row.both, row.both_better, row.both_tied, row.both_worse)
            pvalue = table_cells.probability(row.both_holm)
            table.row("  both answer", *counts, table_cells.ratio(row.both_ratio), pvalue)
    return table


def paired_row(row: Any) -> list[object]:
    """Return the cells of a row of `pairwise.paired_tests`: problems, ratio, p and chance."""
    own = table_cells.of_pair(row)
    counts = (row.problems, row.better, row.tied, row.worse)
    known = table_cells.evidence(row).removesuffix(": cannot be tested")
    p = own["holm"] if known in ("yes", "not shown") else known
    return [*counts, own["ratio"], p, _effect(own)]


def _seeds_table(rows: pd.DataFrame, rival: str) -> PlainTable:
    numbers = ("runs", "median s", "ratio", "p", "Holm", "shorter")
    runs = rows["rival_runs"].iloc[0]
    title = f"Against {rival} ({runs} runs)"
    table = console.table("planner", numbers=numbers, title=title)
    for row in rows.itertuples():
        own = table_cells.of_pair(row)
        table.row(
            console.option_lines(row.Index),
            row.runs,
            table_cells.duration(row.median),
            own["ratio"],
            own["p"],
            own["holm"],
            _effect(own),
        )
    return table


def _effect(own: Cells) -> str:
    """Return the chance of a shorter run, with its interval."""
    return f"{own['chance']} [{own['interval']}]"
