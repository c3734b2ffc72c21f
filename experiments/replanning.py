"""Is the fastest motion that begins or ends in motion found, and is that proved?

    python -m experiments.replanning            # the 88 problems of the suite `moving`
    python -m experiments.replanning --quick    # the first twelve
    python -m experiments.replanning --suite sections   # limits of one segment

Each problem is planned by `exact`, or by `exact-jerk` if it has jerk limits, and bounded by
`prove`. The gap is certified duration over lower bound. *Ruckig, searched* is `ruckig-search`, in
percent above the certified duration.
"""

from __future__ import annotations

import time
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from baselines.lower_bound.bound import prove
from experiments.common.output import progress, save_table
from trajopt import Problem, verify
from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import load

WITHIN = 1e-4
TIME_LIMIT_S = 20.0  # for one proof


def duration(problem: Problem, planner: str) -> float:
    """Return a planner's certified duration, s; NaN without one."""
    motion = load(planner).solve(problem).trajectory
    found = None if motion is None else verify(problem, motion).certified_duration
    return np.nan if found is None else found


def row(problem: Problem) -> dict[str, object]:
    """Return the row of one problem."""
    jerk = problem.has("jerk")
    began = time.process_time()
    best = duration(problem, "exact-jerk" if jerk else "exact")
    spent = time.process_time() - began
    bound = prove(problem, within=WITHIN, time_limit=TIME_LIMIT_S)
    return {
        "problem": problem.name,
        "limits": "jerk too" if jerk else "velocity, acceleration",
        "certified": best,
        "gap": 100 * (best / bound.lower_bound - 1),
        "ruckig": 100 * (duration(problem, "ruckig-search") / best - 1),
        "seconds": spent,
    }


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per kind of limits."""
    found = []
    for limits, own in rows.groupby("limits", sort=False):
        gaps = own["gap"]
        found.append(
            {
                "limits": limits,
                "problems": len(own),
                "solved": int(own["certified"].notna().sum()),
                "proved within 0.01 %": int((gaps <= 100 * WITHIN * (1 + 1e-6)).sum()),
                "median gap, %": gaps.median(),
                "largest gap, %": gaps.max(),
                "Ruckig, searched: median, %": own["ruckig"].median(),
                "largest, %": own["ruckig"].max(),
                "CPU seconds, median": own["seconds"].median(),
            }
        )
    return pd.DataFrame(found)


def main(
    output: Path = Path("results/replanning"), quick: bool = False, suite: str = "moving"
) -> None:
    """Plan and bound every problem of a suite, or the first twelve if `quick`; print the table."""
    problems = catalogue.problems(suite, 12 if quick else None)
    rows = []
    with progress(len(problems), "problems") as advance:
        for problem in problems:
            rows.append(row(problem))
            advance(1)
    table = pd.DataFrame(rows)
    save_table(table, output / "problems")
    shown = summary(table)
    print(shown.to_string(index=False))
    save_table(shown, output / "replanning")


if __name__ == "__main__":
    cyclopts.run(main)
