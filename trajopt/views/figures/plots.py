"""Figures: tables, arrays and trajectories in, matplotlib figures out.

No global state and no display: every function returns a `Figure`, and `save` writes it. Names that
others chose (problems, planners and their options) are drawn as they are written.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO, StringIO
from itertools import cycle
from math import inf, isnan
from pathlib import Path
from textwrap import wrap
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from trajopt.core.arrays import Array
from trajopt.core.numerals import rounded_down
from trajopt.views import table_cells
from trajopt.views.analysis.curves import GAP_FLOOR
from trajopt.views.analysis.results import Line
from trajopt.views.figures.sampling import bounded
from trajopt.views.figures.style import (
    BLACK,
    BLUE,
    CURVES,
    DASHES,
    MARKERS,
    STYLE_SHEET,
    places,
    plain,
    power_of_ten,
    text,
)

Look = dict[str, Any]  # keywords of Matplotlib's artists

_SHORT_DASHES = (0, (3, 2))
_BOX: Look = {"fc": "0.88", "ec": BLACK, "lw": 0.7}
_RUN: Look = {"marker": "o", "ls": "", "ms": 2.8, "mew": 0, "alpha": 0.6}

PNG_DPI = 150
SCREEN_DPI = 100
_COLUMNS = (46, 96)  # points right of a chart: where its columns of numbers end
_GOLDEN = 0.618034  # multiples of it, modulo 1, spread evenly
_LABEL_WIDTH = 30  # characters of a planner's label on one line
_SUBDIVISIONS = (1, 1.5, 2, 3, 4, 5, 6, 8)  # ticks of a decade of durations


@contextmanager
def _style() -> Iterator[None]:
    """Draw in the style of `STYLE_SHEET`, but for what the reader's own style has changed."""
    usual = matplotlib.rcParamsDefault
    ours = {key: own for key, own in STYLE_SHEET.items() if matplotlib.rcParams[key] == usual[key]}
    with matplotlib.rc_context(ours):
        yield


styled = _style()  # the reader's settings stay as they are


class Picture(Figure):
    """A figure that a notebook shows once, where it is a cell's value, without a magic command."""

    @styled
    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return it at twice the screen's resolution, and the size in which it is shown, pixels."""
        content = BytesIO()
        self.savefig(content, format="png", dpi=2 * SCREEN_DPI)
        width, height = SCREEN_DPI * self.get_size_inches()
        return content.getvalue(), {"width": round(width), "height": round(height)}


@styled
def write(figure: Figure, file: Path) -> Path:
    """Write a figure as its suffix says (`.png`, `.svg`, `.pdf`), and return the file.

    Vector files keep text as text, and the same figure gives the same bytes.
    """
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    file.parent.mkdir(parents=True, exist_ok=True)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        figure.savefig(file, dpi=PNG_DPI, metadata=undated.get(file.suffix))
    return file


@styled
def save_svg(figure: Figure, file: StringIO) -> None:
    """Write a figure as SVG into a text."""
    figure.savefig(file, format="svg", metadata={"Date": None})


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write `stem.png` and `stem.svg`, and return both."""
    return [write(figure, stem.with_name(f"{stem.name}.{kind}")) for kind in ("png", "svg")]


# ---- durations ------------------------------------------------------------------------------


@styled
def durations(summary: Sequence[Line], title: str = "") -> Figure:
    """Certified durations of one problem's planners, the shortest first, and their gaps.

    Args:
        summary: one problem's `Results.lines()`. A planner with several runs shows its median,
            quartiles (thick) and range (thin); one without a certified duration, its status.
        title: over the figure.
    """
    rows = sorted(summary, key=lambda row: inf if isnan(row.median) else row.median)
    certified = [row for row in rows if not isnan(row.median)]
    others = rows[len(certified) :]
    reference = _reference(rows)
    labels = [_row_label(row) for row in rows]
    figure, (axes,) = _row_chart(labels, panels=1)
    _dots(axes, certified)
    if reference:
        name, time = reference
        end = len(certified) - 0.5
        axes.vlines(time, -0.5, end, BLUE, "--", label=name, lw=1.0, zorder=1.5)
    _columns(axes, certified, gaps=reference is not None)
    _statuses(axes, others, first=len(certified))
    axes.set_xlabel("certified duration (s)")
    axes.set_title(text(title))
    axes.set_xlim(left=0)
    if certified:
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def _reference(rows: Sequence[Line]) -> tuple[str, float] | None:
    """Return the name of the gaps' reference, and its duration, s."""
    first = rows[0]
    if first.kind is None:
        return None
    name = f"{first.kind} optimum"
    if first.kind == "lower bound":
        name = first.kind
    return f"{name} {first.reference:#.4g} s", first.reference


def _row_label(row: Line) -> str:
    label = wrapped(row.label)
    if 0 < row.solved < row.runs:
        return f"{label}\n({row.solved} of {row.runs} runs solved)"
    return label


_SPREAD = "median, quartiles and range of several runs"
_SLOWED = "slowed down to keep the limits"


def _dots(axes: Axes, rows: Sequence[Line]) -> None:
    """Stems and medians; of several runs also quartiles and range."""
    medians = [row.median for row in rows]
    axes.hlines(range(len(rows)), 0, medians, color="0.85", lw=1.0, zorder=1)
    order = sorted(row.label for row in rows)
    for y, row in enumerate(rows):
        colour = planner_look(row.label, order)["color"]
        several = row.runs > 1
        if several:
            axes.hlines(y, row.min, row.max, color=colour, lw=0.9, zorder=2)
            axes.hlines(y, row.q1, row.q3, color=colour, lw=3.5, zorder=2)
        axes.plot(row.median, y, planner_mark(row.label, order), **_dot(colour, _is_slowed(row)))
    if any(row.runs > 1 for row in rows):
        axes.plot([], [], "o", label=_SPREAD, **_dot(BLACK, False))
    if any(map(_is_slowed, rows)):
        axes.plot([], [], "o", label=_SLOWED, **_dot(BLACK, True))


def _is_slowed(row: Line) -> bool:
    """Return whether some run breaks a limit as claimed, by more than rounding."""
    return bool(row.dilation >= 1 + table_cells.ROUNDING)


def _dot(colour: str, slowed: bool) -> Look:
    """Return the look of a median: hollow where the motion is slowed down to keep the limits."""
    return {"ms": 4.5, "mec": colour, "mfc": "white" if slowed else colour}


def _columns(axes: Axes, rows: Sequence[Line], *, gaps: bool) -> None:
    """Median and gap as numbers, beside the chart."""
    medians = [f"{row.median:#.4g}" for row in rows]
    columns = {"median (s)": medians}
    if gaps:
        columns["gap"] = [table_cells.percent(row.gap) for row in rows]
    style: Look = {"textcoords": "offset points", "ha": "right", "fontsize": 7}
    over: Look = {"xycoords": "axes fraction", "color": "0.3"}
    beside: Look = {"xycoords": axes.get_yaxis_transform(), "va": "center"}
    for (heading, numbers), right in zip(columns.items(), _COLUMNS, strict=False):
        axes.annotate(heading, (1, 1), (right, 6), **over, **style)
        for y, number in enumerate(numbers):
            axes.annotate(number, (1, y), (right, 0), **beside, **style)


def _statuses(axes: Axes, rows: Sequence[Line], first: int) -> None:
    """Write the status and lower bound of rows without a duration, from the row `first` on."""
    style: Look = {
        "textcoords": "offset points",
        "va": "center",
        "fontsize": 7,
        "style": "italic",
        "color": "0.3",
    }
    for y, row in enumerate(rows, start=first):
        said = row.status
        if row.lower_bound > 0:
            said = f"{said} (lower bound {rounded_down(row.lower_bound, '#.4g')} s)"
        axes.annotate(said, (0, y), (4, 0), **style)


# ---- convergence ----------------------------------------------------------------------------


@styled
def convergence(
    curves: Mapping[str, tuple[Array, Array]],
    best: float | None = None,
    title: str = "",
    order: Sequence[str] = (),
) -> Figure:
    """Best certified duration against evaluations: median and quartiles over seeds.

    Args:
        curves: per label evaluations and quartiles of the best durations by then, as of
            `sampling.over_runs`.
        best: the duration of the best 3-5-3, s; a second panel then shows how far above it the
            runs are, in %.
        title: over the figure.
        order: all planners, which have their colours in this order.
    """
    breaks = sum(wrapped(label).count("\n") for label in curves)
    legend = 0.5 + 0.17 * len(curves) + 0.11 * breaks  # inches
    panels = 2 if best else 1
    height = max(2.2 * panels, 2.8, legend)
    figure = Picture(figsize=(7.2, height), layout="constrained")
    grid = figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0]
    above = grid[0]
    shade = min(0.18, 0.9 / len(curves))  # many bands would hide the curves
    known = order or sorted(curves)
    for label, (spent, quartiles) in bounded(curves).items():
        look = planner_look(label, known) | {"marker": planner_mark(label, known)}
        band(above, spent, quartiles, shade, look)
        if best:
            excess = 100 * (quartiles / best - 1)
            drawn = np.maximum(excess, GAP_FLOOR)
            band(grid[1], spent, drawn, shade, look)
    above.set(xscale="log", yscale="log")
    above.set_ylabel("best certified duration (s)")
    above.set_title(text(title))
    longest = max(spent[-1] for spent, _ in curves.values())
    above.set_xlim(1, 1.1 * longest)
    above.xaxis.set_major_formatter(FuncFormatter(power_of_ten))
    above.yaxis.set_major_locator(LogLocator(subs=_SUBDIVISIONS))
    above.yaxis.set_major_formatter(FuncFormatter(plain))
    above.yaxis.set_minor_formatter(NullFormatter())
    if best:
        name = f"best 3-5-3 {best:#.4g} s"
        above.axhline(best, color=BLACK, lw=0.8, ls=_SHORT_DASHES, label=name)
        log_percent(grid[1].yaxis)
        grid[1].set_ylabel("above the best 3-5-3 (%)")
    grid[-1].set_xlabel("evaluations")
    keys = above.get_legend_handles_labels()
    figure.legend(*keys, loc="outside right upper", title="median and quartiles")
    return figure


def planner_look(label: str, order: Sequence[str] = ()) -> Look:
    """Colour and dashes of a planner, the same in every figure.

    Args:
        label: The planner, with its options.
        order: All planners of the comparison, which tells planners that are not of this toolkit.
    """
    place = places([*order, label])[label]
    return {
        "label": wrapped(label),
        "color": CURVES[place % len(CURVES)],
        "ls": DASHES[place % len(DASHES)],
    }


def planner_mark(label: str, order: Sequence[str] = ()) -> str:
    """Mark of a planner, the same in every figure; arguments as of `planner_look`."""
    return MARKERS[places([*order, label])[label] % len(MARKERS)]


def band(axes: Axes, spent: Array, quartiles: Array, shade: float, look: Look) -> None:
    """Draw a median as steps, in a band between its quartiles."""
    first, median, third = quartiles
    axes.fill_between(spent, first, third, step="post", color=look["color"], alpha=shade, lw=0)
    axes.plot(spent, median, drawstyle="steps-post", markevery=0.13, mfc="white", **look)


# ---- gaps -----------------------------------------------------------------------------------


@styled
def gap_distribution(gaps: Mapping[str, Array], title: str = "") -> Figure:
    """The gap (%) of every run, a row per planner with several, the smallest median first.

    On the right, what is above the best of these runs. Planners that ran once are lines, where they
    are in view.

    Args:
        gaps: every planner's on one problem, ratios minus 1; NaN where a run has none.
        title: over the figure.
    """
    groups = {label: 100 * own[~np.isnan(own)] for label, own in sorted(gaps.items())}
    several = [label for label, runs in groups.items() if len(runs) > 1]
    labels = sorted(several, key=lambda label: float(np.median(groups[label])))
    values = [groups[label] for label in labels]
    best = min(runs.min() for runs in values)
    figure, (left, right) = _row_chart([wrapped(label) for label in labels], panels=2)
    colours = [planner_look(label, sorted(gaps))["color"] for label in labels]
    _strips(left, values, colours)
    _strips(right, [np.maximum(runs - best, GAP_FLOOR) for runs in values], colours)
    run = Line2D([], [], label="one run", color=BLACK, **_RUN)
    box = Patch(label="quartiles and range", **_BOX)
    lines = _once(left, groups)
    left.set_xlabel("gap (%)")
    left.set_title(text(title))
    log_percent(right.xaxis)
    right.set_xlabel("above the best run (percentage points)")
    figure.legend(handles=[run, box, *lines], loc="outside lower center", ncols=4)
    return figure


def _once(axes: Axes, groups: Mapping[str, Array]) -> list[Line2D]:
    """A line at the gap of each planner that ran once, where it is in view."""
    low, high = axes.get_xlim()
    dashes = cycle(DASHES[1:])
    lines = []
    for label, runs in groups.items():
        if len(runs) == 1 and low <= runs[0] <= high:
            colour = planner_look(label, sorted(groups))["color"]
            look: Look = {"color": colour, "lw": 0.9, "zorder": 0.5}
            lines.append(axes.axvline(runs[0], ls=next(dashes), label=wrapped(label), **look))
    return lines


def _strips(axes: Axes, values: Sequence[Array], colours: Sequence[str]) -> None:
    """A dot per run over a box of quartiles; the dots' heights only keep them apart."""
    ink: Look = {"color": BLACK, "lw": 0.7}
    axes.boxplot(
        values,
        positions=range(len(values)),
        orientation="horizontal",
        whis=(0, 100),
        widths=0.62,
        patch_artist=True,
        manage_ticks=False,
        showfliers=False,
        boxprops=_BOX,
        medianprops=ink | {"lw": 1.4},
        whiskerprops=ink,
        capprops=ink,
    )
    for y, (runs, colour) in enumerate(zip(values, colours, strict=True)):
        height = np.arange(len(runs)) * _GOLDEN % 1 - 0.5
        axes.plot(np.sort(runs), y + 0.45 * height, zorder=3, color=colour, **_RUN)


# ---- shared by several ----------------------------------------------------------------------


def _row_chart(labels: Sequence[str], panels: int) -> tuple[Figure, Sequence[Axes]]:
    """A figure with one labelled row per planner, the first on top."""
    breaks = [label.count("\n") for label in labels]
    row = 0.2 + 0.1 * max(breaks)
    height = 1.15 + row * len(labels)
    figure = Picture(figsize=(7.2, height), layout="constrained")
    grid: Sequence[Axes] = figure.subplots(1, panels, sharey=True, squeeze=False)[0]
    grid[0].set_yticks(range(len(labels)), labels)
    grid[0].set_ylim(len(labels) - 0.4, -0.6)
    for axes in grid:
        axes.tick_params(axis="y", length=0)
    return figure, grid


def log_percent(axis: XAxis | YAxis) -> None:
    """A log axis from `GAP_FLOOR` up, its end labelled as what is there: that or less."""
    low, high = np.maximum(axis.get_data_interval(), (0, 100 * GAP_FLOOR))
    limits = (0.8 * min(low, high / 100), 1.5 * high)
    if axis.axis_name == "x":
        axis.axes.set(xscale="log", xlim=limits)
    else:
        axis.axes.set(yscale="log", ylim=limits)
    axis.set_major_locator(LogLocator(numticks=8))
    axis.set_major_formatter(FuncFormatter(_floored))


def _floored(value: float, _: object = None) -> str:
    if value < 1.1 * GAP_FLOOR:
        return f"≤{value:g}"
    return f"{value:g}"


def wrapped(label: str) -> str:
    """A planner's label on as many lines as it needs, broken between its options."""
    loose = label.replace(",", ", ").replace(":", ": ")
    lines = wrap(loose, _LABEL_WIDTH, break_on_hyphens=False)
    drawn = "\n".join(text(line) for line in lines)
    return drawn.replace(", ", ",").replace(": ", ":")
