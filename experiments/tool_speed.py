"""What does a limit of the tool's speed cost, and how near do planners come to what is possible?

    python -m experiments.tool_speed            # nine problems, minutes where poses are far
    python -m experiments.tool_speed --quick    # two links alone, half a minute
    python -m experiments.tool_speed --figure   # the figure of the page on it, from the table

Each problem is that of an arm with one more limit: 0.25 m/s, the speed beside a person (ISO
10218-1, reduced speed), and 1 m/s. The bound is proved: the joints' limits together with each
chord between the tool's places over its speed. Planners: `collocation-refined`, which chooses the
path; `along`, the fastest timing of a spline; `exact` without the limit, slowed down into it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from experiments.common.output import progress, save_table
from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites import arms, catalogue
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import TrajoptError
from trajopt.planners.registry import load
from trajopt.views.figures import plots, style
from trajopt.views.figures.style import BLACK, BLUE, VERMILION

NEAR = "ur5e-near"
ARMS = (NEAR, "six-axis", "robots-ur5e-w4", "robots-franka-panda-w4")
SPEEDS = (0.25, 1.0)
PLANNED = "collocation-refined:starts=2,refinements=2"
PROVED = "prove:time_limit=60"
CURVE_SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
CURVE_PROVED = "prove:time_limit=5"


def two_links() -> Problem:
    """Return the planar arm of `docs/how-to/a-limit-of-your-own.md`, 0.6 m and 0.4 m."""
    origins = np.tile(np.eye(4), (2, 1, 1))
    origins[1, 0, 3] = 0.6
    tool = np.eye(4)
    tool[0, 3] = 0.4
    chain = LinkChain(origins, np.tile([0.0, 0.0, 1.0], (2, 1)), np.zeros(2, dtype=bool), tool)
    waypoints = np.radians([[0, 20], [40, 60], [90, 30], [120, 80]])
    limits = Limits(np.radians([180, 180]), np.radians([600, 600]))
    return Problem(waypoints, limits, "two links", chain=chain)


def limited(problem: Problem, speed: float) -> Problem:
    """Return a problem with a limit of the tool's speed, m/s."""
    limits = Limits(**problem.limits.kinds, tool_speed=speed)
    return replace(problem, limits=limits, chain=catalogue.chain(problem))


def certified(problem: Problem, asked: Problem, spec: str) -> tuple[float, float, float]:
    """Return a planner's certified duration, s, and CPU times of planning and judging, s."""
    began = time.process_time()
    try:
        motion = load(spec).solve(asked).trajectory
    except TrajoptError:
        motion = None
    planned = time.process_time()
    found = None if motion is None else verify(problem, motion).certified_duration
    judged = time.process_time()
    return np.nan if found is None else found, planned - began, judged - planned


def row(free: Problem, speed: float, planner: str) -> dict[str, object]:
    """Return the row of one arm and speed."""
    problem = limited(free, speed)
    chords = sum(own.least_times(problem).sum() for own in problem.limits.kinds.values())
    planned, seconds, judging = certified(problem, problem, planner)
    path, _, _ = certified(problem, problem, "along")
    slowed, _, _ = certified(problem, free, "exact")
    bound = load(PROVED).solve(problem).lower_bound or np.nan
    best = min(planned, path)
    return {
        "problem": free.name,
        "tool speed, m/s": speed,
        "without it, s": certified(free, free, "exact")[0],
        "proved bound, s": bound,
        "chords, s": float(chords),
        "best, s": best,
        "above the bound, %": 100 * (best / bound - 1),
        "along a spline, s": path,
        "exact, slowed down, s": slowed,
        "CPU to plan, s": seconds,
        "CPU to judge, s": judging,
    }


def curves(name: str) -> pd.DataFrame:
    """Return the proved bound and the duration along a spline, s, by tool speed, m/s."""
    free = arms.near("ur5e") if name == NEAR else catalogue.load(name)
    rows = []
    for speed in CURVE_SPEEDS:
        problem = limited(free, speed)
        path, _, _ = certified(problem, problem, "along")
        rows.append((speed, load(CURVE_PROVED).solve(problem).lower_bound, path))
    return pd.DataFrame(rows, columns=["speed", "bound", "along"])


@plots.styled
def drawn(table: pd.DataFrame) -> Figure:
    """Draw durations against the limit: the bound, along a spline, and the best of the table."""
    figure = Figure(figsize=(5.4, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    for name, colour in ((NEAR, BLUE), ("six-axis", VERMILION)):
        own = curves(name)
        best = table[table["problem"] == name]
        axes.plot(own["speed"], own["along"], color=colour, lw=0.8, ls="--")
        axes.plot(own["speed"], own["bound"], color=colour, label=f"{name}: proved bound")
        axes.plot(
            best["tool speed, m/s"], best["best, s"], color=colour, marker="o", ls="", label="best"
        )
    axes.plot([], [], color=BLACK, lw=0.8, ls="--", label="along a spline")
    ticks = CURVE_SPEEDS, (1, 2, 5, 10)
    axes.set_xticks(ticks[0], [style.plain(tick) for tick in ticks[0]])
    axes.set_yticks(ticks[1], [style.plain(tick) for tick in ticks[1]])
    axes.minorticks_off()
    axes.set_xlabel("limit of the tool's speed, m/s")
    axes.set_ylabel("duration, s")
    axes.legend()
    return figure


def cases(names: Sequence[str], speeds: Sequence[float]) -> list[tuple[Problem, float]]:
    """Return the problems with their speeds: of two links, 0.5 m/s alone."""
    free = [arms.near("ur5e") if name == NEAR else catalogue.load(name) for name in names]
    return [(two_links(), 0.5), *((arm, speed) for arm in free for speed in speeds)]


def main(
    output: Path = Path("results/tool-speed"),
    *,
    quick: bool = False,
    arm: list[str] | None = None,
    speed: list[float] | None = None,
    planner: str = PLANNED,
    figure: bool = False,
) -> None:
    """Plan every problem in each way, or the smallest if `quick`; print the table.

    Args:
        output: Folder of the table.
        quick: Two links alone.
        arm: Problems in place of the three arms.
        speed: Speeds in place of the two, m/s.
        planner: What plans under the limit.
        figure: Draw the figure from the table that is in the folder.
    """
    if figure:
        plots.save(drawn(pd.read_csv(output / "tool-speed.csv")), output / "tool-speed")
        return
    names = () if quick else arm or ARMS
    rows = []
    asked = cases(names, speed or SPEEDS)
    with progress(len(asked), "problems") as advance:
        for free, own in asked:
            rows.append(row(free, own, planner))
            save_table(pd.DataFrame(rows), output / "tool-speed")
            advance(1)
    print(pd.DataFrame(rows).to_string(index=False))


if __name__ == "__main__":
    cyclopts.run(main)
