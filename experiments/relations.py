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
from numpy.typing import NDArray

from baselines.lower_bound import certify
from baselines.ruckig_ import section
from baselines.topp_ra import along
from experiments.ordering import RELAXED, identities
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.registry import load

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
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
COLUMNS = ["problem", "kind", "excess", "tolerance"]
DONE = "seconds"  # a problem's last kind


def drawn(seed: int) -> Problem:
    """Mostly 1–3 joints and 2–5 waypoints, one in 25 of any size; jerk limited if `seed` is odd."""
    rng = np.random.default_rng([8, seed])
    joints = None
    waypoints = None
    if seed % 25:
        joints = rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2])
        waypoints = rng.choice([2, 3, 4, 5], p=[0.2, 0.4, 0.25, 0.15])
    problem = random_problem(seed, joints=joints, waypoints=waypoints, jerk=bool(seed % 2))
    # Every third problem's jerk limits are asymmetric.
    upwards = 1.0 if seed % 3 else 0.6
    jerk = problem.limits.jerk * [1.0, upwards]
    return replace(problem, limits=replace(problem.limits, jerk=jerk))


@lru_cache(maxsize=64)
def answer(name: str, problem: Problem) -> Found:
    return certified(problem, PLANNERS[name].solve(problem).trajectory)


def certified(problem: Problem, trajectory: Trajectory | None) -> Found:
    if trajectory is None:
        return None, np.nan
    return trajectory, verify(problem, trajectory).certified_duration or np.nan


def duration(name: str, problem: Problem) -> float:
    """A planner's certified duration, s; NaN without one."""
    return answer(name, problem)[1]


def above(own: float, other: float) -> float:
    """How far a duration lies above another, relative."""
    return own / other - 1


def relations(problem: Problem, seed: int) -> Checks:
    """No planner beats the optimum, symmetries change nothing, and what only one kind can do."""
    jerk = problem.has("jerk")
    best = "exact-jerk" if jerk else "exact"
    able = [name for name, planner in PLANNERS.items() if not planner.unsupported(problem)]
    pairs = [(best, name) for name in able if not name.startswith("exact")]
    pairs += [("spline353-nlp", name) for name in ("unoptimised", "pso") if name in able]
    pairs.append(("ruckig", "ruckig-stop"))
    for low, high in pairs:
        excess = above(duration(low, problem), duration(high, problem))
        yield f"{low} <= {high}", excess, THEOREM
    # One of the four symmetries, on every second problem.
    for kind, factor, other in alike(problem, seed)[seed // 2 % 8 :][:1]:
        for name in {best, "ruckig-stop", "spline353-nlp"} & set(able):
            change = above(factor * duration(name, other), duration(name, problem))
            yield f"{kind} {name}", abs(change), THEOREM
    more = jerky if jerk else free
    yield from more(problem, able, seed)


def alike(problem: Problem, seed: int) -> list[tuple[str, float, Problem]]:
    """Problems whose minimum time, times the factor, is this one's."""
    q = problem.waypoints
    v = problem.limits.velocity
    a = problem.limits.acceleration
    j = problem.limits.jerk
    # V c, A c², J c³ divide the duration by c.
    c = 3.7
    scaled = Limits(c * v, c**2 * a, c**3 * j)
    order = np.random.default_rng(seed).permutation(problem.joints)
    permuted = Limits(v[order], a[order], j[order])
    # Every other joint mirrored: its limits change sides.
    even = np.arange(problem.joints) % 2 == 0
    mirrored = Limits(_sides_changed(v, even), _sides_changed(a, even), _sides_changed(j, even))
    # Backwards in time velocity and jerk change signs.
    reversed_ = Limits(-v[:, ::-1], a, -j[:, ::-1])
    return [
        ("scaling", c, Problem(q, scaled)),
        ("permuting", 1.0, Problem(q[:, order], permuted)),
        ("mirroring", 1.0, Problem(q * (1 - 2 * even), mirrored)),
        ("reversing", 1.0, Problem(q[::-1], reversed_)),
    ]


def _sides_changed(pairs: Array, some: Mask) -> Array:
    return np.where(some[:, None], -pairs[:, ::-1], pairs)


def free(problem: Problem, able: list[str], seed: int) -> Checks:
    """The exact optimum in other ways; paths timed anew, up to the grid; a certificate."""
    for kind, _, excess in identities(problem):
        tolerance = SECTIONS if kind.startswith("Ruckig") else RELAXED + THEOREM
        yield kind, excess, tolerance
    for name in set(able) - {"exact-jerk", "toppra", "pso"}:
        trajectory, own = answer(name, problem)
        if trajectory is None:
            continue
        again = along(problem, trajectory, gridpoints=300).trajectory
        _, retimed = certified(problem, again)
        yield f"TOPP-RA along {name} <= {name}", above(retimed, own), GRID
    if seed % 10 == 0:
        bound = certify(problem, time_limit=5.0).lower_bound
        yield "proved bound <= exact", above(bound, duration("exact", problem)), THEOREM


def jerky(problem: Problem, _: list[str], seed: int) -> Checks:
    """Exact without jerk limits and with ever stiffer ones; Ruckig, whose own are symmetric."""
    exact = duration("exact", problem.without("jerk"))
    trajectory, own = answer("exact-jerk", problem)
    yield "exact <= exact-jerk", above(exact, own), THEOREM
    if seed % 10 == 1:
        limits = replace(problem.limits, jerk=STIFF * problem.limits.acceleration)
        stiff = duration("exact-jerk", replace(problem, limits=limits))
        # In every segment acceleration may change sign, over at most (1 + 10^0.5)/STIFF seconds.
        slack = 5 * problem.segments / STIFF / exact
        yield "exact-jerk -> exact", above(stiff, exact), slack
        yield "exact <= exact-jerk (stiff)", above(exact, stiff), THEOREM
    symmetric = seed % 3 != 0
    if symmetric and trajectory is not None:
        yield "Ruckig by segments = exact-jerk", by_segments(problem, trajectory), SECTIONS
    if symmetric and problem.segments == 1:
        change = above(own, duration("ruckig-stop", problem))
        yield "exact-jerk = ruckig-stop (2 waypoints)", abs(change), THEOREM


def by_segments(problem: Problem, trajectory: Trajectory) -> float:
    """How far Ruckig is from a trajectory's segment times, over its whole duration.

    From states divided by `1 + 1e-6`; from nearer ones where that leaves what a tiny segment can
    reach.
    """
    times = trajectory.waypoint_times
    apart = []
    for shift in (RELAXED, 1e-9):
        velocities = trajectory(times, 1) / (1 + shift)
        accelerations = trajectory(times, 2) / (1 + shift)
        states = list(zip(problem.waypoints, velocities, accelerations, strict=True))
        ruckig = [section(problem.limits, a, b)[0] for a, b in itertools.pairwise(states)]
        apart.append(np.abs(ruckig - np.diff(times)))
    nearest = np.min(apart, axis=0)
    return float(nearest.max() / times[-1])


def checked(seed: int) -> pd.DataFrame:
    """All rows of one problem; an exception is one of them."""
    began = time.perf_counter()
    problem = drawn(seed)
    rows = []
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
        futures = [pool.schedule(checked, [seed], timeout=300.0) for seed in seeds]
        for seed, future in zip(seeds, futures, strict=True):
            error = future.exception()
            if error is None:
                yield future.result()
            else:
                lost = (seed, f"failed: {error!r}", np.inf, 0.0)
                done = (seed, DONE, np.nan, np.inf)
                yield pd.DataFrame([lost, done], columns=COLUMNS)
    finally:
        pool.stop()  # type: ignore[no-untyped-call]
        pool.join()


def known(file: Path) -> pd.DataFrame:
    """The rows of finished problems; those of one that was cut short leave the file."""
    rows = pd.DataFrame(columns=COLUMNS)
    if file.exists():
        rows = pd.read_csv(file)
    done = rows.loc[rows["kind"] == DONE, "problem"]
    rows = rows[rows["problem"].isin(done)]
    rows.to_csv(file, index=False)
    return rows


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Per kind: how often checked, how often beyond its tolerance, the worst, and where."""
    rows = rows[rows["kind"] != DONE].fillna({"excess": np.inf})
    beyond = rows["excess"] > rows["tolerance"]
    highest = rows.groupby("kind")["excess"].idxmax()
    worst = rows.loc[highest].set_index("kind")
    columns = {
        "checked": rows["kind"].value_counts(),
        "violations": beyond.groupby(rows["kind"]).sum(),
        "worst": worst["excess"],
        "problem": worst["problem"],
    }
    return pd.DataFrame(columns)


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
