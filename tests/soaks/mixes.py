"""Is an answer to mixed demands certified, monotone, and as short as the parts of its motion?

    python tests/soak.py mixes                 # 1000 problems, hours on a core
    python tests/soak.py mixes --first 5000    # others
    python tests/soak.py mixes --step 2 --wider-every 20 --cut-every 4    # fewer relations
    python tests/soak.py mixes --quick         # 6 problems

Random problems ask for two to five things at once: tolerances that may overlap, least or given
times, waits, a loop, states in motion at either end, limits per segment; every other one has jerk
limits. Three relations are checked:

- An answer is `solved` if and only if the judge certifies its motion.
- A wider tolerance, wider limits and smaller least times never take longer, alone or in pairs.
- The motion is cut in its own state: at a random instant, at a controller's cycle, a millisecond
  after its start and before its end. Each part is planned anew, and takes no longer than it took.

Each row of `mixes-rows.csv` is written when it is known, so a run that is stopped has lost nothing;
after Ctrl-C its summary follows. Exit code 1 if a relation does not hold.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from experiments.common.output import say
from soaks import soak_report
from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites import mixes
from trajopt.core.exceptions import InvalidInput
from trajopt.core.solution import Solution, Status

THEOREM = 1e-6  # relative; tolerance of solvers
CYCLE_S = 1e-3
WIDER = 1.3

Check = tuple[str, str, float]  # relation, problem, relative excess


def drawn(seed: int) -> Problem:
    """Return random problem number `seed`: 1 to 3 joints, 3 to 5 waypoints."""
    rng = np.random.default_rng([777, seed])
    joints, segments = int(rng.integers(1, 4)), int(rng.integers(2, 5))
    steps = np.vstack([rng.uniform(-1, 1, joints), rng.normal(0, 0.8, (segments, joints))])
    V, A = rng.uniform(0.5, 3, joints), rng.uniform(1, 8, joints)
    J = A * rng.uniform(4, 30, joints) if seed % 2 else None
    base = Problem(np.cumsum(steps, axis=0), Limits(V, A, J))
    return mixes.mixed(base, rng, f"mix-{seed}")


def solved(problem: Problem) -> tuple[Solution, float]:
    """Return the answer and its certified duration, s; NaN without one."""
    planner = ExactJerk() if problem.has("jerk") else Exact()
    solution = planner.solve(problem)
    if solution.trajectory is None:
        return solution, np.nan
    return solution, verify(problem, solution.trajectory).certified_duration or np.nan


def checks(seed: int, *, widened: bool = True, cut: bool = True) -> Iterator[Check]:
    """Yield every check of a problem: of its answer, of wider demands, of its motion's parts."""
    problem = drawn(seed)
    solution, duration = solved(problem)
    is_solved = solution.status is Status.SOLVED
    yield "solved is certified", problem.name, 0.0 if is_solved != np.isnan(duration) else np.inf
    if np.isnan(duration):
        is_proved = solution.status is Status.INFEASIBLE
        yield "answered, or proved infeasible", problem.name, 0.0 if is_proved else np.inf
        return
    if widened:
        yield from monotone(problem, seed, duration)
    if cut:
        yield from parts(problem, seed)


def monotone(problem: Problem, seed: int, duration: float) -> Iterator[Check]:
    """Yield the checks of wider demands and limits, alone and in pairs."""
    rng = np.random.default_rng([779, seed])
    for key, own in wider(problem):
        alone = solved(own)[1]
        yield f"a wider {key} never lengthens", problem.name, alone / duration - 1
        _, both = list(wider(own))[rng.integers(2)]
        yield "two wider ones never lengthen", problem.name, solved(both)[1] / alone - 1


def parts(problem: Problem, seed: int) -> Iterator[Check]:
    """Yield the checks of the parts into which the motion is cut."""
    whole = replace(problem, demands=mixes.inherited(problem))
    solution, duration = solved(whole)
    motion = solution.trajectory
    if motion is None or abs(motion.duration / duration - 1) > THEOREM:
        return
    rng = np.random.default_rng([778, seed])
    instant, cycle = rng.uniform(0.02, 0.98, 2) * motion.duration
    cuts = {
        "at random": instant,
        "at a controller's cycle": round(cycle / CYCLE_S) * CYCLE_S,
        "a cycle after the start": CYCLE_S,
        "a cycle before the end": motion.duration - CYCLE_S,
    }
    for words, at in cuts.items():
        if np.abs(motion.waypoint_times - at).min() < 1e-6 or not 0 < at < motion.duration:
            continue
        try:
            both = mixes.halves(whole, motion, at)
        except InvalidInput:  # a part that stands still is no problem
            continue
        for part, own in zip(both, (at, motion.duration - at), strict=True):
            yield f"cut {words}", part.name, solved(part)[1] / own - 1


def wider(problem: Problem) -> Iterator[tuple[str, Problem]]:
    """Yield the problem with one demand or limit that asks less."""
    for key, factor in (("tolerance", WIDER), ("least_times", 1 / WIDER)):
        if key in problem.demands:
            demands = {**problem.demands, key: factor * problem.demands[key]}
            with suppress(InvalidInput):  # within a tolerance so wide no motion is needed
                yield key, replace(problem, demands=demands)
    for key in ("velocity", "acceleration"):
        yield key, replace(problem, limits=problem.limits.widened(key, None, WIDER - 1))


def answered(seed: int, **asked: bool) -> Iterator[Check]:
    """Yield the checks of a problem; an error is one that does not hold."""
    try:
        yield from checks(seed, **asked)
    except Exception as error:  # whatever it is, the other problems count
        yield "no error", f"mix-{seed}: {error!r:.200}", np.inf


def written(file: Path, seeds: range, wider_every: int, cut_every: int) -> None:
    """Write a row per check as soon as it is known, with the CPU time that it took, s."""
    with file.open("w", newline="", encoding="utf-8") as open_file:
        rows = csv.writer(open_file)
        rows.writerow(["family", "problem", "excess", "cpu_s"])
        for k, seed in enumerate(seeds):
            asked = {"widened": k % wider_every == 0, "cut": k % cut_every == 0}
            limits = f"with{'' if drawn(seed).has('jerk') else 'out'} jerk limits"
            began = time.process_time()
            for relation, problem, excess in answered(seed, **asked):
                now = time.process_time()
                rows.writerow([f"{relation}, {limits}", problem, excess, f"{now - began:.3g}"])
                open_file.flush()
                began = now


def main(
    problems: int = 1000,
    first: int = 0,
    step: int = 1,
    wider_every: int = 1,
    cut_every: int = 1,
    output: Path = Path("results/mixes"),
    quick: bool = False,
) -> None:
    """Check the relations on each problem, and print how often each holds.

    Args:
        problems: How many; 6 at most if `quick`.
        first: The seed of the first one.
        step: From a seed to the next; with 2 all have jerk limits, or none.
        wider_every: Which problems are asked with wider demands too: 10 for every tenth.
        cut_every: Which motions are cut.
        output: Folder of the tables.
        quick: Few problems.
    """
    count = min(problems, 6) if quick else problems
    say(f"{count} problems in all")
    output.mkdir(parents=True, exist_ok=True)
    file = output / "mixes-rows.csv"
    seeds = range(first, first + count * step, step)
    with suppress(KeyboardInterrupt):
        written(file, seeds, wider_every, cut_every)
    found = pd.read_csv(file).sort_values("family", kind="stable")
    broken = ~(found["excess"] <= THEOREM)
    soak_report.conclude(found, broken, output / "mixes")
