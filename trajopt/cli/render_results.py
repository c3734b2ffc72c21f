"""What the command line says of trials: a table per problem, or one of many problems."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from trajopt.cli.render import ERR, OUT, option_lines

if TYPE_CHECKING:
    import pandas as pd

    from trajopt.benchmark.analysis.results import Results


def comparison(results: Results, folder: Path, figures: Sequence[Path]) -> None:
    """One table per problem, the readings used, what failed and why, and where everything is."""
    for _, rows in results.summary().groupby("digest", sort=False):
        OUT.print(_comparison(rows))
        for row in rows[rows["solved"] < rows["runs"]].itertuples():
            message = str(row.message).strip().splitlines()
            count = f"{row.runs - row.solved} of {row.runs} runs " if row.runs > 1 else ""
            status = "" if row.lower_bound == row.lower_bound else f"{count}{row.status}: "
            why = f"{status}{message[-1] if message else ''}"
            OUT.print(f"{row.label}: {why}", markup=False)
        OUT.print(_caption(rows, _readings(results)), markup=False)
        OUT.print()
    _warn(results)
    stored = f"stored:  {folder / 'results.h5'} ({len(results.items)} trials of this comparison)"
    OUT.print(stored, soft_wrap=True, markup=False)
    if figures:
        drawn = f"figures: {folder / 'figures'} ({len(figures)} files)"
        OUT.print(drawn, soft_wrap=True, markup=False)


def sweep(results: Results, folder: Path, page: Path) -> None:
    """Many problems: one line per planner, what is suspicious, and where everything is."""
    from trajopt.benchmark.analysis.overview import overview

    found = overview(results)
    table = Table(box=None, pad_edge=False, collapse_padding=True)
    table.add_column("planner", overflow="fold", ratio=1)
    for name in ("problems", "solved", "failed", "bounds", "gap %", "worst %", "time s"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in found.itertuples():
        table.add_row(*_overview(row))
    OUT.print(table)
    OUT.print(_MEANING, markup=False)
    OUT.print()
    _warn(results)
    for what, path in (("stored:  ", folder / "results.h5"), ("report:  ", page)):
        OUT.print(f"{what}{path} ({len(results.items)} trials)", soft_wrap=True, markup=False)


def _overview(row: Any) -> list[str]:
    gaps = ("" if not abs(v) < float("inf") else f"{100 * v:+.2f}" for v in (row.gap, row.worst))
    median, worst = gaps
    return [
        option_lines(row.Index), str(row.problems), f"{row.solved} of {row.trials}",
        str(row.failed), str(row.bounds), "none" if row.gap == float("inf") else median, worst,
        f"{row.time:.3f}",
    ]  # fmt: skip


_MEANING = """\
Problems: as supported. Bounds: answers that ignore a limit on purpose.
Gap: median over problems of the median gap to a known optimum (none: on half of
them it has no answer). Worst: of any solved trial."""


def _comparison(rows: pd.DataFrame) -> Table:
    title = escape(f"{rows['problem'].iloc[0]}: certified durations")
    table = Table(
        title=title, title_justify="left", box=None, pad_edge=False, collapse_padding=True
    )
    table.add_column("planner", overflow="fold", ratio=1)
    for name in ("median s", "quartiles s", "gap %", "kept limits", "evals", "time s"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows.itertuples():
        table.add_row(*_cells(row))
    return table


def _cells(row: Any) -> list[str]:
    if row.median != row.median:  # no certified duration
        bound = f"≥ {row.lower_bound:.4f}" if row.lower_bound == row.lower_bound else row.status
        return [option_lines(row.label), bound, "", "", "", "", f"{row.solve_time:.3f}"]
    return [
        option_lines(row.label),
        f"{row.median:.4f}",
        f"{row.q1:.4f}–{row.q3:.4f}" if row.runs > 1 else "",
        "" if row.gap != row.gap else f"{100 * row.gap:+.2f}",
        f"{100 * row.kept:.0f} %" + (f" ×{row.dilation:.4f}" if row.dilation > 1 else ""),
        "" if row.evaluations != row.evaluations else f"{row.evaluations:.0f}",
        f"{row.solve_time:.3f}",
    ]


def _readings(results: Results) -> str:
    """The readings of the paper that were run: how joints are combined, and the fitness."""
    names = ("timing", "fitness")
    found = {tuple(f"{n}={t.options[n]}" for n in names if n in t.options) for t in results.items}
    return "; ".join(", ".join(reading) for reading in sorted(found) if reading)


def _caption(rows: pd.DataFrame, readings: str) -> str:
    runs, first = rows["runs"].max(), rows.iloc[0]
    lines = [f"Up to {runs} seeds. Durations are the verifier's: claimed × max(1, dilation)."]
    if first["reference"] == first["reference"]:
        lines.append(_reference(first))
    if readings:
        lines.append(f"Reading: {readings}.")
    lines.append("Kept limits: share of runs that did as claimed; × the others' median dilation.")
    return "\n".join(lines)


def _reference(row: pd.Series[Any]) -> str:
    """What the gaps are measured against, and how much of it is proved."""
    reference, proved = row["reference"], row["proved"]
    within = f"proved within {100 * (reference / proved - 1):.3f} % (lower bound {proved:.6f} s)"
    known = within if proved > 0 else "the best known, not proved (see --certify)"
    what = {
        "exact": "Gap to the exact optimum, {:.6f} s: {}.",
        "refined": "Gap to refined collocation, {:.6f} s, its own error below 0.01 %: {}.",
        "lower bound": "Gap to a lower bound, {:.6f} s, the optimum without some limits: {}.",
    }
    return what[row["kind"]].format(reference, known)


def _warn(results: Results) -> None:
    for row in results.suspicious().itertuples():
        ERR.print(
            f"[bold red]BUG OR BETTER OPTIMUM[/bold red]: {escape(row.label)} (seed {row.seed}) on "
            f"{escape(row.problem)} is {-100 * row.gap:.6f} % below the reference; trial {row.id}"
        )
