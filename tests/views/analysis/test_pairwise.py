"""Planners against each other, by hand, by SciPy and statsmodels, and by counting pairs of runs."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy import inf, nan
from numpy.testing import assert_allclose
from scipy import stats
from statsmodels.stats.multitest import multipletests

from trajopt.views import table_cells
from trajopt.views.analysis.pairwise import (
    _seed_row,
    against,
    between_seeds,
    mean_ranks,
    medians,
    paired_tests,
    pairs_by_problem,
)


def runs(**planners):
    """Per planner, per problem, the certified durations of its runs (NaN: none; []: not run)."""
    rows = [
        (str(i), label, d)
        for label, problems in planners.items()
        for i, own in enumerate(problems)
        for d in own
    ]
    table = pd.DataFrame(rows, columns=["digest", "label", "certified_duration"])
    return table.assign(group=table["digest"])


def compared(**planners):
    return paired_tests(pairs_by_problem(runs(**planners)))


def random_runs(seed=0, problems=12):
    """Three planners, a few failures, a few ties, different numbers of runs."""
    rng = np.random.default_rng(seed)

    def one(count, factor):
        found = np.round(factor * rng.lognormal(0, 0.2, (problems, count)), 2)
        found[rng.random(found.shape) < 0.15] = nan
        return found.tolist()

    return runs(a=one(5, 1.0), b=one(5, 1.1), c=one(1, 1.2))


def test_by_hand():
    table = compared(a=[[1, 2, 3], [4], [nan]], b=[[2, 2, 2], [2], [5]])
    row = table.loc[("a", "b")]
    assert row[["problems", "better", "tied", "worse"]].tolist() == [3, 0, 1, 2]
    assert row["ratio"] == 2  # of 1, 2 and ∞
    assert row["chance"] == pytest.approx((0.5 + 0 + 0) / 3)
    assert row["pvalue"] == row["holm"] == 0.5  # two differences of one sign: 2 / 2²


def test_the_other_way_round_is_the_mirror():
    table = paired_tests(pairs_by_problem(random_runs()))
    for a, b in table.index:
        one, other = table.loc[(a, b)], table.loc[(b, a)]
        assert one[["better", "tied", "worse"]].tolist() == (
            other[["worse", "tied", "better"]].tolist()
        )
        assert one["ratio"] == pytest.approx(1 / other["ratio"])
        assert_allclose(one[["chance", "low", "high"]], 1 - other[["chance", "high", "low"]])
        assert one[["pvalue", "holm"]].tolist() == other[["pvalue", "holm"]].tolist()


@pytest.mark.parametrize("seed", range(4))
def test_against_scipy_statsmodels_and_counting(seed):
    runs = random_runs(seed, problems=9)  # all signs: 512 of them
    table = paired_tests(pairs_by_problem(runs))
    own = runs.fillna(inf)
    middle = own.groupby(["digest", "label"])["certified_duration"].median().unstack()
    pvalues = []
    for a, b in (("a", "b"), ("a", "c"), ("b", "c")):
        row = table.loc[(a, b)]
        x = middle[a].to_numpy()
        y = middle[b].to_numpy()
        assert [row["better"], row["tied"], row["worse"]] == [
            (x < y).sum(),
            (x == y).sum(),
            (x > y).sum(),
        ]
        apart = x != y
        # No answer is a ratio beyond all others: e⁹⁹ stands for it.
        logs = np.clip(np.log(x[apart]) - np.log(y[apart]), -99, 99)
        expected = stats.wilcoxon(logs, method=stats.PermutationMethod()).pvalue
        assert row["pvalue"] == pytest.approx(expected, abs=1e-9)
        pvalues.append(row["pvalue"])
        shares = [
            np.mean(
                [
                    (p < q) + (p == q) / 2
                    for p, q in product(
                        *(g.query("label == @k")["certified_duration"] for k in (a, b))
                    )
                ]
            )
            for _, g in own.groupby("digest")
        ]
        assert row["chance"] == pytest.approx(np.mean(shares))
        assert row["low"] <= row["chance"] <= row["high"]
        normal = 1.96 * np.std(shares) / np.sqrt(len(shares))
        assert row["high"] - row["low"] > 2 * normal  # no outcomes spread more than yes and no
    adjusted = multipletests(pvalues, method="holm")[1]
    assert_allclose([table.loc[k, "holm"] for k in (("a", "b"), ("a", "c"), ("b", "c"))], adjusted)


def test_equal_to_six_digits_is_tied_and_no_answer_ties_with_none():
    row = compared(a=[[1.0], [2.0], [nan]], b=[[1.0000001], [2.0001], [nan]]).loc[("a", "b")]
    assert row[["better", "tied", "worse"]].tolist() == [1, 2, 0]
    assert row["ratio"] == 1
    assert row["chance"] == pytest.approx((0.5 + 1 + 0.5) / 3)


@pytest.mark.parametrize(
    ("a", "b", "ratio"),
    [
        ([1, 2, 8], [2, 2, 2], 1),
        ([1, 8], [2, 2], np.sqrt(0.5 * 4)),
        ([nan, nan, 1], [1, 1, 1], inf),
        ([1, 1, 1], [nan, nan, 1], 0),
        ([nan, 1], [1, nan], nan),
    ],
)
def test_the_median_ratio(a, b, ratio):
    table = compared(a=[[v] for v in a], b=[[v] for v in b])
    assert_allclose(table.loc[("a", "b"), "ratio"], ratio)


def test_a_missing_answer_is_the_largest_difference_however_small_the_other_is():
    # Ranks: −1, −2, −3, −4, then +5 for the failure, so W = 5: 10 of the 32 sign patterns.
    a, b = ([[1.0], [1.0], [1.0], [1.0], [nan]], [[1.1], [1.2], [1.3], [100.0], [1.0]])
    below = sum(np.dot(s, [1, 2, 3, 4, 5]) <= 5 for s in product([0, 1], repeat=5))
    assert compared(a=a, b=b).loc[("a", "b"), "pvalue"] == pytest.approx(2 * below / 32)


def test_only_the_problems_that_both_were_run_on_count():
    table = compared(a=[[1], [1], []], b=[[2], [], [2]], c=[[], [], [5]])
    assert table.loc[("a", "b"), "problems"] == 1
    assert ("a", "c") not in table.index
    assert len(table) == 4
    assert table.loc[("a", "b"), "low"] < 0.5  # one problem proves nothing


def test_one_planner_has_nobody_to_meet():
    table = compared(a=[[1.0], [2.0]])
    assert table.empty
    assert table.index.names == ["planner", "against"]


def test_medians_know_no_answer_from_not_run():
    table = medians(runs(a=[[1, 3, nan], [nan, nan]], b=[[2], []]))
    assert table.loc["0"].tolist() == [3, 2]
    assert table.loc["1", "a"] == inf
    assert np.isnan(table.loc["1", "b"])


# Problems that both answer


def test_slower_on_21_of_22_common_problems_is_shown_where_both_answer():
    """It answers on 8 problems more: over all of them, the missing answers outrank the rest."""
    fast = [[1.0 + k / 100] for k in range(22)]
    slow = [[1.1 + k / 50] for k in range(22)]
    slow[0] = [0.9]
    table = compared(fast=fast + [[nan]] * 8, slow=slow + [[1.0]] * 8)
    row = table.loc[("slow", "fast")]
    assert row["pvalue"] > 0.05
    assert row[["both", "both_better", "both_tied", "both_worse"]].tolist() == [22, 1, 0, 21]
    logs = np.log(np.ravel(slow)) - np.log(np.ravel(fast))
    assert row["both_pvalue"] == pytest.approx(stats.wilcoxon(logs, method="exact").pvalue)
    assert row["both_holm"] == row["both_pvalue"] < 1e-4
    assert row["both_ratio"] == pytest.approx(np.exp(np.median(logs)), rel=1e-5)


def test_where_both_answer_by_hand_and_mirrored():
    table = compared(a=[[1], [4], [nan], [2]], b=[[2], [2], [5], [nan]])
    row = table.loc[("a", "b")]
    assert row[["both", "both_better", "both_tied", "both_worse"]].tolist() == [2, 1, 0, 1]
    assert row["both_ratio"] == pytest.approx(1)
    assert row["both_pvalue"] == 1
    mirror = table.loc[("b", "a")]
    assert mirror[["both_better", "both_worse"]].tolist() == [1, 1]
    assert mirror["both_ratio"] == pytest.approx(1)


def test_no_common_answer_says_nothing_of_both():
    row = compared(a=[[1], [nan]], b=[[nan], [1]]).loc[("a", "b")]
    assert row["both"] == 0
    assert np.isnan(row["both_ratio"])
    assert row["both_pvalue"] == row["both_holm"] == 1


def test_pvalues_where_both_answer_are_a_family_of_their_own():
    table = paired_tests(pairs_by_problem(random_runs(2)))
    once = table.loc[[("a", "b"), ("a", "c"), ("b", "c")]]
    assert_allclose(once["both_holm"], multipletests(once["both_pvalue"], method="holm")[1])


def test_problems_of_one_group_count_as_one():
    table = runs(a=[[1]] * 6, b=[[2]] * 6)
    apart = paired_tests(pairs_by_problem(table)).loc[("a", "b")]
    assert (apart["problems"], apart["groups"]) == (6, 6)
    assert apart["pvalue"] == pytest.approx(2 / 2**6)
    together = paired_tests(pairs_by_problem(table.assign(group="ur5e"))).loc[("a", "b")]
    assert (together["better"], together["problems"], together["groups"]) == (6, 6, 1)
    assert together["pvalue"] == 1
    assert together["low"] < apart["low"]


# Between seeds on one problem


def test_between_seeds_by_hand():
    table = between_seeds(runs(a=[[1, 2, 3]], b=[[4, 5, nan]], alone=[[1]]))
    assert table.index.tolist() == [("a", "b"), ("b", "a")]
    row = table.loc[("a", "b")]
    assert row[["runs", "rival_runs", "median", "rival_median"]].tolist() == [3, 3, 2, 5]
    assert row["ratio"] == pytest.approx(0.4)
    assert row[["u", "chance", "high"]].tolist() == [9, 1, 1]
    assert 0 < row["low"] < 1  # three runs each prove little
    assert row["pvalue"] == row["holm"] == pytest.approx(0.1)
    mirror = table.loc[("b", "a")]
    assert mirror[["u", "chance", "median", "rival_median"]].tolist() == [0, 0, 5, 2]
    assert mirror["ratio"] == pytest.approx(2.5)


def test_between_thirty_seeds_a_difference_is_told():
    """One problem: over problems, p = 1 whatever the seeds say."""
    rng = np.random.default_rng(0)
    a = rng.normal(4.4, 0.05, 30)
    b = rng.normal(4.5, 0.05, 30)
    c = rng.normal(4.5, 0.05, 30)
    frame = runs(a=[a], b=[b], c=[c])
    assert paired_tests(pairs_by_problem(frame))["pvalue"].tolist() == [1] * 6
    table = between_seeds(frame)
    pairs = {("a", "b"): (a, b), ("a", "c"): (a, c), ("b", "c"): (b, c)}
    expected = [stats.mannwhitneyu(x, y, method="exact").pvalue for x, y in pairs.values()]
    once = table.loc[list(pairs)]
    assert_allclose(once["pvalue"], expected, rtol=1e-6)
    assert_allclose(once["holm"], multipletests(expected, method="holm")[1], rtol=1e-6)
    assert (once["holm"] < 0.001).tolist() == [True, True, False]
    for key, (x, y) in pairs.items():
        share = np.mean([p < q for p, q in product(x, y)])
        assert once.loc[key, "chance"] == pytest.approx(share)
        found = stats.bootstrap(
            (x, y),
            lambda u, v: np.mean(u[:, None] < v),
            vectorized=False,
            n_resamples=999,
            method="percentile",
            rng=1,
        ).confidence_interval
        assert_allclose(once.loc[key, ["low", "high"]].astype(float), found, atol=0.05)


def test_between_seeds_in_whichever_order_the_trials_were_read():
    rng = np.random.default_rng(2)
    frame = runs(a=[rng.normal(4.4, 0.1, 20)], b=[rng.normal(4.5, 0.1, 20)])
    shuffled = frame.sample(frac=1, random_state=1)
    pd.testing.assert_frame_equal(between_seeds(frame), between_seeds(shuffled))


def test_between_seeds_where_nobody_answers():
    row = between_seeds(runs(a=[[nan, nan]], b=[[nan, nan, nan]])).loc[("a", "b")]
    assert np.isnan(row["ratio"])
    assert row[["u", "chance", "pvalue"]].tolist() == [3, 0.5, 1]
    assert between_seeds(runs(a=[[1.0]], b=[[2.0, 3.0]])).empty


# Ranks


def test_mean_ranks_by_hand():
    table = runs(a=[[1], [2], [nan]], b=[[2], [2.0000001], [3]], c=[[3], [5], [2]], d=[[1], [1]])
    # 1 2 3, then 1½ 1½ 3, then 3 2 1; d was not run on all
    assert mean_ranks(table).to_dict() == {
        "a": pytest.approx(5.5 / 3),
        "b": pytest.approx(5.5 / 3),
        "c": pytest.approx(7 / 3),
    }
    assert mean_ranks(runs(a=[[1]], b=[[2]])).empty


def proved(own, theirs, bounds):
    """Return the row of `a` against `b` on problems with these durations and bounds."""
    table = runs(a=[[d] for d in own], b=[[nan if d == inf else d] for d in theirs])
    digests = table["digest"].unique()
    known = pd.Series(bounds, index=digests, dtype=float)
    return paired_tests(pairs_by_problem(table, known)).loc[("a", "b")]


@pytest.mark.parametrize(
    ("own", "theirs", "bounds", "decided"),
    [
        ([1.0], [2.9], [1.0], True),  # the bound is met: nothing can be shorter
        ([1.0], [2.9], [0.9], False),  # a shorter motion is not excluded
        ([1.0], [2.9], [nan], False),
        ([1.0], [1.0], [1.0], False),  # a tie
        ([1.0005], [1.0007], [1.0], False),  # less apart than the proof leaves open
        ([1.0, 2.9], [2.9, 1.0], [1.0, 1.0], False),  # one each
        ([1.0, 1.0], [2.9, 1.0], [1.0, 1.0], True),  # one longer, one tied
        ([1.0], [inf], [1.0], False),  # no answer is no duration
    ],
)
def test_a_bound_decides_where_it_can(own, theirs, bounds, decided):
    assert bool(proved(own, theirs, bounds)["proved"]) == decided


def test_what_is_proved_on_some_problems_is_not_denied():
    """On the third problem the bound is far below, so that it decides nothing there."""
    row = proved([1.0, 1.0, 1.0], [2.0, 3.0, 1.5], [1.0, 1.0, 0.5])
    assert (row["proved"], row["decided"]) == (0, 2)
    assert table_cells.evidence(row) == "proved on 2 of 3"
    row = proved([1.0, 3.0, 1.0], [2.0, 1.0, 1.0], [1.0, 1.0, 1.0])  # one each, and a tie
    assert (row["proved"], row["decided"]) == (0, 2)


def test_what_is_proved_is_not_tested():
    """Of three pairs two are proved, so one is tested: its p is not multiplied."""
    table = runs(a=[[1.0], [1.0]], b=[[2.0], [2.0]], c=[[2.5], [2.5]])
    known = pd.Series(1.0, index=table["digest"].unique())
    found = paired_tests(pairs_by_problem(table, known))
    assert found["proved"].tolist() == [1, 1, 1, 0, 1, 0]
    assert np.isnan(found.loc[("a", "b"), "holm"])
    assert found.loc[("b", "c"), "holm"] == found.loc[("b", "c"), "pvalue"] == 0.5
    assert np.isnan(against(found, "a")["holm"]).all()


def test_what_one_family_cannot_test_is_said_so():
    """With n families the smallest p is 2/2ⁿ."""
    row = SimpleNamespace(proved=False, groups=1, holm=1.0)
    assert table_cells.evidence(row) == "one family: cannot be tested"
    assert (
        2 / 2**table_cells.FEWEST_GROUPS
        < table_cells.SURE
        < 2 / 2 ** (table_cells.FEWEST_GROUPS - 1)
    )
    row = SimpleNamespace(proved=True, groups=1, holm=1.0)
    assert table_cells.evidence(row) == "proved"
    row = SimpleNamespace(proved=False, groups=9, holm=0.01)
    assert table_cells.evidence(row) == "yes"


def test_a_planner_without_an_answer_is_infinitely_slower():
    """Between seeds: no number where neither has one."""
    never, answers = np.full(3, np.inf), np.array([1.0, 2.0, 3.0])
    assert _seed_row(never, answers)["ratio"] == np.inf
    assert _seed_row(answers, never)["ratio"] == 0
    assert np.isnan(_seed_row(never, never)["ratio"])
