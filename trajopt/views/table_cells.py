"""The cells of every table of trials, as text: of the terminal, a notebook, the report and LaTeX.

A row is one of a frame of `Results`: of `summary`, `planners`, `paired` or `between_seeds`.
"""

from __future__ import annotations

from math import comb, floor, isinf, isnan, log10
from typing import Any

from trajopt.core.numerals import rounded_down

MISSING = "–"
INFINITE = "∞"
TO_ROUNDING = "to rounding"  # in place of a share of runs that kept every limit
NO_ANSWER = "none"  # in place of an infinite gap, duration or ratio
ALONE = "alone"  # in place of a ratio of 0: only it has an answer
_SMALLEST_RATIO = 5e-5  # smallest ratio that is printed; smaller ones would be 0.0000
_ZERO = 5e-5  # largest gap that is printed as 0.00 %
ROUNDING = 1e-4  # a smaller dilation minus 1 counts as no broken limit
_SHORT_S = 0.01  # computing times below have two digits
SURE = 0.05  # a difference is significant if its adjusted p is smaller
FEWEST_GROUPS = 6  # with fewer groups no signed-rank test has a p below SURE: 2/2⁵ is 0.0625
SMALLEST_P = 0.001  # smaller p-values are printed as less than this

Cells = dict[str, str]


def number(value: float | None, form: str = ".4f") -> str:
    """A number; None and NaN are `MISSING`, and infinity is ∞."""
    if value is None or isnan(value):
        return MISSING
    return INFINITE if isinf(value) else format(value, form)


def duration(value: float) -> str:
    """Return a median, s, as text; a word if half of the runs have no answer."""
    return NO_ANSWER if isinf(value) else number(value)


def gap(value: float) -> str:
    """Return a ratio minus 1 in percent; it is infinite for a planner without an answer."""
    return NO_ANSWER if isinf(value) else number(100 * value, "+z.2f")


def percent(gap: float) -> str:
    """A ratio minus 1 in a sentence: two decimals below 10 %, one above; 0.00 % without a sign."""
    if abs(gap) < _ZERO:
        return "0.00 %"
    digits = 2 if abs(gap) < 0.1 else 1
    return f"{100 * gap:+.{digits}f} %".replace("-", "−")


def ratio(value: float, form: str = ".4f") -> str:
    """Return a duration over a rival's, as text; either is infinite without an answer."""
    if value == 0:
        return ALONE
    if isinf(value):
        return NO_ANSWER
    return number(value, ".1e" if value < _SMALLEST_RATIO else form)


def seconds(value: float | None) -> str:
    """Return a computing time, s, with three decimals, or two digits if it is shorter."""
    if value is None or isnan(value) or value >= _SHORT_S or value == 0:
        return number(value, ".3f")
    return f"{value:.1e}".replace("e-0", "e-")


def integral(value: float | None) -> str:
    """Return an integral of squares with four digits; ∞ for a motion that jumps."""
    if value is None or isnan(value) or isinf(value):
        return number(value)
    digits = max(0, 3 - floor(log10(value))) if value > 0 else 0
    return f"{value:.3e}" if value >= 1e6 or digits > 7 else f"{value:.{digits}f}"


def times(value: float | None) -> str:
    """Return a ratio to a least value with three digits."""
    if value is None:
        return MISSING
    return f"{value:.{max(0, 2 - floor(log10(value)))}f}"


LEAST_JERK = "∫ jerk² over the least known of a motion of the same duration"
"""What a ratio of ∫ jerk² is; there is none where limits act on that motion."""


def probability(value: float) -> str:
    """Return a p-value as text."""
    return f"< {SMALLEST_P}" if value < SMALLEST_P else number(value, ".3f")


def dilation(ratio: float) -> str:
    """Return a dilation as text, if it is more than rounding."""
    return f"× {ratio:.4f}" if ratio >= 1 + ROUNDING else MISSING


def grade(status: str, *, feasible: bool | None, slower: float | None) -> str:
    """Return a status in words: of a motion that breaks a limit, by how much it is slowed down.

    Args:
        status: Of a trial.
        feasible: Whether the motion keeps every limit as claimed; None without a motion.
        slower: The least dilation that mends it; None without a motion.
    """
    if status != "solved" or feasible or slower is None or dilation(slower) == MISSING:
        return status
    return f"{status}, slowed {dilation(slower)}"


def kept(share: float, needed: float) -> str:
    """Return the share of runs that kept every limit; a word if all did up to rounding.

    Args:
        share: Share of the runs that kept every limit as claimed.
        needed: Median dilation of the others; NaN where there are none.
    """
    return TO_ROUNDING if 1 < needed < 1 + ROUNDING else f"{100 * share:.0f} %"


LIBRARY = "the part of it inside the calls of the library that a planner wraps"
"""What the column `library` beside a time means; without such planners the column is left out."""


def of_summary(row: Any) -> Cells:
    """Return the cells of a problem and planner; without a duration, its bound or status."""
    moves = not isnan(row.median)
    without = row.status if isnan(row.lower_bound) else f"≥ {rounded_down(row.lower_bound, '.4f')}"
    several = moves and row.runs > 1
    return {
        "solved": f"{row.solved} of {row.runs}",
        "kept": kept(row.kept, row.dilation) if moves else MISSING,
        "median": number(row.median) if moves else without,
        "quartiles": f"{row.q1:.4f}–{row.q3:.4f}" if several else MISSING,
        "gap": gap(row.gap),
        "dilation": dilation(row.dilation),
        "jerk_integral": integral(row.jerk_integral),
        "evaluations": number(row.evaluations, ".0f"),
        "solve_time": number(row.solve_time, ".3f"),
        "library_time": seconds(row.library_time),
    }


def of_planner(row: Any) -> Cells:
    """Return the cells of a planner, over the problems for which it competes."""
    return {
        "problems": str(row.counted),
        "not_applicable": str(row.not_applicable),
        "solved": f"{row.solved} of {row.solved + row.failed}",
        "failed": str(row.failed),
        "gap": gap(row.gap),
        "worst": gap(row.worst),
        "there": gap(row.there),
        "rank": number(row.rank, ".2f"),
        "time": number(row.time, ".3f"),
        "library": seconds(row.library),
    }


def of_pair(row: Any) -> Cells:
    """Return the cells of a planner against a rival: ratio, chance of a shorter run, p."""
    return {
        "ratio": ratio(row.ratio),
        "chance": number(row.chance, ".2f"),
        "interval": f"{row.low:.2f}–{row.high:.2f}",
        "p": probability(row.pvalue),
        "holm": probability(row.holm),
    }


def evidence(row: Any) -> str:
    """Say what the evidence for a difference between two planners is.

    Args:
        row: Of `Results.paired()` or of `Results.between_seeds()`.
    """
    if getattr(row, "proved", False):
        return "proved"
    if row.holm < SURE:
        return "yes"
    if decided := getattr(row, "decided", 0):
        return f"proved on {decided:.0f} of {row.problems:.0f}"
    too_few = _too_few(row)
    return f"{too_few}: cannot be tested" if too_few else "not shown"


def _too_few(row: Any) -> str:
    """Name what is too few for any test to have a p below `SURE`; empty if there is enough."""
    groups = getattr(row, "groups", None)
    if groups is None:  # runs on one problem: all of one before all of the other
        smallest = 2 / comb(round(row.runs + row.rival_runs), round(row.runs))
        return "" if smallest < SURE else f"{row.runs:.0f} against {row.rival_runs:.0f} runs"
    if groups >= FEWEST_GROUPS:
        return ""
    return "one family" if groups == 1 else f"{groups:.0f} families"


def reference(row: Any) -> str:
    """Say what gaps are measured against, and how closely that is proved.

    Args:
        row: Has the columns of `Results.references()`.
    """
    shortest = f"{row.reference:.6f} s"
    known = "the best known, not proved (the planner prove may prove it)"
    if row.proved > 0:
        within = 100 * (row.reference / row.proved - 1)
        by = f", recorded: {row.recorded_proof}" if row.recorded_proof else ""
        lower = rounded_down(row.proved, ".6f")
        known = f"proved within {within:.3f} % (lower bound {lower} s{by})"
    kinds = {
        "exact": f"the exact optimum, {shortest}",
        "refined": f"refined collocation, {shortest}",
        "relaxed": f"the best known without some of the limits, {shortest}",
        "lower bound": f"a lower bound, {shortest}",
        "best known": f"the best known, verified anew: {row.recorded}, {shortest}",
    }
    return f"Gaps are to {kinds[row.kind]}: {known}."
