"""Are the recorded answers proved, and up to which size can random problems be?

    python -m experiments.certificates           # the records of all suites, a minute
    python -m experiments.certificates sizes     # waypoints 3-8 x joints 1-7, three seeds each

Closed means that no motion is shorter by 0.1 % or more than the shortest one known. Every stored
proof is checked again. The tables go to `--output`.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import cyclopts
import pandas as pd

from baselines.lower_bound.bound import certify
from experiments.common.output import save_table
from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.verification import proved
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.core.problem import Problem

SIZES_GAP = 1e-4  # relative, between the bounds
OUTPUT = Path("results/certificates")

app = cyclopts.App()


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
    gap = record.duration / proved(record) - 1
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


@app.default
def main(output: Path = OUTPUT) -> None:
    """Check the records of all suites."""
    rows = pd.DataFrame([recorded(*pair) for pair in catalogue.every_problem().values()])
    table = counted(rows)
    save_table(rows, output / "records")
    save_table(table, output / "by-suite")
    print(table.to_string(float_format="{:.2g}".format))


def measured(
    waypoints: int,
    joints: int,
    seed: int,
) -> dict[str, object]:
    """One random problem's bounds: gap (relative) and seconds."""
    problem = random_problem(seed, joints=joints, waypoints=waypoints)
    bound = certify(problem, within=SIZES_GAP, time_limit=60.0)
    return {
        "waypoints": waypoints,
        "joints": joints,
        "seed": seed,
        "gap": bound.proved_within,
        "seconds": bound.solve_time,
    }


@app.command
def sizes(
    waypoints: int = 8,
    joints: int = 7,
    seeds: int = 3,
    output: Path = OUTPUT,
) -> None:
    """Prove random problems; per cell the worst gap in percent and the longest time in seconds."""
    cells = list(itertools.product(range(3, waypoints + 1), range(1, joints + 1), range(seeds)))
    rows = []
    with console.progress(len(cells)) as advance:
        for cell in cells:
            rows.append(measured(*cell))
            advance(1)
    every = pd.DataFrame(rows)
    worst = every.groupby(["waypoints", "joints"])[["gap", "seconds"]].max()
    gaps = (100 * worst["gap"]).map("{:.3f} %".format)
    text = gaps + worst["seconds"].map(", {:.1f} s".format)
    save_table(every, output / "sizes")
    print(text.unstack("joints").to_string())
    unproved = every["gap"] > SIZES_GAP
    print(f"proved to {100 * SIZES_GAP:g} %: {(~unproved).sum()} of {len(every)}")


if __name__ == "__main__":
    app()
