"""Quintics from waypoint to waypoint, `jtraj` of the Robotics Toolbox (`roboticstoolbox-python`).

`jtraj` joins two points by a quintic of given time, with given velocities and no acceleration at
both ends. It knows no limits, so times and velocities are ours: times in proportion to stopping at
every waypoint, and the whole dilated until the limits hold. Its samples at the waypoints, with
velocities and accelerations, determine its quintics: the answer is exact.

    from baselines.third_party.rtb_jtraj import RtbJtraj
    solution = RtbJtraj().solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from baselines.third_party import imported
from baselines.topp_ra import best_of
from trajopt.planner import Planner, passing_once
from trajopt.problem import Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Array = NDArray[np.float64]

# Peaks of a quintic from rest to rest over h in T: 15/8 h/T, 10/√3 h/T², 60 h/T³.
_QUINTIC_PEAKS = {1: 15 / 8, 2: 10 / np.sqrt(3), 3: 60.0}


@dataclass(frozen=True)
class RtbJtraj(Planner):
    """The Robotics Toolbox's `jtraj`, segment by segment, dilated; by default the better of two.

    `velocities` at the waypoints: `zero`, stopping everywhere, each segment in its own least time;
    or the `mean` of both segments' mean velocities, zero where a joint turns back.
    """

    velocities: Literal["zero", "mean", "best"] = "best"

    on_request = True
    requires = ("roboticstoolbox",)
    extra = "rtb"
    knows = ("velocity", "acceleration", "jerk")

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The briefer after dilation. `stats`: its rule, and every rule's result."""
        toolbox, seconds = imported("roboticstoolbox", self.extra)
        rules: list[str] = [self.velocities]
        if self.velocities == "best":
            rules = ["zero", "mean"]
        solutions = {}
        for rule in rules:
            times = _quintic_times(problem)
            velocities = np.zeros_like(problem.waypoints)
            if rule == "mean":
                times = stop_times(problem)
                velocities[1:-1] = _mean_velocities(problem, times)
            joined = _joined(problem, times, velocities, toolbox.jtraj)
            cheapest = verify(problem, joined).dilation
            solutions[rule] = Solution(Status.SOLVED, joined.dilated(cheapest))
        return replace(best_of(problem, solutions), setup_time=seconds)


def _quintic_times(problem: Problem) -> Array:
    """The least time of each segment as a quintic from rest to rest, s."""
    h = problem.displacements
    limits = problem.limits
    times = []
    for order, bounds in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
        low, high = np.abs(bounds).T
        # of velocity both ways, of the others either side on every way
        narrow = np.minimum(low, high)
        if order == 1:
            narrow = np.where(h >= 0, high, low)
        needed = (_QUINTIC_PEAKS[order] * np.abs(h) / narrow) ** (1 / order)
        times.append(needed.max(axis=1))
    return np.asarray(np.max(times, axis=0))


def _mean_velocities(problem: Problem, times: Array) -> Array:
    """At the inner waypoints, `(waypoints − 2, joints)`."""
    slopes = problem.displacements / times[:, None]
    onwards = slopes[:-1] * slopes[1:] > 0
    return np.where(onwards, (slopes[:-1] + slopes[1:]) / 2, 0.0)


def _joined(problem: Problem, times: Array, velocities: Array, jtraj: Any) -> Trajectory:
    """The quintics of all segments, each sampled at its ends."""
    samples = [problem.waypoints[0]]
    for k, duration in enumerate(times):
        piece = jtraj(
            problem.waypoints[k],
            problem.waypoints[k + 1],
            np.array([0.0, duration]),
            qd0=velocities[k],
            qd1=velocities[k + 1],
        )
        samples.append(piece.q[-1])
    passed = np.r_[0.0, np.cumsum(times)]
    return Trajectory.from_samples(
        passed,
        np.array(samples),
        velocities,
        np.zeros_like(velocities),
        waypoint_times=passed,
    )
