"""Statistics of repeated runs: arrays in, arrays and small records out.

    hits = evaluations_to_target(histories, 1.01 * optimum)      # (runs,), NaN where missed
    success_rate(hits <= budget)                                 # with its Wilson interval
    bootstrap(partial(expected_running_time, budgets=budget), hits)
    bootstrap(a12, ours, theirs)                                 # effect size and interval
    holm([wilcoxon(ours, theirs).pvalue for theirs in others])

Lower is better: values are durations (s), gaps, or evaluations. No answer is NaN or +inf, and is
worse than every answer, never left out. Runs lie along the last axis. Only equal numbers are tied:
round first where a difference means nothing. Every function raises `InvalidInput` for what is not
numbers, has the wrong shape, is empty (an empty family is fine for `holm`), or holds −inf.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from trajopt.exceptions import InvalidInput

Array = NDArray[np.float64]
Values = Array | np.float64  # a number where the runs were the only axis

EXACT = 50  # differences up to which Wilcoxon's p is exact


@dataclass(frozen=True)
class Estimate:
    """A value and the confidence interval around it."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Paired:
    """Wilcoxon's rank sum `T`, two-sided p, and how often `a` was below, equal to, above `b`."""

    statistic: float
    pvalue: float
    wins: int
    ties: int
    losses: int


@dataclass(frozen=True, eq=False)
class Ranking:
    """Friedman's chi-square, its p, and the mean rank of each solver `(solvers,)`, 1 the best."""

    statistic: float
    pvalue: float
    mean_ranks: Array


def success_rate(successes: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Share of true in booleans `(runs,)`, such as feasibility, with Wilson's interval (1927)."""
    outcomes = _costs("successes", successes, 1)
    _require(np.isin(outcomes, (0, 1)), "successes", "true or false", outcomes)
    _require(0 < confidence < 1, "confidence", "between 0 and 1", confidence)
    counted = stats.binomtest(int(outcomes.sum()), outcomes.size)
    low, high = counted.proportion_ci(confidence, method="wilson")
    return Estimate(float(outcomes.mean()), float(low), float(high))


def quantile(values: ArrayLike, q: ArrayLike) -> Values:
    """Quantiles `q` of values `(…, runs)`: `(…)`, or `(…, k)` for `k` of them.

    Linear between neighbouring runs, as NumPy's; +inf from the first run without an answer on.
    """
    ordered, share = np.sort(_costs("values", values)), np.asarray(q, dtype=float)
    _require((share >= 0) & (share <= 1), "q", "from 0 to 1", share)
    place = np.round(share * (ordered.shape[-1] - 1), 9)  # 0.55 · 100 must not reach past 55
    low, high = (ordered[..., whole(place).astype(int)] for whole in (np.floor, np.ceil))
    with np.errstate(invalid="ignore"):
        between = low * (1 - place % 1) + high * (place % 1)
    return np.where(low == high, low, between)[()]


def median(values: ArrayLike) -> Values:
    """Median of values `(…, runs)`: `(…)`; +inf where half of the runs have no answer."""
    return quantile(values, 0.5)


def summary(gaps: ArrayLike) -> Array:
    """Best, first quartile, median, third quartile and worst of gaps `(…, runs)`: `(…, 5)`."""
    return np.asarray(quantile(gaps, [0, 0.25, 0.5, 0.75, 1]))


def ecdf(values: ArrayLike, at: ArrayLike | None = None) -> tuple[Array, Array]:
    """`x` (`at`, or wherever it steps), and the share of values `(runs,)` that are at most `x`.

    Runs without an answer never are: the share ends at the success rate, even at +inf.
    """
    runs = _costs("values", values, 1)
    answers = np.sort(runs[np.isfinite(runs)])
    x = np.unique(answers) if at is None else _numbers("at", at, nan=False)
    return x, np.asarray(np.searchsorted(answers, x, side="right") / runs.size)


def evaluations_to_target(histories: Sequence[ArrayLike], targets: ArrayLike) -> Array:
    """Evaluations that each run spent until its best was at most the target, NaN where never.

    `histories`: per run `(m, 2)`, evaluations spent and best by then; rows without an answer are
    passed over. Returns `(runs,)`, or `(targets, runs)`; the target +inf is the first answer.
    """
    curves, wanted = _curves(histories), _numbers("targets", targets, nan=False)
    hits = [np.append(n, np.nan)[np.searchsorted(-best, -wanted)] for n, best in curves]
    return np.stack(hits, axis=-1)


def fixed_budget(histories: Sequence[ArrayLike], budgets: ArrayLike) -> Array:
    """Best of each run within a budget of evaluations (its last, if it ended before), NaN if none.

    `histories` as above. Returns `(runs,)`, or `(budgets, runs)`: its `median` is a curve.
    """
    curves, limit = _curves(histories), _numbers("budgets", budgets, nan=False)
    found = [np.insert(best, 0, np.nan)[np.searchsorted(n, limit, "right")] for n, best in curves]
    return np.stack(found, axis=-1)


def expected_running_time(hits: ArrayLike, budgets: ArrayLike) -> Values:
    """Evaluations spent by all runs until target or budget, per success (Hansen et al. 2021, COCO).

    `hits` `(…, runs)` from `evaluations_to_target`; `budgets`, what each run spent or was allowed,
    broadcasts against them. A hit beyond its budget is a miss. Returns `(…)`; +inf if all missed,
    as is then its `bootstrap` interval, which sees no further: look at that of `success_rate`.
    """
    reached, limit = _costs("hits", hits), _numbers("budgets", budgets)
    _require(reached >= 0, "hits", "0 or more", reached)
    _require((limit > 0) & np.isfinite(limit), "budgets", "positive and finite", limit)
    fits = limit.shape in ((), reached.shape[-1:], reached.shape)
    _require(fits, "budgets", f"one, or of shape {reached.shape}", limit.shape)
    spent, successes = np.minimum(reached, limit).sum(axis=-1), (reached <= limit).sum(axis=-1)
    with np.errstate(divide="ignore"):
        return np.asarray(spent / successes)[()]


def performance_profile(costs: ArrayLike, taus: ArrayLike | None = None) -> tuple[Array, Array]:
    """Share of problems each solver solves within `tau` times the best (Dolan & Moré 2002).

    `costs` `(problems, solvers)`, positive. Returns `taus` `(k,)` (by default, wherever a profile
    steps) and shares `(k, solvers)`. A problem that none solved counts against all of them.
    """
    table = _costs("costs", costs, 2)
    _require(table > 0, "costs", "positive, since profiles are of ratios", table)
    with np.errstate(invalid="ignore", over="ignore"):
        return _profile(table / table.min(axis=1, keepdims=True), taus)


def data_profile(
    evaluations: ArrayLike, dimension: ArrayLike, alphas: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Share of problems each solver solves in `alpha` simplex gradients (Moré & Wild 2009).

    `evaluations` `(problems, solvers)` to the target; `dimension`, a number or `(problems,)`: a
    simplex gradient is `dimension + 1` evaluations. Returns `alphas` and shares, as above.
    """
    table, size = _costs("evaluations", evaluations, 2), _numbers("dimension", dimension)
    _require(table >= 0, "evaluations", "0 or more", table)
    _require((size >= 1) & np.isfinite(size), "dimension", "at least 1", size)
    _require(size.shape in ((), table.shape[:1]), "dimension", "one per problem", size.shape)
    return _profile((table.T / (size + 1)).T, alphas)


def wilcoxon(a: ArrayLike, b: ArrayLike) -> Paired:
    """Wilcoxon's signed-rank test on pairs `(pairs,)`, two-sided (Wilcoxon 1945).

    Equal pairs, two failures too, are dropped (p = 1 if none is left); a failure differs most from
    an answer. p is exact, ties or not, up to `EXACT` differences, then normal and tie-corrected.
    """
    x, y = _costs("a", a, 1), _costs("b", b, 1)
    _require(x.size == y.size, "b", f"as many values as in a, {x.size}", y.size)
    differ = x != y
    with np.errstate(over="ignore"):
        change = x[differ] - y[differ]
    ranks = stats.rankdata(np.abs(change))
    least = float(min(ranks[change < 0].sum(), ranks[change > 0].sum()))
    counts = int((change < 0).sum()), int((~differ).sum()), int((change > 0).sum())
    few = change.size <= EXACT
    return Paired(least, _by_signs(ranks, least) if few else _by_normal(change), *counts)


def holm(pvalues: ArrayLike) -> Array:
    """p-values adjusted for being one family (Holm 1979), in their own shape."""
    p = _numbers("pvalues", pvalues)
    _require((p >= 0) & (p <= 1), "pvalues", "from 0 to 1", p)
    order = np.argsort(p, axis=None)
    adjusted = np.empty(p.size)
    adjusted[order] = np.maximum.accumulate(p.ravel()[order] * np.arange(p.size, 0, -1))
    return np.minimum(adjusted, 1).reshape(p.shape)


def friedman(costs: ArrayLike) -> Ranking:
    """Friedman's test on costs `(problems, solvers)`, at least 3 solvers (Demšar 2006, 3.2.2).

    Ties share their mean rank; the statistic is corrected for them. If all are tied, p = 1.
    """
    ranks = stats.rankdata(_costs("costs", costs, 2), axis=1)
    _require(ranks.shape[1] > 2, "costs", "3 solvers or more (for 2, wilcoxon)", ranks.shape)
    if (ranks == ranks[:, :1]).all():
        return Ranking(0.0, 1.0, ranks.mean(axis=0))
    statistic, pvalue = map(float, stats.friedmanchisquare(*ranks.T))
    return Ranking(statistic, pvalue, ranks.mean(axis=0))


def critical_difference(problems: int, solvers: int, confidence: float = 0.95) -> float:
    """Difference of mean ranks that Nemenyi's test calls significant (Demšar 2006, 3.2.2)."""
    _require(0 < confidence < 1, "confidence", "between 0 and 1", confidence)
    _require(problems > 0 and solvers > 1, "size", "a problem, 2 solvers", (problems, solvers))
    q = stats.studentized_range.ppf(confidence, solvers, np.inf) / np.sqrt(2)
    return float(q * np.sqrt(solvers * (solvers + 1) / (6 * problems)))


def a12(a: ArrayLike, b: ArrayLike) -> Values:
    """P(a > b) + ½ P(a = b) over all pairs of `a` `(…, n)` and `b` `(…, m)`: `(…)`.

    Below ½ where `a` tends to be lower (better); failures are equal (Vargha & Delaney 2000).
    """
    x, y = _costs("a", a), _costs("b", b)
    _require(x.shape[:-1] == y.shape[:-1], "b", f"shape (*{x.shape[:-1]}, m)", y.shape)
    n, m = x.shape[-1], y.shape[-1]
    ranks = stats.rankdata(np.concatenate([x, y], axis=-1), axis=-1)[..., :n]
    return np.asarray((ranks.sum(axis=-1) - n * (n + 1) / 2) / (n * m))[()]


def bootstrap(
    statistic: Callable[..., Values], *samples: ArrayLike, paired: bool = False,
    confidence: float = 0.95, resamples: int = 9999, seed: int = 0,
) -> Estimate:  # fmt: skip
    """`statistic(*samples)` with its percentile bootstrap interval (Efron & Tibshirani 1993, 13).

    Each sample is `(runs,)`; `statistic` maps samples `(k, runs)` to `(k,)`, as `median`, `a12` and
    `expected_running_time` do. Samples are drawn independently, or, if `paired`, run by run. Bounds
    may be +inf; they are NaN if a sample has a single run, which says nothing of the spread.
    """
    arrays = [_costs(f"sample {i + 1}", s, 1) for i, s in enumerate(samples)]
    sizes = [x.size for x in arrays]
    _require(0 < confidence < 1, "confidence", "between 0 and 1", confidence)
    _require(resamples > 0, "resamples", "at least 1", resamples)
    _require(len(set(sizes)) == 1 or (not paired and sizes != []), "samples", "one size", sizes)
    value = float(statistic(*arrays))
    if min(sizes) < 2:
        return Estimate(value, np.nan, np.nan)
    with np.errstate(invalid="ignore"):  # SciPy's own interval is NaN where resamples are inf
        values = stats.bootstrap(
            arrays, lambda *drawn, axis: statistic(*drawn), paired=paired, vectorized=True,
            n_resamples=resamples, batch=max(1, 10**6 // sum(sizes)), method="percentile",
            rng=np.random.default_rng(seed),
        ).bootstrap_distribution  # fmt: skip
    low, high = np.asarray(quantile(values, [(1 - confidence) / 2, (1 + confidence) / 2]))
    return Estimate(value, float(low), float(high))


def _by_signs(ranks: Array, least: float) -> float:
    """Twice the share of all signs of the ranks whose sum is at most `least`, in halves too."""
    doubled = np.rint(2 * ranks).astype(int)  # ranks shared by an even number of ties end in ½
    chance = np.eye(1, doubled.sum() + 1)[0]
    for rank in doubled:
        chance = (chance + np.roll(chance, rank)) / 2  # what it rolls over the end is 0
    return min(1.0, 2 * float(chance[: round(2 * least) + 1].sum()))


def _by_normal(change: Array) -> float:
    return float(stats.wilcoxon(change, method="asymptotic").pvalue)


def _profile(ratios: Array, at: ArrayLike | None) -> tuple[Array, Array]:
    """The ECDF of each column of `(problems, solvers)`, at the same points."""
    x = ecdf(ratios.ravel())[0] if at is None else np.asarray(at, dtype=float)
    return x, np.stack([ecdf(column, x)[1] for column in ratios.T], axis=-1)


def _curves(histories: Sequence[ArrayLike]) -> list[Array]:
    """Per run, evaluations spent and best by then, where there is an answer: `(2, m)`."""
    _require(len(histories) > 0, "histories", "at least one run")
    return [_curve(_numbers("history", h, 2)) for h in histories]


def _curve(history: Array) -> Array:
    _require(history.shape[1] == 2, "history", "evaluations and best, (m, 2)", history.shape)
    curve = history[history[:, 1] < np.inf].T
    orderly = np.isfinite(curve).all() and (np.diff(curve) * [[1], [-1]] >= 0).all()
    _require(orderly, "history", "evaluations that never fall and a best that never rises")
    return curve


def _costs(key: str, values: ArrayLike, axes: int | None = None) -> Array:
    """At least one number along each axis, +inf for NaN: no answer is the worst of all."""
    array = _numbers(key, values, axes)
    _require(array.ndim > 0 and array.size > 0, key, "at least one value", array.shape)
    _require(array != -np.inf, key, "no −inf", array)
    return np.where(np.isnan(array), np.inf, array)


def _numbers(key: str, values: ArrayLike, axes: int | None = None, *, nan: bool = True) -> Array:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(key, "an array of numbers") from None
    _require(axes in (None, array.ndim), key, f"an array of {axes} axes", array.shape)
    _require(nan or ~np.isnan(array), key, "no NaN", array)
    return array


def _require(holds: ArrayLike, key: str, expected: str, value: object = None) -> None:
    """Raise `InvalidInput` unless all hold, with the first value that does not."""
    if not np.all(holds):
        bad = np.asarray(value)[~np.asarray(holds)].flat[0] if np.ndim(holds) else value
        raise InvalidInput(key, expected, value=bad)
