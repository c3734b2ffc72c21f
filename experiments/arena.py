"""How close do metaheuristics come to a proved optimum: all that are installed, and our own?

    python -m experiments.arena                                # all that is installed: days
    python -m experiments.arena --libraries mealpy --seeds 5   # 234 optimisers on six-axis
    python -m experiments.arena --names mealpy:name=OriginalGWO,population=50 pso
    python -m experiments.arena --dask cluster.json
    python -m experiments.arena --names mine.py:firefly --budgets 1000 --problems six-axis
    python -m experiments.arena --quick

Each searches the three segment times of the 3-5-3 with Deb's rule in the same box, at equal
budgets; the shortest 3-5-3 of each problem is proved to 1e-6 (`prove`). An optimiser has its
library's own defaults, and a population of 30 where it has one. A run that needs more than 20 s of
CPU time, raises or hangs is a failure, and counts as a run that reached no target. What was run is
kept in `--output`; the same command goes on where it was interrupted, also with more seeds. There
is a table for each problem, and one of all runs on the problems beside six-axis.

Groups: those not significantly worse than the best of the group (Mann and Whitney's test of the
gaps, one-sided, Holm over all that are compared with it at 5 %) form a group with it; the next
group is formed of the rest in the same way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from math import comb
from pathlib import Path
from typing import Any

import cyclopts
import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox
from scipy.stats import mannwhitneyu, spearmanr

from experiments.common import races
from experiments.common.output import save_table
from trajopt import InvalidInput, MissingBackend, Planner, compare
from trajopt.benchmark.run.dask import executor as dask_executor
from trajopt.benchmark.suites import catalogue
from trajopt.comparison import TIMEOUT
from trajopt.core.arrays import Array
from trajopt.planners.registry import configured, load, named
from trajopt.views.analysis import searches, statistics
from trajopt.views.figures.style import BLACK, GREEN, SKY, VERMILION

LIBRARIES = ("mealpy", "pymoo", "nevergrad")
OWN = ("pso", "ssa", "issa", "cmaes", "de")
FIRST = races.FIRST
OTHERS = (
    "robots-ur5e-w4",
    "robots-franka-panda-w4",
    "robots-kuka-kr6-r700-w4",
    "robots-puma-560-w4",
    "robots-abb-irb-120-w4",
)
BUDGETS = (1_000, 10_000)
TARGETS = {"1e-6": 1e-6, "0.1 %": 1e-3, "1 %": 1e-2}
CPU_LIMIT_S = 20.0
# Wall time after which a run that does not even evaluate is stopped, where it has a process.
HANG_TIMEOUT_S = 300.0
LEVEL = 0.05
STORED = {1000: "arena.csv", 10_000: "arena-10000.csv"}  # tables of six-axis, by their budget


def entrants(
    names: Sequence[str], libraries: Sequence[str], evaluations: int, without: Sequence[str] = ()
) -> dict[str, Planner]:
    """The planners of these names, or our own and all of these libraries, with this budget.

    Args:
        without: Optimisers of the libraries that are left out, as `mealpy:name=MultiGA`.
    """
    found = {}
    for spec in names or [*OWN, *libraries]:
        name, planner = named(spec)
        budget: dict[str, float] = {"evaluations": evaluations}
        if name in LIBRARIES:
            budget |= {"cpu_limit": CPU_LIMIT_S}
        planner = configured(planner, budget, name)
        if names or name in OWN:
            # as those of a library are called; a colon parts a label from its options
            found[spec.replace(":name=", " ").replace(":", " ")] = planner
            continue
        try:
            known = planner.choices()["name"]
        except MissingBackend:
            continue
        for own in known:
            if f"{name}:name={own}" in without:
                continue
            found[f"{name} {own}"] = replace(planner, name=own)  # type: ignore[type-var]
    return found


def groups(gaps: Mapping[str, Sequence[float]]) -> dict[str, int]:
    """Return the group of each entrant, from 1, the best first.

    Args:
        gaps: Of the runs of each entrant; infinite for a failure.

    Returns:
        Nothing where there are too few runs for any two entrants to differ significantly.
    """
    fewest = min(map(len, gaps.values()))
    if (len(gaps) - 1) / comb(2 * fewest, fewest) >= LEVEL:
        return {}
    order = sorted(gaps, key=lambda name: (np.median(gaps[name]), np.mean(np.isinf(gaps[name]))))
    found: dict[str, int] = {}
    number = 0
    while order:
        number += 1
        best, *others = order
        found[best] = number
        pvalues = [
            mannwhitneyu(_ranked(gaps[own]), _ranked(gaps[best]), alternative="greater").pvalue
            for own in others
        ]
        adjusted = statistics.holm(pvalues)
        found |= {own: number for own, p in zip(others, adjusted, strict=True) if p >= LEVEL}
        order = [own for own in others if own not in found]
    return found


def _ranked(gaps: Sequence[float] | pd.Series[float]) -> Array:
    """Gaps as a rank test needs them: equal below 1e-9, where they are rounding, and finite."""
    return np.clip(gaps, 1e-9, 1e9)


def above_best(outcome: races.RaceResult) -> pd.Series[float]:
    """Each run's gap to the best known 3-5-3, which lies above the proved bound by its width."""
    width = outcome.runs["problem"].map(outcome.proof["width"])
    return (outcome.runs["gap"] - width) / (1 + width)


def together(outcomes: Sequence[races.RaceResult]) -> races.RaceResult:
    """Return the outcomes of the same entrants on several problems as one."""
    return races.RaceResult(
        pd.concat([own.runs for own in outcomes], ignore_index=True),
        {
            name: [history for own in outcomes for history in own.histories[name]]
            for name in outcomes[0].histories
        },
        pd.concat([own.proof for own in outcomes]),
    )


def table(outcome: races.RaceResult) -> pd.DataFrame:
    """A row per entrant: runs, failures, shares within the targets, evaluations to 0.1 %, group.

    Of several problems the median gap on each is a column too, and the groups are of a run's rank
    among all runs on its problem, as gaps of different problems do not compare.
    """
    label, problem = outcome.runs["label"], outcome.runs["problem"]
    above = above_best(outcome)
    gaps = above.groupby(label)
    costs = searches.running_times(outcome.histories, list(TARGETS.values()))
    rows: dict[str, Any] = {
        "runs": gaps.size(),
        "failed": gaps.agg(lambda own: int(np.isinf(own).sum())),
        "median gap": gaps.median(),
    }
    for name, target in TARGETS.items():
        own = costs.xs(target, level="target")
        rows[f"within {name}"] = gaps.agg(
            lambda each, target=target: float((each <= target).mean())
        )
        if name == "0.1 %":
            rows["evaluations to 0.1 %"] = own["ert"]
    compared = above
    if problem.nunique() > 1:
        for name, own in above.groupby(problem):
            rows[f"median gap, {name}"] = own.groupby(label).median()
        compared = above.transform(_ranked).groupby(problem).rank()
    found = groups({name: list(own) for name, own in compared.groupby(label)})
    rows["group"] = pd.Series(found, dtype=float).reindex(gaps.size().index)
    made = pd.DataFrame(rows).sort_values(["group", "median gap", "failed"])
    return made.rename_axis("optimiser")


def printed(tables: Mapping[int, pd.DataFrame]) -> pd.DataFrame:
    """The tables of several budgets as one for people, in the order of the largest budget."""
    largest = max(tables)
    columns = {}
    for budget, own in sorted(tables.items(), reverse=True):
        at = f"at {budget:,}"
        if budget == largest:
            for name in TARGETS:
                columns[f"within {name} {at}"] = own[f"within {name}"].map(_share)
            columns["evaluations to 0.1 %"] = own["evaluations to 0.1 %"].map(_count)
        for name in own.columns[own.columns.str.startswith("median gap")]:
            columns[f"{name} {at}"] = own[name].map(_percent)
        if own["group"].notna().any():
            columns[f"group {at}"] = own["group"].map(_count)
    made = pd.DataFrame(columns).loc[tables[largest].index]
    made.insert(0, "failed", sum(own["failed"] for own in tables.values()))
    return made.rename_axis("optimiser")


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def _count(value: float) -> str:
    return f"{value:,.0f}" if np.isfinite(value) else "–"


def _percent(value: float) -> str:
    return f"{100 * max(value, 0.0):.4f} %" if np.isfinite(value) else "–"


def stored_gaps(budget: int) -> Array:
    """Return the stored median gaps on six-axis after so many evaluations; empty for others.

    A failure has an infinite gap.
    """
    name = STORED.get(budget)
    if name is None:
        return np.empty(0)
    file = Path(__file__).parent / "stored" / name
    cells = pd.read_csv(file, comment="#")["median gap"].str.removesuffix(" %")
    return pd.to_numeric(cells, errors="coerce").fillna(np.inf).to_numpy() / 100


def placed(gap: float, budget: int) -> tuple[int, int] | None:
    """Return a median gap's rank among the stored ones, and of how many with it; None without."""
    others = stored_gaps(budget)
    return (1 + int((others < gap).sum()), 1 + len(others)) if len(others) else None


def versions(libraries: Sequence[str]) -> str:
    """The versions of what is installed of the libraries, of NumPy and of this package."""
    said = []
    for name in (*libraries, "cma", "numpy", "mintime"):
        with suppress(PackageNotFoundError):
            said.append(f"{name} {version(name)}")
    return ", ".join(said)


def main(
    *,
    libraries: tuple[str, ...] = LIBRARIES,
    names: tuple[str, ...] = (),
    without: tuple[str, ...] = (),
    budgets: tuple[int, ...] = BUDGETS,
    problems: tuple[str, ...] = (FIRST, *OTHERS),
    seeds: int = 30,
    other_seeds: int = 10,
    jobs: int = races.JOBS,
    dask: str = "",
    output: Path = Path("results/arena"),
    quick: bool = False,
) -> None:
    """Race all optimisers on each problem with each budget."""
    if quick:
        names = names or ("pso", "de")
        budgets = (200,)
        problems = (FIRST,)
        seeds = 2
    for problem in problems:
        if load("pso").unknown(catalogue.load(problem)):
            right = "those whose limits a search keeps: no slowing down is the optimiser's"
            raise InvalidInput("problems", right, value=problem)
    print(versions(libraries))
    others: dict[int, list[races.RaceResult]] = {budget: [] for budget in budgets}
    on_first: dict[int, pd.DataFrame] = {}
    for problem in problems:
        tables = {}
        for budget in budgets:
            own = entrants(names, libraries, budget, without)
            folder = output / problem / f"{budget}"
            count = seeds if problem == FIRST else other_seeds
            contestants = [*own.items(), ("proof", load(races.PROOF))]
            with dask_executor(dask) if dask else nullcontext() as executor:
                results = compare(
                    problem,
                    contestants,
                    folder,
                    seeds=count,
                    jobs=jobs,
                    timeout=HANG_TIMEOUT_S if jobs or executor else TIMEOUT,
                    executor=executor,
                )
            outcome = races.outcome(results, list(own))
            if problem != FIRST:
                others[budget].append(outcome)
            tables[budget] = table(outcome)
            for name, gap in tables[budget]["median gap"].items() if problem == FIRST else ():
                if place := placed(gap, budget):
                    rank, every = place
                    print(f"{name}: rank {rank} of {every} by median gap, with the stored ones")
            print(f"{problem}, {budget} evaluations, {count} seeds:")
        report(problem, tables, output)
        if problem == FIRST:
            on_first = tables
    if len(others[budgets[0]]) > 1:
        print(f"all problems but {FIRST} together:")
        on_others = {budget: table(together(own)) for budget, own in others.items()}
        report("others", on_others, output)
        for budget, own in on_first.items():
            carried(own, on_others[budget], output / f"carried-{budget}.svg")


def report(name: str, tables: Mapping[int, pd.DataFrame], folder: Path) -> None:
    """Print the tables, and write them and their figure."""
    for budget, own in tables.items():
        save_table(own, folder / f"{name}-{budget}")
        print(own.to_string(float_format="{:.3g}".format))
    save_table(printed(tables), folder / f"{name}-printed")
    figure(tables, folder / f"{name}.svg")


# Distances of a name from its point, points, and the directions in which it is tried.
_AWAY_PT = range(4, 80, 2)
_DIRECTIONS = np.exp(1j * np.arange(0, 2 * np.pi, np.pi / 12))[:, None].view(float)


def write_names(drawing: Figure, points: Mapping[tuple[float, float], str]) -> None:
    """Write names beside their points, where they touch no mark, curve, legend or other name.

    A name takes the nearest free place; a thin line leads to one that is farther away.
    """
    drawing.draw_without_rendering()  # after it places in pixels are final
    axes = drawing.axes[0]
    pixels = drawing.dpi / 72
    marks = np.concatenate([_pixels(axes, line) for line in axes.lines])
    taken = [found.get_window_extent() for found in (axes.get_legend(),) if found]
    for point, name in points.items():
        at = axes.transData.transform(point)
        measured = axes.text(0, 0, name)
        size = np.array(measured.get_window_extent().size)
        measured.remove()
        for away, direction in product(_AWAY_PT, _DIRECTIONS):
            reach = away * pixels + np.min(size / 2 / np.maximum(np.abs(direction), 1e-9))
            low = at + reach * direction - size / 2
            box = Bbox([low, low + size])
            clear = not box.padded(3 * pixels).count_contains(marks)
            clear &= not box.count_overlaps(taken)
            if clear and axes.bbox.count_contains(box.corners()) == len(box.corners()):
                break
        taken.append(box)
        axes.annotate(
            name,
            point,
            reach * direction / pixels,
            textcoords="offset points",
            ha="center",
            va="center",
            arrowprops={"arrowstyle": "-", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 2},
        )


def _pixels(axes: Axes, line: Line2D) -> Array:
    """Return a line's marks, or a curve's points a pixel or so apart, in pixels, `(n, 2)`."""
    points = np.asarray(axes.transData.transform(line.get_xydata()))
    if line.get_linestyle() == "None":
        return points
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    finely = np.linspace(0, along[-1], int(along[-1]) + 2)
    return np.column_stack([np.interp(finely, along, own) for own in points.T])


def figure(tables: Mapping[int, pd.DataFrame], file: Path) -> None:
    """Draw the gaps of all entrants, the best first, one curve a budget; ours are named."""
    with mpl.rc_context({"font.size": 9}):
        drawing = Figure(figsize=(5.6, 4.0), layout="constrained")
        axes = drawing.subplots()
        points: dict[tuple[float, float], str] = {}
        for colour, (budget, own) in zip((SKY, BLACK), tables.items(), strict=False):
            ordered = own.sort_values("median gap")
            solved = ordered[np.isfinite(ordered["median gap"])]
            place = 100 * (np.arange(len(solved)) + 1) / len(ordered)
            percent = np.maximum(100 * solved["median gap"], 1e-4)
            axes.plot(place, percent, color=colour, label=f"{budget:,} evaluations")
            for name in OWN:
                if name in solved.index:
                    at = solved.index.get_loc(name)
                    point = (place[at], percent.iloc[at])
                    axes.plot(*point, "o", color=colour, ms=4)
                    points[point] = name
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlabel("share of the optimisers, best first, %")
        axes.set_ylabel("median gap to the proved best 3-5-3, %")
        axes.grid(alpha=0.3)
        axes.margins(y=0.08)
        axes.legend()
        write_names(drawing, points)
        drawing.savefig(file)


_LIBRARY_LOOKS = {"mealpy": (SKY, "o"), "pymoo": (VERMILION, "s"), "nevergrad": (GREEN, "^")}
_LIBRARY_LOOKS |= {"": (BLACK, "D")}  # ours, above the others


def carried(first: pd.DataFrame, others: pd.DataFrame, file: Path) -> float:
    """Draw each entrant's median gap on the other problems over that on six-axis; ours are named.

    Returns:
        Spearman's correlation of the two; a failure is the largest gap.
    """
    both = pd.DataFrame({"x": first["median gap"], "y": others["median gap"]}).dropna()
    drawn = 100 * both[np.isfinite(both).all(axis=1)].clip(lower=1e-6)
    correlation = float(spearmanr(both["x"].clip(upper=1e9), both["y"].clip(upper=1e9)).statistic)
    with mpl.rc_context({"font.size": 9}):
        drawing = Figure(figsize=(5.6, 4.0), layout="constrained")
        axes = drawing.subplots()
        libraries = drawn.index.map(lambda name: name.split()[0] if " " in name else "")
        for library, (colour, mark) in _LIBRARY_LOOKS.items():
            own = drawn[libraries == library]
            if len(own):
                label = library or "ours"
                axes.plot(own["x"], own["y"], mark, ms=4, color=colour, alpha=0.7, label=label)
        axes.set_xscale("log")
        axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlabel("median gap on six-axis, %")
        axes.set_ylabel("median gap on the other problems, %")
        axes.set_title(f"Spearman's rank correlation {correlation:.2f}")
        axes.grid(alpha=0.3)
        axes.legend()
        ours = drawn[libraries == ""]
        write_names(drawing, {(x, y): str(name) for name, (x, y) in ours.iterrows()})
        drawing.savefig(file)
    return correlation


if __name__ == "__main__":
    cyclopts.run(main)
