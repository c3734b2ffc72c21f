"""Figures of the paper's two experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.paper.searches import ALGORITHMS, NAMES, Runs, running_times
from trajopt import Problem
from trajopt.views.figures import plots, sampling, style

MARKS = {
    "mean": "v",
    "longest": "s",
    "segment-wise maximum": "D",
    "shared": "o",
}


@plots.styled
def joint_convergence(found: Mapping[str, Runs], problem: Problem) -> Figure:
    """Best duration (s) of each joint searched alone: median and quartiles over seeds."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    for joint, axes in enumerate(figure.subplots(2, 3).flat):
        axes.set_title(f"joint {joint + 1}")
        if joint > 2:
            axes.set_xlabel("evaluations")
        if joint % 3 == 0:
            axes.set_ylabel("best duration (s)")
        if problem.moving[joint]:
            _convergence(axes, found, joint)
            handles, labels = axes.get_legend_handles_labels()
        else:
            axes.text(
                0.5,
                0.5,
                "never moves",
                transform=axes.transAxes,
                ha="center",
                color="0.3",
            )
            axes.set(xticks=[], yticks=[])
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _convergence(
    axes: Axes,
    found: Mapping[str, Runs],
    joint: int,
) -> None:
    looks = zip(found.items(), style.CURVES, style.DASHES, style.MARKERS, strict=False)
    ends = []
    for (algorithm, runs), colour, dash, marker in looks:
        curves = runs.curves(joint)
        ends += [curve[-1, 1] for curve in curves]
        spent, (low, median, high) = sampling.over_runs(curves)
        axes.fill_between(
            spent,
            low,
            high,
            step="post",
            color=colour,
            alpha=0.18,
            lw=0,
        )
        axes.plot(
            spent,
            median,
            drawstyle="steps-post",
            color=colour,
            ls=dash,
            marker=marker,
            markevery=0.17,
            mfc="white",
            label=NAMES[algorithm],
        )
    best = min(ends)
    axes.set(xscale="log", xlim=(20, None), ylim=(0.95 * best, 2.0 * best))
    axes.xaxis.set_minor_formatter(NullFormatter())


@plots.styled
def readings(table: pd.DataFrame, names: Sequence[str]) -> Figure:
    """Every reading's running times against the three published ones."""
    height = 1.3 + 0.27 * len(names)
    figure = Figure(figsize=(7.2, height), layout="constrained")
    axes = figure.subplots()
    published = running_times()
    for shift, algorithm, colour, dash in zip(
        (-0.22, 0.0, 0.22),
        ALGORITHMS,
        style.CURVES[:3],
        style.DASHES[:3],
        strict=True,
    ):
        label = f"published {NAMES[algorithm]}"
        axes.axvline(published[algorithm], color=colour, ls=dash, label=label)
        own = table[table["algorithm"] == NAMES[algorithm]]
        heights = own["reading"].map(names.index) + shift
        _claims(axes, own, heights, colour)
    for combination, marker in MARKS.items():
        axes.plot(
            [],
            [],
            marker,
            ms=4,
            mfc="white",
            mec=style.BLACK,
            label=combination,
        )
    axes.plot(
        [],
        [],
        "o",
        ms=4,
        color=style.BLACK,
        label="keeps Table 3's limits, passes points",
    )
    axes.set_title("in each row, from the top: PSO, SSA, ISSA", loc="left", color="0.3")
    lowest = len(names) - 0.4
    axes.set(
        xlabel="running time claimed (s)",
        xlim=(0, 8.2),
        ylim=(lowest, -0.6),
    )
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    axes.set_axisbelow(True)
    between = np.arange(len(names) - 1) + 0.5
    axes.hlines(between, *axes.get_xlim(), color="0.9", lw=0.5)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _claims(
    axes: Axes,
    own: pd.DataFrame,
    heights: pd.Series[float],
    colour: str,
) -> None:
    """A mark per claim: its shape the combination, filled where it is honest."""
    honest = own["passes together"] & (own["keeps limits"] > 0.5)
    for combination, marker in MARKS.items():
        of_kind = own["combination"] == combination
        for face, some in (("white", of_kind & ~honest), (colour, of_kind & honest)):
            axes.plot(
                own.loc[some, "claimed s"],
                heights[some],
                marker,
                ms=4,
                mfc=face,
                mew=0.9,
                mec=colour,
            )
