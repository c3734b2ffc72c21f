"""Figures of one gap: a waterfall from the optimum to the planner, and the use of every limit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.views.figures.plots import Look, Picture, planner_look, styled
from trajopt.views.figures.style import BLACK, BLUE, GREY, VERMILION, text

Steps = Sequence[tuple[str, float]]  # the names of steps, and the duration after each, s

_SAMPLES = 1500
_BAR_WIDTH = 0.62
_SHORT_DASHES = (0, (3, 2))
_LONG_DASHES = (0, (4, 1.5))


@styled
def waterfalls(panels: Sequence[tuple[str, Steps]], columns: int = 2, planner: str = "") -> Figure:
    """One waterfall per `(title, steps)`, from the optimum up to a planner's duration (s).

    Args:
        panels: What is drawn.
        columns: Panels side by side.
        planner: Label of the planner, whose bar has its colour.
    """
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    width = 3.5 * columns
    height = 2.5 * rows
    figure = Picture(figsize=(width, height), layout="constrained")
    panes = figure.subplots(rows, columns, squeeze=False, sharey="row")
    grid = panes.ravel()
    for axes, (title, steps) in zip(grid, panels, strict=False):
        _waterfall(axes, steps, _colour(planner))
        axes.set_title(text(title), wrap=True)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    for axes in grid[::columns]:
        axes.set_ylabel("certified duration (s)")
    return figure


def _colour(planner: str) -> str:
    """Return a planner's colour in every figure; without a label that of a motion."""
    return str(planner_look(planner)["color"]) if planner else VERMILION


def _waterfall(axes: Axes, steps: Steps, colour: str) -> None:
    """Draw a bar per step, each from the end of the last one, and a whole bar for the planner."""
    added = len(steps) - 1
    ends = np.array([end for _, end in steps])
    starts = np.r_[0.0, ends[:-1]]
    heights = ends - starts
    x = np.arange(len(steps))
    planner = len(steps)
    colours = [BLUE, *[GREY] * added]
    bar: Look = {"width": _BAR_WIDTH, "ec": BLACK, "lw": 0.6}
    axes.bar(x, heights, bottom=starts, color=colours, **bar)
    axes.bar(planner, ends[-1], color=colour, **bar)
    half = _BAR_WIDTH / 2
    axes.hlines(ends, x + half, x + 1 - half, color=BLACK, lw=0.6, ls=_SHORT_DASHES)
    _numbers(axes, ends)
    names = [f"+ {name}" for name, _ in steps]
    names[0], _ = steps[0]
    axes.set_xticks([*x, planner], [*names, "planner"])
    axes.margins(y=0.2)
    axes.set_ylim(bottom=0)


def _numbers(axes: Axes, ends: Array) -> None:
    """Write durations over the first and the last bar, and increments over the others."""
    shortest = ends[0]
    longest = ends[-1]
    labels = [f"{shortest:.4g} s"]
    for before, after in pairwise(ends):
        added = after - before
        labels.append(f"{added:+.3g} s\n×{after / before:.4f}")
    labels.append(f"{longest:.4g} s")
    style: Look = {
        "textcoords": "offset points",
        "ha": "center",
        "va": "bottom",
        "fontsize": 7,
        "linespacing": 1.0,
    }
    tops = [*ends, longest]
    for x, label in enumerate(labels):
        top = (x, tops[x])
        axes.annotate(label, top, (0, 2), **style)


@styled
def limit_use(
    problem: Problem,
    trajectory: Trajectory,
    optimum: Trajectory | None = None,
    title: str = "",
    planner: str = "",
) -> Figure:
    """Draw the use of each limit of each moving joint against time.

    On top is the highest use of any limit; where it is below 1, the motion could be faster. The
    optimum, if given, is drawn beneath on the same time axis.

    Args:
        problem: Has the limits.
        trajectory: The motion.
        optimum: Beside which it is drawn.
        title: Over the figure.
        planner: Label of the motion's planner, whose colour it has.
    """
    shown = {"planner": trajectory}
    if optimum:
        shown["optimum"] = optimum
    start = np.zeros(1)
    names, _ = _use(problem, trajectory, start)
    tall = 0.13 * len(names) + 0.35
    heights = [1.2, *[tall] * len(shown)]
    height = 0.3 + sum(heights)
    figure = Picture(figsize=(7.0, height), layout="constrained")
    top, *maps = figure.subplots(len(heights), sharex=True, height_ratios=heights)
    end = max(own.duration for own in shown.values())
    _highest(top, problem, trajectory, optimum, _colour(planner))
    top.set_title(text(title), loc="left", wrap=True)
    top.set_xlim(0, end)
    top.set_ylim(0, 1.05)
    top.set_ylabel("highest use")
    for axes, (name, own) in zip(maps, shown.items(), strict=True):
        mesh = _heat(axes, problem, own)
        axes.set_ylabel(name)
    maps[-1].set_xlabel("time (s)")
    bar = figure.colorbar(mesh, ax=maps, fraction=0.03, pad=0.01)
    bar.set_label("use of the limit")
    return figure


def _highest(
    axes: Axes,
    problem: Problem,
    trajectory: Trajectory,
    optimum: Trajectory | None,
    colour: str,
) -> None:
    """The highest use of any limit against time, filled; that of the optimum dashed."""
    t, use = highest_use(problem, trajectory)
    axes.fill_between(t, use, color=colour, alpha=0.35, lw=0)
    axes.plot(t, use, color=colour, lw=0.9, label="planner")
    if optimum:
        t, use = highest_use(problem, optimum)
        axes.plot(t, use, color=BLUE, ls=_LONG_DASHES, lw=1.0, label="optimum")
    axes.legend(loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


def highest_use(problem: Problem, trajectory: Trajectory) -> tuple[Array, Array]:
    """Return times, s, and the highest use of any limit there: 1 is at the limit."""
    t = np.linspace(0, trajectory.duration, _SAMPLES)
    _, use = _use(problem, trajectory, t)
    return t, use.max(axis=0)


def _heat(axes: Axes, problem: Problem, trajectory: Trajectory) -> QuadMesh:
    edges = np.linspace(0, trajectory.duration, _SAMPLES + 1)
    middles = 0.5 * (edges[:-1] + edges[1:])
    names, use = _use(problem, trajectory, middles)
    rows = np.arange(len(names) + 1)
    mesh = axes.pcolormesh(edges, rows, use, vmin=0, vmax=1, cmap="cividis", rasterized=True)
    axes.set_yticks(rows[:-1] + 0.5, names, fontsize=6)
    axes.tick_params(axis="y", length=0)
    passing = trajectory.waypoint_times[1:-1]
    axes.vlines(passing, 0, len(names), color="white", lw=0.8)
    axes.invert_yaxis()
    return mesh


def _use(problem: Problem, trajectory: Trajectory, t: Array) -> tuple[list[str], Array]:
    """Names and use of every limit, joint by joint; at last of those that are not one joint's.

    Args:
        problem: whose limits they are.
        trajectory: what uses them.
        t: times `(m,)`, s.

    Returns:
        Names, and uses `(names, m)`: 1 is at the limit.
    """
    uses: list[tuple[float, str, Array]] = []
    for limit in problem.limits.kinds.values():
        if not limit.is_ratio:
            continue
        for joint, use in limit.along(trajectory, t).items():
            if joint is None:
                uses.append((np.inf, limit.short, use))
            elif problem.moving[joint]:
                name = text(problem.joint_labels[joint])
                uses.append((joint, f"{name} {limit.short}", use))
    uses.sort(key=lambda row: row[0])
    names = [name for _, name, _ in uses]
    return names, np.array([use for _, _, use in uses])
