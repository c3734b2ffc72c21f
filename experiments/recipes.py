"""Does the choice of the swarm matter, or the family of curves?

    python -m experiments.recipes                # four tasks, six CPU minutes
    python -m experiments.recipes --only yu2025  # the tasks whose names hold that

The literature gives a swarm the segment times of a 3-5-3, or of a quintic B-spline, and compares
it with other swarms. Here every swarm gets the same fitness (every candidate dilated to the limits)
and the same evaluations, beside one local search (Nelder and Mead from equal times, one run, the
same budget). Every answer is certified by the verifier. NiaPy (`pip install 'mintime[bench]'`)
gives PSO, GWO, GA, DE, HHO and ABC with their own parameters; ours are SSA, ISSA and CMA-ES.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.optimize import minimize

from baselines.evolution import CMAES
from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt import Problem, Trajectory, verify
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.planners import spline353
from trajopt.planners.planner import backend
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.swarm import ISSA, SSA, Optimiser, minimise

Array = NDArray[np.float64]
Fitness = Callable[[Array], float]

POPULATION = 30
NIAPY = {
    "PSO": "ParticleSwarmAlgorithm",
    "GWO": "GreyWolfOptimizer",
    "GA": "GeneticAlgorithm",
    "DE": "DifferentialEvolution",
    "HHO": "HarrisHawksOptimization",
    "ABC": "ArtificialBeeColonyAlgorithm",
}
OURS: dict[str, Optimiser] = {"SSA": SSA(), "ISSA": ISSA(), "CMA-ES": CMAES()}
LOCAL = "local search"
SWARMS = (*NIAPY, *OURS, LOCAL)
PERCENT = 100
CUBIC = "3-5-3"
TASKS = (
    ("six-axis", CUBIC),
    ("yu2025-task4-jerk", CUBIC),
    ("six-axis", "quintic B-spline"),
    ("yu2025-task4-jerk", "quintic B-spline"),
)
# Segment times relative to the longest stop-to-stop time.
LONGEST = 4.0
SHORTEST = 0.02


@dataclass(frozen=True, eq=False)
class SplineTimes:
    """A family of splines as a function of its segment times, which all joints share.

    The quintic B-spline has its knots at the waypoints, and no velocity and acceleration at both
    ends. A candidate is a point of the unit cube, mapped linearly to segment times.
    """

    problem: Problem
    family: str

    @cached_property
    def longest_stop(self) -> float:
        """The longest time of a segment from rest to rest, s."""
        return float(stop_times(self.problem).max())

    def seconds(self, x: Array) -> Array:
        """Segment times of a point of the unit cube, s."""
        inside = np.clip(x, 0.0, 1.0)
        return self.longest_stop * (SHORTEST + (LONGEST - SHORTEST) * inside)

    def equal_times(self) -> Array:
        """The point whose segments all take the longest stop-to-stop time."""
        share = (1 - SHORTEST) / (LONGEST - SHORTEST)
        return np.full(self.problem.segments, share)

    def trajectory(self, x: Array) -> Trajectory:
        """The candidate, not dilated."""
        times = self.seconds(x)
        if self.family == CUBIC:
            return spline353.trajectory(self.problem, times)
        passed = np.concatenate([[0.0], np.cumsum(times)])
        still = np.zeros(self.problem.joints)
        at_rest = [(1, still), (2, still)]
        bounds = (at_rest, at_rest)
        spline = make_interp_spline(passed, self.problem.waypoints, k=5, bc_type=bounds)
        return Trajectory.from_spline(spline, waypoint_times=passed)

    def fitness(self, x: Array) -> float:
        """Duration of the candidate once dilated to the limits, s.

        Raises:
            TrajoptError: The verifier does not certify it.
        """
        if self.family == CUBIC:
            times = self.seconds(x)
            use = spline353.limit_use(self.problem.displacements.T, times, self.problem.limits)
            return float(spline353.cheapest_dilation(*use).max() * times.sum())
        certificate = verify(self.problem, self.trajectory(x))
        if certificate.flaws:
            raise TrajoptError(f"{self.problem.name}: {certificate.flaws}")
        return certificate.dilation * certificate.duration


def of_niapy(
    name: str,
    fitness: Fitness,
    dimension: int,
    evaluations: int,
    seed: int,
) -> float:
    """The best that one run of an algorithm of NiaPy finds."""
    problems = backend("niapy.problems")

    class UnitCube(problems.Problem):  # type: ignore[misc, name-defined]
        def _evaluate(self, x: Array) -> float:
            return fitness(x)

    cube = UnitCube(dimension, 0.0, 1.0)
    task = backend("niapy.task").Task(problem=cube, max_evals=evaluations)
    kind: Any = getattr(backend("niapy.algorithms.basic"), NIAPY[name])
    _, best = kind(population_size=POPULATION, seed=seed).run(task)
    return float(best)


def of_ours(
    name: str,
    fitness: Fitness,
    dimension: int,
    evaluations: int,
    seed: int,
) -> float:
    """The best that one run of our own swarm finds."""

    def of_runs(x: Array) -> Array:
        return np.apply_along_axis(fitness, -1, x)

    corner = np.zeros(dimension)
    found = minimise(
        OURS[name],
        of_runs,
        corner,
        corner + 1,
        seeds=[seed],
        evaluations=evaluations,
    )
    return float(found.fitness[0])


def runs(
    times: SplineTimes,
    name: str,
    seeds: int,
    evaluations: int,
) -> pd.DataFrame:
    """One duration per seed, s; of the local search one."""
    dimension = times.problem.segments
    if name == LOCAL:
        best = minimize(
            times.fitness,
            times.equal_times(),
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * dimension,
            options={"maxfev": evaluations, "xatol": 1e-9, "fatol": 1e-9},
        )
        return pd.DataFrame({"duration": [float(best.fun)]})
    one_run = of_niapy if name in NIAPY else of_ours
    durations = []
    for seed in range(seeds):
        durations.append(one_run(name, times.fitness, dimension, evaluations, seed))
    return pd.DataFrame({"duration": durations})


def row(
    problem: Problem,
    family: str,
    durations: pd.Series[float],
) -> dict[str, Any]:
    """Medians of all swarms above the best of the family found, and that above the optimum, %.

    Args:
        durations: All runs, s, each under its swarm's name.
    """
    record = records.find(problem)
    assert record is not None
    best = durations.min()
    medians = durations.groupby(level=0).median()
    above = PERCENT * (medians.loc[[*SWARMS]] / best - 1)
    swarms = above.drop(LOCAL)
    stopping = float(stop_times(problem).sum())
    return {
        "recipe": f"{problem.name}, {family}",
        "best swarm": swarms.idxmin(),
        "worst swarm": swarms.idxmax(),
        **above,
        "family above the optimum": PERCENT * (best / record.duration - 1),
        "above stopping": PERCENT * (best / stopping - 1),
    }


def main(
    *,
    seeds: int = 9,
    evaluations: int = 600,
    only: str = "",
    output: Path = Path("results/recipes"),
) -> None:
    """Give every family to every swarm.

    Args:
        seeds: Runs of each swarm.
        evaluations: Of each run.
        only: Tasks whose problem and family, as "six-axis, 3-5-3", hold this text.
        output: Folder of the table and of all runs.
    """
    tasks = [task for task in TASKS if only in ", ".join(task)]
    if not tasks:
        known = "; ".join(", ".join(task) for task in TASKS)
        raise InvalidInput("--only", f"a part of one of {known}", value=only)
    cells = {}
    for name, family in tasks:
        times = SplineTimes(catalogue.load(name), family)
        for swarm in SWARMS:
            cells[name, family, swarm] = partial(runs, times, swarm, seeds, evaluations)
    file = output / f"{seeds}-seeds-{evaluations}-evaluations.csv"
    found = kept(file, ["problem", "family", "swarm"], cells)
    durations = found.set_index(["problem", "family", "swarm"])["duration"]
    rows = [row(catalogue.load(name), family, durations[name, family]) for name, family in tasks]
    table = pd.DataFrame(rows)
    save_table(table, output / "recipes")
    print(table.to_string(index=False, float_format="{:.4g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
