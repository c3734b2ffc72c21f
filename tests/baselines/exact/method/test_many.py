"""Problems solved together have the answers that each has alone."""

from dataclasses import replace

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from baselines.exact.method import planner as method
from trajopt import Limits, Problem, verify, verify_many
from trajopt.core.solution import Status
from trajopt.judging import together

PLANNERS = {"exact": Exact(), "exact-jerk": ExactJerk()}


def walks(waypoints, joints, count, jerk=20.0, seed=0):
    rng = np.random.default_rng(seed)
    paths = np.cumsum(rng.uniform(-1, 1, (count, waypoints, joints)), axis=1)
    each = np.ones(joints)
    limits = Limits(each, [2.0 + 0.1 * j for j in range(joints)], jerk and jerk * each)
    return [Problem(path, limits) for path in paths]


def mixed(name):
    """Two shapes, a joint that rests, a wait, an impossible end; for `exact` a moving end too."""
    first, second, third, *others = walks(4, 2, 5)
    resting = replace(first, waypoints=first.waypoints * [1.0, 0.0])
    moving = replace(third, demands={"end_velocity": [0.1, 0.0]})
    return [
        first,
        *walks(3, 3, 2, seed=1),
        replace(second, demands={"dwell": [0.0, 0.5, 0.0, 0.0]}),
        resting,
        *([moving] if name == "exact" else []),
        replace(third, demands={"end_velocity": [5.0, 0.0]}),
        *others,
    ]


@pytest.mark.parametrize("name", PLANNERS)
def test_a_batch_gives_what_each_problem_alone_would(name):
    planner = PLANNERS[name]
    problems = mixed(name)
    together = planner.solve_many(problems)
    for problem, own in zip(problems, together, strict=True):
        alone = planner.solve(problem)
        assert own.status is alone.status
        assert own.message == alone.message
        assert own.stats.keys() == alone.stats.keys()
        if alone.trajectory is not None:
            assert own.trajectory.duration == pytest.approx(alone.trajectory.duration, rel=1e-12)
            known = problem.without(*planner.unknown(problem))
            certified = [verify(known, one.trajectory).certified_duration for one in (own, alone)]
            assert certified[0] == pytest.approx(certified[1], rel=1e-12)
            assert own.trajectory.joints == problem.joints
    assert Status.INFEASIBLE in [own.status for own in together]


@pytest.mark.parametrize("name", PLANNERS)
def test_alike_problems_are_one_batch(name, monkeypatch):
    planner = PLANNERS[name]
    problems = walks(4, 2, 5)
    monkeypatch.setattr(type(planner), "solve", pytest.fail)
    assert all(own.trajectory is not None for own in planner.solve_many(problems))


def test_the_motions_of_a_batch_are_judged_as_one_table(monkeypatch):
    problems = walks(4, 6, 4)
    motions = [own.trajectory for own in ExactJerk().solve_many(problems)]
    monkeypatch.setattr(together, "verify", pytest.fail)
    assert all(own.valid for own in verify_many(problems, motions))


def test_a_problem_on_which_the_first_guesses_disagree_is_solved_alone(monkeypatch):
    problems = walks(4, 2, 3)
    asked = method.still_wanted
    disagrees = iter([1, 0, 0])
    monkeypatch.setattr(method, "still_wanted", lambda *own: next(disagrees) or asked(*own))
    alone = []
    solve = Exact.solve
    monkeypatch.setattr(Exact, "solve", lambda self, own: alone.append(own) or solve(self, own))
    together = Exact().solve_many(problems)
    assert alone == problems[:1]
    assert together[0].trajectory.duration == Exact().solve(problems[0]).trajectory.duration


def test_without_jerk_limits_the_batch_is_that_of_problems_alone():
    problems = walks(3, 2, 2, jerk=None)
    for own, alone in zip(ExactJerk().solve_many(problems), problems, strict=True):
        assert own.trajectory.duration == ExactJerk().solve(alone).trajectory.duration
