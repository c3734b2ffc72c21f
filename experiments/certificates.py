"""How far do the certificates carry? Random problems, waypoints 3–8 × joints 1–7.

    python -m experiments.certificates                # 42 cells, 3 seeds each, a few minutes
    python -m experiments.certificates --seeds 1 --waypoints 3 --joints 2

One row per problem goes to `certificates.csv` in `--output` as soon as it is known; running again
does only what is missing. The table shows, per cell, the worst gap reached in % and the longest
time in seconds.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import cyclopts
import pandas as pd

from baselines.lower_bound import certify
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console

KEYS = ["waypoints", "joints", "seed"]


def measured(waypoints: int, joints: int, seed: int, time_limit: float) -> dict[str, object]:
    """One problem's bounds: gap (relative), status, seconds."""
    problem = random_problem(seed, joints=joints, waypoints=waypoints)
    bound = certify(problem, gap=1e-4, time_limit=time_limit)
    found = {"gap": bound.relative_gap, "status": bound.status, "seconds": bound.solve_time}
    return dict(zip(KEYS, (waypoints, joints, seed), strict=True)) | found


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Per cell: worst gap in % and longest time in seconds."""
    cells = rows.groupby(["waypoints", "joints"])
    text = cells["gap"].max().mul(100).map("{:.3f} %".format) + cells["seconds"].max().map(
        " {:.1f} s".format
    )
    return text.unstack("joints")


def main(
    waypoints: int = 8,
    joints: int = 7,
    seeds: int = 3,
    time_limit: float = 60.0,
    output: Path = Path("results/certificates"),
) -> None:
    """Measure every cell up to these sizes and print the table."""
    output.mkdir(parents=True, exist_ok=True)
    file = output / "certificates.csv"
    rows = pd.read_csv(file) if file.exists() else pd.DataFrame(columns=KEYS)
    done = set(rows[KEYS].itertuples(index=False, name=None))
    cells = list(itertools.product(range(3, waypoints + 1), range(1, joints + 1), range(seeds)))
    with console.progress(len(cells)) as advance:
        for cell in cells:
            if cell not in done:
                row = pd.DataFrame([measured(*cell, time_limit)])
                rows = pd.concat([rows, row], ignore_index=True) if len(rows) else row
                rows.to_csv(file, index=False)
            advance(1)
    print(table(rows).to_string())
    print(rows["status"].value_counts().to_string())


if __name__ == "__main__":
    cyclopts.run(main)
