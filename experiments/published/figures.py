"""The figures of docs/literature.md: one per problem, and one of all claims."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator
from numpy.typing import NDArray

from experiments.published.judged import Judged, optimised
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.explain.claims import JudgedClaim, Verdict
from trajopt.views.figures import plots, style

Array = NDArray[np.float64]

_WIDTH = 6.8  # in
_ROW = 0.24  # in, of a claim
_LABEL_LENGTH = 46  # characters of a line beside the axis
_INSTANTS = 400
_TICKS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5)
_IMPOSSIBLE: dict[str, Any] = {
    "facecolor": "#EDEDED",
    "edgecolor": "#BDBDBD",
    "hatch": "////",
    "linewidth": 0,
}


@plots.styled
def of_problem(problem: Judged) -> Figure:
    """The claims beside bound, best known and stopping; and the best known motion."""
    rows = len(problem.judgements)
    labels = [_label(judgement) for judgement in problem.judgements]
    lines = sum(label.count("\n") + 1 for label in labels)
    if rows == 0:
        figure = Figure(figsize=(_WIDTH, 1.9), layout="constrained")
        _motion(figure.subplots(), problem)
        return figure
    above = max(0.5, 0.16 * lines + 0.06 * rows) + 0.35
    below = 1.3
    figure = Figure(figsize=(_WIDTH, above + below + 0.5), layout="constrained")
    top, bottom = figure.subplots(2, 1, height_ratios=[above, below])
    _claims(top, problem, labels)
    _motion(bottom, problem)
    handles, names = top.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=4)
    return figure


def _label(judgement: JudgedClaim) -> str:
    method = style.text(judgement.claim.method)
    return textwrap.fill(method, _LABEL_LENGTH)


def _claims(
    axes: Axes,
    problem: Judged,
    labels: list[str],
) -> None:
    known = problem.known
    durations = [judgement.claim.duration for judgement in problem.judgements]
    families = known.best_of_family.values()
    marks = [*durations, *families, known.stopping, known.lower_bound]
    if known.best is not None:
        marks.append(known.best)
    low = min(marks) / 1.08
    high = max(marks) * 1.08
    axes.axvspan(low, known.lower_bound, label="proved impossible", **_IMPOSSIBLE)
    if known.best is not None:
        word = "optimum, proved" if known.proved else "best known"
        axes.axvline(known.best, color=style.BLUE, lw=1.8, label=word)
    axes.axvline(
        known.stopping,
        color=style.VERMILION,
        ls=style.DASHES[1],
        label="stopping at every waypoint",
    )
    for family, best in known.best_of_family.items():
        axes.axvline(best, color=style.GREEN, ls=style.DASHES[3], label=f"best {family}")
    for row, judgement in enumerate(problem.judgements):
        axes.plot(
            judgement.claim.duration,
            row,
            ls="none",
            zorder=3,
            clip_on=False,
            **_mark(problem, judgement),
        )
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set(xscale="log", xlim=(low, high), xlabel="published duration, s (log)")
    axes.xaxis.set_major_locator(MaxNLocator(7))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(style.plain)


def _mark(problem: Judged, judgement: JudgedClaim) -> dict[str, Any]:
    """Filled where something was optimised, hollow where nothing was, a cross if impossible."""
    if judgement.verdict is Verdict.IMPOSSIBLE:
        return {"marker": "X", "ms": 7, "color": style.BLACK}
    inside = "white"
    if optimised(problem.published, judgement):
        inside = style.BLACK
    return {"marker": "o", "ms": 5, "mec": style.BLACK, "mfc": inside}


def _motion(axes: Axes, problem: Judged) -> None:
    """Positions of the best known, each joint over its own range, with the waypoints."""
    trajectory = problem.known.trajectory
    stated = problem.published.problem
    if trajectory is None or stated is None:
        axes.set_axis_off()
        return
    times = np.linspace(0.0, trajectory.duration, _INSTANTS)
    for joint in map(int, np.flatnonzero(stated.moving)):
        colour = style.CURVES[joint % len(style.CURVES)]
        dash: Any = style.DASHES[joint % len(style.DASHES)]
        curve, dots = _over_range(stated, trajectory, times, joint)
        axes.plot(times, curve, color=colour, ls=dash, lw=1.0)
        axes.plot(trajectory.waypoint_times, dots, ls="none", marker=".", color=colour)
    axes.set_xlim(0, trajectory.duration)
    axes.set(
        xlabel=f"time along the best known motion, s ({problem.known.best_by})",
        ylabel="joints, over range",
    )


def _over_range(
    problem: Problem,
    trajectory: Trajectory,
    times: Array,
    joint: int,
) -> tuple[Array, Array]:
    """One joint's positions and waypoints, from 0 at its lowest waypoint to 1 at its highest."""
    column = problem.waypoints[:, joint]
    low = column.min()
    size = column.max() - low
    positions = trajectory(times)[:, joint]
    return (positions - low) / size, (column - low) / size


@plots.styled
def of_all(problems: list[Judged]) -> Figure:
    """Every claim over the best known of its problem, the closest above; stopping is marked."""
    shown = [problem for problem in problems if problem.judgements and problem.known.best]
    shown.sort(key=_nearest)
    figure = Figure(figsize=(_WIDTH, _ROW * len(shown) + 1.2), layout="constrained")
    axes = figure.subplots()
    for row, problem in enumerate(shown):
        _row_of_all(axes, row, problem)
    axes.axvline(1.0, color=style.BLUE, lw=1.8, label="best known")
    axes.set_yticks(range(len(shown)), [problem.name for problem in shown])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set(xscale="log", xlabel="duration over the best known (ratio, log)")
    axes.set_xticks(_TICKS, [style.plain(tick) for tick in _TICKS])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(axis="x", color="#E0E0E0", lw=0.5)
    axes.set_axisbelow(True)
    handles, names = axes.get_legend_handles_labels()
    once = dict(zip(names, handles, strict=True))
    figure.legend(once.values(), once.keys(), loc="outside upper center", ncols=3)
    return figure


def _nearest(problem: Judged) -> float:
    """The smallest ratio that a source got by optimising."""
    ratios = []
    for judgement in problem.judgements:
        if judgement.excess is not None:
            not_searched = not optimised(problem.published, judgement)
            ratios.append((not_searched, judgement.excess))
    return min(ratios)[1]


def _row_of_all(
    axes: Axes,
    row: int,
    problem: Judged,
) -> None:
    known = problem.known
    assert known.best is not None
    axes.plot(
        [known.lower_bound / known.best, 1.0],
        [row, row],
        color=style.GREY,
        lw=4,
        solid_capstyle="butt",
        label="not settled: lower bound to best known",
    )
    axes.plot(
        known.stopping / known.best,
        row,
        ls="none",
        marker="|",
        ms=10,
        mew=2,
        color=style.VERMILION,
        zorder=2.5,
        label="stopping at every waypoint",
    )
    for judgement in problem.judgements:
        mark = _mark(problem, judgement)
        searched = optimised(problem.published, judgement)
        word = "published, optimised" if searched else "published, nothing optimised"
        if judgement.verdict is Verdict.IMPOSSIBLE:
            word = "published, impossible as printed"
        ratio = judgement.claim.duration / known.best
        axes.plot(ratio, row, ls="none", zorder=3, label=word, **mark)
