"""The figure of docs/literature.md: all claims."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from experiments.published.judged import JudgedProblem, optimised
from trajopt.explain.verdicts import JudgedClaim, Verdict
from trajopt.views.figures import plots, style

_WIDTH = 6.8  # in
_ROW = 0.24  # in, of a claim
_TICKS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5)


def _mark(problem: JudgedProblem, judgement: JudgedClaim) -> dict[str, Any]:
    """Filled where something was optimised, hollow where nothing was, a cross if impossible."""
    if judgement.verdict is Verdict.IMPOSSIBLE:
        return {"marker": "X", "ms": 7, "color": style.BLACK}
    inside = "white"
    if optimised(problem.published, judgement):
        inside = style.BLACK
    return {"marker": "o", "ms": 5, "mec": style.BLACK, "mfc": inside}


@plots.styled
def of_all(problems: list[JudgedProblem]) -> Figure:
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


def _nearest(problem: JudgedProblem) -> float:
    """The smallest ratio that a source got by optimising."""
    ratios = []
    for judgement in problem.judgements:
        if judgement.excess is not None:
            not_searched = not optimised(problem.published, judgement)
            ratios.append((not_searched, judgement.excess))
    return min(ratios)[1]


def _row_of_all(axes: Axes, row: int, problem: JudgedProblem) -> None:
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
        color=style.ORANGE,
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
