"""Pieces of 1e-9 to 1e-6 s: removed where limits do not need them, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines.exact.jerk import ExactJerk
from baselines.exact.jerk_slivers import Task, without_slivers
from baselines.exact.jerk_stretch import JointLimits
from baselines.exact.rounded import Pieces, accumulated
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load

Array = NDArray[np.float64]

SLIVER = 1e-6  # s


def moved(lengths: list[float], jerks: list[float]) -> Pieces:
    """From rest at 0, with such jerks for so long."""
    t, j = np.array(lengths), np.array(jerks)
    a = accumulated(0.0, j * t)
    v = accumulated(0.0, t * (a + j * t / 2))
    q = accumulated(0.0, t * (v + t * (a / 2 + j * t / 6)))
    return np.r_[0.0, np.cumsum(t)], np.stack([j / 6, a / 2, v, q])


def to_one(pieces: Pieces, jerk: float, waypoints: list[float]) -> Task:
    """Through these waypoints, passed when the motion is there, in units of 1 s and 1 rad."""
    knots, _ = pieces
    trajectory = Trajectory(knots, pieces[1][..., None], knots[[0, -1]])
    fine = np.linspace(0, knots[-1], 100_001)
    passed = np.interp(waypoints[1:-1], trajectory(fine)[:, 0], fine)
    passages = np.r_[0.0, passed, knots[-1]]
    places = trajectory(passages)[:, 0]
    problem = Problem(places[:, None], Limits([9.0], [9.0], [jerk]))
    limits = JointLimits(*(np.array([-x, x]) for x in (9.0, 9.0, jerk)))
    return Task(problem, passages, places[:-1], 1.0, np.ones(4), np.diff(places), limits)


def own_lengths(trajectory: Trajectory, joint: int) -> Array:
    """Of one joint's own pieces, s: they end where its jerk changes, and at waypoints."""
    changes = np.diff(trajectory.coefficients[0, :, joint]) != 0
    switches = trajectory.breaks[1:-1][changes]
    return np.diff(np.union1d(switches, trajectory.waypoint_times))


@pytest.mark.parametrize("sliver", [1e-9, 1e-8, 1e-7, 9e-7])
def test_rest_to_rest_without_waiting_at_its_ends(sliver: float) -> None:
    # h = 2 J τ³ in 4 τ, after a sliver of rest and before another: 2 slivers more than it takes
    tau = (1 / 6) ** (1 / 3)
    pieces = moved([sliver, tau, 2 * tau, tau, sliver], [0.0, 3.0, -3.0, 3.0, 0.0])
    task = to_one(pieces, 3.0, [0.0, 1.0])
    knots, cubics = without_slivers(pieces, task)
    assert knots[-1] == pieces[0][-1]
    np.testing.assert_allclose(np.diff(knots), [tau, 2 * tau, tau], atol=3 * sliver)
    trajectory = Trajectory(knots, cubics[..., None], task.passages)
    assert verify(task.alone, trajectory).dilation <= 1 + 1e-11


@pytest.mark.parametrize("offset", [9e-7, 1e-7, -1e-8])
def test_a_break_beside_a_waypoint_moves_there(offset: float) -> None:
    tau = (1 / 6) ** (1 / 3)
    pieces = moved([tau, 2 * tau, tau], [3.0, -3.0, 3.0])
    # beside where jerk first changes, passed at J τ²/2; and 1e-9 more jerk than it takes
    waypoint = 3 * tau**3 / 6 + offset * 3 * tau**2 / 2
    task = to_one(pieces, 3.0 * (1 + 1e-9), [0.0, waypoint, 1.0])
    split = Trajectory(pieces[0], pieces[1][..., None], task.passages[[0, -1]])
    split = split.refined(task.passages)
    assert split.lengths.min() < SLIVER
    knots, cubics = without_slivers((split.breaks, split.coefficients[..., 0]), task)
    assert np.diff(knots).min() > SLIVER
    assert np.isin(task.passages, knots).all()
    mended = Trajectory(knots, cubics[..., None], task.passages)
    assert verify(task.alone, mended).dilation <= 1 + 1e-9


def test_what_the_limits_need_remains() -> None:
    # 1 rad at 1 rad/s, 1 rad/s² and 1e7 rad/s³: h/V + V/A + A/J, and ramps of A/J = 1e-7 s
    problem = Problem([[0.0], [1.5]], Limits([1.0], [1.0], [1e7]))
    answer = ExactJerk(starts=1).solve(problem).trajectory
    assert answer is not None
    assert answer.duration == pytest.approx(1.5 + 1 + 1e-7, rel=1e-10)
    ramps = answer.lengths[::2]
    np.testing.assert_allclose(ramps, 1e-7, rtol=1e-6)


@pytest.mark.parametrize(
    "name",
    [
        "jerk-limit",
        "edges-jerk-soft",
        "edges-jerk-asymmetric",
        "random-collinear-j2-w3-jerk-12",
        "robots-kuka-iisy-3-w4-jerk",
    ],
)
def test_no_joint_has_a_sliver_in_the_answer(name: str) -> None:
    """Without all this there are up to a dozen, beside waypoints and elsewhere."""
    problem = load(name)
    answer = ExactJerk().solve(problem).trajectory
    assert answer is not None
    assert verify(problem.without("position"), answer).dilation == pytest.approx(1, abs=1e-9)
    for joint in np.flatnonzero(problem.moving):
        assert own_lengths(answer, int(joint)).min() > SLIVER
    # no break of any joint lies beside a waypoint
    distances = np.abs(answer.breaks[:, None] - answer.waypoint_times).min(axis=1)
    assert distances[distances > 0].min() > SLIVER
