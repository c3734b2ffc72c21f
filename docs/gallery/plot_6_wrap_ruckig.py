"""
6. Wrap Ruckig
==============

Ruckig's open edition plans from one state to the next. The simplest planner stops at every
waypoint.
"""

from dataclasses import dataclass

import numpy as np
import ruckig
from matplotlib import pyplot as plt

from trajopt import Planner, Solution, Status, Trajectory, verify
from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import load
from trajopt.views.figures.plots import planner_look


@dataclass(frozen=True)
class StopWithRuckig(Planner):
    """Ruckig from waypoint to waypoint, at rest at each, sampled."""

    cycle: float = 0.002  # s

    def solve(self, problem, *, seed=0):
        velocity, acceleration, jerk = (
            problem.limits.by_name()[kind] for kind in ("velocity", "acceleration", "jerk")
        )
        otg = ruckig.Ruckig(problem.joints)
        joints = problem.joints
        rest = np.zeros(joints)
        times = [0.0]
        ends = [0.0]
        states = [(problem.waypoints[0], rest, rest)]
        for start, goal in zip(problem.waypoints[:-1], problem.waypoints[1:], strict=True):
            asked = ruckig.InputParameter(joints)
            asked.current_position = list(start)
            asked.target_position = list(goal)
            asked.max_velocity = list(velocity[:, 1])
            asked.max_acceleration = list(acceleration[:, 1])
            asked.max_jerk = list(jerk[:, 1])
            answer = ruckig.Trajectory(joints)
            if otg.calculate(asked, answer) != ruckig.Result.Working:
                return Solution(Status.FAILED, message="Ruckig found no motion")
            cycles = int(np.ceil(answer.duration / self.cycle))
            for t in np.linspace(0, answer.duration, cycles + 1)[1:]:
                times.append(ends[-1] + t)
                states.append(answer.at_time(t))
            ends.append(times[-1])
        positions, velocities, accelerations = np.array(states).transpose(1, 0, 2)
        motion = Trajectory.from_samples(
            times, positions, velocities, accelerations, waypoint_times=ends
        )
        return Solution(Status.SOLVED, motion)


problem = catalogue.load("jerk-limit")
motion = StopWithRuckig().solve(problem).trajectory
certificate = verify(problem, motion)
optimum = load("exact-jerk").solve(problem).trajectory
print(f"claimed   {motion.duration:.4f} s")
print(f"certified {certificate.certified_duration:.4f} s")
print(f"optimum   {optimum.duration:.4f} s")

# %%
# Ruckig's motion keeps the limits. A controller joins its samples by quintic polynomials, and
# these exceed the jerk limit where jerk jumps between two samples: the motion as executed needs
# to be a fifth slower.

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for name, planner, shown in (
    ("stopping", "ruckig-stop", motion),
    ("optimum", "exact-jerk", optimum),
):
    times = np.linspace(0, shown.duration, 800)
    axes.plot(times, shown(times, 1)[:, 0], **planner_look(planner) | {"label": name})
axes.set_xlabel("time [s]")
axes.set_ylabel("velocity of joint 1 [rad/s]")
axes.legend()
plt.show()
