"""Closed motions: the last waypoint is the first again, with the same velocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from baselines.lower_bound.planner import Prove
from baselines.ruckig_ import RuckigStop
from trajopt import Limits, Problem, Status
from trajopt.core.exceptions import InvalidInput
from trajopt.judging.verification import certified, verify

LOOP = [[0.0, 0.0], [1.0, 0.5], [2.0, 0.0], [1.0, -0.8], [0.0, 0.0]]
LIMITS = Limits([2.0, 2.0], [4.0, 3.0])
JERKY = Limits([2.0, 2.0], [4.0, 3.0], [30.0, 40.0])


def test_an_optimum_of_an_independent_transcription():
    """IPOPT, each joint with its own pieces of constant acceleration, all of eight starts."""
    problem = Problem(
        [[0, 0], [0.524819, -3.876918], [0.615742, -3.659824], [-0.333154, -2.107191], [0, 0]],
        Limits([0.819141, 2.474523], [3.960622, 2.285623]),
        closed=True,
    )
    motion = Exact().solve(problem).trajectory
    certificate = verify(problem, motion)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(5.64011186295704, rel=1e-9)


@pytest.mark.parametrize(("limits", "planner"), [(LIMITS, Exact()), (JERKY, ExactJerk())])
def test_rotating_the_waypoints_changes_nothing(limits, planner):
    durations = []
    for first in range(4):
        order = [(first + i) % 4 for i in range(5)]
        problem = Problem([LOOP[i] for i in order], limits, closed=True)
        motion = planner.solve(problem).trajectory
        certificate = verify(problem, motion)
        assert certificate.feasible
        durations.append(certificate.certified_duration)
        ends = motion([0.0, motion.duration], 1)
        assert ends[0] == pytest.approx(ends[1], abs=1e-9)
        if limits is JERKY:
            assert np.ptp(motion([0.0, motion.duration], 2), axis=0).max() <= 1e-7
    assert durations == pytest.approx([durations[0]] * 4, rel=1e-8)
    at_rest = planner.solve(Problem(LOOP, limits)).trajectory.duration
    assert durations[0] < 0.95 * at_rest


def test_a_motion_there_and_back_turns_at_its_ends():
    """One joint between two points: at rest at both, so twice the time of one way."""
    problem = Problem([[0.0], [1.0], [0.0]], Limits([9.0], [1.0]), closed=True)
    assert Exact().solve(problem).trajectory.duration == pytest.approx(4.0, rel=1e-12)


def test_it_is_judged_as_a_loop():
    problem = Problem(LOOP, LIMITS, closed=True)
    loop = Exact().solve(problem).trajectory
    open_ended = verify(Problem(LOOP, LIMITS), loop)
    assert any("velocity jumps" in flaw for flaw in open_ended.flaws)
    at_rest = Exact().solve(Problem(LOOP, LIMITS)).trajectory
    assert verify(problem, at_rest).feasible
    fast = loop.dilated(0.8)
    certificate = verify(problem, fast)
    assert certificate.certified_duration == pytest.approx(loop.duration, rel=1e-9)
    assert verify(problem, certified(problem, fast)).feasible
    # a little faster at the end than at the start: mended, and judged as mended
    bent = np.array(loop.coefficients)
    bent[-2, -1] += 1e-8
    mended = certified(problem, replace(loop, coefficients=bent))
    ends = mended([0.0, mended.duration], 1)
    assert ends[0] == pytest.approx(ends[1], abs=1e-14)
    bent[-2, -1] += 0.1
    assert not verify(problem, replace(loop, coefficients=bent)).valid


@pytest.mark.parametrize(
    ("waypoints", "demands", "message"),
    [
        (LOOP[:4], {}, "closed, last waypoint, joint 1: expected the first waypoint again"),
        (LOOP, {"start_velocity": [1, 0]}, "closed is True: expected no start_velocity"),
        (LOOP, {"dwell": [0, 1, 0, 0, 0]}, "closed is True: expected no dwell"),
    ],
)
def test_one_line_says_what_is_wrong(waypoints, demands, message):
    with pytest.raises(InvalidInput, match=message):
        Problem(waypoints, LIMITS, closed=True, **demands)
    with pytest.raises(InvalidInput, match="closed is 'yes': expected true or false"):
        Problem(LOOP, LIMITS, closed="yes")


def test_a_file_says_it(tmp_path):
    problem = Problem(LOOP, LIMITS, closed=True)
    (tmp_path / "loop.toml").write_text(problem.to_toml(), encoding="utf-8")
    assert "closed = true" in problem.to_toml()
    assert Problem.from_toml(tmp_path / "loop.toml") == problem
    assert Problem(LOOP, LIMITS, closed=False) == Problem(LOOP, LIMITS)
    answer = RuckigStop().solve(problem)
    assert (answer.status, answer.message) == (
        Status.UNSUPPORTED,
        "it does not know closed motions",
    )


@pytest.mark.parametrize("limits", [LIMITS, JERKY])
def test_a_bound_of_a_loop(limits):
    problem = Problem(LOOP, limits, closed=True)
    found = Prove().solve(problem)
    assert found.lower_bound <= found.trajectory.duration <= found.lower_bound * (1 + 1.1e-4)
    assert Prove().stored_bound(problem, found.stats) == found.lower_bound
