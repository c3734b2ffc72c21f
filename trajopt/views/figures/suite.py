"""Figures of many problems, as wide as a column of a paper: a curve per planner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from trajopt.views.analysis.curves import GAP_FLOOR, Curves
from trajopt.views.figures.plots import (
    Picture,
    band,
    log_percent,
    planner_look,
    planner_mark,
    styled,
    wrapped,
)
from trajopt.views.figures.sampling import bounded
from trajopt.views.figures.style import plain, power_of_ten

Counts = Mapping[str, str]

WIDTH_IN = 3.5
PANEL_IN = 2.2
LEGEND_LINE_IN = 0.14
LEGEND_COLUMNS = 2
NO_COUNTS: Counts = MappingProxyType({})
_FACTORS = (1, 1.2, 1.5, 2, 3, 5, 7)  # ticks of a decade of performance ratios


@styled
def profile(curves: Curves, order: Sequence[str], counts: Counts = NO_COUNTS) -> Figure:
    """Performance profiles: shares of problems solved within a factor of the shortest duration.

    Args:
        curves: Of each planner.
        order: All planners of the suite, which have their colours in this order.
        counts: What to say of planners whose shares are of fewer problems, such as "38 of 46".
    """
    figure, axes = _column(list(curves))
    _staircases(axes, curves, order, counts)
    axes.set_xscale("log")
    axes.set_xlim(1, max(x[-1] for x, _ in curves.values()))
    axes.xaxis.set_major_locator(LogLocator(subs=_FACTORS))
    axes.xaxis.set_major_formatter(FuncFormatter(plain))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("certified duration / shortest of all planners")
    _legend(figure)
    return figure


@styled
def gaps(curves: Curves, order: Sequence[str], counts: Counts = NO_COUNTS) -> Figure:
    """Shares of problems within a gap to the optimum, %; arguments as of `profile`."""
    figure, axes = _column(list(curves))
    _staircases(axes, curves, order, counts)
    log_percent(axes.xaxis)
    axes.set_xlabel("gap to the optimum (%)")
    _legend(figure)
    return figure


@styled
def anytime(curves: Curves, order: Sequence[str], cost: str) -> Figure:
    """Median gap over all runs, and its quartiles, against what was spent.

    Args:
        curves: Of each planner what was spent, and quartiles of the gap, %; a planner that answers
            once is a point.
        order: All planners of the suite, which have their colours in this order.
        cost: What was spent, such as seconds.
    """
    figure, axes = _column(list(curves))
    shade = min(0.18, 0.9 / len(curves))
    for label, (spent, quartiles) in bounded(curves).items():
        drawn = np.maximum(quartiles, GAP_FLOOR)
        look = planner_look(label, order)
        if len(spent) > 1:
            band(axes, spent, drawn, shade, look)
            continue
        low, middle, high = drawn
        axes.vlines(spent, low, high, color=look["color"], lw=0.8)
        axes.plot(spent, middle, **look | {"ls": "", "marker": planner_mark(label, order)})
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(power_of_ten))
    log_percent(axes.yaxis)
    axes.set_xlabel(f"{cost} spent")
    axes.set_ylabel("gap to the optimum (%)")
    _legend(figure)
    return figure


def _staircases(axes: Axes, curves: Curves, order: Sequence[str], counts: Counts) -> None:
    for label, (x, y) in curves.items():
        look = planner_look(label, order)
        if label in counts:
            look["label"] += f" ({counts[label]})"
        axes.plot(x, y, drawstyle="steps-post", **look)
    axes.set_ylim(0, 1.02)
    axes.yaxis.set_major_formatter(PercentFormatter(1, symbol=" %"))
    axes.set_ylabel("problems")


def _legend(figure: Figure) -> None:
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=LEGEND_COLUMNS)


def _column(labels: Sequence[str]) -> tuple[Figure, Axes]:
    """A figure as wide as a column, with room for a legend below."""
    breaks = [wrapped(label).count("\n") + 1 for label in labels]
    lines = sum(breaks) / LEGEND_COLUMNS + 1
    height = PANEL_IN + LEGEND_LINE_IN * lines
    figure = Picture(figsize=(WIDTH_IN, height), layout="constrained")
    return figure, figure.subplots()
