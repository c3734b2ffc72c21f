"""The paper's figure 6: convergence of each joint searched alone."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.paper.searches import NAMES, Runs
from trajopt import Problem
from trajopt.views.figures import plots, sampling, style


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
