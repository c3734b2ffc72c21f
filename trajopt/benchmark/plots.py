"""Figures: tables, arrays and trajectories in, matplotlib figures out.

No global state and no display: every function returns a `Figure`, and `save` writes it. Colours are
Okabe and Ito's; markers and line styles tell the same apart in grey.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from textwrap import wrap
from typing import Any, TypeVar

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
F = TypeVar("F", bound=Callable[..., Any])

BLACK, BLUE, VERMILION, GREY = "#000000", "#0072B2", "#D55E00", "#8C8C8C"
CURVES = (BLUE, VERMILION, "#009E73", "#E69F00", "#CC79A7", BLACK, "#56B4E9")
DASHES = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
QUANTITIES: tuple[tuple[LimitName, str], ...] = (
    ("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s²"), ("jerk", "rad/s³"),
)  # fmt: skip

FLOOR = 1e-4  # %: differences below it are drawn at it, where a log axis ends
_SAMPLES = 240  # points of a curve, however many pieces share them

_STYLE = {
    "font.family": "sans-serif", "font.size": 8, "axes.titlesize": 8, "axes.labelsize": 8,
    "xtick.labelsize": 7, "ytick.labelsize": 7, "legend.fontsize": 7, "legend.frameon": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.6,
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "lines.linewidth": 1.2,
    "svg.fonttype": "none", "svg.hashsalt": "trajopt",
}  # fmt: skip


def _styled(function: F) -> F:
    """Run under this module's style; the reader's own matplotlib settings are left alone."""
    styled: F = matplotlib.rc_context(_STYLE)(function)  # type: ignore[arg-type]
    return styled


@_styled
def save(figure: Figure, stem: Path) -> list[Path]:
    """Write `stem.png` (200 dpi) and `stem.svg`; the same figure gives the same bytes."""
    files = [stem.with_name(f"{stem.name}.{suffix}") for suffix in ("png", "svg")]
    figure.savefig(files[0], dpi=200, metadata={"Software": None})
    figure.savefig(files[1], metadata={"Date": None, "Creator": None})
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
        axes.annotate(_without_duration(row), (0, y), (4, 0), textcoords="offset points", va="center",
                      style="italic", fontsize=7, color="0.3")  # fmt: skip
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
    exact = row["kind"] == "exact"
    return f"exact optimum {value:#.4g} s" if exact else f"optimum ≥ lower bound {value:#.4g} s", value


def _row_label(row: pd.Series[Any]) -> str:
    short = 0 < row["solved"] < row["runs"]
    return wrapped(row["label"]) + (f"\n({row['solved']} of {row['runs']} runs solved)" if short else "")


def _without_duration(row: pd.Series[Any]) -> str:
    bound = row["lower_bound"]
    return str(row["status"]) + ("" if pd.isna(bound) else f" (lower bound {bound:#.4g} s)")


def _dots(axes: Axes, rows: pd.DataFrame) -> None:
    """Stems and medians; of several runs also quartiles and range."""
    axes.hlines(rows.index, 0, rows["median"], color="0.85", lw=1.0, zorder=1)
    many = rows["runs"] > 1
    for several, marker, face in ((False, "o", BLUE), (True, "D", "white")):
        some = rows[many == several]
        if several:
            axes.hlines(some.index, some["min"], some["max"], color=BLUE, lw=0.9, zorder=2)
            axes.hlines(some.index, some["q1"], some["q3"], color=BLUE, lw=3.5, zorder=2)
        if len(some):
            name = "median, quartiles and range of several runs" if several else "one run"
            axes.plot(some["median"], some.index, marker, ms=4.5, mfc=face, mec=BLUE, ls="", zorder=3, label=name)


def _columns(axes: Axes, rows: pd.DataFrame, gaps: bool) -> None:
    """Median and gap as numbers, beside the chart."""
    columns = [("median (s)", 46, [f"{m:#.4g}" for m in rows["median"]])]
    if gaps:
        columns.append(("gap", 96, [percent(g) for g in rows["gap"]]))
    for head, offset, cells in columns:
        for y, text in enumerate([head, *cells], start=-1):
            axes.annotate(text, (1, y), (offset, 0), xycoords=axes.get_yaxis_transform(),
                          textcoords="offset points", ha="right", va="center", fontsize=7,
                          color="0.3" if text == head else "black", annotation_clip=False)  # fmt: skip


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
    curves = [(reference, GREY, 2.0), (trajectory, BLUE, 1.1)] if reference else [(trajectory, BLUE, 1.1)]
    for order, (quantity, unit) in enumerate(quantities):
        sampled = [(*sampled_exactly(t, order), colour, width) for t, colour, width in curves if t]
        for joint, axes in enumerate(grid[:, order]):
            for time, values, colour, width in sampled:
                axes.plot(time, values[:, joint], color=colour, lw=width, solid_joinstyle="miter")
            _limit(axes, getattr(problem.limits, quantity)[joint])
            axes.vlines(trajectory.waypoint_times, 0, 1, transform=axes.get_xaxis_transform(),
                        color="0.6", lw=0.4, zorder=0.5)  # fmt: skip
            axes.set_ylabel(f"joint {joint + 1} ({unit})" if order == 0 else unit)
        grid[0, order].set_title(quantity)
        grid[-1, order].set_xlabel("time (s)")
    for joint, axes in enumerate(grid[:, 0]):
        axes.plot(trajectory.waypoint_times, problem.waypoints[:, joint], "o", ms=3.5, mfc="white",
                  mec=BLACK, mew=0.8, zorder=3, clip_on=False)  # fmt: skip
    grid[0, 0].set_xlim(0, max(t.duration for t, _, _ in curves if t))
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
    """Dashed lines at the finite limits, grey beyond them, and a view that holds both and the data."""
    finite = limits[np.isfinite(limits)]
    values = np.concatenate([finite, *(np.asarray(line.get_ydata()) for line in axes.lines)])
    low, high = values.min(), values.max()
    rests = high - low < 1e-9 * max(1.0, abs(high))  # rounding is no motion worth magnifying
    margin = 0.05 if rests else 0.08 * (high - low)
    for limit in finite:
        beyond = low - margin if limit == limits[0] else high + margin
        axes.axhspan(limit, beyond, color="0.93", lw=0, zorder=0)
        axes.axhline(limit, color=VERMILION, ls=(0, (4, 2)), lw=0.8, zorder=1)
    axes.set_ylim(low - margin, high + margin)


def _grid(rows: int, columns: int) -> tuple[Figure, NDArray[Any]]:
    """Panels laid out in inches: solving for a layout takes longer than drawing all of them."""
    panel = max(0.95, 1.7 - 0.15 * rows)
    width, height = 2.35 * columns + 0.25, rows * panel + 1.05
    figure = Figure(figsize=(width, height))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    figure.subplots_adjust(left=0.6 / width, right=1 - 0.12 / width, top=1 - 0.65 / height,
                           bottom=0.4 / height, wspace=0.36, hspace=0.22)  # fmt: skip
    for axes in grid.flat:
        axes.yaxis.set_major_locator(MaxNLocator(3 if rows > 1 else 6))
        axes.yaxis.set_major_formatter(FuncFormatter(_plain))
    return figure, grid


def _caption(figure: Figure, title: str, reference: str | None) -> None:
    """The title, and under it what the lines mean."""
    width, height = figure.get_size_inches()
    figure.text(0.6 / width, 1 - 0.08 / height, title, va="top", fontsize=9)
    keys = [
        Line2D([], [], color=BLUE, label="planner"),
        Line2D([], [], color=VERMILION, ls=(0, (4, 2)), lw=0.8, label="limit"),
        Line2D([], [], color="0.6", lw=0.4, marker="o", ms=3.5, mfc="white", mec=BLACK, label="waypoint"),
    ]
    if reference:
        keys.insert(1, Line2D([], [], color=GREY, lw=2.0, label=reference))
    figure.legend(handles=keys, loc="upper left", ncols=4, borderpad=0, borderaxespad=0,
                  bbox_to_anchor=(0.6 / width, 1 - 0.26 / height))  # fmt: skip


@_styled
def convergence(
    histories: Mapping[str, Sequence[Array]], best: float | None = None, title: str = ""
) -> Figure:
    """Best feasible duration (s) against evaluations: each planner's median and quartiles over seeds.

    `histories` holds per label one `(m, 2)` array per run: evaluations, and the best feasible
    duration by then (NaN before the first). `best` is the duration of the best 3-5-3, s; a second
    panel then shows how far above it the runs are, in %.
    """
    tall = max(4.4, 0.6 + sum(0.13 + 0.12 * wrapped(label).count("\n") for label in histories))
    figure = Figure(figsize=(7.2, tall if best else max(3.0, tall - 1.4)), layout="constrained")
    panels = figure.subplots(2 if best else 1, 1, sharex=True, squeeze=False)[:, 0]
    for (label, runs), style in zip(histories.items(), _curve_styles(), strict=False):
        evaluations, quartiles = over_seeds(runs)
        _curve(panels[0], evaluations, quartiles, style, wrapped(label))
        if best:
            excess = 100 * (quartiles / best - 1)
            _curve(panels[1], evaluations, np.maximum(excess, FLOOR), style)
    if best:
        panels[0].axhline(best, color=BLACK, lw=0.8, ls=(0, (3, 2)), label=f"best 3-5-3 {best:#.4g} s")
        _log_percent(panels[1].yaxis)
        panels[1].set_ylabel("above the best 3-5-3 (%)")
    panels[0].set(xscale="log", yscale="log", ylabel="best feasible duration (s)", title=title)
    _duration_ticks(panels[0])
    panels[-1].set_xlabel("evaluations")
    figure.legend(loc="outside right upper", title="median and quartiles", handlelength=3.5)
    return figure


def over_seeds(runs: Sequence[Array]) -> tuple[Array, Array]:
    """Evaluations `(m,)` and the quartiles `(3, m)` of the best durations by then, s.

    A run without a feasible candidate counts as infinitely long: a quartile is NaN until enough
    runs have one.
    """
    end = max(float(run[-1, 0]) for run in runs)
    evaluations = np.unique(np.geomspace(1.0, max(end, 1.0), 200).round())
    best = np.sort([_by_then(run, evaluations) for run in runs], axis=0)  # NaN sorts last
    rank = np.array([[0.25], [0.5], [0.75]]) * (len(best) - 1)
    below, share = np.floor(rank).astype(int)[:, 0], rank % 1
    above = np.ceil(rank).astype(int)[:, 0]
    return evaluations, (1 - share) * best[below] + share * best[above]


def _by_then(run: Array, evaluations: Array) -> Array:
    """The best duration of one run after so many evaluations, s."""
    entry = np.searchsorted(run[:, 0], evaluations, side="right") - 1
    return np.where(entry < 0, np.nan, run[entry, 1])


def _curve_styles() -> Any:
    """Colour, line style and marker, no two alike among the first 252."""
    return (
        {"color": colour, "ls": dash, "marker": marker}
        for colour, dash, marker in zip(cycle(CURVES), cycle(DASHES), cycle(MARKERS), strict=False)
    )


def _curve(axes: Axes, x: Array, quartiles: Array, style: Mapping[str, Any], label: str = "") -> None:
    first, median, third = quartiles
    axes.fill_between(x, first, third, step="post", color=style["color"], alpha=0.18, lw=0)
    axes.plot(x, median, drawstyle="steps-post", ms=3.5, mfc="white", mew=0.8, markevery=0.13,
              label=label or "_", **style)  # fmt: skip


def _duration_ticks(axes: Axes) -> None:
    """Seconds as people write them, close enough together for less than a decade."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 4, 5, 6, 8)))
    axes.yaxis.set_major_formatter(FuncFormatter(_plain))
    axes.yaxis.set_minor_formatter(NullFormatter())


@_styled
def gap_distribution(gaps: pd.DataFrame, title: str = "") -> Figure:
    """The gap (%) of every run, a row per planner with several, the smallest median first.

    `gaps` holds `label` and `gap` of one problem (`Results.gaps()`). On the right, percentage points
    above the best of these runs. Planners that ran once are lines, where they are in view.
    """
    groups = {label: 100 * g.dropna().to_numpy() for label, g in gaps.groupby("label")["gap"]}
    several = sorted((label for label, g in groups.items() if len(g) > 1), key=lambda k: np.median(groups[k]))
    values = [groups[label] for label in several]
    figure, (left, right) = _row_chart([wrapped(label) for label in several], 2)
    best = min(v.min() for v in values)
    for axes, shown in (left, values), (right, [np.maximum(v - best, FLOOR) for v in values]):
        _strips(axes, shown)
    once = {label: float(g[0]) for label, g in groups.items() if len(g) == 1}
    _lines_in_view(left, once)
    _log_percent(right.xaxis)
    left.set(xlabel="gap (%)", title=title)
    right.set_xlabel("above the best run (percentage points)")
    box = Patch(fc="0.88", ec=BLACK, lw=0.7, label="quartiles, median, range")
    lines = [line for line in left.lines if not line.get_label().startswith("_")]
    run = Line2D([], [], marker="o", ms=2.8, color=BLUE, alpha=0.6, ls="", label="one run")
    figure.legend(handles=[run, box, *lines], loc="outside lower center", ncols=4)
    return figure


def _strips(axes: Axes, values: Sequence[Array]) -> None:
    """A dot per run over a box of quartiles; the dots' heights only keep them apart."""
    ink = {"color": BLACK, "lw": 0.7}
    axes.boxplot(values, positions=range(len(values)), orientation="horizontal", whis=(0, 100), widths=0.62,
                 patch_artist=True, manage_ticks=False, boxprops={"fc": "0.88", "ec": BLACK, "lw": 0.7},
                 medianprops=ink | {"lw": 1.4}, whiskerprops=ink, capprops=ink)  # fmt: skip
    for y, runs in enumerate(values):
        height = np.arange(len(runs)) * 0.618034 % 1 - 0.5
        axes.plot(np.sort(runs), y + 0.45 * height, "o", ms=2.8, mew=0, color=BLUE, alpha=0.6, zorder=3)


def _lines_in_view(axes: Axes, once: Mapping[str, float]) -> None:
    """A labelled line per planner that ran once, without stretching the view for it."""
    low, high = axes.get_xlim()
    view = {label: gap for label, gap in once.items() if low <= gap <= high}
    for (label, gap), dash in zip(view.items(), cycle(DASHES[1:]), strict=False):
        axes.axvline(gap, color=VERMILION, ls=dash, lw=0.9, zorder=0.5, label=wrapped(label))
    axes.set_xlim(low, high)


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


def _log_percent(axis: Any) -> None:
    """A log axis from `FLOOR` up, its end labelled as what is there: that or less."""
    axis._set_scale("log")
    axis.set_major_locator(LogLocator(numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"≤ {v:g}" if np.isclose(v, FLOOR) else f"{v:g}"))
    axis.set_minor_formatter(NullFormatter())


def wrapped(label: str, width: int = 30) -> str:
    """A planner's label on as many lines as it needs, broken between its options."""
    words = label.replace(",", ", ").replace(":", ": ")
    lines = wrap(words, width, break_on_hyphens=False)
    return "\n".join(lines).replace(", ", ",").replace(": ", ":")


def _plain(value: float, _: object = None) -> str:
    return f"{value:g}".replace("-", "−")
