"""How many problems of the suites are proved, and at what gap are the others open?

    python -m experiments.certificates                  # 220 problems, 20 s each at most
    python -m experiments.certificates --most-segments 5 --time-limit 60
    python -m experiments.certificates --only-open      # what no record in data/best_known proves

Every problem of the suites goes to `certify`; smaller ones come first. Closed means that no motion
is faster by 0.1 % or more than the fastest one known here. Into `--output` go the trials with
their proofs (`trajopt verify` checks them again, without a solver), and a row per problem in
`certificates.csv` as soon as it is known: running again does only what is missing. The tables say
how many problems are closed per suite and per kind of limits, `certificates.png` and `.svg` show
all gaps. `lifted` is what a bound leaves that ignores jerk and position limits, at best: the gap
to the fastest motion known without them.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from baselines.exact.acceleration import Exact
from baselines.lower_bound.planner import Certify
from experiments.common.output import save_table
from trajopt import Problem, verify
from trajopt.benchmark.best_known import records
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import judge
from trajopt.cli import console
from trajopt.core.problem import LIMIT_NAMES
from trajopt.views.figures import plots
from trajopt.views.figures.style import CURVES, MARKERS

CLOSED_WITHIN = 1e-3
ASKED_GAP = 5e-4
# Gaps below are drawn there, relative.
SMALLEST_GAP = 1e-4


def kind(problem: Problem) -> str:
    """The kinds of limits that count, by their initials: `va`, `vaj`, `vap`, `vajp`."""
    initials = [name[0] for name in LIMIT_NAMES if problem.has(name)]
    return "".join(initials)


def drawn_problems(fewest_segments: int, most_segments: int) -> Iterator[tuple[str, Problem]]:
    """Each problem of such sizes once, with the first suite that has it; smaller ones first."""
    first: dict[str, tuple[str, Problem]] = {}
    for name in suite.suites():
        for problem in suite.problems(name):
            first.setdefault(problem.digest(), (name, problem))
    by_size = sorted(
        first.values(),
        key=lambda pair: pair[1].displacements.size,
    )
    for name, problem in by_size:
        if fewest_segments <= problem.segments <= most_segments:
            yield name, problem


def lifted_gap(problem: Problem, upper_bound: float) -> float:
    """The best gap (relative) of a bound that knows velocity and acceleration limits alone."""
    free = problem.without("jerk", "position")
    trajectory = Exact().solve(free).trajectory
    if trajectory is None:
        return np.nan
    duration = verify(free, trajectory).certified_duration
    return np.nan if duration is None else upper_bound / duration - 1


def measured(
    name: str,
    problem: Problem,
    time_limit: float,
    output: Path,
) -> dict[str, object]:
    """One problem's row; its trial is kept in the output."""
    planner = Certify(within=ASKED_GAP, time_limit=time_limit)
    began = time.process_time()
    (trial,) = judge(planner, problem, [0], "certify")
    seconds = time.process_time() - began
    store.Store(output).write(trial)
    stats = trial.solution.stats
    upper_bound = float(stats.get("upper_bound", np.nan))
    return {
        "problem": problem.name,
        "digest": problem.digest(),
        "suite": name,
        "limits": kind(problem),
        "segments": problem.segments,
        "joints": int(problem.moving.sum()),
        "lower_bound": trial.solution.lower_bound,
        "upper_bound": upper_bound,
        "gap": float(stats.get("proved_within", np.nan)),
        "lifted_gap": lifted_gap(problem, upper_bound),
        "proof": stats.get("proof", trial.solution.message),
        "cpu_s": seconds,
    }


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Closed and open problems per suite, and per kind of limits."""
    return {column: counted(rows, column) for column in ("suite", "limits")}


def counted(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """Per value of a column: how many are closed, and at what gap (%) the others are open."""
    lines = []
    every = itertools.chain(rows.groupby(column), [("all", rows)])
    for value, own in every:
        gaps = own["gap"].fillna(np.inf)
        is_open = gaps >= CLOSED_WITHIN
        lifted = own["lifted_gap"].fillna(np.inf)
        line = {
            column: value,
            "problems": len(own),
            "closed": int((~is_open).sum()),
            "closed if lifted": int((lifted < CLOSED_WITHIN).sum()),
            "open": int(is_open.sum()),
            "open: median gap, %": 100 * gaps[is_open].median(),
            "open: worst gap, %": 100 * gaps[is_open].max(),
            "median CPU s": own["cpu_s"].median(),
        }
        lines.append(line)
    return pd.DataFrame(lines)


@plots.styled
def figure(rows: pd.DataFrame) -> Figure:
    """Gaps against the problem's size, a marker per kind of limits."""
    drawn = Figure(figsize=(5.4, 3.6), layout="constrained")
    axes = drawn.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    by_kind = rows.groupby("limits")
    for (name, own), colour, marker in zip(by_kind, CURVES, MARKERS, strict=False):
        size = own["segments"] * own["joints"]
        gaps = own["gap"].clip(lower=SMALLEST_GAP)
        axes.plot(
            size,
            100 * gaps,
            linestyle="none",
            marker=marker,
            color=colour,
            alpha=0.7,
            label=name,
        )
    axes.axhline(
        100 * CLOSED_WITHIN,
        color="0.5",
        linestyle=":",
    )
    axes.set_xlabel("segments × moving joints")
    axes.set_ylabel("gap between the bounds, %")
    axes.legend(title="limits")
    return drawn


def main(
    *,
    time_limit: float = 20.0,
    fewest_segments: int = 1,
    most_segments: int = 1000,
    only_open: bool = False,
    output: Path = Path("results/certificates"),
) -> None:
    """Prove what is missing, then write and print the tables.

    Args:
        time_limit: Seconds for each problem.
        fewest_segments: Smaller problems are left out.
        most_segments: Larger ones are left out.
        only_open: Those that the best known answers prove are left out.
        output: Where everything goes.
    """
    output.mkdir(parents=True, exist_ok=True)
    file = output / "certificates.csv"
    rows = []
    if file.exists():
        rows = pd.read_csv(file).to_dict("records")
    done = {row["digest"] for row in rows}
    missing = []
    for name, problem in drawn_problems(fewest_segments, most_segments):
        record = records.find(problem)
        is_closed = record is not None and record.closed
        left_out = only_open and is_closed
        if problem.digest() not in done and not left_out:
            missing.append((name, problem))
    with console.progress(len(missing), "problems") as advance:
        for name, problem in missing:
            row = measured(name, problem, time_limit, output)
            rows.append(row)
            pd.DataFrame(rows).to_csv(file, index=False)
            advance(1)
    every = pd.DataFrame(rows)
    for name, table in tables(every).items():
        save_table(table, output / f"by-{name}")
        print(table.to_string(index=False, float_format="{:.3g}".format), end="\n\n")
    plots.save(figure(every), output / "certificates")


if __name__ == "__main__":
    cyclopts.run(main)
