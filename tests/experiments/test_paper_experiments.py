"""The paper's experiments: their arithmetic against closed forms, and both scripts in small."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments import paper_readings, paper_study
from experiments.paper import choices as paper_choices
from experiments.paper import claims as paper_claims
from experiments.paper import searches as paper
from experiments.paper.choices import READINGS, Fitness, exact_excess
from trajopt import Limits, Problem
from trajopt.benchmark.suites import catalogue as suite
from trajopt.core import polynomials
from trajopt.planners import spline353
from trajopt.planners.swarm import PSO
from trajopt.views.analysis.statistics import Estimate


@pytest.fixture(scope="module")
def problem() -> Problem:
    return suite.load("six-axis")


def again(*_: object) -> None:
    raise AssertionError("searched again")


def test_published_numbers_agree_with_each_other(problem: Problem) -> None:
    times = paper.running_times()
    assert times["unoptimised"] - times["issa"] == pytest.approx(2.82436)
    claims = paper.reference("claims").set_index("key")["paper"]
    for other, slack in (("unoptimised", 0.5), ("ssa", 0.06), ("pso", 0.06)):
        percent = 100 * (1 - times["issa"] / times[other])
        assert claims[f"below-{other}"] == pytest.approx(percent, abs=slack)
    table = paper.reference("table2").pivot(index="point", columns="joint", values="degrees")
    assert np.radians(table.to_numpy()) == pytest.approx(problem.waypoints)
    for name in ("table4", "table5", "claims", "running-times", "table2"):
        assert paper.reference(name)["source"].str.contains("Machines 12").all()


def test_joints_with_common_times_pass_every_point_together(problem: Problem) -> None:
    robot = suite.robot("six-axis")
    times = np.tile([1.5, 0.9, 1.9], (6, 1))
    at, nearest = paper.tool_miss(robot, problem, times)
    assert at == pytest.approx(np.zeros(4), abs=1e-6)
    assert (nearest < 2.0).all()  # mm between instants
    together = spline353.trajectory(problem, times[0])
    t = np.linspace(0, 5, 30)
    assert paper.alone(problem, times, t) == pytest.approx(together(t), abs=1e-12)


def test_a_joint_that_arrives_early_waits_and_the_tool_misses(problem: Problem) -> None:
    times = np.tile([1.5, 0.9, 1.9], (6, 1))
    times[0], times[1] = np.nan, [0.5, 0.5, 0.5]
    q = paper.alone(problem, times, np.array([0.0, 1.5, 4.3]))
    assert q[1, 1] == pytest.approx(np.radians(-50))
    at, nearest = paper.tool_miss(suite.robot("six-axis"), problem, times)
    assert at[[0, 3]] == pytest.approx([0, 0], abs=1e-9)
    # At point 2 only joint 2 is elsewhere, by 20°: a chord about axis 2, (200, ·, 0) mm.
    wrist = paper.MM * suite.robot("six-axis").forward(problem.waypoints)[1, :3, 3]
    radius = np.hypot(wrist[0] - 200, wrist[2])
    assert at[1] == pytest.approx(2 * radius * np.sin(np.radians(10)), rel=1e-9)
    assert (nearest <= at + 1e-9).all()


def test_ways_of_combining_joints() -> None:
    times = np.full((1, 3, 3), np.nan)
    times[0, 1], times[0, 2] = [1, 2, 3], [3, 1, 1]
    found = {name: float(value[0]) for name, value in paper_readings.combined(times).items()}
    assert found == {
        "joint 2 alone": 6,
        "joint 3 alone": 5,
        "mean": 5.5,
        "sum": 11,
        "longest": 6,
        "segment-wise maximum": 8,
    }


def test_excess_against_sampled_derivatives() -> None:
    rng = np.random.default_rng(0)
    d = rng.normal(size=(200, 1, 3))
    t = rng.uniform(0.3, 2, (200, 1, 3))
    limits = Limits([1.5], [4.0])
    expected = np.zeros(200)
    exact = paper_choices.exact_excess(d, t, limits)[:, 0]
    x = np.linspace(0, 1, 400)[:, None, None] * t[:, 0].T
    for order, top in ((1, 1.5), (2, 4.0)):
        c = polynomials.derivative(spline353.coefficients(d, t)[:, :, 0].transpose(2, 0, 1), order)
        peak = np.abs(sum(row * x**k for k, row in enumerate(c[::-1]))).max(axis=(0, 1))
        expected += np.maximum(peak / top - 1, 0)
    assert exact == pytest.approx(expected, rel=1e-3, abs=1e-4)
    assert (paper_choices.ends_excess(d, t, limits)[:, 0] <= exact + 1e-12).all()


def test_printed_eq_28_differs_by_the_cubic_term_alone() -> None:
    d = np.array([[0.3, 0.4, 0.2]])
    t = np.array([[1.0, 0.5, 1.0]])
    wide = Limits([1e-9], [1e9])
    p5, p4, p3, p2, p1, _ = spline353.coefficients(d, t)[1, 0]
    s = np.linspace(0, 0.5, 21)
    printed = 5 * p5 * s**4 + 4 * p4 * s**3 + 3 * p3 * s**3 + 2 * p2 * s + p1
    peak = max(np.abs(printed).max(), 0.9, 0.6)  # 3 d/t where the cubics meet it
    found = paper_choices.printed_excess(d, t, wide)
    assert found == pytest.approx(peak / 1e-9 - 1, rel=1e-9)


def test_one_joint_searched_in_a_box_of_seconds() -> None:
    problem = Problem([[0.0], [1.0], [2.0], [3.0]], Limits([1e3], [6.0]))
    fitness = Fitness(exact_excess, box=(0.1, 5.0))
    alone, shared = (
        paper_choices.searched(fitness, PSO(), problem, 3, 150, shared=s) for s in (False, True)
    )
    ratios = np.stack(np.meshgrid(*[np.geomspace(0.2, 5, 121)] * 2), axis=-1).reshape(-1, 1, 2)
    grid = np.insert(ratios, 1, 1.0, axis=-1)  # of t1 and t3 to t2, each dilated to the limit
    best = (spline353.dilation(np.ones((1, 3)), grid, problem.limits) * grid[:, 0].sum(-1)).min()
    for runs in (alone, shared):
        total = runs.times.sum(axis=2)
        assert total == pytest.approx(np.full((3, 1), best), rel=2e-3)
    assert [len(c) > 0 for c in alone.curves(0)] == [True] * 3
    assert alone.curves(0)[1][-1, 1] == pytest.approx(alone.times[1].sum())


def test_a_soft_penalty_gives_up_limits_for_time(problem: Problem) -> None:
    moving = replace(problem, waypoints=problem.waypoints)
    best = [
        np.median(
            paper_choices.searched(Fitness(exact_excess, w), PSO(), moving, 3, 60, True)
            .times[:, 1]
            .sum(axis=1)
        )
        for w in (0.1, 0.5, 10.0)
    ]
    assert all(a < b for a, b in pairwise(best))


def test_settling_is_within_one_percent_of_a_runs_own_end() -> None:
    curves = [np.array([[1, 2.0], [40, 1.009], [70, 1.0], [99, 1.0]]), np.array([[1, 1.0]])]
    assert paper_study.settled(curves).tolist() == [40, 1]
    assert paper_study.iterations(np.array([1, 30, 31, 60, 61]), "pso").tolist() == [0, 0, 1, 1, 2]


def test_verdicts() -> None:
    ours = {
        "a": Estimate(1, 0.9, 1.1),
        "time-x": Estimate(4, 4, 4),
        "b": Estimate(1, -1, 9),
        "segment-wise-x": Estimate(3, 3, 3),
    }

    def of(key: str, number: float) -> str:
        return paper_claims.verdict({"key": key, "paper": number, "slack": 0.05}, ours)

    assert of("a", 1.14) == "reproduced"
    assert of("a", 1.2) == of("b", 5.0) == of("time-x", 2) == "not reproduced"
    assert of("time-x", 3.0) == of("", 7.0) == "cannot be decided from the text"


def test_an_order_is_strict_only_where_intervals_are_apart() -> None:
    cells = {"a": (2.0, 1.9, 2.1), "b": (1.0, 0.9, 1.1), "c": (1.05, 1.0, 1.2)}
    keys = ["claimed s", "low s", "high s"]
    assert paper_readings.order({n: pd.Series(v, keys) for n, v in cells.items()}) == "b ≈ c < a"


def test_what_every_reading_stands_beside_was_read() -> None:
    names = [r.name for r in READINGS]
    assert len(set(names)) == len(names)
    for reading in READINGS:
        base = next((r for r in READINGS if r.name == reading.beside), None)
        assert base is None or base.algorithms == paper.ALGORITHMS


def test_table_2_comes_back_but_for_its_singular_wrist(problem: Problem) -> None:
    table = paper_study.table2(suite.robot("six-axis"), problem)
    off = table[table["difference"].abs() > 1e-6]
    assert off[["joint", "point"]].to_numpy().tolist() == [[4, 2], [6, 2]]
    assert off["ours deg"].sum() == pytest.approx(30)


def test_study_in_small_and_not_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paper_study.main(quick=True, output=tmp_path)
    claims = pd.read_csv(tmp_path / "claims.csv")
    assert set(claims["verdict"]) <= {
        "reproduced",
        "not reproduced",
        "cannot be decided from the text",
    }
    assert claims["command"].notna().all()
    times = pd.read_csv(tmp_path / "running-times.csv").set_index(["algorithm", "timing"])
    assert (times.loc[(["pso", "ssa", "issa"], "shared"), "claimed s"] > 4.31038).all()  # proved
    assert times.loc[("unoptimised", "shared"), "claimed s"] == 6.0
    names = {f.name for f in tmp_path.iterdir()}
    tables = {"table2", "table4", "table5", "running-times", "points", "claims"}
    assert {f"{t}.{s}" for t in tables for s in ("csv", "md")} <= names
    assert {"figure6.png", "figure6.svg"} <= names
    monkeypatch.setattr(paper, "swarm", again)
    found = paper_study.searched(tmp_path, suite.load("six-axis"), 4, 20)
    assert len(found["issa", "shared"].times) == 4


def test_readings_in_small_and_not_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    some = "default", "PSO of 1995", "eq. 31 as printed", "bounds 0.5–4 s"
    few = [r for r in READINGS if r.name in some]
    monkeypatch.setattr(paper_readings, "READINGS", few)
    paper_readings.main(quick=True, output=tmp_path)
    table = pd.read_csv(tmp_path / "readings.csv").set_index(["reading", "combination"])
    assert not table.loc[("eq. 31 as printed", "shared"), "passes together"].any()
    assert table.loc[("default", "shared"), "passes together"].all()
    assert (table.loc[("default", "longest"), "miss at point 2 mm"] > 1).all()
    assert (table.loc[("default", "shared"), "certified s"] > 4.31038).all()
    ranked = set(pd.read_csv(tmp_path / "ranking.csv")["reading"])
    assert ranked == {"default", "PSO of 1995", "bounds 0.5–4 s"}
    assert len(pd.read_csv(tmp_path / "claims.csv")) == 3
    first = capsys.readouterr().out
    monkeypatch.setattr(paper_choices, "swarm", again)
    paper_readings.main(quick=True, output=tmp_path)
    assert capsys.readouterr().out == first
