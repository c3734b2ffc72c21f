"""Is the fastest motion found and proved in problems with demands beside rest to rest?

    python -m experiments.replanning            # the 88 problems of the suite `moving`
    python -m experiments.replanning --quick    # the first twelve
    python -m experiments.replanning --suite sections   # limits of one segment
    python -m experiments.replanning --suite demands --time-limit 5  # times, waits, loops, boxes

Each problem is planned by `exact`, or by `exact-jerk` if it has jerk limits, and bounded by
`prove`. The suite `demands` has a row per demand. The gap is certified duration over lower bound.
*Ruckig, searched* is `ruckig-search`, in percent above the certified duration, where it supports
the problem.
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


def duration(problem: Problem, planner: str) -> float:
    """Return a planner's certified duration, s; NaN without one."""
    motion = load(planner).solve(problem).trajectory
    found = None if motion is None else verify(problem, motion).certified_duration
    return np.nan if found is None else found


def row(problem: Problem, time_limit: float) -> dict[str, object]:
    """Return the row of one problem."""
    jerk = problem.has("jerk")
    began = time.process_time()
    best = duration(problem, "exact-jerk" if jerk else "exact")
    spent = time.process_time() - began
    bound = prove(problem, within=WITHIN, time_limit=time_limit)
    return {
        "problem": problem.name,
        "demand": " and ".join(problem.demands),
        "limits": "jerk too" if jerk else "velocity, acceleration",
        "certified": best,
        "gap": 100 * (best / bound.lower_bound - 1),
        "ruckig": 100 * (duration(problem, "ruckig-search") / best - 1),
        "seconds": spent,
    }


def summary(rows: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Return a row per value of these columns."""
    found = []
    for values, own in rows.groupby(by, sort=False):
        gaps = own["gap"]
        found.append(
            {
                **dict(zip(by, values, strict=True)),
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
    output: Path = Path("results/replanning"),
    quick: bool = False,
    suite: str = "moving",
    time_limit: float = 20.0,
) -> None:
    """Plan and bound every problem of a suite, or the first twelve if `quick`; print the table.

    `time_limit` is for one proof, in CPU seconds.
    """
    problems = catalogue.problems(suite, 12 if quick else None)
    rows = []
    with progress(len(problems), "problems") as advance:
        for problem in problems:
            rows.append(row(problem, time_limit))
            advance(1)
    table = pd.DataFrame(rows)
    save_table(table, output / "problems")
    shown = summary(table, ["demand", "limits"] if suite == "demands" else ["limits"])
    print(shown.to_string(index=False))
    save_table(shown, output / "replanning")


if __name__ == "__main__":
    cyclopts.run(main)
