"""The front of duration and smoothness, as wide as a column of a paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from trajopt.benchmark.front import Beside, Front
from trajopt.views.figures.plots import Picture, planner_look, planner_mark, styled, wrapped
from trajopt.views.figures.style import BLACK, GREY, plain, power_of_ten, text

_WIDTH_IN = 3.5
_PANEL_IN = 2.5
_LEGEND_LINE_IN = 0.15
_NEARER = 0.65  # share of an arrow at which its text stands, beyond the middle: off the curve
_TICKS = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8)  # durations that get a label, s, times powers of ten


@styled
def curve(front: Front, beside: Sequence[Beside] = ()) -> Figure:
    """Draw the least integral of each duration, the proved bound below it, and motions as points.

    A motion that jumps has an infinite integral; its marker is on the upper edge. Of the motion
    farthest above the least of its duration two arrows show how far, and the shortest duration with
    its integral.
    """
    lines = (len(beside) + 3) / 2 + 1
    size = (_WIDTH_IN, _PANEL_IN + _LEGEND_LINE_IN * lines)
    figure = Picture(figsize=size, layout="constrained")
    axes = figure.subplots()
    durations = [point.duration for point in front.points]
    values = [point.value for point in front.points]
    axes.plot(durations, values, color=BLACK, marker="o", label="least known", zorder=3)
    proved = [(p.duration, p.lower, p.value) for p in front.points if p.lower is not None]
    if proved:
        at, lower, upper = np.array(proved).T
        axes.fill_between(at, lower, upper, color=GREY, alpha=0.35, lw=0)
        axes.plot(at, lower, color=GREY, ls="--", lw=0.9, label="proved: none below")
    axes.set_xscale("log")
    axes.set_yscale("log")
    _motions(axes, beside)
    _two_savings(axes, beside)
    _ticks(axes)
    axes.set_xlabel("duration (s)")
    axes.set_ylabel(f"∫ {front.measure}² ({front.unit})")
    axes.set_title(text(front.problem.name), loc="left")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=2)
    return figure


def _motions(axes: Axes, beside: Sequence[Beside]) -> None:
    finite = [planner.value for planner in beside if np.isfinite(planner.value)]
    low, high = axes.get_ylim()
    if finite:
        high = max(high, 2 * max(finite))
        low = min(low, 0.5 * min(finite))
    jumps = any(not np.isfinite(planner.value) for planner in beside)
    edge = 4 * high if jumps else high
    axes.set_ylim(low, edge * (1.6 if jumps else 1.0))
    order = sorted(planner.label for planner in beside)
    for planner in beside:
        jumping = not np.isfinite(planner.value)
        axes.plot(
            [planner.duration],
            [edge if jumping else planner.value],
            color=planner_look(planner.label, order)["color"],
            marker=planner_mark(planner.label, order),
            markerfacecolor="white" if jumping else None,
            ls="",
            label=wrapped(planner.label) + (": jumps" if jumping else ""),
            zorder=4,
        )
    if jumps:
        axes.axhline(edge, color=GREY, lw=0.6, ls=":", zorder=1)
        axes.annotate("∞", (1.01, edge), xycoords=("axes fraction", "data"), va="center")


def _two_savings(axes: Axes, beside: Sequence[Beside]) -> None:
    """Draw what one motion could save: in smoothness at its duration, in time at its smoothness."""
    measured = [planner for planner in beside if planner.shortest and planner.times_the_least]
    if not measured:
        return
    planner = max(measured, key=lambda other: other.times_the_least or 0.0)
    times, shortest = planner.times_the_least or 1.0, planner.shortest or planner.duration
    ends = {(planner.duration, planner.value / times): f"{times:.3g} times the least"}
    ends[shortest, planner.value] = f"as smooth in {shortest:.3g} s"
    arrow = {"arrowstyle": "->", "color": GREY, "lw": 0.8, "shrinkA": 4, "shrinkB": 1}
    for end, said in ends.items():
        start = (planner.duration, planner.value)
        axes.annotate("", end, start, arrowprops=arrow, zorder=2)
        upright = end[0] == planner.duration
        axes.annotate(
            said,
            (
                start[0] ** _NEARER * end[0] ** (1 - _NEARER),
                start[1] ** _NEARER * end[1] ** (1 - _NEARER),
            ),
            (-4, 0) if upright else (0, 4),
            textcoords="offset points",
            ha="right" if upright else "center",
            va="center" if upright else "bottom",
            fontsize=7,
        )


def _ticks(axes: Axes) -> None:
    low, high = axes.get_xlim()
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.outer(decades, _TICKS).ravel()
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    axes.set_xticks(ticks[:: 1 + len(ticks) // 9])
    axes.xaxis.set_major_formatter(FuncFormatter(plain))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
