"""Least times of segments and waits at waypoints, from the file to the proof."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from baselines.lower_bound.planner import Prove
from baselines.ruckig_ import RuckigStop
from baselines.spline import Spline
from trajopt import Limits, Problem, Status
from trajopt.benchmark.store.trial_text import certificate_of, certificate_table
from trajopt.core import dwell
from trajopt.core.exceptions import InvalidInput
from trajopt.core.resolution import spared
from trajopt.judging.verification import certified, verify

WAYPOINTS = [[0.0, 0.0], [1.0, 0.5], [2.0, 0.0], [2.5, 1.0]]
LIMITS = Limits([2.0, 2.0], [4.0, 3.0])
JERKY = Limits([2.0, 2.0], [4.0, 3.0], [30.0, 40.0])
EXACT = [(LIMITS, Exact()), (JERKY, ExactJerk())]


@pytest.mark.parametrize(("limits", "planner"), EXACT)
def test_a_wait_adds_its_length_to_two_problems_at_rest(limits, planner):
    whole = Problem(WAYPOINTS, limits, dwell=[0.1, 0.0, 0.4, 0.2])
    parts = [Problem(WAYPOINTS[:3], limits), Problem(WAYPOINTS[2:], limits)]
    expected = sum(planner.solve(part).trajectory.duration for part in parts) + 0.7
    solution = planner.solve(whole)
    certificate = verify(whole, solution.trajectory)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(expected, rel=1e-12)
    motion = solution.trajectory
    for begins, waypoint, wait in ((0.0, 0, 0.1), (motion.waypoint_times[2], 2, 0.4)):
        during = motion(np.linspace(begins, begins + wait, 7)[1:-1])
        assert np.abs(during - WAYPOINTS[waypoint]).max() <= 1e-12
    assert solution.disagreement <= 1e-9


def test_every_planner_waits():
    """Also one that has never heard of it: the wait splits the problem."""
    problem = Problem(WAYPOINTS, LIMITS, dwell=[0.0, 0.3, 0.0, 0.0])
    stops = RuckigStop().solve(problem)
    without = RuckigStop().solve(Problem(WAYPOINTS, LIMITS)).trajectory.duration
    assert verify(problem, stops.trajectory).certified_duration == pytest.approx(without + 0.3)


def test_a_motion_that_does_not_rest_is_told_where():
    problem = Problem(WAYPOINTS, LIMITS, dwell=[0.0, 0.0, 0.4, 0.0])
    through = Exact().solve(Problem(WAYPOINTS, LIMITS)).trajectory
    certificate = verify(problem, through)
    assert certificate.certified_duration is None
    assert "leaves waypoint 3 during its wait by" in certificate.flaws[0]
    motion = Exact().solve(problem).trajectory
    later = np.array([0.0, 0.0, 0.1, 0.0])
    late = replace(motion, waypoint_times=motion.waypoint_times + later)
    assert not verify(problem, late).valid


def test_a_faster_motion_with_a_wait_is_dilated():
    problem = Problem(WAYPOINTS, LIMITS, dwell=[0.0, 0.0, 0.4, 0.0])
    motion = Exact().solve(problem).trajectory
    waits = Problem(WAYPOINTS, LIMITS, dwell=[0.0, 0.0, 0.36, 0.0])
    fast = motion.dilated(0.9)
    certificate = verify(waits, fast)
    assert certificate.dilation == pytest.approx(1 / 0.9, rel=1e-9)
    assert verify(waits, certified(waits, fast)).feasible


@pytest.mark.parametrize(("limits", "planner"), EXACT)
def test_a_single_segment_takes_its_least_time(limits, planner):
    """From rest to rest, any time above the least is had by dilation."""
    problem = Problem(WAYPOINTS[:2], limits, least_times=[5.0])
    assert planner.solve(problem).trajectory.duration == pytest.approx(5.0, rel=1e-9)
    idle = Problem(WAYPOINTS[:2], limits, least_times=[0.2])
    free = planner.solve(Problem(WAYPOINTS[:2], limits)).trajectory.duration
    assert planner.solve(idle).trajectory.duration == pytest.approx(free, rel=1e-9)


def test_an_optimum_of_an_independent_transcription():
    """IPOPT, each joint with its own pieces of constant acceleration, all of eight starts."""
    problem = Problem(
        [[0, 0], [0.436998, 0.580621], [1.157298, 1.970999], [1.369588, 3.594562]],
        Limits([2.125415, 2.293486], [6.895596, 3.406499]),
        least_times=[1.377589, 1.208801, 0.0],
    )
    motion = Exact().solve(problem).trajectory
    certificate = verify(problem, motion)
    assert certificate.certified_duration == pytest.approx(3.6309257448629557, rel=1e-9)
    assert certificate.least_times.value == pytest.approx(1.0, rel=1e-9)
    stored = certificate_of(certificate_table(certificate), problem)
    assert stored.as_dict() == certificate.as_dict()


def test_too_fast_through_a_segment_is_dilated():
    problem = Problem(WAYPOINTS, LIMITS, least_times=[0.0, 1.5, 0.0])
    through = Exact().solve(Problem(WAYPOINTS, LIMITS)).trajectory
    certificate = verify(problem, through)
    taken = np.diff(through.waypoint_times)[1]
    assert not certificate.feasible
    assert certificate.dilation == pytest.approx(1.5 / taken)
    assert certificate.as_dict()["least_times"]["ratio"] == pytest.approx(1.5 / taken)


def test_the_same_waypoint_twice_with_a_time_between_stays():
    """Alone it would be passed once: there and back in 1 s, while the joint turns."""
    problem = Problem([[0.0], [1.0], [1.0], [2.0]], Limits([3.0], [2.0]), least_times=[0, 1, 0])
    merged, _ = problem.merged()
    assert merged is problem
    motion = Exact().solve(problem).trajectory
    assert verify(problem, motion).feasible
    # from rest to v = A/2 and back through -v would be slower than waiting at rest
    assert np.diff(motion.waypoint_times)[1] == pytest.approx(1.0, rel=1e-9)
    waits = [0.0, 0.1, 0.2]
    with pytest.raises(InvalidInput, match="one wait: the motion does not move from waypoint 2 to"):
        Problem([[0.0], [1.0], [1.0]], Limits([3.0], [2.0]), dwell=waits)


@pytest.mark.parametrize("limits", [LIMITS, JERKY])
@pytest.mark.parametrize(
    "demands",
    [{"dwell": [0.1, 0.0, 0.4, 0.2]}, {"least_times": [0, 1.5, 0], "dwell": [0, 0.3, 0, 0]}],
)
def test_a_bound_counts_them(limits, demands):
    problem = Problem(WAYPOINTS, limits, **demands)
    found = Prove(within=1e-4).solve(problem)
    assert found.lower_bound == pytest.approx(found.trajectory.duration, rel=1.1e-4)
    assert found.lower_bound <= found.trajectory.duration
    assert Prove().stored_bound(problem, found.stats) == found.lower_bound


@pytest.mark.parametrize(("limits", "planner"), EXACT)
def test_given_times_are_kept_or_proved_impossible(limits, planner):
    """The optimum's own times 1 % faster are impossible: their total is below the minimum."""
    fastest = np.diff(planner.solve(Problem(WAYPOINTS, limits)).trajectory.waypoint_times)
    for times in (fastest * [1.01, 1.3, 1.0], fastest * (1 + 1e-6)):
        problem = Problem(WAYPOINTS, limits, given_times=times)
        motion = planner.solve(problem).trajectory
        assert verify(problem, motion).feasible
        assert np.diff(motion.waypoint_times) == pytest.approx(times, rel=1e-10)
        assert Prove().solve(problem).lower_bound == pytest.approx(times.sum(), rel=1e-10)
    problem = Problem(WAYPOINTS, limits, given_times=0.99 * fastest)
    answer = planner.solve(problem)
    assert answer.status is Status.INFEASIBLE
    assert "a bound proves that it takes" in answer.message
    proved = Prove().solve(problem)
    assert proved.status is Status.INFEASIBLE
    assert proved.lower_bound > 0.99 * fastest.sum()
    assert Prove().stored_bound(problem, proved.stats) == proved.lower_bound


def test_a_segment_faster_than_its_velocity_limit_is_impossible_at_once():
    problem = Problem(WAYPOINTS, LIMITS, given_times=[5.0, 0.3, 5.0])
    proved = Prove().solve(problem)
    assert proved.status is Status.INFEASIBLE
    assert proved.lower_bound == pytest.approx(10.5)  # 1 rad at 2 rad/s in place of 0.3 s


def test_a_stream_is_retimed_at_its_own_spacing():
    """Rounded samples at 50 Hz, some of them twice: a motion through all of them, on time."""
    t = np.arange(0.0, 1.001, 0.02)
    s = t**3 * (10 - 15 * t + 6 * t**2)
    samples = np.round(np.outer(s, [0.5, -0.3]), 4)
    problem = Problem(samples, Limits([2.0, 2.0], [8.0, 8.0]), given_times=[0.02] * 50)
    motion = Exact().solve(problem).trajectory
    certificate = verify(problem, motion)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(1.0, rel=1e-12)
    assert np.abs(motion(t) - samples).max() <= 1e-9


def test_no_slower_motion_has_the_given_times():
    fastest = Exact().solve(Problem(WAYPOINTS, LIMITS)).trajectory
    fast = fastest.dilated(0.99)
    problem = Problem(WAYPOINTS, LIMITS, given_times=np.diff(fast.waypoint_times))
    certificate = verify(problem, fast)
    assert certificate.certified_duration is None
    assert certificate.flaws[0].endswith("and the times are given")
    slow = verify(problem, fastest)
    given = [f"s, {time:.6g} s are given" for time in np.diff(fast.waypoint_times)]
    # all are missed by one per cent: rounding says which is the worst
    assert any(said in slow.flaws[0] for said in given)


def test_asking_for_nothing_changes_nothing():
    plain = Problem(WAYPOINTS, LIMITS)
    asked = Problem(WAYPOINTS, LIMITS, least_times=[0, 0, 0], dwell=[0, 0, 0, 0])
    assert asked == plain
    assert asked.demands == {}


@pytest.mark.parametrize(
    ("demands", "message"),
    [
        ({"least_times": [1.0]}, r"least_times is \[1.0\]: expected 3 numbers, one per segment"),
        (
            {"least_times": [0, -1, 0]},
            "least_times, segment 2 is -1: expected a time of at least 0",
        ),
        ({"given_times": [1, 0, 1]}, "given_times, segment 2 is 0.0: expected a time above 0"),
        (
            {"given_times": [1, 1, 1], "least_times": [0, 1, 0]},
            "given_times or least_times, not both",
        ),
        ({"dwell": [0, np.inf, 0, 0]}, "dwell, waypoint 2 is inf: expected a time of at least 0"),
        (
            {"dwell": [1, 0, 0, 0], "start_velocity": [1, 0]},
            "dwell is 1.0: expected 0 at the first waypoint, where start_velocity is given",
        ),
    ],
)
def test_one_line_says_what_is_wrong(demands, message):
    with pytest.raises(InvalidInput, match=message):
        Problem(WAYPOINTS, LIMITS, **demands)


def test_a_planner_without_them_refuses_least_times():
    problem = Problem(WAYPOINTS, LIMITS, least_times=[0, 1.5, 0], dwell=[0, 0.2, 0, 0])
    answer = Spline().solve(problem)
    assert answer.status is Status.UNSUPPORTED
    assert answer.message == "it does not know least times"
    assert "does not know least times" in Exact(solver="ipopt").unsupported(problem)


def test_a_tiny_step_with_a_least_time_is_not_spared():
    waypoints = [[0.0], [1.0], [1.0 + 1e-9], [1.0 + 2e-9], [2.0]]
    limits = Limits([1.0], [1.0])
    assert spared(Problem(waypoints, limits)).any()
    assert not spared(Problem(waypoints, limits, least_times=[0, 0, 0.1, 0])).any()


def test_parts_keep_the_states_at_the_ends():
    problem = Problem(
        WAYPOINTS, LIMITS, start_velocity=[0.1, 0], end_velocity=[0, 0.2], dwell=[0, 0.3, 0, 0]
    )
    first, second = dwell.parts(problem)
    assert first.start_velocity.tolist() == [0.1, 0]
    assert not first.end_velocity.any()
    assert second.end_velocity.tolist() == [0, 0.2]
    assert [len(part.waypoints) for part in (first, second)] == [2, 3]
    assert list(pairwise(dwell.ends(problem))) == [(0, 1), (1, 3)]
    assert json.dumps(problem.route.demand("dwell").tolist()) == "[0.0, 0.3, 0.0, 0.0]"
