"""The summary of a run as a LaTeX table; the document needs the package `booktabs`.

write(Results("results"), Path("summary.tex"))       # \\input{summary} puts it into a paper
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.benchmark.store import atomic
from trajopt.views.analysis.results import Results

_HEADINGS = (
    "planner",
    "solved",
    "kept limits (\\%)",
    "median (s)",
    "quartiles (s)",
    "gap (\\%)",
    "time (s)",
)
_ALIGNMENT = "lrrrrrr"
_NONE = "--"
_ESCAPED = {
    "\\": "\\textbackslash{}",
    "~": "\\textasciitilde{}",
    "^": "\\textasciicircum{}",
    "<": "\\textless{}",
    ">": "\\textgreater{}",
    "|": "\\textbar{}",
    "`": "\\textasciigrave{}",
}
_ESCAPED |= {special: f"\\{special}" for special in "&%$#_{}"}


def write(results: Results, path: Path) -> None:
    """Write one `tabular`: per problem a line per planner, by median certified duration."""
    text = tabular(results)
    atomic.write(path, lambda place: place.write_text(text, encoding="utf-8", newline="\n"))


def tabular(results: Results) -> str:
    """The table of `Results.summary()`: of what has no duration, its status or its lower bound."""
    lines = [
        f"\\begin{{tabular}}{{{_ALIGNMENT}}}",
        "\\toprule",
        _row(_HEADINGS),
    ]
    columns = len(_HEADINGS)
    for _, rows in results.summary().groupby("digest", sort=False):
        problem = escaped(rows["problem"].iloc[0])
        title = f"\\multicolumn{{{columns}}}{{l}}{{\\textit{{{problem}}}}} \\\\"
        lines += ["\\midrule", title]
        lines += [_row(_cells(row)) for row in rows.itertuples()]
    lines += ["\\bottomrule", "\\end{tabular}", ""]
    return "\n".join(lines)


def escaped(name: str) -> str:
    """A name as LaTeX prints it, character by character; what cannot be printed is a space."""
    said = ""
    for character in name:
        shown = character if character.isprintable() else " "
        if shown == "-" and said.endswith("-"):
            said += "{}"  # or LaTeX makes one dash of two hyphens
        said += _ESCAPED.get(shown, shown)
    return said


def _row(cells: Sequence[str]) -> str:
    return f"{' & '.join(cells)} \\\\"


def _cells(row: Any) -> list[str]:
    return [
        escaped(row.label),
        f"{row.solved} of {row.runs}",
        f"{100 * row.kept:.0f}",
        _median(row),
        _quartiles(row),
        _number(100 * row.gap, 2),
        _number(row.solve_time, 3),
    ]


def _median(row: Any) -> str:
    if not np.isnan(row.median):
        return f"{row.median:.4f}"
    if not np.isnan(row.lower_bound):
        return f"$\\geq {row.lower_bound:.4f}$"
    return escaped(row.status)


def _quartiles(row: Any) -> str:
    if row.runs == 1 or np.isnan(row.median):
        return _NONE
    return f"{row.q1:.4f}--{row.q3:.4f}"


def _number(value: float, digits: int) -> str:
    if np.isnan(value):
        return _NONE
    return f"${value:.{digits}f}$"
