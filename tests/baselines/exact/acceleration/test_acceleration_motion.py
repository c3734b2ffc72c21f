"""Motions of least acceleration: closed forms, shared breaks, and no slivers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.acceleration.motion import SegmentTask, pieces
from baselines.exact.acceleration.profiles import extremes, gentlest, straightest
from experiments.common.brief_pieces import needless
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem

ARM = Path(__file__).parents[4] / "docs/examples/motions/arm.toml"
V = np.array([-1.0, 1.5])
A = np.array([-2.0, 3.0])


def gentle(u: float, w: float, t: float, h: float) -> np.ndarray:
    """Peak, time of both ramps, and share of the limits."""
    return np.array(gentlest(*np.array([u, w, t, h]), V, A))


def test_from_rest_to_rest_it_is_a_triangle_of_the_acceleration_that_the_time_asks_for() -> None:
    # both ramps fill 2 s: p T/2 = h, up in 2/(2 + 3) of the time at s 3, down in 3/5 at s 2
    expected = [0.5, 2 * 2 / 5, 2 * 3 / 5, 0.5 / (0.8 * 3)]
    np.testing.assert_allclose(gentle(0.0, 0.0, 2.0, 0.5), expected, rtol=1e-14)


def test_above_the_velocity_limit_it_cruises() -> None:
    # ramps to 1.5 lose V/2 each: h = V (T - (t1 + t3)/2), t1 = V/(3 s), t3 = V/(2 s)
    peak, first, last, share = gentle(0.0, 0.0, 4.0, 5.0)
    assert peak == 1.5
    lost = 2 * (4.0 - 5.0 / 1.5)
    np.testing.assert_allclose([first, last], [lost * 2 / 5, lost * 3 / 5], rtol=1e-14)
    assert share == pytest.approx(1.5 / (3 * lost * 2 / 5), rel=1e-14)


def test_constant_velocity_takes_no_acceleration() -> None:
    assert gentle(0.7, 0.7, 2.0, 1.4)[3] == pytest.approx(0, abs=1e-15)
    np.testing.assert_array_equal(gentle(1.5, 1.5, 2.0, 3.0)[3], 0)


@pytest.mark.parametrize("seed", range(5))
def test_the_extremes_take_all_of_the_limits_and_what_lies_between_less(seed: int) -> None:
    rng = np.random.default_rng(seed)
    u, w = rng.uniform(*V, (2, 200))
    t = np.abs(w - u) / 2 + rng.uniform(0.01, 2, 200)
    _, upper, _, lower = extremes(u, w, t, V, A)
    for h in (upper, lower):
        np.testing.assert_allclose(gentlest(u, w, t, h, V, A).share, 1, rtol=1e-9)
    between = rng.uniform(lower, upper)
    share = gentlest(u, w, t, between, V, A).share
    assert (share < 1).all()
    # half of the limits reach no further than the profile that takes less than half of them
    _, upper, _, lower = extremes(u, w, t, V, A / 2)
    reached = (lower < between) & (between < upper) & (np.abs(w - u) < A[1] / 2 * t)
    assert (share[reached & (w - u > A[0] / 2 * t)] < 0.5).all()


@pytest.mark.parametrize("seed", range(5))
def test_the_straightest_turns_round_as_soon_as_it_can(seed: int) -> None:
    """Beyond both ends by u²/(2 A) and w²/(2 A) at most, which no motion can better."""
    rng = np.random.default_rng(seed)
    u, w = rng.uniform(*V, (2, 200))
    t = np.abs(w - u) / 2 + rng.uniform(0.0, 4, 200)
    far = np.array([-1e3, 1e3])
    _, upper, _, lower = extremes(u, w, t, far, A)
    h = rng.uniform(lower, upper)
    cruise, first, last = straightest(u, w, t, h, A)
    middle = t - first - last
    assert (middle >= 0).all()
    travelled = (u + cruise) / 2 * first + cruise * middle + (cruise + w) / 2 * last
    np.testing.assert_allclose(travelled, h, atol=1e-12)
    for ramp, step in ((first, cruise - u), (last, w - cruise)):
        np.testing.assert_allclose(np.where(step > 0, 3.0, 2.0) * ramp, np.abs(step), atol=1e-12)
    start = u**2 / np.where(u > 0, 4, -6)
    end = w**2 / np.where(w < 0, 4, -6)
    at = np.linspace(0, 1, 101)[:, None] * t
    first_part = u * np.minimum(at, first) + (cruise - u) * np.minimum(at, first) ** 2 / 2 / first
    cruised = cruise * np.clip(at - first, 0, middle)
    late = np.clip(at - first - middle, 0, None)
    position = first_part + cruised + cruise * late + (w - cruise) * late**2 / 2 / last
    turns = [0 * h, h, np.where(u * cruise < 0, start, 0), h + np.where(w * cruise < 0, end, 0)]
    assert (position <= np.max(turns, axis=0) + 1e-12).all()
    assert (position >= np.min(turns, axis=0) - 1e-12).all()


def test_the_straightest_of_constant_velocity_and_of_one_ramp() -> None:
    assert straightest(*np.array([0.5, 0.5, 2.0, 1.0]), A) == (0.5, 0.0, 0.0)
    _, first, last = straightest(*np.array([-1.0, 0.5, 0.5, -0.125]), A)
    assert first + last == pytest.approx(0.5, abs=1e-12)  # at 3 all the time
    assert straightest(*np.array([0.5, 0.5, 0.0, 0.0]), A)[1:] == (0.0, 0.0)


@pytest.mark.parametrize("name", ["position-limits", "robots-kuka-kr6-r700-w16"])
def test_what_must_leave_position_limits_does_so_without_slivers(name: str) -> None:
    assert shortest_piece(load(name)) > 1e-6


@pytest.mark.parametrize("name", ["robots-abb-irb-120-w4", "robots-kinova-gen3-w8"])
def test_position_limits_are_kept_where_the_time_and_the_velocities_allow_it(name: str) -> None:
    """Joints with time to spare once strayed by up to 0.6 rad beyond their limits."""
    problem = load(name)
    trajectory = Exact().solve(problem).trajectory
    assert trajectory is not None
    certificate = verify(problem, trajectory)
    assert certificate.valid
    assert certificate.dilation < 1 + 1e-11


def test_the_limit_of_a_velocity_step_follows_from_the_interval() -> None:
    """Without a cruise the interval is (A2 T − d)(A1 T + d)/(A1 + A2) wide: none beyond A T."""
    steps = np.linspace(-2.0, 3.0, 11)
    at_rest = np.zeros(11)
    far = np.array([-1e3, 1e3])
    _, upper, _, lower = extremes(at_rest, steps, np.ones(11), far, A)
    expected = (3 - steps) * (2 + steps) / 5
    np.testing.assert_allclose(upper - lower, expected, atol=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_a_motion_late_in_a_long_trajectory_is_the_same(seed: int) -> None:
    """Breaks after 1000 s are rounded to 1e-13 s, a percent of some of these segments' ramps."""
    rng = np.random.default_rng(seed)
    for length in 10.0 ** rng.uniform(-6, 0, 50):
        u = rng.uniform(*V)
        w = np.clip(u + rng.uniform(*A) * length, *V)
        _, upper, _, lower = extremes(u, w, length, V, A)
        h = rng.uniform(lower, upper)
        # at rest for 1000 s, then this segment
        both = np.array([[0.0], [1.0]])
        task = SegmentTask(
            times=np.array([[1000.0], [length]]),
            h=h * both,
            u=u * both,
            w=w * both,
            v=V[:, None],
            a=A[:, None],
            q=0 * both,
            positions=np.array([[-np.inf], [np.inf]]),
        )
        own = pieces(task, brief=0.0)
        assert (own.start >= A[0]).all()
        assert (own.start <= A[1]).all()
        velocity, position = own.passed(task.u)
        fastest = max(abs(u), abs(w))
        assert position[-1, 1] == pytest.approx(h, abs=1e-12 * fastest * length)
        assert velocity[-1, 1] == pytest.approx(w, abs=1e-14)
        by_segment = own.integrated(task.u).transpose(2, 0, 1, 3)
        lengths = own.lengths[..., 0].T
        motion = Trajectory.of_segments(zip(lengths, by_segment, strict=True))
        late = motion.breaks[:-1] >= 1000.0
        _, moving = lengths
        np.testing.assert_array_equal(motion.lengths[late], moving[moving > 0])


def shortest_piece(problem: Problem) -> float:
    """Return the shortest piece of `exact`'s answer, relative to its segment."""
    trajectory = Exact().solve(problem).trajectory
    assert trajectory is not None
    assert verify(problem.without("jerk", "position"), trajectory).dilation < 1 + 1e-9
    times = trajectory.waypoint_times
    segment = np.searchsorted(times, trajectory.breaks[:-1], side="right") - 1
    return float((trajectory.lengths / np.diff(times)[segment]).min())


@pytest.mark.parametrize("name", ["six-axis", "asymmetric", "seven-waypoints", "reversal", ARM])
def test_no_piece_is_a_sliver(name: str | Path) -> None:
    """A shoulder that cruises through its waypoint once braked there for 3e-7 of the segment."""
    assert shortest_piece(load(str(name))) > 1e-6


@pytest.mark.parametrize("seed", [1, 2, 3, 5, 8, 13, 21, 34])
def test_no_piece_of_random_ones_is_a_sliver(seed: int) -> None:
    assert shortest_piece(random_problem(seed, jerk=False)) > 1e-6


@pytest.mark.parametrize("seed", [17, 28, 72, 99, 105, 113, 203, 204, 217, 251, 266, 272])
def test_a_brief_piece_stays_only_where_no_motion_does_without_it(seed: int) -> None:
    """Such pieces of 2e-15 to 2e-7 s once stayed where joints had time to spare."""
    problem = random_problem(seed)
    trajectory = Exact().solve(problem).trajectory
    assert trajectory is not None
    assert needless(problem, trajectory) == 0
    assert verify(problem, trajectory).dilation <= 1 + 3e-10


def test_a_ramp_that_the_optimum_needs_remains() -> None:
    # 1 rad at 1 rad/s and 1e8 rad/s²: h/V + V/A, and ramps of 1e-8 of it; a search ends
    # where it gains less than 1e-10 of the duration
    problem = Problem([[0.0], [1.0]], Limits([1.0], [1e8]))
    trajectory = Exact().solve(problem).trajectory
    assert trajectory is not None
    np.testing.assert_allclose(trajectory.lengths, [1e-8, 1 - 1e-8, 1e-8], rtol=1e-5)
    assert verify(problem, trajectory).certified_duration == pytest.approx(1 + 1e-8, rel=2e-10)
