"""A motion, joint by joint: position, velocity, acceleration and jerk, with limits and waypoints.

Six joints have eighteen panels. As many of Matplotlib's axes take a second to make and to draw;
here what all panels have in common is one collection of lines, so that a figure takes a third of
that. Every place is in inches from the lower left corner.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.views.figures.plots import styled
from trajopt.views.figures.sampling import curve
from trajopt.views.figures.style import (
    BLACK,
    BLUE,
    GREY,
    QUANTITIES,
    VERMILION,
    plain,
    text,
)
from trajopt.views.figures.words import Lettering, Words, depth, height

Array = NDArray[np.float64]
Look = dict[str, Any]  # what Matplotlib calls the parts of an artist's look

_LIMIT: Look = {"color": VERMILION, "ls": (0, (4, 2)), "lw": 0.8}
_OWN: Look = {"color": BLUE, "lw": 1.1}
_BEHIND: Look = {"color": GREY, "lw": 1.8}
_PASSING: Look = {"color": "0.6", "lw": 0.4}
_FRAME: Look = {"color": BLACK, "lw": 0.6}
_DOT: Look = {"marker": "o", "mfc": "white", "mec": BLACK, "mew": 0.8}

# inches
_LEFT = 0.65
_RIGHT = 0.12
_TOP = 0.65
_BOTTOM = 0.4
_BETWEEN_COLUMNS = 0.38  # of a panel's width
_BETWEEN_ROWS = 0.22  # of a panel's height
_TICK = 3.5 / 72
_AFTER_TICK = 7.0 / 72
_NAME_LEFT = 0.48
_TITLE_RISE = 0.08
_TIME_DROP = 0.23
_TITLE_DROP = 0.17  # from the top to the title's baseline
_KEYS_DROP = 0.34  # to the baseline of what the lines mean
_KEY = 0.29
_AFTER_KEY = 0.08
_BETWEEN_KEYS = 0.2

# points
_LARGE = 9.0
_USUAL = 8.0
_SMALL = 7.0
_TINY = 6.0

_LONG_LABEL = 10  # characters of a joint's name
_MARGIN = 0.08  # of the values' range, above and below them
_ROUNDING = 1e-9  # relative: changes below it are not worth magnifying
_TIME_STEPS = (1, 2, 2.5, 5, 10)
_IN_VIEW_RTOL = 1e-9


@dataclass(frozen=True, eq=False)
class Panel:
    """One quantity of one joint, and where it is drawn.

    - `joint`, `order`: from 0; the order of the derivative;
    - `own`, `behind`: times (s) and values of the trajectory, and of the one behind it, if any;
    - `limits`: `(2,)`, low and high, which may be infinite;
    - `corner`, `size`: `(2,)`, inches; `end`, `low`, `high`: what they show, from 0 s.
    """

    joint: int
    order: int
    own: tuple[Array, Array]
    behind: tuple[Array, Array] | None
    limits: Array
    corner: Array
    size: Array
    end: float
    low: float
    high: float

    def x(self, times: Any) -> Any:
        """From seconds to inches."""
        left, _ = self.corner
        width, _ = self.size
        return left + times * (width / self.end)

    def y(self, values: Any) -> Any:
        """From rad, rad/s, … to inches."""
        _, bottom = self.corner
        _, height = self.size
        scale = height / (self.high - self.low)
        return bottom + (values - self.low) * scale

    def line(self, times: Array, values: Array) -> Array:
        """A curve in inches, `(n, 2)`."""
        return np.column_stack([self.x(times), self.y(values)])

    def across(self, value: float) -> Array:
        """A level line from side to side, in inches."""
        ends = np.array([0.0, self.end])
        return self.line(ends, np.full(2, value))

    def upright(self, time: float) -> Array:
        """A line from bottom to top, in inches."""
        ends = np.array([self.low, self.high])
        return self.line(np.full(2, time), ends)

    def beyond(self) -> list[Array]:
        """What lies outside each limit, a rectangle in inches each."""
        areas = []
        sides = zip(self.limits, (self.low, self.high), strict=True)
        for limit, edge in sides:
            if not np.isfinite(limit):
                continue
            near = self.across(limit)
            far = self.across(edge)
            areas.append(np.concatenate([near, far[::-1]]))
        return areas


@styled
def motion(
    problem: Problem,
    trajectory: Trajectory,
    reference: Trajectory | None = None,
    title: str = "",
    reference_name: str = "exact optimum",
    own_name: str = "planner",
) -> Figure:
    """Every joint against time, with its limits and waypoints.

    A row per joint, a column per quantity: position, velocity, acceleration, and jerk if limited.

    Args:
        problem: whose limits and waypoints are drawn.
        trajectory: in blue.
        reference: behind it in grey.
        title: over the figure.
        reference_name: what the legend calls the reference.
        own_name: what it calls the trajectory.
    """
    width, height = _size(problem)
    figure = Figure(figsize=(width, height))
    shown = panels(problem, trajectory, reference)
    _draw_lines(figure, shown, trajectory.waypoint_times)
    _draw_waypoints(figure, shown, problem, trajectory)
    numbers = _draw_ticks(figure, shown)
    names = _names(shown, problem)
    looks = {own_name: _OWN, "limit": _LIMIT, "waypoint": _PASSING | _DOT}
    if reference:
        looks[reference_name] = _BEHIND
    caption = _draw_caption(figure, title, looks)
    figure.add_artist(Lettering([*numbers, *names, *caption], figure.dpi_scale_trans))
    return figure


def panels(
    problem: Problem,
    trajectory: Trajectory,
    reference: Trajectory | None = None,
) -> list[Panel]:
    """What `motion` shows, row by row."""
    columns = _columns(problem)
    end = trajectory.duration
    if reference:
        end = max(end, reference.duration)
    every = []
    for order, quantity in enumerate(QUANTITIES[:columns]):
        limits = getattr(problem.limits, quantity)
        times, values = curve(trajectory, order)
        behind = curve(reference, order) if reference else None
        for joint, own_limits in enumerate(limits):
            own = (times, values[:, joint])
            finite = own_limits[np.isfinite(own_limits)]
            seen = [finite, own[1]]
            back = None
            if behind:
                back = (behind[0], behind[1][:, joint])
                seen.append(back[1])
            low, high = _view(seen)
            corner, size = _place(problem, joint, order)
            panel = Panel(
                joint=joint,
                order=order,
                own=own,
                behind=back,
                limits=own_limits,
                corner=corner,
                size=size,
                end=end,
                low=low,
                high=high,
            )
            every.append(panel)
    every.sort(key=lambda panel: (panel.joint, panel.order))
    return every


def _columns(problem: Problem) -> int:
    return 4 if problem.has("jerk") else 3


def _size(problem: Problem) -> tuple[float, float]:
    """The figure's width and height, inches."""
    joints = problem.joints
    row = max(0.95, 1.7 - 0.15 * joints)
    return 2.35 * _columns(problem) + 0.3, joints * row + 1.05


def _place(problem: Problem, joint: int, order: int) -> tuple[Array, Array]:
    """A panel's lower left corner and its size, inches."""
    width, height = _size(problem)
    columns = _columns(problem)
    rows = problem.joints
    # n panels and n − 1 gaps fill what the margins leave
    free_width = width - _LEFT - _RIGHT
    free_height = height - _TOP - _BOTTOM
    panel_width = free_width / (columns + _BETWEEN_COLUMNS * (columns - 1))
    panel_height = free_height / (rows + _BETWEEN_ROWS * (rows - 1))
    size = np.array([panel_width, panel_height])
    pitch = size * (1 + np.array([_BETWEEN_COLUMNS, _BETWEEN_ROWS]))
    below = rows - 1 - joint
    corner = np.array([_LEFT, _BOTTOM]) + pitch * (order, below)
    return corner, size


def _view(parts: Sequence[Array]) -> tuple[float, float]:
    """The values from which and to which a panel shows: all of them, and a margin."""
    values = np.concatenate(parts)
    low = float(values.min())
    high = float(values.max())
    moves = high - low > _ROUNDING * max(1.0, abs(high))
    margin = _MARGIN * (high - low) if moves else 0.05
    return low - margin, high + margin


def _draw_lines(figure: Figure, shown: Sequence[Panel], passing: Array) -> None:
    """What lies beyond the limits, waypoint times, limits, curves and frames, from the back."""
    beyond: list[Array] = []
    uprights: list[Array] = []
    limits: list[Array] = []
    behind: list[Array] = []
    own: list[Array] = []
    frames: list[Array] = []
    for panel in shown:
        beyond += panel.beyond()
        uprights += [panel.upright(time) for time in passing]
        finite = panel.limits[np.isfinite(panel.limits)]
        limits += [panel.across(limit) for limit in finite]
        own.append(panel.line(*panel.own))
        if panel.behind is not None:
            behind.append(panel.line(*panel.behind))
        frames += [panel.upright(0.0), panel.across(panel.low)]
    inches = figure.dpi_scale_trans
    areas = PolyCollection(
        beyond,
        transform=inches,
        color="0.93",
        lw=0,
        zorder=0,
    )
    figure.add_artist(areas)
    layers: list[tuple[str, list[Array], Look]] = [
        ("waypoint times", uprights, _PASSING),
        ("limits", limits, _LIMIT),
        ("reference", behind, _BEHIND),
        ("motion", own, _OWN),
        ("frames", frames, _FRAME),
    ]
    for layer, (name, lines, look) in enumerate(layers, start=1):
        ends = "projecting" if name in ("reference", "motion", "frames") else "butt"
        artist = LineCollection(
            lines,
            transform=inches,
            zorder=layer,
            capstyle=ends,
            joinstyle="round",
            **look,
        )
        artist.set_gid(name)
        figure.add_artist(artist)


def _draw_waypoints(
    figure: Figure,
    shown: Sequence[Panel],
    problem: Problem,
    trajectory: Trajectory,
) -> None:
    """A dot at each, in the panels of positions."""
    dots = []
    for panel in shown:
        if panel.order == 0:
            coordinates = problem.waypoints[:, panel.joint]
            dots.append(panel.line(trajectory.waypoint_times, coordinates))
    x, y = np.concatenate(dots).T
    marks = Line2D(
        x,
        y,
        ls="",
        zorder=9,
        transform=figure.dpi_scale_trans,
        **_DOT,
    )
    marks.set_gid("waypoints")
    figure.add_artist(marks)


def _draw_ticks(figure: Figure, shown: Sequence[Panel]) -> list[Words]:
    """Ticks, and their numbers: time under the last row, values beside every panel."""
    last = shown[-1].joint
    intervals = 3 if last > 0 else 6
    of_values = MaxNLocator(intervals)
    of_times = MaxNLocator(6, steps=_TIME_STEPS)
    digits = height("0") * _SMALL / 72
    ticks = []
    numbers = []
    for panel in shown:
        left, bottom = panel.corner
        for value in _in_view(of_values, panel.low, panel.high):
            y = panel.y(value)
            ticks.append([(left - _TICK, y), (left, y)])
            number = Words(
                left - _AFTER_TICK,
                y - digits / 2,
                plain(value),
                _SMALL,
                "right",
            )
            numbers.append(number)
        if panel.joint < last:
            continue
        for time in _in_view(of_times, 0.0, panel.end):
            x = panel.x(time)
            ticks.append([(x, bottom - _TICK), (x, bottom)])
            number = Words(
                x,
                bottom - _AFTER_TICK - digits,
                plain(time),
                _SMALL,
                "center",
            )
            numbers.append(number)
    artist = LineCollection(ticks, transform=figure.dpi_scale_trans, **_FRAME)
    artist.set_gid("ticks")
    figure.add_artist(artist)
    return numbers


def _in_view(locator: MaxNLocator, low: float, high: float) -> Array:
    """The places of ticks between two values."""
    places = np.asarray(locator.tick_values(low, high), dtype=float)
    slack = _IN_VIEW_RTOL * (high - low)
    above = places >= low - slack
    below = places <= high + slack
    # 0, not what steps of 0.1 leave of it
    places[np.abs(places) < slack] = 0.0
    return places[above & below]


def _names(shown: Sequence[Panel], problem: Problem) -> list[Words]:
    """Quantities with units over the columns, joints beside the rows, time under the last row."""
    names = []
    for panel in shown:
        left, bottom = panel.corner
        width, panel_height = panel.size
        quantity = QUANTITIES[panel.order]
        unit = problem.shared_unit(panel.order)
        middle = left + width / 2
        if panel.joint == 0:
            over = bottom + panel_height + _TITLE_RISE
            names.append(Words(middle, over, f"{quantity} ({unit})", _USUAL, "center"))
        if panel.joint == problem.joints - 1:
            under = bottom - _TIME_DROP - height("l") * _USUAL / 72
            names.append(Words(middle, under, "time (s)", _USUAL, "center"))
        if panel.order == 0:
            beside = bottom + panel_height / 2
            names.append(_joint_name(_label(problem, panel.joint), beside))
    return names


def _label(problem: Problem, joint: int) -> str:
    """A joint's name, with its unit where joints differ in it."""
    label = problem.joint_labels[joint]
    if len(set(problem.joint_units)) < 2:
        return label
    return f"{label} ({problem.unit(joint)})"


def _joint_name(label: str, middle: float) -> Words:
    """A joint's name, upwards, left of its row."""
    name = text(label)
    size = _USUAL if len(name) <= _LONG_LABEL else _TINY
    baseline = _LEFT - _NAME_LEFT - depth("p") * size / 72
    return Words(
        baseline,
        middle,
        name,
        size,
        "center",
        upwards=True,
    )


def _draw_caption(figure: Figure, title: str, looks: Mapping[str, Look]) -> list[Words]:
    """What the lines mean, as lines; the title over them, and their names."""
    top = figure.get_figheight()
    baseline = top - _TITLE_DROP
    words = [Words(_LEFT, baseline, text(title), _LARGE, "left")]
    baseline = top - _KEYS_DROP
    middle = baseline + height("x") * _SMALL / 72 / 2
    x = _LEFT
    for label, look in looks.items():
        ends = x + _KEY * np.array([0.0, 0.5, 1.0])
        key = Line2D(
            ends,
            np.full(3, middle),
            markevery=[1],
            transform=figure.dpi_scale_trans,
            **look,
        )
        figure.add_artist(key)
        name = Words(x + _KEY + _AFTER_KEY, baseline, label, _SMALL, "left")
        words.append(name)
        x = name.x + name.width + _BETWEEN_KEYS
    return words
