"""How often do local optima differ, by how much, and when may a planner stop trying starts?

    python -m experiments.local_optima                          # 300 problems, four minutes
    python -m experiments.local_optima --problems 2000 --starts 64
    python -m experiments.local_optima --planner exact-jerk --problems 60 --starts 4

Every start of `exact` (or `exact-jerk`) is tried on random problems of 1 to 7 joints and 3 to 8
waypoints. Durations go to `exact-starts.csv` in `--output` problem by problem; running again does
only what is missing. The first table counts the problems where some start ends above the best by
more than a threshold. The second judges the rule that the planners stop by, as if every start in
turn had been the first: how many starts it takes until so many agree, and how often and by how much
it then misses the best.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from baselines.ipopt import AGREEMENT_RTOL
from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt.benchmark.suites.random import random_problem
from trajopt.core.problem import Problem
from trajopt.planners.registry import load

Array = NDArray[np.float64]

THRESHOLDS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-4, 1e-2)  # relative
AGREEING = (1, 2, 3, 4)


def drawn(seed: int, planner: str) -> Problem:
    """A random problem with the limits that the planner is for."""
    return random_problem(seed, jerk=planner == "exact-jerk")


def durations(
    problem: Problem,
    planner: str,
    starts: int,
) -> pd.DataFrame:
    """The duration that each of so many starts leads to, s; infinite where it failed."""
    every_start = load(f"{planner}:starts={starts},agreeing={starts}")
    found = every_start.solve(problem).stats.get("start_duration", [])
    return pd.DataFrame({"duration": found[:starts]})


def excesses(table: pd.DataFrame) -> Iterator[Array]:
    """Of each problem: how far its starts ended above the best, relative."""
    for _, rows in table.groupby("problem"):
        own = rows["duration"].to_numpy()
        if np.isfinite(own).any():
            yield own / own.min() - 1


def differing(table: pd.DataFrame) -> pd.DataFrame:
    """Per threshold: problems with a start that ended further above the best, and such starts."""
    by_problem = list(excesses(table))
    rows = []
    for threshold in THRESHOLDS:
        above = [(own > threshold) & np.isfinite(own) for own in by_problem]
        rows.append(
            {
                "above the best by more than": threshold,
                "problems": sum(any(one) for one in above),
                "of problems": len(by_problem),
                "starts": sum(int(one.sum()) for one in above),
                "of starts": len(table),
            }
        )
    return pd.DataFrame(rows)


def stopped(excess: Array, agreeing: int) -> tuple[int, float]:
    """After how many starts the planners' rule stops, and how far the answer misses the best."""
    lengths = 1 + excess
    for tried in range(1, len(excess) + 1):
        shortest = lengths[:tried].min()
        as_short = lengths[:tried] <= shortest * (1 + AGREEMENT_RTOL)
        if np.isfinite(shortest) and as_short.sum() >= agreeing:
            return tried, float(shortest - 1)
    return len(excess), float(lengths.min() - 1)


def rules(table: pd.DataFrame) -> pd.DataFrame:
    """Per number of starts that have to agree: starts it takes, and what it misses."""
    by_problem = list(excesses(table))
    rows = []
    for agreeing in AGREEING:
        ends = []
        for excess in by_problem:
            for first in range(len(excess)):
                in_turn = np.roll(excess, -first)
                ends.append(stopped(in_turn, agreeing))
        tried, missed = np.array(ends).T
        beyond = missed > AGREEMENT_RTOL
        rows.append(
            {
                "agreeing": agreeing,
                "mean starts": tried.mean(),
                "most starts": tried.max(),
                "missed %": 100 * beyond.mean(),
                "worst miss": missed.max(),
            }
        )
    return pd.DataFrame(rows)


def main(
    problems: int = 300,
    starts: int = 16,
    planner: str = "exact",
    output: Path = Path("results/local-optima"),
) -> None:
    """Try every start on every problem; print both tables, and write them to `output`."""
    cells = {}
    for seed in range(problems):
        problem = drawn(seed, planner)
        if problem.moving.any():
            cells[seed,] = partial(durations, problem, planner, starts)
    table = kept(output / f"{planner}-starts.csv", ["problem"], cells)
    failed = np.isinf(table["duration"])
    print(f"{planner}: {failed.sum()} of {len(table)} starts failed")
    for name, summary in (("differing", differing(table)), ("rules", rules(table))):
        save_table(summary, output / f"{planner}-{name}")
        print(summary.to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
