"""Statistics of repeated runs: arrays in, arrays and small records out.

    hits = evaluations_to_target(histories, 1.01 * optimum)      # (runs,), NaN where missed
    success_rate(hits <= budget)                                 # with its Wilson interval
    bootstrap(partial(expected_running_time, budgets=budget), hits)
    chance = shorter_chance(ours, theirs)                        # that a run of ours is shorter
    shorter_interval(chance, len(ours), len(theirs))             # Newcombe's
    holm([wilcoxon(ours, theirs).pvalue for theirs in others])

Lower is better: values are durations (s), gaps, or evaluations. No answer is NaN or +inf, and is
worse than every answer, never left out. Runs lie along the last axis. Only equal numbers are tied:
round first where a difference means nothing. Every function raises `InvalidInput` for what is not
numbers, has the wrong shape, is empty (an empty family is fine for `holm`), or holds −inf.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajopt.core.exceptions import InvalidInput

Array = NDArray[np.float64]
Values = Array | np.float64  # a number where the runs were the only axis

EXACT_PAIRS = 50  # pairs that differ, up to which Wilcoxon's p is exact
EXACT_RUNS = 60  # runs of both samples together, up to which Mann and Whitney's p is exact
_BOOTSTRAP_VALUES = 10**6  # drawn at a time: they fit into memory
_BESIDE_END = 1e-12  # of a chance: the variance is 0 at both ends
QUARTILES = (0.25, 0.5, 0.75)
FIVE_NUMBERS = (0, *QUARTILES, 1)


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


@dataclass(frozen=True, eq=False)
class Ranking:
    """Friedman's chi-square, its p, and the mean rank of each solver `(solvers,)`, 1 the best."""

    statistic: float
    pvalue: float
    mean_ranks: Array


def success_rate(successes: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Share of true in booleans `(runs,)`, such as feasibility, with Wilson's interval (1927)."""
    outcomes = _costs("successes", successes, 1)
    binary = np.isin(outcomes, (0, 1))
    _require(binary, "successes", "true or false", outcomes)
    _require_level(confidence)
    successful = int(outcomes.sum())
    counted = _scipy().binomtest(successful, outcomes.size)
    low, high = counted.proportion_ci(confidence, method="wilson")
    return Estimate(
        value=float(outcomes.mean()),
        low=float(low),
        high=float(high),
    )


def quantile(values: ArrayLike, q: ArrayLike) -> Values:
    """Quantiles `q` of values `(…, runs)`: `(…)`, or `(…, k)` for `k` of them.

    Linear between neighbouring runs, as NumPy's; +inf from the first run without an answer on.
    """
    ordered = np.sort(_costs("values", values))
    share = _shares("q", q)
    last = ordered.shape[-1] - 1
    place = np.round(share * last, 9)  # 0.55 · 100 must not reach past 55
    below = np.floor(place).astype(int)
    above = np.ceil(place).astype(int)
    low = ordered[..., below]
    high = ordered[..., above]
    weight = place % 1
    with np.errstate(invalid="ignore"):
        between = low * (1 - weight) + high * weight
    equal = low == high
    return np.where(equal, low, between)[()]


def median(values: ArrayLike) -> Values:
    """Median of values `(…, runs)`: `(…)`; +inf where half of the runs have no answer."""
    return quantile(values, 0.5)


def summary(gaps: ArrayLike) -> Array:
    """Best, first quartile, median, third quartile and worst of gaps `(…, runs)`: `(…, 5)`."""
    five = quantile(gaps, FIVE_NUMBERS)
    return np.asarray(five)


def ecdf(values: ArrayLike, at: ArrayLike | None = None) -> tuple[Array, Array]:
    """`x` (`at`, or wherever it steps), and the share of values `(runs,)` that are at most `x`.

    Runs without an answer never are: the share ends at the success rate, even at +inf.
    """
    runs = _costs("values", values, 1)
    finite = np.isfinite(runs)
    answers = np.sort(runs[finite])
    x = np.unique(answers)
    if at is not None:
        x = _numbers("at", at, nan=False)
    counts = np.searchsorted(answers, x, side="right")
    shares: Array = counts / runs.size
    return x, shares


def evaluations_to_target(histories: Sequence[ArrayLike], targets: ArrayLike) -> Array:
    """Evaluations that each run spent until its best was at most the target, NaN where never.

    `histories`: per run `(m, 2)`, evaluations spent and the answer by then; rows without an answer
    are passed over. Returns `(runs,)`, or `(targets, runs)`; the target +inf is the first answer.
    """
    curves = _curves(histories)
    wanted = _numbers("targets", targets, nan=False)
    hits = []
    for spent, best in curves:
        row = np.searchsorted(-best, -wanted)
        spent_or_never = np.append(spent, np.nan)
        hits.append(spent_or_never[row])
    return np.stack(hits, axis=-1)


def fixed_budget(histories: Sequence[ArrayLike], budgets: ArrayLike) -> Array:
    """Best of each run within a budget of evaluations (its last, if it ended before), NaN if none.

    `histories` as above. Returns `(runs,)`, or `(budgets, runs)`: its `median` is a curve.
    """
    curves = _curves(histories)
    limit = _numbers("budgets", budgets, nan=False)
    within = []
    for spent, best in curves:
        row = np.searchsorted(spent, limit, "right")
        none_or_best = np.insert(best, 0, np.nan)
        within.append(none_or_best[row])
    return np.stack(within, axis=-1)


def quartiles_over_runs(histories: Sequence[ArrayLike], budgets: ArrayLike) -> Array:
    """Quartiles over runs of the best within each budget of evaluations: `(3, budgets)`.

    `histories` as above; a run without an answer by then is worse than any, so that a quartile is
    +inf until enough runs have one.
    """
    several = np.atleast_1d(budgets)
    best = fixed_budget(histories, several)
    quartiles = np.asarray(quantile(best, QUARTILES))
    return quartiles.T


def expected_running_time(hits: ArrayLike, budgets: ArrayLike) -> Values:
    """Evaluations spent by all runs until target or budget, per success (Hansen et al. 2021, COCO).

    `hits` `(…, runs)` from `evaluations_to_target`; `budgets`, what each run spent or was allowed,
    broadcasts against them. A hit beyond its budget is a miss. Returns `(…)`; +inf if all missed,
    as is then its `bootstrap` interval, which sees no further: look at that of `success_rate`.
    """
    reached = _costs("hits", hits)
    limit = _numbers("budgets", budgets)
    _require(reached >= 0, "hits", "0 or more", reached)
    usable = (limit > 0) & (limit < np.inf)
    _require(usable, "budgets", "positive and finite", limit)
    shape = reached.shape
    shapes = [(), shape[-1:], shape]
    fits = limit.shape in shapes
    _require(fits, "budgets", f"one, or of shape {shape}", limit.shape)
    spent = np.minimum(reached, limit)
    hit = reached <= limit
    successes = hit.sum(axis=-1)
    with np.errstate(divide="ignore"):
        ert = spent.sum(axis=-1) / successes
    return np.asarray(ert)[()]


def performance_profile(
    costs: ArrayLike,
    taus: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Share of problems each solver solves within `tau` times the best (Dolan & Moré 2002).

    `costs` `(problems, solvers)`, positive. Returns `taus` `(k,)` (by default, wherever a profile
    steps) and shares `(k, solvers)`. A problem that none solved counts against all of them.
    """
    table = _costs("costs", costs, 2)
    _require(table > 0, "costs", "positive, since profiles are of ratios", table)
    best = table.min(axis=1, keepdims=True)
    with np.errstate(invalid="ignore", over="ignore"):
        ratios = table / best
    return _profile(ratios, taus)


def data_profile(
    evaluations: ArrayLike,
    dimension: ArrayLike,
    alphas: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Share of problems each solver solves in `alpha` simplex gradients (Moré & Wild 2009).

    `evaluations` `(problems, solvers)` to the target; `dimension`, a number or `(problems,)`: a
    simplex gradient is `dimension + 1` evaluations. Returns `alphas` and shares, as above.
    """
    table = _costs("evaluations", evaluations, 2)
    size = _numbers("dimension", dimension)
    _require(table >= 0, "evaluations", "0 or more", table)
    usable = (size >= 1) & (size < np.inf)
    _require(usable, "dimension", "at least 1", size)
    if size.ndim:
        _require_shape("dimension", size, table.shape[:1])
    gradients = table.T / (size + 1)
    return _profile(gradients.T, alphas)


def wilcoxon(a: ArrayLike, b: ArrayLike, groups: ArrayLike | None = None) -> Paired:
    """Wilcoxon's signed-rank test on pairs `(pairs,)`, two-sided (Wilcoxon 1945).

    Pairs of one group need not be independent: the signs of a group change together, so its signed
    ranks count as one sum (Rosner, Glynn and Lee 2006). By default each pair is a group.

    Equal pairs, two failures too, are dropped (p = 1 if none is left); a failure differs most from
    an answer. p is exact, ties or not, up to `EXACT_PAIRS` groups, then normal.
    """
    x = _costs("a", a, 1)
    y = _costs("b", b, 1)
    pairs = x.size
    paired = y.size == pairs
    _require(paired, "b", f"as many values as in a, {pairs}", y.size)
    own = np.arange(pairs) if groups is None else np.asarray(groups)
    _require(own.shape == (pairs,), "groups", f"one for each of {pairs} pairs", own.shape)
    differ = x != y
    with np.errstate(over="ignore"):
        change = x[differ] - y[differ]
    below = change < 0
    above = change > 0
    size = np.abs(change)
    ranks = _scipy().rankdata(size)
    _, group = np.unique(own[differ], return_inverse=True)
    signed = np.where(above, ranks, -ranks)
    sums: Array = np.bincount(group, weights=signed).astype(float)
    sizes = np.abs(sums)
    negative = sizes[sums < 0].sum()
    positive = sizes[sums > 0].sum()
    rank_sum = float(min(negative, positive))
    if len(sums) <= EXACT_PAIRS:
        pvalue = _exact_signed_rank(sizes, rank_sum)
    else:
        pvalue = _normal_signed_rank(sums)
    return Paired(
        statistic=rank_sum,
        pvalue=pvalue,
        wins=int(below.sum()),
        ties=pairs - change.size,
        losses=int(above.sum()),
    )


def mann_whitney(a: ArrayLike, b: ArrayLike) -> RankSum:
    """Mann and Whitney's test of independent runs `(n,)` and `(m,)`, two-sided (1947).

    `U` is `n m` times `shorter_chance`: in how many of the `n m` pairs `a` is lower (better), ties
    counting half; failures are equal. p is exact, ties or not, for up to `EXACT_RUNS` runs
    together: the share of all ways to deal the ranks; then normal, corrected for ties and
    continuity. If all runs are equal, p = 1.
    """
    x = _costs("a", a, 1)
    y = _costs("b", b, 1)
    n = x.size
    m = y.size
    both = np.concatenate([x, y])
    ranks = _scipy().rankdata(both)
    rank_sum = ranks[:n].sum()
    # pairs lost: U' = R − n (n + 1) / 2; pairs won: U = n m − U'
    lost = rank_sum - n * (n + 1) / 2
    won = float(n * m - lost)
    if np.ptp(ranks) == 0:
        return RankSum(won, 1.0)
    if both.size <= EXACT_RUNS:
        pvalue = _exact_rank_sum(ranks, n, rank_sum)
    else:
        pvalue = _normal_rank_sum(ranks, n)
    return RankSum(won, pvalue)


def holm(pvalues: ArrayLike) -> Array:
    """p-values adjusted for being one family (Holm 1979), in their own shape."""
    p = _shares("pvalues", pvalues)
    order = np.argsort(p, axis=None)
    rising = p.ravel()[order]
    remaining = np.arange(p.size, 0, -1)
    adjusted = np.empty(p.size)
    scaled = rising * remaining
    adjusted[order] = np.maximum.accumulate(scaled)
    return np.minimum(adjusted, 1).reshape(p.shape)


def friedman(costs: ArrayLike) -> Ranking:
    """Friedman's test on costs `(problems, solvers)`, at least 3 solvers (Demšar 2006, 3.2.2).

    Ties share their mean rank; the statistic is corrected for them. If all are tied, p = 1.
    """
    table = _costs("costs", costs, 2)
    ranks = _scipy().rankdata(table, axis=1)
    solvers = table.shape[1]
    _require(solvers > 2, "costs", "3 solvers or more (for 2, wilcoxon)", table.shape)
    mean_ranks = ranks.mean(axis=0)
    spread = np.ptp(ranks, axis=1)
    if not spread.any():
        return Ranking(0.0, 1.0, mean_ranks)
    statistic, pvalue = _scipy().friedmanchisquare(*ranks.T)
    return Ranking(float(statistic), float(pvalue), mean_ranks)


def critical_difference(problems: int, solvers: int, confidence: float = 0.95) -> float:
    """Difference of mean ranks that Nemenyi's test calls significant (Demšar 2006, 3.2.2)."""
    _require_level(confidence)
    several = problems > 0 and solvers > 1
    _require(several, "size", "a problem, 2 solvers", (problems, solvers))
    studentized = _scipy().studentized_range.ppf(confidence, solvers, np.inf)
    # CD = q √(k (k + 1) / 6 N), with q the studentized range over √2
    q = studentized / np.sqrt(2)
    orders = solvers * (solvers + 1)
    spread = orders / (6 * problems)
    difference = q * np.sqrt(spread)
    return float(difference)


def shorter_chance(a: ArrayLike, b: ArrayLike) -> Values:
    """Chance that a run of `a` is shorter than one of `b`: P(a < b) + ½ P(a = b), `(…)`.

    Over all pairs of `a` `(…, n)` and `b` `(…, m)`; above ½ where `a` tends to be better. Failures
    are equal. It is 1 − A12 of Vargha and Delaney (2000).
    """
    x = _costs("a", a)
    y = _costs("b", b)
    *leading, n = x.shape
    *others, m = y.shape
    expected = f"shape {(*leading, 'm')}"
    _require(leading == others, "b", expected, y.shape)
    both = np.concatenate([x, y], axis=-1)
    ranks = _scipy().rankdata(both, axis=-1)
    # the rank sum of `a` is n (n + 1) / 2 more than the pairs that it loses, ties counting half
    lost = ranks[..., :n].sum(axis=-1) - n * (n + 1) / 2
    share = 1 - lost / (n * m)
    return np.asarray(share)[()]


def shorter_interval(chance: float, n: int, m: int, confidence: float = 0.95) -> Estimate:
    """Interval of `shorter_chance` of `n` and `m` runs: Newcombe's method 5 (2006).

    Its ends are the chances θ at which `chance` is a normal quantile away, with the variance

        V(θ) = θ (1 − θ) (1 + k (1 − θ) / (2 − θ) + k θ / (1 + θ)) / (n m),  k = (n + m) / 2 − 1,

    so it does not shrink to a point at 0 and 1, as a bootstrap does.
    """
    _require(n > 0 and m > 0, "runs", "at least one each", (n, m))
    _require_level(confidence)
    quantile = _scipy().norm.ppf((1 + confidence) / 2)
    k = (n + m) / 2 - 1

    def excess(theta: float) -> float:
        spread = 1 + k * (1 - theta) / (2 - theta) + k * theta / (1 + theta)
        variance = theta * (1 - theta) * spread / (n * m)
        return float((chance - theta) ** 2 - quantile**2 * variance)

    inside = min(max(chance, _BESIDE_END), 1 - _BESIDE_END)
    low = 0.0 if chance == 0 else _root(excess, inside, 0.0)
    high = 1.0 if chance == 1 else _root(excess, inside, 1.0)
    return Estimate(chance, low, high)


def mean_interval(shares: ArrayLike, groups: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Mean of shares between 0 and 1 `(n,)`, and an interval that counts each group once.

    The mean is one over the groups' means, as shares of one group are not independent. The interval
    is Wilson's (1927) for as many yes-or-no outcomes as there are groups: none of the same mean
    spreads more.
    """
    values = _shares("shares", shares)
    _, group = np.unique(np.asarray(groups), return_inverse=True)
    sums = np.bincount(group, weights=values)
    count = len(sums)
    _require_level(confidence)
    mean = float((sums / np.bincount(group)).mean())
    z = float(_scipy().norm.ppf((1 + confidence) / 2))
    centre = (mean + z**2 / (2 * count)) / (1 + z**2 / count)
    spread = mean * (1 - mean) / count + z**2 / (4 * count**2)
    half = z * spread**0.5 / (1 + z**2 / count)
    return Estimate(mean, max(0.0, centre - half), min(1.0, centre + half))


def bootstrap(
    statistic: Callable[..., Values],
    *samples: ArrayLike,
    paired: bool = False,
    confidence: float = 0.95,
    resamples: int = 9999,
    seed: int = 0,
) -> Estimate:
    """`statistic(*samples)` with its percentile bootstrap interval (Efron & Tibshirani 1993, 13).

    Each sample is `(runs,)`; `statistic` maps samples `(k, runs)` to `(k,)`, as `median` and
    `expected_running_time` do. Samples are drawn independently, or, if `paired`, run by run. Bounds
    may be +inf; they are NaN if a sample has a single run, which says nothing of the spread.
    """
    arrays = []
    for number, sample in enumerate(samples, 1):
        key = f"sample {number}"
        array = _costs(key, sample, 1)
        arrays.append(array)
    sizes = [array.size for array in arrays]
    matched = len(set(sizes)) == 1
    independent = not paired and sizes != []
    _require_level(confidence)
    _require(resamples > 0, "resamples", "at least 1", resamples)
    _require(matched or independent, "samples", "one size", sizes)
    value = float(statistic(*arrays))
    if min(sizes) < 2:
        return Estimate(value, np.nan, np.nan)
    values = sum(sizes)
    batch = max(1, _BOOTSTRAP_VALUES // values)
    with np.errstate(invalid="ignore"):  # SciPy's own interval is NaN where resamples are inf
        found = _scipy().bootstrap(
            arrays,
            lambda *drawn, axis: statistic(*drawn),
            paired=paired,
            vectorized=True,
            n_resamples=resamples,
            batch=batch,
            method="percentile",
            rng=np.random.default_rng(seed),
        )
    lower = (1 - confidence) / 2
    upper = (1 + confidence) / 2
    tails = [lower, upper]
    interval = quantile(found.bootstrap_distribution, tails)
    low, high = np.asarray(interval)
    return Estimate(
        value,
        low=float(low),
        high=float(high),
    )


def _scipy() -> Any:
    """`scipy.stats`, which takes a second to import and few commands need."""
    from scipy import stats

    return stats


def _root(function: Callable[[float], float], inside: float, end: float) -> float:
    """Where a function that is negative at `inside` and positive at `end` is 0."""
    from scipy.optimize import brentq

    return float(brentq(function, inside, end, xtol=1e-12))


def _doubled(ranks: Array) -> NDArray[np.int64]:
    """Twice the ranks: those shared by an even number of ties end in ½."""
    return np.rint(2 * ranks).astype(np.int64)


def _exact_signed_rank(ranks: Array, rank_sum: float) -> float:
    """Twice the share of all signs of the ranks whose positive ones sum to `rank_sum` or less."""
    doubled = _doubled(ranks)
    total = doubled.sum()
    chance = np.zeros(total + 1)
    chance[0] = 1.0
    for rank in doubled:
        # positive with probability ½; what it rolls over the end is 0
        chance = (chance + np.roll(chance, rank)) / 2
    end = round(2 * rank_sum) + 1
    tail = chance[:end].sum()
    return min(1.0, 2 * float(tail))


def _normal_signed_rank(sums: Array) -> float:
    """Two-sided p of a sum of independent terms with random signs."""
    deviation = np.sqrt((sums**2).sum())
    return float(2 * _scipy().norm.sf(abs(sums.sum()) / deviation))


def _exact_rank_sum(ranks: Array, n: int, rank_sum: float) -> float:
    """Twice the share of all choices of `n` of the ranks in the smaller tail at `rank_sum`."""
    doubled = _doubled(ranks)
    sums = doubled.sum() + 1
    # ways[k, s]: choices of k ranks that sum to s / 2
    ways = np.zeros((n + 1, sums))
    ways[0, 0] = 1.0
    for rank in doubled:
        room = sums - rank
        without = ways[:-1, :room].copy()
        ways[1:, rank:] += without
    chance = ways[n] / ways[n].sum()
    place = round(2 * rank_sum)
    at_most = chance[: place + 1].sum()
    at_least = chance[place:].sum()
    tail = min(at_most, at_least)
    return min(1.0, 2 * float(tail))


def _normal_rank_sum(ranks: Array, n: int) -> float:
    first = ranks[:n]
    second = ranks[n:]
    found = _scipy().mannwhitneyu(first, second, method="asymptotic")
    return float(found.pvalue)


def _profile(ratios: Array, at: ArrayLike | None) -> tuple[Array, Array]:
    """The ECDF of each column of `(problems, solvers)`, at the same points."""
    if at is None:
        x, _ = ecdf(ratios.ravel())
    else:
        x = np.asarray(at, dtype=float)
    shares = []
    for column in ratios.T:
        _, share = ecdf(column, x)
        shares.append(share)
    return x, np.stack(shares, axis=-1)


def _curves(histories: Sequence[ArrayLike]) -> list[Array]:
    """Per run, evaluations spent and best by then, where there is an answer: `(2, m)`."""
    _require(len(histories) > 0, "histories", "at least one run")
    numbers = [_numbers("history", history, 2) for history in histories]
    return [_curve(history) for history in numbers]


def _curve(history: Array) -> Array:
    """A history may rise (a better claim may certify worse): its best by then does not."""
    shape = history.shape
    _require(shape[1] == 2, "history", "evaluations and best, (m, 2)", shape)
    answered = history[:, 1] < np.inf
    curve: Array = history[answered].T
    spent, values = curve
    finite = np.isfinite(curve)
    rising = np.diff(spent) >= 0
    orderly = finite.all() and rising.all()
    _require(orderly, "history", "finite numbers, and evaluations that never fall")
    best = np.minimum.accumulate(values)
    return np.stack([spent, best])


def _costs(
    key: str,
    values: ArrayLike,
    axes: int | None = None,
) -> Array:
    """At least one number along each axis, +inf for NaN: no answer is the worst of all."""
    array = _numbers(key, values, axes)
    some = array.ndim and array.size
    _require(bool(some), key, "at least one value", array.shape)
    _require(array != -np.inf, key, "no −inf", array)
    missing = np.isnan(array)
    costs: Array = np.where(missing, np.inf, array)
    return costs


def _numbers(
    key: str,
    values: ArrayLike,
    axes: int | None = None,
    *,
    nan: bool = True,
) -> Array:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(key, "an array of numbers") from None
    if axes is not None:
        expected = f"an array of {axes} axes"
        _require(array.ndim == axes, key, expected, array.shape)
    if not nan:
        _require(~np.isnan(array), key, "no NaN", array)
    return array


def _shares(key: str, values: ArrayLike) -> Array:
    array = _numbers(key, values)
    inside = (array >= 0) & (array <= 1)
    _require(inside, key, "from 0 to 1", array)
    return array


def _require_level(confidence: float) -> None:
    inside = 0 < confidence < 1
    _require(inside, "confidence", "between 0 and 1", confidence)


def _require_shape(
    key: str,
    array: NDArray[Any],
    shape: tuple[int, ...],
) -> None:
    alike = array.shape == shape
    _require(alike, key, f"of shape {shape}", array.shape)


def _require(
    holds: ArrayLike,
    key: str,
    expected: str,
    value: object = None,
) -> None:
    """Raise `InvalidInput` unless all hold, with the first value that does not."""
    held = np.asarray(holds)
    if held.all():
        return
    if held.ndim:
        wrong = np.asarray(value)[~held]
        raise InvalidInput(key, expected, value=wrong[0])
    raise InvalidInput(key, expected, value=value)
