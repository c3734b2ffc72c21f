"""The races in small: numbers that can be worked out by hand, and nothing done twice."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial
from math import comb
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from experiments import issa_ablation, swarms
from experiments.common import races
from trajopt import Limits, Problem
from trajopt.core.exceptions import TrajoptError
from trajopt.planners.swarm import SSA
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.analysis import statistics

Array = NDArray[np.float64]

LIMITS = Limits([1.0], [2.0])
PROBLEM = Problem([[0.0], [1.0], [0.5], [2.0]], LIMITS, "one")


def trial(name, problem, curve, **stats):
    """A run as far as a race looks at it: evaluations, and the best duration by then."""
    _, duration = curve[-1]
    return SimpleNamespace(
        planner=name,
        label=name,
        problem=SimpleNamespace(name=problem),
        digest=problem,
        certified_history=np.array(curve, dtype=float),
        certified_duration=duration,
        solution=SimpleNamespace(stats=stats),
    )


def outcome(runs):
    """The outcome of runs by entrant and problem, whose lower bounds are 2 s."""
    items = []
    for name, by_problem in runs.items():
        for problem, curves in by_problem.items():
            items += [trial(name, problem, curve) for curve in curves]
    for problem in {item.digest for item in items}:
        items.append(trial("proof", problem, [[0, 2.0]], lower_bound=2.0, proved_within=1e-6))
    return races.outcome(SimpleNamespace(items=items), list(runs))


def crowd(gaps):
    """The outcome of answers with these gaps, by entrant: `(problems, seeds)`."""
    runs = {}
    for name, table in gaps.items():
        problems = [races.FIRST, *(f"p{number}" for number in range(1, len(table)))]
        curves = [[[[100, 2 * (1 + gap)]] for gap in row] for row in table]
        runs[name] = dict(zip(problems, curves, strict=True))
    return outcome(runs)


def three():
    """Gaps of three entrants on 6 problems, 4 seeds: the second always best, the third worst."""
    base = 0.01 * np.arange(1, 7)[:, None] + 1e-4 * np.arange(4)
    return crowd({"a": base, "b": 0.5 * base, "c": 10 * base})


def test_a_run_below_the_proof_is_an_error():
    with pytest.raises(TrajoptError, match="a is below the proved bound"):
        outcome({"a": {"six-axis": [[[9, 1.0]]]}})


def test_no_answer_is_infinite_and_the_width_of_the_proof_the_smallest_gap():
    curves = [[[9, 2.01]], [[9, np.nan]], [[9, 2.0]]]
    gaps = outcome({"a": {"six-axis": curves}}).runs["gap"]
    assert gaps.tolist() == pytest.approx([0.005, np.inf, 1e-6])


def test_a_race_proves_the_best_spline_and_keeps_its_trials(tmp_path, monkeypatch):
    """One joint, equal limits: the bound is below what a swarm finds, and close to it."""
    monkeypatch.setattr(races, "JOBS", 0)
    planner = SwarmPlanner(evaluations=3000, fitness="scaled")
    for _ in range(2):
        race = races.run({"swarm": planner}, [PROBLEM], 1, tmp_path)
        assert race.proof["width"]["one"] <= 1.1e-6
        assert 1e-6 <= race.runs["gap"][0] < 1e-2
        monkeypatch.setattr(SwarmPlanner, "solve_batch", pytest.fail)
    history = race.histories["swarm"][0]
    bound = race.proof["lower bound s"]["one"]
    certified = bound * (1 + race.runs["gap"][0])
    assert history[-1] * [1, bound] == pytest.approx([3000, certified])


def test_wilcoxon_and_the_chance_of_a_shorter_run_by_hand():
    table = races.against(three(), "a")
    counts = table[["better", "equal", "worse"]].to_numpy()
    assert counts.tolist() == [[6, 0, 0], [0, 0, 6]]
    over_problems = 2 / 2**6
    over_seeds = 2 / comb(8, 4)
    expected = {"p": over_problems, "p (Holm)": 2 * over_problems, "six-axis p": over_seeds}
    for column, value in expected.items():
        np.testing.assert_allclose(table[column], value)
    assert table["shorter"].tolist() == [1.0, 0.0]


def test_summary_by_hand():
    ratios = np.array([1.0, 0.5, 10.0])
    table = races.summary(three())
    np.testing.assert_allclose(table["six-axis median gap (%)"], 1.015 * ratios)
    np.testing.assert_allclose(table["median gap (%)"], 3.515 * ratios)


def test_expected_evaluations_by_hand():
    half = {"six-axis": 2 * [[[50, 2.01], [100, 2.01]]], "other": 2 * [[[100, 3.0]]]}
    always = {problem: [[[10, 2.001], [100, 2.001]]] for problem in half}
    never = {problem: [[[100, np.nan]]] for problem in half}
    table = races.summary(outcome({"half": half, "always": always, "never": never}))
    assert table["success 1 %"].tolist() == [0.5, 1.0, 0.0]
    assert table["evaluations to 1 %"].tolist() == [150.0, 10.0, np.inf]


def test_an_ingredient_is_worth_what_it_multiplies_the_gap_by():
    factors = (0.5, 1.0, 3.0, 0.9)
    worth = dict(zip(issa_ablation.INGREDIENTS, factors, strict=True))
    base = np.array([[0.01, 0.01], [0.07, 0.07]])
    gaps = {}
    for some in issa_ablation.subsets(issa_ablation.INGREDIENTS):
        own = [worth[name] for name in some]
        gaps[issa_ablation.subset(some)] = np.prod(own) * base
    table = issa_ablation.ingredients(crowd(gaps))
    for column in ("alone", "to the others", "overall", "low", "high"):
        assert table[column].tolist() == pytest.approx(factors)


def test_the_variants_are_all_different_and_the_empty_one_is_ssa():
    planners = issa_ablation.entrants(90)
    different = set(planners.values())
    assert len(different) == 16 + 10 + 3
    own = planners["ssa"].solve(PROBLEM, seed=3)
    other = SwarmPlanner(SSA(), evaluations=90).solve(PROBLEM, seed=3)
    np.testing.assert_array_equal(own.history, other.history)
    assert planners["issa"] == SwarmPlanner(evaluations=90)
    budgets = {planner.evaluations for planner in planners.values()}
    assert budgets == {90}


def error(name, frame):
    """Median error of an optimiser on the sphere, its minimum in the middle of a box."""
    cell = ("sphere", frame, 0.5, name)
    (row,) = issa_ablation.biased(cell, 5, 600)
    return float(row["median error"])


def test_only_the_sparrows_care_where_the_origin_is():
    there = error("PSO", "in its middle")
    assert error("PSO", "far away") == pytest.approx(there, rel=1e-3)
    assert error("SSA", "far away") > 1e6 * error("SSA", "in its middle")


def test_the_fitness_is_all_that_the_swarms_pairs_differ_in():
    planners = swarms.entrants(60)
    for name in swarms.OPTIMISERS:
        scaled = planners[f"{name} scaled"]
        assert replace(scaled, fitness="penalty") == planners[f"{name} penalty"]
    paired = itertools.chain(*swarms.pairs())
    assert {*paired, swarms.NLP} == set(planners)


@pytest.mark.parametrize(
    ("experiment", "table"),
    [pytest.param(issa_ablation, "origin", marks=pytest.mark.long), (swarms, "compared")],
)
def test_quick_forms_resume(experiment, table, tmp_path, capsys, monkeypatch):
    # Small where size shows nothing: intervals, boxes and proofs are as many as it takes.
    monkeypatch.setattr(races, "JOBS", 0)
    monkeypatch.setattr(races, "PROOF", "prove:family=spline353,within=1.0")
    monkeypatch.setattr(statistics, "bootstrap", partial(statistics.bootstrap, resamples=99))
    monkeypatch.setattr(issa_ablation, "PLACES", (0.0, 0.5))
    experiment.main(output=tmp_path, quick=True)
    summary = pd.read_csv(tmp_path / "summary.csv")
    gaps = summary["median gap (%)"].dropna()
    assert (gaps > 0).all()
    written = {file.name for file in tmp_path.iterdir()}
    assert {f"{table}.csv", f"{table}.md", "summary.md", "results.h5"} <= written
    first = capsys.readouterr().out
    monkeypatch.setattr(issa_ablation, "biased", lambda *_: pytest.fail("done twice"))
    experiment.main(output=tmp_path, quick=True)
    assert capsys.readouterr().out == first
