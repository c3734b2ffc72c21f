"""Does the ordering of docs/mathematics.md, section 8, hold on random problems?

    python -m experiments.ordering                    # 300 problems, about ten minutes on two cores
    python -m experiments.ordering --problems 5       # a quick look

Every planner runs on every problem (the swarms where there are four waypoints, with two seeds), the
trials go to `--output`, and running again does only what is missing. Then every relation is
checked on every problem, and the violations beyond 1e-6 are counted and listed.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from baselines.exact.acceleration import Exact
from baselines.ruckig_ import section
from baselines.topp_ra import along
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark import compare as run
from trajopt.benchmark.analysis.results import Results
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.registry import entries, load

SPLINES = ("unoptimised", "pso", "ssa", "issa")
RELAXED = 1e-6  # of the limits, or of the waypoint velocities: keeps rounding off a longer branch


def orderings(results: Results) -> Iterator[tuple[str, str, float]]:
    """`(relation, problem, excess)` for every pair of trials whose durations must be ordered."""
    for _, rows in results.trials().groupby("digest"):
        problem = rows["problem"].iloc[0]
        best = rows.groupby("planner")["certified_duration"].min().dropna()
        pairs = [("exact", name) for name in best.index if name != "exact"]
        pairs.append(("ruckig", "ruckig-stop"))
        pairs += [("spline353-nlp", name) for name in SPLINES]
        for low, high in pairs:
            if low in best.index and high in best.index:
                yield f"{low} <= {high}", problem, best[low] / best[high] - 1


def identities(problem: Problem) -> Iterator[tuple[str, str, float]]:
    """The exact optimum reproduced by TOPP-RA along its path, and by Ruckig segment by segment."""
    trajectory = Exact().solve(problem).trajectory
    if trajectory is None:
        yield "exact finds an answer", problem.name, np.inf
        return
    limits = problem.limits
    wider = Limits(limits.velocity * (1 + RELAXED), limits.acceleration * (1 + RELAXED))
    relaxed = Problem(problem.waypoints, wider)
    own = along(relaxed, trajectory, start_speed=1.0, end_speed=1.0).trajectory
    yield "TOPP-RA along exact = exact", problem.name, _difference(own, trajectory)
    certificate = verify(problem, trajectory)
    yield "exact is exact to 1e-6", problem.name, certificate.dilation - 1
    times = _section_times(problem, trajectory)
    difference = np.abs(times - np.diff(trajectory.waypoint_times)).max()
    yield "Ruckig by segments = exact", problem.name, float(difference / trajectory.duration)


def _difference(a: Trajectory | None, b: Trajectory) -> float:
    if a is None:
        return np.inf
    return abs(a.duration / b.duration - 1)


def _section_times(problem: Problem, trajectory: Trajectory) -> np.ndarray:
    velocities = trajectory(trajectory.waypoint_times, order=1) / (1 + RELAXED)
    states = [(q, v, 0 * v) for q, v in zip(problem.waypoints, velocities, strict=True)]
    return np.array([section(problem.limits, a, b)[0] for a, b in itertools.pairwise(states)])


def table(found: list[tuple[str, str, float]]) -> pd.DataFrame:
    """Per relation: how often checked, how often broken beyond 1e-6 and 1e-5, worst and where."""
    frame = pd.DataFrame(found, columns=["relation", "problem", "excess"])
    groups = frame.groupby("relation")["excess"]
    worst = frame.loc[groups.idxmax()].set_index("relation")
    columns = {"checked": groups.size()}
    for threshold in (1e-6, 1e-5):
        above = frame["excess"] > threshold
        columns[f"above {threshold:g}"] = above.groupby(frame["relation"]).sum()
    columns["worst"] = worst["excess"]
    columns["at"] = worst["problem"]
    return pd.DataFrame(columns)


def main(problems: int = 300, jobs: int = 2, output: Path = Path("results/ordering")) -> None:
    """Run the study and print its table; also written to `ordering.csv` in `output`."""
    drawn = [random_problem(seed) for seed in range(problems)]
    registered = [(name, load(name)) for name in entries()]
    planners = [(name, planner) for name, planner in registered if not planner.on_request]
    with console.trials() as advance:
        results = run.compare(drawn, planners, output, seeds=2, jobs=jobs, progress=advance)
    found = list(orderings(results))
    with console.progress(problems) as advance:
        for problem in drawn:
            found += identities(problem)
            advance(1)
    summary = table(found)
    summary.to_csv(output / "ordering.csv")
    print(summary.to_string(float_format=lambda x: f"{x:.1e}"))


if __name__ == "__main__":
    cyclopts.run(main)
