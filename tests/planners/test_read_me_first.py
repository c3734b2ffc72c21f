"""Read me first: a planner turns a problem into a trajectory, and the verifier judges it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from trajopt import Limits, Planner, Problem, Solution, Status, Trajectory, verify
from trajopt.planners.registry import load
from trajopt.planners.testing import check_planner


@dataclass(frozen=True)
class EvenCubic(Planner):
    """A clamped cubic spline, one time step per waypoint."""

    step: float = 1.0

    def unsupported(self, problem):
        if problem.has("jerk"):
            return "its acceleration jumps"
        return None

    def solve(self, problem, *, seed=0):
        times = self.step * np.arange(len(problem.waypoints))
        spline = CubicSpline(times, problem.waypoints, bc_type="clamped")
        trajectory = Trajectory(spline.x, spline.c, times)
        return Solution(Status.SOLVED, trajectory)


def test_a_planner_is_a_frozen_dataclass_with_solve():
    check_planner(EvenCubic())
    assert EvenCubic(step=2.0).options() == {"step": 2.0}


def test_a_planner_goes_by_its_name_with_options():
    assert load("unoptimised:segment_time=3").options() == {"segment_time": 3.0}


def test_the_verifier_dilates_an_answer_that_breaks_a_limit():
    problem = Problem([[0.0], [1.0]], Limits(velocity=[1.0], acceleration=[100.0]))
    hasty = EvenCubic(step=0.5).solve(problem).trajectory
    certificate = verify(problem, hasty)
    # a clamped cubic over 1 rad peaks at 1.5 rad over its time
    assert certificate.duration == 0.5
    assert abs(certificate.certified_duration - 1.5) < 1e-9
