"""PSO, SSA and ISSA on objectives with a known minimum, and the formulas one by one."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from numpy.random import SeedSequence
from objectives import HIGH, LOW, Recorded, digest, said_elsewhere, sphere
from scipy.special import gamma

from trajopt import InvalidInput
from trajopt.planners.swarm import ISSA, PSO, SSA, Box, Compared, Streams, minimise
from trajopt.planners.swarm.issa import chaotic_map, control, falling_weight, levy_scale

PRINTED = ISSA(eq41="printed", eq43="printed", eq49="printed", eq50="printed")
OTHER = ISSA(
    acceptance="always", boundary="reflect", sorting="phase", watch="first", step="elementwise"
)
ALL = [PSO(), SSA(), ISSA(), PRINTED, OTHER]
PLAIN = ISSA(chaos=False, levy=False, weight=False, opposition=False)


def search(optimiser, runs, **budget):
    """Independent runs on the sphere."""
    return minimise(optimiser, sphere, LOW, HIGH, range(runs), **budget)


@pytest.mark.parametrize("scale", [1.0, 1e3])
@pytest.mark.parametrize("centre", [[0.3, 1.7, 3.2, 2.0], [0.05, 0.05, 3.95, 0.05]])
def test_pso_finds_the_centre_of_every_ellipsoid(scale, centre):
    axes = scale ** (np.arange(4) / 3)
    result = minimise(
        PSO(),
        lambda x: (axes * (x - centre) ** 2).sum(-1),
        [0] * 4,
        [4] * 4,
        range(20),
        iterations=300,
    )
    np.testing.assert_allclose(result.position, np.tile(centre, (20, 1)), atol=1e-5)


@pytest.mark.parametrize("optimiser", [SSA(), ISSA(), PRINTED, OTHER])
def test_sparrows_come_close_to_the_centre_of_a_sphere(optimiser):
    result = search(optimiser, 20, iterations=400)
    assert np.median(result.fitness) < 1e-3


@pytest.mark.parametrize("optimiser", ALL)
def test_a_run_gives_the_same_bits_alone_and_among_others(optimiser):
    together = search(optimiser, 12, iterations=120)
    for seed in (0, 7, 11):
        alone = minimise(optimiser, sphere, LOW, HIGH, [seed], iterations=120)
        assert (alone.position[0] == together.position[seed]).all()
        np.testing.assert_array_equal(alone.histories[0], together.histories[seed])


def test_a_run_gives_the_same_bits_in_another_process():
    here = [digest(search(o, 5, iterations=120)) for o in ALL]
    there = said_elsewhere(
        "from tests.planners.test_swarm import *",
        "for o in ALL:",
        "    print(digest(search(o, 5, iterations=120)))",
    )
    assert there.split() == here


def test_different_seeds_give_different_runs():
    result = minimise(SSA(), sphere, LOW, HIGH, [*range(9), SeedSequence(99)], iterations=3)
    assert len(np.unique(result.fitness)) == 10


def test_issa_with_everything_off_is_ssa():
    assert digest(search(PLAIN, 4, iterations=150)) == digest(search(SSA(), 4, iterations=150))


@pytest.mark.parametrize("change", ["chaos", "levy", "weight", "opposition"])
def test_each_change_of_issa_matters(change):
    changed = ISSA(**{name: name == change for name in ("chaos", "levy", "weight", "opposition")})
    runs = [search(o, 4, iterations=20) for o in (PLAIN, changed)]
    assert (runs[0].fitness != runs[1].fitness).any()


@pytest.mark.parametrize(
    ("optimiser", "each"),
    [(PSO(), 30), (SSA(), 33), (ISSA(), 36), (PLAIN, 33), (SSA(vigilantes=0.2), 36), (PSO(9), 9)],
)
@pytest.mark.parametrize("iterations", [0, 1, 7])
def test_evaluations_are_what_was_asked_of_the_objective(optimiser, each, iterations):
    objective = Recorded()
    result = minimise(optimiser, objective, LOW, HIGH, range(3), iterations=iterations)
    counted = sum(f.shape[1] for f in objective.f)
    assert result.evaluations == counted == optimiser.population + iterations * each
    assert result.iterations == iterations


@pytest.mark.parametrize("optimiser", ALL)
@pytest.mark.parametrize("budget", [1, 29, 30, 31, 37, 61, 64, 100, 501])
def test_a_budget_of_evaluations_is_spent_exactly(optimiser, budget):
    objective = Recorded()
    result = minimise(optimiser, objective, LOW, HIGH, range(3), evaluations=budget)
    assert result.evaluations == sum(f.shape[1] for f in objective.f) == budget
    assert result.histories[0][-1, 0] == budget


@pytest.mark.parametrize("optimiser", [PSO(), SSA(), ISSA()])
def test_both_kinds_of_budget_are_one(optimiser):
    evaluations = 30 + 20 * optimiser.evaluations_per_iteration
    by_evaluations = search(optimiser, 3, evaluations=evaluations)
    by_iterations = search(optimiser, 3, iterations=20)
    assert digest(by_evaluations) == digest(by_iterations)
    one_more = search(optimiser, 3, evaluations=evaluations + 1)
    assert (by_evaluations.iterations, one_more.iterations) == (20, 21)


@pytest.mark.parametrize("optimiser", ALL)
@pytest.mark.parametrize("instead", [np.inf, 0.0])
def test_what_is_not_below_its_incumbent_is_never_looked_at(optimiser, instead):
    """Any value at or above the incumbent stands for such a fitness: the very same search."""

    def blurred(x, incumbent):
        exact = sphere(x)
        if incumbent is None:
            return exact
        return np.where(exact < incumbent, exact, incumbent + instead)

    compared = minimise(optimiser, Compared(blurred), LOW, HIGH, range(4), iterations=100)
    assert digest(compared) == digest(search(optimiser, 4, iterations=100))


@pytest.mark.parametrize("optimiser", ALL)
def test_history_and_best_are_those_of_the_recorded_candidates(optimiser):
    objective = Recorded()
    result = minimise(optimiser, objective, LOW, HIGH, range(5), iterations=60)
    x = np.concatenate(objective.x, axis=1)
    f = np.concatenate(objective.f, axis=1)
    for run, history in enumerate(result.histories):
        spent, best = history.T
        np.testing.assert_array_equal(best, np.minimum.accumulate(f[run])[spent.astype(int) - 1])
        assert (np.diff(spent) > 0).all()
        assert (np.diff(best[:-1]) < 0).all()
        assert best[-1] == result.fitness[run] == f[run].min()
        improvements = 1 + np.sum(np.diff(np.minimum.accumulate(f[run])) < 0)
        assert len(history) in (improvements, improvements + 1)
        assert (result.position[run] == x[run, f[run].argmin()]).all()


@pytest.mark.parametrize(
    "optimiser", [*ALL, PSO(rebound=-1.0), SSA(eq41="printed", boundary="reflect")]
)
def test_every_candidate_is_in_its_runs_own_box(optimiser):
    low = np.array([[0, 0, 0], [-3, 1e-3, 5], [1, 1, 1.0]])
    high = low + np.array([[4, 4, 4], [1, 1e-2, 1e3], [1e-6, 1, 1e6]])
    objective = Recorded()
    minimise(optimiser, objective, low, high, range(3), iterations=150)
    x = np.concatenate(objective.x, axis=1)
    assert np.isfinite(x).all()
    assert (x >= low[:, None]).all()
    assert (x <= high[:, None]).all()


def test_reflection_mirrors_as_often_as_it_takes():
    x = np.array([-0.25, 0.4, 1.25, 2.5, -7.25, np.inf])[None, :, None]
    mirrored = Box.of([0.0], [1.0], 1).reflect(x)[0, :, 0]
    np.testing.assert_allclose(mirrored, [0.25, 0.4, 0.75, 0.5, 0.75, np.nan])


class FirstIteration:
    """Candidates of SSA's first iteration, phase by phase, and the random numbers behind them.

    The flock is already ranked, and every candidate is refused.
    """

    def __init__(self, ssa: SSA, runs: int, t_max: int = 50) -> None:
        box = Box.of([-1e9] * 3, [1e9] * 3, runs)
        self.drawn = Streams(range(runs))
        self.drawn.uniform(30, 3)
        search = ssa.search(box, Streams(range(runs)), t_max)
        self.x = next(search)
        self.x[:] = np.random.default_rng(5).uniform(0, 4, self.x.shape)
        self.f = np.tile(1 + np.arange(30) / 100, (runs, 1))
        worse = np.full_like(self.f, 9.0)
        self.discovered = search.send(self.f).x
        self.followed = search.send(worse[:, :6]).x
        self.watched = search.send(worse[:, 6:]).x


def test_equation_39_sparrow_by_sparrow():
    first = FirstIteration(SSA(), runs=4)
    r2 = first.drawn.uniform(1, 1)[:, 0, 0]
    alpha = 1 - first.drawn.uniform(6)
    q = first.drawn.normal(6)
    for run, i in np.ndindex(4, 6):
        x = first.x[run, i]
        calm = x * np.exp(-(i + 1) / (alpha[run, i] * 50))
        alarmed = x + q[run, i] * np.ones(3)
        expected = calm if r2[run] < 0.8 else alarmed
        np.testing.assert_allclose(first.discovered[run, i], expected, rtol=1e-12)


def test_equation_40_sparrow_by_sparrow():
    first = FirstIteration(SSA(), runs=4)
    first.drawn.uniform(7)
    first.drawn.normal(6)
    q = first.drawn.normal(24)
    coin = first.drawn.uniform(24, 3)
    for run, row in np.ndindex(4, 24):
        x = first.x[run, 6 + row]
        best = first.x[run, 0]
        worst = first.x[run, -1]
        i = 7 + row
        A = np.where(coin[run, row] < 0.5, -1.0, 1.0)[None]
        step = np.abs(x - best)[None] @ np.linalg.pinv(A) @ np.ones((1, 3))
        expected = best + step[0]
        if i > 15:
            expected = q[run, row] * np.exp((worst - x) / i**2)
        np.testing.assert_allclose(first.followed[run, row], expected, rtol=1e-9, atol=1e-12)


def test_equation_41_sparrow_by_sparrow():
    first = FirstIteration(SSA(watch="first"), runs=4)
    first.drawn.uniform(7)
    first.drawn.normal(30)
    first.drawn.uniform(24, 3)
    beta = first.drawn.normal(3, 3)
    k = 2 * first.drawn.uniform(3) - 1
    for run, row in np.ndindex(4, 3):
        x = first.x[run, row]
        best = first.x[run, 0]
        worst = first.x[run, -1]
        expected = best + beta[run, row] * np.abs(x - best)
        if row == 0:
            fall = first.f[run, 0] - first.f[run, -1] + 1e-50
            expected = x + k[run, 0] * np.abs(x - worst) / fall
        np.testing.assert_allclose(first.watched[run, row], expected, rtol=1e-9)


def test_vigilantes_are_all_different_and_any_sparrow_can_be_one():
    first = FirstIteration(SSA(vigilantes=0.5), runs=50)
    first.drawn.uniform(7)
    first.drawn.normal(30)
    first.drawn.uniform(24, 3)
    drawn = first.drawn.uniform(30).argsort(axis=1)[:, :15]
    assert first.watched.shape == (50, 15, 3)
    assert len(np.unique(drawn)) == 30


@pytest.mark.parametrize("reading", ["intended", "printed"])
@pytest.mark.parametrize("a", [0.0, 0.5, 0.9, 1.0])
def test_chaotic_map_stays_in_the_unit_square(reading, a):
    x, y = np.random.default_rng(0).random((2, 1000))
    for _ in range(100):
        x, y = chaotic_map(x, y, a, reading)
        assert min(x.min(), y.min()) > -1e-12
        assert max(x.max(), y.max()) <= 1


def test_chaotic_map_at_points_where_it_is_known():
    quarter = 4 * 0.9 * 0.25 * 0.75 + 0.1 * np.sin(pi / 2)
    x, y = chaotic_map(np.array([0.25, 0.5]), np.array([0.5, 0.0]), 0.9)
    np.testing.assert_allclose(x, [np.sin(pi * quarter), np.sin(0.9 * pi)])
    np.testing.assert_allclose(y[1], np.sin(pi * 0.1 * np.sin(pi * np.sin(0.9 * pi))))
    x, y = chaotic_map(np.array([0.5]), np.array([0.5]), 0.9, "printed")
    np.testing.assert_allclose(x, np.sin(pi * 0.9 + 0.1))
    np.testing.assert_allclose(y, np.sin(pi * 0.9 + 0.1 * np.sin(pi * x**2)))


def test_the_chaotic_flock_covers_the_box():
    objective = Recorded()
    minimise(ISSA(), objective, LOW, HIGH, range(200), iterations=0)
    cells = np.floor(objective.x[0] / 4 * 8).clip(0, 7).astype(int)
    assert [len(np.unique(cells[..., d])) for d in range(3)] == [8, 8, 8]
    assert len(np.unique(cells.reshape(-1, 3) @ [64, 8, 1])) > 400  # of 512


@pytest.mark.parametrize("beta", [0.5, 1.0, 1.5, 1.9])
def test_levy_scale_is_equation_45(beta):
    top = gamma(1 + beta) * np.sin(pi * beta / 2)
    expected = (top / (gamma((1 + beta) / 2) * beta * 2 ** ((beta - 1) / 2))) ** (1 / beta)
    assert levy_scale(beta) == pytest.approx(expected, rel=1e-14)
    assert levy_scale(1.5) == pytest.approx(0.6965745, abs=1e-7)  # Mantegna's table


def test_the_weight_falls_from_one_end_to_the_other():
    assert falling_weight(0.0, 0.9, 0.4) == 0.9
    assert falling_weight(1.0, 0.9, 0.4) == pytest.approx(0.4, abs=1e-15)
    assert falling_weight(0.5, 0.9, 0.4) == pytest.approx(0.775, abs=1e-15)


def test_equation_50_in_both_readings():
    assert control(1, 4) == 0.75
    assert control(4, 4) == 0.0
    assert control(2, 4, "printed") == 3.5**2
    assert [np.isinf(control(t, 1000, "printed")) for t in (102, 103)] == [False, True]


@pytest.mark.parametrize(
    ("make", "option"),
    [
        (lambda: PSO(population=1), "population"),
        (lambda: PSO(inertia=-1.0), "inertia"),
        (lambda: PSO(social=float("nan")), "social"),
        (lambda: PSO(clamp=0.0), "clamp"),
        (lambda: PSO(rebound=2.0), "rebound"),
        (lambda: SSA(discoverers=1.0), "discoverers"),
        (lambda: SSA(vigilantes=0.01), "vigilantes"),
        (lambda: SSA(vigilantes=float("nan")), "vigilantes"),
        (lambda: SSA(safety=1.5), "safety"),
        (lambda: SSA(acceptance="sometimes"), "acceptance"),
        (lambda: SSA(boundary="wrap"), "boundary"),
        (lambda: ISSA(eq43="squared"), "eq43"),
        (lambda: ISSA(chaos_a=1.1), "chaos_a"),
        (lambda: ISSA(levy_exponent=2.0), "levy_exponent"),
        (lambda: ISSA(weight_min=-0.1), "weight_min"),
        (lambda: minimise(PSO(), sphere, LOW, LOW, [0]), "bounds"),
        (lambda: minimise(PSO(), sphere, LOW, HIGH, []), "seeds"),
        (lambda: minimise(PSO(), sphere, LOW, HIGH, [0], evaluations=0), "evaluations"),
        (lambda: minimise(PSO(), sphere, LOW, HIGH, [0], iterations=-1), "iterations"),
    ],
)
def test_a_bad_option_is_named(make, option):
    with pytest.raises(InvalidInput, match=f"^{option} .*expected"):
        make()
