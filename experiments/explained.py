"""What are the gaps made of? The decompositions of mathematics.md, section 6, side by side.

    python -m experiments.explained                       # six-axis, five planners, half a minute
    python -m experiments.explained my-problem.toml --planner issa --planner toppra

One row per planner goes to `explained.csv` and `.md` in `--output`, one waterfall per decomposition
to `waterfalls.png` and `.svg`.
"""

from __future__ import annotations

from pathlib import Path

import cyclopts
import pandas as pd

from experiments.common.output import save_table
from trajopt.benchmark.figures import explanation as gap_plots
from trajopt.benchmark.figures import plots
from trajopt.benchmark.suites import catalogue as suite
from trajopt.cli import console
from trajopt.exceptions import TrajoptError
from trajopt.explain.active_limits import share_at_limits
from trajopt.explain.decomposition import Explanation, explain
from trajopt.problem import Problem
from trajopt.registry import load

PLANNERS = ("issa", "ssa", "pso", "toppra", "ruckig")


def explained(problem: Problem, name: str, seed: int) -> Explanation:
    """One planner's explanation; raises `TrajoptError` if it has no trajectory."""
    solution = load(name).solve(problem, seed=seed)
    if solution.trajectory is None:
        raise TrajoptError(f"{name} on {problem.name}: {solution.status}: {solution.message}")
    return explain(problem, load(name), solution.trajectory)


def row(problem: Problem, name: str, found: Explanation) -> dict[str, object]:
    """Durations in seconds, gaps as ratios, and the share of time at a limit."""
    values = {k: v for k, v in found.as_dict().items() if k not in ("notes", "binding")}
    return {"planner": name} | values | {"at_a_limit": share_at_limits(problem, found.trajectory)}


def main(
    problem: str = "six-axis",
    *,
    planner: tuple[str, ...] = PLANNERS,
    seed: int = 0,
    output: Path = Path("results/explained"),
) -> None:
    """Explain every planner on a problem."""
    loaded, found = suite.load(problem), {}
    with console.progress(len(planner)) as advance:
        for name in planner:
            found[name] = explained(loaded, name, seed)
            advance(1)
    table = pd.DataFrame([row(loaded, name, e) for name, e in found.items()])
    save_table(table, output / "explained")
    panels = [(f"{n}: {title}", s) for n, e in found.items() for title, s in e.steps().items()]
    if panels:
        plots.save(gap_plots.waterfalls(panels), output / "waterfalls")
    print(table.to_string(index=False, float_format="{:.4f}".format))


if __name__ == "__main__":
    cyclopts.run(main)
