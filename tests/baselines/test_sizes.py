"""Planners that will take long say so before they begin."""

import logging

import numpy as np
import pytest

from baselines.collocation import refined, uniform
from baselines.exact.acceleration import planner as exact
from baselines.exact.jerk import planner as exact_jerk
from trajopt import Limits, Problem
from trajopt.planners.planner import Planner


class Begun(Exception):
    """The solver is about to be built."""


def walk(waypoints: int, joints: int, jerk_limit: float = np.inf) -> Problem:
    steps = np.random.default_rng(0).uniform(-1, 1, (waypoints, joints))
    limits = Limits(np.ones(joints), np.full(joints, 2.0), np.full(joints, jerk_limit))
    return Problem(np.cumsum(steps, axis=0), limits)


@pytest.fixture
def stop_at_the_solver(monkeypatch):
    def begun(*_: object, **__: object) -> None:
        raise Begun

    monkeypatch.setattr(uniform, "transcription", begun)
    monkeypatch.setattr(refined, "transcription", begun)
    monkeypatch.setattr(exact, "_minimised", begun)
    monkeypatch.setattr(exact_jerk, "_minimised", begun)


PLANNERS = [
    ("collocation", uniform.Collocation()),
    ("collocation-refined", refined.CollocationRefined()),
    ("exact", exact.Exact()),
    ("exact-jerk", exact_jerk.ExactJerk()),
]

# 2000 waypoints of 7 joints are a matter of seconds for `exact` and `exact-jerk`.
LARGE = [(*planner, 30, 600) for planner in PLANNERS]
LARGE += [(*planner, 2000, 7) for planner in PLANNERS if planner[0].startswith("coll")]


@pytest.mark.usefixtures("stop_at_the_solver")
@pytest.mark.parametrize(("name", "planner", "waypoints", "joints"), LARGE)
def test_large_problems_are_announced_first(name, planner: Planner, waypoints, joints, caplog):
    problem = walk(waypoints, joints, 20.0 if name == "exact-jerk" else np.inf)
    with caplog.at_level(logging.WARNING, "trajopt.sizes"), pytest.raises(Begun):
        planner.solve(problem)
    assert f"{name}: {waypoints} waypoints and {joints} moving joints" in caplog.text


@pytest.mark.usefixtures("stop_at_the_solver")
@pytest.mark.parametrize(("name", "planner"), PLANNERS)
def test_small_problems_are_not(name, planner: Planner, caplog):
    with caplog.at_level(logging.WARNING, "trajopt.sizes"), pytest.raises(Begun):
        planner.solve(walk(4, 2, 20.0 if name == "exact-jerk" else np.inf))
    assert caplog.text == ""
