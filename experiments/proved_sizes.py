"""How far do the proofs carry? Random problems, velocity and acceleration limits, by size.

    python -m experiments.proved_sizes                # waypoints 3–8 × joints 1–7, 3 seeds each
    python -m experiments.proved_sizes --seeds 1 --waypoints 3 --joints 2

One row per problem goes to `proved_sizes.csv` in `--output` as soon as it is known; running again
does only what is missing. The table shows, per cell, the worst gap reached in % and the longest
time in seconds.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import cyclopts
import pandas as pd

from baselines.lower_bound.bound import certify
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console

KEYS = ["waypoints", "joints", "seed"]
GAP = 1e-4  # relative, between the bounds: proved


def measured(
    waypoints: int,
    joints: int,
    seed: int,
    time_limit: float,
) -> dict[str, object]:
    """One problem's bounds: gap (relative), status, seconds."""
    problem = random_problem(seed, joints=joints, waypoints=waypoints)
    bound = certify(problem, within=GAP, time_limit=time_limit)
    return {
        "waypoints": waypoints,
        "joints": joints,
        "seed": seed,
        "gap": bound.proved_within,
        "status": bound.status,
        "seconds": bound.solve_time,
    }


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Per cell: worst gap in % and longest time in seconds."""
    cells = rows.groupby(["waypoints", "joints"])
    gaps = 100 * cells["gap"].max()
    seconds = cells["seconds"].max()
    text = gaps.map("{:.3f} %".format) + seconds.map(" {:.1f} s".format)
    return text.unstack("joints")


def main(
    waypoints: int = 8,
    joints: int = 7,
    seeds: int = 3,
    time_limit: float = 60.0,
    output: Path = Path("results/proved-sizes"),
) -> None:
    """Measure every cell up to these sizes and print the table."""
    output.mkdir(parents=True, exist_ok=True)
    file = output / "proved_sizes.csv"
    rows = []
    if file.exists():
        rows = pd.read_csv(file).to_dict("records")
    done = {tuple(row[key] for key in KEYS) for row in rows}
    cells = itertools.product(
        range(3, waypoints + 1),
        range(1, joints + 1),
        range(seeds),
    )
    missing = [cell for cell in cells if cell not in done]
    with console.progress(len(missing)) as advance:
        for cell in missing:
            row = measured(*cell, time_limit)
            rows.append(row)
            pd.DataFrame(rows).to_csv(file, index=False)
            advance(1)
    every = pd.DataFrame(rows)
    print(table(every).to_string())
    print(every["status"].value_counts().to_string())


if __name__ == "__main__":
    cyclopts.run(main)
