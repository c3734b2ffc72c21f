"""Tables of a run for a paper in LaTeX; the document needs the package `booktabs`.

write(Results("results"), Path("tables"))       # \\input{tables/planners} puts one into a paper

- `planners.tex`: a line per planner, with the chance that one of its runs is shorter than one of a
  rival, and the p-value;
- `tests.tex`: a line per pair of planners;
- `summary.tex`: a line per problem and planner.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import pandas as pd

from trajopt.benchmark.store import atomic
from trajopt.explain.references import PROVERS, REFERENCES
from trajopt.views import table_cells
from trajopt.views.analysis import pairwise
from trajopt.views.analysis.results import Tables

_PLANNERS = {
    "problems": "problems",
    "not_applicable": "n/a",
    "solved": "solved",
    "gap": "gap (\\%)",
    "there": "there (\\%)",
    "worst": "worst (\\%)",
    "rank": "rank",
}
_TESTS = ("planner", "against", "ratio", "shorter", "95 \\%", "$p$", "$p$ (Holm)")
_OVER_PROBLEMS = ("better", "tied", "worse")
_SUMMARY = {
    "solved": "solved",
    "kept": "kept limits",
    "median": "median (s)",
    "quartiles": "quartiles (s)",
    "gap": "gap (\\%)",
    "solve_time": "time (s)",
    "library_time": "library (s)",
}
_ESCAPED = {
    "\\": "\\textbackslash{}",
    "~": "\\textasciitilde{}",
    "^": "\\textasciicircum{}",
    "<": "\\textless{}",
    ">": "\\textgreater{}",
    "|": "\\textbar{}",
    "`": "\\textasciigrave{}",
    "–": "--",
    "≥": "$\\geq$",
    "∞": "$\\infty$",
}
_ESCAPED |= {special: f"\\{special}" for special in "&%$#_{}"}


def write(results: Tables, folder: Path, against: str = "") -> None:
    """Write the three tables into a folder.

    Args:
        results: The trials.
        folder: Made if it is not there; its tables are overwritten.
        against: The rival of `planners.tex`, by its name with options; by default `rival`.
    """
    tables = {
        "planners": planners(results, against or rival(results)),
        "tests": tests(results),
        "summary": summary(results),
    }
    for name, text in tables.items():
        atomic.write(folder / f"{name}.tex", partial(_fill, text))


def _fill(text: str, place: Path) -> None:
    place.write_text(text, encoding="utf-8", newline="\n")


def rival(results: Tables) -> str:
    """Return the planner with the smallest median gap that is no reference, or else the first."""
    known = (*REFERENCES, *PROVERS)
    references = {trial.label for trial in results.items if trial.planner in known}
    labels = results.planners().index.tolist()
    others = [label for label in labels if label not in references]
    return str([*others, *labels][0])


def planners(results: Tables, against: str) -> str:
    """A line per planner: problems, solved, gaps, mean rank; chance of a shorter run, and p.

    Lines of different problems have the column `there`, as in the terminal. The chance is that of a
    shorter run than a rival's.

    p is of Wilcoxon's test over the problems, or on one problem of Mann and Whitney's over runs,
    adjusted for the rows of this table (Holm 1979), and missing where a proved bound decides.
    Without any mean rank the table has none.
    """
    rivals = pairwise.against(_pairs(results), against)
    table = results.planners().join(rivals[["chance", "holm"]])
    said = [
        f"% shorter: chance that a run is shorter than one of {_plain(against)}",
        f"% p: of that test, adjusted for the {_tested(rivals)} tests here; in tests.tex for all",
    ]
    headings = dict(_PLANNERS)
    if table["there"].nunique() > 1:
        yardstick = _plain(table["yardstick"].iloc[0])
        said.append(f"% there: the gap of {yardstick} on the problems that this line is about")
    else:
        del headings["there"]
    if not table["not_applicable"].any():
        del headings["not_applicable"]
    if table["rank"].isna().all():
        del headings["rank"]
        said += ["% no mean rank: fewer than three planners were run on every problem"]
    rows = []
    for row in table.itertuples():
        own = table_cells.of_planner(row)
        shown = [own[name] for name in headings]
        met = [table_cells.number(row.chance, ".2f"), table_cells.probability(row.holm)]
        rows.append(_row([row.Index, *shown, *met]))
    columns = ("planner", *headings.values(), "shorter", "$p$ (Holm)")
    return "\n".join([*said, _tabular(columns, [rows])])


def _tested(pairs: pd.DataFrame) -> int:
    """Count the rows that are tested, and not proved."""
    return int(pairs["holm"].notna().sum())


def tests(results: Tables) -> str:
    """A line per pair of planners, the one with the smaller median gap first.

    Over several problems there are also the numbers of those on which the first is better, tied
    and worse.
    """
    pairs = _pairs(results)
    counts = [name for name in _OVER_PROBLEMS if name in pairs]
    rows = []
    for pair in combinations(results.planners().index, 2):
        if pair not in pairs.index:
            continue
        row = pairs.loc[pair]
        met = [f"{row[name]:.0f}" for name in counts]
        own = table_cells.of_pair(row)
        rows.append(_row([*pair, *met, *own.values()]))
    first, second, *others = _TESTS
    tested = _tested(pairs) // 2
    said = f"% Holm: p adjusted for the {tested} tests here; in planners.tex for those of one rival"
    return f"{said}\n{_tabular([first, second, *counts, *others], [rows], texts=2)}"


def summary(results: Tables) -> str:
    """The table of `Results.summary()`: of what has no duration, its status or its lower bound.

    Where no planner wraps a library, the column of the time inside it is left out.
    """
    table = results.summary()
    cells = dict(_SUMMARY)
    said = [f"% library: {table_cells.LIBRARY}"]
    if table["library_time"].isna().all():
        del cells["library_time"]
        said = []
    parts = []
    for _, rows in table.groupby("digest", sort=False):
        problem = escaped(rows["problem"].iloc[0])
        title = f"\\multicolumn{{{1 + len(cells)}}}{{l}}{{\\textit{{{problem}}}}} \\\\"
        parts.append([title, *(_summary_row(row, cells) for row in rows.itertuples())])
    return "\n".join([*said, _tabular(("planner", *cells.values()), parts)])


def _pairs(results: Tables) -> pd.DataFrame:
    """Every pair of planners: over the problems, or on one problem over runs."""
    if results.trials()["digest"].nunique() == 1:
        return results.between_seeds()
    return results.paired()


def _tabular(headings: Sequence[str], parts: Sequence[Sequence[str]], texts: int = 1) -> str:
    """A `tabular` with a rule before each part; the first columns are texts."""
    alignment = "l" * texts + "r" * (len(headings) - texts)
    heading = f"{' & '.join(headings)} \\\\"
    lines = [f"\\begin{{tabular}}{{{alignment}}}", "\\toprule", heading]
    for rows in parts:
        lines += ["\\midrule", *rows]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", ""])


def escaped(name: str) -> str:
    """A name as LaTeX prints it, character by character; what cannot be printed is a space."""
    said = ""
    for character in name:
        shown = character if character.isprintable() else " "
        if shown == "-" and said.endswith("-"):
            said += "{}"  # otherwise LaTeX makes a dash of two hyphens
        said += _ESCAPED.get(shown, shown)
    return said


def _row(texts: Sequence[str]) -> str:
    return f"{' & '.join(map(escaped, texts))} \\\\"


def _summary_row(row: Any, cells: Iterable[str]) -> str:
    own = table_cells.of_summary(row)
    return _row([row.label, *(own[name] for name in cells)])


def _plain(name: str) -> str:
    """A name on one line, for a comment."""
    return " ".join(name.split())
