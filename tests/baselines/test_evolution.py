"""CMA-ES and DE on objectives with a known minimum, and against the libraries' own runs."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import get_args, get_type_hints

import cma
import numpy as np
import pytest
from numpy.random import PCG64
from numpy.random import Generator as Random
from objectives import CENTRE, HIGH, LOW, Recorded, digest, said_elsewhere, sphere
from scipy.optimize import differential_evolution

from baselines.evolution import CMAES, DE, cmaes, de
from trajopt import InvalidInput, MissingBackend, Problem, Status, verify
from trajopt.benchmark.trial import trials_of
from trajopt.planners.planner import Relation, field_values
from trajopt.planners.registry import GROUP, Entry, configured, options
from trajopt.planners.swarm import Box, Streams, minimise
from trajopt.planners.swarm_planner import SwarmPlanner, pso
from trajopt.planners.testing import check_planner

SIX_AXIS = Problem.from_toml(Path(__file__).parents[2] / "data" / "problems" / "six-axis.toml")
BEST_353 = 4.310382  # s, by spline353-nlp, from every start
STRATEGIES = get_args(get_type_hints(DE)["strategy"])
BOTH = [CMAES(), DE()]
SMALL = [CMAES(2), CMAES(7, sigma0=1e-6, growth=1), DE(6)]


def rosenbrock(x):
    """Least, 0, at (1, 1, 1)."""
    return (100 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1 - x[..., :-1]) ** 2).sum(-1)


def short(optimiser, seeds):
    return minimise(optimiser, sphere, LOW, HIGH, seeds, iterations=30)


@pytest.mark.parametrize("optimiser", BOTH)
def test_finds_the_centre_of_a_sphere(optimiser):
    result = minimise(optimiser, sphere, LOW, HIGH, range(2), iterations=100)
    np.testing.assert_allclose(result.position, np.tile(CENTRE, (2, 1)), atol=1e-5)


@pytest.mark.parametrize("optimiser", BOTH)
def test_finds_the_end_of_rosenbrocks_valley(optimiser):
    result = minimise(optimiser, rosenbrock, [-0.5, -3, 0.9], [3.5, 2, 8], [0], iterations=200)
    np.testing.assert_allclose(result.position, 1, atol=1e-4)


@pytest.mark.parametrize("optimiser", BOTH)
def test_finds_a_minimum_in_the_corner_of_the_box(optimiser):
    result = minimise(
        optimiser, lambda x: (x * [1, 2, -3]).sum(-1), LOW, HIGH, range(2), iterations=100
    )
    np.testing.assert_allclose(result.position, np.tile([0, 0, 4], (2, 1)), atol=1e-5)


@pytest.mark.parametrize("optimiser", BOTH)
def test_a_cliff_beside_the_minimum_does_not_matter(optimiser):
    """As in the planner's penalty: the best point of a corner beyond which everything is worse."""

    def cliff(x):
        excess = np.maximum(1 - x[..., 0] * x[..., 1], 0) + np.maximum(1.5 - x[..., 2], 0)
        return np.where(excess > 0, 12 + excess, x.sum(-1))  # least at (1, 1, 1.5)

    result = minimise(optimiser, cliff, LOW, HIGH, [0, 1], iterations=100)
    np.testing.assert_allclose(result.fitness, 3.5, rtol=1e-5)


def test_de_needs_no_second_dimension():
    result = minimise(DE(), lambda x: (x[..., 0] - 1) ** 2, [-3], [3], range(3), iterations=60)
    np.testing.assert_allclose(result.position, 1, atol=1e-5)


def test_cmaes_needs_a_second_dimension():
    with pytest.raises(InvalidInput, match=r"^dimensions is 1: expected at least 2"):
        minimise(CMAES(), lambda x: x[..., 0], [0], [1], [0])


class Forgetful(Random):
    """A stream that shuffles from the same order each time: SciPy's goes on from its last one."""

    def shuffle(self, x, axis=0):
        x.sort()
        super().shuffle(x, axis)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_de_is_scipys_own(strategy):
    """SciPy's uninterrupted run from the same stream, candidate by candidate."""
    run = DE(20, strategy=strategy, recombination=0.6).run(Forgetful(PCG64(5)), 3)
    ours = [next(run)]
    theirs = Recorded(lambda x: sphere(4 * x.T))
    random = Forgetful(PCG64(5))
    while len(ours) < 25:
        ours.append(run.send(sphere(4 * ours[-1])))
    differential_evolution(
        theirs,
        [(0, 1)] * 3,
        init=random.random((20, 3)),
        maxiter=24,
        rng=random,
        strategy=strategy,
        recombination=0.6,
        mutation=(0.5, 1),
        vectorized=True,
        updating="deferred",
        polish=False,
        tol=0,
    )
    np.testing.assert_allclose(ours, [x.T for x in theirs.x], rtol=0, atol=1e-12)


def test_cmaes_is_the_librarys_own():
    random = Random(PCG64(3))
    strategy = cma.CMAEvolutionStrategy(
        random.random(3),
        0.2,
        {
            "bounds": [[0] * 3, [1] * 3],
            "popsize": 12,
            "randn": lambda *s: random.standard_normal(s),
            "verbose": -9,
            "seed": np.nan,
            "verb_log": 0,
        },
    )
    theirs = Recorded(lambda x: sphere(4 * x))
    strategy.optimize(theirs, maxfun=600)
    run = CMAES(12, sigma0=0.2).run(Random(PCG64(3)), 3)
    ours = [next(run)]
    while len(ours) < 50:
        ours.append(run.send(sphere(4 * ours[-1])))
    np.testing.assert_array_equal(np.concatenate(ours), np.array(theirs.x[:600]))


@pytest.mark.parametrize(
    ("growth", "sizes"), [(1, [5] * 13), (2, [5, 10, 20, 40]), (3, [5, 15, 45])]
)
def test_every_restart_of_cmaes_grows(monkeypatch, growth, sizes):
    """Descents of one generation each, and candidates for 13 of the first."""
    seen = []
    original = cma.CMAEvolutionStrategy

    def brief(x, sigma, options):
        seen.append(options["popsize"])
        return original(x, sigma, options | {"maxiter": 1})

    monkeypatch.setattr(cma, "CMAEvolutionStrategy", brief)
    minimise(CMAES(5, growth=growth), sphere, LOW, HIGH, [0], iterations=12)
    assert seen == sizes


@pytest.mark.parametrize("optimiser", BOTH)
def test_no_budget_lies_idle_after_convergence(optimiser):
    objective = Recorded()
    minimise(optimiser, objective, LOW, HIGH, [0, 1], iterations=200)
    spread = np.array([np.ptp(x, axis=1).max(axis=-1) for x in objective.x])
    assert (spread.min(axis=0) < 1e-3).all()
    first = (spread < 1e-3).argmax(axis=0)
    for run, converged in enumerate(first):
        assert (spread[converged:, run] > 1).any()


@pytest.mark.parametrize("optimiser", [*BOTH, *SMALL])
def test_a_run_gives_the_same_bits_alone_and_among_others_in_any_order(optimiser):
    together = short(optimiser, range(4))
    mixed = short(optimiser, [3, 99, 1])
    assert len(np.unique(together.fitness)) == 4
    for seed, column in ((3, 0), (1, 2)):
        alone = short(optimiser, [seed])
        for result, row in ((together, seed), (mixed, column)):
            assert (alone.position[0] == result.position[row]).all()
            np.testing.assert_array_equal(alone.histories[0], result.histories[row])


@pytest.mark.long
def test_a_run_gives_the_same_bits_in_another_process():
    there = said_elsewhere(
        "from baselines.evolution import *",
        "from objectives import *",
        "from trajopt.planners.swarm import minimise",
        "for optimiser in [CMAES(), DE()]:",
        "    result = minimise(optimiser, sphere, LOW, HIGH, [1, 2], iterations=30)",
        "    print(digest(result))",
    )
    assert there.split() == [digest(short(o, [1, 2])) for o in BOTH]


def test_numpys_global_stream_is_left_alone():
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    for optimiser in BOTH:
        short(optimiser, [0])
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002


@pytest.mark.parametrize("optimiser", BOTH)
@pytest.mark.parametrize("iterations", [0, 1, 7])
def test_evaluations_are_what_was_asked_of_the_objective(optimiser, iterations):
    objective = Recorded()
    result = minimise(optimiser, objective, LOW, HIGH, range(3), iterations=iterations)
    counted = sum(f.shape[1] for f in objective.f)
    assert result.evaluations == counted == 30 * (1 + iterations)
    assert result.iterations == iterations


@pytest.mark.parametrize("optimiser", BOTH)
@pytest.mark.parametrize("budget", [1, 29, 30, 31, 61, 100, 501])
def test_a_budget_of_evaluations_is_spent_exactly(optimiser, budget):
    objective = Recorded()
    result = minimise(optimiser, objective, LOW, HIGH, range(2), evaluations=budget)
    assert result.evaluations == sum(f.shape[1] for f in objective.f) == budget
    assert result.histories[0][-1, 0] == budget
    best = np.concatenate(objective.f, axis=1).min(axis=1)
    np.testing.assert_array_equal(result.fitness, best)


@pytest.mark.parametrize(
    "optimiser", [*BOTH, *SMALL, *(DE(6, strategy=name) for name in STRATEGIES)]
)
def test_every_candidate_is_in_its_runs_own_box(optimiser):
    low = np.array([[0, 0, 0], [-3, 1e-3, 5], [1, 1, 1.0]])
    high = low + np.array([[4, 4, 4], [1, 1e-2, 1e3], [1e-6, 1, 1e6]])
    objective = Recorded(lambda x: ((x - low[:, None]) / (high - low)[:, None]).sum(-1))
    minimise(optimiser, objective, low, high, range(3), iterations=40)
    x = np.concatenate(objective.x, axis=1)
    assert np.isfinite(x).all()
    assert (x >= low[:, None]).all()
    assert (x <= high[:, None]).all()


@pytest.mark.parametrize("optimiser", [*BOTH, *SMALL])
@pytest.mark.parametrize(
    "values", [[np.nan], [np.inf], [-np.inf], [0.0], [np.nan, np.inf, -np.inf, 1e300, 1.0]]
)
def test_any_fitness_is_survived(optimiser, values):
    random = np.random.default_rng(0)
    search = optimiser.search(Box.of(LOW, HIGH, 1), Streams([0]), 12)
    x = next(search)
    for _ in range(12):
        assert x.shape == (1, optimiser.population, 3)
        assert np.isfinite(x).all()
        x = search.send(random.choice(values, x.shape[:2]))


@pytest.mark.parametrize("optimiser", BOTH)
def test_missing_values_among_others_do_not_mislead(optimiser):
    search = optimiser.search(Box.of(LOW, HIGH, 1), Streams([0]), 150)
    best = np.inf
    x = next(search)
    for _ in range(150):
        best = min(best, sphere(x).min())
        x = search.send(np.where(x[..., 0] < CENTRE[0], np.nan, sphere(x)))
    assert best < 1e-6


@pytest.mark.parametrize(
    ("make", "option"),
    [
        (lambda: CMAES(1), "population"),
        (lambda: CMAES(sigma0=0.0), "sigma0"),
        (lambda: CMAES(sigma0=0.4), "sigma0"),
        (lambda: CMAES(sigma0=float("nan")), "sigma0"),
        (lambda: CMAES(growth=0), "growth"),
        (lambda: DE(5), "population"),
        (lambda: DE(strategy="best3bin"), "strategy"),
        (lambda: DE(recombination=1.1), "recombination"),
        (lambda: DE(recombination=float("nan")), "recombination"),
        (lambda: DE(tolerance=-1e-9), "tolerance"),
        (lambda: DE(tolerance=1.0), "tolerance"),
    ],
)
def test_a_bad_option_is_named(make, option):
    with pytest.raises(InvalidInput, match=f"^{option} .*expected"):
        make()


@pytest.mark.parametrize("fitness", ["penalty", "scaled"])
@pytest.mark.parametrize("planner", [cmaes, de])
def test_reaches_the_best_353_and_does_not_beat_it(planner, fitness):
    solution = replace(planner, fitness=fitness, evaluations=5000).solve(SIX_AXIS, seed=1)
    certificate = verify(SIX_AXIS, solution.trajectory)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(BEST_353, rel=1e-5)
    assert certificate.certified_duration > BEST_353 * (1 - 1e-6)
    assert solution.history[-1, 0] == solution.evaluations == 5000


@pytest.mark.parametrize("planner", [cmaes, de])
def test_keeps_the_contract_joint_by_joint_too(planner):
    check_planner(replace(planner, timing="per-joint", iterations=2))


def test_the_planners_are_the_swarms_own_but_for_the_optimiser():
    around_pso = options(pso).items() - field_values(pso.optimiser).items()
    around_de = options(de).items() - field_values(de.optimiser).items()
    assert around_pso == around_de
    for planner, name in ((cmaes, "CMAES."), (de, "DE.")):
        assert isinstance(planner, SwarmPlanner)
        assert planner.stochastic
        assert planner.relation(SIX_AXIS) is Relation.RESTRICTION
        assert planner.description.endswith(name)
        assert (planner.fitness, planner.optimiser.population) == ("penalty", 30)
        budget = pso.optimiser.evaluations_per_iteration * pso.iterations
        assert planner.optimiser.evaluations_per_iteration * planner.iterations == budget
        assert len(options(planner)) == len(vars(planner)) - 1 + len(vars(planner.optimiser))


def test_options_are_set_from_text():
    changed = configured(cmaes, {"sigma0": "0.2", "fitness": "scaled", "population": "7"})
    assert changed.optimiser == CMAES(7, sigma0=0.2)
    assert type(changed) is type(cmaes)
    assert configured(de, {"strategy": "rand1bin"}).optimiser == DE(strategy="rand1bin")
    with pytest.raises(InvalidInput, match="option population"):
        configured(de, {"population": "4"})


def test_a_missing_library_is_told_with_the_line_that_mends_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "cma", None)
    entry = Entry("cmaes", EntryPoint("cmaes", "baselines.evolution:cmaes", GROUP))
    assert entry.missing() == 'cma is not installed; install it with: pip install "mintime[cma]"'
    with pytest.raises(MissingBackend, match=r"mintime\[cma\]"):
        cmaes.solve(SIX_AXIS)
    (trial,) = trials_of(cmaes, SIX_AXIS, [0], "cmaes")
    assert trial.status is Status.MISSING
    assert "mintime[cma]" in trial.message
    assert replace(de, iterations=1).solve(SIX_AXIS).status is Status.SOLVED
