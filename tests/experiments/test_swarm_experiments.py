"""The races in small: numbers that can be worked out by hand, and nothing done twice."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from experiments import issa_ablation, swarms
from experiments.common import races
from trajopt import Limits, Problem, Solution, Status, verify
from trajopt.core.exceptions import TrajoptError
from trajopt.planners import spline353
from trajopt.planners.swarm import SSA
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.analysis import statistics

Array = NDArray[np.float64]

LIMITS = Limits([1.0], [2.0])
PROBLEM = Problem([[0.0], [1.0], [0.5], [2.0]], LIMITS, "one")


def full_speed(problem):
    """A bound without a solver: every segment at full speed (the limits are per joint)."""
    speed = np.abs(problem.limits.velocity).max(axis=1)
    ways = np.abs(problem.displacements)
    slowest = (ways / speed).max(axis=1)
    return [{"lower_bound": slowest.sum(), "width": 1e-6}]


def outcome(names, gaps, hits=None):
    problems = [f"p{number}" for number in range(len(gaps))]
    proof = pd.DataFrame({"problem": problems, "width": 1e-6})
    if hits is None:
        hits = np.full((3, *gaps.shape), np.nan)
    return races.Outcome(names, proof, gaps, hits, 100)


def crowd():
    """Gaps of three entrants on 6 problems, 4 seeds: the second always best, the third worst."""
    of_problems = 0.01 * np.arange(1, 7)
    of_seeds = 1e-4 * np.arange(4)
    base = of_problems[:, None] + of_seeds
    return np.stack([base, 0.5 * base, 100 * base], axis=1)


def test_a_run_below_the_proof_is_an_error(tmp_path, monkeypatch):
    proof = {"lower_bound": 1e3, "width": 1e-6}
    monkeypatch.setattr(races, "proved", lambda problem: [proof])
    planner = SwarmPlanner(evaluations=300)
    with pytest.raises(TrajoptError, match="below the proved bound"):
        races.run({"a": planner}, [PROBLEM], 2, 300, tmp_path)


def test_gaps_are_of_certified_durations_and_no_answer_is_infinite():
    slowly = np.array([9.0, 9.0, 9.0])
    too_fast = np.array([0.1, 0.1, 0.1])
    slow = spline353.trajectory(PROBLEM, slowly)
    fast = spline353.trajectory(PROBLEM, too_fast)
    certified = verify(PROBLEM, fast).certified_duration
    assert certified is not None
    answers = [
        (slow, [[5, 28.0], [9, 27.0]]),
        (fast, [[9, 0.3]]),
        (slow, [[9, np.nan]]),
    ]
    found = []
    for trajectory, curve in answers:
        solution = Solution(Status.SOLVED, trajectory, history=np.array(curve))
        found.append(solution)
    planner: Any = SimpleNamespace(solve_batch=lambda problem, seeds: found)
    bound = 27 / 1.005
    rows = races.measured(PROBLEM, planner, 3, bound)
    gaps = [0.005, certified / bound - 1, np.inf]
    assert rows["gap"].tolist() == pytest.approx(gaps)
    hits = [9, 9, np.nan]
    assert rows["1 %"].tolist() == pytest.approx(hits, nan_ok=True)
    assert rows["0.1 %"].isna().tolist() == [True, False, True]


def test_the_proof_holds_the_optimum():
    """One joint, equal limits: the bound is below what a swarm finds, and close to it."""
    planner = SwarmPlanner(evaluations=3000, fitness="scaled")
    (proof,) = races.proved(PROBLEM)
    history = planner.solve(PROBLEM).history
    assert proof["status"] == "proved"
    assert 0 <= proof["width"] <= 1.1e-6
    rows = races.measured(PROBLEM, planner, 1, 1.0)
    (duration,) = rows["gap"] + 1
    assert history is not None
    assert duration == pytest.approx(history[-1, 1])
    assert 0 <= duration / proof["lower_bound"] - 1 < 1e-2


def test_wilcoxon_and_the_chance_of_a_shorter_run_by_hand():
    race = outcome(["a", "b", "c"], crowd())
    table = races.against(race, "a")
    counts = table[["better", "equal", "worse"]].to_numpy()
    assert counts.tolist() == [[6, 0, 0], [0, 0, 6]]
    over_problems = 2 / 2**6
    over_seeds = 2 / 2**4
    expected = {
        "p": over_problems,
        "p (Holm)": 2 * over_problems,
        "six-axis p": over_seeds,
    }
    for column, value in expected.items():
        np.testing.assert_allclose(table[column], value)
    assert table["shorter"].tolist() == [1.0, 0.0]


def test_summary_by_hand():
    gaps = crowd()
    hits = np.full((3, *gaps.shape), np.nan)
    hits[0, :, 1] = 10.0  # always
    hits[0, :3, 0] = 50.0  # on half of the problems
    race = outcome(["a", "b", "c"], gaps, hits)
    table = races.summary(race)
    ratios = np.array([1.0, 0.5, 100.0])
    np.testing.assert_allclose(table["six-axis median gap (%)"], 1.015 * ratios)
    np.testing.assert_allclose(table["median gap (%)"], 3.515 * ratios)
    rates = table["success 1 %"]
    assert rates.tolist() == [0.5, 1.0, 0.0]
    assert table["evaluations to 1 %"].tolist() == [150.0, 10.0, np.inf]


def test_an_ingredient_is_worth_what_it_multiplies_the_gap_by():
    factors = (0.5, 1.0, 3.0, 0.9)
    worth = dict(zip(issa_ablation.INGREDIENTS, factors, strict=True))
    base = np.array([[0.01, 0.01], [0.07, 0.07]])
    names = []
    gaps = []
    for some in issa_ablation.subsets(issa_ablation.INGREDIENTS):
        names.append(issa_ablation.subset(some))
        own = [worth[name] for name in some]
        gaps.append(np.prod(own) * base)
    race = outcome(names, np.stack(gaps, axis=1))
    table = issa_ablation.ingredients(race)
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
    assert set(paired) == set(planners)


@pytest.mark.parametrize(("experiment", "table"), [(issa_ablation, "origin"), (swarms, "nlp")])
def test_quick_forms_resume(
    experiment,
    table,
    tmp_path,
    capsys,
    monkeypatch,
):
    monkeypatch.setattr(races, "proved", full_speed)
    # Small where size shows nothing: intervals, boxes and batches are as many as it takes.
    monkeypatch.setattr(statistics, "bootstrap", partial(statistics.bootstrap, resamples=99))
    monkeypatch.setattr(issa_ablation, "PLACES", (0.0, 0.5))
    experiment.main(output=tmp_path, quick=True)
    folder = tmp_path / "2-problems-2-seeds-100-evaluations"
    summary = pd.read_csv(folder / "summary.csv")
    gaps = summary["median gap (%)"].dropna()
    assert (gaps > 0).all()
    written = {file.name for file in folder.iterdir()}
    assert {f"{table}.csv", f"{table}.md", "summary.md"} <= written
    again = [
        (races, "measured"),
        (races, "proved"),
        (issa_ablation, "biased"),
        (swarms, "nlp"),
    ]
    first = capsys.readouterr().out
    for module, name in again:
        monkeypatch.setattr(module, name, lambda *_: pytest.fail("done twice"))
    experiment.main(output=tmp_path, quick=True)
    assert capsys.readouterr().out == first
