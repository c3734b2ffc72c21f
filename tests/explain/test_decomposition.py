"""Decompositions of a gap: products, closed forms, and parts that do not apply."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.ruckig_ import RuckigStop
from baselines.spline353_nlp import Spline353NLP
from baselines.topp_ra import ToppRa, along
from trajopt import Limits, Problem, Solution, Status, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load as problem_of
from trajopt.benchmark.suites.random import random_problem
from trajopt.core.exceptions import TrajoptError
from trajopt.explain.decomposition import Explanation, explain, peaks
from trajopt.explain.references import ReferenceAnswer, judged, references
from trajopt.planners import spline353
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.swarm_planner import SwarmPlanner, Unoptimised

approx = pytest.approx

QUICK = SwarmPlanner(iterations=30)
KEYS = "certified_duration exact gap timing_gap route_gap optimiser_gap shape_gap smoothness_gap"


def explained(problem: Problem, planner: Planner) -> Explanation:
    trajectory = planner.solve(problem).trajectory
    assert trajectory is not None
    return explain(problem, planner, trajectory)


@pytest.mark.parametrize(("planner", "seed"), [(QUICK, 1), (Unoptimised(), 2), (Spline353NLP(), 1)])
def test_both_decompositions_multiply_to_the_gap(planner: Planner, seed: int) -> None:
    found = explained(random_problem(seed, joints=3, waypoints=4), planner)
    ratio = found.certified_duration / found.exact
    assert found.gap == approx(ratio - 1, rel=1e-14)
    assert ratio == approx((1 + found.timing_gap) * (1 + found.route_gap), rel=1e-12)
    shape = (1 + found.shape_gap) * (1 + found.smoothness_gap)
    assert ratio == approx((1 + found.optimiser_gap) * shape, rel=1e-12)
    gaps = (found.timing_gap, found.route_gap, found.optimiser_gap, found.shape_gap)
    assert min(*gaps, found.smoothness_gap) >= -1e-6
    for steps in found.steps().values():
        assert steps[0] == ("optimum", found.exact)
        assert steps[-1][1] == approx(found.certified_duration, rel=1e-12)


def test_the_optimum_has_no_gap() -> None:
    found = explained(problem_of("six-axis"), Exact())
    assert [found.gap, found.timing_gap, found.route_gap] == approx([0.0, 0.0, 0.0], abs=1e-6)
    assert "3-5-3" in found.notes["shape_gap"]


def test_stopping_at_every_waypoint_loses_by_its_path_alone() -> None:
    # One joint, one way: the best timing of its own path need not stop; T = 2 sqrt(h / A) for all.
    problem = Problem([[0.0], [0.3], [1.0]], Limits([10.0], [4.0]))
    found = explained(problem, RuckigStop())
    assert found.exact == approx(1.0, rel=1e-6)
    assert found.certified_duration == approx(stop_times(problem).sum(), rel=1e-9)
    assert found.route_gap is not None


def test_the_worst_timing_of_the_best_path_loses_by_its_timing_alone() -> None:
    problem = random_problem(3, joints=2, waypoints=4)
    optimum = Exact().solve(problem).trajectory
    assert optimum is not None
    found = explain(problem, ToppRa(), optimum.dilated(1.7))
    assert found.timing_gap == approx(0.7, abs=2e-4)
    assert found.route_gap == approx(0.0, abs=1e-4)


def test_a_line_is_the_best_route_and_the_spline_only_times_it_badly() -> None:
    # One joint, monotone: every path is the same line, so the route costs nothing.
    problem = Problem([[0.0], [0.5], [1.0], [1.5]], Limits([1.0], [2.0]))
    found = explained(problem, Spline353NLP())
    assert found.exact == approx(1.5 / 1.0 + 1.0 / 2.0, rel=1e-6)
    assert found.route_gap == approx(0.0, abs=2e-4)
    assert found.timing_gap == approx(found.gap, abs=1e-3)


@pytest.mark.parametrize("power", [2, 3, 5])
def test_a_line_left_and_reached_at_infinite_path_speed_is_timed_well(power: int) -> None:
    # q = t^m, then the same backwards in time: a line from 0 to 2, of any smoothness at its ends.
    first = np.zeros(power + 1)
    second = np.zeros(power + 1)
    first[0] = 1.0
    second[:] = [-math.comb(power, k) * (-1.0) ** (power - k) for k in range(power + 1)]
    second[-1] += 2.0
    local = np.stack([first, second], axis=1)[:, :, None]
    problem = Problem([[0.0], [2.0]], Limits([1.5], [1.0]))
    answer = along(problem, Trajectory([0.0, 1.0, 2.0], local, [0.0, 2.0])).trajectory
    assert answer is not None
    certified = verify(problem, answer).certified_duration
    assert certified == approx(2 / 1.5 + 1.5 / 1.0, rel=3e-3)  # trapezoid; the grid's first order


def test_what_does_not_apply_is_null_with_its_reason() -> None:
    loop = Problem([[0.0], [1.0], [0.0]], Limits([1.0], [2.0]), closed=True)
    found = explained(loop, Exact())
    assert found.timing_gap is None
    assert found.route_gap is None
    assert "does not know closed" in found.notes["timing_gap"]
    assert found.gap == approx(found.certified_duration / found.exact - 1)
    assert found.steps() == {}


def test_under_jerk_limits_a_gap_is_timing_times_path() -> None:
    """Ruckig's motion with stops is the best timing of its path: the stops are its path's."""
    found = explained(problem_of("jerk-limit"), RuckigStop())
    assert found.timing_gap == approx(0, abs=1e-6)
    assert (1 + found.timing_gap) * (1 + found.route_gap) == approx(1 + found.gap)
    assert "the path itself stops at waypoint 2" in found.notes["timing"]


def test_a_dilated_or_segmentwise_spline_is_still_of_the_family() -> None:
    problem = random_problem(5, joints=2, waypoints=4)
    fast = spline353.trajectory(problem, np.array([0.05, 0.04, 0.06]))
    found = explain(problem, QUICK, fast)
    assert found.optimiser_gap is not None
    assert found.certified_duration == approx(verify(problem, fast).certified_duration)


def test_what_cannot_be_certified_cannot_be_explained() -> None:
    problem = Problem([[0.0], [1.0]], Limits([1.0], [1.0]))
    jump = Trajectory([0.0, 1.0], np.array([[1.0], [0.0]])[:, None], [0.0, 1.0])
    with pytest.raises(TrajoptError, match="velocity jumps"):
        explain(problem, Exact(), jump)


def test_as_dict_has_the_keys_and_counts_joints_from_one() -> None:
    table = explained(random_problem(1, joints=2, waypoints=4), Exact()).as_dict()
    assert set(table) == {*KEYS.split(), "recorded", "notes", "active"}
    assert {frozenset(row) for row in table["active"]} == {
        frozenset({"joint", "limit", "from", "to", "saving"})
    }
    assert min(row["joint"] for row in table["active"]) >= 1


def test_references_are_those_that_know_the_limits() -> None:
    assert references(problem_of("six-axis")) == ["exact"]
    assert references(problem_of("jerk-limit")) == ["exact-jerk"]
    assert references(problem_of("position-limits")) == ["exact", "collocation-refined"]


def test_peaks_are_exact() -> None:
    # q = t^5 on [0, 2]: q''' = 60 t², 240 at the end; a joint at rest has none.
    local = np.zeros((6, 1, 2))
    local[0, 0, 0] = 1.0
    found = peaks(Trajectory([0.0, 2.0], local, [0.0, 2.0]), 3)
    assert found == approx([240.0, 0.0])


def test_asking_by_name_goes_through_the_registry() -> None:
    assert isinstance(load("toppra"), ToppRa)
    assert callable(load("toppra").along)  # type: ignore[attr-defined]


def test_a_record_is_the_optimum_only_where_it_is_shorter() -> None:
    problem = Problem([[0.0], [1.0]], Limits([5.0], [1.0]))
    bang = Trajectory([0.0, 1.0, 2.0], np.array([[0.5, -0.5], [0, 1], [0, 0.5]])[..., None], [0, 2])
    slow = bang.dilated(1.5)
    known = explain(problem, None, slow, ReferenceAnswer(bang, "theirs, 2026-11-22"))
    assert (known.exact, known.recorded) == (approx(2.0), "")
    # no such motion exists: it only has to be believed that it is shorter
    shorter = ReferenceAnswer(bang.dilated(0.9), "theirs, 2026-11-22")
    known = explain(problem, None, slow, shorter)
    assert (known.exact, known.gap, known.recorded) == (
        1.8,
        approx(3 / 1.8 - 1),
        "theirs, 2026-11-22",
    )
    assert explain(problem, None, slow, ReferenceAnswer(None, "nothing")).recorded == ""


@pytest.mark.parametrize("demands", [{"start_velocity": [0.5, -0.2]}, {"dwell": [0, 0.4, 0]}])
def test_a_motion_in_motion_or_that_waits_has_a_timing_and_a_path(
    demands: dict[str, object],
) -> None:
    waypoints = [[0, 0], [1, -0.4], [1.5, 0.5]]
    problem = Problem(waypoints, Limits([1.0, 1.2], [2.0, 3.0]), demands=demands)
    found = explained(problem, ToppRa(knots="chord", ends="natural"))
    assert found.timing_gap == approx(0, abs=2e-3)
    assert found.route_gap is not None
    assert found.gap is not None
    assert (1 + found.timing_gap) * (1 + found.route_gap) == approx(1 + found.gap)


def test_a_broken_acceleration_limit_is_no_break_of_a_range_that_is_kept() -> None:
    """TOPP-RA knows no ranges. A cubic of 1 rad in 1 s stays inside; its acceleration is 6."""
    limits = Limits([10.0], [1.0], position=[[-1.0, 2.0]])
    problem = Problem([[0.0], [1.0]], limits)
    cubic = Trajectory([0, 1], np.reshape([-2.0, 3.0, 0.0, 0.0], (4, 1, 1)), [0, 1])
    answer = judged(problem, load("toppra"), Solution(Status.SOLVED, cubic))
    assert answer.duration == approx(np.sqrt(6), rel=1e-9)
    narrow = replace(problem, limits=Limits([10.0], [99.0], position=[[-0.2, 2.0]]))
    quartic = np.reshape([-16.0, 30.0, -13.0, 0.0, 0.0], (5, 1, 1))  # -0.48 rad at 0.35 s
    beyond = Trajectory([0, 1], quartic, [0, 1])
    answer = judged(narrow, load("toppra"), Solution(Status.SOLVED, beyond))
    assert answer.trajectory is None
    assert answer.reason == "it ignores position limits, and breaks them"
