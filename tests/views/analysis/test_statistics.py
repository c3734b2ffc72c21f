"""Statistics against statsmodels, scikit-posthocs, published numbers, enumeration and loops."""

from functools import partial
from itertools import product

import numpy as np
import pytest
import scikit_posthocs
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy import inf, nan
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.nonparametric import rank_compare_2indep
from statsmodels.stats.proportion import proportion_confint

from trajopt.core.exceptions import InvalidInput
from trajopt.views.analysis.statistics import (
    Estimate,
    Paired,
    bootstrap,
    critical_difference,
    ecdf,
    evaluations_to_target,
    expected_running_time,
    fixed_budget,
    holm,
    mann_whitney,
    mean_interval,
    mean_ranks,
    median,
    performance_profile,
    quantile,
    quartiles_over_runs,
    shorter_chance,
    shorter_interval,
    success_rate,
    wilcoxon,
)

reproducible = settings(deadline=None, derandomize=True, max_examples=100)
few = st.sampled_from([0.5, 1.0, 1.5, 2.0, 3.0, inf, nan])  # many ties, many failures
samples = st.lists(few, min_size=1, max_size=12)
tables = arrays(float, st.tuples(st.integers(1, 8), st.integers(1, 4)), elements=few)


# Shares and quantiles


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),  # Newcombe 1998, Statistics in Medicine 17, table I, method 3
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_success_rate_has_the_published_wilson_intervals(k, n, low, high):
    rate = success_rate(np.arange(n) < k)
    assert rate.value == k / n
    assert (round(rate.low, 4), round(rate.high, 4)) == (low, high)


@pytest.mark.parametrize(("k", "n"), [(0, 1), (1, 1), (7, 7), (3, 10), (999, 1000)])
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_success_rate_agrees_with_statsmodels(k, n, confidence):
    rate = success_rate(np.arange(n) < k, confidence)
    expected = proportion_confint(k, n, 1 - confidence, method="wilson")
    assert_allclose((rate.low, rate.high), expected, atol=1e-12)


@given(samples, st.floats(0, 1))
@reproducible
def test_quantile_is_numpys_with_a_huge_number_for_no_answer(values, q):
    stand_in = np.nan_to_num(np.array(values), nan=1e200, posinf=1e200)
    expected = np.quantile(stand_in, q)
    if expected > 1e180:
        assert quantile(values, q) == inf
    else:
        assert_allclose(quantile(values, q), expected, rtol=1e-8)


def test_quantile_at_a_run_does_not_touch_the_failure_beside_it():
    values = np.r_[np.arange(56.0), np.full(45, inf)]
    assert quantile(values, 0.55) == 55  # 0.55 · 100 is 55.00000000000001 in floating point
    assert_array_equal(quantile([1, 2, inf], [0, 0.5, 1]), [1, 2, inf])


def test_a_planner_that_fails_half_the_time_has_median_infinity():
    assert median([0.1, 0.2, nan, nan]) == inf
    assert median([0.1, 0.2, 0.3, nan, nan]) == 0.3
    assert median([nan]) == inf
    assert_array_equal(median([[1, 3], [2, nan], [nan, inf]]), [2, inf, inf])


def test_ecdf_by_hand():
    assert_array_equal(ecdf([3, 1, nan, 1], [0, 1, 2.9, 3, inf]), [0, 0.5, 0.5, 0.75, 0.75])
    assert_array_equal(ecdf([nan, inf], [0, inf]), [0, 0])


@given(samples.filter(lambda values: np.isfinite(values).any()))
@reproducible
def test_ecdf_agrees_with_scipy_where_runs_without_an_answer_are_censored(values):
    runs = np.array(values)
    solved = np.isfinite(runs)
    data = stats.CensoredData(uncensored=runs[solved], right=np.full((~solved).sum(), 9.0))
    expected = stats.ecdf(data).cdf
    x = np.unique(runs[solved])
    assert_allclose(ecdf(runs, x), expected.evaluate(x), atol=1e-12)


# Runs and their cost

HISTORIES = [
    np.array([[20, inf], [30, nan], [45, 9.0], [60, 8.0], [90, 8.0]]),
    np.array([[1, 10.0], [50, 7.0], [80, 6.0]]),
    np.array([[100, nan]]),
    np.empty((0, 2)),
]


def test_evaluations_to_target_by_hand():
    assert_array_equal(evaluations_to_target(HISTORIES, 8.0), [60, 50, nan, nan])
    several = evaluations_to_target(HISTORIES, [inf, 10, 9, 7, 6, 5.9])
    assert several.shape == (6, 4)
    assert_array_equal(several[:, 0], [45, 45, 45, nan, nan, nan])
    assert_array_equal(several[:, 1], [1, 1, 50, 50, 80, nan])
    assert np.isnan(several[:, 2:]).all()


def test_fixed_budget_by_hand():
    assert_array_equal(fixed_budget(HISTORIES, 45), [9, 10, nan, nan])
    several = fixed_budget(HISTORIES, [0, 44, 45, 60, 1e9])
    assert_array_equal(several[:, 0], [nan, nan, 9, 8, 8])
    assert_array_equal(several[:, 1], [nan, 10, 10, 7, 6])
    assert_array_equal(median(several), [inf, inf, inf, inf, inf])
    assert_array_equal(median(several[:, :2]), [inf, inf, 9.5, 7.5, 7])


def test_a_history_that_rises_keeps_its_best():
    # a better claim may certify worse
    rising = [[[10, 5.0], [20, 7.0], [30, 4.0]]]
    assert_array_equal(fixed_budget(rising, [10, 25, 30]), [[5], [5], [4]])
    assert_array_equal(evaluations_to_target(rising, [7, 5, 4]), [[10], [10], [30]])


def test_quartiles_over_runs_by_hand():
    quartiles = quartiles_over_runs(HISTORIES, [45, 60, 1e9])
    # the best at 45 evaluations: 9, 10 and two without; at 60: 8, 7; at the end: 8, 6
    assert_array_equal(quartiles, [[9.75, 7.75, 7.5], [inf] * 3, [inf] * 3])
    assert_array_equal(quartiles_over_runs(HISTORIES[:2], 45), [[9.25], [9.5], [9.75]])


def monotone(rows):
    """Evaluations rising, best falling, NaN first."""
    spent = np.sort([n for n, _ in rows]).astype(float)
    best = np.sort([inf if np.isnan(x) else x for _, x in rows])[::-1]
    return np.column_stack([spent, np.where(best == inf, nan, best)]).reshape(-1, 2)


@given(st.lists(st.tuples(st.integers(0, 9), few), max_size=8).map(monotone), st.integers(0, 10))
@reproducible
def test_histories_read_row_by_row(history, step):
    target, budget = step / 3, step
    hit = next((n for n, x in history if x <= target), nan)
    best = min((x for n, x in history if n <= budget and x == x), default=nan)
    assert_array_equal(evaluations_to_target([history], target), [hit])
    assert_array_equal(fixed_budget([history], budget), [best])
    reached = hit <= budget
    assert (fixed_budget([history], budget)[0] <= target) == reached  # two views of one thing


def test_expected_running_time_by_hand():
    assert expected_running_time([10, 20, nan, nan], 100) == (10 + 20 + 200) / 2
    assert expected_running_time([10, 20, inf, nan], [50, 50, 60, 70]) == (10 + 20 + 130) / 2
    assert expected_running_time([10, 20], 15) == 25  # a hit beyond its budget is a miss
    assert expected_running_time([nan, nan], 100) == inf
    assert expected_running_time([0.0], 100) == 0
    table = expected_running_time([[1, 2, 3], [nan, 4, 6], [nan] * 3], [10, 11, 12])
    assert_array_equal(table, [2, 10, inf])


def test_expected_running_time_is_what_restarts_cost():
    # Hansen et al. 2021, section 5: run until success, restarting; the mean is the ERT
    rng = np.random.default_rng(1)
    hits = np.array([40, 70, 90, nan, nan, nan, nan])
    budget = 100
    costs = []
    for _ in range(20_000):
        cost = 0.0
        while np.isnan(hit := hits[rng.integers(7)]):
            cost += budget
        costs.append(cost + hit)
    error = np.std(costs) / np.sqrt(len(costs))
    assert abs(expected_running_time(hits, budget) - np.mean(costs)) < 4 * error


# Profiles


def test_performance_profile_by_hand():
    costs = [[1, 2, 4], [3, 3, nan], [10, 5, 20], [nan, nan, inf]]
    assert_array_equal(
        performance_profile(costs, [1, 2, 4]), [[0.5, 0.5, 0], [0.75, 0.75, 0], [0.75, 0.75, 0.5]]
    )
    assert_array_equal(performance_profile(costs, [0.9, 3]), [[0, 0, 0], [0.75, 0.75, 0]])
    assert_array_equal(performance_profile([[nan, nan]], [inf]), [[0, 0]])
    assert_array_equal(performance_profile([[1e-300, 1e300]], [1, 1e308]), [[1, 0], [1, 0]])


@given(tables, st.floats(1, 7))
@reproducible
def test_performance_profile_counts_problems_within_a_factor_of_the_best(costs, tau):
    (shares,) = performance_profile(costs, [tau])
    for solver, share in enumerate(shares):
        solved = [row[solver] <= tau * np.nanmin(row) for row in costs if np.isfinite(row).any()]
        assert share == pytest.approx(sum(solved) / len(costs))


# Tests

DEPRESSION = (  # Hollander & Wolfe 1973, p. 29
    [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30],
    [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29],
)


def test_wilcoxon_on_the_depression_scores():
    before, after = DEPRESSION
    assert wilcoxon(before, after) == Paired(
        5.0, pytest.approx(0.0390625), wins=2, ties=0, losses=7
    )
    assert wilcoxon(after, before) == Paired(
        5.0, pytest.approx(0.0390625), wins=7, ties=0, losses=2
    )


def by_enumeration(differences):
    """Two-sided p over all signs of the mid-ranks of the differences that are not 0."""
    d = np.array([x for x in differences if x])
    size = np.abs(d)
    ranks = np.array([(size < x).sum() + ((size == x).sum() + 1) / 2 for x in size])
    sums = np.zeros(1)
    for rank in ranks:
        sums = np.concatenate([sums, sums + rank])
    seen = ranks[d > 0].sum()
    return min(1, 2 * min((sums <= seen).mean(), (sums >= seen).mean()))


@given(st.lists(st.integers(-4, 4), min_size=1, max_size=10))
@settings(deadline=None, derandomize=True, max_examples=40)
def test_wilcoxon_is_exact_on_few_pairs_with_ties_and_zeros(differences):
    test = wilcoxon(np.array(differences) + 10, np.full(len(differences), 10))
    assert test.pvalue == pytest.approx(by_enumeration(differences))
    counts = [np.less, np.equal, np.greater]
    assert (test.wins, test.ties, test.losses) == tuple(c(differences, 0).sum() for c in counts)


@pytest.mark.parametrize("seed", range(4))
def test_wilcoxon_is_exact_on_twenty_pairs_with_ties_and_failures(seed):
    d = np.round(np.random.default_rng(seed).normal(0.6, 2, 20))
    d[0] = inf
    test = wilcoxon(np.maximum(d, 0), np.maximum(-d, 0))
    assert test.pvalue == pytest.approx(by_enumeration(d), rel=1e-12)


@pytest.mark.parametrize("n", [14, 50])
def test_wilcoxon_without_ties_is_scipys_exact_one(n):
    d = np.random.default_rng(n).normal(0.3, 1, n)
    expected = stats.wilcoxon(d, method="exact")
    test = wilcoxon(d, np.zeros(n))
    assert test.pvalue == pytest.approx(expected.pvalue, rel=1e-9)
    assert test.statistic == expected.statistic


def test_wilcoxon_of_many_pairs_is_scipys_normal_one():
    d = np.round(np.random.default_rng(1).normal(0.3, 1, 51), 1)
    d[d == 0] = 9
    expected = stats.wilcoxon(d, method="asymptotic").pvalue
    assert wilcoxon(d, np.zeros(51)).pvalue == pytest.approx(expected)


def test_wilcoxon_stays_exact_when_most_of_many_pairs_are_equal():
    a = np.ones(50)
    b = np.ones(50)
    a[:3] = 2, 3, 4
    assert wilcoxon(a, b) == Paired(0.0, 0.25, wins=0, ties=47, losses=3)


def test_wilcoxon_without_differences_is_sure_of_nothing():
    assert wilcoxon([1, nan, inf], [1, inf, nan]) == Paired(0.0, 1.0, 0, 3, 0)
    assert wilcoxon([1], [2]).pvalue == 1
    assert wilcoxon([1e308], [-1e308]).pvalue == 1


def test_wilcoxon_counts_a_failure_as_the_largest_difference():
    a, b = [1, 2, 3, 4, 5, 6], [1.1, 2.2, 3.3, 4.4, 5.5, nan]
    assert wilcoxon(a, b).pvalue == pytest.approx(2 / 2**6)
    assert wilcoxon([*a[:5], nan], [*b[:5], 6]) == Paired(6.0, pytest.approx(14 * 2 / 64), 5, 0, 1)


@pytest.mark.parametrize("n", [20, 60, 1000])
def test_wilcoxon_on_many_pairs_is_near_a_permutation_test(n):
    rng = np.random.default_rng(n)
    d = np.round(rng.normal(0.2, 1, n), 1)  # with ties and zeros
    kept = d[d != 0]
    ranks = stats.rankdata(np.abs(kept))
    sums = (rng.random((20_000, kept.size)) < 0.5) @ ranks
    seen = ranks[kept > 0].sum()
    expected = 2 * min((sums <= seen).mean(), (sums >= seen).mean())
    assert wilcoxon(d, np.zeros(n)).pvalue == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("n", [1, 2, 5, 24])
def test_holm_agrees_with_statsmodels(n):
    pvalues = np.round(np.random.default_rng(n).beta(0.3, 2, n), 2)  # with zeros and ties
    assert_allclose(holm(pvalues), multipletests(pvalues, method="holm")[1], rtol=1e-12)


@given(st.lists(st.sampled_from([0, 1e-300, 0.01, 0.02, 0.05, 0.3, 1]), max_size=9))
@reproducible
def test_holm_rejects_as_stepping_down_does(pvalues):
    rejected = np.zeros(len(pvalues), bool)
    for left, i in enumerate(np.argsort(pvalues)):  # Holm 1979: stop at the first that stays
        if pvalues[i] * (len(pvalues) - left) > 0.05:
            break
        rejected[i] = True
    assert_array_equal(holm(pvalues) <= 0.05, rejected)


def test_holm_by_hand_and_its_edges():
    assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    assert_allclose(holm([[0.01, 0.04], [0.03, 0.005]]), [[0.03, 0.06], [0.06, 0.02]])
    assert holm([]).shape == (0,)
    assert_array_equal(holm([0.2]), [0.2])


AUC = np.array(  # Demšar 2006, table 6: C4.5, C4.5+m, C4.5+cf, C4.5+m+cf on 14 data sets
    [
        [0.763, 0.768, 0.771, 0.798],
        [0.599, 0.591, 0.590, 0.569],
        [0.954, 0.971, 0.968, 0.967],
        [0.628, 0.661, 0.654, 0.657],
        [0.882, 0.888, 0.886, 0.898],
        [0.936, 0.931, 0.916, 0.931],
        [0.661, 0.668, 0.609, 0.685],
        [0.583, 0.583, 0.563, 0.625],
        [0.775, 0.838, 0.866, 0.875],
        [1.000, 1.000, 1.000, 1.000],
        [0.940, 0.962, 0.965, 0.962],
        [0.619, 0.666, 0.614, 0.669],
        [0.972, 0.981, 0.9751, 0.975],
        [0.957, 0.978, 0.946, 0.970],
    ]  # voting prints 0.975 twice, but ranks them 2 and 3
)

BASES = np.array(  # Hollander & Wolfe 1973, p. 140: three ways of rounding first base, 22 players
    [
        [5.40, 5.50, 5.55],
        [5.85, 5.70, 5.75],
        [5.20, 5.60, 5.50],
        [5.55, 5.50, 5.40],
        [5.90, 5.85, 5.70],
        [5.45, 5.55, 5.60],
        [5.40, 5.40, 5.35],
        [5.45, 5.50, 5.35],
        [5.25, 5.15, 5.00],
        [5.85, 5.80, 5.70],
        [5.25, 5.20, 5.10],
        [5.65, 5.55, 5.45],
        [5.60, 5.35, 5.45],
        [5.05, 5.00, 4.95],
        [5.50, 5.50, 5.40],
        [5.45, 5.55, 5.50],
        [5.55, 5.55, 5.35],
        [5.45, 5.50, 5.55],
        [5.50, 5.45, 5.25],
        [5.65, 5.60, 5.40],
        [5.70, 5.65, 5.55],
        [6.30, 6.30, 6.25],
    ]
)


def test_ranks_and_nemenyi_on_demsars_classifiers():
    ranks = mean_ranks(1 - AUC)
    assert_array_equal(np.round(ranks, 3), [3.143, 2.000, 2.893, 1.964])
    n, k = AUC.shape  # Demšar's statistic has no correction for ties
    assert round(12 * n / (k * (k + 1)) * (ranks @ ranks - k * (k + 1) ** 2 / 4), 2) == 9.28
    assert round(critical_difference(n, k), 2) == 1.25
    assert round(critical_difference(n, k, 0.9), 2) == 1.12


@pytest.mark.parametrize(
    ("solvers", "q95", "q90"),  # Demšar 2006, table 5(a)
    [
        (2, 1.960, 1.645),
        (3, 2.343, 2.052),
        (4, 2.569, 2.291),
        (7, 2.949, 2.693),
        (10, 3.164, 2.920),
    ],
)
def test_critical_difference_has_demsars_quantiles(solvers, q95, q90):
    scale = np.sqrt(solvers * (solvers + 1) / 6 / 30)
    assert critical_difference(30, solvers) / scale == pytest.approx(q95, abs=1e-3)
    assert critical_difference(30, solvers, 0.9) / scale == pytest.approx(q90, abs=1e-3)


def test_critical_difference_is_where_scikit_posthocs_turns_significant():
    costs = np.random.default_rng(3).normal(np.linspace(0, 1.5, 6), 1, (20, 6))
    ranks = mean_ranks(costs)
    apart = np.abs(ranks[:, None] - ranks) > critical_difference(20, 6)
    expected = scikit_posthocs.posthoc_nemenyi_friedman(costs).to_numpy() < 0.05
    assert expected.any()
    assert_array_equal(apart, expected)


def test_mean_ranks_with_failures_and_nothing_but_ties():
    assert_array_equal(mean_ranks([[1, nan, 2], [3, inf, nan]]), [1, 2.75, 2.25])
    assert_array_equal(mean_ranks([[1, 1, 1], [nan, inf, nan]]), [2, 2, 2])


# Effect sizes and intervals


@given(samples, samples)
@reproducible
def test_the_chance_of_a_shorter_run_counts_pairs(a, b):
    x, y = (np.nan_to_num(v, nan=inf, posinf=inf) for v in (a, b))
    wins = sum((p < q) + (p == q) / 2 for p in x for q in y)
    assert shorter_chance(a, b) == pytest.approx(wins / (len(a) * len(b)))
    assert shorter_chance(a, b) + shorter_chance(b, a) == pytest.approx(1)


def test_the_chance_of_a_shorter_run_agrees_with_statsmodels_and_mann_whitney():
    rng = np.random.default_rng(2)
    a = rng.integers(0, 9, 30)
    b = rng.integers(2, 12, 40)
    assert shorter_chance(a, b) == pytest.approx(rank_compare_2indep(b, a).prob1)
    assert shorter_chance(a, b) == pytest.approx(stats.mannwhitneyu(b, a).statistic / 1200)
    assert shorter_chance([1, 2, 3], [2, 3, 4]) == pytest.approx(7 / 9)


def test_the_chance_of_a_shorter_run_works_row_by_row():
    rng = np.random.default_rng(4)
    a = rng.integers(0, 5, (6, 2, 7))
    b = rng.integers(0, 5, (6, 2, 3))
    expected = [[shorter_chance(a[i, j], b[i, j]) for j in range(2)] for i in range(6)]
    assert_array_equal(shorter_chance(a, b), expected)


@pytest.mark.parametrize("runs", [5, 30])
@pytest.mark.parametrize("chance", [0.5, 0.9, 0.98])
def test_the_interval_of_the_chance_covers_at_the_extremes_too(runs, chance):
    """A percentile bootstrap covers 0.98 in 29 % of samples of 5 runs, in 81 % of 30."""
    rng = np.random.default_rng(8)
    # P(a < b) of two normal samples that are `shift` apart
    shift = np.sqrt(2) * stats.norm.ppf(chance)
    samples = 400
    a = rng.normal(0, 1, (samples, runs))
    b = rng.normal(shift, 1, (samples, runs))
    covered = 0
    for seen in shorter_chance(a, b):
        interval = shorter_interval(float(seen), runs, runs)
        covered += interval.low <= chance <= interval.high
    # 95 % of 400 is 380, 3 standard deviations are 13; Newcombe's is cautious at the extremes
    assert covered >= 367


def test_the_interval_of_the_chance_solves_newcombes_equation():
    found = shorter_interval(0.8, 10, 14)
    for theta in (found.low, found.high):
        k = (10 + 14) / 2 - 1
        spread = 1 + k * (1 - theta) / (2 - theta) + k * theta / (1 + theta)
        variance = theta * (1 - theta) * spread / 140
        assert abs(0.8 - theta) == pytest.approx(1.959964 * np.sqrt(variance), rel=1e-5)
    assert shorter_interval(1.0, 5, 5).high == 1
    assert shorter_interval(0.0, 5, 5).low == 0
    mirrored = shorter_interval(0.2, 14, 10)
    assert [mirrored.low, mirrored.high] == pytest.approx([1 - found.high, 1 - found.low])


def test_the_mean_over_groups_has_wilsons_interval_of_as_many_outcomes():
    shares = [1.0, 1.0, 1.0, 0.0, 1.0]
    found = mean_interval(shares, ["a", "a", "a", "b", "c"])
    assert found.value == pytest.approx(2 / 3)
    wilson = success_rate([True, False, True])
    assert [found.low, found.high] == pytest.approx([wilson.low, wilson.high])


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_a_true_null_is_rejected_as_often_as_said_where_problems_share_an_arm(correlation):
    """Without groups it is rejected in 18 % of samples at a correlation of 0.6."""
    rng = np.random.default_rng(9)
    arms, each, samples = 14, 3, 500
    arm = np.repeat(np.arange(arms), each)
    common = rng.normal(size=(samples, arms))[:, arm]
    own = rng.normal(size=(samples, arms * each))
    effects = np.sqrt(correlation) * common + np.sqrt(1 - correlation) * own
    zero = np.zeros(arms * each)
    rejected = sum(wilcoxon(effect, zero, arm).pvalue < 0.05 for effect in effects)
    # 5 % of 500 is 25, 3 standard deviations are 15
    assert rejected <= 40


def test_wilcoxon_of_groups_turns_the_signs_of_each_group_together():
    change = np.array([3.0, 1.0, -2.0, 5.0, -4.0, 6.0])
    groups = ["x", "x", "y", "y", "y", "z"]
    # signed ranks are 3, 1 | -2, 5, -4 | 6: sums 4, -1, 6, of which -1 is negative
    found = wilcoxon(change, np.zeros(6), groups)
    assert (found.statistic, found.wins, found.losses) == (1, 2, 4)
    signs = np.array(list(product([-1, 1], repeat=3)))
    sums = signs @ np.array([4, 1, 6])
    assert found.pvalue == pytest.approx(np.mean(np.abs(sums) >= 9))


def test_bootstrap_of_a_median_has_the_exact_percentiles():
    # The median of a resample of 5 is the j-th smallest or less if 3 draws are: binomial
    values = np.array([1.0, 2, 4, 8, 16])
    cdf = stats.binom.sf(2, 5, np.arange(1, 6) / 5)
    low, high = (values[np.searchsorted(cdf, p)] for p in (0.1, 0.9))
    assert bootstrap(median, values, confidence=0.8) == Estimate(4.0, low, high)


def test_bootstrap_of_a_mean_agrees_with_enumeration():
    values = np.array([1.0, 2, 4, 9])
    means = np.sort([np.mean(draw) for draw in product(values, repeat=4)])
    interval = bootstrap(partial(np.mean, axis=-1), values, confidence=0.8, resamples=40_000)
    assert (interval.low, interval.high) == (means[25], means[230])  # 0.1 and 0.9 of 256


def test_bootstrap_of_two_samples_agrees_with_a_loop():
    rng = np.random.default_rng(6)
    a = rng.normal(0, 1, 25)
    b = rng.normal(0.5, 1, 35)
    beats = (a[:, None] < b) + (a[:, None] == b) / 2
    draws = [
        beats[rng.integers(25, size=25)][:, rng.integers(35, size=35)].mean() for _ in range(4000)
    ]
    interval = bootstrap(shorter_chance, a, b)
    assert interval.value == pytest.approx(beats.mean())
    assert_allclose([interval.low, interval.high], np.quantile(draws, [0.025, 0.975]), atol=0.012)


def test_bootstrap_interval_covers_about_as_often_as_it_says():
    rng = np.random.default_rng(7)
    covered = 0
    for _ in range(200):
        interval = bootstrap(
            shorter_chance, rng.normal(0, 1, 50), rng.normal(0, 1, 50), resamples=300
        )
        covered += interval.low <= 0.5 <= interval.high
    assert 180 <= covered <= 199  # 95 % of 200 is 190, 3 standard deviations are 9


def test_a_running_time_of_few_successes_has_no_interval():
    time = partial(expected_running_time, budgets=100)
    few = bootstrap(time, [10, nan, nan, nan])
    assert few.value == 310
    assert np.isnan([few.low, few.high]).all()
    assert np.isnan(bootstrap(time, [nan, nan]).high)
    assert np.isnan(bootstrap(time, [1.0] * 9 + [nan] * 11).high)
    assert np.isfinite(bootstrap(time, [1.0] * 10 + [nan] * 10).high)


def test_a_running_time_of_few_runs_has_no_interval_even_if_all_succeed():
    """Of ten runs that succeed with chance 0.8 one set in nine has no miss to resample."""
    time = partial(expected_running_time, budgets=100)
    found = bootstrap(time, [7.0] * 19)
    assert found.value == 7.0
    assert np.isnan([found.low, found.high]).all()
    assert bootstrap(time, [7.0] * 20) == Estimate(7.0, 7.0, 7.0)


@pytest.mark.parametrize(("runs", "rate"), [(30, 0.5), (30, 0.8), (20, 0.8)])
def test_intervals_of_running_times_cover_what_they_say(runs, rate):
    """Hits at 0 to 100 evaluations: 50 for a hit, 100 for each miss before it."""
    rng = np.random.default_rng(0)
    time = partial(expected_running_time, budgets=100)
    expected = 50 + 100 * (1 - rate) / rate
    within = []
    for _ in range(200):
        hits = np.where(rng.random(runs) < rate, rng.uniform(0, 100, runs), nan)
        found = bootstrap(time, hits, resamples=500)
        if not np.isnan(found.low):
            within.append(found.low <= expected <= found.high)
    assert len(within) > 150
    assert np.mean(within) > 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(within))


def test_bootstrap_depends_on_the_seed_only():
    values = np.random.default_rng(8).normal(size=30)
    mean = partial(np.mean, axis=-1)
    assert bootstrap(mean, values) == bootstrap(mean, values)
    assert bootstrap(mean, values, seed=1) != bootstrap(mean, values)


def test_one_run_has_no_interval():
    alone = bootstrap(median, [3.0])
    assert alone.value == 3
    assert np.isnan([alone.low, alone.high]).all()
    assert np.isnan(bootstrap(shorter_chance, [3.0], [1.0, 2.0]).low)


def test_numbers_come_out_as_numbers():
    for value in (median([1, 2]), shorter_chance([1], [2]), expected_running_time([1], 2)):
        assert isinstance(value, float)


def test_no_runs_have_no_statistic():
    with pytest.raises(InvalidInput, match=r"values is \(0,\): expected at least one value"):
        median([])


# Between seeds


def test_mann_whitney_by_hand():
    # All of a below all of b: one of the 20 ways to deal six ranks to three, and its mirror.
    found = mann_whitney([1, 2, 3], [4, 5, nan])
    assert (found.statistic, found.pvalue) == (9, pytest.approx(2 / 20))
    assert mann_whitney([4, 5, nan], [1, 2, 3]).statistic == 0
    tied = mann_whitney([1, nan], [inf, 1])
    assert (tied.statistic, tied.pvalue) == (2, 1)
    assert mann_whitney([2, 2], [2, 2, 2]).pvalue == 1


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 5), (8, 8), (12, 30), (30, 30)])
def test_mann_whitney_without_ties_is_scipys_exact(n, m):
    rng = np.random.default_rng(n + m)
    a = rng.normal(0, 1, n)
    b = rng.normal(0.4, 1, m)
    expected = stats.mannwhitneyu(a, b, method="exact")
    found = mann_whitney(a, b)
    assert found.pvalue == pytest.approx(expected.pvalue, rel=1e-9)
    assert found.statistic == n * m - expected.statistic  # theirs counts what a loses


@pytest.mark.parametrize("seed", range(5))
def test_mann_whitney_with_ties_and_failures_deals_the_ranks_in_every_way(seed):
    rng = np.random.default_rng(seed)
    a = rng.choice([1, 2, 3, inf], 5)
    b = rng.choice([1, 2, 3, 4, inf], 6)
    all_ways = stats.PermutationMethod(n_resamples=9999)  # of 462: so it takes each once
    expected = stats.mannwhitneyu(a, b, method=all_ways).pvalue
    assert mann_whitney(a, b).pvalue == pytest.approx(expected, rel=1e-9)


def test_mann_whitney_of_many_runs_is_scipys_normal_one():
    rng = np.random.default_rng(4)
    a = np.round(rng.normal(0, 1, 50), 1)
    b = np.round(rng.normal(0.3, 1, 60), 1)
    a[:3] = nan
    expected = stats.mannwhitneyu(np.where(np.isnan(a), 99, a), b, method="asymptotic").pvalue
    assert mann_whitney(a, b).pvalue == pytest.approx(expected, rel=1e-12)


@given(samples, samples)
@reproducible
def test_mann_whitney_and_the_chance_of_a_shorter_run_are_one_statistic(a, b):
    found = mann_whitney(a, b)
    mirror = mann_whitney(b, a)
    assert found.statistic / (len(a) * len(b)) == pytest.approx(shorter_chance(a, b))
    assert found.pvalue == pytest.approx(mirror.pvalue)
