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

problem = Problem([[0.0], [0.2], [0.8], [1.0]], Limits([2.0], [4.0]), name="one joint")
motions = {
    "3-5-3": load("spline353-nlp").solve(problem).trajectory,
    "optimum": load("exact").solve(problem).trajectory,
}

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for (name, motion), colour in zip(motions.items(), ("#D55E00", "#0072B2"), strict=True):
    times = np.linspace(0, motion.duration, 1000)
    axes.plot(times, motion(times, 2)[:, 0], color=colour, label=f"{name}, {motion.duration:.3f} s")
for limit in problem.limits.acceleration[0]:
    axes.axhline(limit, color="0.5", linestyle="--", linewidth=0.8)
axes.set_xlabel("time (s)")
axes.set_ylabel("acceleration (rad/s²)")
axes.legend()
plt.show()
