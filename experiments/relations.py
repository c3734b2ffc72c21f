"""Do the relations of docs/mathematics.md, section 8, hold on thousands of random problems?

    python -m experiments.relations                   # 2000 problems, half an hour on a core
    python -m experiments.relations --problems 20     # a quick look

A problem's rows go to `relations.csv` in `--output` as soon as they are known; running again does
only what is missing. The table counts violations by kind, each beyond its own tolerance. What could
not be checked (no answer, an exception, no time left) is a row of a kind "failed: …".
"""

from __future__ import annotations

import itertools
import multiprocessing
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd
import pebble

from baselines.lower_bound import certify
from baselines.ruckig_ import section
from baselines.topp_ra import along
from experiments.ordering import RELAXED, identities
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.registry import load

Checks = Iterator[tuple[str, float, float]]  # kind, relative excess, tolerance
Found = tuple[Trajectory | None, float]  # with its certified duration, NaN where there is none

SPLINES = "spline353-nlp:starts=2 unoptimised pso:fitness=scaled,iterations=40"
OTHERS = "collocation toppra:gridpoints=300 ruckig:evaluations=600 ruckig-stop"
SPECS = f"exact:starts=4 exact-jerk:starts=2 {SPLINES} {OTHERS}".split()
PLANNERS = {spec.partition(":")[0]: load(spec) for spec in SPECS}
THEOREM = 1e-6  # what solvers' tolerances are worth
SECTIONS = 1e-5  # what dividing the states by 1 + 1e-6 is worth
GRID = 5e-2  # what 300 gridpoints are worth where a joint reaches its velocity within one step
STIFF = 1e5  # jerk over acceleration, 1/s
COLUMNS, DONE = ["problem", "kind", "excess", "tolerance"], "seconds"  # a problem's last kind


def drawn(seed: int) -> Problem:
    """Mostly 1–3 joints and 2–5 waypoints, one in 25 of any size; jerk limited if `seed` is odd."""
    rng, size = np.random.default_rng([8, seed]), {}
    if seed % 25:
        size["joints"] = rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2])
        size["waypoints"] = rng.choice([2, 3, 4, 5], p=[0.2, 0.4, 0.25, 0.15])
    problem = random_problem(seed, jerk=bool(seed % 2), **size)
    jerk = problem.limits.jerk * [1.0, 1.0 if seed % 3 else 0.6]
    return replace(problem, limits=replace(problem.limits, jerk=jerk))


@lru_cache(maxsize=64)
def answer(name: str, problem: Problem) -> Found:
    return certified(problem, PLANNERS[name].solve(problem).trajectory)


def certified(problem: Problem, trajectory: Trajectory | None) -> Found:
    duration = verify(problem, trajectory).certified_duration if trajectory else None
    return trajectory, duration or np.nan


def relations(problem: Problem, seed: int) -> Checks:
    """No planner beats the optimum, symmetries change nothing, and what only one kind can do."""
    best = "exact-jerk" if problem.has("jerk") else "exact"
    able = [name for name, planner in PLANNERS.items() if not planner.unsupported(problem)]
    pairs = [(best, name) for name in able if not name.startswith("exact")]
    pairs += [("spline353-nlp", name) for name in ("unoptimised", "pso") if name in able]
    for low, high in [*pairs, ("ruckig", "ruckig-stop")]:
        yield f"{low} <= {high}", answer(low, problem)[1] / answer(high, problem)[1] - 1, THEOREM
    for kind, factor, other in alike(problem, seed)[seed // 2 % 8 :][:1]:  # every second problem
        for name in {best, "ruckig-stop", "spline353-nlp"} & set(able):
            change = factor * answer(name, other)[1] / answer(name, problem)[1] - 1
            yield f"{kind} {name}", abs(change), THEOREM
    yield from (jerky if problem.has("jerk") else free)(problem, able, seed)


def alike(problem: Problem, seed: int) -> list[tuple[str, float, Problem]]:
    """Problems whose minimum time, times the factor, is this one's."""
    q, c, limits = problem.waypoints, 3.7, problem.limits
    v, a, j = rates = limits.velocity, limits.acceleration, limits.jerk
    order = np.random.default_rng(seed).permutation(problem.joints)
    even = np.arange(problem.joints) % 2 == 0
    mirrored = [np.where(even[:, None], -x[:, ::-1], x) for x in rates]
    return [
        ("scaling", c, Problem(q, Limits(c * v, c**2 * a, c**3 * j))),
        ("permuting", 1.0, Problem(q[:, order], Limits(*(x[order] for x in rates)))),
        ("mirroring", 1.0, Problem(q * (1 - 2 * even), Limits(*mirrored))),
        ("reversing", 1.0, Problem(q[::-1], Limits(-v[:, ::-1], a, -j[:, ::-1]))),
    ]


def free(problem: Problem, able: list[str], seed: int) -> Checks:
    """The exact optimum in other ways; paths timed anew, up to the grid; a certificate."""
    for kind, _, excess in identities(problem):
        yield kind, excess, SECTIONS if kind.startswith("Ruckig") else RELAXED + THEOREM
    for name in set(able) - {"exact-jerk", "toppra", "pso"}:
        trajectory, own = answer(name, problem)
        if trajectory:
            again = along(problem, trajectory, gridpoints=300).trajectory
            yield f"TOPP-RA along {name} <= {name}", certified(problem, again)[1] / own - 1, GRID
    if seed % 10 == 0:
        bound = certify(problem, time_limit=5.0).lower_bound
        yield "proved bound <= exact", bound / answer("exact", problem)[1] - 1, THEOREM


def jerky(problem: Problem, _: list[str], seed: int) -> Checks:
    """Exact without jerk limits and with ever stiffer ones; Ruckig, whose own are symmetric."""
    exact = answer("exact", problem.without("jerk"))[1]
    trajectory, duration = answer("exact-jerk", problem)
    yield "exact <= exact-jerk", exact / duration - 1, THEOREM
    if seed % 10 == 1:
        limits = replace(problem.limits, jerk=STIFF * problem.limits.acceleration)
        stiff = answer("exact-jerk", replace(problem, limits=limits))[1]
        # In every segment acceleration may change sign, over at most (1 + 10^0.5)/STIFF seconds.
        yield "exact-jerk -> exact", stiff / exact - 1, 5 * problem.segments / STIFF / exact
        yield "exact <= exact-jerk (stiff)", exact / stiff - 1, THEOREM
    if seed % 3 and trajectory:
        yield "Ruckig by segments = exact-jerk", by_segments(problem, trajectory), SECTIONS
    if seed % 3 and problem.segments == 1:
        change = duration / answer("ruckig-stop", problem)[1] - 1
        yield "exact-jerk = ruckig-stop (2 waypoints)", abs(change), THEOREM


def by_segments(problem: Problem, trajectory: Trajectory) -> float:
    """How far Ruckig is from a trajectory's segment times, over its whole duration.

    From states divided by `1 + 1e-6`; from nearer ones where that leaves what a tiny segment can
    reach.
    """
    times, apart = trajectory.waypoint_times, []
    for shift in (RELAXED, 1e-9):
        rates = (trajectory(times, order) / (1 + shift) for order in (1, 2))
        states = itertools.pairwise(zip(problem.waypoints, *rates, strict=True))
        ruckig = [section(problem.limits, *ends)[0] for ends in states]
        apart.append(np.abs(ruckig - np.diff(times)))
    return float(np.min(apart, axis=0).max() / times[-1])


def checked(seed: int) -> pd.DataFrame:
    """All rows of one problem; an exception is one of them."""
    began, problem, rows = time.perf_counter(), drawn(seed), []
    mark = " (jerk)" if problem.has("jerk") else ""
    try:
        for kind, excess, tolerance in relations(problem, seed):
            failed = "" if np.isfinite(excess) else "failed: "
            rows.append((seed, f"{failed}{kind}{mark}", excess, tolerance))
    except Exception as error:
        rows.append((seed, f"failed: {error!r}", np.inf, 0.0))
    rows.append((seed, DONE, time.perf_counter() - began, np.inf))
    return pd.DataFrame(rows, columns=COLUMNS)


def run(seeds: list[int], jobs: int) -> Iterator[pd.DataFrame]:
    """The rows of each problem, whatever happens to the process that computes them."""
    context = multiprocessing.get_context("spawn")  # forking loaded solvers is not safe
    pool = pebble.ProcessPool(max_workers=jobs, context=context)
    try:
        for seed, future in [(s, pool.schedule(checked, [s], timeout=300.0)) for s in seeds]:
            error = future.exception()
            lost = [(seed, f"failed: {error!r}", np.inf, 0.0), (seed, DONE, np.nan, np.inf)]
            yield pd.DataFrame(lost, columns=COLUMNS) if error else future.result()
    finally:
        pool.stop()  # type: ignore[no-untyped-call]
        pool.join()


def known(file: Path) -> pd.DataFrame:
    """The rows of finished problems; those of one that was cut short leave the file."""
    rows = pd.read_csv(file) if file.exists() else pd.DataFrame(columns=COLUMNS)
    rows = rows[rows["problem"].isin(rows.loc[rows["kind"] == DONE, "problem"])]
    rows.to_csv(file, index=False)
    return rows


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Per kind: how often checked, how often beyond its tolerance, the worst, and where."""
    rows = rows[rows["kind"] != DONE].fillna({"excess": np.inf})
    broken = (rows["excess"] > rows["tolerance"]).groupby(rows["kind"]).sum()
    worst = rows.loc[rows.groupby("kind")["excess"].idxmax()].set_index("kind")
    counts = {"checked": rows["kind"].value_counts(), "violations": broken}
    return pd.DataFrame(counts | {"worst": worst["excess"], "problem": worst["problem"]})


def main(problems: int = 2000, jobs: int = 1, output: Path = Path("results/relations")) -> None:
    """Check the relations on every problem and print the table."""
    output.mkdir(parents=True, exist_ok=True)
    file = output / "relations.csv"
    missing = sorted(set(range(problems)) - set(known(file)["problem"]))
    with console.progress(problems) as advance:
        advance(problems - len(missing))
        for rows in run(missing, jobs):
            rows.to_csv(file, mode="a", header=False, index=False)
            advance(1)
    print(table(known(file)).to_string(float_format=lambda x: f"{x:.1e}"))


if __name__ == "__main__":
    cyclopts.run(main)
