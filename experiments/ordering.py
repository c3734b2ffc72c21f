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
from trajopt import comparison as run
from trajopt.benchmark.suites.random import random_problem
from trajopt.cli import console
from trajopt.planners.registry import entries, load
from trajopt.views.analysis.results import Results

Check = tuple[str, str, float]  # relation, problem, excess (relative)

SPLINES = ("unoptimised", "pso", "ssa", "issa")
RELAXED = 1e-6  # of the limits, or of the waypoint velocities: keeps rounding off a longer branch


def orderings(results: Results) -> Iterator[Check]:
    """A check for every pair of trials whose durations must be ordered."""
    trials = results.trials()
    for _, rows in trials.groupby("digest"):
        problem = rows["problem"].iloc[0]
        durations = rows.groupby("planner")["certified_duration"].min()
        best = dict(durations.dropna())
        pairs = [("exact", name) for name in best if name != "exact"]
        pairs.append(("ruckig-search", "ruckig-stop"))
        pairs += [("spline353-nlp", name) for name in SPLINES]
        for low, high in pairs:
            if low in best and high in best:
                excess = best[low] / best[high] - 1
                yield f"{low} <= {high}", problem, excess


def identities(problem: Problem) -> Iterator[Check]:
    """The exact optimum reproduced by TOPP-RA along its path, and by Ruckig segment by segment."""
    trajectory = Exact().solve(problem).trajectory
    if trajectory is None:
        yield "exact finds an answer", problem.name, np.inf
        return
    yield "TOPP-RA along exact = exact", problem.name, _retimed(problem, trajectory)
    certificate = verify(problem, trajectory)
    yield "exact is exact to 1e-6", problem.name, certificate.dilation - 1
    yield "Ruckig by segments = exact", problem.name, _by_segments(problem, trajectory)


def _retimed(problem: Problem, trajectory: Trajectory) -> float:
    """How far TOPP-RA's duration along the path is from the trajectory's, relative."""
    limits = Limits(
        problem.limits.velocity * (1 + RELAXED),
        problem.limits.acceleration * (1 + RELAXED),
    )
    relaxed = Problem(problem.waypoints, limits)
    solution = along(
        relaxed,
        trajectory,
        start_speed=1.0,
        end_speed=1.0,
    )
    if solution.trajectory is None:
        return np.inf
    ratio = solution.trajectory.duration / trajectory.duration
    return abs(ratio - 1)


def _by_segments(problem: Problem, trajectory: Trajectory) -> float:
    """How far Ruckig is from the trajectory's segment times, over its whole duration."""
    times = trajectory.waypoint_times
    velocities = trajectory(times, order=1) / (1 + RELAXED)
    states = []
    for q, v in zip(problem.waypoints, velocities, strict=True):
        states.append((q, v, 0 * v))
    ruckig = []
    for start, end in itertools.pairwise(states):
        duration, _ = section(problem.limits, start, end)
        ruckig.append(duration)
    differences = np.abs(ruckig - np.diff(times))
    return float(differences.max() / trajectory.duration)


def table(checks: list[Check]) -> pd.DataFrame:
    """Per relation: how often checked, how often broken beyond 1e-6 and 1e-5, worst and where."""
    frame = pd.DataFrame(checks, columns=["relation", "problem", "excess"])
    excess = frame["excess"]
    groups = frame.groupby("relation")["excess"]
    highest = groups.idxmax()
    worst = frame.loc[highest].set_index("relation")
    columns = {"checked": groups.size()}
    for threshold in (1e-6, 1e-5):
        above = excess > threshold
        count = above.groupby(frame["relation"]).sum()
        columns[f"above {threshold:g}"] = count
    columns["worst"] = worst["excess"]
    columns["at"] = worst["problem"]
    return pd.DataFrame(columns)


def main(
    problems: int = 300,
    jobs: int = 2,
    output: Path = Path("results/ordering"),
) -> None:
    """Run the study and print its table; also written to `ordering.csv` in `output`."""
    drawn = [random_problem(seed) for seed in range(problems)]
    planners = []
    for name in entries():
        planner = load(name)
        if not planner.on_request:
            planners.append((name, planner))
    with console.trials() as advance:
        results = run.compare(
            drawn,
            planners,
            output,
            seeds=2,
            jobs=jobs,
            progress=advance,
        )
    checks = list(orderings(results))
    with console.progress(problems) as advance:
        for problem in drawn:
            checks += identities(problem)
            advance(1)
    summary = table(checks)
    summary.to_csv(output / "ordering.csv")
    print(summary.to_string(float_format="{:.1e}".format))


if __name__ == "__main__":
    cyclopts.run(main)
