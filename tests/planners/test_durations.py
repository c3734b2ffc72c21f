"""A time of the whole motion: at least, or exactly."""

from __future__ import annotations

import numpy as np
import pytest

import trajopt
from trajopt import Limits, Problem, Status
from trajopt.core.exceptions import InvalidInput
from trajopt.judging.verification import verify

LIMITS = Limits([2.0, 2.0], [4.0, 4.0])
JERK = Limits([2.0, 2.0], [4.0, 4.0], jerk=[50.0, 50.0])
WAY = [[0, 0], [0.5, -0.3], [1, 0.2]]
OTHERS = {
    "none": {},
    "dwell": {"dwell": [0.2, 0.3, 0.1]},
    "start": {"start_velocity": [0.2, 0]},
    "tolerance": {"tolerance": 0.05},
    "closed": {"closed": True},
    "least": {"least_times": [0, 1.0]},
    "falling": {},
}


def problem(other="none", limits=LIMITS, **time):
    way = [*WAY[:2], WAY[0]] if other == "closed" else WAY
    if other == "falling":
        edge = {"offset": [0.1] * 2, "deceleration": [3.0] * 2, "position": [[-2, 2]] * 2}
        limits = Limits([2.0] * 2, [4.0] * 2, falling_velocity=edge)
    return Problem(way, limits, **OTHERS[other], **time)


@pytest.mark.parametrize("limits", [LIMITS, JERK], ids=["acceleration", "jerk"])
@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("key", ["least_duration", "duration"])
def test_every_demand_beside_a_time_of_the_whole(other, limits, key):
    """A motion of the time asked for is the fastest that there is, and keeps every limit."""
    found = trajopt.plan(problem(other, limits, **{key: 4.0}))
    assert found.status is Status.SOLVED
    assert found.certified_duration == pytest.approx(4.0, rel=1e-9)
    assert found.certificate.feasible
    motion = found.certified_trajectory
    waits = OTHERS[other].get("dwell", [0, 0, 0])
    for at, wait in zip(motion.waypoint_times[:2], waits[:2], strict=True):
        assert motion(at, 1) == pytest.approx(motion(at + wait, 1), abs=1e-9)
        assert motion(at) == pytest.approx(motion(at + wait), abs=1e-9)


def test_a_shorter_least_duration_changes_nothing():
    free = trajopt.plan(problem())
    found = trajopt.plan(problem(least_duration=0.5))
    assert found.certified_duration == free.certified_duration


def test_a_time_that_no_motion_has_is_infeasible():
    """1 rad at 2 rad/s and 4 rad/s² takes 1 s from rest to rest."""
    line = Problem([[0.0], [1.0]], Limits([2.0], [4.0]), duration=0.99)
    found = trajopt.plan(line, "exact")
    assert found.status is Status.INFEASIBLE
    assert found.message == "every motion takes 0.999999 s at least, 0.99 s are asked for"
    # the waypoint aside is not in the closed form
    found = trajopt.plan(problem(duration=1.2), "exact")
    assert found.status is Status.FAILED
    assert found.message.startswith("no motion of the time asked for was found: its fastest")
    found = trajopt.plan(problem(duration=1.2), "prove")
    assert found.status is Status.INFEASIBLE
    assert "no motion takes the given time, 1.2 s" in found.message


@pytest.mark.parametrize("name", ["exact", "spline353-nlp", "toppra", "issa"])
def test_every_planner_takes_the_time_asked_for(name):
    way = [[0.0], [1.0], [1.5], [3.0]]
    asked = Problem(way, Limits([2.0], [4.0]), least_duration=9.0)
    found = trajopt.plan(asked, name)
    assert found.certified_duration == pytest.approx(9.0, rel=1e-12)


def test_the_prover_proves_the_time_asked_for():
    found = trajopt.plan(problem(least_duration=4.0), "prove")
    assert (found.lower_bound, found.solution.stats["proof"]) == (4.0, "proved")


def test_the_judge_asks_for_it():
    motion = trajopt.plan(problem()).certified_trajectory
    short = verify(problem(least_duration=2.0), motion)
    assert not short.feasible
    assert short.certified_duration == pytest.approx(2.0, rel=1e-12)
    assert short.least_times.value == pytest.approx(2.0 / motion.duration, rel=1e-12)
    other = verify(problem(duration=2.0), motion)
    assert other.flaws == (f"it takes {motion.duration:.6g} s, 2 s are asked for",)
    kept = verify(problem(duration=2.0), motion.dilated(2.0 / motion.duration))
    assert kept.feasible
    waits = trajopt.plan(problem("dwell")).certified_trajectory
    assert verify(problem("dwell", duration=3.0), waits).flaws
    assert verify(problem("dwell", least_duration=3.0), waits).dilation > 1


def test_a_problem_has_one_time_of_the_whole():
    with pytest.raises(InvalidInput, match="left out beside duration"):
        problem(least_duration=4.0, duration=4.0)
    with pytest.raises(InvalidInput, match="left out beside given_times"):
        problem(duration=4.0, given_times=[2.0, 2.0])
    with pytest.raises(InvalidInput, match="expected a time of at least 0, s"):
        problem(duration=-1.0)


def test_files_and_parts(tmp_path):
    asked = problem("dwell", least_duration=4.0)
    (tmp_path / "p.toml").write_text(asked.to_toml(), encoding="utf-8")
    assert Problem.from_toml(tmp_path / "p.toml") == asked
    assert not asked.route.part(0, 1).demands
    assert np.isclose(asked.route.in_units(2.0, 1.0).demands["least_duration"], 2.0)
