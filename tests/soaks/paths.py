"""Does `along` answer any path, and is its answer certified and below every bound it must be?

    python tests/soak.py paths                      # 160 random problems, a minute on an idle core
    python tests/soak.py paths --first 160 --count 1000

Two to eight random waypoints, one to seven joints, limits of two sides, half with jerk limits; the
spline rules take turns. Each answer must be certified, slowed down by at most 1e-3, and take no
less than the bound along its path, nor less than any motion through its waypoints (`prove`'s closed
form of each segment).
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.along.planner import Along
from baselines.topp_ra import rules, spline
from experiments.common.output import progress, save_table
from trajopt import Limits, Problem, verify
from trajopt.core.arrays import Array
from trajopt.planners.rest_to_rest import end_to_end_bound

MOST_SLOWED = 1e-3
MARGIN_RTOL = 1e-6


def problem(seed: int) -> Problem:
    """Return a random problem; every second one has jerk limits."""
    rng = np.random.default_rng([64, seed])
    waypoints, joints = int(rng.integers(2, 9)), int(rng.integers(1, 8))

    def pairs(low: float, high: float) -> Array:
        return np.stack([-rng.uniform(low, high, joints), rng.uniform(low, high, joints)], axis=1)

    velocity, acceleration, jerk = pairs(0.5, 3.0), pairs(0.5, 8.0), pairs(5.0, 80.0)
    limits = Limits(velocity, acceleration, jerk if seed % 2 else None)
    return Problem(rng.normal(size=(waypoints, joints)), limits, f"path-{seed}")


@dataclass(frozen=True)
class Found:
    """What one problem's answer is, and what is wrong with it; empty for nothing."""

    seed: int
    seconds: float
    dilation: float
    above_bound: float
    wrong: str


def judged(seed: int) -> Found:
    """Time one problem's spline, and judge the answer."""
    asked = problem(seed)
    knots, ends = rules()[seed % len(rules())]
    path = spline(asked, knots, ends)
    planner = Along()
    began = time.process_time()
    solution = planner.along(asked, path)
    seconds = time.process_time() - began
    if solution.trajectory is None:
        return Found(seed, seconds, np.nan, np.nan, solution.message)
    found = verify(asked, solution.trajectory)
    duration = found.certified_duration
    if duration is None:
        return Found(seed, seconds, np.nan, np.nan, "; ".join(found.flaws))
    bound = planner.bound(asked, path) or np.nan
    above = duration / bound - 1
    wrong = ""
    if found.dilation > 1 + MOST_SLOWED:
        wrong = f"slowed down {found.dilation:.6f} times"
    elif above < -MARGIN_RTOL or duration < end_to_end_bound(asked) * (1 - MARGIN_RTOL):
        wrong = "below a bound"
    return Found(seed, seconds, found.dilation, above, wrong)


def main(
    count: int = 160, first: int = 0, output: Path = Path("results/paths"), quick: bool = False
) -> None:
    """Judge `count` problems from a seed on, `quick` ten; exit code 1 if anything is wrong."""
    count = min(count, 10) if quick else count
    found = []
    with progress(count, "paths") as advance:
        for seed in range(first, first + count):
            found.append(judged(seed))
            advance(1)
    table = pd.DataFrame(found)
    save_table(table, output / "paths")
    print(table[["seconds", "dilation", "above_bound"]].describe().to_string())
    broken = table[table["wrong"] != ""]
    for row in broken.itertuples():
        print(f"{row.seed}: {row.wrong}")
    sys.exit(int(len(broken) > 0))
