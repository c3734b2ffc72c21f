"""Waypoints on an optimal motion change no verdict, and no jump is too small to count."""

from __future__ import annotations

import numpy as np
import pytest

from soaks.tricks import rest_to_rest, smooth_cruise, together
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.repair import repaired
from trajopt.judging.verification import certified, verify

SPACINGS = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9]


def straight(joints, jerk):
    """The optimum from 0 to 4 rad under limits of 1, every joint alike: 6 s, or 5 s."""
    motion = smooth_cruise(4.0, 1.0) if jerk else rest_to_rest(4.0, 1.0, 1.0)
    limits = Limits([1.0] * joints, [1.0] * joints, jerk=[1.0] * joints if jerk else None)
    return motion, limits


@pytest.mark.parametrize("jerk", [True, False])
@pytest.mark.parametrize("joints", [1, 3])
@pytest.mark.parametrize("spacing", SPACINGS)
def test_waypoints_added_on_an_optimum_change_nothing(spacing, joints, jerk):
    """At the start, in a ramp, in the cruise and at the end: spacings of the way."""
    motion, limits = straight(joints, jerk)
    end = motion.duration
    ways = 4 * spacing * np.array([1.0, 2.0])
    near = np.cbrt(6 * ways) if jerk else np.sqrt(2 * ways)  # after so far from rest
    steps = 4 * spacing * np.arange(-2, 3)
    times = np.unique([0.0, *near, *(1.1 + steps), *(3 + steps), *(end - near), end])
    waypoints = np.repeat(motion(times), joints, axis=1)
    problem = Problem(waypoints, limits)
    given = together([motion] * joints, times)
    duration = verify(problem, given).certified_duration
    assert end * (1 - 1e-9) <= duration <= end * (1 + 1e-6)
    again = verify(problem, certified(problem, given)).certified_duration
    assert again == pytest.approx(duration, rel=1e-8)


@pytest.mark.parametrize("jerk", [True, False])
def test_a_spared_waypoint_is_missed_by_no_more_than_its_rounding(jerk):
    """Half a rounding beside the line it is passed; at two and a half it is met exactly."""
    motion, limits = straight(2, jerk)
    steps = 1e-9 * np.arange(6)
    middle = motion.duration / 2
    times = np.array([0.0, *(middle + steps), motion.duration])
    waypoints = np.repeat(motion(times), 2, axis=1)
    problem = Problem(waypoints, limits)
    rounding = problem.rounding[0]
    for off, missed in ((0.5, 0.5), (2.5, 0.0)):
        beside = waypoints.copy()
        beside[3, 1] += off * rounding
        asked = Problem(beside, limits)
        passing = certified(asked, together([motion] * 2, times))
        away = np.abs(passing(passing.waypoint_times) - beside)[3] / rounding
        assert away[1] == pytest.approx(missed, abs=0.2)


def test_no_jump_is_too_small_to_count():
    """4096 jumps of one last place, all upwards: the repaired velocity rises by none of them."""
    count = 4096
    ulp = 2.0**-53
    lengths = np.full(count, 2.0**-10)
    velocity = 0.5 * (1 + ulp * 2 * np.arange(count))
    before = np.cumsum(lengths * velocity) - lengths * velocity
    pieces = np.zeros((4, count + 2, 1))
    pieces[2, 1:-1, 0] = velocity
    pieces[3, 1:-1, 0] = 0.25 + before
    pieces[:, 0, 0] = [0.0, 0.25, 0.0, 0.0]
    reached = 0.25 + lengths @ velocity
    pieces[:, -1, 0] = [0.0, -0.25, velocity[-1], reached]
    breaks = np.concatenate([[0.0, 1.0], 1.0 + np.cumsum(lengths), [2.0 + lengths.sum()]])
    motion = Trajectory(breaks, pieces, breaks[[0, -1]])
    end = pieces[:, -1, 0].sum()
    problem = Problem([[0.0], [float(end)]], Limits([1.0], [1.0]))
    mended = repaired(problem, motion)
    unit = mended.pieces(1)
    jumps = unit[-1, 1:] - unit.sum(axis=0)[:-1]
    risen = count * 2 * ulp * 0.5
    assert abs(jumps.sum()) < 0.05 * risen
