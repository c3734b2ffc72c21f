"""A motion, joint by joint: position, velocity, acceleration, jerk, limits and waypoints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.views.figures.plots import Look, styled
from trajopt.views.figures.sampling import curve
from trajopt.views.figures.style import BLACK, BLUE, GREY, QUANTITIES, VERMILION, text

Array = NDArray[np.float64]

_LIMIT: Look = {"color": VERMILION, "ls": (0, (4, 2)), "lw": 0.8}
_MOTION: Look = {"color": BLUE, "lw": 1.1}
_REFERENCE: Look = {"color": GREY, "lw": 1.8}
_PASSING: Look = {"color": "0.6", "lw": 0.4}
_WAYPOINT: Look = {"marker": "o", "mfc": "white", "mec": BLACK, "mew": 0.8, "zorder": 3}

MARGINS_IN = {"left": 0.75, "right": 0.12, "top": 0.65, "bottom": 0.42}
MARGIN_SHARE = 0.08  # of the range of values, above and below it
CONSTANT_RTOL = 1e-9  # a smaller change of value is drawn as none
CONSTANT_MARGIN = 0.05  # rad, rad/s, …: shown around a value that does not change
LONG_LABEL = 10  # characters; a longer name of a joint is written smaller


@styled
def motion(
    problem: Problem,
    trajectory: Trajectory,
    reference: Trajectory | None = None,
    title: str = "",
    reference_name: str = "exact optimum",
    own_name: str = "planner",
) -> Figure:
    """Draw every joint against time, with its limits and waypoints.

    A row is a joint, a column a quantity: position, velocity, acceleration, and jerk if limited.

    Args:
        problem: has the limits and waypoints.
        trajectory: drawn in blue.
        reference: drawn behind it in grey.
        title: stands over the figure.
        reference_name: names the reference in the legend.
        own_name: names the trajectory in the legend.
    """
    quantities = QUANTITIES if problem.has("jerk") else QUANTITIES[:3]
    curves = {own_name: (trajectory, _MOTION)}
    if reference:
        curves = {reference_name: (reference, _REFERENCE)} | curves
    end = max(shown.duration for shown, _ in curves.values())
    figure, grid = _grid(problem.joints, len(quantities))
    for order, (quantity, column) in enumerate(zip(quantities, grid.T, strict=True)):
        limits = getattr(problem.limits, quantity)
        lines = [(*curve(shown, order), look) for shown, look in curves.values()]
        for joint, axes in enumerate(column):
            own = [(times, values[:, joint], look) for times, values, look in lines]
            _panel(axes, own, limits[joint], trajectory.waypoint_times[1:-1])
        column[0].set_title(f"{quantity} ({problem.shared_unit(order)})")
        column[-1].set(xlabel="time (s)", xlim=(0, end))
    for joint, axes in enumerate(grid[:, 0]):
        waypoints = problem.waypoints[:, joint]
        axes.plot(trajectory.waypoint_times, waypoints, ls="", clip_on=False, **_WAYPOINT)
        label = _label(problem, joint)
        axes.set_ylabel(text(label), fontsize=6 if len(label) > LONG_LABEL else 8)
    looks = {name: look for name, (_, look) in curves.items()}
    looks |= {"limit": _LIMIT, "waypoint": _PASSING | _WAYPOINT}
    keys = [Line2D([], [], label=name, **look) for name, look in looks.items()]
    left = MARGINS_IN["left"] / figure.get_figwidth()
    line = 0.2 / figure.get_figheight()
    figure.suptitle(text(title), x=left, y=1 - line / 4, ha="left", fontsize=9)
    place = (left, 1 - line)
    figure.legend(handles=keys, loc="upper left", bbox_to_anchor=place, ncols=4, borderpad=0.2)
    figure.align_ylabels(grid[:, 0])
    return figure


def _grid(joints: int, columns: int) -> tuple[Figure, Any]:
    """Return a figure and its panels `(joints, columns)`; a column shares its time axis."""
    row = max(0.95, 1.7 - 0.15 * joints)
    width = 2.35 * columns + 0.3
    height = joints * row + 1.05
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left=MARGINS_IN["left"] / width,
        right=1 - MARGINS_IN["right"] / width,
        top=1 - MARGINS_IN["top"] / height,
        bottom=MARGINS_IN["bottom"] / height,
        wspace=0.38,
        hspace=0.22,
    )
    return figure, figure.subplots(joints, columns, squeeze=False, sharex=True)


def _panel(
    axes: Axes,
    lines: Sequence[tuple[Array, Array, Look]],
    limits: Array,
    passing: Array,
) -> None:
    """Draw one quantity of one joint: its curves, its finite limits, and the waypoint times."""
    finite = limits[np.isfinite(limits)]
    values = np.concatenate([finite, *(own for _, own, _ in lines)])
    low, high = _view(values)
    axes.set_ylim(low, high)
    for limit, edge in zip(limits, (low, high), strict=True):
        if np.isfinite(limit):
            axes.axhspan(min(limit, edge), max(limit, edge), color="0.93", lw=0, zorder=0)
            axes.axhline(limit, **_LIMIT)
    axes.vlines(passing, low, high, colors=_PASSING["color"], lw=_PASSING["lw"])
    for times, own, look in lines:
        axes.plot(times, own, **look)
    axes.yaxis.set_major_locator(MaxNLocator(3))


def _view(values: Array) -> tuple[float, float]:
    """Return the ends of a value axis: all values, and a margin."""
    low = float(values.min())
    high = float(values.max())
    changes = high - low > CONSTANT_RTOL * max(1.0, abs(high))
    margin = MARGIN_SHARE * (high - low) if changes else CONSTANT_MARGIN
    return low - margin, high + margin


def _label(problem: Problem, joint: int) -> str:
    """Return the name of a joint, with its unit where the units of joints differ."""
    label = problem.joint_labels[joint]
    if len(set(problem.joint_units)) < 2:
        return label
    return f"{label} ({problem.unit(joint)})"
