"""How far do the methods of the paper's introduction come on its own problem?

    python -m experiments.paper_references            # 20 seeds, 1000 iterations
    python -m experiments.paper_references --quick    # small; not meaningful

Families of curves, each with the best times that it has, and optimisers of the 3-5-3 at the
paper's population and iterations. `references.csv` in `--output` has one row each, beside the
paper's own. Of an optimiser: the median run, and the share of runs within 1 % of the shortest
3-5-3. The works cited improve QPSO and WOA; the paper does not say how, so these are as first
published.

A B-spline of degree 7 (5) here has its knots where the waypoints are passed, and rests at both
ends with velocity, acceleration and jerk (velocity and acceleration) zero. That fixes it but for
the three segment times, which differential evolution searches.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import differential_evolution

from experiments.common.output import progress, save_table
from experiments.paper.figures import solved
from experiments.paper.kept_searches import budget
from experiments.paper.other_swarms import QPSO, WOA
from trajopt import Problem, Trajectory, verify
from trajopt.benchmark.suites import catalogue as suite
from trajopt.core.arrays import Array
from trajopt.planners.swarm import ISSA, PSO, SSA
from trajopt.planners.swarm_planner import SwarmPlanner

FAMILIES = {
    "3-5-3 (the paper)": "spline353-nlp",
    "5-3-5 (Porawagama [5])": "spline:shape=5-3-5",
    "cubics (Sabarigirish [3])": "spline:degree=3",
    "quintics (Fang [4])": "spline:degree=5",
    "septics, 7-7-7": "spline:degree=7",
}
B_SPLINES = {"B-spline of degree 5 (Zhao [15])": 5, "B-spline of degree 7 (Lan [12])": 7}
OPTIMISERS = {
    "3-5-3 by PSO (Ekrem [18])": PSO(),
    "3-5-3 by SSA (Xue [23])": SSA(),
    "3-5-3 by ISSA (the paper)": ISSA(),
    "3-5-3 by QPSO (Luo [11] improves it)": QPSO(),
    "3-5-3 by WOA (Zhao [15] improves it)": WOA(),
}
_SAMPLES = 60  # of a segment, while searching


def b_spline(problem: Problem, degree: int, times: Array) -> BSpline:
    """Return the B-spline of odd degree through the waypoints at rest, at segment times, s."""
    at_rest = [(order, np.zeros(problem.joints)) for order in range(1, (degree + 1) // 2)]
    knots = np.cumsum([0.0, *times])
    return make_interp_spline(knots, problem.waypoints, degree, bc_type=(at_rest, at_rest))


def dilation(problem: Problem, spline: BSpline) -> float:
    """Return the factor on time with which the samples of a spline keep both limits."""
    limits = problem.limits.in_all_segments()
    knots = np.unique(spline.t)
    instants = np.linspace(knots[:-1], knots[1:], _SAMPLES).ravel()
    speed = np.abs(spline(instants, 1)) / limits.velocity[:, 1]
    push = np.abs(spline(instants, 2)) / limits.acceleration[:, 1]
    return float(max(speed.max(), np.sqrt(push.max())))


def best_b_spline(problem: Problem, degree: int, generations: int = 60) -> Trajectory:
    """Return the shortest B-spline of `b_spline` that keeps the limits, verified."""

    def times(ratios: Array) -> Array:
        return np.exp([ratios[0], 0.0, ratios[1]])

    def duration(ratios: Array) -> float:
        own = times(ratios)
        return float(own.sum()) * dilation(problem, b_spline(problem, degree, own))

    box = [(-2.5, 2.5), (-2.5, 2.5)]
    found = differential_evolution(duration, box, popsize=12, maxiter=generations, seed=0, tol=1e-8)
    own = times(found.x)
    own = own * dilation(problem, b_spline(problem, degree, own))
    passed = np.cumsum([0.0, *own])
    motion = Trajectory.from_spline(b_spline(problem, degree, own), waypoint_times=passed)
    return motion.dilated(max(1.0, verify(problem, motion).dilation))


def family(problem: Problem, name: str) -> Trajectory:
    """Return the best motion of a family of curves."""
    if name in B_SPLINES:
        return best_b_spline(problem, B_SPLINES[name])
    return solved(problem, FAMILIES[name])


def swarm(problem: Problem, name: str, seeds: int, iterations: int, best: float) -> dict[str, Any]:
    """Return a row of an optimiser: the median run, and how many end near the best 3-5-3."""
    planner = SwarmPlanner(OPTIMISERS[name], iterations=iterations)
    answers = planner.solve_batch(problem, range(seeds))
    motions = [answer.trajectory for answer in answers if answer.trajectory]
    durations = np.array([verify(problem, motion).certified_duration for motion in motions])
    near = 100 * np.mean(durations <= 1.01 * best)
    return {"duration, s": np.median(durations), "within 1 % of the best 3-5-3, % of runs": near}


def main(
    seeds: int = 20, *, quick: bool = False, output: Path = Path("results/paper_references")
) -> None:
    """Run all, and write and print the table.

    Args:
        seeds: How many runs of each optimiser.
        quick: Four runs of 20 iterations.
        output: The folder.
    """
    seeds, iterations = budget(seeds, quick)
    problem = suite.load("six-axis")
    exact = solved(problem, "exact").duration
    best = solved(problem, "spline353-nlp").duration
    steps = {name: partial(family, problem, name) for name in (*FAMILIES, *B_SPLINES)}
    rows = []
    with progress(len(steps) + len(OPTIMISERS), "methods") as advance:
        for name, motion in steps.items():
            certificate = verify(problem, motion())
            rows.append({"method": name, "duration, s": certificate.certified_duration})
            advance(1)
        for name in OPTIMISERS:
            rows.append({"method": name} | swarm(problem, name, seeds, iterations, best))
            advance(1)
    table = pd.DataFrame(rows)
    table.insert(2, "over the exact optimum, %", 100 * (table["duration, s"] / exact - 1))
    save_table(table, output / "references")
    print(table.to_string(index=False, float_format="{:.5g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
