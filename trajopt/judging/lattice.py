"""The step of a sensor, from the values alone: all are whole multiples of it beside an offset.

An encoder's step is rarely a unit of the last digit, and its values are printed with more digits
than they have. Gaps between sorted distinct values are then multiples of the step, up to one
printed unit. Neither repeated values nor a known offset, gear or unit of angle is needed.
"""

from __future__ import annotations

from math import log10, sqrt

import numpy as np

from trajopt.core.arrays import Array

LEAST_UNITS = 2.0
"""Steps below this many printed units cannot be told from the digits."""
LEAST_STEP = 1e-7
"""No smaller step is looked for, rad."""

_LEAST_VALUES = 6
_GAPS = 24, 160  # the smallest ones that are used: at least, at most
_MOST_COSINES = 2e6
_MOST_PEAKS = 60
_ALIKE = 0.7, 0.93  # sum of cosines at a step, of 1: at least with many gaps, with few
_OFF_UNITS = 0.62  # a value is off by half a unit of its own and by that of the offset's estimate
_OFF_SHARE = 0.004  # of the step
_CHANCE = 6  # decimal logarithm of the odds that values without a step pass


def lattice(values: Array, unit: float) -> tuple[float, Array] | None:
    """Return the step, and the values moved onto their multiples of it; None if none is certain.

    Args:
        values: `(samples,)`.
        unit: The printed unit: a value is off by at most half of it.
    """
    distinct = np.unique(values)
    distinct = distinct[np.append(True, np.diff(distinct) > unit / 2)]
    if len(distinct) < _LEAST_VALUES:
        return None
    gaps = np.diff(distinct)
    for step in _candidates(np.sort(gaps), unit):
        found = _fitted(distinct, gaps, step, unit)
        if found is not None:
            step, offset = found
            return step, offset + step * np.round((values - offset) / step)
    return None


def _candidates(gaps: Array, unit: float) -> list[float]:
    """Return steps of which most of the smallest gaps are multiples, the largest step first.

    At a frequency f of the step, `cos 2π f gap` is 1 for every gap, but for the printed digits,
    which reduce its mean to sinc²(unit f).
    """
    least = max(LEAST_UNITS * unit, LEAST_STEP)
    most = 1.02 * (gaps[0] + unit)  # no step is wider than the smallest gap
    if most <= least:
        return []
    fewest, small = _GAPS[0], gaps[: _GAPS[1]]
    while True:
        resolution = 1 / (10 * small[-1])
        count = int((1 / least - 1 / most) / resolution) + 2
        if count * len(small) <= _MOST_COSINES or len(small) <= fewest:
            break
        small = small[: max(fewest, len(small) // 2)]
    count = min(count, int(_MOST_COSINES / len(small)))
    frequencies = 1 / most + resolution * np.arange(count)
    alike = np.zeros(count)
    for gap in small:
        alike += np.cos(2 * np.pi * gap * frequencies)
    alike /= len(small) * np.sinc(np.minimum(unit * frequencies, 0.6)) ** 2
    low, high = _ALIKE
    needed = np.clip(4 / sqrt(2 * len(small)) + 0.3, low, high)
    before, after = np.append(-1, alike[:-1]), np.append(alike[1:], -1)
    peaks = np.flatnonzero((alike >= needed) & (alike >= before) & (alike >= after))
    steps: list[float] = (1 / frequencies[peaks[:_MOST_PEAKS]]).tolist()
    return steps


def _fitted(values: Array, gaps: Array, step: float, unit: float) -> tuple[float, float] | None:
    """Refine a step over longer and longer gaps, then over all values: the step, and an offset.

    Return None if a value is off its multiple, or if values without a step might pass.
    """
    order = np.sort(gaps)
    used = 16
    while True:
        part = order[:used]
        multiples = np.round(part / step)
        if not multiples.any():
            return None
        step = float((multiples * part).sum() / (multiples**2).sum())
        if used >= len(order):
            break
        used *= 2
    multiples = np.append(0, np.cumsum(np.round(gaps / step)))
    if not (np.diff(multiples) > 0).all():
        return None
    for _ in range(3):
        centre = multiples.mean()
        since = multiples - centre
        step = float((since * values).sum() / (since**2).sum())
        offset = float(values.mean() - step * centre)
        again = np.round((values - offset) / step)
        if (again == multiples).all():
            break
        multiples = again
    allowed = _OFF_UNITS * unit + _OFF_SHARE * step
    share = 2 * allowed / step
    certain = share < 1 and len(values) * log10(share) < -_CHANCE
    off = np.abs(values - offset - step * multiples).max()
    return (step, offset) if step >= LEAST_UNITS * unit and certain and off <= allowed else None
