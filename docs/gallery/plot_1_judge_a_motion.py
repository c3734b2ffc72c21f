"""
1. Judge a motion
=================

A cubic spline through four waypoints of a two-joint arm, as many planners make it. Does it keep
the limits, and how far is it from the minimum time?
"""

import numpy as np
from matplotlib import pyplot as plt
from scipy.interpolate import CubicSpline

import trajopt
from trajopt import Limits, Problem

waypoints = np.radians([[0, 0], [40, -25], [90, 30], [60, 60]])  # rad, a row per waypoint
limits = Limits(velocity=[2.0, 2.5], acceleration=[5.0, 6.0])  # rad/s, rad/s²
problem = Problem(waypoints, limits, name="two joints")

motion = CubicSpline([0, 0.7, 1.5, 2.1], waypoints, bc_type="clamped")
judgement = trajopt.judge(problem, motion)
print(judgement.certificate)

# %%
# The motion breaks the acceleration limit. Slowed down just enough it keeps all limits; that
# duration is *certified*. The gap is measured from there to the optimum.

print(f"claimed   {judgement.claimed_duration:.4f} s")
print(f"certified {judgement.certified_duration:.4f} s")
print(f"gap       {100 * judgement.gap:.1f} %")

# %%
# The acceleration of both joints over time, with the limits dashed.

times = np.linspace(0, motion.x[-1], 400)
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for joint, colour in enumerate(("#0072B2", "#D55E00")):
    axes.plot(times, motion(times, 2)[:, joint], color=colour, label=f"joint {joint + 1}")
    for side in (0, 1):
        limit = problem.limits.acceleration[joint, side]
        axes.axhline(limit, color=colour, linestyle="--", linewidth=0.8)
axes.set_xlabel("time [s]")
axes.set_ylabel("acceleration [rad/s²]")
axes.legend()
plt.show()
