"""Are the recorded answers proved?

    python -m experiments.certificates           # the records of all suites, a minute

Closed means that no motion is shorter by 0.1 % or more than the shortest one known. Every stored
proof is checked again. The tables go to `--output`.
"""

from __future__ import annotations

from pathlib import Path

import cyclopts
import pandas as pd

from experiments.common.output import save_table
from trajopt.benchmark.best_known import records
from trajopt.benchmark.store.recheck import proved
from trajopt.benchmark.suites import catalogue
from trajopt.core.problem import Problem


def recorded(suite: str, problem: Problem) -> dict[str, object]:
    """Return the relative gap between a record's checked bound and its motion."""
    record = records.find(problem)
    row: dict[str, object] = {
        "suite": suite,
        "problem": problem.name,
        "recorded": record is not None,
    }
    if record is None:
        return row
    gap = record.duration / proved(record.trial) - 1
    return row | {"closed": record.closed, "gap": gap}


def counted(rows: pd.DataFrame) -> pd.DataFrame:
    """Per suite: how many problems are closed, and the largest gap."""
    every = rows.assign(suite="all")
    groups = pd.concat([rows, every]).groupby("suite", sort=False)
    closed = groups["closed"].sum()
    found = groups["recorded"].sum()
    problems = groups.size()
    columns = {
        "problems": problems,
        "closed": closed,
        "open": found - closed,
        "without a record": problems - found,
        "largest gap, %": 100 * groups["gap"].max(),
    }
    return pd.DataFrame(columns)


def main(output: Path = Path("results/certificates")) -> None:
    """Check the records of all suites."""
    rows = pd.DataFrame([recorded(*pair) for pair in catalogue.every_problem().values()])
    table = counted(rows)
    save_table(rows, output / "records")
    save_table(table, output / "by-suite")
    print(table.to_string(float_format="{:.2g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
