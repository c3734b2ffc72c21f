"""Figures of the paper's two experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.paper.searches import ALGORITHMS, MM, NAMES, Array, Runs, running_times
from trajopt import Problem, Trajectory
from trajopt.planners.kinematics import Robot
from trajopt.views.figures import plots, sampling, style

MARKS = {
    "mean": "v",
    "longest": "s",
    "segment-wise maximum": "D",
    "shared": "o",
}


@plots.styled
def cartesian_path(
    robot: Robot,
    problem: Problem,
    trajectory: Trajectory,
) -> Figure:
    """The tool's path, and the robot as links at the four points: in space, and from the side."""
    figure = Figure(figsize=(7.2, 3.3))
    space: Any = figure.add_axes((0.0, 0.1, 0.47, 0.92), projection="3d")
    side = figure.add_axes((0.62, 0.24, 0.36, 0.72))
    instants = np.linspace(0, trajectory.duration, 400)
    poses = robot.forward(trajectory(instants))
    frames = robot.frames(problem.waypoints)
    path = MM * poses[:, :3, 3]
    links = MM * frames[..., :3, 3]
    x_z = [0, 2]
    _links_and_path(space, links, path)
    _links_and_path(side, links[..., x_z], path[:, x_z])
    space.set(
        xlabel="x (mm)",
        ylabel="y (mm)",
        zlabel="z (mm)",
        xticks=[0, 1000, 2000],
        yticks=[-500, 0, 500],
        zticks=[-500, 0, 500],
        ylim=(-700, 700),
        zlim=(-600, 700),
    )
    space.zaxis.labelpad = -1
    space.set_box_aspect((2, 1.4, 1.4), zoom=0.92)
    space.view_init(elev=22, azim=-62)
    side.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal")
    handles, labels = side.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=5)
    return figure


def _links_and_path(
    axes: Any,
    links: Array,
    path: Array,
) -> None:
    """Links `(points, joints + 1, axes)` and path `(m, axes)`, mm, on two or three axes."""
    looks = zip(links, style.CURVES, style.DASHES, style.MARKERS, strict=False)
    for point, (chain, colour, dash, marker) in enumerate(looks, start=1):
        axes.plot(
            *chain.T,
            color=colour,
            ls=dash,
            lw=1.6,
            marker=marker,
            mfc="white",
            ms=3.5,
            label=f"links at point {point}",
        )
    axes.plot(*path.T, color=style.BLACK, lw=1.8, label="tool path")


@plots.styled
def joint_convergence(found: Mapping[str, Runs], problem: Problem) -> Figure:
    """Best duration (s) of each joint searched alone: median and quartiles over seeds."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    for joint, axes in enumerate(figure.subplots(2, 3).flat):
        axes.set_title(f"joint {joint + 1}")
        if joint > 2:
            axes.set_xlabel("evaluations")
        if joint % 3 == 0:
            axes.set_ylabel("best duration (s)")
        if problem.moving[joint]:
            _convergence(axes, found, joint)
            handles, labels = axes.get_legend_handles_labels()
        else:
            axes.text(
                0.5,
                0.5,
                "never moves",
                transform=axes.transAxes,
                ha="center",
                color="0.3",
            )
            axes.set(xticks=[], yticks=[])
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _convergence(
    axes: Axes,
    found: Mapping[str, Runs],
    joint: int,
) -> None:
    looks = zip(found.items(), style.CURVES, style.DASHES, style.MARKERS, strict=False)
    ends = []
    for (algorithm, runs), colour, dash, marker in looks:
        curves = runs.curves(joint)
        ends += [curve[-1, 1] for curve in curves]
        spent, (low, median, high) = sampling.over_runs(curves)
        axes.fill_between(
            spent,
            low,
            high,
            step="post",
            color=colour,
            alpha=0.18,
            lw=0,
        )
        axes.plot(
            spent,
            median,
            drawstyle="steps-post",
            color=colour,
            ls=dash,
            marker=marker,
            markevery=0.17,
            mfc="white",
            label=NAMES[algorithm],
        )
    best = min(ends)
    axes.set(xscale="log", xlim=(20, None), ylim=(0.95 * best, 2.0 * best))
    axes.xaxis.set_minor_formatter(NullFormatter())


@plots.styled
def joint_curves(problem: Problem, trajectories: Mapping[str, Trajectory]) -> Figure:
    """Position, velocity and acceleration of every joint (rows), one column per algorithm."""
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    grid = figure.subplots(
        3,
        len(trajectories),
        sharex=True,
        sharey="row",
        squeeze=False,
    )
    for column, (algorithm, trajectory) in zip(grid.T, trajectories.items(), strict=True):
        column[0].set_title(f"{NAMES[algorithm]}, {trajectory.duration:.4f} s")
        column[-1].set_xlabel("time (s)")
        for order, axes in enumerate(column):
            _joints(axes, trajectory, order)
    labels = ("position (°)", "velocity (°/s)", "acceleration (°/s²)")
    for axes, label in zip(grid[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    handles, names = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=6)
    return figure


def _joints(
    axes: Axes,
    trajectory: Trajectory,
    order: int,
) -> None:
    """One derivative of every joint, degrees, and when the waypoints are passed."""
    t, values = sampling.curve(trajectory, order)
    looks = zip(range(trajectory.joints), style.CURVES, cycle(style.DASHES), strict=False)
    for joint, colour, dash in looks:
        degrees = np.degrees(values[:, joint])
        axes.plot(
            t,
            degrees,
            color=colour,
            ls=dash,
            lw=1.1,
            label=f"joint {joint + 1}",
        )
    for time in trajectory.waypoint_times:
        axes.axvline(time, color="0.6", lw=0.4, zorder=0.5)


@plots.styled
def readings(table: pd.DataFrame, names: Sequence[str]) -> Figure:
    """Every reading's running times against the three published ones."""
    height = 1.3 + 0.27 * len(names)
    figure = Figure(figsize=(7.2, height), layout="constrained")
    axes = figure.subplots()
    published = running_times()
    for shift, algorithm, colour, dash in zip(
        (-0.22, 0.0, 0.22),
        ALGORITHMS,
        style.CURVES[:3],
        style.DASHES[:3],
        strict=True,
    ):
        label = f"published {NAMES[algorithm]}"
        axes.axvline(published[algorithm], color=colour, ls=dash, label=label)
        own = table[table["algorithm"] == NAMES[algorithm]]
        heights = own["reading"].map(names.index) + shift
        _claims(axes, own, heights, colour)
    for combination, marker in MARKS.items():
        axes.plot(
            [],
            [],
            marker,
            ms=4,
            mfc="white",
            mec=style.BLACK,
            label=combination,
        )
    axes.plot(
        [],
        [],
        "o",
        ms=4,
        color=style.BLACK,
        label="keeps Table 3's limits, passes points",
    )
    axes.set_title("in each row, from the top: PSO, SSA, ISSA", loc="left", color="0.3")
    lowest = len(names) - 0.4
    axes.set(
        xlabel="running time claimed (s)",
        xlim=(0, 8.2),
        ylim=(lowest, -0.6),
    )
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    axes.set_axisbelow(True)
    between = np.arange(len(names) - 1) + 0.5
    axes.hlines(between, *axes.get_xlim(), color="0.9", lw=0.5)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _claims(
    axes: Axes,
    own: pd.DataFrame,
    heights: pd.Series[float],
    colour: str,
) -> None:
    """A mark per claim: its shape the combination, filled where it is honest."""
    honest = own["passes together"] & (own["keeps limits"] > 0.5)
    for combination, marker in MARKS.items():
        of_kind = own["combination"] == combination
        for face, some in (("white", of_kind & ~honest), (colour, of_kind & honest)):
            axes.plot(
                own.loc[some, "claimed s"],
                heights[some],
                marker,
                ms=4,
                mfc=face,
                mew=0.9,
                mec=colour,
            )
