"""Figures: tables, arrays and trajectories in, matplotlib figures out.

No global state and no display: every function returns a `Figure`, and `save` writes it. Colours are
Okabe and Ito's; markers and line styles tell the same apart in grey.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from textwrap import wrap
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
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

_DOT: dict[str, Any] = {"marker": "o", "mfc": "white", "mec": BLACK, "mew": 0.8}
_LIMIT: dict[str, Any] = {"color": VERMILION, "ls": (0, (4, 2)), "lw": 0.8}
_BOX: dict[str, Any] = {"fc": "0.88", "ec": BLACK, "lw": 0.7}
_RUN: dict[str, Any] = {"marker": "o", "ls": "", "ms": 2.8, "mew": 0, "color": BLUE, "alpha": 0.6}
FLOOR = 1e-4  # %: differences below it are drawn at it, where a log axis ends

_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif", "font.size": 8, "axes.titlesize": 8, "axes.labelsize": 8,
    "xtick.labelsize": 7, "ytick.labelsize": 7, "legend.fontsize": 7, "legend.frameon": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.6,
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "lines.linewidth": 1.2,
    "lines.markersize": 3.5, "legend.handlelength": 3.0, "svg.fonttype": "none",
    "svg.hashsalt": "trajopt",
}  # fmt: skip
styled = matplotlib.rc_context(_STYLE)  # the reader's own settings are left alone


@styled
def save(figure: Figure, stem: Path) -> list[Path]:
    """Write `stem.png` (200 dpi) and `stem.svg`; the same figure gives the same bytes."""
    files = [stem.with_name(f"{stem.name}.{suffix}") for suffix in ("png", "svg")]
    figure.savefig(files[0], dpi=200, metadata={"Software": None})
    figure.savefig(files[1], metadata={"Date": None})
    return files


@styled
def durations(summary: pd.DataFrame, title: str = "") -> Figure:
    """Certified durations (s) of one problem's planners, the shortest first, and their gaps.

    `summary` holds one problem's rows of `Results.summary()`. A planner with several runs shows its
    median, quartiles (thick) and range (thin); one without a certified duration, its status.
    """
    rows = summary.sort_values("median", kind="stable", na_position="last").reset_index(drop=True)
    certified, reference = rows[rows["median"].notna()], _reference(rows)
    figure, (axes,) = _row_chart([_row_label(row) for _, row in rows.iterrows()], 1)
    _dots(axes, certified)
    if reference:
        name, time = reference
        end = len(certified) - 0.5
        axes.vlines(time, -0.5, end, VERMILION, "--", label=name, lw=1.0, zorder=1.5)
    _columns(axes, certified, reference is not None)
    for y, row in rows[rows["median"].isna()].iterrows():
        bound = f" (lower bound {row['lower_bound']:#.4g} s)" * bool(row["lower_bound"] > 0)
        axes.annotate(row["status"] + bound, (0, y), (4, 0), textcoords="offset points",
                      va="center", style="italic", fontsize=7, color="0.3")  # fmt: skip
    axes.set(xlabel="certified duration (s)", title=title, xlim=(0, None))
    if len(certified):
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def _reference(rows: pd.DataFrame) -> tuple[str, float] | None:
    """What the gaps are measured against, in words, and its duration, s."""
    for kind, value in rows[["kind", "reference"]].dropna().itertuples(index=False):
        bound = "optimum ≥ lower bound" if kind == "lower bound" else f"{kind} optimum"
        return f"{bound} {value:#.4g} s", float(value)
    return None


def _row_label(row: pd.Series[Any]) -> str:
    note = f"\n({row['solved']} of {row['runs']} runs solved)"
    return wrapped(row["label"]) + note * bool(0 < row["solved"] < row["runs"])


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
    style: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "fontsize": 7}
    cells = {"median (s)": [f"{m:#.4g}" for m in rows["median"]]}
    cells |= {"gap": [percent(g) for g in rows["gap"]]} if gaps else {}
    for (head, texts), right in zip(cells.items(), (46, 96), strict=False):
        axes.annotate(head, (1, 1), (right, 6), xycoords="axes fraction", color="0.3", **style)
        for y, text in enumerate(texts):
            axes.annotate(text, (1, y), (right, 0), xycoords=axes.get_yaxis_transform(),
                          va="center", **style)  # fmt: skip


def percent(gap: float) -> str:
    """A gap with the sign it has: two decimals below 10 %, one above."""
    return f"{100 * gap:+.{2 if abs(gap) < 0.1 else 1}f} %".replace("-", "−")


@styled
def motion(
    problem: Problem, trajectory: Trajectory, reference: Trajectory | None = None,
    title: str = "", reference_name: str = "exact optimum",
) -> Figure:  # fmt: skip
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

    Linear pieces need their ends only; all others share 240 points.
    """
    pieces = polynomials.derivative(trajectory.coefficients, order)
    points = max(5, 240 // pieces.shape[1] + 1) if pieces[:-2].any() else 2
    local = np.linspace(0.0, 1.0, points)[:, None] * np.diff(trajectory.breaks)
    values = polynomials.evaluate(pieces[:, None], local[..., None])
    return (trajectory.breaks[:-1] + local).T.ravel(), values.swapaxes(0, 1).reshape(
        -1, trajectory.joints
    )


def _limit(axes: Axes, limits: Array) -> None:
    """Dashed lines at the finite limits, grey beyond, and a view that holds both and the data."""
    finite = limits[np.isfinite(limits)]
    values = np.concatenate([finite, *(np.asarray(line.get_ydata()) for line in axes.lines)])
    low, high = values.min(), values.max()
    moves = high - low > 1e-9 * max(1.0, abs(high))  # rounding is not worth magnifying
    margin = 0.08 * (high - low) if moves else 0.05
    for limit in finite:
        beyond = low - margin if limit == limits[0] else high + margin
        axes.axhspan(limit, beyond, color="0.93", lw=0, zorder=0)
        axes.axhline(limit, zorder=1, **_LIMIT)
    axes.set_ylim(low - margin, high + margin)


def _grid(rows: int, columns: int) -> tuple[Figure, NDArray[Any]]:
    """Panels laid out in inches: solving for a layout takes longer than drawing all of them."""
    panel = max(0.95, 1.7 - 0.15 * rows)
    width, height = 2.35 * columns + 0.3, rows * panel + 1.05
    figure = Figure(figsize=(width, height))
    with matplotlib.rc_context({"axes.titley": 1.0}):  # titles need not look for free space
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    figure.subplots_adjust(left=0.65 / width, right=1 - 0.12 / width, top=1 - 0.65 / height,
                           bottom=0.4 / height, wspace=0.38, hspace=0.22)  # fmt: skip
    left = -0.44 * (columns + 0.38 * (columns - 1)) / (width - 0.77)
    for axes in grid.flat:
        axes.xaxis.set_label_coords(0.5, -0.26 / panel)
        axes.yaxis.set_label_coords(left, 0.5)
        axes.yaxis.set_major_locator(MaxNLocator(3 if rows > 1 else 6))
        axes.yaxis.set_major_formatter(FuncFormatter(_plain))
    return figure, grid


def _caption(figure: Figure, title: str, reference: str | None) -> None:
    """The title, and under it what the lines mean."""
    width, height = figure.get_size_inches()
    figure.text(0.65 / width, 1 - 0.08 / height, title, va="top", fontsize=9)
    looks: dict[str, dict[str, Any]] = {"planner": {"color": BLUE}, "limit": _LIMIT}
    looks |= {"waypoint": {"color": "0.6", "lw": 0.4, **_DOT}}
    looks |= {reference: {"color": GREY, "lw": 1.8}} if reference else {}
    keys = [Line2D([], [], label=label, **look) for label, look in looks.items()]
    figure.legend(handles=keys, loc="upper left", ncols=4, borderpad=0, borderaxespad=0,
                  bbox_to_anchor=(0.65 / width, 1 - 0.26 / height))  # fmt: skip


@styled
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
    shade = min(0.18, 0.9 / len(histories))  # many bands would hide the curves
    looks = zip(cycle(CURVES), cycle(DASHES), cycle(MARKERS), strict=False)
    for (label, runs), (colour, dash, marker) in zip(histories.items(), looks, strict=False):
        look = {"marker": marker, "ls": dash, "color": colour, "label": wrapped(label)}
        spent, quartiles = over_seeds(runs)
        excess = np.maximum(100 * (quartiles / (best or np.nan) - 1), FLOOR)
        for axes, (first, median, third) in zip(panels, (quartiles, excess), strict=False):
            axes.fill_between(spent, first, third, step="post", color=colour, alpha=shade, lw=0)
            axes.plot(spent, median, drawstyle="steps-post", markevery=0.13, mfc="white", **look)
    panels[0].set(xscale="log", yscale="log", ylabel="best feasible duration (s)", title=title)
    panels[0].set_xlim(1, max(run[-1, 0] for runs in histories.values() for run in runs) * 1.1)
    panels[0].yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 4, 5, 6, 8)))
    panels[0].yaxis.set_major_formatter(FuncFormatter(_plain))
    panels[0].yaxis.set_minor_formatter(NullFormatter())
    if best:
        name = f"best 3-5-3 {best:#.4g} s"
        panels[0].axhline(best, color=BLACK, lw=0.8, ls=(0, (3, 2)), label=name)
        _log_percent(panels[1].yaxis)
        panels[1].set_ylabel("above the best 3-5-3 (%)")
    panels[-1].set_xlabel("evaluations")
    keys = panels[0].get_legend_handles_labels()
    figure.legend(*keys, loc="outside right upper", title="median and quartiles")
    return figure


def over_seeds(runs: Sequence[Array]) -> tuple[Array, Array]:
    """Evaluations `(m,)` and the quartiles `(3, m)` of the best durations by then, s.

    A run without a feasible candidate counts as infinitely long: a quartile is NaN until enough
    runs have one.
    """
    end = max(float(run[-1, 0]) for run in runs)
    evaluations = np.unique(np.geomspace(1.0, max(end, 1.0), 120).round())
    padded = [np.vstack([[0.0, np.nan], run]) for run in runs]
    entries = [np.searchsorted(run[:, 0], evaluations, side="right") - 1 for run in padded]
    best = np.sort([run[e, 1] for run, e in zip(padded, entries, strict=True)], axis=0)
    rank = np.array([0.25, 0.5, 0.75]) * (len(best) - 1)
    below, above = np.floor(rank).astype(int), np.ceil(rank).astype(int)
    share = (rank - below)[:, None]  # NaN, as infinity, sorts last and spreads
    return evaluations, (1 - share) * best[below] + share * best[above]


@styled
def gap_distribution(gaps: pd.DataFrame, title: str = "") -> Figure:
    """The gap (%) of every run, a row per planner with several, the smallest median first.

    `gaps` holds `label` and `gap` of one problem (`Results.gaps()`). On the right, what is above
    the best of these runs. Planners that ran once are lines, where they are in view.
    """
    groups = {label: 100 * g.dropna().to_numpy() for label, g in gaps.groupby("label")["gap"]}
    several = [label for label, runs in groups.items() if len(runs) > 1]
    labels = sorted(several, key=lambda label: float(np.median(groups[label])))
    values = [groups[label] for label in labels]
    best = min(runs.min() for runs in values)
    figure, (left, right) = _row_chart([wrapped(label) for label in labels], 2)
    _strips(left, values)
    _strips(right, [np.maximum(runs - best, FLOOR) for runs in values])
    low, high = left.get_xlim()
    once = [(k, g[0]) for k, g in groups.items() if len(g) == 1 and low <= g[0] <= high]
    lines = [
        left.axvline(gap, color=VERMILION, ls=dash, lw=0.9, zorder=0.5, label=wrapped(label))
        for (label, gap), dash in zip(once, cycle(DASHES[1:]), strict=False)
    ]
    _log_percent(right.xaxis)
    left.set(xlabel="gap (%)", title=title)
    right.set_xlabel("above the best run (percentage points)")
    run, box = Line2D([], [], label="one run", **_RUN), Patch(label="quartiles and range", **_BOX)
    figure.legend(handles=[run, box, *lines], loc="outside lower center", ncols=4)
    return figure


def _strips(axes: Axes, values: Sequence[Array]) -> None:
    """A dot per run over a box of quartiles; the dots' heights only keep them apart."""
    ink = {"color": BLACK, "lw": 0.7}
    axes.boxplot(
        values, positions=range(len(values)), orientation="horizontal", whis=(0, 100), widths=0.62,
        patch_artist=True, manage_ticks=False, showfliers=False, boxprops=_BOX,
        medianprops=ink | {"lw": 1.4}, whiskerprops=ink, capprops=ink,
    )  # fmt: skip
    for y, runs in enumerate(values):
        height = np.arange(len(runs)) * 0.618034 % 1 - 0.5
        axes.plot(np.sort(runs), y + 0.45 * height, zorder=3, **_RUN)


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


def _log_percent(axis: XAxis | YAxis) -> None:
    """A log axis from `FLOOR` up, its end labelled as what is there: that or less."""
    low, high = np.maximum(axis.get_data_interval(), (0, 100 * FLOOR))
    limits = (min(low, high / 100) * 0.8, high * 1.5)
    axis.axes.set(**{f"{axis.axis_name}scale": "log", f"{axis.axis_name}lim": limits})
    axis.set_major_locator(LogLocator(numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda v, _: "≤" * bool(v < 1.1 * FLOOR) + f"{v:g}"))
    axis.set_minor_formatter(NullFormatter())


def wrapped(label: str, width: int = 30) -> str:
    """A planner's label on as many lines as it needs, broken between its options."""
    lines = wrap(label.replace(",", ", ").replace(":", ": "), width, break_on_hyphens=False)
    return "\n".join(lines).replace(", ", ",").replace(": ", ":")


def _plain(value: float, _: object = None) -> str:
    return f"{value:g}".replace("-", "−")
