"""Swarms on the times of splines: the fitness is the verifier's, and budgets are kept."""

from functools import partial

import numpy as np
import pandas as pd
import pytest

from experiments import recipes
from experiments.recipes import SplineTimes
from trajopt import InvalidInput, Limits, Problem, verify

LIMITS = Limits(
    [2.0, [-1.0, 3.0]],
    [4.0, 5.0],
    jerk=[30.0, np.inf],
)
TURN = Problem(
    [
        [0.0, 0.2],
        [1.0, -0.4],
        [0.3, 0.5],
        [1.2, 0.1],
    ],
    LIMITS,
)
B_SPLINE = "quintic B-spline"


@pytest.mark.parametrize("family", ["3-5-3", B_SPLINE])
def test_the_fitness_is_what_the_verifier_certifies(family):
    times = SplineTimes(TURN, family)
    rng = np.random.default_rng(0)
    for x in rng.random((20, 3)):
        certificate = verify(TURN, times.trajectory(x))
        duration = certificate.dilation * certificate.duration
        assert certificate.valid
        assert times.fitness(x) == pytest.approx(duration, rel=1e-9)


def test_equal_times_are_the_longest_stop():
    times = SplineTimes(TURN, B_SPLINE)
    seconds = times.seconds(times.equal_times())
    np.testing.assert_allclose(seconds, times.longest_stop)


def test_two_waypoints_give_the_quintic_from_rest_to_rest():
    # 10 s³ − 15 s⁴ + 6 s⁵ peaks at 60 h/T³; here jerk decides.
    limits = Limits([1e3], [1e3], jerk=[15.0])
    problem = Problem([[0.0], [2.0]], limits)
    times = SplineTimes(problem, B_SPLINE)
    longest = np.cbrt(60 * 2 / 15)
    anywhere = np.array([0.3])
    assert times.fitness(anywhere) == pytest.approx(longest, rel=1e-9)


@pytest.mark.parametrize("name", [*recipes.NIAPY, *recipes.OURS])
def test_every_swarm_spends_its_budget_and_no_more(name):
    run = recipes.of_ours
    if name in recipes.NIAPY:
        pytest.importorskip("niapy")
        run = recipes.of_niapy
    seen = []

    def bowl(x):
        assert (x >= 0).all()
        assert (x <= 1).all()
        squares = (x - 0.3) ** 2
        value = float(squares.sum())
        seen.append(value)
        return value

    best = run(name, bowl, 3, 200, 0)
    assert len(seen) == 200
    assert best == pytest.approx(min(seen), abs=1e-12)


def test_a_recipe_measures_every_swarm(tmp_path, monkeypatch):
    swarms = (*recipes.OURS, recipes.LOCAL)
    monkeypatch.setattr(recipes, "SWARMS", swarms)
    monkeypatch.setattr(recipes, "POPULATION", 6)
    measure = partial(recipes.main, only="six-axis, 3-5-3", seeds=2, evaluations=60)
    measure(output=tmp_path)
    (row,) = pd.read_csv(tmp_path / "recipes.csv").to_dict("records")
    # no 3-5-3 is faster than the best one, which takes 2.905 times the optimum
    assert row["family above the optimum"] >= 190.4
    assert 0 <= row[row["best swarm"]] <= row[row["worst swarm"]]


def test_a_task_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="--only is '4-3-4': expected a part of one of six-axis"):
        recipes.main(only="4-3-4", output=tmp_path)
