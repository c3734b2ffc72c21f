"""Ratios to the least ∫ jerk²: closed forms of one joint between two waypoints.

The smoothest motion from rest to rest in time T is q = d (10 s³ − 15 s⁴ + 6 s⁵), s = t/T, with
∫ jerk² = 720 d²/T⁵, a peak velocity of 15/8 d/T and a peak acceleration of 10/√3 d/T².
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from trajopt import Limits, Planner, Problem, Solution, Status, Trajectory
from trajopt.benchmark.front import free_least
from trajopt.benchmark.trial import trials_of
from trajopt.views.analysis.least_jerk import times_the_least

D, V, A = 0.8, 3.0, 40.0
PROBLEM = Problem([[0.2], [0.2 + D]], Limits([V], [A]))


class Quintic(Planner):
    """The smoothest motion in a time, or one of a larger ∫ jerk²."""

    def __init__(self, duration, wave=0.0):
        self.duration, self.wave = duration, wave

    def options(self):
        return {"duration": self.duration, "wave": self.wave}

    def solve(self, problem, *, seed=0):
        # wave adds s³ (1 − s)³, which changes neither states nor accelerations at the ends
        unit = D * np.array([0, 6.0, -15, 10, 0, 0, 0]) - self.wave * np.array(
            [1, -3, 3, -1, 0, 0, 0.0]
        )
        unit[-1] = 0.2
        powers = np.arange(6, -1, -1)
        c = (unit / self.duration**powers).reshape(7, 1, 1)
        ends = np.array([0, self.duration])
        return Solution(Status.SOLVED, Trajectory(ends, c, ends))


def test_read_me_first():
    least = free_least(PROBLEM)
    assert least.constant == pytest.approx(720 * D**2, rel=1e-6)
    assert least.shortest == pytest.approx(
        max(15 / 8 * D / V, sqrt(10 / sqrt(3) * D / A)), rel=1e-6
    )


def test_the_smoothest_motion_has_the_ratio_1():
    trials = trials_of(Quintic(1.0), PROBLEM, [0], "smooth")
    assert times_the_least(trials)["smooth:duration=1.0,wave=0.0"] == pytest.approx(1, rel=1e-6)


def test_a_wave_costs_its_own_integral():
    # the third derivative of w s³ (1 − s)³ is orthogonal to the quintic's, its ∫ square is 36/7 w²
    trials = trials_of(Quintic(1.0, wave=3.0), PROBLEM, [0], "wave")
    (ratio,) = times_the_least(trials).values()
    assert ratio == pytest.approx(1 + 9 * 36 / 7 / (720 * D**2), rel=1e-6)


def test_where_limits_act_there_is_no_ratio():
    shortest = free_least(PROBLEM).shortest
    trials = trials_of(Quintic(0.9 * shortest), PROBLEM, [0], "fast")
    trials[0] = replace(trials[0], certificate=replace(trials[0].certificate, dilation=1.0))
    assert trials[0].certified_duration == pytest.approx(0.9 * shortest)
    assert times_the_least(trials) == {}


def test_what_the_front_does_not_know_has_no_ratio():
    waits = Problem([[0.0], [1.0], [2.0]], Limits([V], [A]), demands={"dwell": [0, 0.5, 0]})
    assert free_least(waits) is None


def test_a_position_limit_that_always_acts_leaves_no_ratio():
    # in every duration the first joint of the smoothest motion goes beyond 1, between 1 and 1
    limits = Limits([V, V], [A, A], position=[[-1.0, 1.0], [-9.0, 9.0]])
    beyond = Problem([[0.0, 0.0], [1.0, 1.0], [1.0, 2.0]], limits)
    assert free_least(beyond.without("position")) is not None
    assert free_least(beyond) is None
