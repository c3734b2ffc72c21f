"""
2. The minimum-time motion
==========================

The exact solution of the paper's six-axis problem. At every instant some joint is at a limit.
"""

import numpy as np
from matplotlib import pyplot as plt

from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import load

problem = catalogue.load("six-axis")
optimum = load("exact").solve(problem).trajectory
print(
    f"minimum time {optimum.duration:.6f} s, waypoints at {np.round(optimum.waypoint_times, 4)} s"
)

# %%
# Velocities over time. The waypoints are the grey lines: all joints pass a waypoint at the same
# instant.

times = np.linspace(0, optimum.duration, 600)
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(times, optimum(times, 1), label=[f"joint {j + 1}" for j in range(problem.joints)])
for instant in optimum.waypoint_times:
    axes.axvline(instant, color="0.8", linewidth=0.8, zorder=0)
axes.set_xlabel("time [s]")
axes.set_ylabel("velocity [rad/s]")
axes.legend(ncols=3, fontsize="small")
plt.show()
