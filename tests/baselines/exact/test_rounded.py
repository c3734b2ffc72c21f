"""Breaks as a trajectory stores them: no two joints' breaks that are one are at two places."""

from __future__ import annotations

import numpy as np

from baselines.exact.rounded import (
    Clock,
    apart,
    assembled,
    clocks,
    integrated,
    later,
    mended,
    missing,
)
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.core.trajectory import BREAK_RTOL


def test_breaks_that_a_trajectory_takes_as_one_are_moved_to_one_place() -> None:
    clock = Clock(start=28.0, end=28.5, unit=2.0, resolution=40 * BREAK_RTOL)
    near = 0.1 + 0.4 * clock.resolution / clock.unit
    one = np.array([0.0, 0.1, 0.2, clock.length])
    other = np.array([0.0, near, clock.length - 1e-16, clock.length])
    first, second = clock.shared([one, other])
    np.testing.assert_allclose(first, [28.0, 28.2, 28.4, 28.5], rtol=1e-15)
    np.testing.assert_allclose(second, [28.0, 28.2, 28.5], rtol=1e-15)
    assert second[1] in first
    assert second[-1] == first[-1] == 28.5


def test_shared_breaks_are_those_of_the_trajectory() -> None:
    """Random knots, many closer than rounding, late in a long motion: none is merged again."""
    rng = np.random.default_rng(0)
    passages = np.array([0.0, 1000.0, 1000.01])
    _, clock = clocks(passages, units=0.3)
    middle = clock.length * rng.uniform(0.2, 0.8, (3, 20))
    close = middle[0] + rng.uniform(-3, 3, 20) * clock.resolution / clock.unit
    joints = []
    for inner in (*middle, close):
        joints.append(np.r_[0.0, np.sort(inner), clock.length])
    shared = clock.shared(joints)
    before = np.array([0.0, 1000.0])
    parts = []
    for stored in shared:
        assert (np.diff(stored) > clock.resolution).all()
        own = np.r_[before, stored[1:]]
        parts.append((own, np.zeros((1, len(own) - 1))))
    joined = Trajectory.joined(parts, passages)
    every = np.unique(np.concatenate([before, *shared]))
    np.testing.assert_array_equal(joined.breaks, every)


def test_later_is_never_too_early() -> None:
    """Lengths of 1e-9 to 1e-3 s, hours after the start: the nearest stored time is often early."""
    rng = np.random.default_rng(1)
    starts = rng.uniform(25_000.0, 25_700.0, 300)
    lengths = 10 ** rng.uniform(-9, -3, 300)
    stored = later(starts, lengths)
    assert (stored - starts >= lengths).all()
    assert (stored - starts <= lengths + np.spacing(starts)).all()
    nearest = starts + lengths
    assert (nearest - starts < lengths).sum() > 50


def test_assembled_joints_start_from_their_waypoints_and_the_others_rest() -> None:
    problem = Problem(
        [
            [0, 7, 1],
            [1, 7, 0],
            [3, 7, 2],
        ],
        Limits([9.0] * 3, [9.0] * 3),
    )
    passages = np.array([0.0, 1.0, 2.0])
    segments = []
    for k, step in enumerate(problem.displacements[:, problem.moving]):
        stored = passages[k : k + 2]
        segments.append([(stored, np.array([[h], [0.0]])) for h in step])
    trajectory = assembled(problem, passages, segments)
    np.testing.assert_allclose(trajectory(passages), problem.waypoints)
    np.testing.assert_allclose(trajectory(0.5), [0.5, 7, 0.5])
    assert verify(problem, trajectory).waypoint.value < 1e-15


def test_knots_are_apart_from_each_other_and_from_both_ends() -> None:
    knots = np.array([-0.0, 0.05, 0.5, 0.55, 0.7, 0.95, 1.0])
    np.testing.assert_allclose(apart(knots, 1.0, 0.1), [0.0, 0.5, 0.7, 1.0])


def test_mended_accelerations_end_with_their_velocity_where_they_should() -> None:
    """Random accelerations at random breaks, some of them 1e-9 of the others."""
    rng = np.random.default_rng(2)
    lengths = 10 ** rng.uniform(-9, 0, (8, 50))
    t = lengths.sum(axis=0)
    u, w, h = rng.uniform(-1, 1, (3, 50))
    acceleration = mended(lengths, rng.uniform(-1, 1, (9, 50)), u, w, h)
    cubics, velocity, displacement = integrated(lengths, acceleration, u)
    np.testing.assert_allclose(velocity, w, atol=1e-13)
    np.testing.assert_allclose(displacement, h, atol=1e-13 * t.max())
    # each piece's jerk, acceleration and velocity lead to those of the next
    cubic, square, speed, _ = cubics
    np.testing.assert_allclose(
        2 * square[:-1] + 6 * cubic[:-1] * lengths[:-1], 2 * square[1:], atol=1e-9
    )
    after = speed + lengths * (2 * square + 3 * cubic * lengths)
    np.testing.assert_allclose(after[:-1], speed[1:], atol=1e-12)


def test_what_is_missing_is_not_rounding() -> None:
    lengths = np.array([[0.25], [0.5], [0.25]])
    none = np.zeros((4, 1))
    slow, short = missing(lengths, none, np.array([1.0]), np.array([1.0 + 1e-15]), np.array([1.0]))
    assert (slow, short) == (0, 0)
    slow, short = missing(lengths, none, np.array([1.0]), np.array([1.5]), np.array([1.25]))
    assert (slow, short) == (0.5, 0.25)
