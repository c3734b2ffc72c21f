"""Planners against each other, by hand, by SciPy and statsmodels, and by counting pairs of runs."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from numpy import inf, nan
from numpy.testing import assert_allclose
from scipy import stats
from statsmodels.stats.multitest import multipletests

from trajopt.benchmark.analysis.pairwise import duels, medians, paired


def runs(**planners):
    """Per planner, per problem, the certified durations of its runs (NaN: none; []: not run)."""
    rows = [(str(i), label, d) for label, problems in planners.items()
            for i, own in enumerate(problems) for d in own]  # fmt: skip
    return pd.DataFrame(rows, columns=["digest", "label", "certified_duration"])


def compared(**planners):
    return paired(duels(runs(**planners)))


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
    assert row["a12"] == pytest.approx((0.5 + 0 + 0) / 3)
    assert row["pvalue"] == row["holm"] == 0.5  # two differences of one sign: 2 / 2²


def test_the_other_way_round_is_the_mirror():
    table = paired(duels(random_runs()))
    for a, b in table.index:
        one, other = table.loc[(a, b)], table.loc[(b, a)]
        assert one[["better", "tied", "worse"]].tolist() == (
            other[["worse", "tied", "better"]].tolist()
        )
        assert one["ratio"] == pytest.approx(1 / other["ratio"])
        assert_allclose(one[["a12", "low", "high"]], 1 - other[["a12", "high", "low"]])
        assert one[["pvalue", "holm"]].tolist() == other[["pvalue", "holm"]].tolist()


@pytest.mark.parametrize("seed", range(4))
def test_against_scipy_statsmodels_and_counting(seed):
    table, own = paired(duels(random_runs(seed))), random_runs(seed).fillna(inf)
    middle = own.groupby(["digest", "label"])["certified_duration"].median().unstack()
    pvalues = []
    for a, b in (("a", "b"), ("a", "c"), ("b", "c")):
        row = table.loc[(a, b)]
        x, y = middle[a].to_numpy(), middle[b].to_numpy()
        assert [row["better"], row["tied"], row["worse"]] == [
            (x < y).sum(), (x == y).sum(), (x > y).sum()
        ]  # fmt: skip
        apart = x != y
        # No answer is a ratio beyond all others: e⁹⁹ stands for it.
        logs = np.clip(np.log(x[apart]) - np.log(y[apart]), -99, 99)
        expected = stats.wilcoxon(logs, method=stats.PermutationMethod()).pvalue
        assert row["pvalue"] == pytest.approx(expected, abs=1e-9)
        pvalues.append(row["pvalue"])
        shares = [
            np.mean([(p < q) + (p == q) / 2 for p, q in product(*(g.query("label == @k")[
                "certified_duration"] for k in (a, b)))])
            for _, g in own.groupby("digest")
        ]  # fmt: skip
        assert row["a12"] == pytest.approx(np.mean(shares))
        assert row["low"] <= row["a12"] <= row["high"]
        normal = 1.96 * np.std(shares) / np.sqrt(len(shares))
        assert row["high"] - row["low"] == pytest.approx(2 * normal, rel=0.15)
    adjusted = multipletests(pvalues, method="holm")[1]
    assert_allclose([table.loc[k, "holm"] for k in (("a", "b"), ("a", "c"), ("b", "c"))], adjusted)


def test_equal_to_six_digits_is_tied_and_no_answer_ties_with_none():
    row = compared(a=[[1.0], [2.0], [nan]], b=[[1.0000001], [2.0001], [nan]]).loc[("a", "b")]
    assert row[["better", "tied", "worse"]].tolist() == [1, 2, 0]
    assert row["ratio"] == 1
    assert row["a12"] == pytest.approx((0.5 + 1 + 0.5) / 3)


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
    a, b = [[1.0], [1.0], [1.0], [1.0], [nan]], [[1.1], [1.2], [1.3], [100.0], [1.0]]
    below = sum(np.dot(s, [1, 2, 3, 4, 5]) <= 5 for s in product([0, 1], repeat=5))
    assert compared(a=a, b=b).loc[("a", "b"), "pvalue"] == pytest.approx(2 * below / 32)


def test_only_the_problems_that_both_were_run_on_count():
    table = compared(a=[[1], [1], []], b=[[2], [], [2]], c=[[], [], [5]])
    assert table.loc[("a", "b"), "problems"] == 1
    assert ("a", "c") not in table.index
    assert len(table) == 4
    assert np.isnan(table.loc[("a", "b"), "low"])


def test_one_planner_has_nobody_to_meet():
    table = compared(a=[[1.0], [2.0]])
    assert table.empty
    assert table.index.names == ["planner", "against"]


def test_medians_know_no_answer_from_not_run():
    table = medians(runs(a=[[1, 3, nan], [nan, nan]], b=[[2], []]), "certified_duration")
    assert table.loc["0"].tolist() == [3, 2]
    assert table.loc["1", "a"] == inf
    assert np.isnan(table.loc["1", "b"])
