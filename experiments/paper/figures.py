"""The paper's Figures 5, 6 and 7, drawn from our runs, with the exact optimum beside each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.paper.kept_searches import ALGORITHMS, NAMES, Found
from trajopt import Problem, Trajectory
from trajopt.core.arrays import Array
from trajopt.planners import spline353
from trajopt.planners.kinematics import Robot
from trajopt.planners.registry import load
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.figures import plots
from trajopt.views.figures.style import BLACK, BLUE, CURVES, DASHES, GREEN, PURPLE, VERMILION

OPTIMUM = "exact optimum"
_SAMPLES = 601
_COLOURS = {"issa": VERMILION, "ssa": GREEN, "pso": PURPLE}
_QUANTITIES = ("angle (°)", "velocity (°/s)", "acceleration (°/s²)")
Motions = Mapping[str, Trajectory]


def solved(problem: Problem, planner: str) -> Trajectory:
    """Return a planner's answer on a problem that it solves."""
    answer = load(planner).solve(problem).trajectory
    assert answer is not None
    return answer


def median_motions(found: Found, problem: Problem) -> dict[str, Trajectory]:
    """Return the run of median duration of ISSA, SSA and PSO with shared times, and the optimum."""
    motions = {}
    for algorithm in reversed(ALGORITHMS):
        times = found[algorithm, "shared"].times[:, 0]
        middle = np.argsort(times.sum(axis=1))[len(times) // 2]
        motions[NAMES[algorithm]] = spline353.trajectory(problem, times[middle])
    return motions | {OPTIMUM: solved(problem, "exact")}


def _look(name: str) -> dict[str, Any]:
    if name == OPTIMUM:
        return {"color": BLUE, "lw": 1.6}
    planner = next(key for key, own in NAMES.items() if own == name)
    # Elsewhere all swarms have one colour; here their curves cross.
    return plots.planner_look(planner) | {"label": name, "color": _COLOURS[planner]}


@plots.styled
def tool_path(robot: Robot, problem: Problem, motions: Motions) -> Figure:
    """Fig. 5: the tool's path in space, and the same from the side and from above, m."""
    figure = plots.Picture(figsize=(7.4, 3.3), layout="constrained")
    space = figure.add_subplot(1, 3, 1, projection="3d")
    side, above = figure.add_subplot(1, 3, 2), figure.add_subplot(1, 3, 3)
    for name, motion in motions.items():
        instants = np.linspace(0, motion.duration, _SAMPLES)
        x, y, z = robot.forward(motion(instants))[:, :3, 3].T
        look = _look(name) | {"label": f"{name}, {motion.duration:.2f} s"}
        space.plot(x, y, z, **look)
        side.plot(x, z, **look)
        above.plot(x, y, **look)
    points = robot.forward(problem.waypoints)[:, :3, 3]
    x, y, z = points.T
    marks: dict[str, Any] = {"ls": "", "marker": "o", "color": BLACK, "ms": 4, "zorder": 5}
    space.plot(x, y, z, **marks)
    for axes, upward in ((side, z), (above, y)):
        axes.plot(x, upward, **marks, label="path points 1 to 4" if axes is side else "")
        for number, place in enumerate(zip(x, upward, strict=True), start=1):
            below = -10 if number == 1 and axes is above else 3
            axes.annotate(str(number), place, (5, below), textcoords="offset points")
    space.set(xlabel="x (m)", ylabel="y (m)", title="in space; z upwards (m)")
    space.tick_params(labelsize=6)
    space.locator_params(nbins=4)
    space.set_box_aspect(None, zoom=0.85)
    side.set(xlabel="x (m)", ylabel="z (m)", title="from the side")
    above.set(xlabel="x (m)", ylabel="y (m)", title="from above")
    side.set_aspect("equal", adjustable="datalim")
    above.set_aspect("equal", adjustable="datalim")
    figure.legend(*side.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _by_iteration(curve: Array, algorithm: str, iterations: int) -> Array:
    """Return the best duration after iterations 0 to the last, s; `curve` as of `Runs.curves`."""
    planner = load(algorithm)
    assert isinstance(planner, SwarmPlanner)
    own = planner.optimiser
    spent = own.population + own.evaluations_per_iteration * np.arange(iterations + 1)
    place = np.searchsorted(curve[:, 0], spent, side="right") - 1
    return np.where(place < 0, np.nan, curve[np.maximum(place, 0), 1])


@plots.styled
def convergence(found: Found, problem: Problem, iterations: int) -> Figure:
    """Fig. 6: the best duration of each joint alone by iteration, medians and quartiles."""
    figure = plots.Picture(figsize=(7.4, 4.6), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True)
    steps = np.arange(iterations + 1)
    for joint, axes in enumerate(grid.flat):
        axes.set_title(f"({'abcdef'[joint]}) joint {joint + 1}")
        if not problem.moving[joint]:
            axes.text(0.5, 0.5, "does not move: 0 s", transform=axes.transAxes, ha="center")
            axes.set_yticks([])
            continue
        ends, starts = [], []
        for algorithm in reversed(ALGORITHMS):
            curves = found[algorithm, "per-joint"].curves(joint)
            best = [_by_iteration(curve, algorithm, iterations) for curve in curves]
            low, middle, high = np.nanpercentile(best, [25, 50, 75], axis=0)
            look = _look(NAMES[algorithm])
            axes.plot(1 + steps, middle, **look)
            axes.fill_between(1 + steps, low, high, color=look["color"], alpha=0.15, lw=0)
            starts.append(high[0])
            ends += [curve[-1, 1] for curve in curves]
        optimum = solved(problem.only([joint]), "exact").duration
        _level(axes, min(ends), "shortest 3-5-3 of all runs", {"color": BLACK, "ls": DASHES[2]})
        _level(axes, optimum, OPTIMUM, {"color": BLUE})
        axes.set(xscale="log", ylim=(0, min(1.05 * max(starts), 4 * min(ends))))
    for axes in grid[:, 0]:
        axes.set_ylabel("duration of the joint alone (s)")
    for axes in grid[-1]:
        axes.set_xlabel("1 + iterations")
    keys = grid[0, 1].get_legend_handles_labels()
    figure.legend(*keys, loc="outside lower center", ncols=5)
    return figure


def _level(axes: Axes, duration: float, label: str, look: dict[str, Any]) -> None:
    """Draw a horizontal line with its number."""
    axes.axhline(duration, lw=1.2, label=label, **look)
    axes.annotate(
        f"{duration:.3f} s",
        (1.0, duration),
        (-2, 3),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        ha="right",
        color=look["color"],
    )


@plots.styled
def joint_curves(problem: Problem, motions: Motions) -> Figure:
    """Fig. 7: angle, velocity and acceleration of all joints, a column per motion."""
    figure = plots.Picture(figsize=(7.4, 6.0), layout="constrained")
    grid = figure.subplots(3, len(motions), sharex=True, sharey="row")
    letters = iter("abcdefghi")
    for order, row in enumerate(grid):
        row[0].set_ylabel(_QUANTITIES[order])
        for axes, (name, motion) in zip(row, motions.items(), strict=True):
            own = "" if name == OPTIMUM else f"({next(letters)}) "
            title = f"{own}{name}"
            axes.set_title(f"{title}, {motion.duration:.3f} s" if order == 0 else title)
            _draw_joints(axes, problem, motion, order)
    for axes in grid[-1]:
        axes.set_xlabel("time (s)")
    keys = grid[0, 0].get_legend_handles_labels()
    figure.legend(*keys, loc="outside lower center", ncols=problem.joints)
    return figure


def _draw_joints(axes: Axes, problem: Problem, motion: Trajectory, order: int) -> None:
    """Draw a derivative of all joints, degrees."""
    instants = np.linspace(0, motion.duration, 4 * _SAMPLES)
    values = np.degrees(motion(instants, order))
    for joint in range(problem.joints):
        look: dict[str, Any] = {
            "color": CURVES[joint],
            "ls": DASHES[joint % 4],
            "label": f"joint {joint + 1}",
        }
        axes.plot(instants, values[:, joint], **look)
