"""
Time-optimal trajectory through waypoints with jerk limits in Python
====================================================================

Ten lines: waypoints and limits in, the minimum-time motion out. It passes every waypoint without
stopping, and keeps the limits of velocity, acceleration and jerk at every instant. Beside it,
Ruckig's open edition, which stops at every waypoint.
"""

import numpy as np
from matplotlib import pyplot as plt

from trajopt import Limits, Problem, plan
from trajopt.views.figures.plots import planner_look

problem = Problem(
    waypoints=[[0.0, 0.0], [0.5, -0.2], [0.9, 0.3], [1.2, 0.0]],  # rad, a row per waypoint
    limits=Limits(velocity=[2.0, 2.0], acceleration=[4.0, 4.0], jerk=[30.0, 30.0]),
    name="two joints",
)
fastest = plan(problem, "exact-jerk").certified_trajectory
stopping = plan(problem, "ruckig-stop").certified_trajectory
print(f"through the waypoints {fastest.duration:.3f} s, stopping {stopping.duration:.3f} s")

# %%
# A trajectory is a function of time: ``fastest(t)`` is its positions, ``fastest(t, 1)`` its
# velocities, ``fastest(t, 2)`` and ``fastest(t, 3)`` its accelerations and jerks.
# ``trajopt.write("motion.yaml", ...)`` makes a ROS message of it.

figure, axes = plt.subplots(2, 1, figsize=(7, 4.5), sharex=True, layout="constrained")
shown = {"exact-jerk": ("minimum time", fastest), "ruckig-stop": ("Ruckig, stopping", stopping)}
for planner, (name, motion) in shown.items():
    colour = planner_look(planner)["color"]
    times = np.linspace(0, motion.duration, 800)
    axes[0].plot(times, motion(times)[:, 1], color=colour, label=f"{name}, {motion.duration:.2f} s")
    axes[0].plot(
        motion.waypoint_times, motion(motion.waypoint_times)[:, 1], "o", mec=colour, mfc="w"
    )
    axes[1].plot(times, motion(times, 2)[:, 1], color=colour)
axes[0].set_ylabel("joint 2 (rad)")
axes[1].set_ylabel("acceleration (rad/s²)")
axes[1].set_xlabel("time (s)")
axes[0].legend()
plt.show()

# %%
# Without jerk limits ``plan(problem)`` takes ``exact``; with position limits it takes
# ``collocation-refined``. The planner is chosen by the limits unless one is named. TOPP-RA times a
# given path; here the path between the waypoints is free, which makes the motion shorter.
