"""Statistics of repeated runs: arrays in, arrays and small records out.

    hits = evaluations_to_target(histories, 1.01 * optimum)      # (runs,), NaN where missed
    success_rate(hits <= budget)                                 # with its Wilson interval
    bootstrap(partial(expected_running_time, budgets=budget), hits)
    chance = shorter_chance(ours, theirs)                        # that a run of ours is shorter
    shorter_interval(chance, len(ours), len(theirs))             # Newcombe's
    holm([wilcoxon(ours, theirs).pvalue for theirs in others])

Lower is better: values are durations (s), gaps, or evaluations. A missing answer is NaN or +inf; it
is worse than every answer, and never left out. Runs lie along the last axis. Only equal numbers are
tied: round values first where a difference means nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput

Values = Array | np.float64  # a number where the runs were the only axis

EXACT_PAIRS = 50  # largest number of pairs that differ for which Wilcoxon's p is exact
EXACT_RUNS = 60  # largest number of runs of both samples for which Mann and Whitney's p is exact
MAX_BOOTSTRAP_VALUES = 10**6  # values drawn at a time, so that they fit into memory
FEWEST_ANSWERS = 10  # least answers of a sample with missing ones for a bootstrap interval
# Least runs for an interval of an expected running time. Ten runs that all succeed vary in nothing:
# where eight of ten do in the long run, 22 % of such intervals hold the expected time.
FEWEST_RUNS = 20
END_MARGIN = 1e-12  # distance of a chance from 0 and 1, where its variance is 0
QUARTILES = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class Estimate:
    """A value and the confidence interval around it."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Paired:
    """Wilcoxon's test: the smaller rank sum `T` (of groups), the two-sided p, and counted pairs.

    `wins`, `ties` and `losses`: in how many pairs `a` was below, equal to, and above `b`.
    """

    statistic: float
    pvalue: float
    wins: int
    ties: int
    losses: int


@dataclass(frozen=True)
class RankSum:
    """Mann and Whitney's test: `U` of the first sample (pairs that it wins), the two-sided p."""

    statistic: float
    pvalue: float


def success_rate(successes: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Share of true in booleans `(runs,)`, such as feasibility, with Wilson's interval (1927)."""
    outcomes = _costs("successes", successes)
    return mean_interval(outcomes, np.arange(outcomes.size), confidence)


def quantile(values: ArrayLike, q: ArrayLike) -> Values:
    """Quantiles `q` of values `(…, runs)`: `(…)`, or `(…, k)` for `k` of them.

    Linear between neighbouring runs, as NumPy's; +inf from the first run without an answer on.
    """
    costs = _costs("values", values)
    ordered = np.sort(costs)
    last = costs.shape[-1] - 1
    rank = np.round(np.asarray(q) * last, 9)  # 0.55 · 100 must not exceed 55
    below = np.floor(rank).astype(int)
    above = np.ceil(rank).astype(int)
    low = ordered[..., below]
    high = ordered[..., above]
    weight = rank % 1
    with np.errstate(invalid="ignore"):
        between = low * (1 - weight) + high * weight
    equal = low == high
    return np.where(equal, low, between)[()]


def median(values: ArrayLike) -> Values:
    """Median of values `(…, runs)`: `(…)`; +inf where half of the runs have no answer."""
    return quantile(values, 0.5)


def ecdf(values: ArrayLike, at: ArrayLike) -> Array:
    """Return the share of values `(runs,)` that are at most each of `at`.

    Runs without an answer never are: the share ends at the success rate, even at +inf.
    """
    runs = _costs("values", values)
    answers = np.sort(runs[np.isfinite(runs)])
    shares: Array = np.searchsorted(answers, at, side="right") / runs.size
    return shares


def evaluations_to_target(histories: Sequence[ArrayLike], targets: ArrayLike) -> Array:
    """Evaluations that each run spent until its best was at most the target, NaN where never.

    `histories`: per run `(m, 2)`, evaluations spent and the answer by then; rows without an answer
    are passed over. Returns `(runs,)`, or `(targets, runs)`; the target +inf is the first answer.
    """
    wanted = np.asarray(targets, dtype=float)
    hits = []
    for spent, best in map(_curve, histories):
        row = np.searchsorted(-best, -wanted)
        spent_or_never = np.append(spent, np.nan)
        hits.append(spent_or_never[row])
    return np.stack(hits, axis=-1)


def fixed_budget(histories: Sequence[ArrayLike], budgets: ArrayLike) -> Array:
    """Best of each run within a budget of evaluations (its last, if it ended before), or NaN.

    `histories` as above. Returns `(runs,)`, or `(budgets, runs)`: its `median` is a curve.
    """
    within = []
    for spent, best in map(_curve, histories):
        row = np.searchsorted(spent, budgets, "right")
        none_or_best = np.insert(best, 0, np.nan)
        within.append(none_or_best[row])
    return np.stack(within, axis=-1)


def quartiles_over_runs(histories: Sequence[ArrayLike], budgets: ArrayLike) -> Array:
    """Quartiles over runs of the best within each budget of evaluations: `(3, budgets)`.

    `histories` as above; a run without an answer by then is worse than any, so that a quartile is
    +inf until enough runs have one.
    """
    best = fixed_budget(histories, np.atleast_1d(budgets))
    quartiles = np.asarray(quantile(best, QUARTILES))
    return quartiles.T


def expected_running_time(hits: ArrayLike, budgets: ArrayLike) -> Values:
    """Evaluations spent by all runs until target or budget, per success (Hansen et al. 2021, COCO).

    `hits` `(…, runs)` from `evaluations_to_target`; `budgets`, what each run spent or was allowed,
    broadcasts against them. A hit beyond its budget is a miss. Returns `(…)`; +inf if all missed.
    With fewer than `FEWEST_RUNS` runs, or misses and fewer than `FEWEST_ANSWERS` hits, its
    `bootstrap` has no interval: look at that of `success_rate`.
    """
    reached = _costs("hits", hits)
    spent = np.minimum(reached, budgets)
    hit = reached <= np.asarray(budgets)
    successes = hit.sum(axis=-1)
    with np.errstate(divide="ignore"):
        ert = spent.sum(axis=-1) / successes
    return np.asarray(ert)[()]


def performance_profile(costs: ArrayLike, taus: ArrayLike) -> Array:
    """Share of problems each solver solves within `tau` times the best (Dolan & Moré 2002).

    `costs` `(problems, solvers)`, positive. Returns shares `(taus, solvers)`. A problem that none
    solved counts against all of them.
    """
    table = _costs("costs", costs)
    best = table.min(axis=1, keepdims=True)
    with np.errstate(invalid="ignore", over="ignore"):
        ratios = table / best
    return np.stack([ecdf(column, taus) for column in ratios.T], axis=-1)


def wilcoxon(a: ArrayLike, b: ArrayLike, groups: ArrayLike | None = None) -> Paired:
    """Wilcoxon's signed-rank test on pairs `(pairs,)`, two-sided (Wilcoxon 1945).

    Pairs of one group need not be independent: the signs of a group change together, so its signed
    ranks count as one sum (Rosner, Glynn and Lee 2006). By default each pair is a group.

    Equal pairs, two failures too, are dropped (p = 1 if none is left); a failure differs most from
    an answer. p is exact, ties or not, up to `EXACT_PAIRS` groups, then normal.
    """
    x = _costs("a", a)
    y = _costs("b", b)
    own = np.arange(x.size) if groups is None else np.asarray(groups)
    differ = x != y
    with np.errstate(over="ignore"):
        change = x[differ] - y[differ]
    ranks = _scipy().rankdata(np.abs(change))
    signed = np.sign(change) * ranks
    _, group = np.unique(own[differ], return_inverse=True)
    sums: Array = np.bincount(group, weights=signed).astype(float)
    sizes = np.abs(sums)
    negative = sizes[sums < 0].sum()
    positive = sizes[sums > 0].sum()
    rank_sum = float(min(negative, positive))
    if len(sums) <= EXACT_PAIRS:
        pvalue = _exact_signed_rank(sizes, rank_sum)
    else:
        pvalue = _normal_signed_rank(sums)
    wins = int((change < 0).sum())
    return Paired(
        statistic=rank_sum,
        pvalue=pvalue,
        wins=wins,
        ties=x.size - change.size,
        losses=change.size - wins,
    )


def mann_whitney(a: ArrayLike, b: ArrayLike) -> RankSum:
    """Mann and Whitney's test of independent runs `(n,)` and `(m,)`, two-sided (1947).

    `U` is `n m` times `shorter_chance`: in how many of the `n m` pairs `a` is lower (better), ties
    counting half; failures are equal. p is exact, ties or not, for up to `EXACT_RUNS` runs
    together: the share of all ways to deal the ranks; then normal, corrected for ties and
    continuity. If all runs are equal, p = 1.
    """
    x = _costs("a", a)
    y = _costs("b", b)
    both = np.concatenate([x, y])
    ranks = _scipy().rankdata(both)
    pairs = x.size * y.size
    halves = np.round(2 * pairs * shorter_chance(x, y))
    won = float(halves / 2)
    if np.ptp(ranks) == 0:
        return RankSum(won, 1.0)
    if both.size <= EXACT_RUNS:
        return RankSum(won, _exact_rank_sum(ranks, x.size))
    own = ranks[: x.size]
    theirs = ranks[x.size :]
    found = _scipy().mannwhitneyu(own, theirs, method="asymptotic")
    return RankSum(won, float(found.pvalue))


def holm(pvalues: ArrayLike) -> Array:
    """p-values adjusted for being one family (Holm 1979), in their own shape."""
    p = np.asarray(pvalues, dtype=float)
    order = np.argsort(p, axis=None)
    remaining = np.arange(p.size, 0, -1)
    scaled = p.ravel()[order] * remaining
    adjusted = np.empty(p.size)
    adjusted[order] = np.maximum.accumulate(scaled)
    return np.minimum(adjusted, 1).reshape(p.shape)


def mean_ranks(costs: ArrayLike) -> Array:
    """Mean rank of each solver over costs `(problems, solvers)`, 1 the best; ties share theirs."""
    ranks = _scipy().rankdata(_costs("costs", costs), axis=1)
    means: Array = ranks.mean(axis=0)
    return means


def critical_difference(problems: int, solvers: int, confidence: float = 0.95) -> float:
    """Difference of mean ranks that Nemenyi's test calls significant (Demšar 2006, 3.2.2)."""
    studentized = _scipy().studentized_range.ppf(confidence, solvers, np.inf)
    # CD = q √(k (k + 1) / 6 N), with q the studentized range over √2
    q = studentized / np.sqrt(2)
    orders = solvers * (solvers + 1)
    spread = orders / (6 * problems)
    return float(q * np.sqrt(spread))


def shorter_chance(a: ArrayLike, b: ArrayLike) -> Values:
    """Chance that a run of `a` is shorter than one of `b`: P(a < b) + ½ P(a = b), `(…)`.

    Over all pairs of `a` `(…, n)` and `b` `(…, m)`; above ½ where `a` tends to be better. Failures
    are equal. It is 1 − A12 of Vargha and Delaney (2000).
    """
    x = _costs("a", a)
    y = _costs("b", b)
    n = x.shape[-1]
    m = y.shape[-1]
    both = np.concatenate([x, y], axis=-1)
    ranks = _scipy().rankdata(both, axis=-1)
    own = ranks[..., :n]
    rank_sum = own.sum(axis=-1)
    # the rank sum of `a` is n (n + 1) / 2 more than the pairs that it loses, ties counting half
    lost = rank_sum - n * (n + 1) / 2
    share = 1 - lost / (n * m)
    return np.asarray(share)[()]


def shorter_interval(chance: float, n: int, m: int, confidence: float = 0.95) -> Estimate:
    """Interval of `shorter_chance` of `n` and `m` runs: Newcombe's method 5 (2006).

    Its ends are the chances θ at which `chance` is a normal quantile away, with the variance

        V(θ) = θ (1 − θ) (1 + k (1 − θ) / (2 − θ) + k θ / (1 + θ)) / (n m),  k = (n + m) / 2 − 1,

    so it does not shrink to a point at 0 and 1, as a bootstrap does.
    """
    z = _z(confidence)
    k = (n + m) / 2 - 1

    def excess(theta: float) -> float:
        other = 1 - theta
        spread = 1 + k * other / (1 + other)
        spread += k * theta / (1 + theta)
        variance = theta * other * spread / (n * m)
        return float((chance - theta) ** 2 - z**2 * variance)

    inside = np.clip(chance, END_MARGIN, 1 - END_MARGIN)
    low = 0.0
    high = 1.0
    if chance > 0:
        low = _root(excess, inside, low)
    if chance < 1:
        high = _root(excess, inside, high)
    return Estimate(chance, low, high)


def mean_interval(shares: ArrayLike, groups: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Mean of shares between 0 and 1 `(n,)`, and an interval that counts each group once.

    The mean is one over the groups' means, as shares of one group are not independent. The interval
    is Wilson's (1927) for as many yes-or-no outcomes as there are groups: none of the same mean
    spreads more.
    """
    values = np.asarray(shares, dtype=float)
    _, group = np.unique(groups, return_inverse=True)
    sums = np.bincount(group, weights=values)
    means = sums / np.bincount(group)
    mean = float(means.mean())
    n = len(means)
    z = _z(confidence)
    share = z**2 / n
    scale = 1 + share
    centre = (mean + share / 2) / scale
    variance = mean * (1 - mean) + share / 4
    spread = np.sqrt(share * variance)
    half = float(spread / scale)
    low = max(0.0, centre - half)
    high = min(1.0, centre + half)
    return Estimate(mean, low, high)


def bootstrap(
    statistic: Callable[..., Values],
    *samples: ArrayLike,
    confidence: float = 0.95,
    resamples: int = 9999,
    seed: int = 0,
) -> Estimate:
    """`statistic(*samples)` with its percentile bootstrap interval (Efron & Tibshirani 1993, 13).

    Each sample is `(runs,)`; `statistic` maps samples `(k, runs)` to `(k,)`, as `median` and
    `expected_running_time` do. Samples are drawn independently. Bounds may be +inf. They are NaN
    if a sample has a single run, which says nothing of the spread, if it has fewer than
    `FEWEST_RUNS` for an expected running time, or if runs without an answer are
    among fewer than `FEWEST_ANSWERS` with one: resampling these hardly varies the success rate. At
    one success in ten, 95 % intervals of expected running times would cover 64 % (10 runs) and 88 %
    (30 runs).
    """
    arrays = [_costs("sample", sample) for sample in samples]
    value = float(statistic(*arrays))
    sizes = [array.size for array in arrays]
    counts_misses = getattr(statistic, "func", statistic) is expected_running_time
    fewest = FEWEST_RUNS if counts_misses else 2
    if min(sizes) < fewest or any(map(_hardly_answers, arrays)):
        return Estimate(value, np.nan, np.nan)
    with np.errstate(invalid="ignore"):  # SciPy's own interval is NaN where resamples are inf
        found = _scipy().bootstrap(
            arrays,
            lambda *drawn, axis: statistic(*drawn),
            vectorized=True,
            n_resamples=resamples,
            batch=max(1, MAX_BOOTSTRAP_VALUES // sum(sizes)),
            method="percentile",
            rng=np.random.default_rng(seed),
        )
    tail = (1 - confidence) / 2
    low = quantile(found.bootstrap_distribution, tail)
    high = quantile(found.bootstrap_distribution, 1 - tail)
    return Estimate(value, float(low), float(high))


def _hardly_answers(sample: Array) -> bool:
    answers = np.isfinite(sample).sum()
    return bool(answers < min(FEWEST_ANSWERS, sample.size))


def _scipy() -> Any:
    """Return `scipy.stats`, which takes a second to import and few commands need."""
    from scipy import stats

    return stats


def _z(confidence: float) -> float:
    """Return the normal quantile of a two-sided interval."""
    from scipy.special import ndtri  # without `scipy.stats`, whose `norm.ppf` it is

    return float(ndtri((1 + confidence) / 2))


def _root(function: Callable[[float], float], inside: float, end: float) -> float:
    """Return the root between `inside` (function negative) and `end` (positive)."""
    from scipy.optimize import brentq

    return float(brentq(function, inside, end, xtol=1e-12))


def _doubled(ranks: Array) -> NDArray[np.int64]:
    """Return twice the ranks: those shared by an even number of ties end in ½."""
    return np.rint(2 * ranks).astype(np.int64)


def _exact_signed_rank(ranks: Array, rank_sum: float) -> float:
    """Twice the share of all signs of the ranks whose positive ones sum to `rank_sum` or less."""
    doubled = _doubled(ranks)
    total = doubled.sum()
    chance = np.zeros(total + 1)
    chance[0] = 1.0
    for rank in doubled:
        # a rank is positive with probability ½; `roll` moves only zeros over the end
        chance = (chance + np.roll(chance, rank)) / 2
    end = round(2 * rank_sum) + 1
    tail = chance[:end].sum()
    return min(1.0, 2 * float(tail))


def _normal_signed_rank(sums: Array) -> float:
    """Two-sided p of a sum of independent terms with random signs."""
    deviation = np.sqrt((sums**2).sum())
    z = abs(sums.sum()) / deviation
    return float(2 * _scipy().norm.sf(z))


def _exact_rank_sum(ranks: Array, n: int) -> float:
    """Twice the share of all choices of `n` ranks in the smaller tail at the sum of the first `n`.

    `ways[k, s]` counts the choices of `k` ranks that sum to `s / 2`.
    """
    doubled = _doubled(ranks)
    sums = doubled.sum() + 1
    ways = np.zeros((n + 1, sums))
    ways[0, 0] = 1.0
    for rank in doubled:
        without = ways[:-1, : sums - rank].copy()
        ways[1:, rank:] += without
    chance = ways[n] / ways[n].sum()
    own = doubled[:n].sum()
    at_most = chance[: own + 1].sum()
    at_least = chance[own:].sum()
    tail = min(at_most, at_least)
    return min(1.0, 2 * float(tail))


def _curve(history: ArrayLike) -> Array:
    """Return evaluations spent and the best by then, where there is an answer: `(2, m)`.

    A history may rise (a better claim may certify worse): its best by then does not.
    """
    rows = np.asarray(history, dtype=float)
    answered = rows[rows[:, 1] < np.inf]
    spent, values = answered.T
    best = np.minimum.accumulate(values)
    return np.stack([spent, best])


def _costs(name: str, values: ArrayLike) -> Array:
    """Return at least one number, +inf for NaN: a missing answer is the worst of all.

    Raises:
        InvalidInput: if there is no number.
    """
    array = np.asarray(values, dtype=float)
    if not array.size:
        raise InvalidInput(name, "at least one value", value=array.shape)
    costs: Array = np.where(np.isnan(array), np.inf, array)
    return costs
