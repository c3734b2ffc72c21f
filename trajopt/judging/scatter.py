"""How much samples scatter: the standard deviation of what no smooth motion explains.

A normalised divided difference of order k (weights whose squares sum to 1) has the standard
deviation of white noise, and of a motion it shows its k-th derivative only. Noise that is filtered
or coloured shows between samples that are farther apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb, sqrt

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.judging.tube_proof import Limit

LEAST_WINDOWS = 12
"""Fewer windows in motion tell nothing."""

_ORDERS = (3, 4, 5, 6, 8)
_STRIDES = (1, 2, 3, 4, 6, 8, 12, 16, 24)
_MOST_BLOCKS = 15
_MOVING = 1.5  # a window that spans less than that many units stands still
_OWN = 0.25  # of a limit's largest difference: about what a lawful motion has by itself
_EVEN = 1e-6  # relative differences of steps in time that count as none


@dataclass(frozen=True)
class Scatter:
    """The largest scatter over distances of samples.

    Attributes:
        sigma: Standard deviation, rad.
        windows: How many windows it is the scatter of.
    """

    sigma: float
    windows: int

    def upper(self, errors: float) -> float:
        """Return sigma, larger by some standard errors of it."""
        return self.sigma * (1 + errors / sqrt(self.windows))


def scatter(times: Array, values: Array, unit: float, order: int, limit: Limit) -> Scatter | None:
    """Return the scatter; None where too few windows move.

    The smallest over the orders of differences counts, and the largest over their distances, up to
    the distance at which a lawful motion may look as if it scattered.

    Args:
        times: Increasing, s, `(samples,)`.
        values: `(samples,)`.
        unit: The step or the printed unit of the values.
        order, limit: Of the highest derivative that is limited.
    """
    largest: Scatter | None = None
    step = float(np.median(np.diff(times)))
    for stride in _STRIDES:
        each = list(_by_order(times, values, unit, stride))
        if not each:
            break
        found = min(each, key=lambda own: own.sigma)
        if largest is None or found.sigma > largest.sigma:
            largest = found
        own = _OWN * max(map(abs, limit)) * (stride * step) ** order
        if own > max(found.sigma, unit / sqrt(12)) / 2:
            break
    return largest


def _by_order(times: Array, values: Array, unit: float, stride: int) -> Iterator[Scatter]:
    for order in _ORDERS:
        squares, moving, _ = differences(times, values, unit, order, stride)
        squares = squares[moving]
        count = len(squares)
        if count < LEAST_WINDOWS:
            continue
        # The median over blocks of mean squares: switches of a motion are in few blocks. A median
        # of single differences fails, since on a lattice they take few values.
        blocks = np.array_split(squares, np.clip(count // 8, 3, _MOST_BLOCKS) if count >= 24 else 1)
        mean = float(np.median([block.mean() for block in blocks]))
        yield Scatter(sqrt(mean), count)


def differences(
    times: Array, values: Array, unit: float, order: int, stride: int = 1
) -> tuple[Array, Bools, Array]:
    """Return the squares of normalised differences, which windows move, and their mean speeds.

    Args:
        times, values, unit: As for `scatter`.
        order: Of the differences.
        stride: Number of steps between the samples of a window.
    """
    span = order * stride
    if len(times) <= span:
        return np.zeros(0), np.zeros(0, bool), np.zeros(0)
    each = np.lib.stride_tricks.sliding_window_view(values, span + 1)[:, ::stride]
    at = np.lib.stride_tricks.sliding_window_view(times, span + 1)[:, ::stride]
    squares = (_weights(times, at) * each).sum(axis=1) ** 2
    moving = np.ptp(each, axis=1) > _MOVING * unit
    speeds = np.abs(each[:, -1] - each[:, 0]) / (at[:, -1] - at[:, 0])
    return squares, moving, speeds


def _weights(times: Array, at: Array) -> Array:
    """Return the weights of normalised divided differences, `(windows or 1, order + 1)`."""
    count = at.shape[1]
    steps = np.diff(times)
    if np.ptp(steps) < _EVEN * steps.mean():
        weights = np.array([[(-1.0) ** i * comb(count - 1, i) for i in range(count)]])
    else:
        local = (at - at.mean(axis=1, keepdims=True)) / np.ptp(at, axis=1)[:, None]
        apart = local[:, :, None] - local[:, None, :]
        apart[:, range(count), range(count)] = 1.0
        weights = 1 / apart.prod(axis=2)
    found: Array = weights / np.sqrt((weights**2).sum(axis=1, keepdims=True))
    return found
