"""Print two results of a planner as a Markdown table: python gap_table.py BEFORE AFTER PERCENT

Exit code 1 if a median got longer by more than PERCENT, and by more than chance: for planners with
several runs Mann and Whitney's test says so, adjusted for all problems (`trajopt diff`). Where no
run has an answer any more, it got longer too.
"""

from __future__ import annotations

import sys

import numpy as np

from trajopt import Results
from trajopt.views.analysis.changes import changes


def gap(results: Results, problem: str, label: str) -> str:
    """Return the median gap of a planner on a problem, %; a dash where there is none."""
    trials = results.gaps()
    own = trials[(trials["problem"] == problem) & (trials["label"] == label)]["gap"]
    middle = own.fillna(np.inf).median()
    return f"{100 * middle:.2f} %" if np.isfinite(middle) else "no answer"


def table(before: Results, after: Results, percent: float) -> tuple[str, bool]:
    """Return the comment, and whether a median got longer."""
    rows = changes(before, after)
    answers = after.trials().dropna(subset="certified_duration")
    answered = set(zip(answers["problem"], answers["label"], strict=True))
    lost = [own not in answered for own in zip(rows["problem"], rows["label"], strict=True)]
    moved = rows["moved"] | (np.array(lost, dtype=bool) & np.isfinite(rows["old"]))
    longer = moved & (rows["ratio"] > 1 + percent / 100)
    shorter = rows["moved"] & (rows["ratio"] < 1 - percent / 100)
    lines = [
        "### Gap to the best known motion",
        "",
        "| problem | planner | before | after | median | |",
        "|---|---|---:|---:|---:|---|",
    ]
    for row, up, down in zip(rows.itertuples(), longer, shorter, strict=True):
        change = f"{100 * (row.ratio - 1):+.2f} %" if np.isfinite(row.ratio) else "lost"
        verdict = "**longer**" if up else "shorter" if down else ""
        gaps = [gap(results, row.problem, row.label) for results in (before, after)]
        cells = (row.problem, f"`{row.label}`", *gaps, change, verdict)
        lines.append("| " + " | ".join(cells) + " |")
    lines += [
        "",
        f"{longer.sum()} of {len(rows)} medians got longer by more than {percent:g} % and by more "
        "than chance (Mann and Whitney, Holm over the problems; planners without chance: any "
        "change). Problems that one side did not finish in time are left out.",
    ]
    return "\n".join(lines), bool(longer.any())


if __name__ == "__main__":
    old, new, allowed = sys.argv[1:]
    text, worse = table(Results(old), Results(new), float(allowed))
    print(text)
    sys.exit(worse)
