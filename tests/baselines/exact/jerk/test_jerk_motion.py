"""The motion of an optimum under jerk limits is certified as claimed, whatever is rounded."""

from __future__ import annotations

from math import fsum

import numpy as np
import pytest

from baselines.exact.jerk import ExactJerk
from baselines.exact.jerk import motion as jerk_motion
from experiments.known_optima import end_to_end, line, one_way
from experiments.scaling import walk
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem

NAMES = {
    "random-huge-j8-w30-jerk-07": 1e-9,  # 16,839 s, dips of 5e-5 s at the velocity limit
    "random-collinear-j8-w50-jerk-06": 1e-9,  # one jerk throughout a segment
    "random-huge-j12-w30-jerk-17": 1e-9,  # ramps of 5e-5 s after eight hours
    "random-tiny-j7-w10-jerk-17": 1e-9,  # segments a thousandth of the others
    # Ramps of 3e-4 s after 25,000 s, where times are stored to 4e-12 s: 1e-8 of a ramp.
    "random-unequal-j8-w50-jerk-11": 1e-9,
    # Segments of 5e-8 s after 30 s, where a time rounds by 8e-8 of them: once 2.2e-7 late.
    "random-tiny-j10-w50-jerk-16": 1e-9,
}


LONG = {"random-tiny-j10-w50-jerk-16"}


@pytest.mark.parametrize(
    ("name", "rounding"),
    [
        pytest.param(*case, marks=[pytest.mark.long] if case[0] in LONG else [])
        for case in NAMES.items()
    ],
)
def test_the_motion_is_certified_as_claimed(name: str, rounding: float) -> None:
    problem = load(name)
    solution = ExactJerk().solve(problem)
    assert solution.trajectory is not None
    assert verify(problem, solution.trajectory).dilation <= 1 + rounding
    assert solution.trajectory.duration <= min(solution.stats["start_duration"]) * (1 + 1e-9)


@pytest.mark.parametrize("seed", [15, 294, 335])
def test_jerk_limits_may_differ_up_and_down(seed: int) -> None:
    """On straight lines most segments have one motion only, here with two jerk limits."""
    problem = line(np.random.default_rng([26, seed]))
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert verify(problem, trajectory).dilation <= 1 + 1e-9


def test_many_pieces_end_at_the_next_waypoint() -> None:
    """Sums over some 100 pieces round: once a motion missed a waypoint by its last places."""
    rng = np.random.default_rng(0)
    limits = Limits([1.0] * 7, [2.0] * 7, [20.0] * 7)
    for path in np.cumsum(rng.uniform(-1, 1, (2, 4, 7)), axis=1):
        problem = Problem(path, limits)
        motion = ExactJerk().solve(problem).trajectory
        assert motion is not None
        ways = motion.pieces(0)[:-1].sum(axis=0)
        at = motion.breaks.searchsorted(motion.waypoint_times)
        for begin, end, step in zip(at[:-1], at[1:], problem.displacements, strict=True):
            reached = [fsum(own) for own in ways[begin:end].T]
            assert (np.abs(reached - step) < problem.rounding / 4).all()


def test_a_turn_is_braked_with_one_jerk() -> None:
    """Forth and back: by symmetry the joint turns at the waypoint, in the middle of the brake."""
    problem = Problem([[0.0], [1.0], [0.0]], Limits([10.0], [100.0], [1.0]))
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    # Jerk 1 for a time of 1, then -1 for s, until the velocity is 0: 1/2 + s - s²/2 = 0. A way of 1
    # instead of 1/6 + s/2 + s²/2 - s³/6 scales the times by its third root.
    s = 1 + np.sqrt(2)
    way = 1 / 6 + s / 2 + s**2 / 2 - s**3 / 6
    half = (1 + s) / np.cbrt(way)
    assert trajectory.duration == pytest.approx(2 * half, rel=1e-9)
    np.testing.assert_allclose(np.abs(jerks(trajectory)), 1.0, rtol=1e-9)


def jerks(trajectory: Trajectory) -> np.ndarray:
    """Jerk of every piece, `(pieces, joints)`."""
    middles = trajectory.breaks[:-1] + trajectory.lengths / 2
    return trajectory(middles, order=3)


def test_phases_end_within_their_segment() -> None:
    """Three in a row once ended after it: 1e-9 of the jerk limit too much."""
    problem = walk(200, jerk=True, position=False)
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert verify(problem, trajectory).dilation <= 1 + 3e-10


def short(trajectory: Trajectory) -> int:
    """Number of pieces below 1e-6 s."""
    return int((trajectory.lengths < 1e-6).sum())


@pytest.mark.parametrize(
    "name",
    [
        "jerk-limit",
        "edges-jerk-stiff",
        "robots-franka-fr3-w16-jerk",
        "robots-franka-panda-w16-jerk",
        "random-collinear-j6-w16-jerk-14",
        "random-huge-j8-w30-jerk-07",
        "random-zigzag-j5-w50-jerk-12",
    ],
)
def test_no_phase_of_the_barrier_is_left(name: str) -> None:
    """No piece is below 1e-6 s if no ramp is briefer than a hundredth of a second."""
    trajectory = ExactJerk().solve(load(name)).trajectory
    assert trajectory is not None
    assert short(trajectory) == 0


@pytest.mark.parametrize("seed", [15, 75, 115, 241, 305, 461, 486])
def test_no_break_is_left_that_no_limit_needs(seed: int) -> None:
    """On a line, where two joints' breaks or a dip at a limit once left pieces of 3e-7 s."""
    problem = line(np.random.default_rng([26, seed]))
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert short(trajectory) == 0
    assert verify(problem, trajectory).dilation <= 1 + 3e-10


@pytest.mark.parametrize("name", ["random-tiny-j9-w6-jerk-01", "random-huge-j2-w6-jerk-01"])
def test_a_brief_piece_stays_only_where_no_motion_does_without_it(name: str) -> None:
    """A linear program says which one does: a smooth change of acceleration exceeds limits."""
    problem = load(name)
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert short(trajectory) == 0
    assert verify(problem, trajectory).dilation <= 1 + 1e-9


def some_without_jerk(seed: int) -> Problem:
    """A random problem in which some joints have no jerk limit."""
    problem = random_problem(seed, jerk=True)
    rng = np.random.default_rng(seed)
    jerk = np.array(problem.limits.jerk)
    jerk[rng.uniform(size=len(jerk)) < 0.4] = [-np.inf, np.inf]
    own = problem.limits
    return Problem(problem.waypoints, Limits(own.velocity, own.acceleration, jerk))


@pytest.mark.parametrize("seed", [7066, 7084, 7088, 7102, 7119])
def test_joints_without_a_jerk_limit_share_the_breaks(seed: int) -> None:
    """Two joints' breaks 1e-14 of a segment apart once made jerk out of rounding: 54 times J."""
    problem = some_without_jerk(seed)
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert verify(problem, trajectory).dilation <= 1 + 1e-9


@pytest.mark.parametrize("seed", [7006, 7026, 7031, 7034, 7037, 7038])
def test_a_joint_without_a_jerk_limit_reaches_its_velocity_limit(seed: int) -> None:
    """The barrier keeps it 1e-8 below, and left two pieces of 5e-8 s at each waypoint."""
    problem = some_without_jerk(seed)
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert short(trajectory) == 0
    assert verify(problem, trajectory).dilation <= 1 + 1e-9


def test_a_brief_ramp_keeps_its_length() -> None:
    """A ramp of 2e-5 s starts a segment of which 3e-12 s are too many: the longest phase has them.

    The ramp once had them, and a jerk 1.4e-7 above its limit.
    """
    problem = random_problem(6017, jerk=True)
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert verify(problem, trajectory).dilation <= 1 + 1e-9


def test_a_joint_with_time_to_spare_has_few_breaks() -> None:
    """Of two joints the second has a thousand times the limits that it needs: three pieces."""
    one = Problem([[0.0], [1.0], [1.5], [0.0]], Limits([2.0], [3.0], [40.0]))
    alone = ExactJerk().solve(one).trajectory
    wide = Limits([2.0, 2000.0], [3.0, 3000.0], [40.0, 40000.0])
    waypoints = np.hstack([one.waypoints, one.waypoints])
    both = ExactJerk().solve(Problem(waypoints, wide)).trajectory
    assert alone is not None
    assert both is not None
    assert len(both.lengths) == len(alone.lengths)
    jumps = np.diff(jerks(both)[:, 1])
    changes = np.abs(jumps) > 1e-6
    assert changes.sum() <= 3 * 3 - 1


@pytest.mark.parametrize("seed", [35, 53, 78, 112, 128, 185, 195])
def test_rounded_times_of_brief_segments_cost_nothing(seed: int) -> None:
    """A millionth of the others: rounding of their times changes their velocity by 1e-10."""
    problem = one_way(seed)
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert np.diff(trajectory.waypoint_times).min() < 1e-4
    best = end_to_end(problem)
    certified = verify(problem, trajectory).certified_duration
    assert certified == pytest.approx(best, rel=1e-9)


def test_breaks_of_a_segment_are_shared() -> None:
    """Between two waypoints no joint has a break that another one has 1e-6 s earlier or later."""
    problem = load("robots-franka-fr3-w8-jerk")
    trajectory = ExactJerk().solve(problem).trajectory
    assert trajectory is not None
    assert trajectory.lengths.min() > 1e-6


def test_a_break_is_left_out_or_moves_where_that_costs_next_to_nothing() -> None:
    # 1e-8 after another one: the next is 1e-5 later and serves
    assert apart(0.5, 0.5 + 1e-8, 0.5 + 1e-5) == [0.0, 0.5, 0.5 + 1e-5, 1.0]
    # or it moves 1e-6²/1e-8, from the end too
    _, _, moved, _ = apart(0.5, 0.5 + 1e-8)
    assert moved == pytest.approx(0.5 + 1e-4, abs=1e-9)
    _, moved, _ = apart(1.0 - 1e-8)
    assert moved == pytest.approx(1.0 - 1e-4, abs=1e-9)


def apart(*times: float) -> list[float]:
    """Breaks between 0 and 1 that may cost 1e-6 each, beside a segment that has none."""
    wanted = np.array([times, np.full(len(times), np.inf)]).T
    breaks, none = jerk_motion._apart(wanted, np.full_like(wanted, 1e-6)).T
    assert (none == [0.0] + [1.0] * (len(none) - 1)).all()
    return breaks.tolist()
