"""Waypoints within tolerance: from the file to the optimum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from baselines.lower_bound.apart import counted, relaxed
from baselines.lower_bound.planner import Prove
from baselines.ruckig_ import RuckigStop
from trajopt import Limits, Problem
from trajopt.core.exceptions import InvalidInput
from trajopt.judgement import passing
from trajopt.judging.verification import verify

WAYPOINTS = [[0.0, 0.0], [1.0, 0.5], [2.0, 0.0], [2.5, 1.0]]
LIMITS = Limits([2.0, 2.0], [4.0, 3.0])


def duration(problem):
    motion = Exact().solve(problem).trajectory
    certificate = verify(problem, motion)
    assert certificate.feasible
    return certificate.certified_duration


def test_a_turn_at_the_near_side_of_the_box():
    """From 0 to 0.85 and back, at velocity 1 and acceleration 2: 2 (0.85 + 0.5) s."""
    problem = Problem([[0.0], [1.0], [0.0]], Limits([1.0], [2.0]), tolerance=0.15)
    assert duration(problem) == pytest.approx(2.7, rel=1e-9)


def test_an_optimum_of_an_independent_transcription():
    """IPOPT, each joint with its own pieces of constant acceleration, seven of eight starts."""
    problem = Problem(
        [
            [0, 0],
            [0.715109, 0.450965],
            [1.862915, -0.350989],
            [-0.425134, -0.236242],
            [-1.036809, -0.26342],
        ],
        Limits([1.387653, 1.296697], [3.195667, 1.824948]),
        tolerance=0.05,
    )
    assert duration(problem) == pytest.approx(4.279624490079625, rel=1e-9)


def test_wider_never_takes_longer():
    rows = [0.0, 0.001, 0.02, [0.05, 0.02], [[0, 0], [0.2, 0.05], [0.05, 0.1], [0, 0]]]
    found = [duration(Problem(WAYPOINTS, LIMITS, tolerance=row)) for row in rows]
    assert np.diff(found).max() <= 1e-9
    assert found[0] == pytest.approx(duration(Problem(WAYPOINTS, LIMITS)), rel=1e-12)


def test_one_instant_may_pass_two_waypoints():
    """Boxes that overlap ask nothing of a straight line through them: rest to rest, 0 to 2."""
    limits = Limits([1.0, 1.0], [1.0, 1.0])
    straight = duration(Problem([[0.0, 0.0], [2.0, 2.0]], limits))
    waypoints = [[0.0, 0.0], [1.05, 0.95], [0.95, 1.05], [2.0, 2.0]]
    problem = Problem(waypoints, limits, tolerance=0.1)
    assert duration(problem) == pytest.approx(straight, rel=1e-9)
    assert duration(problem) < 0.99 * duration(Problem(waypoints, limits))
    motion = Exact().solve(Problem([[0.0, 0.0], [2.0, 2.0]], limits)).trajectory
    halfway = motion.duration / 2
    times = np.array([0.0, halfway, halfway, motion.duration])
    assert verify(problem, replace(motion, waypoint_times=times)).feasible
    apart = Problem(waypoints, limits, tolerance=0.1, least_times=[0, 0.5, 0])
    assert np.diff(Exact().solve(apart).trajectory.waypoint_times)[1] >= 0.5 * (1 - 1e-12)


@pytest.mark.parametrize("ulps", [-1, 0, 1, 3])
def test_boxes_that_miss_each_other_by_rounding_touch(ulps):
    """Boxes down to 0.85 and up to 0.85 ask nothing of the way from 0 to 2: 3 s."""
    second = 0.7 - ulps * np.spacing(0.7)
    problem = Problem([[0.0], [1.0], [second], [2.0]], Limits([1.0], [1.0]), tolerance=0.15)
    assert duration(problem) == pytest.approx(3.0, rel=1e-9)


@pytest.mark.parametrize("off", [0.0, 1e-17, -1e-16])
def test_waypoints_of_one_instant_are_one_place(off):
    """A motion passes two boxes at one time, at a corner of both, to its rounding."""
    limits = Limits([1.0, 1.0], [1.0, 1.0])
    straight = Exact().solve(Problem([[0.0, 0.0], [2.0, 2.0]], limits)).trajectory
    at = straight(straight.duration / 2)
    waypoints = np.array(
        [[0.0, 0.0], np.add(at, [0.1, -0.1 + off]), np.add(at, [-0.1 - off, 0.1]), [2.0, 2.0]]
    )
    problem = Problem(waypoints, limits, tolerance=[[0, 0], [0.1, 0.1], [0.1, 0.1], [0, 0]])
    half, whole = straight.duration / 2, straight.duration
    certificate = verify(problem, replace(straight, waypoint_times=[0.0, half, half, whole]))
    assert certificate.certified_duration == pytest.approx(3.0, rel=1e-12)


def test_boxes_that_are_apart_are_not_passed_at_one_instant():
    limits = Limits([1.0], [1.0])
    straight = Exact().solve(Problem([[0.0], [2.0]], limits)).trajectory
    half, whole = straight.duration / 2, straight.duration
    problem = Problem([[0.0], [1.1], [0.9], [2.0]], limits, tolerance=0.0999)
    certificate = verify(problem, replace(straight, waypoint_times=[0.0, half, half, whole]))
    assert not certificate.valid


def test_a_miss_counts_from_the_side_of_the_box():
    problem = Problem([[0.0], [1.0], [0.0]], Limits([1.0], [2.0]), tolerance=0.15)
    near = Problem([[0.0], [0.8], [0.0]], Limits([1.0], [2.0]))
    certificate = verify(problem, Exact().solve(near).trajectory)
    assert certificate.flaws[0].startswith("joint 1 at 1.3 s: misses the waypoint by 0.05 rad")
    inside = Problem([[0.0], [1.1], [0.0]], Limits([1.0], [2.0]))
    assert verify(problem, Exact().solve(inside).trajectory).feasible


def test_a_planner_of_exact_points_keeps_it():
    problem = Problem(WAYPOINTS, LIMITS, tolerance=0.1)
    exact_points = RuckigStop().solve(problem).trajectory
    assert verify(problem, exact_points).feasible


@pytest.mark.parametrize(
    ("tolerance", "message"),
    [
        (-1, "tolerance is -1: expected a distance of at least 0"),
        ("wide", "tolerance is 'wide': expected a number, 2 of them, one per joint, or 4 rows"),
        ([1, 2, 3], r"tolerance is \[1, 2, 3\]: expected a number, 2 of them, one per joint"),
        ([[0, 0], [0, 0], [0, 0], [0.1, 0]], "tolerance, waypoint 4 is 0.1: expected 0: the mot"),
    ],
)
def test_one_line_says_what_is_wrong(tolerance, message):
    with pytest.raises(InvalidInput, match=message):
        Problem(WAYPOINTS, LIMITS, tolerance=tolerance)


def test_it_must_leave_a_way():
    with pytest.raises(InvalidInput, match="within it no motion is needed"):
        Problem([[0.0], [0.1], [0.0]], Limits([1.0], [2.0]), tolerance=0.15)
    with pytest.raises(InvalidInput, match=r"tolerance, waypoint 2 is 0.1: expected 0, where"):
        Problem(WAYPOINTS, LIMITS, tolerance=0.1, dwell=[0, 1, 0, 0])


def test_a_file_says_it_in_the_unit_of_the_waypoints(tmp_path):
    file = tmp_path / "near.toml"
    file.write_text(
        "waypoints = [[0, 0], [90, 100], [0, 300]]\ntolerance = [9, 5]\n"
        'units = { waypoints = ["deg", "mm"], limits = ["deg", "m"] }\n'
        "[limits]\nvelocity = [180, 0.5]\nacceleration = [360, 1]\n",
        encoding="utf-8",
    )
    problem = Problem.from_toml(file)
    assert problem.tolerance[1] == pytest.approx([np.pi / 20, 0.005])
    assert not problem.tolerance[[0, 2]].any()
    file.write_text(problem.to_toml(), encoding="utf-8")
    assert Problem.from_toml(file) == problem


def proved(problem, **options):
    found = Prove(**options).solve(problem)
    stored = Prove().stored_bound(problem, found.stats)
    assert stored == (found.lower_bound if "proof_cutoff" in found.stats else None)
    return found


def test_a_bound_counts_the_boxes():
    problem = Problem([[0.0], [1.0], [0.0]], Limits([1.0], [2.0]), tolerance=0.15)
    found = proved(problem)
    assert 2.7 * (1 - 1.1e-4) <= found.lower_bound <= 2.7
    turned = Problem(WAYPOINTS, LIMITS, tolerance=[0.05, 0.02])
    found = proved(turned, within=1e-2)
    assert 0.99 * found.trajectory.duration <= found.lower_bound <= found.trajectory.duration


def test_a_bound_leaves_out_waypoints_that_one_instant_passes():
    limits = Limits([1.0, 1.0], [1.0, 1.0])
    waypoints = [[0.0, 0.0], [1.05, 0.95], [0.95, 1.05], [2.0, 2.0]]
    found = proved(Problem(waypoints, limits, tolerance=0.1), within=1e-2)
    assert "leaves out waypoints that others' tolerances overlap: 3" in found.message
    assert 0.99 * 3.0 <= found.lower_bound <= 3.0  # from rest to rest over 2 rad
    kept = Problem(waypoints, limits, tolerance=[[0, 0], [0.1, 0.1], [0, 0], [0, 0]])
    waits = replace(kept, demands={**kept.demands, "dwell": [0, 0, 0.2, 0]})
    assert counted(waits).tolist() == [True, False, True, True]


@pytest.mark.parametrize("jerk", [None, pytest.param([10.0], marks=pytest.mark.long)])
def test_a_bound_counts_the_limits_of_a_segment_that_takes_no_time(jerk):
    velocity = np.array([[[-9.0, 9.0]], [[-0.5, 0.5]], [[-9.0, 9.0]]])
    limits = Limits(velocity, [1.0], jerk)
    waypoints = [[0.0], [1.0], [1.05], [2.0]]
    problem = Problem(waypoints, limits, tolerance=np.reshape([0.0, 0.0, 0.1, 0.0], (4, 1)))
    half = Problem([[0.0], [1.0]], Limits([9.0], [1.0], jerk), end_velocity=[0.5])
    expected = 2 * (Exact() if jerk is None else RuckigStop()).solve(half).trajectory.duration
    found = proved(problem)
    assert expected * (1 - 1.1e-4) <= found.lower_bound <= expected
    # all waypoints count: without the third it would be 13 % less, as without its segment's limit
    assert "leaves out" not in found.message
    assert "proof_waypoints" not in found.stats


def test_a_proof_counts_waypoints_that_rise_through_all_with_a_wait():
    waits = Problem(WAYPOINTS, LIMITS, dwell=[0.0, 0.0, 0.2, 0.0])
    assert len(relaxed(waits, np.array([0, 2, 3])).waypoints) == 3
    for numbers in ([0, 1, 3], [0, 2], [1, 2, 3], [0, 2, 2, 3], [0, 2, 1, 3], [0]):
        with pytest.raises(InvalidInput, match="through all with a wait"):
            relaxed(waits, np.array(numbers))


@pytest.mark.parametrize("wide", [0.0998, pytest.param(0.09995, marks=pytest.mark.long)])
def test_what_hardly_moves_is_bounded(wide):
    problem = Problem([[0.0], [0.1], [0.0]], Limits([1.0], [1.0]), tolerance=wide)
    found = proved(problem, within=5e-2)
    optimum = 4 * np.sqrt(0.1 - wide)  # there and back between rests
    assert 0.94 * optimum <= found.lower_bound <= optimum * (1 + 1e-9)


def test_with_jerk_limits_a_turn_is_at_the_near_side_too():
    limits = Limits([1.0], [2.0], [8.0])
    within = ExactJerk().solve(Problem([[0.0], [1.0], [0.0]], limits, tolerance=0.15)).trajectory
    exactly = ExactJerk().solve(Problem([[0.0], [0.85], [0.0]], limits)).trajectory
    assert within.duration == pytest.approx(exactly.duration, rel=1e-9)


def test_with_jerk_limits_wider_never_takes_longer():
    limits = Limits([2.0, 2.0], [4.0, 3.0], [30.0, 40.0])
    found = []
    for row in (0.0, 0.002, [0.05, 0.02], [0.1, 0.1]):
        problem = Problem(WAYPOINTS, limits, tolerance=row)
        certificate = verify(problem, ExactJerk().solve(problem).trajectory)
        assert certificate.feasible
        found.append(certificate.certified_duration)
    assert np.diff(found).max() <= 1e-9


@pytest.mark.long
def test_with_jerk_limits_a_tolerance_counts_beside_moving_ends():
    limits = Limits([1.0], [2.0], [8.0])
    moving = {"start_velocity": [-0.3], "end_velocity": [-0.4], "end_acceleration": [0.5]}
    within = Problem([[0.0], [1.0], [0.0]], limits, tolerance=0.15, **moving)
    exactly = Problem([[0.0], [0.85], [0.0]], limits, **moving)
    durations = []
    for problem in (within, exactly):
        motion = ExactJerk().solve(problem).trajectory
        durations.append(verify(within, motion).certified_duration)
    # limits that rounding breaks are tightened by 1e-8
    assert durations[0] == pytest.approx(durations[1], rel=1e-7)
    # with limits of its own a segment between boxes that overlap is passed at one instant
    velocity = np.array([[[-1.0, 1.0]], [[-0.5, 0.5]], [[-1.0, 1.0]]])
    brief = Problem(
        [[0.0], [1.0], [1.05], [2.0]],
        Limits(velocity, [2.0], [8.0]),
        tolerance=np.reshape([0.0, 0.1, 0.1, 0.0], (4, 1)),
        start_velocity=[0.3],
    )
    motion = ExactJerk().solve(brief).trajectory
    assert np.diff(motion.waypoint_times)[1] < 1e-5
    # that instant has the velocity 0.5, wherever in both boxes it is: Ruckig's two parts join there
    parts = [
        Problem([[0.0], [1.0]], limits, start_velocity=[0.3], end_velocity=[0.5]),
        Problem([[1.0], [2.0]], limits, start_velocity=[0.5]),
    ]
    least = sum(RuckigStop().solve(part).trajectory.duration for part in parts)
    assert motion.duration == pytest.approx(least, rel=1e-9)
    assert motion(motion.waypoint_times[1], 1)[0] == pytest.approx(0.5, rel=1e-6)
    assert verify(brief, motion).certified_duration == pytest.approx(motion.duration, rel=1e-9)


def slow_between(tolerance):
    """Rest to rest over 2 rad at acceleration 1; the second segment allows a velocity of 0.5."""
    velocity = np.array([[[-9.0, 9.0]], [[-0.5, 0.5]], [[-9.0, 9.0]]])
    limits = Limits(velocity, [1.0])
    waypoints = [[0.0], [1.0], [1.05], [2.0]]
    return Problem(waypoints, limits, tolerance=tolerance)


@pytest.mark.parametrize(
    ("tolerance", "optimum"),
    [
        # a pass at p with velocity u takes 2 √(p + u²/2) + 2 √(2 − p + u²/2) − 2 u
        ([0.0, 0.0, 0.1, 0.0], 4 * np.sqrt(1.125) - 1),
        ([0.0, 0.1, 0.1, 0.0], 2 * np.sqrt(1.225) + 2 * np.sqrt(1.025) - 1),
    ],
)
def test_at_one_instant_the_segment_between_still_limits_velocity(tolerance, optimum):
    problem = slow_between(np.reshape(tolerance, (4, 1)))
    motion = Exact().solve(problem).trajectory
    assert np.diff(motion.waypoint_times)[1] == 0
    certificate = verify(problem, motion)
    assert certificate.certified_duration == pytest.approx(optimum, rel=1e-9)
    # without the segment, at √2 instead of 0.5: the judge slows it down that much
    free = Exact().solve(Problem([[0.0], [1.0], [2.0]], Limits([9.0], [1.0]))).trajectory
    times = free.waypoint_times[[0, 1, 1, 2]]
    certificate = verify(problem, replace(free, waypoint_times=times))
    assert certificate.dilation == pytest.approx(2 * np.sqrt(2), rel=1e-9)
    assert certificate.uses["velocity"].time == pytest.approx(np.sqrt(2), rel=1e-9)


def test_with_jerk_limits_velocity_at_one_instant_is_that_of_the_segment_between():
    velocity = np.array([[[-9.0, 9.0]], [[-0.5, 0.5]], [[-9.0, 9.0]]])
    limits = Limits(velocity, [1.0], [10.0])
    waypoints = [[0.0], [1.0], [1.05], [2.0]]
    tolerance = np.reshape([0.0, 0.0, 0.1, 0.0], (4, 1))
    problem = Problem(waypoints, limits, tolerance=tolerance)
    motion = ExactJerk().solve(problem).trajectory
    # twice what Ruckig takes from rest to the middle, 0.5 rad/s there and no acceleration
    half = Problem([[0.0], [1.0]], Limits([9.0], [1.0], [10.0]), end_velocity=[0.5])
    expected = 2 * RuckigStop().solve(half).trajectory.duration
    assert np.diff(motion.waypoint_times)[1] == 0
    assert verify(problem, motion).certified_duration == pytest.approx(expected, rel=1e-9)


def test_with_jerk_limits_acceleration_at_one_instant_is_that_of_the_segment_between():
    waypoints = [[0.0], [0.2], [0.25], [2.0]]
    tolerance = np.reshape([0.0, 0.0, 0.1, 0.0], (4, 1))
    acceleration = np.array([[[-1.0, 1.0]], [[-0.3, 0.3]], [[-1.0, 1.0]]])
    limits = Limits([9.0], acceleration, [10.0])
    problem = Problem(waypoints, limits, tolerance=tolerance)
    motion = ExactJerk().solve(problem).trajectory
    assert np.diff(motion.waypoint_times)[1] == 0
    certificate = verify(problem, motion)
    assert certificate.dilation == pytest.approx(1.0, rel=1e-9)
    assert motion(motion.waypoint_times[1], 2)[0] == pytest.approx(0.3, rel=1e-6)
    # without the segment, at the limit of the others: the judge slows it down that much
    free = Problem([[0.0], [0.2], [2.0]], Limits([9.0], [1.0], [10.0]))
    fast = ExactJerk().solve(free).trajectory
    fast = replace(fast, waypoint_times=fast.waypoint_times[[0, 1, 1, 2]])
    assert verify(problem, fast).dilation == pytest.approx(np.sqrt(1 / 0.3), rel=1e-6)
    # where acceleration may jump, an instant is no time for it to be too large
    jumping = replace(problem, limits=limits.without("jerk"))
    certificate = verify(jumping, Exact().solve(jumping).trajectory)
    assert certificate.certified_duration == pytest.approx(2 * np.sqrt(2), rel=1e-9)


def test_a_segment_between_equal_waypoints_limits_nothing():
    limits = slow_between(0.0).limits
    problem = Problem([[0.0], [1.0], [1.0], [2.0]], limits)
    certificate = verify(problem, Exact().solve(problem).trajectory)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(2 * np.sqrt(2), rel=1e-9)


def test_passing_times_within_boxes_keep_least_times_and_limits_of_segments(tmp_path):
    """The times of a motion that is read from a file: those that the boxes allow."""
    faster = np.array([[2.0, 2.0], [0.8, 0.5], [2.0, 2.0]])
    limits = Limits(np.stack([-faster, faster], axis=-1), [4.0, 4.0])
    waypoints = [[0.0, 0.0], [1.0, 0.5], [2.0, 0.0], [1.5, 0.4]]
    problem = Problem(
        waypoints,
        limits,
        start_velocity=[0.5, 0.0],
        end_velocity=[0.0, 0.1],
        tolerance=0.02,
        least_times=[0.0, 1.5, 0.0],
    )
    motion = Exact().solve(problem).trajectory
    untimed = replace(motion, waypoint_times=motion.waypoint_times[[0, -1]])
    assert passing(problem, untimed).waypoint_times == pytest.approx(motion.waypoint_times)
    assert verify(problem, passing(problem, untimed)).feasible


@pytest.mark.parametrize(
    "seed", [2, *(pytest.param(seed, marks=pytest.mark.long) for seed in (0, 3))]
)
def test_a_bound_without_a_waypoint_has_the_widest_limits_of_both_segments(seed):
    """Which segment a motion is in where a waypoint is left out, nobody knows."""
    rng = np.random.default_rng(seed)
    waypoints = [[0.0], [1.0], [1.05], [2.0 + rng.random()]]
    widths = rng.uniform(0.3, 2.0, (3, 1))
    limits = Limits(np.stack([-widths, widths], axis=-1), [4.0])
    problem = Problem(waypoints, limits, tolerance=0.3)
    motion = Exact().solve(problem).trajectory
    found = proved(problem, within=0.02)
    assert not counted(problem).all()
    assert found.lower_bound <= motion.duration * (1 + 1e-9)
    apart = Problem(waypoints, limits, tolerance=0.3, least_times=[0.0, 0.1, 0.0])
    assert counted(apart)[:3].all()


@pytest.mark.parametrize("value", [float("nan"), "0.1", {}])
def test_what_is_no_number_and_no_table_is_answered_with_every_form(value):
    right = "expected a number, 2 of them, one per joint, or 4 rows"
    with pytest.raises(InvalidInput, match=right):
        Problem(WAYPOINTS, LIMITS, tolerance=value)


def test_a_rough_stream_keeps_its_spacing_within_tolerance_and_has_none_exactly():
    """Samples of 1 mrad, some equal to the last: one instant passes no two of them."""
    s = np.arange(31) / 30
    samples = np.round(np.outer(s**3 * (10 - 15 * s + 6 * s * s), [0.2, -0.1]), 3)
    limits = Limits([2.0, 2.0], [8.0, 8.0], [200.0, 200.0])
    demands = {"given_times": np.full(30, 0.02)}
    exactly = Problem(samples, limits, **demands)
    assert proved(exactly).message.startswith("no motion takes the given time, 0.6 s")
    within = Problem(samples, limits, tolerance=1e-3, **demands)
    certificate = verify(within, ExactJerk().solve(within).trajectory)
    assert certificate.certified_duration == pytest.approx(0.6, rel=1e-9)


@pytest.mark.long
def test_a_bound_is_no_less_than_the_closed_form():
    """Boxes that overlap everywhere, of a straight way from rest to rest."""
    samples = np.linspace(0.0, 0.5, 9)[:, None]
    found = proved(Problem(samples, Limits([2.0], [8.0]), tolerance=0.2), time_limit=0.1)
    assert found.lower_bound == pytest.approx(0.5, rel=1.1e-4)  # 2 √(0.5/8)
