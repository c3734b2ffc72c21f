"""
5. Wrap TOPP-RA
===============

TOPP-RA times a given path. This is the way its own documentation runs it: a natural cubic spline,
and constant acceleration between gridpoints. The wrapper hands the sampled motion to the judge,
as a controller would execute it.
"""

from dataclasses import dataclass

import numpy as np
import toppra
from matplotlib import pyplot as plt
from toppra import constraint
from toppra.algorithm import TOPPRA

from trajopt import Planner, Solution, Status, Trajectory, verify
from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import load
from trajopt.views.figures.plots import planner_look

toppra.setup_logging("WARNING")


@dataclass(frozen=True)
class NaturalToppra(Planner):
    """TOPP-RA along a natural cubic spline, sampled at its gridpoints."""

    gridpoints: int = 1001

    def solve(self, problem, *, seed=0):
        knots = np.linspace(0, 1, len(problem.waypoints))
        path = toppra.SplineInterpolator(knots, problem.waypoints)
        limits = [
            constraint.JointVelocityConstraint(problem.limits.velocity),
            constraint.JointAccelerationConstraint(problem.limits.acceleration),
        ]
        grid = np.union1d(np.linspace(0, 1, self.gridpoints), knots)
        algorithm = TOPPRA(limits, path, gridpoints=grid, parametrizer="ParametrizeConstAccel")
        if algorithm.compute_trajectory() is None:
            return Solution(Status.FAILED, message="TOPP-RA found no timing")
        speeds = algorithm.problem_data.sd_vec  # ds/dt at the gridpoints
        steps = 2 * np.diff(grid) / (speeds[1:] + speeds[:-1])
        times = np.concatenate([[0], np.cumsum(steps)])
        motion = Trajectory.from_samples(
            times,
            path(grid),
            path(grid, 1) * speeds[:, None],
            waypoint_times=times[np.searchsorted(grid, knots)],
        )
        return Solution(Status.SOLVED, motion)


problem = catalogue.load("six-axis")
motion = NaturalToppra().solve(problem).trajectory
certificate = verify(problem, motion)
best = verify(problem, load("toppra").solve(problem).trajectory)
optimum = load("exact").solve(problem).trajectory
print(f"natural spline, sampled  {certificate.certified_duration:.4f} s")
print(f"best of twelve splines   {best.certified_duration:.4f} s")
print(f"optimum                  {optimum.duration:.4f} s")

# %%
# TOPP-RA is optimal along its path. The rest of the gap belongs to the path.

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for name, planner, shown in (("TOPP-RA", "toppra", motion), ("optimum", "exact", optimum)):
    times = np.linspace(0, shown.duration, 500)
    positions = shown(times)
    axes.plot(positions[:, 1], positions[:, 4], **planner_look(planner) | {"label": name})
axes.plot(*problem.waypoints[:, [1, 4]].T, "ko", label="waypoints")
axes.set_xlabel("joint 2 [rad]")
axes.set_ylabel("joint 5 [rad]")
axes.legend()
plt.show()
