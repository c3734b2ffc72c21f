"""Published numbers of the paper, and searches kept on disk: what its two experiments share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from trajopt import Problem
from trajopt.core import built_in
from trajopt.core.arrays import Array
from trajopt.planners.planner import Planner
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.analysis import statistics

ALGORITHMS = ("pso", "ssa", "issa")
NAMES = {"pso": "PSO", "ssa": "SSA", "issa": "ISSA"}
TOGETHER = -1  # instead of a joint's number: all joints at once


def budget(seeds: int, quick: bool) -> tuple[int, int]:
    """Return runs of each search, and iterations of a run: the paper's, or few if `quick`."""
    return (4, 20) if quick else (seeds, 1000)


def reference(name: str) -> pd.DataFrame:
    """A published table, `data/reference/*.csv`."""
    folder = built_in.data_folder() / "reference"
    return pd.read_csv(folder / f"{name}.csv")


def running_times() -> dict[str, float]:
    """Published running times, s: `unoptimised`, `pso`, `ssa`, `issa`."""
    table = reference("running-times").set_index("algorithm")
    return dict(table["seconds"])


@dataclass(frozen=True, eq=False)
class Runs:
    """All seeds of one search.

    - `times` `(seeds, joints, 3)`: segment times, s; NaN for joints that never move;
    - `history` `(m, 4)`: seed, joint (from 0, or `TOGETHER`), evaluations, best duration, s.
    """

    times: Array
    history: Array

    def curves(self, joint: int = TOGETHER) -> list[Array]:
        """Per seed `(m, 2)`: evaluations of that joint's search, and its best duration, s."""
        of_joint = self.history[:, 1] == joint
        own = self.history[of_joint]
        curves = []
        for seed in range(len(self.times)):
            of_seed = own[:, 0] == seed
            curves.append(own[of_seed, 2:])
        return curves


Search = tuple[str, str]  # algorithm, timing
Found = dict[Search, Runs]


def stored(file: Path, search: Callable[[], Runs]) -> Runs:
    """The runs in a file, searched for and written whole if it is not there."""
    if not file.exists():
        runs = search()
        part = file.with_suffix(".part.npz")
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(part, times=runs.times, history=runs.history)
        part.replace(file)
    with np.load(file) as arrays:
        return Runs(arrays["times"], arrays["history"])


def swarm(planner: Planner, problem: Problem, seeds: int) -> Runs:
    """Runs of the toolkit's swarm planner, seeds from 0."""
    assert isinstance(planner, SwarmPlanner)
    times = []
    histories = []
    solutions = planner.solve_batch(problem, range(seeds))
    for seed, solution in enumerate(solutions):
        stats = solution.stats
        if solution.history is None:
            curves = stats["joint_history"]
            own_times = stats["joint_times"]
        else:
            curves = np.insert(solution.history, 0, TOGETHER, axis=1)
            own_times = np.tile(stats["segment_times"], (problem.joints, 1))
        history = np.insert(curves, 0, seed, axis=1)
        histories.append(history)
        times.append(own_times)
    return Runs(np.array(times), np.concatenate(histories))


def interval(values: Sequence[float] | Array) -> statistics.Estimate:
    """Median over seeds with its 95 % bootstrap interval; of a single value, the value."""
    sample = np.asarray(values)
    if len(sample) == 1:
        sample = np.repeat(sample, 2)
    return statistics.bootstrap(statistics.median, sample)


def percent_below(ours: Array, others: Array) -> statistics.Values:
    """By how many percent the median of ours `(…, runs)` is below the others'."""
    other = np.maximum(statistics.median(others), 1e-9)
    ratio = statistics.median(ours) / other
    percent = np.asarray(100 * (1 - ratio))
    return percent[()]
