"""
9. The 3-5-3 spline, beside the optimum
=======================================

One joint moves through four waypoints. The best 3-5-3 spline takes a cubic, a quintic and a cubic;
the optimum uses its acceleration limit all the time. The cubics start from rest with zero
acceleration, so they reach the limit at their inner ends only.
"""

import numpy as np
from matplotlib import pyplot as plt

from trajopt import Limits, Problem
from trajopt.planners.registry import load
from trajopt.views.figures.plots import planner_look

problem = Problem([[0.0], [0.2], [0.8], [1.0]], Limits([2.0], [4.0]), name="one joint")
motions = {name: load(name).solve(problem).trajectory for name in ("spline353-nlp", "exact")}
names = {"spline353-nlp": "3-5-3", "exact": "optimum"}

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for planner, motion in motions.items():
    times = np.linspace(0, motion.duration, 1000)
    label = f"{names[planner]}, {motion.duration:.3f} s"
    axes.plot(times, motion(times, 2)[:, 0], **planner_look(planner) | {"label": label})
for limit in problem.limits.acceleration[0]:
    axes.axhline(limit, color="0.5", linestyle="--", linewidth=0.8)
axes.set_xlabel("time (s)")
axes.set_ylabel("acceleration (rad/s²)")
axes.legend()
plt.show()
