"""Tables against plain NumPy on made-up trials, and the alarm for beating the reference."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from trials import as_runs

from trajopt import (
    InvalidInput,
    Limits,
    Problem,
    Relation,
    Solution,
    Status,
    StoreError,
    Trajectory,
)
from trajopt.benchmark.store.fields import FIELDS
from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.trial import trials_of
from trajopt.planners.planner import Planner
from trajopt.views.analysis.overview import competing
from trajopt.views.analysis.pairwise import mean_ranks
from trajopt.views.results import Results

PROBLEM = Problem([[0.0], [1.0]], Limits([10.0], [100.0]), "one")
THIRD = Problem([[0.0], [3.0]], Limits([10.0], [100.0]), "three")
OTHER = Problem([[0.0], [2.0]], Limits([10.0], [100.0]), "two")


class Fixed(Planner):
    """A quintic of a given duration per seed; 0 is a crash, a negative one fails."""

    def __init__(self, *durations, bound=None, relation=Relation.RESTRICTION):
        self.durations, self.bound, self.kind = durations, bound, relation

    def options(self):
        return {}

    def relation(self, problem):
        return self.kind

    def unsupported(self, problem):
        return None

    def solve(self, problem, *, seed=0):
        t = self.durations[seed]
        if t < 0 and self.kind is Relation.RELAXATION:
            through_the_air = Trajectory([0, -t], np.zeros((1, 1, 1)), [0, -t])
            return Solution(Status.RELAXED, through_the_air, "waypoints are ignored")
        if t < 0:
            return Solution(Status.FAILED, message="gave up", lower_bound=self.bound)
        h = problem.displacements[0, 0]
        c = [6 * h / t**5, -15 * h / t**4, 10 * h / t**3, 0, 0, problem.waypoints[0, 0]]
        trajectory = Trajectory([0, t], np.reshape(c, (6, 1, 1)), [0, t])
        return Solution(Status.SOLVED, trajectory, lower_bound=self.bound, evaluations=10 * seed)


def run(name, *durations, problem=PROBLEM, **more):
    planner = Fixed(*durations, **more)
    return [trials_of(planner, problem, [seed], name)[0] for seed in range(len(durations))]


def test_the_reference_is_the_shortest_certified_exact_answer_of_each_problem():
    items = [*run("exact", 2.5, 2.0), *run("exact", 3.0, problem=OTHER), *run("mine", 1.0)]
    table = Results(items).references()
    assert table.loc[PROBLEM.digest()].tolist()[:2] == [2.0, "exact"]
    assert table.loc[OTHER.digest()].tolist()[:2] == [3.0, "exact"]
    assert table["proved"].isna().all()


def test_gaps_are_certified_over_reference_minus_one():
    items = [*run("exact", 2.0), *run("mine", 2.5, 3.0, -1.0)]
    table = Results(items).gaps()
    np.testing.assert_allclose(table["gap"], [0, 0.25, 0.5, np.nan], rtol=1e-12)


def test_what_counts_is_the_certified_duration_not_the_claim():
    # 15/8 · 1 rad / 0.05 s is 3.75 times 10 rad/s; 10/√3 / 0.05² is 23.09 times 100 rad/s²
    (trial,) = run("mine", 0.05)
    k = max(3.75, np.sqrt(10 / np.sqrt(3) / 0.05**2 / 100))
    row = Results([*run("exact", 2.0), trial]).gaps().iloc[1]
    assert row["claimed_duration"] == 0.05
    assert row["certified_duration"] == pytest.approx(0.05 * k, rel=1e-9)
    assert not row["feasible"]
    assert row["dilation"] == pytest.approx(k, rel=1e-9)


def test_without_a_certified_exact_answer_a_relaxed_one_is_the_reference_or_what_is_proved():
    items = [*run("exact", -1.5, relation=Relation.RELAXATION), *run("mine", 3.0)]
    results = Results(items)
    assert results.references().iloc[0].tolist()[:2] == [1.5, "relaxed"]
    row = results.summary().set_index("label").loc["mine"]
    assert row["gap"] == pytest.approx(1.0)
    assert row["kind"] == "relaxed"
    relaxed = results.summary().set_index("label").loc["exact"]
    assert (relaxed["status"], relaxed["solved"]) == ("invalid", 0)
    assert np.isnan(relaxed["lower_bound"])
    proved = Results([*items, *run("prove", -1.0, bound=2.0)])
    assert proved.references().iloc[0].tolist()[:3] == [2.0, "lower bound", 2.0]
    unproved = Results([*run("exact", -1.0, bound=2.0), *run("mine", 3.0)])
    assert unproved.references().empty  # a bound of `exact` is not proved


@pytest.mark.parametrize("name", ["prove", "certify"])  # stored trials may have the old name
def test_a_proof_bounds_the_reference_and_may_improve_it(name):
    proof = run(name, 1.9, bound=1.8)
    results = Results([*run("exact", 2.0), *proof, *run("mine", 2.5)])
    assert results.references().iloc[0].tolist() == [1.9, "exact", 1.8, "", ""]
    assert results.summary()["proved"].tolist() == [1.8] * 3
    assert results.suspicious().empty


def test_below_a_proof_is_suspicious_whatever_the_reference():
    items = [*run("exact", 2.0), *run("prove", -1.0, bound=2.2), *run("mine", 2.1)]
    assert set(Results(items).suspicious()["label"]) == {"exact", "mine"}


@pytest.mark.parametrize(("duration", "suspicious"), [(1.9999, False), (1.999, True)])
def test_refined_collocation_may_itself_be_a_little_above_the_optimum(duration, suspicious):
    items = [*run("exact", -1.0, bound=1.0), *run("collocation-refined", 2.0)]
    results = Results([*items, *run("mine", duration)])
    assert results.references().iloc[0].tolist()[:2] == [2.0, "refined"]
    assert (set(results.suspicious()["label"]) == {"mine"}) is suspicious


def test_without_an_exact_answer_there_are_no_gaps():
    results = Results(run("mine", 2.0))
    assert results.references().empty
    assert results.gaps()["gap"].isna().all()
    assert results.suspicious().empty


def test_the_summary_is_what_numpy_says():
    durations = np.random.default_rng(1).uniform(2, 5, 30)
    row = (
        Results([*run("exact", 2.0), *run("mine", *durations)])
        .summary()
        .set_index("label")
        .loc["mine"]
    )
    q1, median, q3 = np.percentile(durations, [25, 50, 75])
    found = row[["min", "q1", "median", "q3", "max"]].astype(float)
    np.testing.assert_allclose(
        found, [durations.min(), q1, median, q3, durations.max()], rtol=1e-12
    )
    assert row["gap"] == pytest.approx(np.median(durations / 2 - 1))
    assert row["evaluations"] == np.median(10 * np.arange(30))
    assert (row["runs"], row["solved"], row["kept"]) == (30, 30, 1.0)


def test_kept_is_a_share_of_all_runs_and_dilation_the_median_of_those_that_broke():
    items = run("mine", 2.0, 0.05, 0.04, 0.1, -1.0)
    row = Results(items).summary().iloc[0]
    assert row["kept"] == pytest.approx(1 / 5)
    assert (row["runs"], row["solved"]) == (5, 4)
    broke = [np.sqrt(10 / np.sqrt(3) / t**2 / 100) for t in (0.05, 0.04, 0.1)]
    assert row["dilation"] == pytest.approx(np.median(broke))
    assert (row["status"], row["message"]) == ("failed", "gave up")


def test_rows_are_sorted_by_certified_duration_with_failures_last():
    items = [*run("d", -1.0), *run("c", 4.0), *run("a", 2.0), *run("b", 3.0)]
    assert Results(items).summary()["label"].tolist() == ["a", "b", "c", "d"]


@pytest.mark.parametrize(
    ("excess", "alarm"), [(-2e-6, True), (-1.1e-6, True), (-0.9e-6, False), (0, False)]
)
def test_beating_the_reference_beyond_a_millionth_is_suspicious(excess, alarm):
    results = Results([*run("exact", 2.0), *run("mine", 2.0 * (1 + excess))])
    assert results.suspicious()["label"].tolist() == ["mine"] * alarm


def test_no_trials_give_an_empty_table():
    assert Results([]).trials().empty


@pytest.mark.parametrize("as_path", [str, lambda path: path])
@pytest.mark.parametrize("name", ["", "results.h5"])
def test_a_path_is_read_as_the_trials_it_holds(tmp_path, name, as_path):
    store = Store(tmp_path)
    items = [*run("exact", 2.0), *run("mine", 2.5, -1.0)]
    for trial in items:
        store.write(trial)
    store.consolidate()
    found = Results(as_path(tmp_path / name))
    made = Results(items)
    for table in ("trials", "gaps", "summary"):
        expected = getattr(made, table)()
        keys = ["id"] if "id" in expected else ["problem", "label"]
        pd.testing.assert_frame_equal(
            getattr(found, table)().sort_values(keys, ignore_index=True),
            expected.sort_values(keys, ignore_index=True),
        )


def test_a_path_without_results_is_named(tmp_path):
    with pytest.raises(StoreError, match=r"results\.h5: no such file"):
        Results(tmp_path / "results.h5")


def searching(name, histories, *, problem=PROBLEM, spent=None):
    """One run per history `(m, 2)`, as long as its last best; an empty one is a run without any."""
    items = run(name, *(h[-1][1] if h else -1.0 for h in histories), problem=problem)
    return [
        replace(
            t, solution=replace(t.solution, history=np.array(h) if h else None, evaluations=spent)
        )
        for t, h in zip(items, histories, strict=True)
    ]


def best_353(duration, problem=PROBLEM):
    return run("spline353-nlp", duration, problem=problem)


def test_expected_running_times_count_what_every_run_spent():
    good = [[10, np.nan], [20, 2.1], [100, 2.01]]
    items = [
        *best_353(2.0),
        *searching("mine", [good, [[10, 2.5], [50, 2.3]]]),
        *searching("mine", [[[40, 3.0]]], problem=OTHER, spent=70),
        *best_353(2.9, OTHER),
        *searching("mine", [[[1, 9.0]]], problem=THIRD),
    ]
    table = Results(items).running_times([0.1, 0.01, 0.001], to="best 3-5-3").loc["mine"]
    # Within 10 %: at 20, never in 50, at 40. Within 1 %: at 100, never in 50, never in 70.
    assert table["ert"].tolist() == [(20 + 50 + 40) / 2, 100 + 50 + 70, np.inf]
    assert table["successes"].tolist() == [2, 1, 0]
    assert table["runs"].tolist() == [3, 3, 3]  # nothing is known of the third problem
    assert table["problems"].tolist() == [2, 2, 2]


def test_a_run_without_an_answer_or_a_count_is_charged_too():
    first, lost, none = searching("mine", [[[20, 2.0]], [[30, 1.0]], []])
    lost = replace(lost, certificate=None, status=Status.INVALID)
    items = [*best_353(2.0), first, lost, none]
    row = Results(items).running_times(0.1, to="best 3-5-3").loc[("mine", 0.1)]
    assert row.tolist() == [20 + 30 + 30, 1, 3, 1]


def test_what_beats_the_best_353_or_keeps_no_history_is_no_search_of_it():
    items = [*best_353(2.0), *searching("fast", [[[20, 1.5]]]), *run("mine", 2.5)]
    assert Results(items).running_times(to="best 3-5-3").empty


def test_expected_running_times_to_the_optimum_are_of_any_planner():
    """Evaluations of 0.01 s each; a planner without a history answers at the end of its time."""
    found = [replace(t, solve_time=0.5) for t in searching("mine", [[[10, 2.6], [50, 2.1]]])]
    fast, slow = run("once", 2.1, 3.0)
    once = [replace(fast, solve_time=0.2), replace(slow, solve_time=0.4)]
    results = Results([*run("exact", 2.0), *found, *once])
    table = results.running_times([0.5, 0.1])
    assert table.loc["mine", "ert"].tolist() == pytest.approx([0.1, 0.5])
    # within 50 %: both, as 3.0 is exactly that; within 10 %: the first, which pays for both
    assert table.loc["once", "ert"].tolist() == pytest.approx([0.6 / 2, 0.6])
    assert table.loc["once", "successes"].tolist() == [2, 1]
    counted = results.running_times([0.5, 0.1], cost="evaluations")
    assert counted.loc["mine", "ert"].tolist() == [10, 50]
    unknown = Results(run("mine", 2.0))
    assert unknown.running_times().empty


def test_running_times_say_on_how_many_problems_each_planner_ran():
    """`once` ran on the easy one of two problems only: its time is not of the same problems."""
    items = [
        *run("exact", 2.0),
        *run("exact", 4.0, problem=OTHER),
        *searching("mine", [[[10, 2.1]]]),
        *searching("mine", [[[10, 4.1]]], problem=OTHER),
        *run("once", 2.1, 2.2),
    ]
    results = Results(items)
    assert results.running_times(0.1)["problems"].to_dict() == {
        ("exact", 0.1): 2,
        ("mine", 0.1): 2,
        ("once", 0.1): 1,
    }
    alike = results.only(common=True).running_times(0.1)
    assert set(alike["problems"]) == {1}


def test_paired_knows_who_is_better_on_each_problem():
    items = [
        *run("a", 2.0, 3.0),
        *run("b", 2.5),
        *run("a", 3.0, problem=OTHER),
        *run("b", -1.0, problem=OTHER),
    ]
    row = Results(items).paired().loc[("a", "b")]
    assert row[["problems", "better", "tied", "worse"]].tolist() == [2, 1, 1, 0]
    assert row["chance"] == (0.5 + 1) / 2


def test_a_motion_that_breaks_an_ignored_limit_is_ranked_as_any_that_breaks_one():
    """`exact` is first on one problem and last of four on the other, where it breaks a limit."""
    relaxed = run("exact", -1.5, relation=Relation.RELAXATION, problem=OTHER)
    items = [*run("exact", 1.0), *relaxed]
    for name, duration in (("a", 2.0), ("b", 3.0), ("c", 4.0)):
        items += [*run(name, duration), *run(name, duration, problem=OTHER)]
    ranks = mean_ranks(competing(Results(items).trials()))
    assert ranks.to_dict() == {"a": 1.5, "b": 2.5, "exact": 2.5, "c": 3.5}


def test_between_seeds_is_of_one_problem():
    items = [*run("a", 2.0, 3.0), *run("b", 4.0, 5.0), *run("a", 5.0, 6.0, problem=OTHER)]
    results = Results(items)
    for problem in ("one", PROBLEM.digest()):
        row = results.between_seeds(problem).loc[("a", "b")]
        assert row[["u", "chance"]].tolist() == [4, 1]
        assert row["pvalue"] == pytest.approx(2 / 6)
    assert Results(items[:4]).between_seeds().loc[("b", "a"), "u"] == 0
    assert results.between_seeds("two").empty
    for wrong in (None, "three"):
        with pytest.raises(InvalidInput, match="one of: one, two"):
            results.between_seeds(wrong)


def test_how_far_a_trajectory_leaves_its_position_limits_is_said():
    # 2.5 rad beyond the limit of 0.5 at the end; the smaller one keeps it, the third has none
    limits = Limits([10.0], [100.0], position=[[-1.0, 0.5]])
    out = Problem([[0.0], [0.4], [0.5]], limits, "within")
    inside = run("mine", 1.0)
    table = Results(as_runs([*inside, *leaving(out, 2.5), *leaving(out, 0.4)])).trials()
    np.testing.assert_allclose(table["position_excess"], [np.nan, 2.0, 0.0], atol=1e-12)
    row = Results(as_runs(leaving(out, 2.5) + leaving(out, 0.7))).summary().iloc[0]
    assert row["position_excess"] == pytest.approx(2.0)


def leaving(problem, furthest):
    """Straight pieces through `furthest` (rad) instead of the waypoint in the middle."""
    ends = np.array([problem.waypoints[0, 0], furthest, problem.waypoints[-1, 0]])
    trajectory = Trajectory([0, 1, 2], [np.diff(ends)[:, None], ends[:2, None]], [0, 1, 2])
    (trial,) = trials_of(Answering(trajectory), problem, [0], "leaving")
    return [trial]


class Answering(Fixed):
    def __init__(self, trajectory):
        super().__init__()
        self.trajectory = trajectory

    def solve(self, problem, *, seed=0):
        return Solution(Status.SOLVED, self.trajectory)


def test_frames_are_built_once_and_handed_out_as_copies(monkeypatch):
    results = Results([*run("exact", 2.0), *run("mine", 3.0)])
    first = {name: getattr(results, name)() for name in ("trials", "gaps", "summary")}
    monkeypatch.setattr("trajopt.benchmark.store.fields.columns", None)
    for name, frame in first.items():
        frame["label"] = "spoiled"
        assert "mine" in getattr(results, name)()["label"].tolist()
    assert len(results.paired()) == 2


@pytest.mark.parametrize("name", ["references", "summary"])
def test_the_docstring_lists_the_columns(name):
    frame = getattr(Results([*run("exact", 2.0), *run("mine", 3.0)]), name)()
    words = set(re.findall(r"\w+", getattr(Results, name).__doc__))
    assert set(frame.columns) <= words


def test_trials_have_a_column_for_each_field_of_the_store():
    trials = Results(run("mine", 2.0)).trials()
    (row,) = trials.to_dict("records")
    assert row["relation"] == "RESTRICTION"
    assert (row["options"], row["joint_names"], row["feasible"]) == ("{}", "", True)
    assert list(trials) == [*(field.name for field in FIELDS), "group"]


def test_no_trials_have_an_empty_summary():
    assert Results([]).summary().empty
    assert Results([]).gaps().empty


def test_of_tied_rows_the_optimum_is_first_and_then_the_name_decides():
    named = {
        "exact-jerk": (2.0,),
        "b": (3.0 - 1e-8,),  # 3 s to six digits
        "exact": (2.0 + 1e-9,),
        "a": (3.0,),
        "gives up": (-1.0,),
        "prove": (2.0 - 1e-9,),
        "faster": (1.9,),
    }
    trials = []
    for name, durations in named.items():
        trials += trials_of(Fixed(*durations), PROBLEM, [0], name)
    expected = ["faster", "exact", "exact-jerk", "prove", "a", "b", "gives up"]
    for given in (trials, trials[::-1]):
        results = Results(given)
        assert [line.label for line in results.lines()] == expected
        assert results.planners().index.tolist() == expected
