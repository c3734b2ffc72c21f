"""Which gap to the best known motion does each planner leave, suite by suite?

    python -m experiments.gaps                       # every suite, more than an hour on two cores
    python -m experiments.gaps --quick               # six-axis alone

It runs every registered planner but `certify`, with its default options, on every problem of a
suite. Planners that search at random run with `SEEDS` seeds. A gap is to the problem's best known
motion. The folder `--output` keeps the trials, and a second run adds only what is missing. Its
files `gaps.csv` and `gaps.md` hold the table.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cyclopts
import pandas as pd

from experiments.common.output import save_table, say
from trajopt import compare
from trajopt.benchmark.suites import catalogue
from trajopt.cli import console
from trajopt.planners.registry import entries

SEEDS = 3
TIMEOUT = 120.0  # s, of a trial
PERCENT = 100


def planners() -> list[str]:
    """The names of those that can run here; `certify` answers with another planner's motion."""
    return [
        name for name, entry in entries().items() if name != "certify" and entry.missing() is None
    ]


def cell(row: Any) -> str:
    """Median gap and worst, in percent; and how many answers there are, where some are missing."""
    asked = row.trials - row.relaxed
    if not asked:
        return ""
    if not row.solved:
        return f"0 of {asked}"
    text = f"{PERCENT * row.gap:z.2f} ({PERCENT * row.worst:z.2f})"
    if row.solved < asked:
        text += f"; {row.solved} of {asked}"
    return text


def main(
    *,
    suite: list[str] | None = None,
    output: Path = Path("gaps"),
    jobs: int = 2,
    quick: bool = False,
) -> None:
    """Run what is missing, then write and print the table.

    Args:
        suite: Names of suites; all if left out.
        output: The folder.
        jobs: Trials side by side.
        quick: The suite six-axis alone.
    """
    columns = {}
    if quick:
        suite = ["six-axis"]
    for name in suite or catalogue.suites():
        say(f"every planner on {name}")
        results = compare(
            list(catalogue.problems(name)),
            planners(),
            output,
            seeds=SEEDS,
            jobs=jobs,
            timeout=TIMEOUT,
            progress=console.progress_line(),
        )
        table = results.planners()
        cells = [cell(row) for row in table.itertuples()]
        columns[name] = pd.Series(cells, index=table.index)
    wide = pd.DataFrame(columns).reindex(planners()).rename_axis("planner").fillna("")
    save_table(wide, output / "gaps")
    print(wide.to_string())


if __name__ == "__main__":
    cyclopts.run(main)
