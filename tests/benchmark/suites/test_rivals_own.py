"""The optima of other people's tests are the durations that these tests expect."""

from __future__ import annotations

import pytest

from trajopt.benchmark.suites import catalogue, rivals_own
from trajopt.benchmark.trial import trials_of
from trajopt.planners.registry import load

EXPECTED = rivals_own.expected()
# How far a test itself lets the duration be from what it expects; TOTG integrates in steps.
WITHIN = {"moveit-1": 1e-6, "moveit-single-joint": 1e-3, "moveit-smoothing-duration": 2e-3}


@pytest.mark.parametrize("name", [name for name in EXPECTED if not name.endswith("moveit-2")])
def test_the_optimum_is_what_their_test_expects(name: str) -> None:
    problem = catalogue.load(name)
    planner = "exact-jerk" if problem.has("jerk") else "exact"
    (trial,) = trials_of(load(planner), problem, [0], planner)
    within = WITHIN.get(name.removeprefix("rivals-own-"), 1e-9)
    assert trial.certified_duration == pytest.approx(EXPECTED[name], rel=within)


def test_where_their_path_cuts_corners_the_optimum_is_briefer_still() -> None:
    """MoveIt's test of five points rounds them by circles, and follows straight lines between."""
    (trial,) = trials_of(load("exact"), catalogue.load("rivals-own-moveit-2"), [0], "exact")
    assert trial.certified_duration is not None
    assert trial.certified_duration < EXPECTED["rivals-own-moveit-2"]


def test_every_problem_says_which_test_it_is() -> None:
    sources = [problem.source for problem in catalogue.problems("rivals-own")]
    assert len(set(sources)) == len(sources)
    owners = {source.split("@")[0] for source in sources}
    assert owners == {"hungpham2511/toppra", "pantor/ruckig", "moveit/moveit2"}
