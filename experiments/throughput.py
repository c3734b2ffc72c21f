"""What does the runner cost, and what does a second job gain?

    python -m experiments.throughput             # 500 trials at one and at two jobs, five minutes
    python -m experiments.throughput --quick     # a few dozen

The same trials run into fresh folders. *Overhead* is the wall time of all jobs that the planners
did not spend themselves, per trial; starting the workers, a few seconds, is in it. Only an idle
machine gives meaningful numbers. The table goes to `throughput.csv` and `.md` in `--output`.
"""

from __future__ import annotations

import math
import shutil
import time
from pathlib import Path

import cyclopts
import pandas as pd

from experiments.common.output import save_table
from trajopt import comparison as run
from trajopt.benchmark.suites import catalogue as suite
from trajopt.core.problem import Problem
from trajopt.planners.registry import named

SWARMS = ("pso", "ssa", "issa")


def four_waypoints() -> list[Problem]:
    """The built-in problems that the swarms take."""
    problems = [suite.load(name) for name in suite.problem_files()]
    return [problem for problem in problems if len(problem.waypoints) == 4]


def timed(
    trials: int,
    iterations: int,
    jobs: int,
    folder: Path,
) -> dict[str, float]:
    """Wall time of so many trials (or a few more), s; what of it was the planners' own."""
    shutil.rmtree(folder, ignore_errors=True)
    problems = four_waypoints()
    planners = [named(f"{name}:iterations={iterations}") for name in SWARMS]
    a_seed = len(problems) * len(planners)  # trials
    seeds = math.ceil(trials / a_seed)
    began = time.perf_counter()
    results = run.compare(
        problems,
        planners,
        folder,
        seeds=seeds,
        jobs=jobs,
    )
    wall = time.perf_counter() - began
    table = results.trials()
    spent = table["solve_time"] + table["setup_time"]
    own = float(spent.sum())
    overhead = wall * jobs - own
    size = (folder / "results.h5").stat().st_size
    return {
        "jobs": jobs,
        "trials": len(table),
        "wall (s)": wall,
        "planners' own (s)": own,
        "overhead (ms per trial)": 1000 * overhead / len(table),
        "results.h5 (KB per trial)": size / 1000 / len(table),
    }


def main(
    trials: int = 500,
    *,
    iterations: int = 1000,
    quick: bool = False,
    output: Path = Path("results/throughput"),
) -> None:
    """Time them at one and at two jobs, and print the table."""
    if quick:
        trials = 30
        iterations = 20
    rows = []
    for jobs in (1, 2):
        row = timed(trials, iterations, jobs, output / f"jobs-{jobs}")
        rows.append(row)
    table = pd.DataFrame(rows)
    wall = table["wall (s)"]
    table["speed-up"] = wall.iloc[0] / wall
    save_table(table, output / "throughput")
    print(table.to_string(index=False, float_format="{:.2f}".format))


if __name__ == "__main__":
    cyclopts.run(main)
