"""Optimisers as planners: from `f(x)` to the table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import trajopt
from trajopt import InvalidInput, Status, TrajoptError
from trajopt.benchmark.trial import Configuration, trials_of
from trajopt.planners.registry import load
from trajopt.planners.testing import check_planner

SIX_AXIS = trajopt.problem("six-axis")


def walk(f, seed, step=0.2):
    """Go where it is better."""
    rng = np.random.default_rng(seed)
    best, value = f.high / 2, f(f.high / 2)
    while f.left > 1:
        tried = best + step * rng.standard_normal(f.variables)
        now = f(tried)
        if now < value:
            best, value = tried, now
    return best


class Scatter:
    """Candidates from everywhere, ten at a time."""

    def __init__(self, low, high, seed):
        self.rng, self.box = np.random.default_rng(seed), (low, high)
        self.told = []

    def ask(self):
        return self.rng.uniform(*self.box, (10, len(self.box[0])))

    def tell(self, candidates, values):
        assert candidates.shape == (10, 3)
        assert values.shape == (10,)


@pytest.mark.parametrize("search", [walk, Scatter])
def test_a_search_is_a_planner_whose_objective_counts_and_remembers(search):
    planner = trajopt.optimiser(search, evaluations=500)
    assert planner.stochastic
    first, second = trials_of(planner, SIX_AXIS, [0, 1])
    for trial in (first, second):
        assert trial.status is Status.SOLVED
        assert trial.solution.evaluations == 500
        assert trial.solution.history[-1].tolist() == pytest.approx([500, trial.claimed_duration])
        assert trial.certified_duration > 4.3103  # no 3-5-3 is faster, proved
    assert first.claimed_duration != second.claimed_duration
    again, *_ = trials_of(planner, SIX_AXIS, [0])
    assert again.claimed_duration == first.claimed_duration


def test_it_keeps_the_contract():
    check_planner(trajopt.optimiser(walk, evaluations=50))


def test_what_it_returns_counts_and_what_it_evaluated_is_enough():
    """By hand: times 1.2 as long as the best; the better of two candidates."""
    times = load("spline353-nlp").solve(SIX_AXIS).stats["segment_times"]

    def returns(f):
        return 1.2 * np.asarray(times)

    def evaluates(f):
        f(np.array([1.3 * np.asarray(times), 1.2 * np.asarray(times)]))

    for search, spent in ((returns, 1), (evaluates, 2)):
        planner = trajopt.optimiser(search)
        assert not planner.stochastic
        found = planner.solve(SIX_AXIS)
        assert found.evaluations == spent
        assert found.trajectory.duration == pytest.approx(1.2 * np.sum(times), rel=1e-9)

    assert trajopt.optimiser(lambda f: None).solve(SIX_AXIS).status is Status.FAILED


def test_options_are_keywords_and_a_changed_search_is_another_planner():
    planner = trajopt.optimiser(walk, evaluations=40)
    assert planner.options() == {
        "evaluations": 40,
        "shape": "3-5-3",
        "fitness": "penalty",
        "step": 0.2,
    }
    assert Configuration.of(planner).entrant.label == "walk"
    other = replace(planner, step=0.4)
    assert Configuration.of(other).entrant.label == "walk:step=0.4"
    assert other.solve(SIX_AXIS).trajectory.duration != planner.solve(SIX_AXIS).trajectory.duration

    def named(factor):
        def search(f):
            return factor * f.high

        return trajopt.optimiser(search)

    codes = {Configuration.of(named(factor)).entrant.code.digest for factor in (0.5, 0.25)}
    assert len(codes) == 2


def test_a_file_s_optimiser_goes_by_its_name(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(
        "import trajopt\n"
        "def search(f, seed, step: float = 0.1):\n    return f.high * (0.5 + seed / 100)\n"
        "firefly = trajopt.optimiser(search)\n"
        "def bare(f, seed=0):\n    return f.high\n"
    )
    planners = [f"{file}:firefly:evaluations=7", "pso:iterations=2", trajopt.optimiser(Scatter)]
    results = trajopt.compare(["six-axis"], planners, tmp_path / "kept", seeds=2, jobs=1)
    solved = results.planners()["solved"]
    assert solved.to_dict() == {"firefly:evaluations=7": 2, "pso:iterations=2": 2, "Scatter": 2}
    with pytest.raises(TrajoptError, match=r"bare = trajopt\.optimiser\(bare\)"):
        load(f"{file}:bare")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: trajopt.optimiser(walk, budget=9), "evaluations=…, the number of candidates"),
        (lambda: trajopt.optimiser(walk, pop_size=9), "a keyword of the search"),
        (lambda: trajopt.optimiser(3), "a function"),
        (lambda: trajopt.optimiser(dict), "ask"),
        (lambda: trajopt.optimiser(lambda f, x: x), "a keyword with a default"),
        (lambda: trajopt.optimiser(walk, fitness="best"), "'penalty' or 'scaled'"),
        (lambda: load("pso:pop_size=40"), "population=40, as it is called here"),
        (lambda: load("pso:epoch=40"), "iterations=40, as it is called here"),
        (lambda: load("issa:budget=40"), "evaluations"),
        (lambda: load("pso:nonsense=40"), "one of: "),
    ],
)
def test_what_is_wrong_is_answered_with_our_word(call, said):
    with pytest.raises(InvalidInput, match=said):
        call()


def test_the_stored_table_ranks_a_search():
    from experiments import arena

    stored = Path(arena.__file__).parent / "stored" / "arena.csv"
    rows = [line for line in stored.read_text().splitlines() if not line.startswith(("#", "opti"))]
    assert arena.placed(0.0, 1000) == (1, len(rows) + 1)
    rank, of = arena.placed(0.002, 1000)  # 0.2 %: behind all whose median is below
    assert (rank, of) == (1 + sum(arena.stored_gaps(1000) < 0.002), len(rows) + 1)
    assert arena.placed(0.02, 1000)[0] > rank
    assert arena.placed(0.0, 777) is None
