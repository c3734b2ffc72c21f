"""The suite of mixed demands, and of parts of optimal motions."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from trajopt import Limits, Problem
from trajopt.benchmark.suites import catalogue, mixes
from trajopt.core.demand import END_STATES
from trajopt.judging.verification import verify

DRAWN = [mixes.draw(index) for index in range(200)]


def test_half_are_drawn_and_half_are_parts_of_motions():
    problems = mixes.SUITE.problems()
    assert len({own.digest() for own in problems}) == mixes.SUITE.size == 24
    parts = [own for own in problems if own.name.startswith("mixes-part")]
    assert len(parts) == mixes.DRAWN
    assert all(set(END_STATES) & set(own.demands) for own in parts)
    assert {own.has("jerk") for own in parts} == {True, False}
    assert all(catalogue.given(own.name) == own for own in problems[::5])


def test_the_drawn_ones_ask_for_two_to_five_things_at_once():
    assert {own.joints for own in DRAWN} == set(range(2, 8))
    assert {len(own.waypoints) for own in DRAWN} == set(range(2, 13))
    for own in DRAWN:
        ends = {key.split("_")[0] for key in own.demands if key in END_STATES}
        others = set(own.demands) - set(END_STATES)
        asked = len(ends) + len(others) + (own.limits.segments is not None)
        assert (
            1 <= asked <= 5
        )  # least times or waits may all be 0, and a single segment has no other
    with_jerk = [own.has("jerk") for own in DRAWN]
    assert with_jerk == [False, True] * 100


def test_numbers_recorded_once_are_still_the_numbers():
    """Made on one machine; if another draws other problems, records would belong to none."""
    assert DRAWN[0].waypoints[0].tolist() == [0.4624, -0.5499, 0.5024]
    assert all(np.array_equal(own.waypoints, np.round(own.waypoints, 4)) for own in DRAWN[:24])


def test_both_halves_of_a_motion_are_as_long_as_it():
    """From rest to rest over 1 rad with A = 1 in 2 s: half a second is an eighth of a rad."""
    problem = Problem([[0.0], [1.0]], Limits([9.0], [1.0]))
    motion = Exact().solve(problem).trajectory
    before, after = mixes.halves(problem, motion, 0.5)
    assert before.waypoints[-1] == pytest.approx([0.125], abs=1e-15)
    assert before.route.end.velocity == pytest.approx([0.5], abs=1e-15)
    assert np.array_equal(after.route.start.velocity, before.route.end.velocity)
    for part, took in ((before, 0.5), (after, 1.5)):
        own = Exact().solve(part).trajectory
        assert verify(part, own).certified_duration == pytest.approx(took, rel=1e-9)


@pytest.mark.parametrize("name", ["mixes-part-00", "mixes-part-07", "mixes-random-08"])
def test_some_are_solved(name):
    problem = catalogue.given(name)
    planner = ExactJerk() if problem.has("jerk") else Exact()
    assert verify(problem, planner.solve(problem).trajectory).valid
