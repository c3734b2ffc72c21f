"""Anyone's motion judged: passing times, the tolerance as another problem, limits alone."""

from __future__ import annotations

from dataclasses import replace
from math import factorial

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline

import trajopt
from trajopt.benchmark.store import trial_text
from trajopt.core.exceptions import FileNote, InvalidInput, InvalidTrajectory
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.formats.motion import motion
from trajopt.formats.samples import Samples
from trajopt.judgement import GivenMotion, as_executed, motion_of
from trajopt.judging import slower
from trajopt.judging.passing import waypoint_times
from trajopt.judging.verification import verify
from trajopt.planners.registry import load

FREE = Limits([10.0, 10.0], [10.0, 10.0])


def rows(text: str) -> list[list[float]]:
    """Numbers, a row before each semicolon."""
    return [[float(number) for number in row.split()] for row in text.split(";")]


def circle() -> Trajectory:
    """About (cos t, sin t), twice around."""
    t = np.linspace(0, 4 * np.pi, 49)
    points = np.column_stack([np.cos(t), np.sin(t)])
    return Trajectory.from_ppoly(CubicSpline(t, points))


def test_closest_points_are_those_of_calculus():
    """q = (t, t²): from (0, 1) the closest has 2 t³ − t = 0, t = sqrt(1/2)."""
    coefficients = [rows("0 1"), rows("1 0"), rows("0 0")]
    parabola = Trajectory([0, 1], coefficients, [0, 1])
    times = waypoint_times(parabola, np.array(rows("0 0; 0 1; 1 1")))
    np.testing.assert_allclose(times, [0, np.sqrt(0.5), 1], atol=1e-12)


@pytest.mark.parametrize(
    ("waypoints", "half_turns"),
    [
        # right, left, right, top, right: only if right is passed after one turn
        ("1 0; -1 0; 1 0; 0 1; 1 0", "0 1 2 2.5 4"),
        # right, top, left, top, right: the second pass of the top would be too late
        ("1 0; 0 1; -1 0; 0 1; 1 0", "0 0.5 1 2.5 4"),
    ],
)
def test_a_motion_that_comes_by_early_does_not_mislead(waypoints, half_turns):
    times = waypoint_times(circle(), np.array(rows(waypoints)))
    (expected,) = rows(half_turns)
    np.testing.assert_allclose(times / np.pi, expected, atol=1e-3)


def test_stated_times_of_a_planner_are_found_again():
    problem = Problem(rows("0 0; 1 -0.5; 0.2 0.4; 1 1"), FREE)
    t = np.array([0.0, 0.7, 1.9, 2.5])
    spline = CubicSpline(t, problem.waypoints, bc_type="clamped")
    judged = trajopt.judge(problem, spline)
    assert judged.trajectory.waypoint_times.tolist() == t.tolist()


def test_times_that_are_not_at_breaks_are_found_too():
    problem = Problem(rows("0 0; 1 -0.5; 0.2 0.4; 1 1"), FREE)
    t = np.array([0.0, 0.7, 1.9, 2.5])
    spline = CubicSpline(t, problem.waypoints, bc_type="clamped")
    more_breaks = np.linspace(0.01, 2.49, 31)
    whole = Trajectory.from_ppoly(spline).refined(more_breaks)
    judged = trajopt.judge(problem, PPoly(whole.coefficients, whole.breaks))
    np.testing.assert_allclose(judged.trajectory.waypoint_times, t, atol=1e-12)
    assert judged.certificate.waypoint.value < 1e-13


def test_where_the_motion_stands_on_a_waypoint_within_a_piece_it_is_met_closely():
    """q = 1 + (t − 1)³ stands at t = 1: the distance is flat there, the time less sharp."""
    stand = PPoly(rows("1; -3; 3; 0"), [0.0, 2.0])
    trajectory = Trajectory.from_ppoly(stand)
    _, time, _ = waypoint_times(trajectory, np.array(rows("0; 1; 2")))
    assert abs((time - 1) ** 3) < 1e-10


def samples(text: str = "0 0 0; 1 0.5 1; 2 1 0", names: tuple[str, ...] = ("a",)) -> Samples:
    """Times, positions and velocities; by default the optimum of 1 rad under 1 rad/s², 2 s."""
    table = np.array(rows(text))
    joints = len(names)
    return Samples(names, table[:, 0], table[:, 1 : joints + 1], table[:, joints + 1 :])


FAST = "0 0 0; 0.5 0.5 2; 1 1 0"  # the optimum in half its time
UNIT = Problem(rows("0; 1"), Limits([5.0], [1.0]), "unit", joint_names=("a",))


def test_the_optimum_has_no_gap_and_half_its_time_needs_twice_the_time():
    judged = trajopt.judge(UNIT, samples())
    assert judged.certificate.feasible
    assert judged.status is Status.SOLVED
    assert judged.certified_duration == pytest.approx(2)
    assert judged.gap == pytest.approx(0, abs=1e-6)
    judged = trajopt.judge(UNIT, samples(FAST))
    table = judged.as_dict()
    assert not table["feasible"]
    assert table["claimed_duration"] == 1
    assert table["dilation"] == pytest.approx(2)
    assert table["certificate"]["acceleration"]["ratio"] == pytest.approx(4)
    assert table["gap"] == pytest.approx(0, abs=1e-6)
    keys = "motion problem interpolation via_tolerance status duration claimed_duration"
    keys += " certified_duration feasible dilation gap waypoint_times flaws ends_taken"
    keys += " smoothness certificate evidence optimum_within_tolerance ends standing jumps nearly"
    assert set(table) == set(keys.split())


def test_a_tolerance_is_another_problem_and_gains_nothing():
    """Short of the goal by 1 %: faster, but compared with the optimum to where it went."""
    t = np.sqrt(0.99)
    short = samples(f"0 0 0; {t} 0.495 {t}; {2 * t} 0.99 0")
    strict = trajopt.judge(UNIT, short)
    assert strict.status is Status.INVALID
    assert strict.certified_duration is None
    assert strict.gap is None
    assert "misses the waypoint by 0.01 rad" in strict.as_dict()["flaws"][0]
    judged = trajopt.judge(UNIT, short, via_tolerance=0.011)
    assert judged.certificate.feasible
    assert judged.problem.name == "unit, as passed within 0.011 rad"
    np.testing.assert_allclose(judged.problem.waypoints, [[0], [0.99]], rtol=1e-15)
    assert judged.certified_duration == pytest.approx(2 * t)
    assert judged.gap == pytest.approx(0, abs=1e-6)
    # a smaller word than the miss changes nothing, nor does one that is not needed
    assert trajopt.judge(UNIT, short, via_tolerance=0.009).status is Status.INVALID
    assert trajopt.judge(UNIT, samples(), via_tolerance=0.1).problem is UNIT


@pytest.mark.parametrize("tolerance", [0.5, 7.0, -1e-9, np.nan, np.inf])
def test_a_tolerance_that_could_pass_two_waypoints_at_once_is_refused(tolerance):
    with pytest.raises(InvalidInput, match="less than half the shortest segment, 1 rad"):
        trajopt.judge(UNIT, samples(), via_tolerance=tolerance)


TWO_JOINTS = Problem(rows("0 0; 1 2"), FREE, joint_names=("a", "b"))
SWAPPED = "0 0 0 0 0; 2 2 1 0 0"


def test_joints_are_matched_by_name():
    assert trajopt.judge(TWO_JOINTS, samples(SWAPPED, ("b", "a"))).certificate.valid
    with pytest.raises(InvalidInput, match="expected the joints a, b"):
        trajopt.judge(TWO_JOINTS, samples(SWAPPED, ("b", "c")))
    one = PPoly(rows("1; 0"), [0, 1])
    with pytest.raises(InvalidInput, match="joints is 1: expected 2, as the problem has"):
        trajopt.judge(TWO_JOINTS, one)


def test_a_namespace_of_all_joints_is_no_part_of_their_names():
    left_arm = samples(SWAPPED, ("left/b", "left/a"))
    assert trajopt.judge(TWO_JOINTS, left_arm).certificate.valid
    both_arms = samples(SWAPPED, ("left/b", "right/a"))
    with pytest.raises(InvalidInput, match="expected the joints a, b"):
        trajopt.judge(TWO_JOINTS, both_arms)


def test_limits_alone_need_no_waypoints_not_even_where_it_ends_where_it_starts():
    """To 1 rad and back, 2 s each way, under half the acceleration: sqrt(2) times slower."""
    there_and_back = samples("0 0 0; 1 0.5 1; 2 1 0; 3 0.5 -1; 4 0 0")
    found = as_executed(motion(there_and_back), Limits([5.0], [0.5]))
    assert not found.certificate.feasible
    assert found.certificate.dilation == pytest.approx(np.sqrt(2))
    assert found.as_dict()["certified_duration"] == pytest.approx(4 * np.sqrt(2))
    fast = as_executed(motion(there_and_back), Limits([5.0], [4.0]))
    assert fast.certificate.feasible
    assert fast.certificate.dilation == pytest.approx(0.5)
    keys = "motion interpolation duration feasible dilation certified_duration"
    keys += " ends jumps standing smoothness certificate evidence"
    assert list(fast.as_dict()) == keys.split()


def test_limits_alone_find_a_motion_outside_its_positions():
    limits = Limits([5.0], [5.0], position=[[-1.0, 0.7]])
    outside = as_executed(motion(samples()), limits)
    said = "a at 2 s: leaves its position limits by 0.3 rad (1 of 0.7)"
    assert outside.certificate.flaws == (said,)  # one finding, not three
    assert outside.certificate.position.value == pytest.approx(0.3)
    with pytest.raises(InvalidInput, match="stays where it is"):
        as_executed(motion(samples("0 0 0; 1 0 1; 2 0 0")), UNIT.limits)


def test_limits_alone_take_the_ends_of_a_motion_as_facts():
    given = motion(samples("0 0 0; 1 0.5 1; 2 1 0.5"))
    moving = as_executed(given, Limits([5.0], [5.0]))
    assert moving.kept
    assert moving.as_dict()["ends"] == {"start_velocity": [0.0], "end_velocity": [0.5]}
    resting = as_executed(given, Limits([5.0], [5.0]), ends={})
    assert "velocity jumps by 0.5 rad/s" in resting.certificate.flaws[0]


@pytest.mark.parametrize("jerk", [None, [300.0, 300.0]])
@pytest.mark.parametrize("seed", range(6))
def test_a_cut_changes_no_verdict_on_limits(seed, jerk):
    """The uses of a part are those of the whole there; the parts together use as much."""
    rng = np.random.default_rng(seed)
    rows = rng.uniform(-1, 1, (6, 2)).cumsum(axis=0)
    times = rng.uniform(0.5, 1.5, 6).cumsum()
    rest = [(order, np.zeros(2)) for order in (1, 2)]
    whole = make_interp_spline(times - times[0], rows, k=5, bc_type=(rest, rest))
    limits = Limits([2.5, 2.5], [9.0, 9.0], jerk)
    motions = as_ppoly(whole)
    entire = as_executed(motion(motions), limits, ends={})
    at = rng.uniform(0.2, 0.8) * motions.x[-1]
    parts = [as_executed(motion(own), limits) for own in cut(motions, at)]
    assert all(not own.certificate.flaws for own in parts)
    for key, use in entire.certificate.uses.items():
        found = max(own.certificate.uses[key].value for own in parts)
        assert found == pytest.approx(use.value, rel=1e-6)
    assert entire.kept == all(own.kept for own in parts)


def as_ppoly(spline):
    """A spline as polynomials, from time 0 on."""
    t, rows, k = spline.t, spline.c, spline.k
    each = [PPoly.from_spline((t, column, k)) for column in rows.T]
    (pieces,) = np.nonzero(np.diff(each[0].x))
    breaks = np.append(each[0].x[pieces], each[0].x[-1])
    return PPoly(np.stack([own.c[:, pieces] for own in each], axis=2), breaks)


def cut(motion, at):
    """Both parts of a motion, each from time 0 on."""
    before = np.append(motion.x[motion.x < at], at)
    after = np.append(at, motion.x[motion.x > at])
    for breaks in (before, after):
        shifted = [
            np.array(
                [motion(start, nu=order) / factorial(order) for order in range(len(motion.c))][::-1]
            )
            for start in breaks[:-1]
        ]
        yield PPoly(np.stack(shifted, axis=1), breaks - breaks[0])


def test_a_waypoint_missed_by_little_gets_a_second_verdict():
    near = samples("0 0 0; 1 0.5 1; 2 1 0")
    problem = Problem([[0.0], [0.5], [1.0]], Limits([5.0], [1.0]), joint_names=("a",))
    shifted = replace(near, positions=[[0.0], [0.5], [1.0000019]])
    judged = trajopt.judge(problem, shifted)
    assert not judged.certificate.valid
    assert judged.nearly.via_tolerance == pytest.approx(2e-6)
    assert judged.nearly.certificate.valid
    assert judged.best is judged.nearly
    # sqrt(4 h) each way is the optimum between 0 and 1, and the motion is it
    assert judged.nearly.gap == pytest.approx(0, abs=1e-4)
    assert judged.as_dict()["nearly"]["via_tolerance"] == judged.nearly.via_tolerance
    far = replace(near, positions=[[0.0], [0.5], [1.2]])
    assert trajopt.judge(problem, far).nearly is None


def test_standing_at_the_ends_is_no_motion():
    """0.5 s before and 1 s after the optimum of 2 s."""
    given = samples("0 0 0; 0.5 0 0; 1.5 0.5 1; 2.5 1 0; 3.5 1 0")
    judged = trajopt.judge(UNIT, given)
    assert (judged.standing.start, judged.standing.end) == pytest.approx((0.5, 1.0))
    assert judged.standing.moving == pytest.approx(2)
    assert judged.gap == pytest.approx(0.75, abs=1e-5)
    assert not trajopt.judge(UNIT, samples()).standing


def test_steps_of_whole_turns_are_no_motion():
    turn = 2 * np.pi
    around = samples("0 3 0; 1 3.5 1; 2 4 0")
    wrapped = replace(around, positions=[[3.0], [3.5 - turn], [4.0 - turn]])
    limits = Limits([1.0], [4.0])
    with pytest.warns(FileNote, match="steps of whole turns are no motion of a"):
        found = as_executed(motion(wrapped), limits)
    assert found.kept
    assert found.certificate.velocity.value == pytest.approx(1)
    with pytest.warns(FileNote, match="steps of whole turns"):
        judged = trajopt.judge(Problem([[3.0], [4.0]], limits, joint_names=("a",)), wrapped)
    assert judged.certificate.valid
    elsewhere = replace(around, positions=around.positions - turn)
    with pytest.warns(FileNote, match="moved by whole turns to the first waypoint: joint 1"):
        assert trajopt.judge(Problem([[3.0], [4.0]], limits), elsewhere).certificate.valid
    bounded = Limits([1.0], [4.0], position=[[-4.0, 4.0]])
    assert not as_executed(motion(wrapped), bounded).kept


def test_no_motion_is_judged_better_than_the_verifier_says():
    """The judge adds nothing of its own: what it certifies is what `verify` certifies."""
    judged = trajopt.judge(UNIT, samples())
    assert judged.certificate == verify(UNIT, judged.trajectory)


def test_a_motion_is_compared_beside_planners_and_a_changed_one_is_another(tmp_path):
    def compared(given):
        entry = ("theirs.csv", GivenMotion(motion(given)))
        return trajopt.compare([UNIT], ["ruckig-stop", entry], tmp_path, seeds=1)

    results = compared(samples())
    rows = results.trials().set_index("label")
    assert set(rows.index) == {"theirs.csv", "ruckig-stop", "exact"}
    assert rows.loc["theirs.csv", "certified_duration"] == pytest.approx(2)
    again = compared(samples())
    assert again.kept.count == 3
    changed = compared(samples(FAST))
    assert changed.kept.count == 2
    row = changed.trials().set_index("label").loc["theirs.csv"]
    assert row["claimed_duration"] == 1
    assert row["certified_duration"] == pytest.approx(2)
    figure = changed.plot()
    assert "theirs.csv" in [text.get_text() for text in figure.axes[0].get_yticklabels()]
    with pytest.raises(InvalidInput, match="expected one of unit"):
        changed.plot("other")


def test_a_motion_of_another_robot_is_unsupported():
    entry = GivenMotion(motion(samples()))
    assert entry.unsupported(UNIT) is None
    assert entry.solve(TWO_JOINTS).status is Status.UNSUPPORTED
    renamed = Problem(UNIT.waypoints, UNIT.limits, joint_names=("elbow",))
    assert "expected the joints elbow" in entry.solve(renamed).message


def test_a_motion_in_motion_that_breaks_a_limit_has_all_numbers_from_one_search(monkeypatch):
    """It was planned with 2 % more acceleration. Its file says no waypoint times."""
    asked = {"start_velocity": [0.5]}
    problem = Problem([[0.0], [0.7], [1.0]], Limits([5.0], [1.0]), demands=asked)
    fast = load("exact").solve(replace(problem, limits=Limits([5.0], [1.02]))).trajectory
    ran = []
    search = slower.slower
    monkeypatch.setattr(slower, "slower", lambda *given: ran.append(1) or search(*given))
    judged = trajopt.judge(problem, PPoly(fast.coefficients, fast.breaks))
    assert judged.certified_duration > load("exact").solve(problem).trajectory.duration
    assert judged.explanation.certified_duration == pytest.approx(judged.certified_duration)
    # at its limit all the time but for a thousandth
    energy = judged.smoothness.acceleration_integral
    assert energy == pytest.approx(judged.certified_duration, rel=1e-2)
    assert len(ran) == 1


def test_a_motion_was_not_planned_with_the_limits_of_other_segments():
    problem = Problem([[0.0], [0.5], [1.0]], Limits([[[-2.0, 2.0]], [[-3.0, 3.0]]], [4.0]))
    assert GivenMotion(motion(samples())).solve(problem).message == ""


def test_values_are_readable():
    judged = trajopt.judge(UNIT, samples())
    said = "Trajectory(2 s, 1 joints, 2 pieces of degree 3, waypoints at 0, 2 s)"
    assert repr(judged.trajectory) == said
    assert repr(judged.certificate).startswith("Certificate(feasible, 2 s claimed, dilation 1")
    worst = trajopt.judge(UNIT, samples("0 0 0; 1 0.5 1; 2 0.9 0")).certificate
    assert repr(worst).startswith("Certificate(invalid: a at 2 s: misses the waypoint by 0.1")


@pytest.mark.parametrize("size", [1e250, 1e-300])
@pytest.mark.parametrize("duration", [1e-8, 1.0, 1e9])
def test_huge_and_tiny_motions_end_in_a_verdict(size, duration):
    given = samples(f"0 0 0; {duration} {size} 0")
    assert not trajopt.judge(UNIT, given).certificate.valid
    found = as_executed(motion(given), UNIT.limits)
    # 6 h / T² at both ends
    expected = np.sqrt(6 * size) / duration
    if expected > 1e-150:
        assert found.certificate.dilation >= expected * (1 - 1e-9)


def test_what_overflows_is_refused():
    with pytest.raises(InvalidTrajectory, match="not finite"):
        motion(samples("0 0 0; 1e-200 1 0"))


def test_a_tolerance_that_mends_nothing_changes_nothing():
    jumping = Samples(("a",), [0, 1, 2], rows("0; 0.3; 0.995"))
    judged = trajopt.judge(UNIT, jumping, via_tolerance=0.01)
    assert judged.problem is UNIT
    assert not judged.tolerance_needed
    assert any("velocity jumps" in flaw for flaw in judged.certificate.flaws)


# --- a trial's file ---


@pytest.mark.parametrize("brief", [False, True])
def test_a_trials_file_is_a_motion(tmp_path, brief):
    own = trajopt.plan("one-joint", "ruckig-stop")
    file = tmp_path / "trial.json"
    file.write_bytes(trial_text.write(own, brief=brief))
    found = motion_of(file)
    assert (found.name, found.interpolation) == ("trial.json", "polynomial")
    t = np.linspace(0, own.claimed_duration, 20)
    np.testing.assert_allclose(found.trajectory(t), own.solution.trajectory(t), atol=1e-12)
    judged = trajopt.judge("one-joint", file)
    assert judged.certified_duration == pytest.approx(own.certified_duration, rel=1e-9)
    with pytest.raises(InvalidInput, match="interpolation"):
        motion_of(file, "linear")


def test_a_trials_file_without_a_trajectory_is_no_motion(tmp_path):
    own = trajopt.plan("one-joint", "ruckig-stop")
    nothing = Solution(Status.FAILED, message="gave up")
    failed = replace(own, status=Status.FAILED, solution=nothing, certificate=None)
    file = tmp_path / "trial.json"
    file.write_bytes(trial_text.write(failed))
    with pytest.raises(InvalidInput, match="a trial with a trajectory"):
        motion_of(file)


@pytest.mark.parametrize(("begins", "little"), [(0.02, True), (0.3, False)])
def test_a_motion_that_begins_almost_at_rest_is_compared_with_its_equals(begins, little):
    problem = trajopt.Problem([[0.0], [1.0]], trajopt.Limits([2.0], [1.0]))
    # At 1 rad/s² up to the peak and down to rest: (peak² − begins²) / 2 + peak² / 2 = 1 rad.
    peak = np.sqrt(1 + begins**2 / 2)
    up, down = peak - begins, peak
    pieces = [[0.5, -0.5], [begins, peak], [0.0, begins * up + up**2 / 2]]
    judged = trajopt.judge(problem, PPoly(np.array(pieces)[..., None], [0, up, up + down]))
    assert not judged.certificate.valid
    assert (judged.nearly is not None) == little
    if little:
        assert judged.best.ends_taken == pytest.approx(begins)
        assert judged.best.via_tolerance == 0
        assert judged.best.gap == pytest.approx(0, abs=1e-6)
        assert "velocities at the ends" in judged.best.problem.name
