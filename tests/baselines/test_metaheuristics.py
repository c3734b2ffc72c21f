"""Optimisers of other libraries by name: their budget, their failures, and what they find.

Whatever a library does is played by a small optimiser of this file; the libraries themselves run
where they are installed.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import pytest

import trajopt
from baselines.metaheuristics import Mealpy, Metaheuristic, Nevergrad, Pymoo
from trajopt import InvalidInput, Status, UnknownName, verify
from trajopt.cli import main
from trajopt.planners.registry import load
from trajopt.planners.testing import check_planner

SIX_AXIS = trajopt.problem("six-axis")
# `prove --family spline353` proves that no 3-5-3 of six-axis is faster.
BEST_353 = 4.310377
NAMES = {
    "mealpy": ["OriginalGWO", "OriginalSHADE", "OriginalPSO", "Simple_CMA_ES"],
    "pymoo": ["PSO", "CMAES", "NelderMead", "DE"],
    "nevergrad": ["CMA", "DE", "OnePlusOne", "NelderMead"],
}
INSTALLED = [library for library in NAMES if find_spec(library) is not None]
SPECS = [f"{library}:name={name}" for library in INSTALLED for name in NAMES[library]]


@dataclass(frozen=True)
class Played(Metaheuristic):
    """Plays an optimiser that behaves in a way of this test's."""

    name: str = "uniform"
    requires = ("numpy",)

    @staticmethod
    def optimisers():
        return {name: own for name, own in vars(Played).items() if name.startswith("play_")}

    def _check_name(self):
        pass

    def search(self, counted, seed):
        rng = np.random.default_rng(seed)
        box = counted.fitness
        getattr(self, f"play_{self.name}")(counted, lambda: rng.uniform(box.low, box.high))

    def play_uniform(self, counted, draw):
        while True:
            counted.one(draw())

    def play_generations(self, counted, draw):
        while True:
            counted.many(np.array([draw() for _ in range(7)]))

    def play_early(self, counted, draw):
        for _ in range(11):
            counted.one(draw())

    def play_lazy(self, counted, draw):
        """Ends without an evaluation."""

    def play_catching(self, counted, draw):
        for _ in range(1000):
            try:
                counted.one(draw())
            except Exception:
                raise AssertionError("the end of the budget was caught") from None

    def play_raising(self, counted, draw):
        counted.one(draw())
        raise ZeroDivisionError("division by zero")

    def play_slow(self, counted, draw):
        while True:
            sum(range(100_000))
            counted.one(draw())

    def play_hanging(self, counted, draw):
        counted.one(draw())
        while True:
            try:
                sum(range(1000))
            except BaseException:  # a library that catches everything, once
                break
        while True:
            sum(range(1000))

    def play_wild(self, counted, draw):
        for odd in (np.nan, [np.inf, 1.0, 1.0], "abc", [1.0], None, draw() * 1e9, -draw()):
            value = counted.one(odd)
            assert np.isfinite(value)
            assert value > counted.fitness.ceiling or np.isfinite(np.asarray(odd, float)).all()
        while True:
            counted.one(draw()[None])

    def play_global(self, counted, draw):
        """Draws from the streams that all share, as some do."""
        while True:
            own = [random.random(), np.random.random(), np.random.random()]  # noqa: NPY002
            counted.one(counted.fitness.high * own)


def played(name, **options):
    return Played(**{"evaluations": 100} | options, name=name).solve(SIX_AXIS, seed=3)


@pytest.mark.parametrize("name", ["uniform", "generations", "early", "catching", "wild", "global"])
@pytest.mark.parametrize("budget", [1, 10, 100, 101])
def test_exactly_the_budget_is_spent(name, budget):
    solution = played(name, evaluations=budget)
    assert solution.status is Status.SOLVED, solution.message
    assert solution.evaluations == budget
    assert solution.history[-1, 0] == budget
    assert not solution.history_flaw


def test_the_budget_in_iterations_is_that_of_the_swarms():
    planner = Played(population=10, iterations=4)
    assert planner.solve(SIX_AXIS).evaluations == 50
    assert load("pso:population=10,iterations=4").solve(SIX_AXIS).evaluations == 50


def test_one_that_ends_early_starts_anew_from_another_seed():
    solution = played("early", evaluations=50)
    assert solution.stats["searches"] == 5
    improved = played("uniform", evaluations=11)
    assert solution.trajectory.duration <= improved.trajectory.duration


def test_a_failure_says_what_happened_and_after_how_many_evaluations():
    lazy = played("lazy")
    assert (lazy.status, lazy.trajectory) == (Status.FAILED, None)
    assert lazy.message == "lazy ends without an evaluation, after 0 of 100 evaluations"
    raising = played("raising")
    assert (raising.status, raising.evaluations) == (Status.FAILED, 1)
    assert "ZeroDivisionError: division by zero" in raising.message
    slow = played("slow", cpu_limit=0.02, evaluations=10**6)
    assert slow.status is Status.FAILED
    assert "takes more than 0.02 s of CPU time" in slow.message
    assert 0 < slow.evaluations < 10**6
    hanging = played("hanging", cpu_limit=0.1)
    assert (hanging.status, hanging.evaluations) == (Status.FAILED, 1)
    assert "takes more than 0.1 s of CPU time, after 1 of 100" in hanging.message


def test_the_seed_decides_and_the_global_streams_are_left_alone():
    np.random.seed(7)  # noqa: NPY002
    random.seed(7)
    states = repr(np.random.get_state()), random.getstate()  # noqa: NPY002
    first = played("global")
    assert (repr(np.random.get_state()), random.getstate()) == states  # noqa: NPY002
    np.random.seed(8)  # noqa: NPY002
    assert played("global").trajectory.duration == first.trajectory.duration
    other = Played(name="global", evaluations=100).solve(SIX_AXIS, seed=4)
    assert other.trajectory.duration != first.trajectory.duration


@pytest.mark.parametrize(
    "options",
    [
        {"population": 1},
        {"evaluations": 0},
        {"iterations": -1},
        {"cpu_limit": 0.0},
        {"upper": 0.0},
        {"lower": 1.0},
        {"fitness": "deb"},
    ],
)
def test_bad_options_are_named(options):
    with pytest.raises(InvalidInput, match=next(iter(options))):
        Played(**options)


def test_other_shapes_and_problems():
    solution = played("uniform", shape="5", evaluations=30)
    assert verify(SIX_AXIS, solution.trajectory).feasible or solution.message
    ur5e = trajopt.problem("robots-ur5e-w8")
    assert "exactly 4 waypoints" in Played().unsupported(ur5e)
    of_family = Played(shape="5", evaluations=20, fitness="scaled").solve(ur5e)
    assert verify(ur5e, of_family.trajectory).certified_duration == pytest.approx(
        of_family.trajectory.duration, rel=1e-8
    )


# --- the libraries ---


@pytest.mark.parametrize("spec", SPECS)
def test_a_library_spends_the_budget_and_beats_no_proof(spec):
    planner = load(f"{spec},evaluations=300")
    first, second = planner.solve(SIX_AXIS, seed=5), planner.solve(SIX_AXIS, seed=5)
    assert first.status is Status.SOLVED, first.message
    assert first.evaluations == 300
    assert not first.history_flaw
    assert first.trajectory.duration == second.trajectory.duration
    certified = verify(SIX_AXIS, first.trajectory).certified_duration
    assert certified >= BEST_353


@pytest.mark.parametrize("library", INSTALLED)
def test_a_library_keeps_the_contract(library):
    check_planner(load(f"{library}:evaluations=60"))


@pytest.mark.parametrize("library", INSTALLED)
def test_a_wrong_name_names_the_nearest(library, capsys):
    right = NAMES[library][0]
    with pytest.raises(InvalidInput, match=f"did you mean '{right}'"):
        load(f"{library}:name={right}x")
    with pytest.raises(InvalidInput, match=f"trajopt list {library}"):
        load(f"{library}:name=qqqqqq")
    with pytest.raises(SystemExit) as ended:
        main(["plan", "six-axis", "--planner", f"{library}:name={right}x"])
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert right in printed.out + printed.err


@pytest.mark.parametrize("library", INSTALLED)
def test_list_says_what_is_there(library, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["list", library])
    assert not ended.value.code
    printed = capsys.readouterr().out
    names = load(library).choices()["name"]
    assert set(NAMES[library]) <= set(names)
    for name in names:
        assert name in printed
    with pytest.raises((SystemExit, UnknownName)) as ended:
        main(["list", f"{library}x"])
    assert ended.value.code == 2


@pytest.mark.skipif("pymoo" not in INSTALLED, reason="pymoo is not installed")
def test_optimisers_of_bits_are_left_out():
    """pymoo's `BGA` draws its variables from {0, 1}: eight candidates of three segment times."""
    names = load("pymoo").choices()["name"]
    assert {"GA", "BRKGA", "NicheGA"} <= set(names)
    assert "BGA" not in names


def test_the_extras_are_those_that_the_planners_name():
    for planner in (Mealpy(), Pymoo(), Nevergrad()):
        assert planner.requires == (planner.extra,)


@pytest.mark.skipif("mealpy" not in INSTALLED, reason="mealpy is not installed")
def test_one_that_allows_no_such_population_has_its_own():
    """Cross-entropy takes the best 20 of its population by default, so that 30 are too few."""
    solution = load("mealpy:name=OriginalCEM,evaluations=300").solve(SIX_AXIS)
    assert (solution.status, solution.evaluations) == (Status.SOLVED, 300)
    refused = load("mealpy:name=OriginalBCO,evaluations=300").solve(SIX_AXIS)
    assert refused.status is Status.FAILED  # its default is outside of its own range
    assert "n_chemotaxis" in refused.message
