"""The races in small: numbers that can be worked out by hand, and nothing done twice."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments import issa_ablation, swarms
from experiments.common import races
from trajopt import Limits, Problem, Solution, Status, verify
from trajopt.core.exceptions import TrajoptError
from trajopt.planners import spline353
from trajopt.planners.swarm import SSA
from trajopt.planners.swarm_planner import SwarmPlanner
from trajopt.views.analysis import statistics

PROBLEM = Problem([[0.0], [1.0], [0.5], [2.0]], Limits([1.0], [2.0]), "one")


def full_speed(problem: Problem) -> pd.DataFrame:
    """A bound without a solver: every segment at full speed (the limits are per joint)."""
    speed = np.abs(problem.limits.velocity).max(axis=1)
    bound = (np.abs(np.diff(problem.waypoints, axis=0)) / speed).max(axis=1).sum()
    return pd.DataFrame([{"problem": problem.name, "lower_bound": bound, "width": 1e-6}])


def outcome(names: list[str], gaps: np.ndarray, hits: np.ndarray | None = None) -> races.Outcome:
    problems = [f"p{i}" for i in range(len(gaps))]
    proof = pd.DataFrame({"problem": problems, "width": 1e-6})
    if hits is None:
        hits = np.full((3, *gaps.shape), np.nan)
    return races.Outcome(names, proof, gaps, hits, 100)


def crowd() -> np.ndarray:
    """Gaps of three entrants on 6 problems, 4 seeds: the second always best, the third worst."""
    base = 0.01 * np.arange(1, 7)[:, None] + 1e-4 * np.arange(4)
    return np.stack([base, 0.5 * base, 100 * base], axis=1)


def test_a_table_is_made_once_and_no_part_of_it_stays(tmp_path: Path) -> None:
    table = pd.DataFrame({"gap": [0.1 + 0.2, np.inf]})
    folder = tmp_path / "new"
    made = []

    def make(option: int) -> pd.DataFrame:
        made.append(option)
        return table

    for option in (1, 1, 2, 1):
        found = races.stored(folder, "cell a=b", partial(make, option))
        pd.testing.assert_frame_equal(found, table, check_exact=True)
    assert made == [1, 2]
    assert len(list(folder.iterdir())) == 2


def test_what_is_interrupted_leaves_no_table(tmp_path: Path) -> None:
    def interrupted() -> pd.DataFrame:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        races.stored(tmp_path, "cut", partial(interrupted))
    assert list(tmp_path.iterdir()) == []


def test_a_run_below_the_proof_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    proof = pd.DataFrame({"problem": ["one"], "lower_bound": [1e3], "width": [1e-6]})
    monkeypatch.setattr(races, "proved", lambda problem: proof)
    with pytest.raises(TrajoptError, match="below the proved bound"):
        races.run({"a": SwarmPlanner(evaluations=300)}, [PROBLEM], 2, 300, tmp_path)


def test_gaps_are_of_certified_durations_and_no_answer_is_infinite() -> None:
    slow = spline353.trajectory(PROBLEM, np.array([9.0, 9.0, 9.0]))
    fast = spline353.trajectory(PROBLEM, np.array([0.1, 0.1, 0.1]))  # breaks the limits
    certified = verify(PROBLEM, fast).certified_duration
    assert certified is not None
    curves = [[[5, 28.0], [9, 27.0]], [[9, 0.3]], [[9, np.nan]]]
    found = [
        Solution(Status.SOLVED, trajectory, history=np.array(curve))
        for trajectory, curve in zip((slow, fast, slow), curves, strict=True)
    ]
    planner: Any = SimpleNamespace(solve_batch=lambda problem, seeds: found)
    rows = races.measured(PROBLEM, planner, 3, 27 / 1.005)
    assert rows["gap"].tolist() == pytest.approx([0.005, certified * 1.005 / 27 - 1, np.inf])
    assert rows["1 %"].tolist() == pytest.approx([9, 9, np.nan], nan_ok=True)
    assert rows["0.1 %"].isna().tolist() == [True, False, True]


def test_the_proof_holds_the_optimum() -> None:
    """One joint, equal limits: the bound is below what a swarm finds, and close to it."""
    proof = races.proved(PROBLEM).iloc[0]
    found = SwarmPlanner(evaluations=3000, fitness="scaled").solve(PROBLEM)
    assert proof["status"] == "proved"
    assert 0 <= proof["width"] <= 1.1e-6
    rows = races.measured(PROBLEM, SwarmPlanner(evaluations=3000, fitness="scaled"), 1, 1.0)
    assert rows["gap"][0] + 1 == pytest.approx(found.history[-1, 1])  # type: ignore[index]
    assert 0 <= (rows["gap"][0] + 1) / proof["lower_bound"] - 1 < 1e-2


def test_wilcoxon_and_the_chance_of_a_shorter_run_by_hand() -> None:
    table = races.against(outcome(["a", "b", "c"], crowd()), "a")
    assert table[["better", "equal", "worse"]].to_numpy().tolist() == [[6, 0, 0], [0, 0, 6]]
    assert table["p"].tolist() == pytest.approx([2 / 2**6] * 2)
    assert table["p (Holm)"].tolist() == pytest.approx([4 / 2**6] * 2)
    assert table["six-axis p"].tolist() == pytest.approx([2 / 2**4] * 2)
    assert table["shorter"].tolist() == table["six-axis shorter"].tolist() == [1.0, 0.0]


def test_summary_by_hand() -> None:
    gaps = crowd()
    hits = np.full((3, *gaps.shape), np.nan)
    hits[0, :, 1] = 10.0  # always
    hits[0, :3, 0] = 50.0  # on half of the problems
    table = races.summary(outcome(["a", "b", "c"], gaps, hits))
    assert table["six-axis median gap (%)"].tolist() == pytest.approx([1.015, 0.5075, 101.5])
    assert table["median gap (%)"].tolist() == pytest.approx([3.515, 1.7575, 351.5])
    assert table["success 1 %"].tolist() == [0.5, 1.0, 0.0]
    assert table["evaluations to 1 %"].tolist() == [150.0, 10.0, np.inf]
    assert table["mean rank"].tolist() == [2.0, 1.0, 3.0]
    assert (table["success 1 % low"] <= table["success 1 %"]).all()


def test_an_ingredient_is_worth_what_it_multiplies_the_gap_by() -> None:
    worth = dict(zip(issa_ablation.INGREDIENTS, (0.5, 1.0, 3.0, 0.9), strict=True))
    names = []
    gaps = []
    for switches in itertools.product((False, True), repeat=4):
        kept = tuple(n for n, on in zip(worth, switches, strict=True) if on)
        names.append(issa_ablation.subset(kept))
        gaps.append(np.prod([worth[n] for n in kept]) * np.array([[0.01, 0.01], [0.07, 0.07]]))
    table = issa_ablation.ingredients(outcome(names, np.stack(gaps, axis=1)))
    for column in ("alone", "to the others", "overall", "low", "high"):
        assert table[column].tolist() == pytest.approx(list(worth.values()))


def test_the_variants_are_all_different_and_the_empty_one_is_ssa() -> None:
    planners = issa_ablation.entrants(90)
    assert len(planners) == len(set(planners.values())) == 16 + 10 + 3
    own = planners["ssa"].solve(PROBLEM, seed=3)
    other = SwarmPlanner(SSA(), evaluations=90).solve(PROBLEM, seed=3)
    assert np.array_equal(own.history, other.history, equal_nan=True)  # type: ignore[arg-type]
    assert planners["issa"] == SwarmPlanner(evaluations=90)
    assert all(planner.evaluations == 90 for planner in planners.values())


def test_only_the_sparrows_care_where_the_origin_is() -> None:
    def error(name: str, frame: str) -> float:
        cell = ("sphere", frame, 0.5, name)
        return float(issa_ablation.biased(cell, 5, 600)["median error"][0])

    assert error("PSO", "far away") == pytest.approx(error("PSO", "in its middle"), rel=1e-3)
    assert error("SSA", "far away") > 1e6 * error("SSA", "in its middle")


def test_time_to_the_target_is_evaluations_times_their_cost() -> None:
    hits = np.full((3, 2, 2, 2), np.nan)
    hits[1, :, 0] = [[40, 60], [10, np.nan]]  # 50; (10 + 100) / 1
    costs = pd.DataFrame({"alone (µs)": [2e6, 1.0]})
    solved = pd.DataFrame({"gap": [1e-6, 0.5], "seconds": [7.0, 8.0]})
    found = swarms.seconds(outcome(["a", "b"], np.ones((2, 2, 2)), hits), costs, solved)
    assert found.tolist() == [[100.0, np.inf, 7.0], [220.0, np.inf, np.inf]]


def test_the_fitness_is_all_that_the_swarms_pairs_differ_in() -> None:
    planners = swarms.entrants(60)
    for name in swarms.OPTIMISERS:
        assert replace(planners[f"{name} scaled"], fitness="penalty") == planners[f"{name} penalty"]
    assert {entrant for pair in swarms.pairs() for entrant in pair} == set(planners)


@pytest.mark.parametrize(("experiment", "table"), [(issa_ablation, "origin"), (swarms, "nlp")])
def test_quick_forms_resume(
    experiment: Any,
    table: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(races, "proved", full_speed)
    # Small where size shows nothing: intervals, boxes and batches are as many as it takes.
    monkeypatch.setattr(statistics, "bootstrap", partial(statistics.bootstrap, resamples=99))
    monkeypatch.setattr(issa_ablation, "PLACES", (0.0, 0.5))
    monkeypatch.setattr(swarms, "BATCH", 2)
    experiment.main(output=tmp_path, quick=True)
    folder = tmp_path / "2-problems-2-seeds-100-evaluations"
    summary = pd.read_csv(folder / "summary.csv").set_index("entrant")
    assert (summary["median gap (%)"].dropna() > 0).all()
    written = {f.name for f in folder.iterdir()}
    assert {f"{table}.csv", f"{table}.md", "summary.md"} <= written
    again = ((races, "measured"), (races, "proved"), (issa_ablation, "biased"), (swarms, "nlp"))
    for module, name in (*again, (swarms, "speed")):
        monkeypatch.setattr(module, name, lambda *_: pytest.fail("done twice"))
    experiment.main(output=tmp_path, quick=True)
    printed = capsys.readouterr().out
    assert printed[: len(printed) // 2] == printed[len(printed) // 2 :]
