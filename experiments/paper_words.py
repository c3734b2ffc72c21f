"""What do the paper's words measure: smooth, diverse, robust?

    python -m experiments.paper_words             # 20 seeds, 1000 iterations
    python -m experiments.paper_words --quick     # small; not meaningful

The paper calls its motions smoother and without abrupt changes, its start diverse and balanced,
and its search robust. It defines none of these words. Here they are:

- abrupt changes: jumps of the acceleration and of the jerk of one joint, the largest; the start
  from rest and the end at rest count. Beside them the largest |jerk|, and ∫ jerk² of all joints.
- diversity: the standard deviation of the population's segment times in % of the box, mean of the
  three times, median over seeds; after the first population and after some iterations.
- balance: the centred L2 discrepancy of the first population in the unit cube. Smaller is more
  even.
- robustness: the share of runs that end within 1 % and within 0.1 % of the shortest 3-5-3.

Tables in `--output`: `smoothness`, `diversity`, `robustness`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd
from scipy.stats import qmc

from experiments.common.output import progress, save_table
from experiments.paper.figures import solved
from experiments.paper.kept_searches import budget
from trajopt import Problem, Trajectory
from trajopt.benchmark.suites import catalogue as suite
from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.judging.smoothness import smoothness
from trajopt.planners import spline353
from trajopt.planners.swarm import ISSA, PSO, SSA, Compared, Optimiser, minimise
from trajopt.planners.swarm.ssa import Flock, Move
from trajopt.planners.swarm_planner import SwarmPlanner, Unoptimised

Seen = Callable[[Array], None]
OTHERS = {
    "best quintic, 5-5-5": "spline:degree=5",
    "best septic, 7-7-7": "spline:degree=7",
    "exact optimum": "exact",
}
AFTER = (0, 1, 10, 100, 900)  # iterations


@dataclass(frozen=True)
class WatchedSSA(SSA):
    """SSA that shows its flock before each iteration."""

    seen: Seen = print

    def _discover(self, flock: Flock) -> Move:
        self.seen(flock.x)
        return super()._discover(flock)


@dataclass(frozen=True)
class WatchedISSA(ISSA):
    """ISSA that shows its flock before each iteration."""

    seen: Seen = print

    def _discover(self, flock: Flock) -> Move:
        self.seen(flock.x)
        return super()._discover(flock)


SEARCHES: Mapping[str, Callable[[Seen], Optimiser]] = {
    "PSO": lambda seen: PSO(),
    "SSA": lambda seen: WatchedSSA(seen=seen),
    "ISSA": lambda seen: WatchedISSA(seen=seen),
    "ISSA, eq. 43 as printed": lambda seen: WatchedISSA(seen=seen, eq43="printed"),
    "ISSA, random start": lambda seen: WatchedISSA(seen=seen, chaos=False),
}


@dataclass(frozen=True, eq=False)
class Watched:
    """What a search showed: `populations` after 0, 1, … iterations, in the unit cube.

    Attributes:
        times: Segment times that each run ended with, `(seeds, 3)`, s.
        first: The first populations, `(seeds, population, 3)`, in the unit cube.
        spread: Standard deviations over the population, mean of the times, in % of the box,
            `(iterations, seeds)`.
    """

    times: Array
    first: Array
    spread: Array


def watched(name: str, problem: Problem, seeds: int, iterations: int) -> Watched:
    """Run a search of `SEARCHES` with shared times and the paper's population."""
    planner = SwarmPlanner()
    task = planner.task(problem)
    low, high = task.box(seeds)
    shown: list[Array] = []

    def seen(x: Array) -> None:
        unit = (x - low[:, None]) / (high - low)[:, None]
        if not shown:
            first.append(unit)
        shown.append(100 * unit.std(axis=1).mean(axis=1))

    first: list[Array] = []
    optimiser = SEARCHES[name](seen)

    def fitness(x: Array, incumbent: Array | None) -> Array:
        if isinstance(optimiser, PSO):  # its candidates are its population
            seen(x)
        return task.fitness(x, incumbent)

    streams = task.streams(range(seeds))
    result = minimise(optimiser, Compared(fitness), low, high, streams, iterations=iterations)
    return Watched(result.position, first[0], np.array(shown))


def diversity(runs: Mapping[str, Watched]) -> pd.DataFrame:
    """Spread after some iterations, and how even the first population is: medians over seeds."""
    rows = []
    for name, own in runs.items():
        uneven = [qmc.discrepancy(unit) for unit in own.first]
        row: dict[str, object] = {"search": name, "unevenness of the start": np.median(uneven)}
        for after in AFTER:
            if after < len(own.spread):
                row[f"spread after {after}, %"] = np.median(own.spread[after])
        rows.append(row)
    return pd.DataFrame(rows)


def robustness(runs: Mapping[str, Watched], best: float) -> pd.DataFrame:
    """How many runs end near the shortest 3-5-3, and how far above it they end, %."""
    rows = []
    for name, own in runs.items():
        above = 100 * (own.times.sum(axis=1) / best - 1)
        row = {
            "search": name,
            "runs": len(above),
            "within 1 %": 100 * np.mean(above <= 1),
            "within 0.1 %": 100 * np.mean(above <= 0.1),
            "median above, %": np.median(above),
            "worst above, %": above.max(),
        }
        rows.append(row)
    return pd.DataFrame(rows)


def largest_jump(motion: Trajectory, order: int) -> float:
    """Return the largest jump of a joint's derivative, rad/s^order, from rest to rest."""
    pieces = motion.pieces(order)
    starts, stops = pieces[-1], pieces.sum(axis=0)
    still = np.zeros((1, motion.joints))
    return float(np.abs(np.vstack([starts, still]) - np.vstack([still, stops])).max())


def largest_jerk(motion: Trajectory) -> float:
    """Return the largest |jerk| of a joint, rad/s³."""
    pieces = motion.pieces(3).reshape(motion.pieces(3).shape[0], -1)
    at = polynomials.critical_points(pieces)
    return float(np.abs(polynomials.evaluate(pieces[:, None], at)).max())


def smooth(motions: Mapping[str, Trajectory], problem: Problem) -> pd.DataFrame:
    """Abrupt changes of motions, and their jerk."""
    rows = []
    for name, motion in motions.items():
        own = smoothness(problem, motion)
        jumps = own.jump is not None
        row = {
            "motion": name,
            "duration, s": motion.duration,
            "largest jump of acceleration, rad/s²": largest_jump(motion, 2) if jumps else 0.0,
            "largest jump of jerk, rad/s³": np.inf if jumps else largest_jump(motion, 3),
            "largest jerk, rad/s³": np.inf if jumps else largest_jerk(motion),
            "∫ jerk², rad²/s⁵": own.jerk_integral,
        }
        rows.append(row)
    return pd.DataFrame(rows)


def main(
    seeds: int = 20, *, quick: bool = False, output: Path = Path("results/paper_words")
) -> None:
    """Measure, and write and print the three tables.

    Args:
        seeds: How many runs of each search.
        quick: Four runs of 20 iterations.
        output: The folder.
    """
    seeds, iterations = budget(seeds, quick)
    problem = suite.load("six-axis")
    runs = {}
    with progress(len(SEARCHES), "searches") as advance:
        for name in SEARCHES:
            runs[name] = watched(name, problem, seeds, iterations)
            advance(1)
    best = solved(problem, "spline353-nlp")
    fixed = Unoptimised().solve(problem).trajectory
    assert fixed is not None
    motions = {"3-5-3, unoptimised": fixed, "best 3-5-3": best}
    for name in ("PSO", "SSA", "ISSA"):
        times = runs[name].times
        middle = np.argsort(times.sum(axis=1))[len(times) // 2]
        motions[f"3-5-3, {name}, median run"] = spline353.trajectory(problem, times[middle])
    motions |= {name: solved(problem, planner) for name, planner in OTHERS.items()}
    tables = {
        "smoothness": smooth(motions, problem),
        "diversity": diversity(runs),
        "robustness": robustness(runs, best.duration),
    }
    for name, table in tables.items():
        save_table(table, output / name)
        print(table.to_string(index=False, float_format="{:.5g}".format), end="\n\n")


if __name__ == "__main__":
    cyclopts.run(main)
