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
from trajopt.planners.swarm.optimiser import Draw
from trajopt.planners.swarm.ssa import Flock

PRINTED = ISSA(eq41="printed", eq43="printed", eq49="printed", eq50="printed")
OTHER = ISSA(
    acceptance="always", boundary="reflect", sorting="phase", watch="first", step="elementwise"
)
ALL = [PSO(), SSA(), ISSA(), PRINTED, OTHER]
PLAIN = ISSA(chaos=False, levy=False, weight=False, opposition=False)


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
    result = minimise(optimiser, sphere, LOW, HIGH, range(20), iterations=300)
    assert np.median(result.fitness) < 1e-3


@pytest.mark.parametrize("optimiser", ALL)
def test_a_run_gives_the_same_bits_alone_and_among_others(optimiser):
    together = minimise(optimiser, sphere, LOW, HIGH, range(12), iterations=120)
    for seed in (0, 7, 11):
        alone = minimise(optimiser, sphere, LOW, HIGH, [seed], iterations=120)
        assert (alone.position[0] == together.position[seed]).all()
        np.testing.assert_array_equal(alone.histories[0], together.histories[seed])


def test_a_run_gives_the_same_bits_in_another_process():
    here = [digest(minimise(o, sphere, LOW, HIGH, range(5), iterations=120)) for o in ALL]
    there = said_elsewhere(
        "from tests.planners.test_swarm import *",
        "for o in ALL:",
        "    print(digest(minimise(o, sphere, LOW, HIGH, range(5), iterations=120)))",
    )
    assert there.split() == here


def test_different_seeds_give_different_runs():
    result = minimise(SSA(), sphere, LOW, HIGH, [*range(9), SeedSequence(99)], iterations=3)
    assert len(np.unique(result.fitness)) == 10


def test_issa_with_everything_off_is_ssa():
    assert digest(minimise(PLAIN, sphere, LOW, HIGH, range(4), iterations=150)) == digest(
        minimise(SSA(), sphere, LOW, HIGH, range(4), iterations=150)
    )


@pytest.mark.parametrize("change", ["chaos", "levy", "weight", "opposition"])
def test_each_change_of_issa_matters(change):
    changed = ISSA(**{name: name == change for name in ("chaos", "levy", "weight", "opposition")})
    runs = [minimise(o, sphere, LOW, HIGH, range(4), iterations=20) for o in (PLAIN, changed)]
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
    by_evaluations = minimise(optimiser, sphere, LOW, HIGH, range(3), evaluations=evaluations)
    by_iterations = minimise(optimiser, sphere, LOW, HIGH, range(3), iterations=20)
    assert digest(by_evaluations) == digest(by_iterations)
    one_more = minimise(optimiser, sphere, LOW, HIGH, range(3), evaluations=evaluations + 1)
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
    assert digest(compared) == digest(
        minimise(optimiser, sphere, LOW, HIGH, range(4), iterations=100)
    )


@pytest.mark.parametrize("optimiser", ALL)
def test_history_and_best_are_those_of_the_recorded_candidates(optimiser):
    objective = Recorded()
    result = minimise(optimiser, objective, LOW, HIGH, range(5), iterations=60)
    x, f = np.concatenate(objective.x, axis=1), np.concatenate(objective.f, axis=1)
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


@pytest.mark.parametrize("count", [0, 1, 50, 101])
def test_rounds_have_the_numbers_of_single_draws(count):
    draws = [Draw("random", 7), Draw("standard_normal", 4), Draw("random", 1)]
    one_by_one = Streams(range(3))
    rounds = list(Streams(range(3)).rounds(count, draws))
    assert len(rounds) == count
    for even, normal, last in rounds:
        np.testing.assert_array_equal(even, one_by_one.uniform(7))
        np.testing.assert_array_equal(normal, one_by_one.normal(4))
        np.testing.assert_array_equal(last, one_by_one.uniform(1))


def test_reflection_mirrors_as_often_as_it_takes():
    x = np.array([-0.25, 0.4, 1.25, 2.5, -7.25, np.inf])[None, :, None]
    mirrored = Box.of([0.0], [1.0], 1).reflect(x)[0, :, 0]
    np.testing.assert_allclose(mirrored, [0.25, 0.4, 0.75, 0.5, 0.75, np.nan])


def test_equations_39_to_41_sparrow_by_sparrow():
    rng, ssa, runs, t_max = np.random.default_rng(5), SSA(), 4, 50
    box = Box.of(LOW, HIGH, runs)
    flock = Flock(box, Streams(range(runs)), t_max)
    flock.t = 3
    flock.settle(rng.uniform(0, 4, (runs, 30, 3)), rng.uniform(1, 2, (runs, 30)))
    draw = Streams(range(runs))
    chance = next(ssa._chances(flock.streams, 3, 1))
    _, (discovered,) = ssa._discover(flock, chance)
    r2, alpha, q = draw.uniform(1, 1), 1 - draw.uniform(6, 1), draw.normal(6, 1)
    for run, i in np.ndindex(runs, 6):
        x = flock.x[run, i]
        calm = x * np.exp(-(i + 1) / (alpha[run, i, 0] * t_max))
        expected = calm if r2[run, 0, 0] < 0.8 else x + q[run, i, 0] * np.ones(3)
        np.testing.assert_allclose(discovered[run, i], expected, rtol=1e-12)
    slots, (followed,) = ssa._follow(flock, chance)
    q, u = draw.normal(24, 1), draw.uniform(24, 3)
    for run, row in np.ndindex(runs, 24):
        x, i, best = flock.x[run, 6 + row], 7 + row, flock.x[run, 0]
        a = np.where(u[run, row] < 0.5, -1.0, 1.0)[None]  # A is one row; A⁺ its pseudo-inverse
        near = best + (np.abs(x - best)[None] @ np.linalg.pinv(a) @ np.ones((1, 3)))[0]
        far = q[run, row, 0] * np.exp((flock.x[run, -1] - x) / i**2)
        np.testing.assert_allclose(
            followed[run, row], far if i > 15 else near, rtol=1e-9, atol=1e-12
        )
    slots, (watched,) = ssa._watch(flock, chance)
    draw.uniform(30)
    beta, k = draw.normal(3, 3), 2 * draw.uniform(3, 1) - 1
    for run, row in np.ndindex(runs, 3):
        s = slots[run, row]
        x, f, best, worst = flock.x[run, s], flock.f[run, s], flock.x[run, 0], flock.x[run, -1]
        away = x + k[run, row, 0] * np.abs(x - worst) / (f - flock.f[run, -1] + 1e-50)
        home = best + beta[run, row] * np.abs(x - best)
        np.testing.assert_allclose(watched[run, row], away if s == 0 else home, rtol=1e-9)


def test_vigilantes_are_all_different_and_any_sparrow_can_be_one():
    flock = Flock(Box.of(LOW, HIGH, 50), Streams(range(50)), 9)
    flock.settle(
        np.random.default_rng(1).uniform(0, 4, (50, 30, 3)), np.tile(np.arange(30.0), (50, 1))
    )
    ssa = SSA(vigilantes=0.5)
    slots, _ = ssa._watch(flock, next(ssa._chances(flock.streams, 3, 1)))
    assert all(len(set(row)) == 15 for row in slots)
    assert len(np.unique(slots)) == 30


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
