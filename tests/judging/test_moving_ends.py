"""Motions that begin and end in motion: repaired to the states that are asked, and never cheaper.

Closed form, one joint over 1 rad within 1 rad/s² from `v0` to rest: it speeds up to
`p = √(h + v0²/2)` and brakes, so T = 2 p − v0.
"""

from __future__ import annotations

import numpy as np
import pytest

from soaks import moving_ends
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.judging.joint_program import JointProgram
from trajopt.judging.repair import repaired
from trajopt.judging.verification import certified


def motion(v0, accelerations, lengths):
    """One joint from 0, of pieces of constant acceleration."""
    q, v, rows = 0.0, v0, []
    for a, t in zip(accelerations, lengths, strict=True):
        rows.append([a / 2, v, q])
        q, v = q + v * t + a * t**2 / 2, v + a * t
    breaks = np.append(0.0, np.cumsum(lengths))
    return Trajectory(breaks, np.array(rows).T[:, :, None], breaks[[0, -1]])


def from_speed(v0):
    return Problem([[0.0], [1.0]], Limits([5.0], [1.0]), start_velocity=[v0])


def fastest(v0, excess):
    """The fastest motion where the acceleration limit is larger by this."""
    A = 1 + excess
    peak = np.sqrt(A + v0**2 / 2)
    return motion(v0, [A, -A], [(peak - v0) / A, peak / A])


def optimum(v0):
    return 2 * np.sqrt(1 + v0**2 / 2) - v0


@pytest.mark.parametrize("v0", [1.0, -1.0])
def test_the_optimum_is_certified_as_claimed(v0):
    certificate = verify(from_speed(v0), fastest(v0, 0.0))
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(optimum(v0), rel=1e-14)


# A dilation by √(1 + e) would be cheaper than the optimum where v0 < 0.
@pytest.mark.parametrize(
    ("excess", "above"), [(1e-9, 1e-7), (1e-6, 1e-7), (1e-2, 1e-3), (1.25, 1e-2)]
)
@pytest.mark.parametrize("v0", [1.0, -1.0])
def test_no_excess_is_certified_below_the_optimum(v0, excess, above):
    problem = from_speed(v0)
    given = fastest(v0, excess)
    duration = verify(problem, given).certified_duration
    assert -1e-9 < duration / optimum(v0) - 1 < above
    found = certified(problem, given)
    assert found.duration == pytest.approx(duration, rel=1e-15)
    assert found(0.0, 1) == v0
    again = verify(problem, found)
    assert again.feasible
    assert again.certified_duration == pytest.approx(duration, rel=1e-12)


def test_a_start_that_is_too_fast_has_no_slower_motion():
    problem = Problem([[0.0], [1.0]], Limits([1.0], [1.0]), start_velocity=[-1.01])
    peak = np.sqrt(1 + 1.01**2 / 2)
    given = motion(-1.01, [1, -1], [peak + 1.01, peak])
    certificate = verify(problem, given)
    (flaw,) = certificate.flaws
    assert flaw.startswith("joint 1 at ")
    assert flaw.endswith(" of limit, and no slower motion was found that keeps the start velocity")
    assert certificate.certified_duration is None
    assert certified(problem, given) is None


def test_wrong_states_at_the_ends_are_repaired_or_refused():
    problem = from_speed(0.5)
    given = fastest(0.5, -0.1)
    near = Problem(problem.waypoints, problem.limits, start_velocity=[0.5 + 1e-8])
    mended = repaired(near, given)
    assert mended(0.0, 1) == pytest.approx(0.5 + 1e-8, abs=1e-16)
    assert mended(mended.duration, 1) == pytest.approx(0.0, abs=1e-15)
    assert mended(mended.duration) == pytest.approx(1.0, abs=1e-15)
    assert verify(near, given).valid
    far = Problem(problem.waypoints, problem.limits, start_velocity=[0.6])
    assert verify(far, given).flaws == ("joint 1 at 0 s: velocity jumps by 0.1 rad/s",)


def test_accelerations_at_the_ends_are_repaired_where_jerk_is_limited():
    limits = Limits([5.0], [9.0], jerk=[60.0])
    problem = Problem([[0.0], [1.0]], limits, end_velocity=[3.0], end_acceleration=[6.0 + 1e-7])
    cubic = Trajectory([0.0, 1.0], np.array([1.0, 0, 0, 0])[:, None, None], [0.0, 1.0])
    mended = repaired(problem, cubic)
    assert mended(1.0, 2) == pytest.approx(6.0 + 1e-7, abs=1e-13)
    assert mended(1.0, 1) == pytest.approx(3.0, abs=1e-14)
    assert verify(problem, cubic).feasible


def test_a_wall_at_the_start_is_left_at_the_speed_that_is_asked():
    limits = Limits([5.0], [1.0], position=[[0.0, 2.0]])
    problem = Problem([[0.0], [1.0]], limits, start_velocity=[1.0])
    certificate = verify(problem, fastest(1.0, 0.0))
    assert certificate.certified_duration == pytest.approx(optimum(1.0), rel=1e-12)
    outwards = Problem([[0.0], [1.0]], limits, start_velocity=[-1.0])
    assert not verify(outwards, fastest(-1.0, 0.0)).valid


@pytest.mark.long
def test_cheats_in_small():
    """500 of them: `python tests/soak.py moving_ends`."""
    rows = moving_ends.rows(9)
    assert (rows["certified %"] > -100 * moving_ends.CERTIFIED_BELOW).all()
    assert (rows["claimed %"] < 0).any()


def test_no_slower_motion_is_looked_for_where_none_can_begin(monkeypatch):
    """It begins beyond the velocity limit: no linear program is asked."""
    problem = Problem([[0.0], [1.0]], Limits([1.0], [2.0]), start_velocity=[1.3])
    # 1.3 rad/s down to 0 in a constant deceleration of 0.845 rad/s²
    motion = Trajectory([0.0, 2 / 1.3], [[[-0.4225]], [[1.3]], [[0.0]]], [0.0, 2 / 1.3])
    monkeypatch.setattr(JointProgram, "solved", lambda _: pytest.fail("a program is solved"))
    found = verify(problem, motion)
    assert not found.valid
    assert found.certified_duration is None
