"""Figures of the paper's two experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.paper.searches import ALGORITHMS, MM, NAMES, Runs, running_times
from trajopt import Problem, Trajectory
from trajopt.benchmark.figures import plots, sampling, style
from trajopt.kinematics import Robot

MARKS = {"mean": "v", "longest": "s", "segment-wise maximum": "D", "shared": "o"}


@plots.styled
def cartesian_path(robot: Robot, problem: Problem, trajectory: Trajectory) -> Figure:
    """The tool's path, and the robot as links at the four points: in space, and from the side."""
    figure = Figure(figsize=(7.2, 3.3))
    space: Any = figure.add_axes((0.0, 0.1, 0.47, 0.92), projection="3d")
    side = figure.add_axes((0.62, 0.24, 0.36, 0.72))
    path = MM * robot.forward(trajectory(np.linspace(0, trajectory.duration, 400)))[:, :3, 3]
    links = MM * robot.frames(problem.waypoints)[..., :3, 3]
    for axes, kept_axes in ((space, [0, 1, 2]), (side, [0, 2])):
        looks = zip(links, style.CURVES, style.DASHES, style.MARKERS, strict=False)
        for k, (chain, colour, dash, marker) in enumerate(looks, start=1):
            own: Any = {"color": colour, "ls": dash, "marker": marker, "mfc": "white", "ms": 3.5}
            axes.plot(*chain[:, kept_axes].T, lw=1.6, label=f"links at point {k}", **own)
        axes.plot(*path[:, kept_axes].T, color=style.BLACK, lw=1.8, label="tool path")
    space.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)", xticks=[0, 1000, 2000],
              yticks=[-500, 0, 500], zticks=[-500, 0, 500], ylim=(-700, 700),
              zlim=(-600, 700))  # fmt: skip
    space.zaxis.labelpad = -1
    space.set_box_aspect((2, 1.4, 1.4), zoom=0.92)
    space.view_init(elev=22, azim=-62)
    side.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal")
    figure.legend(*side.get_legend_handles_labels(), loc="lower center", ncols=5)
    return figure


@plots.styled
def joint_convergence(found: Mapping[str, Runs], problem: Problem) -> Figure:
    """Best duration (s) of each joint searched alone: median and quartiles over seeds."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    for joint, axes in enumerate(figure.subplots(2, 3).flat):
        axes.set(title=f"joint {joint + 1}")
        axes.set_xlabel("evaluations" if joint > 2 else "")
        axes.set_ylabel("best duration (s)" if joint % 3 == 0 else "")
        if not problem.moving[joint]:
            axes.text(0.5, 0.5, "never moves", transform=axes.transAxes, ha="center", color="0.3")
            axes.set(xticks=[], yticks=[])
            continue
        looks = zip(found.items(), style.CURVES, style.DASHES, style.MARKERS, strict=False)
        for (algorithm, runs), colour, dash, marker in looks:
            spent, (low, median, high) = sampling.over_runs(runs.curves(joint))
            axes.fill_between(spent, low, high, step="post", color=colour, alpha=0.18, lw=0)
            axes.plot(spent, median, drawstyle="steps-post", color=colour, ls=dash, marker=marker,
                      markevery=0.17, mfc="white", label=NAMES[algorithm])  # fmt: skip
        end = min(curve[-1, 1] for runs in found.values() for curve in runs.curves(joint))
        axes.set(xscale="log", xlim=(20, None), ylim=(0.95 * end, 2.0 * end))
        axes.xaxis.set_minor_formatter(NullFormatter())
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


@plots.styled
def joint_curves(problem: Problem, trajectories: Mapping[str, Trajectory]) -> Figure:
    """Position, velocity and acceleration of every joint (rows), one column per algorithm."""
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    grid = figure.subplots(3, len(trajectories), sharex=True, sharey="row", squeeze=False)
    for column, (algorithm, trajectory) in zip(grid.T, trajectories.items(), strict=True):
        column[0].set_title(f"{NAMES[algorithm]}, {trajectory.duration:.4f} s")
        column[-1].set_xlabel("time (s)")
        for order, axes in enumerate(column):
            t, values = sampling.curve(trajectory, order)
            looks = zip(range(problem.joints), style.CURVES, cycle(style.DASHES), strict=False)
            for joint, colour, dash in looks:
                axes.plot(t, np.degrees(values[:, joint]), color=colour, ls=dash, lw=1.1,
                          label=f"joint {joint + 1}")  # fmt: skip
            for time in trajectory.waypoint_times:
                axes.axvline(time, color="0.6", lw=0.4, zorder=0.5)
    for axes, label in zip(grid[:, 0], ("position (°)", "velocity (°/s)", "acceleration (°/s²)"),
                           strict=True):  # fmt: skip
        axes.set_ylabel(label)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return figure


@plots.styled
def readings(table: pd.DataFrame, names: Sequence[str]) -> Figure:
    """Every reading's running times against the three published ones."""
    figure = Figure(figsize=(7.2, 1.3 + 0.27 * len(names)), layout="constrained")
    axes = figure.subplots()
    colours = dict(zip(ALGORITHMS, style.CURVES, strict=False))
    for algorithm, dash in zip(ALGORITHMS, style.DASHES, strict=False):
        label = f"published {NAMES[algorithm]}"
        axes.axvline(running_times()[algorithm], color=colours[algorithm], ls=dash, label=label)
    for shift, algorithm in zip((-0.22, 0.0, 0.22), ALGORITHMS, strict=True):
        for combination, marker in MARKS.items():
            own = table[(table["algorithm"] == NAMES[algorithm])
                        & (table["combination"] == combination)]  # fmt: skip
            heights = [names.index(n) + shift for n in own["reading"]]
            honest = own["passes together"] & (own["keeps limits"] > 0.5)
            for face, some in (("white", ~honest), (colours[algorithm], honest)):
                at = [h for h, s in zip(heights, some, strict=True) if s]
                axes.plot(own.loc[some, "claimed s"], at, marker, ms=4, mfc=face, mew=0.9,
                          mec=colours[algorithm])  # fmt: skip
    for combination, marker in MARKS.items():
        axes.plot([], [], marker, ms=4, mfc="white", mec=style.BLACK, label=combination)
    axes.plot([], [], "o", ms=4, color=style.BLACK, label="keeps Table 3's limits, passes points")
    axes.set_title("in each row, from the top: PSO, SSA, ISSA", loc="left", color="0.3")
    axes.set(xlabel="running time claimed (s)", xlim=(0, 8.2), ylim=(len(names) - 0.4, -0.6))
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    axes.set_axisbelow(True)
    axes.hlines(np.arange(len(names) - 1) + 0.5, *axes.get_xlim(), color="0.9", lw=0.5)
    figure.legend(loc="outside lower center", ncols=3)
    return figure
