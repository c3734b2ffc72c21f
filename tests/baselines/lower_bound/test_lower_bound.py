"""Proved bounds against closed forms and other searches."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from work import HANG_S

from baselines.exact.acceleration import Exact
from baselines.lower_bound.bound import Bound, prove
from baselines.lower_bound.planner import Prove
from baselines.ruckig_ import RuckigStop
from baselines.spline353_nlp import Spline353NLP
from lower_bound.test_proof import limited_problem
from trajopt import InvalidInput, Limits, Problem, Status, verify
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem
from trajopt.core.exceptions import MissingBackend
from trajopt.planners import spline353


def one_joint(*waypoints: float, v: float = 1.0, a: float = 2.0) -> Problem:
    return Problem([[q] for q in waypoints], Limits([v], [a]))


def sane(bound: Bound, problem: Problem) -> None:
    assert 0 < bound.lower_bound <= bound.upper_bound
    assert bound.proved_within == pytest.approx(bound.upper_bound / bound.lower_bound - 1)
    assert bound.trajectory is not None
    judged = verify(problem, bound.trajectory)
    assert judged.certified_duration == pytest.approx(bound.upper_bound, rel=1e-9)


@pytest.mark.parametrize("within", [1e-3, 1e-5])
@pytest.mark.parametrize(
    ("problem", "optimum"),
    [
        (load("one-joint"), 2.0),
        (one_joint(0, 1.5), 1.5 / 1 + 1 / 2),  # trapezoid: h/V + V/A
        (one_joint(0, 0.08), 2 * np.sqrt(0.08 / 2)),  # triangle: 2 √(h/A)
        (one_joint(0, 0.4, 1.0, 1.5), 2.0),  # waypoints on the way cost nothing
        (one_joint(0, 1.5, 0), 4.0),  # a reversal is two stops
        (one_joint(0, 1.5, 1.5, 0), 4.0),  # a repeated waypoint is passed once
        (one_joint(0, 1e5), 1e5 + 0.5),
        (Problem([[0, 5], [1.5, 5]], Limits([1, 1], [2, 2])), 2.0),  # a joint that rests
        (Problem([[0, 0], [1.5, 1.5]], Limits([1, 3], [2, 9])), 2.0),  # the slower one decides
        (Problem([[0.0], [1.0]], Limits([[-1, 0.5]], [[-1.0, 4.0]])), 2 + 0.25 * 1.25),
        (Problem([[0.0], [-1.0]], Limits([[-0.5, 1]], [[-4.0, 1.0]])), 2 + 0.25 * 1.25),
    ],
)
def test_closed_forms(problem: Problem, optimum: float, within: float) -> None:
    bound = prove(problem, within=within)
    sane(bound, problem)
    assert bound.status == "proved"
    assert bound.proved_within <= within * (1 + 1e-6)
    assert bound.lower_bound <= optimum * (1 + 1e-12)
    assert bound.upper_bound == pytest.approx(optimum, rel=1e-8)


@pytest.mark.long
def test_six_axis_is_proved_in_time() -> None:
    problem = load("six-axis")
    free = prove(problem, time_limit=HANG_S)
    spline = prove(problem, "spline353", within=1e-6, time_limit=HANG_S)
    for bound in (free, spline):
        sane(bound, problem)
        assert bound.status == "proved"
    assert free.upper_bound < spline.lower_bound
    assert free.proved_within <= 1e-4 * (1 + 1e-6)
    assert spline.proved_within <= 1e-6 * (1 + 1e-6)
    readme = (Path(__file__).parents[3] / "README.md").read_text(encoding="utf-8")
    rounded_down = np.floor(1e6 * free.lower_bound) / 1e6
    assert f"No motion takes less than {rounded_down:.6f} s" in readme


def test_a_segment_near_rounding_is_left_unproved() -> None:
    """Flown by at full speed its spline takes 6 s, which no other spline comes near."""
    problem = one_joint(0.0, 1.0, 1.0 + 1e-13, 2.0)
    bound = prove(problem, "spline353", time_limit=HANG_S)
    assert bound.status == "stopped: no progress"
    # 3 d1/t1 <= V = 1 and 6 d1/t1^2 <= A = 2 for d1 = 1, twice; the middle one takes no time
    assert bound.lower_bound <= 6.0
    longer = prove(one_joint(0.0, 1.0, 1.0 + 1e-10, 2.0), "spline353", time_limit=HANG_S)
    assert longer.status == "proved"
    assert longer.lower_bound <= 6.0 <= longer.upper_bound * (1 + 1e-9)


@pytest.mark.parametrize(
    ("problem", "family", "planner", "within"),
    [
        *((random_problem(seed), "free", Exact(), 1e-3) for seed in range(6)),
        *((limited_problem(seed, waypoints=3), "free", RuckigStop(), 1e-2) for seed in range(3)),
        *(
            (random_problem(seed, waypoints=4, jerk=seed < 2), "spline353", Spline353NLP(), 1e-3)
            for seed in range(4)
        ),
    ],
)
def test_a_bound_lies_between_a_trivial_one_and_an_answer(problem, family, planner, within) -> None:
    """Under jerk limits too; each joint crosses each segment at its velocity limit at best."""
    bound = prove(problem, family, within=within, time_limit=HANG_S)
    sane(bound, problem)
    assert bound.proved_within < 2 * within
    answer = planner.solve(problem).trajectory
    assert answer is not None
    assert bound.lower_bound <= answer.duration * (1 + 1e-9)
    cruising = np.abs(problem.displacements) / np.abs(problem.limits.velocity).max(axis=1)
    assert bound.lower_bound >= cruising.max(axis=1).sum()


@pytest.mark.parametrize("joints", [[1], [3], [1, 2], [3, 4, 5]])
def test_some_joints_against_a_search_over_the_ratios(joints: list[int]) -> None:
    """Random times, dilated exactly: none may beat the bound, the best must come near."""
    problem = load("six-axis").only(joints)
    bound = prove(problem, "spline353", within=1e-5, time_limit=HANG_S)
    assert bound.status == "proved"
    generator = np.random.default_rng(0)
    ratios = np.exp(generator.uniform(-4, 4, (20000, 3)))
    h = problem.displacements.T
    dilations = spline353.dilation(h, ratios[:, None, :], problem.limits)
    durations = dilations * ratios.sum(axis=1)
    assert bound.lower_bound <= durations.min()
    assert durations.min() <= bound.upper_bound * 1.05


def test_a_joint_alone_is_faster() -> None:
    whole = load("six-axis")
    alone = prove(whole.only([4]))
    assert alone.trajectory is not None
    assert alone.trajectory.joints == 1
    assert len(alone.trajectory.waypoint_times) == len(whole.waypoints)
    assert alone.upper_bound < prove(whole).lower_bound


def test_jerk_and_position_limits_count() -> None:
    for name, within in (("jerk-limit", 5e-3), ("position-limits", 5e-4)):
        bound = prove(load(name), within=within)
        free = prove(load(name).without("jerk", "position"))
        sane(bound, load(name))
        assert bound.status == "proved"
        assert bound.lower_bound > free.upper_bound


def test_position_limits_bound_the_353_too() -> None:
    """Between the bound and the best known lies nothing; without the limits it is far below."""
    problem = load("position-limits")
    bound = prove(problem, "spline353", within=1e-3, time_limit=HANG_S)
    assert bound.status == "proved"
    assert bound.trajectory is not None
    assert verify(problem, bound.trajectory).feasible
    # the best of a grid of ratios, refined
    assert bound.lower_bound <= 35.18858 <= bound.upper_bound * (1 + 1e-6)
    free = prove(problem.without("position"), "spline353", within=1e-3, time_limit=HANG_S)
    assert free.status == "proved"
    assert free.lower_bound < bound.lower_bound


def test_no_353_passes_a_limit_at_speed() -> None:
    limits = Limits([2.0], [5.0], position=[[0.0, 1.0]])
    problem = Problem([[0.2], [1.0], [0.5], [0.0]], limits)
    bound = prove(problem, "spline353")
    assert bound.status == "infeasible"
    assert bound.lower_bound == np.inf
    assert bound.trajectory is None
    assert "at its limit at waypoint 2" in bound.message
    answer = Prove(family="spline353").solve(problem)
    assert answer.status is Status.INFEASIBLE
    assert answer.message == bound.message


@pytest.mark.parametrize("family", ["free", "spline353"])
def test_a_time_limit_returns_the_bounds_reached(family: str) -> None:
    problem = load("six-axis")
    for seconds in (1e-6, 0.5):
        bound = prove(problem, family, within=1e-9, time_limit=seconds)  # type: ignore[arg-type]
        sane(bound, problem)
        assert bound.status in ("time limit", "stopped: no progress")


def test_without_a_solver_the_message_is_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "highspy", None)
    with pytest.raises(MissingBackend, match="pip install highspy"):
        prove(load("six-axis"))


@pytest.mark.parametrize("wrong", [{"family": "5-3-5"}, {"within": 0}, {"time_limit": -1}])
def test_wrong_arguments(wrong: dict[str, object]) -> None:
    with pytest.raises(InvalidInput):
        Prove(**wrong).bound(load("six-axis"))  # type: ignore[arg-type]
    with pytest.raises(InvalidInput):
        prove(load("seven-waypoints"), "spline353")
