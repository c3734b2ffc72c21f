"""Problems with limits of one segment: closed forms by their names."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt import verify
from trajopt.benchmark.suites import catalogue, sections
from trajopt.planners.registry import load

PEAK = np.sqrt(2.5)  # from rest at 2 rad/s² over 1 rad, braking to 1 rad/s
FAST = PEAK / 2 + (PEAK - 1) / 2
CLOSED_FORMS = {
    "slow": FAST + 0.75 + 0.5,
    "slow-first": FAST + 0.75 + 0.5,
    "slow-middle": 2 * FAST + 1.0,
    "fast-middle": 2 * (0.5 + 0.75) + 2 * (np.sqrt(3) - 1) / 2,
    # 8 rad/s² up, passing 1 rad at √2
    "gentle": 3 / 8 + (3 - np.sqrt(2)) / 8 + np.sqrt(2),
    "repeated": FAST + 0.75 + 0.5,
}


@pytest.mark.parametrize("name", sorted(CLOSED_FORMS))
def test_a_closed_form_is_met(name):
    problem = catalogue.load(f"sections-{name}")
    motion = load("exact").solve(problem).trajectory
    assert verify(problem, motion).certified_duration == pytest.approx(CLOSED_FORMS[name], rel=1e-9)


def test_every_name_leads_to_its_problem():
    for problem in catalogue.problems("sections", 20):
        assert catalogue.load(problem.name) == problem
        assert problem.limits.segments == problem.segments
    assert sections.SUITE.named("sections-random-5") is None
    assert sections.draw(3).has("jerk")
    assert not sections.draw(2).has("jerk")
