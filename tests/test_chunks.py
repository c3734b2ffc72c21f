"""Chunks: closed forms, never worse than the spline, states at the ends, bad input."""

import numpy as np
import pytest

import trajopt
from trajopt import InvalidInput, Limits
from trajopt.benchmark.suites.chunks import KINDS, targets
from trajopt.chunks import DilatedSpline, answers, from_samples, take_over
from trajopt.core.chain import LinkChain
from trajopt.core.solution import Solution, Status

V, A = 2.0, 10.0
ONE = Limits(velocity=[V], acceleration=[A])
THREE = Limits(velocity=[V] * 3, acceleration=[A] * 3)


def small(kind, number=0, **keywords):
    return from_samples(targets(kind, number, 16, 3), THREE, rate=30, name=kind, **keywords)


def test_read_me_first_a_straight_chunk_takes_the_time_of_its_trapezoid():
    answer = from_samples(np.linspace(0, 1, 30)[:, None], ONE, rate=30).fastest()
    assert answer.duration == pytest.approx(1 / V + V / A, rel=5e-4)
    assert answer.deviation <= 0.005 * (1 + 1e-9)


def test_several_chunks_at_once_and_never_slower_than_the_spline():
    for answer in answers([small(kind) for kind in KINDS]):
        assert answer.duration <= answer.spline * (1 + 1e-9), answer
        passed = answer.motion(answer.motion.waypoint_times)
        assert np.abs(passed - answer.chunk.problem.waypoints).max() <= 0.005 * (1 + 1e-6)


def test_the_spline_is_dilated_as_its_closed_form_says():
    # q = 3 s² − 2 s³: at most 1.5 h/T and 6 h/T²
    found = from_samples([[0.0], [1.0]], ONE, rate=1)
    assert found.spline.motion(found.problem).duration == pytest.approx(
        max(1.5 / V, np.sqrt(6 / A)), rel=1e-9
    )


def test_with_jerk_limits_the_spline_is_quintic():
    # q = 10 s³ − 15 s⁴ + 6 s⁵: at most 60 h/T³
    limits = Limits(velocity=[100.0], acceleration=[1000.0], jerk=[60.0])
    found = from_samples([[0.0], [1.0]], limits, rate=1)
    assert found.spline.motion(found.problem).duration == pytest.approx(1.0, rel=1e-9)


def test_given_times_that_are_possible_are_the_answer():
    chunk = small("smooth")
    slow = from_samples(chunk.problem.waypoints, THREE, times=2 * chunk.times)
    answer = slow.at_given_times()
    assert answer.motion.waypoint_times == pytest.approx(2 * chunk.times, abs=1e-12)
    assert answer.delay == pytest.approx(0, abs=1e-12)


def test_times_that_are_not_possible_are_late_by_the_least_time():
    answer = from_samples([[0.0], [1.0]], ONE, rate=10).at_given_times()
    assert answer.delay == pytest.approx(1 / V + V / A - 0.1, rel=1e-6)


def test_a_chunk_begins_in_the_state_of_the_arm():
    chunk = small("noisy")
    place = chunk.problem.waypoints[0] - [0.02, 0.01, 0.0]
    velocity = [0.3, -0.2, 0.1]
    moving = from_samples(
        chunk.problem.waypoints, THREE, rate=30, start=place, start_velocity=velocity
    )
    answer = moving.fastest()
    assert answer.motion(0.0) == pytest.approx(place, abs=1e-9)
    assert answer.motion(0.0, 1) == pytest.approx(velocity, abs=1e-9)
    assert len(moving.times) == 17


def test_a_spline_in_motion_keeps_its_velocity_at_the_start():
    chunk = small("smooth", start_velocity=[0.3, 0.0, 0.0])
    motion = chunk.spline.motion(chunk.problem)
    assert motion(0.0, 1) == pytest.approx([0.3, 0, 0], abs=1e-9)
    assert trajopt.verify(chunk.problem, motion).feasible


@pytest.mark.parametrize(("jerk", "timeout"), [(None, None), (1e3, None), (1e3, 60.0)])
def test_a_limit_that_the_planner_does_not_know_times_its_path(jerk, timeout):
    # 1 m along a line at a tool speed v, an acceleration a and a jerk j: 1/v + v/a + a/j; dilated
    # it takes 2 s
    chain = LinkChain(np.tile(np.eye(4), (2, 1, 1)), np.eye(3)[:2], np.ones(2, dtype=bool))
    acceleration = np.array([3.0, 4.0])
    steepest = None if jerk is None else acceleration / 5 * jerk
    limits = Limits([10.0, 10.0], acceleration, steepest, tool_speed=1.0)
    line = np.linspace([0.0, 0.0], [0.6, 0.8], 6)
    chunk = from_samples(line, limits, rate=30, chain=chain, tolerance=0, joint_units=["m", "m"])
    (answer,) = answers([chunk], timeout=timeout)
    closed_form = 1 / 1 + 1 / 5 + (5 / jerk if jerk else 0.0)
    assert answer.duration == pytest.approx(closed_form, rel=1e-3)


def test_repeated_targets_are_passed():
    rows = np.repeat(targets("smooth", 1, 8, 3), 2, axis=0)
    answer = from_samples(rows, THREE, rate=30).fastest()
    assert answer.duration is not None


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"targets": [[0.0]]}, "at least two targets"),
        ({"targets": [[0.0], [np.nan]]}, "target 2"),
        ({"targets": [[0.0], [0.0]]}, "never move"),
        ({"times": [0.0, 0.2, 0.1]}, "times, target 3"),
        ({"times": [0.0, 0.1]}, "3, one per target"),
        ({"rate": 0.0}, "above 0"),
        ({"rate": None}, "one of both"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"start": [0.0, 1.0]}, "1 numbers"),
        ({"limits": Limits([V], [A], position=[[-0.5, 0.5]])}, "waypoint 3"),
    ],
)
def test_what_cannot_be_used_is_named(keywords, said):
    given = {"targets": [[0.0], [0.4], [1.0]], "limits": ONE, "rate": 30.0, **keywords}
    if "times" in given:
        given["rate"] = None
    with pytest.raises(InvalidInput, match=said):
        from_samples(**given)


def test_the_spline_answers_where_the_planner_does_not():
    def silent(problem):
        return trajopt.Solution(trajopt.Status.FAILED, message="no")

    (answer,) = answers([small("smooth")], planner=silent)
    assert answer.trial.planner == "spline"
    assert answer.duration == pytest.approx(answer.spline)


def test_the_spline_is_a_planner():
    chunk = small("smooth")
    assert DilatedSpline(tuple(chunk.times)).solve(chunk.problem).trajectory is not None


def test_new_targets_take_over_from_a_motion_that_runs():
    chunk = small("noisy")
    running = chunk.fastest().motion
    at = 0.4 * running.duration
    ahead = chunk.problem.waypoints[np.searchsorted(running.waypoint_times, at) + 1 :] + 0.01
    answer = take_over(running, at, ahead, THREE, rate=30)
    for order in (0, 1):
        assert answer.motion(0.0, order) == pytest.approx(running(at, order), abs=1e-7)
    assert answer.motion(answer.motion.duration) == pytest.approx(ahead[-1], abs=1e-9)


def test_under_jerk_limits_the_spline_takes_over_with_its_acceleration():
    limits = Limits(velocity=[V] * 3, acceleration=[A] * 3, jerk=[200.0] * 3)
    rows = targets("smooth", 0, 16, 3)
    slow = from_samples(rows, limits, times=np.arange(16) / 8)
    running = slow.spline.motion(slow.problem)
    at = 0.4 * running.duration
    answer = take_over(running, at, rows[8:], limits, rate=8)
    assert answer.trial.planner == "spline"
    for order in (0, 1, 2):
        assert answer.motion(0.0, order) == pytest.approx(running(at, order), abs=1e-6)


def test_a_quick_answer_under_jerk_limits_is_the_closed_form_of_a_straight_chunk():
    limits = Limits(velocity=[V], acceleration=[A], jerk=[100.0])
    straight = from_samples(np.linspace(0, 1, 30)[:, None], limits, rate=30)
    (answer,) = answers([straight], quick=True)
    assert answer.trial.planner == "few-targets"
    assert answer.duration == pytest.approx(1 / V + V / A + A / 100, rel=1e-9)


def test_under_jerk_limits_the_quick_answer_stands_where_the_search_has_none():
    limits = Limits(velocity=[V] * 3, acceleration=[A] * 3, jerk=[200.0] * 3)
    rows = targets("noisy", 0, 16, 3)
    chunk = from_samples(rows, limits, rate=30)

    def stopped(problem):
        return Solution(Status.FAILED, message="stopped")

    (answer,) = answers([chunk], planner=stopped)
    assert answer.trial.planner == "few-targets"
    faster = from_samples(rows, THREE, rate=30).fastest()
    assert faster.duration < answer.duration < 0.5 * answer.spline
    assert answer.deviation <= 0.005 * (1 + 1e-9)
    running = chunk.spline.motion(chunk.problem)
    back = take_over(running, 99.0, rows[::-1][1:], limits, rate=30)
    assert back.trial.planner == "few-targets"
    assert back.duration == pytest.approx(answer.duration, rel=5e-2)
    given = answers([chunk], "at-given-times", quick=True)[0]
    assert given.trial.planner == "spline"


def test_after_its_end_a_motion_that_runs_is_at_rest():
    chunk = small("smooth")
    running = chunk.fastest().motion
    rows = chunk.problem.waypoints[::-1]
    answer = take_over(running, 99.0, rows[1:], THREE, rate=30)
    assert "start_velocity" not in answer.chunk.problem.demands
    assert answer.duration == pytest.approx(running.duration, rel=2e-2)  # the way back


def test_a_bound_is_below_the_answer_and_near_it():
    # one joint there and back: two trapezoids, of which the turning point is a target
    way = np.append(np.linspace(0, 1, 8), np.linspace(1, 0, 8)[1:])[:, None]
    answer = from_samples(way, ONE, rate=30).fastest()
    bound = answer.bound(seconds=5)
    assert bound <= answer.duration <= bound * (1 + 0.01)


def test_the_suite_has_chunks_of_four_kinds_by_their_names():
    from trajopt.benchmark.suites import catalogue

    found = catalogue.problems("chunks")
    assert len(found) == 3 * len(KINDS)
    for own in found:
        assert catalogue.load(own.name) == own
    noisy, anchored = (catalogue.load(f"chunks-{kind}-0") for kind in ("noisy", "anchored"))
    smooth = catalogue.load("chunks-smooth-0").waypoints
    assert np.std(noisy.waypoints - smooth) == pytest.approx(np.radians(0.05), rel=0.15)
    shifts = np.abs(anchored.waypoints - smooth)
    assert not shifts[:25].any()
    assert ((shifts[25:] >= 0.02) & (shifts[25:] <= 0.07)).all()
