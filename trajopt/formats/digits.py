"""Determine from the text of numbers how precisely they are known.

A column may have a fixed number of decimals (`%.4f`, also with trailing zeros removed). Or it may
have a fixed number of digits (`%g`, `%.4e`); then the number of decimals depends on the size of a
number. So decimals are counted together for numbers of one size. What a sensor rounds besides is
found by the judge (`trajopt.judging.lattice`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import gcd

import numpy as np

from trajopt.core.arrays import Array
from trajopt.formats.samples import Samples

_NOTHING = 1e-9  # smaller digits of times, relative to a step in time, are ignored


def decimals(text: str) -> int:
    """Return how many decimals a number has; of 1.5e-3 it is 4, of 1e3 it is -3."""
    mantissa, _, exponent = text.lower().partition("e")
    fraction = mantissa.partition(".")[2]
    return len(fraction) - int(exponent or 0)


def half_digits(texts: Sequence[str], values: Array) -> tuple[Array, int]:
    """Return half a unit of each number's last digit, and the decimals of most numbers.

    Args:
        texts: A column's numbers as they are written.
        values: The same numbers, `(numbers,)`.
    """
    counted = _decimals(texts, values)
    kinds, counts = np.unique(counted, return_counts=True)
    most = int(kinds[np.argmax(counts)])
    return 0.5 * 10.0**-counted, most


def of_columns(texts: Sequence[Sequence[str]], values: Array) -> tuple[Array, tuple[int, ...]]:
    """Return `half_digits` of each column, `(numbers, columns)`, and each column's decimals."""
    columns = zip(texts, values.T, strict=True)
    half, decimals = zip(*(half_digits(*own) for own in columns), strict=True)
    return np.stack(half, axis=1), decimals


def known(samples: Samples) -> Samples:
    """Return samples without a text, with the digits of their numbers.

    They are those of the shortest text that reads as the same number, without trailing zeros.
    """
    half, decimals = _of_numbers(samples.positions)
    found = replace(samples, half_digits=half, decimals=decimals)
    if samples.velocities is None:
        return found
    return replace(found, velocity_half_digits=_of_numbers(samples.velocities)[0])


def _of_numbers(values: Array) -> tuple[Array, tuple[int, ...]]:
    return of_columns([[repr(item) for item in own.tolist()] for own in values.T], values)


def time_half_digit(texts: Sequence[str], values: Array, elapsed: Sequence[int]) -> float:
    """Return half a unit of the last digit of times; 0 where all are on a coarser, even grid.

    It is also 0 where the last digit is negligible compared with the steps.

    Args:
        texts: The times as they are written.
        values: The same times, `(times,)`.
        elapsed: The times since the first one, in units of the last digit that any of them has.
    """
    steps = {later - earlier for earlier, later in pairwise(elapsed)}
    if len(steps) == 1 or gcd(*steps) > 1:
        return 0.0
    found = float((0.5 * 10.0 ** -_decimals(texts, values)).max())
    return found if found > _NOTHING * float(np.median(np.diff(values))) else 0.0


def _decimals(texts: Sequence[str], values: Array) -> Array:
    """The decimals with which each number was written, before trailing zeros were removed."""
    own = np.array([decimals(text) for text in texts], dtype=float)
    with np.errstate(divide="ignore"):
        sizes = np.floor(np.log10(np.abs(values)))
    counted = np.full(len(own), own.max())
    for size in np.unique(sizes):
        alike = sizes == size
        if len(np.unique(values[alike])) > 1:  # one number alone may have lost its zeros
            counted[alike] = own[alike].max()
    return counted
