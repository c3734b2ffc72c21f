"""A start beyond limits brakes into them in the least time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from work import one_in

import trajopt
from trajopt import Limits, Problem, Status
from trajopt.core.exceptions import InvalidInput
from trajopt.judging.verification import verify

JERK = Limits([1.0, 1.0], [2.0, 2.0], jerk=[20.0, 20.0])
WAY = [[0.0, 0.0], [1.0, 0.4], [2.0, 1.0]]


def planned(problem):
    """The braking, the answer to the rest, and the certificate of both together."""
    found = trajopt.brake_first(problem)
    rest = trajopt.plan(found.rest)
    motion = found.joined(rest.certified_trajectory)
    return found, motion, verify(found.problem, motion)


def test_the_closed_form_without_jerk_limits():
    """FT5-12: 1.5 to 1 rad/s in 0.25 s and 0.3125 rad, then (1.6875 − 0.25) / 1 + 0.5 s."""
    problem = Problem([[0.0], [2.0]], Limits([1.0], [2.0]), start_velocity=[1.5])
    found, motion, certificate = planned(problem)
    assert found.ways == {0: (0.25, 0.3125)}
    assert motion.duration == pytest.approx(2.1875, rel=1e-12)
    assert certificate.feasible


def test_ruckig_brakes_as_long():
    """FT5-12: Ruckig takes 0.167347456888558 s on its issue 128, braking included."""
    limits = Limits([800.0], [40000.0], jerk=[200000.0])
    problem = Problem([[1300.0], [1400.0]], limits, start_velocity=[1200.0])
    assert planned(problem)[1].duration == pytest.approx(0.167347456888558, rel=1e-9)


@pytest.mark.parametrize("seed", one_in(4, range(12)))
def test_whole_motions_are_certified(seed):
    """Velocities beyond limits on either side, accelerations too, beside joints within them."""
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(1, 4))
    way = np.cumsum(rng.uniform(-1, 1, (3, joints)), axis=0)
    fastest, steepest = rng.uniform(0.5, 2, joints), rng.uniform(1, 5, joints)
    start = rng.uniform(1.05, 1.6, joints) * rng.choice([-1, 1], joints) * fastest
    if seed % 2:
        limits = Limits(fastest, steepest, jerk=rng.uniform(10, 60, joints))
        bend = rng.uniform(-1.4, 1.4, joints) * steepest
        problem = Problem(way, limits, start_velocity=start, start_acceleration=bend)
    else:
        problem = Problem(way, Limits(fastest, steepest), start_velocity=start)
    assert trajopt.plan(problem).status is Status.INFEASIBLE
    found, motion, certificate = planned(problem)
    assert certificate.feasible, certificate.flaws
    beyond = np.abs(start) > fastest
    ends = found.motion.duration
    assert np.all(np.abs(motion(ends, 1)) <= fastest * (1 + 1e-9))
    assert set(np.flatnonzero(beyond)) <= set(found.ways)


def test_demands_move_with_the_waypoints():
    asked = {"dwell": [0, 0.2, 0], "least_duration": 5.0, "least_times": [1.0, 0]}
    problem = Problem(WAY, JERK, start_velocity=[0.3, -1.2], **asked)
    found, motion, certificate = planned(problem)
    assert certificate.feasible
    assert motion.duration == pytest.approx(5.0, rel=1e-9)
    assert found.problem.demands["dwell"].tolist() == [0, 0, 0.2, 0]
    times = motion.waypoint_times
    assert times[2] >= 1.0 - 1e-9


def test_a_start_within_the_limits_brakes_nothing():
    assert trajopt.brake_first(Problem(WAY, JERK, start_velocity=[0.9, -0.9])) is None


def test_a_braking_out_of_the_range_is_refused():
    limits = Limits([1.0], [2.0], position=[[-1.0, 1.2]])
    problem = Problem([[1.0], [0.0]], limits, start_velocity=[1.5])
    with pytest.raises(InvalidInput, match=r"brakes within limits\.position: it gets to 1\.3125"):
        trajopt.brake_first(problem)


def test_the_judge_allows_a_braking_and_no_more():
    problem = Problem(WAY, JERK, start_velocity=[1.3, -1.2])
    _, motion, _ = planned(problem)
    assert trajopt.judge(problem, motion, brake_first=True).certificate.feasible
    assert not trajopt.judge(problem, motion).certificate.feasible
    # a motion that stays beyond its limit
    late = Problem(
        WAY, Limits([1.3, 1.2], [2.0, 2.0], jerk=[20.0, 20.0]), start_velocity=[1.3, -1.2]
    )
    fast = trajopt.plan(late).certified_trajectory
    assert not trajopt.judge(problem, fast, brake_first=True).certificate.feasible


def test_a_duration_shorter_than_the_braking_is_refused():
    problem = Problem([[0.0], [2.0]], Limits([1.0], [2.0]), start_velocity=[1.5], duration=0.2)
    with pytest.raises(InvalidInput, match=r"duration is 0\.2: expected more than the braking"):
        trajopt.brake_first(problem)


def test_a_motion_that_brakes_out_of_its_range_gets_a_verdict():
    limits = Limits([1.0], [2.0], position=[[-1.0, 2.5]])
    problem = Problem([[0.0], [2.0]], limits, start_velocity=[1.5])
    _, motion, _ = planned(problem)
    away = replace(motion, coefficients=motion.coefficients * 9.0)
    certificate = trajopt.judge(problem, away, brake_first=True).certificate
    assert any("position limits" in flaw for flaw in certificate.flaws)
