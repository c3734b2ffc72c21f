"""What a few rows of a log prove: divided differences of positions (or velocities).

A divided difference of order k of samples is a mean of the k-th derivative between them, whatever
the motion is. It is known within a half width, from those of its k + 1 samples. So these rows prove
how much of a limit every motion within the half widths uses, and a reader checks it by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import factorial, inf

import numpy as np

from trajopt.core.arrays import Array

EXCESS = 0.05
"""A mean excess over a window that must show, as a share of the limit."""

_STRIDE_GROWTH = 1.25
_MAX_STRIDE_BY_ONE = 8


@dataclass(frozen=True)
class WindowBound:
    """A bound on the use of a limit, from windows of samples.

    Attributes:
        share: Every motion within the half widths uses at least this share of the limit.
        rows: The samples that prove it, counted from 0.
        margin: No motion keeps the limit unless half widths were this times as wide. Below 1 the
            windows prove nothing.
        window: The shortest window, s, over which the samples exclude a mean excess of `EXCESS`;
            infinite if there is none.
        of_velocities: Whether the rows are those of logged velocities.
    """

    share: float
    rows: tuple[int, ...] = ()
    margin: float = 0.0
    window: float = inf
    of_velocities: bool = False


def bound(
    times: Array,
    values: Array,
    half: Array,
    low: float | Array,
    high: float | Array,
    order: int,
) -> WindowBound:
    """Return the best bound over windows of all lengths.

    Args:
        times: Increasing, s, `(samples,)`.
        values: Positions or velocities, `(samples,)`.
        half: Their half widths.
        low, high: The limit; or at each sample, of which the loosest of a window counts for the
            share, and the tightest for the window.
        order: Of the derivative of `values`.
    """
    share, margin, shown = 0.0, 0.0, inf
    rows: tuple[int, ...] = ()
    fixed = np.ndim(low) == 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for stride, mean, doubt, longest in means_over_windows(times, values, half, order):
            loose_low, loose_high = low, high
            tight_low, tight_high = low, high
            if not fixed:
                size = order * stride + 1
                loose_low, tight_low = _filtered(low, size)
                tight_high, loose_high = _filtered(high, size)
            least = np.maximum((mean - doubt) / loose_high, (mean + doubt) / loose_low)
            least = np.nan_to_num(least, nan=0.0, posinf=0.0)
            first = int(np.argmax(least))
            if least[first] > share:
                share = float(least[first])
                rows = tuple(range(first, first + order * stride + 1, stride))
            wider = np.maximum(mean - loose_high, loose_low - mean) / doubt
            margin = max(margin, float(np.nan_to_num(wider, nan=0.0, posinf=0.0).max()))
            most = np.maximum((mean + doubt) / tight_high, (mean - doubt) / tight_low)
            if most.max() <= 1 + EXCESS:
                shown = min(shown, longest)
    return WindowBound(share, rows, margin, shown)


def best(bounds: Sequence[WindowBound]) -> WindowBound:
    """Return the largest of bounds, with the shortest window of all."""
    largest = max(bounds, key=lambda own: own.share)
    shown = min(own.window for own in bounds)
    return WindowBound(largest.share, largest.rows, largest.margin, shown, largest.of_velocities)


def proved(times: Array, values: Array, half: Array, low: float, high: float) -> Fraction:
    """Return the share of a limit that samples prove, in rational numbers.

    Their number determines the order of the derivative: one sample is a value itself.
    """
    order = len(times) - 1
    at = [Fraction(float(own)) for own in times]
    mean, doubt = Fraction(0), Fraction(0)
    for i, (value, width) in enumerate(zip(values, half, strict=True)):
        weight = Fraction(factorial(order))
        for j in range(order + 1):
            if j != i:
                weight /= at[i] - at[j]
        mean += weight * Fraction(float(value))
        doubt += abs(weight) * Fraction(float(width))
    return max((mean - doubt) / Fraction(float(high)), (mean + doubt) / Fraction(float(low)))


def means_over_windows(
    times: Array, values: Array, half: Array, order: int
) -> Iterator[tuple[int, Array, Array, float]]:
    """Yield means of a derivative over longer and longer windows; order 0 are the values.

    Yields:
        The number of steps between a window's samples, each window's mean and its half width, and
        the longest window, s.
    """
    if order == 0:
        yield 1, values, half, 0.0
        return
    stride = 1
    while order * stride < len(times):
        count = len(times) - order * stride
        parts = [slice(i * stride, i * stride + count) for i in range(order + 1)]
        at = [times[part] for part in parts]
        mean, doubt = np.zeros(count), np.zeros(count)
        for i, part in enumerate(parts):
            weight = np.full(count, float(factorial(order)))
            for j in range(order + 1):
                if j != i:
                    weight /= at[i] - at[j]
            mean += weight * values[part]
            doubt += np.abs(weight) * half[part]
        yield stride, mean, doubt, float((at[-1] - at[0]).max())
        stride = stride + 1 if stride < _MAX_STRIDE_BY_ONE else int(_STRIDE_GROWTH * stride)


def _filtered(values: float | Array, size: int) -> tuple[Array, Array]:
    """Return the smallest and the largest value in each window of `size` samples."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    def inner(extreme: Callable[..., Array]) -> Array:
        found: Array = extreme(values, size)
        return found[size // 2 :][: np.size(values) - size + 1]

    return inner(minimum_filter1d), inner(maximum_filter1d)
