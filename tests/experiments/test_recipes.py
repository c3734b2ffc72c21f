"""Swarms on the times of splines: an exact fitness, an adapter for any of them, and budgets."""

import numpy as np
import pandas as pd
import pytest

from experiments import recipes
from experiments.common.beetles import DBO
from experiments.common.minimisers import NiaPy, Ours, local_search
from experiments.common.spline_times import SplineTimes
from experiments.common.whales import WOA
from trajopt import InvalidInput, Limits, Problem, verify
from trajopt.explain.claims import Known
from trajopt.planners.swarm import SSA, minimise

TURN = Problem(
    [[0.0, 0.2], [1.0, -0.4], [0.3, 0.5], [1.2, 0.1]],
    Limits([2.0, [-1.0, 3.0]], [4.0, 5.0], jerk=[30.0, np.inf]),
)
SIX = Problem([*TURN.waypoints, [0.0, 0.0], [0.5, 0.7]], TURN.limits)


@pytest.mark.parametrize(
    ("problem", "family"),
    [(TURN, "3-5-3"), (TURN, "quintic B-spline"), (SIX, "quintic B-spline")],
)
def test_the_fitness_is_what_the_verifier_certifies(problem, family):
    times = SplineTimes(problem, family)
    rng = np.random.default_rng(0)
    for x in rng.random((20, times.dimension)):
        trajectory = times.trajectory(x)
        certificate = verify(problem, trajectory)
        assert certificate.valid
        duration = certificate.dilation * certificate.duration
        assert times.fitness(x) == pytest.approx(duration, rel=1e-9)
        np.testing.assert_allclose(times.coordinates(times.seconds(x)), x, atol=1e-12)


def test_two_waypoints_give_the_quintic_from_rest_to_rest():
    # 10 s³ − 15 s⁴ + 6 s⁵ peaks at 15/8 h/T, 10/√3 h/T² and 60 h/T³; here jerk decides.
    problem = Problem([[0.0], [2.0]], Limits([1e3], [1e3], jerk=[15.0]))
    times = SplineTimes(problem, "quintic B-spline")
    assert times.fitness(np.array([0.3])) == pytest.approx(np.cbrt(60 * 2 / 15), rel=1e-9)


def test_the_b_spline_is_four_times_continuously_differentiable():
    trajectory = SplineTimes(SIX, "quintic B-spline").trajectory(np.linspace(0.2, 0.9, 5))
    inner = trajectory.breaks[1:-1]
    for order in range(5):
        before = trajectory(inner * (1 - 1e-9), order)
        after = trajectory(inner * (1 + 1e-9), order)
        np.testing.assert_allclose(before, after, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", recipes.SWARMS)
def test_every_swarm_spends_its_budget_and_no_more(name):
    if isinstance(recipes.SWARMS[name], NiaPy):
        pytest.importorskip("niapy")
    seen = []

    def bowl(x):
        assert (x >= 0).all()
        assert (x <= 1).all()
        seen.append(float(((x - 0.3) ** 2).sum()))
        return seen[-1]

    best = recipes.SWARMS[name](bowl, 3, 200, 0)
    assert len(seen) == 200
    assert ((best - 0.3) ** 2).sum() == pytest.approx(min(seen), abs=1e-12)


def test_a_seed_means_the_same_run():
    pytest.importorskip("niapy")
    times = SplineTimes(TURN, "3-5-3")
    for swarm in (NiaPy("GreyWolfOptimizer"), Ours(SSA())):
        first = swarm(times.fitness, 3, 100, 7)
        np.testing.assert_array_equal(first, swarm(times.fitness, 3, 100, 7))


@pytest.mark.parametrize("swarm", [WOA(), DBO()])
def test_a_swarm_finds_the_bottom_of_a_bowl(swarm):
    def bowl(x):
        return ((x - [0.3, 0.6]) ** 2).sum(axis=-1)

    low = np.array([0.0, 0.0])
    seeds = range(10)
    found = minimise(swarm, bowl, low, low + 1, seeds=seeds, evaluations=1500)
    np.testing.assert_allclose(found.position, [[0.3, 0.6]] * 10, atol=0.01)
    # a run knows nothing of the runs beside it
    alone = minimise(swarm, bowl, low, low + 1, seeds=[4], evaluations=1500)
    np.testing.assert_array_equal(alone.position[0], found.position[4])


def test_the_beetles_need_their_numbers():
    with pytest.raises(InvalidInput, match="population is 20: expected a multiple of 30"):
        DBO(population=20)


def test_the_local_search_finds_the_bottom_of_a_bowl():
    found = local_search(lambda x: float(((x - 0.3) ** 2).sum()), np.full(3, 0.8), 500)
    np.testing.assert_allclose(found, 0.3, atol=1e-4)


def references(problem, families, time_limit):
    """What the references say of the six-axis problem: found once, not again for a table's form."""
    return Known(problem, 1.4839, "exact", 1.4837, "certify", 2.3865, {"3-5-3": 4.3104})


def test_quick_writes_its_tables_and_figure(tmp_path, monkeypatch):
    pytest.importorskip("niapy")
    monkeypatch.setattr(recipes, "survey", references)
    recipes.main(quick=True, output=tmp_path)
    table = (tmp_path / "recipes.md").read_text(encoding="utf-8")
    for name in (*recipes.SWARMS, recipes.LOCAL):
        assert f"| {name} " in table
    (decided,) = pd.read_csv(tmp_path / "shares.csv").to_dict("records")
    # no 3-5-3 is faster than the best there is, and no swarm than its family
    assert decided["family's best found s"] >= 4.3103
    assert (
        0 <= decided["best swarm's median over it %"] <= decided["worst swarm's median over it %"]
    )
    assert (tmp_path / "recipes.png").is_file()


def test_a_task_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="--only is '4-3-4': expected a part of one of six-axis"):
        recipes.main(only="4-3-4", output=tmp_path)
