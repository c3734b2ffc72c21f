"""
8. Prove it
===========

A best known motion may be a local optimum. ``prove`` proves a lower bound: no motion is
shorter. The proof is stored, and checked without a solver.
"""

from matplotlib import pyplot as plt

from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import load

names = ["one-joint", "tiny", "repeated", "six-axis"]
rows = []
for name in names:
    solution = load("prove").solve(catalogue.load(name))
    best, bound = solution.trajectory.duration, solution.lower_bound
    rows.append(100 * (best / bound - 1))
    print(f"{name:10s} best {best:.6f} s, no motion is shorter than {bound:.6f} s")

# %%
# How much room is left between the motion and the bound, in percent.

figure, axes = plt.subplots(figsize=(7, 2.4), layout="constrained")
axes.barh(names, rows)
axes.set_xlabel("best known over lower bound, minus one [%]")
plt.show()
