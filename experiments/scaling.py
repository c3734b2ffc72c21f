"""How do the reference planners' times grow with the number of waypoints?

    python -m experiments.scaling                # up to 1000 waypoints, some minutes on a core
    python -m experiments.scaling --quick        # up to 20

The problems are random walks of seven joints, each the beginning of a longer one, with the limits
that a planner knows. The times are CPU seconds of a planner's first `solve` at a size. They include
building IPOPT's program, if it uses IPOPT, but no imports, since another problem is solved before.
The slope is the power of the number of waypoints, fitted from `FITTED_FROM` waypoints on. Rows go
to `scaling.csv` in `--output` as soon as they are known, and running again does only what is
missing; the figure is `scaling.png` and `.svg`.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt import Limits, Problem, verify
from trajopt.core.limits import KINDS
from trajopt.planners.registry import load
from trajopt.views.figures import plots

JOINTS = 7
# Waypoints.
SIZES = {
    "exact": (3, 5, 10, 20, 50, 100, 200, 500, 1000),
    "exact-jerk": (3, 5, 10, 20, 50, 100, 200, 300),
    "collocation-refined": (3, 5, 10, 20, 30),
}
WARM_UP = 4  # waypoints of a problem that is not measured
FITTED_FROM = 10
MARGIN = 0.02  # of position limits beyond the outermost waypoints, rad
KEY = ["planner", "waypoints"]


def walk(waypoints: int, *, jerk: bool, position: bool) -> Problem:
    """Uniform steps of up to 1 rad; limits 1 rad/s, 2 rad/s²; 20 rad/s³ and positions, if any."""
    rng = np.random.default_rng(0)
    steps = rng.uniform(-1, 1, (waypoints, JOINTS))
    path = np.cumsum(steps, axis=0)
    each = np.ones(JOINTS)
    jerk_limits = 20 * each if jerk else None
    walls = None
    if position:
        lowest = path.min(axis=0) - MARGIN
        highest = path.max(axis=0) + MARGIN
        walls = np.stack([lowest, highest], axis=1)
    limits = Limits(each, 2 * each, jerk_limits, walls)
    return Problem(path, limits, name=f"walk-{waypoints}")


def measured(planner: str, waypoints: int) -> list[dict[str, float]]:
    """One size's row: CPU seconds, the certified duration (s), and how many starts it took."""
    tried = load(planner)
    planned = {key: tried.plans_for(KINDS[key]) for key in ("jerk", "position")}
    problem = walk(waypoints, **planned)
    solve = tried.solve
    solve(walk(WARM_UP, **planned))
    began = time.process_time()
    solution = solve(problem)
    seconds = time.process_time() - began
    certified = np.nan
    if solution.trajectory is not None:
        certified = verify(problem, solution.trajectory).certified_duration or np.nan
    row = {
        "cpu s": seconds,
        "starts": len(solution.stats["start_status"]),
        "certified duration s": certified,
    }
    return [row]


def slope(rows: pd.DataFrame) -> float:
    """The power of the waypoints that a planner's times grow with; NaN of one size alone."""
    fitted = rows[rows["waypoints"] >= FITTED_FROM]
    if len(fitted) < 2:
        return np.nan
    powers = np.polyfit(np.log(fitted["waypoints"]), np.log(fitted["cpu s"]), deg=1)
    return float(powers[0])


@plots.styled
def drawn(table: pd.DataFrame) -> Figure:
    """Times against waypoints on logarithmic axes, a curve per planner with its slope above."""
    figure = Figure(figsize=(5.4, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    by_planner = table.groupby("planner")
    for planner, own in by_planner:
        own = own.sort_values("waypoints")
        x = own["waypoints"]
        power = slope(own)
        label = planner if np.isnan(power) else f"{planner}: slope {power:.2f}"
        colour = plots.planner_look(planner)["color"]
        axes.plot(x, own["cpu s"], color=colour, marker=plots.planner_mark(planner), label=label)
    axes.set_xlabel("waypoints")
    axes.set_ylabel("CPU time, s")
    figure.legend(loc="outside upper left")
    return figure


def main(most: int = 1000, output: Path = Path("results/scaling"), quick: bool = False) -> None:
    """Measure every size up to `most` waypoints, print the table and the slopes, draw both.

    `quick`: up to 20 waypoints.
    """
    if quick:
        most = min(most, 20)
    cells = {}
    for planner, sizes in SIZES.items():
        for waypoints in sizes:
            if waypoints <= most:
                cells[planner, waypoints] = partial(measured, planner, waypoints)
    table = kept(output / "scaling.csv", KEY, cells)
    save_table(table, output / "scaling")
    print(table.to_string(index=False, float_format="{:.3g}".format))
    for planner, own in table.groupby("planner"):
        if not np.isnan(power := slope(own)):
            print(f"{planner}: time grows as waypoints to the power {power:.2f}")
    plots.save(drawn(table), output / "scaling")


if __name__ == "__main__":
    cyclopts.run(main)
