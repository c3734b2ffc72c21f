"""The arena in small: groups by hand, every optimiser of a library, and nothing run twice."""

from __future__ import annotations

from importlib.util import find_spec
from math import comb

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from test_swarm_experiments import crowd, outcome

from experiments import arena
from experiments.common import races
from trajopt import InvalidInput
from trajopt.benchmark.store.recheck import verification
from trajopt.planners.registry import load


def spread(centre, runs=12):
    return list(centre * (1 + 0.01 * np.arange(runs)))


def test_groups_differ_significantly_from_the_best_of_the_one_before():
    same = spread(1e-3)
    gaps = {"a": same, "b": same[::-1], "c": spread(1e-2), "d": spread(1e-2), "e": [np.inf] * 12}
    assert arena.groups(gaps) == {"a": 1, "b": 1, "c": 2, "d": 2, "e": 3}


def test_few_runs_form_no_groups():
    """Two entrants of n runs differ with p ≥ 1 / C(2n, n); Holm multiplies by the comparisons."""
    few = {name: spread(10.0**k, 3) for k, name in enumerate("abc")}
    assert 2 / comb(6, 3) > arena.LEVEL
    assert arena.groups(few) == {}
    more = {name: spread(10.0**k, 4) for k, name in enumerate("abc")}
    assert 2 / comb(8, 4) < arena.LEVEL
    assert arena.groups(more) == {"a": 1, "b": 2, "c": 3}


def test_differences_below_rounding_make_no_group():
    gaps = {"a": [0.0] * 12, "b": [1e-11] * 12, "c": [1e-6] * 12}
    assert arena.groups(gaps) == {"a": 1, "b": 1, "c": 2}


def test_the_table_by_hand():
    """Of four runs one is at the optimum, one within 0.1 %, one within 1 % and one beyond."""
    width = 1e-6
    gaps = np.array([[width, 5e-4, 5e-3, 5e-2]])
    made = arena.table(crowd({"a": gaps, "b": gaps * 2}))
    row = made.loc["a"]
    shares = [row[f"within {name}"] for name in arena.TARGETS]
    assert shares == [0.25, 0.5, 0.75]
    assert row["median gap"] == pytest.approx((5e-4 + 5e-3) / 2, rel=1e-3)
    assert (row["runs"], row["failed"]) == (4, 0)
    # 100 evaluations a run, two of four succeed
    assert row["evaluations to 0.1 %"] == pytest.approx(200)
    shown = arena.printed({100: made, 200: made})
    assert list(shown.index) == ["a", "b"]
    assert shown.loc["a", "within 1 % at 200"] == "75 %"
    assert shown.loc["a", "median gap at 100"] == "0.2749 %"
    assert shown.loc["a", "group at 200"] == "1"


def test_problems_together_count_all_their_runs():
    on_first = crowd({"a": np.array([[1e-4] * 3]), "b": np.array([[np.nan] * 3])})
    on_second = outcome({"a": {"p1": [[[100, 2.2]]]}, "b": {"p1": [[[100, 2.0002]]]}})
    made = arena.table(arena.together([on_first, on_second]))
    assert made["runs"].to_dict() == {"a": 4, "b": 4}
    assert made["within 0.1 %"].to_dict() == {"a": 0.75, "b": 0.25}
    assert made["failed"].to_dict() == {"a": 0, "b": 3}
    assert made.loc["a", "median gap, p1"] == pytest.approx(0.1, rel=1e-4)
    assert "median gap, p1 at 100" in arena.printed({100: made})


def test_groups_of_several_problems_compare_runs_of_one():
    """On the second problem, whose gaps are larger, `a` is better; on the first both are equal."""
    gaps = np.array([spread(1e-3), spread(1.0)])
    made = arena.table(crowd({"a": gaps, "b": gaps * [[1.0], [2.0]], "c": gaps * 1.3}))
    assert made["group"].to_dict() == {"a": 1, "b": 2, "c": 2}


def test_an_order_that_carries_over_correlates(tmp_path):
    same = {name: np.array([[gap] * 2]) for name, gap in (("a", 1e-4), ("b", 1e-3), ("c", np.nan))}
    turned = dict(zip("cba", same.values(), strict=True))
    first = arena.table(crowd(same))
    assert arena.carried(first, first, tmp_path / "same.svg") == pytest.approx(1.0)
    assert arena.carried(first, arena.table(crowd(turned)), tmp_path / "a.svg") == pytest.approx(-1)


def test_a_failure_reaches_no_target():
    made = arena.table(crowd({"a": np.array([[np.nan, np.nan]]), "b": np.array([[1e-4, 1e-4]])}))
    assert made.loc["a", "failed"] == 2
    assert made.loc["a", "within 1 %"] == 0
    shown = arena.printed({100: made})
    assert shown.loc["a", "median gap at 100"] == "–"
    assert shown.loc["a", "evaluations to 0.1 %"] == "–"


@pytest.mark.skipif(find_spec("pymoo") is None, reason="pymoo is not installed")
def test_every_optimiser_of_a_library_and_our_own_have_the_same_budget():
    found = arena.entrants((), ("pymoo",), 500)
    assert [*arena.OWN] == list(found)[: len(arena.OWN)]
    assert {f"pymoo {name}" for name in load("pymoo").choices()["name"]} <= found.keys()
    assert {planner.evaluations for planner in found.values()} == {500}
    limits = {planner.cpu_limit for name, planner in found.items() if "pymoo" in name}
    assert limits == {arena.CPU_LIMIT_S}
    one = arena.entrants(("pymoo:name=DE,population=10",), (), 500)
    assert one["pymoo DE,population=10"].population == 10
    assert "pymoo DE" in arena.entrants(("pymoo:name=DE",), (), 500)
    assert "pymoo DE" not in arena.entrants((), ("pymoo",), 500, without=("pymoo:name=DE",))


def test_a_problem_with_limits_that_no_search_keeps_is_refused(tmp_path):
    """The judge slows down to the FR3's falling velocity limits: that gap is no optimiser's."""
    assert not any("fr3" in problem for problem in arena.OTHERS)
    with pytest.raises(InvalidInput, match="robots-franka-fr3-w4"):
        arena.main(problems=("robots-franka-fr3-w4",), budgets=(9,), output=tmp_path)


def test_it_goes_on_where_it_was_interrupted(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(races, "PROOF", "prove:family=spline353,within=1e-3,time_limit=20")
    told = {
        "names": ("pso", "de:population=12"),
        "problems": ("six-axis",),
        "jobs": 0,
        "output": tmp_path,
    }
    arena.main(budgets=(60,), seeds=1, **told)
    trials = tmp_path / "six-axis" / "60" / "results.h5"
    assert trials.exists()
    arena.main(budgets=(60, 90), seeds=2, **told)
    monkeypatch.setattr("trajopt.planners.swarm_planner.minimise", pytest.fail)
    arena.main(budgets=(60, 90), seeds=2, **told)
    assert "six-axis, 90 evaluations, 2 seeds:" in capsys.readouterr().out
    assert (tmp_path / "six-axis.svg").read_text(encoding="utf-8").startswith("<?xml")
    own_words = [t for t in verification(tmp_path / "six-axis" / "60").trials if not t.holds]
    assert not own_words
    kept = (tmp_path / "six-axis-printed.csv").read_text(encoding="utf-8")
    assert "median gap at 60" in kept


def test_names_in_figures_touch_no_mark_and_no_other_name():
    """A cloud, a curve through it, and five points in its middle with names."""
    rng = np.random.default_rng(0)
    drawing = Figure(figsize=(5.6, 4.0), layout="constrained")
    axes = drawing.subplots()
    cloud = rng.normal(size=(150, 2))
    curve = np.column_stack([np.linspace(-3, 3, 7), np.sin(np.linspace(-3, 3, 7))])
    axes.plot(*cloud.T, "o", ms=4, label="cloud")
    axes.plot(*curve.T)
    axes.legend()
    names = {(x, y): f"entrant {k}" for k, (x, y) in enumerate(cloud[:5])}
    arena.write_names(drawing, names)
    drawing.draw_without_rendering()
    boxes = [Text.get_window_extent(found) for found in axes.texts]  # without the line
    finely = np.linspace(-3, 3, 2000)
    on_curve = np.column_stack([finely, np.interp(finely, *curve.T)])
    marks = axes.transData.transform(np.vstack([cloud, on_curve]))
    assert [found.get_text() for found in axes.texts] == list(names.values())
    for k, box in enumerate(boxes):
        assert box.count_contains(marks) == 0
        assert box.count_overlaps([*boxes[:k], axes.get_legend().get_window_extent()]) == 0
