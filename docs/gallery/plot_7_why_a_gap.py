"""
7. What a gap is made of
========================

The sparrow search ISSA takes 2.9 times the optimum on the six-axis problem. ``explain`` splits
this ratio in two ways: into the timing and the path, and into the optimiser, the shape and the
smoothness of the 3-5-3 spline.
"""

from matplotlib import pyplot as plt

from trajopt.benchmark.suites import catalogue
from trajopt.explain.decomposition import explain
from trajopt.planners.registry import load

problem = catalogue.load("six-axis")
planner = load("issa")
motion = planner.solve(problem, seed=27).trajectory
explanation = explain(problem, planner, motion)
print(f"{explanation.certified_duration:.4f} s, optimum {explanation.exact:.4f} s")

# %%
# Both decompositions, from the optimum up. The shape costs most: the optimiser is not to blame.

figure, axes = plt.subplots(2, 1, figsize=(7, 4), sharex=True, layout="constrained")
for panel, (title, steps) in zip(axes, explanation.steps().items(), strict=True):
    names = [name for name, _ in steps]
    durations = [duration for _, duration in steps]
    starts = [0.0, *durations[:-1]]
    lengths = [end - start for start, end in zip(starts, durations, strict=True)]
    panel.barh(names, lengths, left=starts, color="#8C8C8C")
    panel.set_title(title, fontsize="medium")
axes[-1].set_xlabel("duration [s]")
plt.show()
