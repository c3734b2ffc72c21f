"""Anyone's motion judged: passing times, the tolerance as another problem, limits alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly

import trajopt
from trajopt.benchmark.judgement import GivenMotion, as_executed
from trajopt.core.exceptions import InvalidInput, InvalidTrajectory
from trajopt.core.problem import Limits, Problem
from trajopt.core.solution import Status
from trajopt.core.trajectory import Trajectory
from trajopt.formats.motion import motion
from trajopt.formats.samples import Samples
from trajopt.judging.passing import waypoint_times
from trajopt.judging.verification import verify

FREE = Limits([10.0, 10.0], [10.0, 10.0])


def circle() -> Trajectory:
    """About (cos t, sin t), twice around."""
    t = np.linspace(0, 4 * np.pi, 49)
    return Trajectory.from_ppoly(CubicSpline(t, np.c_[np.cos(t), np.sin(t)]))


def test_closest_points_are_those_of_calculus():
    """q = (t, t²): from (0, 1) the closest has 2 t³ − t = 0, t = sqrt(1/2)."""
    parabola = Trajectory([0, 1], [[[0.0, 1.0]], [[1.0, 0.0]], [[0.0, 0.0]]], [0, 1])
    times = waypoint_times(parabola, np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]]))
    np.testing.assert_allclose(times, [0, np.sqrt(0.5), 1], atol=1e-12)


def test_a_motion_that_comes_by_early_does_not_mislead():
    """Twice around: left, right, top are only in this order if right is passed after one turn."""
    left, right, top = [-1.0, 0.0], [1.0, 0.0], [0.0, 1.0]
    waypoints = np.array([right, left, right, top, right])
    expected = np.pi * np.array([0, 1, 2, 2.5, 4])
    np.testing.assert_allclose(waypoint_times(circle(), waypoints), expected, atol=1e-3)
    # nearest of all to slightly beyond the top is the second pass, but what follows needs the first
    later = np.array([right, top, left, top, right])
    expected = np.pi * np.array([0, 0.5, 1, 2.5, 4])
    np.testing.assert_allclose(waypoint_times(circle(), later), expected, atol=1e-3)


def test_stated_times_of_a_planner_are_found_again():
    problem = Problem([[0.0, 0.0], [1.0, -0.5], [0.2, 0.4], [1.0, 1.0]], FREE)
    t = np.array([0.0, 0.7, 1.9, 2.5])
    spline = CubicSpline(t, problem.waypoints, bc_type="clamped")
    judged = trajopt.judge(problem, spline)
    assert judged.trajectory.waypoint_times.tolist() == t.tolist()
    # also where they are not at breaks
    whole = Trajectory.from_ppoly(spline).refined(np.linspace(0.01, 2.49, 31))
    moved = PPoly(np.delete(whole.coefficients, [], 1), whole.breaks)
    judged = trajopt.judge(problem, moved)
    np.testing.assert_allclose(judged.trajectory.waypoint_times, t, atol=1e-12)
    assert judged.certificate.waypoint.value < 1e-13


def test_where_the_motion_stands_on_a_waypoint_within_a_piece_it_is_met_closely():
    """q = 1 + (t − 1)³ stands at t = 1: the distance is flat there, the time less sharp."""
    stand = PPoly([[1.0], [-3.0], [3.0], [0.0]], [0.0, 2.0])
    times = waypoint_times(Trajectory.from_ppoly(stand), np.array([[0.0], [1.0], [2.0]]))
    assert abs((times[1] - 1) ** 3) < 1e-10


def bang_bang(**changes) -> Samples:
    """The optimum of 1 rad under 1 rad/s² by its breaks: 2 s."""
    table = {
        "joint_names": ("a",),
        "times": [0.0, 1.0, 2.0],
        "positions": [[0.0], [0.5], [1.0]],
        "velocities": [[0.0], [1.0], [0.0]],
    }
    return Samples(**(table | changes))


UNIT = Problem([[0.0], [1.0]], Limits([5.0], [1.0]), "unit", joint_names=("a",))


def test_the_optimum_has_no_gap_and_half_its_time_needs_twice_the_time():
    judged = trajopt.judge(UNIT, bang_bang())
    assert judged.certificate.feasible
    assert judged.status is Status.SOLVED
    assert judged.certified_duration == pytest.approx(2)
    assert judged.gap == pytest.approx(0, abs=1e-6)
    fast = bang_bang(times=[0, 0.5, 1], velocities=[[0.0], [2.0], [0.0]])
    judged = trajopt.judge(UNIT, fast)
    table = judged.as_dict()
    assert not table["feasible"]
    assert table["claimed_duration"] == 1
    assert table["dilation"] == pytest.approx(2)
    assert table["certificate"]["acceleration"]["ratio"] == pytest.approx(4)
    assert table["gap"] == pytest.approx(0, abs=1e-6)
    keys = "motion problem interpolation via_tolerance status claimed_duration certified_duration"
    keys += " feasible dilation gap waypoint_times flaws falling_velocity certificate"
    assert list(table) == keys.split()


def test_a_tolerance_is_another_problem_and_gains_nothing():
    """Short of the goal by 1 %: faster, but compared with the optimum to where it went."""
    short = bang_bang(
        times=[0, np.sqrt(0.99), 2 * np.sqrt(0.99)],
        positions=[[0.0], [0.495], [0.99]],
        velocities=[[0.0], [np.sqrt(0.99)], [0.0]],
    )
    strict = trajopt.judge(UNIT, short)
    assert strict.status is Status.INVALID
    assert strict.certified_duration is None
    assert strict.gap is None
    assert "misses the waypoint by 0.01 rad" in strict.as_dict()["flaws"][0]
    judged = trajopt.judge(UNIT, short, via_tolerance=0.011)
    assert judged.certificate.feasible
    assert judged.problem.name == "unit, as passed within 0.011 rad"
    np.testing.assert_allclose(judged.problem.waypoints, [[0], [0.99]], rtol=1e-15)
    assert judged.certified_duration == pytest.approx(2 * np.sqrt(0.99))
    assert judged.gap == pytest.approx(0, abs=1e-6)
    # a smaller word than the miss changes nothing, nor does one that is not needed
    assert trajopt.judge(UNIT, short, via_tolerance=0.009).status is Status.INVALID
    assert trajopt.judge(UNIT, bang_bang(), via_tolerance=0.1).problem is UNIT


@pytest.mark.parametrize("tolerance", [0.5, 7.0, -1e-9, np.nan, np.inf])
def test_a_tolerance_that_could_pass_two_waypoints_at_once_is_refused(tolerance):
    with pytest.raises(InvalidInput, match="less than half the shortest segment, 1 rad"):
        trajopt.judge(UNIT, bang_bang(), via_tolerance=tolerance)


def test_joints_are_matched_by_name():
    problem = Problem([[0.0, 0.0], [1.0, 2.0]], FREE, joint_names=("a", "b"))
    swapped = Samples(("b", "a"), [0, 2], [[0.0, 0.0], [2.0, 1.0]], np.zeros((2, 2)))
    assert trajopt.judge(problem, swapped).certificate.valid
    with pytest.raises(InvalidInput, match="expected the joints a, b"):
        trajopt.judge(problem, Samples(("b", "c"), [0, 1], np.eye(2), np.zeros((2, 2))))
    with pytest.raises(InvalidInput, match="joints is 1: expected 2, as the problem has"):
        trajopt.judge(problem, PPoly([[1.0], [0.0]], [0, 1]))


def test_a_namespace_of_all_joints_is_no_part_of_their_names():
    problem = Problem([[0.0, 0.0], [1.0, 2.0]], FREE, joint_names=("a", "b"))
    times = [0, 2]
    swapped = [[0.0, 0.0], [2.0, 1.0]]
    of_left_arm = Samples(("left/b", "left/a"), times, swapped, np.zeros((2, 2)))
    assert trajopt.judge(problem, of_left_arm).certificate.valid
    of_both = Samples(("left/b", "right/a"), times, swapped, np.zeros((2, 2)))
    with pytest.raises(InvalidInput, match="expected the joints a, b"):
        trajopt.judge(problem, of_both)


def test_limits_alone_need_no_waypoints_not_even_where_it_ends_where_it_starts():
    """To 1 rad and back, 2 s each way, under half the acceleration: sqrt(2) times slower."""
    there_and_back = bang_bang(
        times=[0, 1, 2, 3, 4],
        positions=[[0.0], [0.5], [1.0], [0.5], [0.0]],
        velocities=[[0.0], [1.0], [0.0], [-1.0], [0.0]],
    )
    found = as_executed(motion(there_and_back), Limits([5.0], [0.5]))
    assert not found.certificate.feasible
    assert found.certificate.dilation == pytest.approx(np.sqrt(2))
    assert found.as_dict()["certified_duration"] == pytest.approx(4 * np.sqrt(2))
    fast = as_executed(motion(there_and_back), Limits([5.0], [4.0]))
    assert fast.certificate.feasible
    assert fast.certificate.dilation == pytest.approx(0.5)
    keys = "motion interpolation duration feasible dilation certified_duration"
    keys += " falling_velocity certificate"
    assert list(fast.as_dict()) == keys.split()


def test_limits_alone_find_a_motion_outside_its_positions_or_not_at_rest():
    limits = Limits([5.0], [5.0], position=[[-1.0, 0.7]])
    outside = as_executed(motion(bang_bang()), limits)
    assert "leaves its position limits by 0.3 rad" in outside.certificate.flaws[0]
    moving = as_executed(motion(bang_bang(velocities=[[0.0], [1.0], [0.5]])), UNIT.limits)
    assert "velocity jumps by 0.5 rad/s" in moving.certificate.flaws[0]
    with pytest.raises(InvalidInput, match="stays where it is"):
        as_executed(motion(bang_bang(positions=np.zeros((3, 1)))), UNIT.limits)


def test_no_motion_is_judged_better_than_the_verifier_says():
    """The judge adds nothing of its own: what it certifies is what `verify` certifies."""
    judged = trajopt.judge(UNIT, bang_bang())
    assert judged.certificate == verify(UNIT, judged.trajectory)


def test_a_motion_is_compared_beside_planners_and_a_changed_one_is_another(tmp_path):
    def compared(samples):
        entry = ("theirs.csv", GivenMotion(motion(samples)))
        return trajopt.compare([UNIT], ["ruckig-stop", entry], tmp_path, seeds=1)

    results = compared(bang_bang())
    rows = results.trials().set_index("label")
    assert set(rows.index) == {"theirs.csv", "ruckig-stop", "exact"}
    assert rows.loc["theirs.csv", "certified_duration"] == pytest.approx(2)
    again = compared(bang_bang())
    assert again.kept.count == 3
    fast = bang_bang(times=[0, 0.5, 1], velocities=[[0.0], [2.0], [0.0]])
    changed = compared(fast)
    assert changed.kept.count == 2
    row = changed.trials().set_index("label").loc["theirs.csv"]
    assert row["claimed_duration"] == 1
    assert row["certified_duration"] == pytest.approx(2)
    figure = changed.plot()
    assert "theirs.csv" in [text.get_text() for text in figure.axes[0].get_yticklabels()]
    with pytest.raises(InvalidInput, match="expected one of unit"):
        changed.plot("other")


def test_a_motion_of_another_robot_is_unsupported():
    entry = GivenMotion(motion(bang_bang()))
    assert entry.unsupported(UNIT) is None
    two = Problem([[0.0, 0.0], [1.0, 2.0]], FREE)
    assert entry.solve(two).status is Status.UNSUPPORTED
    renamed = Problem([[0.0], [1.0]], UNIT.limits, joint_names=("elbow",))
    assert "expected the joints elbow" in entry.solve(renamed).message


def test_values_are_readable():
    judged = trajopt.judge(UNIT, bang_bang())
    said = "Trajectory(2 s, 1 joints, 2 pieces of degree 3, waypoints at 0, 2 s)"
    assert repr(judged.trajectory) == said
    assert repr(judged.certificate).startswith("Certificate(feasible, 2 s claimed, dilation 1")
    worst = trajopt.judge(UNIT, bang_bang(positions=[[0.0], [0.5], [0.9]])).certificate
    assert repr(worst).startswith("Certificate(invalid: a at 2 s: misses the waypoint by 0.1")


@pytest.mark.parametrize("size", [1e250, 1e-300])
@pytest.mark.parametrize("duration", [1e-8, 1.0, 1e9])
def test_huge_and_tiny_motions_end_in_a_verdict(size, duration):
    samples = Samples(("a",), [0, duration], [[0.0], [size]], np.zeros((2, 1)))
    assert not trajopt.judge(UNIT, samples).certificate.valid
    found = as_executed(motion(samples), UNIT.limits)
    # 6 h / T² at both ends
    expected = np.sqrt(6 * size) / duration
    if expected > 1e-150:
        assert found.certificate.dilation >= expected * (1 - 1e-9)


def test_what_overflows_is_refused():
    samples = Samples(("a",), [0, 1e-200], [[0.0], [1.0]], np.zeros((2, 1)))
    with pytest.raises(InvalidTrajectory, match="not finite"):
        motion(samples)


def test_a_tolerance_that_mends_nothing_changes_nothing():
    jumping = Samples(("a",), [0, 1, 2], [[0.0], [0.3], [0.995]])
    judged = trajopt.judge(UNIT, jumping, via_tolerance=0.01)
    assert judged.problem is UNIT
    assert not judged.tolerance_needed
    assert any("velocity jumps" in flaw for flaw in judged.certificate.flaws)
