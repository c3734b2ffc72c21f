"""Figures of one gap: a waterfall from the optimum to the planner, and the use of every limit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from numpy.typing import NDArray

from trajopt.benchmark.figures.plots import BLACK, BLUE, GREY, VERMILION, styled
from trajopt.problem import LimitName, Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]
Steps = Sequence[tuple[str, float]]  # what was added, and the duration it leads to, s

_SAMPLES = 1500
_LABEL: dict[str, Any] = {
    "textcoords": "offset points", "ha": "center", "va": "bottom", "fontsize": 7,
    "linespacing": 1.0,
}  # fmt: skip
_KINDS: tuple[tuple[LimitName, int], ...] = (("velocity", 1), ("acceleration", 2), ("jerk", 3))


@styled
def waterfalls(panels: Sequence[tuple[str, Steps]], columns: int = 2) -> Figure:
    """One waterfall per `(title, steps)`, from the optimum up to a planner's duration (s)."""
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(3.5 * columns, 2.5 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharey="row").ravel()
    for axes, (title, steps) in zip(grid, panels, strict=False):
        _waterfall(axes, steps)
        axes.set_title(title)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    for axes in grid[::columns]:
        axes.set_ylabel("certified duration (s)")
    return figure


def _waterfall(axes: Axes, steps: Steps) -> None:
    names, ends = [name for name, _ in steps], np.array([end for _, end in steps])
    before = np.r_[0.0, ends[:-1]]
    x = np.arange(len(steps) + 1)
    colours = [GREY, *[VERMILION] * (len(steps) - 1)]
    axes.bar(x[:-1], ends - before, bottom=before, width=0.62, color=colours, ec=BLACK, lw=0.6)
    axes.bar(x[-1], ends[-1], width=0.62, color=BLUE, ec=BLACK, lw=0.6)
    axes.hlines(ends, x[:-1] + 0.31, x[1:] - 0.31, color=BLACK, lw=0.6, ls=(0, (3, 2)))
    labels = [f"{ends[0]:.4g} s"]
    labels += [f"{b - a:+.3g} s\n×{b / a:.4f}" for a, b in pairwise(ends)]
    for at, top, label in zip(x, [*ends, ends[-1]], [*labels, f"{ends[-1]:.4g} s"], strict=True):
        axes.annotate(label, (at, top), (0, 2), **_LABEL)
    axes.set_xticks(x, [names[0], *(f"+ {name}" for name in names[1:]), "planner"])
    axes.margins(y=0.2)
    axes.set_ylim(bottom=0)


@styled
def limit_use(
    problem: Problem, trajectory: Trajectory, optimum: Trajectory | None = None, title: str = ""
) -> Figure:
    """Each moving joint's velocity and acceleration (jerk) over its limit, against time.

    On top the highest use of any limit: where it is below 1, time is wasted. The optimum, if given,
    is drawn beneath on the same time axis.
    """
    shown = [("planner", trajectory), *([("optimum", optimum)] if optimum else [])]
    rows = _use(problem, trajectory, np.zeros(1))[0]
    tall = 0.13 * len(rows) + 0.35
    figure = Figure(figsize=(7.0, 1.5 + tall * len(shown)), layout="constrained")
    heights = [1.2, *[tall] * len(shown)]
    top, *maps = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=True)
    end = max(t.duration for _, t in shown)
    _highest(top, problem, trajectory, optimum)
    top.set_title(title, loc="left")
    top.set(ylim=(0, 1.05), ylabel="highest use", xlim=(0, end))
    for axes, (name, own) in zip(maps, shown, strict=True):
        mesh = _heat(axes, problem, own)
        axes.set_ylabel(name)
    maps[-1].set_xlabel("time (s)")
    bar = figure.colorbar(mesh, ax=maps, fraction=0.03, pad=0.01)
    bar.set_label("use of the limit")
    return figure


def _highest(
    axes: Axes, problem: Problem, trajectory: Trajectory, optimum: Trajectory | None
) -> None:
    t = np.linspace(0, trajectory.duration, _SAMPLES)
    use = _use(problem, trajectory, t)[1].max(axis=0)
    axes.fill_between(t, use, color=BLUE, alpha=0.35, lw=0)
    axes.plot(t, use, color=BLUE, lw=0.9, label="planner")
    if optimum:
        t = np.linspace(0, optimum.duration, _SAMPLES)
        use = _use(problem, optimum, t)[1].max(axis=0)
        axes.plot(t, use, color=VERMILION, ls=(0, (4, 1.5)), lw=1.0, label="optimum")
    axes.legend(loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


def _heat(axes: Axes, problem: Problem, trajectory: Trajectory) -> QuadMesh:
    edges = np.linspace(0, trajectory.duration, _SAMPLES + 1)
    names, use = _use(problem, trajectory, 0.5 * (edges[:-1] + edges[1:]))
    mesh = axes.pcolormesh(
        edges, np.arange(len(names) + 1), use, vmin=0, vmax=1, cmap="cividis", rasterized=True
    )
    axes.set_yticks(np.arange(len(names)) + 0.5, names, fontsize=6)
    axes.tick_params(axis="y", length=0)
    axes.vlines(trajectory.waypoint_times[1:-1], 0, len(names), color="white", lw=0.8)
    axes.invert_yaxis()
    return mesh


def _use(problem: Problem, trajectory: Trajectory, t: Array) -> tuple[list[str], Array]:
    """Names and use of every finite limit of the moving joints at times `t`, `(rows, len(t))`."""
    names, rows = [], []
    for kind, order in _KINDS:
        low, high = getattr(problem.limits, kind).T
        values = trajectory(t, order)
        use = np.maximum(values / high, values / low)
        for joint in np.flatnonzero(problem.moving & np.isfinite(high - low)):
            names.append((int(joint), kind))
            rows.append(use[:, joint])
    order_of = sorted(range(len(names)), key=lambda i: names[i][0])
    short = {"velocity": "vel.", "acceleration": "acc.", "jerk": "jerk"}
    return [f"joint {names[i][0] + 1} {short[names[i][1]]}" for i in order_of], np.array(
        [rows[i] for i in order_of]
    )
