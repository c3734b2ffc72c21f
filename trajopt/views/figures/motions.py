"""A motion, joint by joint: position, velocity, acceleration, jerk, limits and waypoints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.views.figures.plots import Look, Picture, styled
from trajopt.views.figures.sampling import curve
from trajopt.views.figures.style import BLACK, BLUE, QUANTITIES, headline, text

_LIMIT: Look = {"color": "0.35", "ls": (0, (4, 2)), "lw": 0.8}
_MOTION: Look = {"lw": 1.8}
_REFERENCE: Look = {"color": BLUE, "lw": 0.9, "zorder": 2.5}  # on top of the motion
_PASSING: Look = {"color": "0.6", "lw": 0.4}
_WAYPOINT: Look = {"marker": "o", "mfc": "white", "mec": BLACK, "mew": 0.8, "zorder": 3}

LEFT_IN = 0.75  # inches left of the panels
RIGHT_IN = 0.12
TOP_IN = 0.65
BOTTOM_IN = 0.42
BELOW_IN = 0.55  # of a time axis, above a wide panel
BEYOND = (-1e6, 1e6)  # rad, rad/s, …: the shade beyond a limit ends outside the panel
MARGIN_SHARE = 0.08  # above and below the values, relative to their range
CONSTANT_RTOL = 1e-9  # a smaller change of value is drawn as none
CONSTANT_MARGIN = 0.05  # rad, rad/s, …: shown around a value that does not change
EDGE_SAMPLES = 400  # of a limit that changes along the motion
LONG_LABEL = 10  # characters; a longer name of a joint is written smaller


@styled
def motion(
    problem: Problem,
    trajectory: Trajectory,
    reference: Trajectory | None = None,
    title: str = "",
    reference_name: str = "exact optimum",
    own_name: str = "planner",
    colour: str = BLUE,
) -> Figure:
    """Draw every joint against time, with its limits and waypoints.

    A row is a joint that moves, a column a quantity: position, velocity, acceleration, and jerk if
    limited. The joints that rest are named in the title. Below them, each limit that is no joint's
    has a panel with its use over time.

    Args:
        problem: has the limits and waypoints.
        trajectory: drawn in `colour`, which is its planner's.
        reference: drawn on top of it, thin, in the colour of references.
        title: stands over the figure.
        reference_name: names the reference in the legend.
        own_name: names the trajectory in the legend.
        colour: of the trajectory.
    """
    joints = _moving(problem, trajectory)
    quantities = QUANTITIES if problem.has("jerk") else QUANTITIES[:3]
    passing = trajectory.waypoint_times
    together = _together(problem, trajectory)
    figure, grid, wide = _grid(len(joints), len(quantities), len(together))
    looks = {own_name: _MOTION | {"color": colour}}
    end = trajectory.duration
    if reference:
        looks |= {reference_name: _REFERENCE}
        end = max(end, reference.duration)
    drawn = [trajectory] if reference is None else [trajectory, reference]
    edges: dict[tuple[int, int], Array] = {}
    times_of_edges = np.linspace(0.0, trajectory.duration, EDGE_SAMPLES)
    for own in problem.limits.kinds.values():
        edges |= own.edges(trajectory, times_of_edges)
    for order, quantity in enumerate(quantities):
        limits = getattr(problem.limits, quantity)
        lines = [curve(own, order) for own in drawn]
        column = grid[:, order]
        for joint, axes in zip(joints, column, strict=True):
            _limits(axes, limits[..., joint, :], passing)
            low, high = _along(limits[..., joint, :], passing, times_of_edges)
            for edge in edges.get((order, joint), ()):
                within = np.clip(edge, low, high)
                axes.plot(times_of_edges, within, **_LIMIT)
            for (times, values), look in zip(lines, looks.values(), strict=True):
                axes.plot(times, values[:, joint], **look)
            if order == 0:
                waypoints = problem.waypoints[:, joint]
                axes.plot(passing, waypoints, ls="", clip_on=False, **_WAYPOINT)
            _fit(axes)
            for time in passing[1:-1]:
                axes.axvline(time, **_PASSING)
        unit = problem.shared_unit(order)
        column[0].set_title(f"{quantity} ({unit})")
        column[-1].set_xlabel("time (s)")
        column[-1].set_xlim(0, end)
    for key, axes in zip(together, wide, strict=True):
        limit = problem.limits.kinds[key]
        for shown, look in zip(drawn, looks.values(), strict=True):
            times, _ = curve(shown, 0)
            axes.plot(times, limit.along(shown, times)[None], **look)
        _limits(axes, np.array([-np.inf, 1.0]), passing)
        _fit(axes)
        axes.set_ylabel(text(f"{limit.name()} (use)"), fontsize=8)
        axes.set_xlabel("time (s)")
        axes.set_xlim(0, end)
        for time in passing[1:-1]:
            axes.axvline(time, **_PASSING)
    for joint, axes in zip(joints, grid[:, 0], strict=True):
        label = _label(problem, joint)
        axes.set_ylabel(text(label), fontsize=6 if len(label) > LONG_LABEL else 8)
    figure.align_ylabels(grid[:, 0])
    looks["limit"] = _LIMIT
    looks["waypoint"] = _PASSING | _WAYPOINT
    resting = [problem.joint_labels[own] for own in range(problem.joints) if own not in joints]
    rests = f"; at rest: {', '.join(resting)}" if resting else ""
    _caption(figure, headline(title, rests), looks)
    return figure


def _moving(problem: Problem, trajectory: Trajectory) -> list[int]:
    """Return the joints that move, or that should; all of them where none does."""
    values = trajectory.pieces(1)
    moves = (np.abs(values).max(axis=(0, 1)) > 0) | (np.ptp(problem.waypoints, axis=0) > 0)
    return [int(joint) for joint in np.flatnonzero(moves)] or list(range(problem.joints))


def _along(limits: Array, passing: Array, times: Array) -> Array:
    """Return the limits at some times, `(2, times)`; of segments, from waypoint to waypoint."""
    if limits.ndim == 1:
        return np.repeat(limits[:, None], len(times), axis=1)
    segments = np.searchsorted(passing, times, side="right") - 1
    return limits[np.clip(segments, 0, len(limits) - 1)].T


def _caption(figure: Figure, title: str, looks: Mapping[str, Look]) -> None:
    """Write the title in the first line, and what the lines mean in the second."""
    keys = [Line2D([], [], label=name, **look) for name, look in looks.items()]
    left = LEFT_IN / figure.get_figwidth()
    line = 0.2 / figure.get_figheight()
    figure.suptitle(text(title), x=left, y=1 - line / 4, ha="left", fontsize=9)
    figure.legend(
        handles=keys,
        loc="upper left",
        bbox_to_anchor=(left, 1 - line),
        ncols=len(keys),
        borderpad=0.2,
    )


def _together(problem: Problem, trajectory: Trajectory) -> list[str]:
    """Return the kinds of limits that are no joint's, by their keys."""
    start = trajectory.breaks[:1]
    kinds = problem.limits.kinds.items()
    return [key for key, own in kinds if not own.separate and None in own.along(trajectory, start)]


def _grid(joints: int, columns: int, together: int) -> tuple[Figure, Any, list[Axes]]:
    """Return a figure, its panels `(joints, columns)`, and wide ones below them.

    A column shares its time axis. The wide ones are of limits that are no joint's.
    """
    row = max(0.95, 1.7 - 0.15 * joints)
    width = 2.35 * columns + 0.3
    below = together * (row + BELOW_IN)
    height = joints * row + 1.05 + below
    figure = Picture(figsize=(width, height))
    figure.subplots_adjust(
        left=LEFT_IN / width,
        right=1 - RIGHT_IN / width,
        top=1 - TOP_IN / height,
        bottom=(BOTTOM_IN + below) / height,
        wspace=0.38,
        hspace=0.22,
    )
    grid = figure.subplots(joints, columns, squeeze=False, sharex=True)
    wide = []
    for place in reversed(range(together)):
        bottom = BOTTOM_IN + place * (row + BELOW_IN)
        size = ((width - LEFT_IN - RIGHT_IN) / width, row / height)
        wide.append(figure.add_axes((LEFT_IN / width, bottom / height, *size)))
    return figure, grid, wide


def _limits(axes: Axes, limits: Array, passing: Array) -> None:
    """Draw the finite ones of the limits, and shade what lies beyond them.

    Limits are `(2,)`, or `(segments, 2)` from waypoint to waypoint.
    """
    for limit, beyond in zip(limits.T, BEYOND, strict=True):
        if limit.ndim:
            edge = np.where(np.isfinite(limit), limit, np.nan)
            edge = np.append(edge, edge[-1])
            axes.plot(passing, edge, drawstyle="steps-post", **_LIMIT)
            shade: Look = {"step": "post", "color": "0.93", "lw": 0, "zorder": 0}
            axes.fill_between(passing, edge, edge + beyond, **shade)
        elif np.isfinite(limit):
            axes.axhline(limit, **_LIMIT)
            axes.axhspan(limit, limit + beyond, color="0.93", lw=0, zorder=0)


def _fit(axes: Axes) -> None:
    """Let the value axis show every line, with a margin, and nothing beyond."""
    values = np.concatenate([line.get_ydata() for line in axes.lines])
    low = float(np.nanmin(values))
    high = float(np.nanmax(values))
    changes = high - low > CONSTANT_RTOL * max(1.0, abs(high))
    margin = CONSTANT_MARGIN
    if changes:
        margin = MARGIN_SHARE * (high - low)
    axes.set_ylim(low - margin, high + margin)
    axes.yaxis.set_major_locator(MaxNLocator(3))


def _label(problem: Problem, joint: int) -> str:
    """Return the name of a joint, with its unit where the units of joints differ."""
    label = problem.joint_labels[joint]
    if len(set(problem.joint_units)) < 2:
        return label
    return f"{label} ({problem.unit(joint)})"
