"""Explain the gaps: the decompositions of mathematics.md, section 6, side by side.

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
from trajopt.benchmark.suites import catalogue as suite
from trajopt.cli import console
from trajopt.cli.explain import explained_run
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.explain.active_limits import share_at_limits
from trajopt.explain.decomposition import Explanation, explain
from trajopt.planners.registry import load
from trajopt.views.figures import explanation as gap_plots
from trajopt.views.figures import plots

PLANNERS = ("issa", "ssa", "pso", "toppra", "ruckig-search")


def explained(
    problem: Problem,
    name: str,
    seed: int | None,
) -> Explanation:
    """One planner's explanation, of the median run of a stochastic one unless a seed is given.

    Raises:
        TrajoptError: it has no certified trajectory.
    """
    planner = load(name)
    trial = explained_run(planner, problem, seed, name)
    if trial.certified_trajectory is None:
        raise TrajoptError(f"{name} on {problem.name}: {trial.status}: {trial.message}")
    return explain(problem, planner, trial.certified_trajectory)


def row(
    problem: Problem,
    name: str,
    explanation: Explanation,
) -> dict[str, object]:
    """Durations in seconds, gaps as ratios minus 1, and the share of time at a limit."""
    values = explanation.as_dict()
    del values["notes"], values["binding"]
    share = share_at_limits(problem, explanation.trajectory)
    return {"planner": name} | values | {"at_a_limit": share}


def main(
    problem: str = "six-axis",
    *,
    planner: tuple[str, ...] = PLANNERS,
    seed: int | None = None,
    output: Path = Path("results/explained"),
) -> None:
    """Explain every planner on a problem."""
    loaded = suite.load(problem)
    rows = []
    panels = []
    with console.progress(len(planner)) as advance:
        for name in planner:
            explanation = explained(loaded, name, seed)
            rows.append(row(loaded, name, explanation))
            for title, steps in explanation.steps().items():
                panels.append((f"{name}: {title}", steps))
            advance(1)
    table = pd.DataFrame(rows)
    save_table(table, output / "explained")
    if panels:
        figure = gap_plots.waterfalls(panels)
        plots.save(figure, output / "waterfalls")
    print(table.to_string(index=False, float_format="{:.4f}".format))


if __name__ == "__main__":
    cyclopts.run(main)
