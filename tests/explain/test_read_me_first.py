"""Read me first: `explain` says what a gap is made of, and which limits hold a motion back."""

from __future__ import annotations

import pytest

from trajopt import Limits, Problem
from trajopt.explain.active_limits import share_at_limits
from trajopt.explain.decomposition import explain
from trajopt.planners.registry import load

LIMITS = Limits(velocity=[1.0], acceleration=[2.0])
PROBLEM = Problem([[0.0], [1.0], [2.5]], LIMITS)


def test_the_parts_of_a_gap_multiply_to_the_whole_gap():
    planner = load("ruckig-stop")
    answer = planner.solve(PROBLEM).trajectory
    explanation = explain(PROBLEM, planner, answer)
    # without the stop: 2.5 s of cruise and half a second for both ramps
    assert explanation.exact == pytest.approx(3.0)
    assert explanation.certified_duration == pytest.approx(3.5)
    parts = (1 + explanation.timing_gap) * (1 + explanation.route_gap)
    assert parts == pytest.approx(1 + explanation.gap)


def test_an_optimum_is_always_at_some_limit():
    optimum = load("exact").solve(PROBLEM).trajectory
    assert share_at_limits(PROBLEM, optimum) == pytest.approx(1.0, abs=0.01)
