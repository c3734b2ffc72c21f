"""Published numbers of the paper, and searches kept on disk: what its two experiments share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from trajopt import Problem, spline353
from trajopt.benchmark.analysis import statistics
from trajopt.benchmark.suites import built_in
from trajopt.kinematics import Robot
from trajopt.planner import Planner
from trajopt.swarm_planner import SwarmPlanner

Array = NDArray[np.float64]

ALGORITHMS = ("pso", "ssa", "issa")
NAMES = {"pso": "PSO", "ssa": "SSA", "issa": "ISSA"}
MM = 1000.0  # per metre


def reference(name: str) -> pd.DataFrame:
    """A published table, `data/reference/*.csv`."""
    return pd.read_csv(built_in.data_folder() / "reference" / f"{name}.csv")


def running_times() -> dict[str, float]:
    """Published running times, s: `unoptimised`, `pso`, `ssa`, `issa`."""
    return dict(reference("running-times").set_index("algorithm")["seconds"])


@dataclass(frozen=True, eq=False)
class Runs:
    """All seeds of one search.

    - `times` `(seeds, joints, 3)`: segment times, s; NaN for joints that never move;
    - `history` `(m, 4)`: seed, joint (from 0; −1: all together), evaluations, best duration, s.
    """

    times: Array
    history: Array

    def curves(self, joint: int = -1) -> list[Array]:
        """Per seed `(m, 2)`: evaluations of that joint's search, and its best duration, s."""
        own = self.history[self.history[:, 1] == joint]
        return [own[own[:, 0] == seed, 2:] for seed in range(len(self.times))]


Found = dict[tuple[str, str], Runs]  # by algorithm and timing


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
    for seed, solution in enumerate(planner.solve_batch(problem, range(seeds))):
        stats = solution.stats
        if solution.history is None:
            curves = stats["joint_history"]
            own_times = stats["joint_times"]
        else:
            curves = np.insert(solution.history, 0, -1, axis=1)
            own_times = np.tile(stats["segment_times"], (problem.joints, 1))
        histories.append(np.insert(curves, 0, seed, axis=1))
        times.append(own_times)
    return Runs(np.array(times), np.concatenate(histories))


def alone(problem: Problem, times: Array, t: Array) -> Array:
    """Joint positions `(m, joints)` at `t` `(m,)` s, every joint on its own clock `(joints, 3)`.

    All start together; a joint that has arrived waits.
    """
    q = np.tile(problem.waypoints[0], (len(t), 1))
    for joint in np.flatnonzero(problem.moving):
        own = problem.only([joint])
        q[:, joint] = spline353.trajectory(own, times[joint])(t)[:, 0]
    return q


def tool_miss(robot: Robot, problem: Problem, times: Array) -> tuple[Array, Array]:
    """How far the tool is from each Cartesian point, mm `(4,)`, joints timed alone `(joints, 3)`.

    First when the slowest joint passes that point, then the least of the whole motion (at 2001
    instants).
    """
    points = _tool(robot, problem.waypoints)
    arrivals = np.nanmax(np.cumsum(times, axis=1), axis=0)
    passed = np.concatenate([[0.0], arrivals])
    instants = np.linspace(0.0, passed[-1], 2001)
    at = _tool(robot, alone(problem, times, passed))
    path = _tool(robot, alone(problem, times, instants))
    distances = np.linalg.norm(path[:, None] - points, axis=-1)
    nearest = distances.min(axis=0)
    return MM * np.linalg.norm(at - points, axis=-1), MM * nearest


def _tool(robot: Robot, q: Array) -> Array:
    """The tool's position at joint angles `(m, joints)`, `(m, 3)`, m."""
    poses = robot.forward(q)
    return poses[:, :3, 3]


def interval(values: Sequence[float] | Array) -> statistics.Estimate:
    """Median over seeds with its 95 % bootstrap interval; of a single value, the value."""
    copies = 2 if len(values) == 1 else 1
    return statistics.bootstrap(statistics.median, np.repeat(values, copies))


def percent_below(ours: Array, others: Array) -> statistics.Values:
    """By how many percent the median of ours `(…, runs)` is below the others'."""
    other = np.maximum(statistics.median(others), 1e-9)
    ratio = statistics.median(ours) / other
    return np.asarray(100 * (1 - ratio))[()]
