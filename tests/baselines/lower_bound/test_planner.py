"""The registered planner: its answers, its refusals, and its proofs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from work import HANG_S

from baselines.lower_bound.planner import Prove
from trajopt import InvalidInput, Limits, Problem
from trajopt.benchmark.suites.catalogue import load
from trajopt.core.solution import Status
from trajopt.planners import spline353
from trajopt.planners.planner import Relation
from trajopt.planners.registry import load as load_planner
from trajopt.planners.rest_to_rest import stop_times

QUICK = Prove(time_limit=HANG_S)


def test_it_is_the_registered_planner():
    planner = load_planner("prove:family=spline353")
    assert planner == Prove(family="spline353")


def test_the_trapezoid_has_both_ends():
    solution = QUICK.solve(load("one-joint"))
    # 1.5 rad at most 1 rad/s and 2 rad/s²: 1.5/1 + 1/2
    assert solution.lower_bound <= 2.0
    assert solution.lower_bound == pytest.approx(2.0, rel=2e-4)
    assert solution.trajectory.duration == pytest.approx(2.0, rel=1e-8)
    assert solution.stats["proof"] == "proved"


def test_position_limits_under_jerk_limits_are_proved_by_rows_searched_for():
    # at the limit the jerk jumps: with the rows of `extremal.py` alone 13 % stay open
    position = [[0, 1], [-0.5, 0.6]]
    problem = Problem(
        [[0, 0], [1, -0.5], [0.4, 0.6]], Limits([1, 1], [2, 2], jerk=[20, 20], position=position)
    )
    planner = Prove(within=2e-3, time_limit=HANG_S)
    solution = planner.solve(problem)
    assert solution.stats["proof"] == "proved"
    assert solution.lower_bound > 3.19
    assert planner.stored_bound(problem, solution.stats) == solution.lower_bound


def test_a_bound_of_splines_is_not_a_bound_of_every_trajectory():
    planner = Prove(family="spline353", within=1e-2, time_limit=HANG_S)
    # one way with waypoints on it: the trapezoid of 1.5/1 + 1/2 s passes them, a 3-5-3 is slower
    problem = Problem([[0.0], [0.4], [1.0], [1.5]], Limits([1.0], [2.0]))
    solution = planner.solve(problem)
    bound = solution.stats["lower_bound"]
    assert planner.relation(problem) is Relation.RESTRICTION
    assert solution.lower_bound is None
    assert bound > 2.0
    assert planner.stored_bound(problem, solution.stats) == bound


def test_what_it_cannot_answer_is_refused_with_the_reason():
    problem = Problem([[0, 5], [1.5, 5]], Limits([1, 1], [2, 2]))
    solution = Prove(family="spline353").solve(problem)
    assert solution.status is Status.UNSUPPORTED
    assert "4 waypoints" in solution.message


# --- proofs of 3-5-3 splines ---


@pytest.fixture(scope="module")
def proved():
    planner = Prove(family="spline353", within=1e-3)
    return planner, planner.solve(load("reversal")).stats


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("cutoff", lambda cutoff: cutoff * 1.01),
        ("cutoff", lambda cutoff: cutoff * 1e300),
        ("cutoff", lambda cutoff: cutoff * np.nan),
        ("cutoff", lambda cutoff: cutoff * np.inf),
        ("cutoff", lambda cutoff: -cutoff),
        ("cutoff", lambda cutoff: cutoff[:0]),
        ("rows", lambda rows: rows[:-1]),
        ("rows", lambda rows: np.add(rows, [6, 0, 0, 0])),
        ("rows", lambda rows: np.add(rows, [0, 9, 0, 0])),
        ("rows", lambda rows: np.add(rows, [0, 0, 2, 0])),
        ("rows", lambda rows: np.add(rows, [0, 0, 0, 1.5])),
        ("rows", lambda rows: rows * [0, 1, 1, 1]),  # positions, which have no limits
        ("rows", lambda rows: rows[::-1]),
        ("rows", lambda rows: rows[:, :3]),
        ("rows", lambda rows: rows * np.nan),
        ("steps", lambda steps: steps[:-1]),
        ("steps", lambda steps: np.append(steps, 2)),
        ("steps", lambda steps: np.full_like(steps, 2.0)),
        ("steps", lambda steps: np.zeros_like(steps)),
        ("steps", lambda steps: steps + 0.5),
        ("steps", lambda steps: steps + 1000),
        ("steps", lambda steps: steps * np.nan),
    ],
)
def test_a_forged_proof_of_splines_is_refused(proved, name, change):
    planner, stats = proved
    forged = dict(stats)
    forged[f"ratio_proof_{name}"] = change(stats[f"ratio_proof_{name}"])
    with pytest.raises(InvalidInput, match="proof"):
        planner.stored_bound(load("reversal"), forged)


def without_rows(stats):
    """The proof as it was stored before it stated rows: instants, and a bit for each box."""
    old = {name: own for name, own in stats.items() if not name.endswith(("_rows", "_steps"))}
    leaves = np.packbits(stats["ratio_proof_steps"] >= 2).astype(float)
    instants = np.unique(stats["ratio_proof_rows"][:, 3])
    return old | {"ratio_proof_instants": instants, "ratio_proof_leaves": leaves}


def test_a_stored_proof_without_rows_proves_the_same(proved):
    planner, stats = proved
    bound = planner.stored_bound(load("reversal"), without_rows(stats))
    assert bound == stats["ratio_proof_cutoff"][0]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("cutoff", lambda cutoff: cutoff * 1.01),
        ("cutoff", lambda cutoff: cutoff * np.nan),
        ("instants", lambda instants: instants[:1]),
        ("instants", lambda instants: instants + 0.5),
        ("instants", lambda instants: instants * np.nan),
        ("leaves", lambda leaves: leaves[:-1]),
        ("leaves", lambda leaves: np.full_like(leaves, 255.0)),
        ("leaves", lambda leaves: np.zeros_like(leaves)),
        ("leaves", lambda leaves: leaves + 0.5),
        ("leaves", lambda leaves: leaves * np.nan),
    ],
)
def test_a_forged_proof_without_rows_is_refused(proved, name, change):
    planner, stats = proved
    forged = without_rows(stats)
    forged[f"ratio_proof_{name}"] = change(forged[f"ratio_proof_{name}"])
    with pytest.raises(InvalidInput, match="proof"):
        planner.stored_bound(load("reversal"), forged)


def test_a_proof_of_splines_proves_nothing_of_a_faster_problem(proved):
    planner, stats = proved
    problem = load("reversal")
    limits = problem.limits
    faster_limits = replace(
        limits, velocity=2 * limits.velocity, acceleration=4 * limits.acceleration
    )
    faster = replace(problem, limits=faster_limits)
    with pytest.raises(InvalidInput, match="proof"):
        planner.stored_bound(faster, stats)


@settings(deadline=None, max_examples=60)
@given(
    st.floats(-6, 6), st.floats(-6, 6), st.sampled_from(["six-axis", "jerk-limit", "asymmetric"])
)
def test_no_spline_is_shorter_than_the_stored_bound(first, last, name):
    """Each pair of ratios, dilated exactly, against the boxes: an independent formula."""
    problem = load(name).without("position")
    bound = stored_bound_of(name)
    times = np.exp([-first, 0.0, -last])
    dilation = spline353.dilation(problem.displacements.T, times[None], problem.limits)
    assert times.sum() * dilation >= bound


@cache
def stored_bound_of(name):
    problem = load(name).without("position")
    planner = Prove(family="spline353", within=1e-2)
    return planner.stored_bound(problem, planner.solve(problem).stats)


# --- sizes ---


@pytest.mark.parametrize(("waypoints", "joints"), [(1000, 7), (4, 1000)])
def test_a_model_that_takes_longer_than_the_time_limit_is_not_built(monkeypatch, waypoints, joints):
    rng = np.random.default_rng(0)
    steps = rng.uniform(-1, 1, (waypoints, joints))
    limits = Limits(np.ones(joints), np.full(joints, 2.0))
    problem = Problem(np.cumsum(steps, axis=0), limits)
    for built in ("relaxed", "branch_and_bound"):
        monkeypatch.delattr(f"baselines.lower_bound.bound.{built}")
    solution = Prove(time_limit=5.0).solve(problem)
    assert "a proof can begin" in solution.message
    # no segment is faster than its largest displacement at top speed
    at_top_speed = np.abs(problem.displacements).max(axis=1).sum()
    assert solution.lower_bound >= at_top_speed * (1 - 1e-12)
    assert solution.lower_bound < stop_times(problem).sum()


@pytest.mark.parametrize(
    ("apart", "words"),
    [
        (0.0, "the fastest known is 25 % above"),
        (0.3, "is 25 % above, and its planner's starts disagree by 30 %"),
        (np.inf, "is 25 % above: one of its planner's starts succeeded alone"),
    ],
)
def test_an_open_bound_says_how_far_the_motion_is_above_and_whether_its_starts_agree(apart, words):
    bound = Prove(time_limit=HANG_S).bound(Problem([[0.0], [1.0]], Limits([1.0], [1.0])))
    opened = replace(bound, status="time limit", proved_within=0.25, disagreement=apart)
    assert Prove()._message(opened).endswith(words)
    assert "above" not in Prove()._message(replace(opened, status="proved"))
