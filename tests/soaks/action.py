"""Does the gap table's action catch a regression of 1 %, and let noise pass?

    python tests/soak.py action    # 40 runs, a minute

Each run compares a planner before and after a change, 10 seeds on three problems, as
`.github/actions/gap-table` does. Its seeds are others after the change, as they are after a change
of code that draws other numbers. In 20 runs that is all (noise), in 20 its motions take 1 % longer
as well. A fault is a regression that the action's table does not call longer, or noise that it
does.
"""

from __future__ import annotations

import runpy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd

from soaks import soak_report
from trajopt import Problem, Solution, compare
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load

ACTION = Path(__file__).parents[2] / ".github" / "actions" / "gap-table"
PROBLEMS = ("six-axis", "asymmetric", "jerk-limit")
SEEDS = 10
ALLOWED = 0.5  # %, the action's default
RUNS = 20  # of each kind


@dataclass(frozen=True)
class Changed(Planner):
    """A planner after a change: it draws other numbers, and its motions take longer.

    - `run`: which numbers it draws.
    - `longer`: factor on its durations.
    """

    run: int = 0
    longer: float = 1.0

    stochastic = True

    def options(self) -> dict[str, str]:
        """None: before and after are one planner."""
        return {}

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        solution = load("pso:iterations=30").solve(problem, seed=SEEDS * self.run + seed)
        if solution.trajectory is None:
            return solution
        # slower than its limits ask for, which the judge counts
        slower = solution.trajectory.dilated(self.longer)
        return replace(solution, trajectory=slower, history=None)


def called_longer(
    before: Changed, after: Changed, problems: Sequence[str] = PROBLEMS, seeds: int = SEEDS
) -> bool:
    """Whether the action's table calls a median longer."""
    table = runpy.run_path(str(ACTION / "gap_table.py"))["table"]
    with TemporaryDirectory() as folder:
        sides = [
            compare(problems, [("planner", own)], Path(folder) / name, seeds=seeds, jobs=0)
            for name, own in (("before", before), ("after", after))
        ]
        return bool(table(*sides, ALLOWED)[1])


def main(output: Path = Path("results/action"), quick: bool = False) -> None:
    """Run 20 regressions and 20 changes that are noise, or one of each if `quick`."""
    rows = []
    for run in range(1 if quick else RUNS):
        before = Changed(2 * run)
        for longer, planted in ((1.01, True), (1.0, False)):
            after = Changed(2 * run + 1, longer)
            family = "a median that is 1 % longer" if planted else "noise alone"
            called = called_longer(before, after)
            rows.append({"family": family, "run": run, "planted": planted, "called": called})
    table = pd.DataFrame(rows)
    soak_report.conclude(table, table["planted"] != table["called"], output / "action")
