"""How often do local optima differ, and by how much does a planner that stops early miss the best?

    python -m experiments.local_optima                          # 300 problems, four minutes
    python -m experiments.local_optima --quick                  # 10
    python -m experiments.local_optima --problems 2000 --starts 64
    python -m experiments.local_optima --planner exact-jerk --problems 60 --starts 4

Every start of `exact` (or `exact-jerk`) is tried on random problems of 1 to 7 joints and 3 to 8
waypoints. Durations go to `exact-starts.csv` in `--output` problem by problem; running again does
only what is missing. The table counts the starts that fail or end above the best. It says by how
much the first start misses the best, and by how much the first two that agree do, as if every start
in turn had been the first.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from baselines.several_starts import AGREEMENT_RTOL
from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt.benchmark.suites.random import random_problem
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.planners.registry import load

ABOVE_RTOL = 1e-9
AGREEING = 2


def durations(problem: Problem, planner: str, starts: int) -> pd.DataFrame:
    """Return the duration of each start's local optimum, s; infinite where it failed."""
    every_start = load(f"{planner}:starts={starts},agreeing={starts}")
    found = every_start.solve(problem).stats.get("start_duration", [])
    return pd.DataFrame({"duration": found[:starts]})


def missed(excess: Array, agreeing: int) -> float:
    """Return the relative excess of the shortest over the best where so many starts first agree.

    Args:
        excess: Relative excess of each start over the best, in their order.
        agreeing: So many starts have to be as short as the shortest so far; else all are tried.
    """
    lengths = 1 + excess
    for tried in range(1, len(excess) + 1):
        shortest = lengths[:tried].min()
        as_short = lengths[:tried] <= shortest * (1 + AGREEMENT_RTOL)
        if np.isfinite(shortest) and as_short.sum() >= agreeing:
            break
    return float(shortest - 1)


def summary(table: pd.DataFrame) -> pd.Series[float]:
    """The table's line: what fails, what ends above the best, and what an early stop misses."""
    above = 0
    worst = dict.fromkeys((1, AGREEING), 0.0)
    by_problem = table.groupby("problem")["duration"]
    for _, own in by_problem:
        if not np.isfinite(own.min()):
            continue
        excess = own.to_numpy() / own.min() - 1
        above += int((np.isfinite(excess) & (excess > ABOVE_RTOL)).sum())
        for agreeing, most in worst.items():
            ends = [missed(np.roll(excess, -first), agreeing) for first in range(len(excess))]
            worst[agreeing] = max(most, *ends)
    columns = {
        "problems": len(by_problem),
        "starts": len(table),
        "failed": np.isinf(table["duration"]).sum(),
        f"above the best by more than {ABOVE_RTOL:g}": above,
        "the first start misses the best by": worst[1],
        "the first two that agree miss it by": worst[AGREEING],
    }
    return pd.Series(columns)


def main(
    problems: int = 300,
    starts: int = 16,
    planner: str = "exact",
    output: Path = Path("results/local-optima"),
    quick: bool = False,
) -> None:
    """Try every start on every problem; print the table, and write it to `output`.

    `quick`: ten problems at most, of four starts.
    """
    if quick:
        problems = min(problems, 10)
        starts = min(starts, 4)
    cells = {}
    for seed in range(problems):
        problem = random_problem(seed, jerk=planner == "exact-jerk")
        if problem.moving.any():
            cells[seed,] = partial(durations, problem, planner, starts)
    found = summary(kept(output / f"{planner}-starts.csv", ["problem"], cells))
    save_table(found.to_frame().T, output / f"{planner}-summary")
    print(found.to_string(float_format="{:.2g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
