"""Figures: tables, arrays and trajectories in, matplotlib figures out.

No global state and no display: every function returns a `Figure`, and `save` writes it. Colours are
Okabe and Ito's; markers and line styles tell the same apart in grey.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from textwrap import wrap
from typing import Any, Literal

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.problem import LimitName, Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

BLACK, BLUE, VERMILION, GREY = "#000000", "#0072B2", "#D55E00", "#8C8C8C"
CURVES = (BLUE, VERMILION, "#009E73", "#E69F00", "#CC79A7", BLACK, "#56B4E9")
DASHES = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
QUANTITIES: tuple[tuple[LimitName, str], ...] = (
    ("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s²"), ("jerk", "rad/s³"),
)  # fmt: skip

_DOT: dict[str, Any] = {"marker": "o", "ms": 3.5, "mfc": "white", "mec": BLACK, "mew": 0.8}
_LIMIT: dict[str, Any] = {"color": VERMILION, "ls": (0, (4, 2)), "lw": 0.8}
_BOX: dict[str, Any] = {"fc": "0.88", "ec": BLACK, "lw": 0.7}
_RUN: dict[str, Any] = {"marker": "o", "ls": "", "ms": 2.8, "mew": 0, "color": BLUE, "alpha": 0.6}
FLOOR = 1e-4  # %: differences below it are drawn at it, where a log axis ends
_SAMPLES = 240  # points of a curve, however many pieces share them

_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif", "font.size": 8, "axes.titlesize": 8, "axes.labelsize": 8,
    "xtick.labelsize": 7, "ytick.labelsize": 7, "legend.fontsize": 7, "legend.frameon": False,
    "axes.titley": 1.04, "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.6,
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "lines.linewidth": 1.2,
    "svg.fonttype": "none", "svg.hashsalt": "trajopt",
}  # fmt: skip
_styled = matplotlib.rc_context(_STYLE)  # the reader's own settings are left alone


@_styled
def save(figure: Figure, stem: Path) -> list[Path]:
    """Write `stem.png` (200 dpi) and `stem.svg`; the same figure gives the same bytes."""
    files = [stem.with_name(f"{stem.name}.{suffix}") for suffix in ("png", "svg")]
    figure.savefig(files[0], dpi=200, metadata={"Software": None})
    figure.savefig(files[1], metadata={"Date": None})
    return files


@_styled
def durations(summary: pd.DataFrame, title: str = "") -> Figure:
    """Certified durations (s) of one problem's planners, the shortest first, and their gaps.

    `summary` holds one problem's rows of `Results.summary()`. A planner with several runs shows its
    median, quartiles (thick) and range (thin); one without a certified duration, its status.
    """
    rows = summary.sort_values("median", kind="stable", na_position="last").reset_index(drop=True)
    certified, reference = rows[rows["median"].notna()], _reference(rows)
    figure, (axes,) = _row_chart([_row_label(row) for _, row in rows.iterrows()], 1)
    _dots(axes, certified)
    if reference is not None:
        name, value = reference
        axes.vlines(value, -0.5, len(certified) - 0.5, color=VERMILION, ls="--", lw=1.0, label=name)
    _columns(axes, certified, reference is not None)
    for y, row in rows[rows["median"].isna()].iterrows():
        axes.annotate(_without_duration(row), (0, y), (4, 0), textcoords="offset points",
                      va="center", style="italic", fontsize=7, color="0.3")  # fmt: skip
    axes.set_xlim(0, (certified["max"].max() if len(certified) else 1.0) * 1.03)
    axes.set(xlabel="certified duration (s)", title=title)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _reference(rows: pd.DataFrame) -> tuple[str, float] | None:
    """What the gaps are measured against, in words, and its duration, s."""
    known = rows[rows["gap"].notna()]
    if known.empty:
        return None
    row = known.iloc[0]
    value = float(row["median"] / (1 + row["gap"]))
    name = "exact optimum" if row["kind"] == "exact" else "optimum ≥ lower bound"
    return f"{name} {value:#.4g} s", value


def _row_label(row: pd.Series[Any]) -> str:
    some = 0 < row["solved"] < row["runs"]
    note = f"\n({row['solved']} of {row['runs']} runs solved)" if some else ""
    return wrapped(row["label"]) + note


def _without_duration(row: pd.Series[Any]) -> str:
    bound = row["lower_bound"]
    return str(row["status"]) + ("" if pd.isna(bound) else f" (lower bound {bound:#.4g} s)")


def _dots(axes: Axes, rows: pd.DataFrame) -> None:
    """Stems and medians; of several runs also quartiles and range."""
    axes.hlines(rows.index, 0, rows["median"], color="0.85", lw=1.0, zorder=1)
    one, many = rows[rows["runs"] == 1], rows[rows["runs"] > 1]
    axes.hlines(many.index, many["min"], many["max"], color=BLUE, lw=0.9, zorder=2)
    axes.hlines(many.index, many["q1"], many["q3"], color=BLUE, lw=3.5, zorder=2)
    spread = "median, quartiles and range of several runs"
    for some, marker, face, name in (one, "o", BLUE, "one run"), (many, "D", "white", spread):
        if len(some):
            axes.plot(some["median"], some.index, marker, ms=4.5, mfc=face, mec=BLUE, label=name)


def _columns(axes: Axes, rows: pd.DataFrame, gaps: bool) -> None:
    """Median and gap as numbers, beside the chart."""
    columns = [("median (s)", 46, [f"{m:#.4g}" for m in rows["median"]])]
    if gaps:
        columns.append(("gap", 96, [percent(g) for g in rows["gap"]]))
    place: dict[str, Any] = {"xycoords": axes.get_yaxis_transform(), "annotation_clip": False}
    place |= {"textcoords": "offset points", "ha": "right", "va": "center", "fontsize": 7}
    for head, offset, cells in columns:
        for y, text in enumerate([head, *cells], start=-1):
            axes.annotate(text, (1, y), (offset, 0), color="0.3" if y < 0 else BLACK, **place)


def percent(gap: float) -> str:
    """A gap with the sign it has: two decimals below 10 %, one above."""
    return f"{100 * gap:+.{2 if abs(gap) < 0.1 else 1}f} %".replace("-", "−")


@_styled
def motion(
    problem: Problem,
    trajectory: Trajectory,
    reference: Trajectory | None = None,
    title: str = "",
    reference_name: str = "exact optimum",
) -> Figure:
    """Every joint against time (s), with its limits and waypoints; `reference` behind it in grey.

    A row per joint, a column per quantity: position, velocity, acceleration, and jerk if limited.
    """
    quantities = QUANTITIES if problem.has("jerk") else QUANTITIES[:3]
    figure, grid = _grid(problem.joints, len(quantities))
    for order, (quantity, unit) in enumerate(quantities):
        own = sampled_exactly(trajectory, order)
        behind = sampled_exactly(reference, order) if reference else None
        for joint, axes in enumerate(grid[:, order]):
            if behind:
                axes.plot(behind[0], behind[1][:, joint], color=GREY, lw=1.8)
            axes.plot(own[0], own[1][:, joint], color=BLUE, lw=1.1)
            _limit(axes, getattr(problem.limits, quantity)[joint])
            axes.vlines(trajectory.waypoint_times, 0, 1, transform=axes.get_xaxis_transform(),
                        color="0.6", lw=0.4, zorder=0.5)  # fmt: skip
            axes.set_ylabel(f"joint {joint + 1} ({unit})" if order == 0 else unit)
        grid[0, order].set_title(quantity)
        grid[-1, order].set_xlabel("time (s)")
    for axes, positions in zip(grid[:, 0], problem.waypoints.T, strict=True):
        axes.plot(trajectory.waypoint_times, positions, ls="", zorder=3, clip_on=False, **_DOT)
    grid[0, 0].set_xlim(0, max(t.duration for t in (trajectory, reference) if t))
    _caption(figure, title, reference_name if reference else None)
    return figure


def sampled_exactly(trajectory: Trajectory, order: int) -> tuple[Array, Array]:
    """Times `(m,)` and values `(m, joints)` of a derivative, each break twice: before and after.

    Linear pieces need their ends only; others share `_SAMPLES` points.
    """
    pieces = polynomials.derivative(trajectory.coefficients, order)
    straight = not pieces[:-2].any()
    points = 2 if straight else max(5, -(-_SAMPLES // pieces.shape[1]))
    local = np.linspace(0.0, 1.0, points)[:, None] * np.diff(trajectory.breaks)
    values = polynomials.evaluate(pieces[:, None], local[..., None])
    times = trajectory.breaks[:-1] + local
    return times.T.ravel(), values.swapaxes(0, 1).reshape(-1, trajectory.joints)


def _limit(axes: Axes, limits: Array) -> None:
    """Dashed lines at the finite limits, grey beyond, and a view that holds both and the data."""
    finite = limits[np.isfinite(limits)]
    values = np.concatenate([finite, *(np.asarray(line.get_ydata()) for line in axes.lines)])
    low, high = values.min(), values.max()
    rests = high - low < 1e-9 * max(1.0, abs(high))  # rounding is no motion worth magnifying
    margin = 0.05 if rests else 0.08 * (high - low)
    for limit in finite:
        beyond = low - margin if limit == limits[0] else high + margin
        axes.axhspan(limit, beyond, color="0.93", lw=0, zorder=0)
        axes.axhline(limit, zorder=1, **_LIMIT)
    axes.set_ylim(low - margin, high + margin)


def _grid(rows: int, columns: int) -> tuple[Figure, NDArray[Any]]:
    """Panels laid out in inches: solving for a layout takes longer than drawing all of them."""
    panel = max(0.95, 1.7 - 0.15 * rows)
    width, height = 2.35 * columns + 0.25, rows * panel + 1.05
    figure = Figure(figsize=(width, height))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    figure.subplots_adjust(left=0.6 / width, right=1 - 0.12 / width, top=1 - 0.65 / height,
                           bottom=0.4 / height, wspace=0.36, hspace=0.22)  # fmt: skip
    left = -0.4 * (columns + 0.36 * (columns - 1)) / (width - 0.72)
    for axes in grid.flat:
        axes.xaxis.set_label_coords(0.5, -0.26 / panel)
        axes.yaxis.set_label_coords(left, 0.5)
        axes.yaxis.set_major_locator(MaxNLocator(3 if rows > 1 else 6))
        axes.yaxis.set_major_formatter(FuncFormatter(_plain))
    return figure, grid


def _caption(figure: Figure, title: str, reference: str | None) -> None:
    """The title, and under it what the lines mean."""
    width, height = figure.get_size_inches()
    figure.text(0.6 / width, 1 - 0.08 / height, title, va="top", fontsize=9)
    keys = [
        Line2D([], [], color=BLUE, label="planner"),
        Line2D([], [], label="limit", **_LIMIT),
        Line2D([], [], color="0.6", lw=0.4, label="waypoint", **_DOT),
    ]
    if reference:
        keys.insert(1, Line2D([], [], color=GREY, lw=1.8, label=reference))
    figure.legend(handles=keys, loc="upper left", ncols=4, borderpad=0, borderaxespad=0,
                  bbox_to_anchor=(0.6 / width, 1 - 0.26 / height))  # fmt: skip


@_styled
def convergence(
    histories: Mapping[str, Sequence[Array]], best: float | None = None, title: str = ""
) -> Figure:
    """Best feasible duration (s) against evaluations: median and quartiles over seeds.

    `histories` holds per label one `(m, 2)` array per run: evaluations, and the best feasible
    duration by then (NaN before the first). `best` is the duration of the best 3-5-3, s; a second
    panel then shows how far above it the runs are, in %.
    """
    legend = 0.5 + sum(0.17 + 0.11 * wrapped(label).count("\n") for label in histories)
    figure = Figure(figsize=(7.2, max(4.4 if best else 2.8, legend)), layout="constrained")
    panels = figure.subplots(2 if best else 1, 1, sharex=True, squeeze=False)[:, 0]
    looks = zip(cycle(CURVES), cycle(DASHES), cycle(MARKERS), strict=False)
    for (label, runs), (colour, dash, marker) in zip(histories.items(), looks, strict=False):
        look = {"color": colour, "ls": dash, "marker": marker, "label": wrapped(label)}
        evaluations, quartiles = over_seeds(runs)
        _curve(panels[0], evaluations, quartiles, look)
        if best:
            _curve(panels[1], evaluations, np.maximum(100 * (quartiles / best - 1), FLOOR), look)
    panels[0].set(xscale="log", yscale="log", ylabel="best feasible duration (s)", title=title)
    panels[0].set_xlim(1, max(run[-1, 0] for runs in histories.values() for run in runs) * 1.1)
    panels[0].yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 4, 5, 6, 8)))
    panels[0].yaxis.set_major_formatter(FuncFormatter(_plain))
    panels[0].yaxis.set_minor_formatter(NullFormatter())
    if best:
        name = f"best 3-5-3 {best:#.4g} s"
        panels[0].axhline(best, color=BLACK, lw=0.8, ls=(0, (3, 2)), label=name)
        _log_percent(panels[1], "y")
        panels[1].set_ylabel("above the best 3-5-3 (%)")
    panels[-1].set_xlabel("evaluations")
    keys, _ = panels[0].get_legend_handles_labels()
    figure.legend(handles=keys, loc="outside right upper", title="median and quartiles",
                  handlelength=3.5)  # fmt: skip
    return figure


def over_seeds(runs: Sequence[Array]) -> tuple[Array, Array]:
    """Evaluations `(m,)` and the quartiles `(3, m)` of the best durations by then, s.

    A run without a feasible candidate counts as infinitely long: a quartile is NaN until enough
    runs have one.
    """
    end = max(float(run[-1, 0]) for run in runs)
    evaluations = np.unique(np.geomspace(1.0, max(end, 1.0), 120).round())
    best = np.sort([_by_then(run, evaluations) for run in runs], axis=0)  # NaN sorts last
    rank = np.array([[0.25], [0.5], [0.75]]) * (len(best) - 1)
    below, share = np.floor(rank).astype(int)[:, 0], rank % 1
    above = np.ceil(rank).astype(int)[:, 0]
    return evaluations, (1 - share) * best[below] + share * best[above]


def _by_then(run: Array, evaluations: Array) -> Array:
    """The best duration of one run after so many evaluations, s."""
    entry = np.searchsorted(run[:, 0], evaluations, side="right") - 1
    return np.where(entry < 0, np.nan, run[entry, 1])


def _curve(axes: Axes, x: Array, quartiles: Array, look: dict[str, Any]) -> None:
    first, median, third = quartiles
    axes.fill_between(x, first, third, step="post", color=look["color"], alpha=0.18, lw=0)
    axes.plot(x, median, drawstyle="steps-post", ms=3.5, mfc="white", markevery=0.13, **look)


@_styled
def gap_distribution(gaps: pd.DataFrame, title: str = "") -> Figure:
    """The gap (%) of every run, a row per planner with several, the smallest median first.

    `gaps` holds `label` and `gap` of one problem (`Results.gaps()`). On the right, percentage
    points above the best of these runs. Planners that ran once are lines, where they are in view.
    """
    groups = {label: 100 * g.dropna().to_numpy() for label, g in gaps.groupby("label")["gap"]}
    several = {label: runs for label, runs in groups.items() if len(runs) > 1}
    labels = sorted(several, key=lambda label: float(np.median(several[label])))
    values = [several[label] for label in labels]
    best = min(runs.min() for runs in values)
    figure, (left, right) = _row_chart([wrapped(label) for label in labels], 2)
    _strips(left, values)
    _strips(right, [np.maximum(runs - best, FLOOR) for runs in values])
    lines = _lines_in_view(left, {k: float(g[0]) for k, g in groups.items() if len(g) == 1})
    _log_percent(right, "x")
    left.set(xlabel="gap (%)", title=title)
    right.set_xlabel("above the best run (percentage points)")
    keys = [
        Line2D([], [], label="one run", **_RUN),
        Patch(label="quartiles, median, range", **_BOX),
    ]
    figure.legend(handles=[*keys, *lines], loc="outside lower center", ncols=4)
    return figure


def _strips(axes: Axes, values: Sequence[Array]) -> None:
    """A dot per run over a box of quartiles; the dots' heights only keep them apart."""
    ink = {"color": BLACK, "lw": 0.7}
    axes.boxplot(
        values, positions=range(len(values)), orientation="horizontal", whis=(0, 100), widths=0.62,
        patch_artist=True, manage_ticks=False, boxprops=_BOX,
        medianprops=ink | {"lw": 1.4}, whiskerprops=ink, capprops=ink,
    )  # fmt: skip
    for y, runs in enumerate(values):
        height = np.arange(len(runs)) * 0.618034 % 1 - 0.5
        axes.plot(np.sort(runs), y + 0.45 * height, zorder=3, **_RUN)


def _lines_in_view(axes: Axes, once: Mapping[str, float]) -> list[Line2D]:
    """A labelled line per planner that ran once, without stretching the view for it."""
    low, high = axes.get_xlim()
    view = {label: gap for label, gap in once.items() if low <= gap <= high}
    styles = zip(view.items(), cycle(DASHES[1:]), cycle((VERMILION, BLACK)), strict=False)
    lines = [
        axes.axvline(gap, color=colour, ls=dash, lw=0.9, zorder=0.5, label=wrapped(label))
        for (label, gap), dash, colour in styles
    ]
    axes.set_xlim(low, high)
    return lines


def _row_chart(labels: Sequence[str], panels: int) -> tuple[Figure, Sequence[Axes]]:
    """A figure with one labelled row per planner, the first on top."""
    row = 0.2 + 0.1 * max(label.count("\n") for label in labels)
    figure = Figure(figsize=(7.2, 1.15 + row * len(labels)), layout="constrained")
    axes: Sequence[Axes] = figure.subplots(1, panels, sharey=True, squeeze=False)[0]
    axes[0].set_yticks(range(len(labels)), labels)
    axes[0].set_ylim(len(labels) - 0.4, -0.6)
    for each in axes:
        each.tick_params(axis="y", length=0)
    return figure, axes


def _log_percent(axes: Axes, direction: Literal["x", "y"]) -> None:
    """A log axis from `FLOOR` up, its end labelled as what is there: that or less."""
    axes.set(**{f"{direction}scale": "log"})
    axis = axes.xaxis if direction == "x" else axes.yaxis
    low, high = axis.get_data_interval()
    axes.set(**{f"{direction}lim": (min(low, 10 * FLOOR) * 0.8, max(high, 100 * FLOOR) * 1.5)})
    axis.set_major_locator(LogLocator(numticks=8))
    or_less = {True: "≤", False: ""}
    axis.set_major_formatter(FuncFormatter(lambda v, _: or_less[bool(v < 1.01 * FLOOR)] + f"{v:g}"))
    axis.set_minor_formatter(NullFormatter())


def wrapped(label: str, width: int = 30) -> str:
    """A planner's label on as many lines as it needs, broken between its options."""
    words = label.replace(",", ", ").replace(":", ": ")
    lines = wrap(words, width, break_on_hyphens=False)
    return "\n".join(lines).replace(", ", ",").replace(": ", ":")


def _plain(value: float, _: object = None) -> str:
    return f"{value:g}".replace("-", "−")
