"""
4. Your planner in ten lines
============================

A planner is a frozen dataclass with ``solve``; its fields are its options. This one looks at no
limits. The judge slows its motion down to the limits.
"""

import tempfile
from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from scipy.interpolate import CubicSpline

from trajopt import Planner, Solution, Status, Trajectory, compare
from trajopt.views.figures.plots import planner_look


@dataclass(frozen=True)
class EvenCubic(Planner):
    """A clamped cubic spline, one time step per waypoint."""

    step: float = 1.0

    def solve(self, problem, *, seed=0):
        times = self.step * np.arange(len(problem.waypoints))
        spline = CubicSpline(times, problem.waypoints, bc_type="clamped")
        return Solution(Status.SOLVED, Trajectory(spline.x, spline.c, times))


folder = tempfile.mkdtemp()
planners = [EvenCubic(), "toppra", "ruckig-stop"]
results = compare(["six-axis", "seven-waypoints", "reversal"], planners, folder, jobs=1)
table = results.summary()[["problem", "label", "median", "gap"]]
print(table.to_string(index=False, float_format="%.4f"))

# %%
# The same as a picture: certified durations relative to the optimum.

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
wide = table.pivot(index="problem", columns="label", values="gap")
colours = [planner_look(name, wide.columns)["color"] for name in wide.columns]
wide.mul(100).plot.barh(ax=axes, color=colours)
axes.set_xlabel("gap to the optimum [%]")
axes.set_ylabel("")
plt.show()
