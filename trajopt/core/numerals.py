"""Numbers written as text, read exactly as they are written, or refused.

Python reads more than people write: 1_000 is 1000, 1e999 is infinite, ١ is 1. A command line's
library rounds 1.5 to 2 where a whole number is needed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from decimal import ROUND_FLOOR, Decimal, localcontext
from typing import Any

import numpy as np

from trajopt.core.exceptions import shown

MAX_LENGTH = 400  # characters; every float written in full is shorter

_WHOLE = re.compile(r"[+-]?[0-9]+")
# The exponent has three digits at most: beyond, a `Decimal` overflows.
_DECIMAL = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?0*[0-9]{1,3})?")


def parsed(text: str) -> int | float | None:
    """Return a whole or decimal number; None for other text, or one of over 400 characters."""
    if len(text) > MAX_LENGTH:
        return None
    if _WHOLE.fullmatch(text):
        return int(text)
    if not _DECIMAL.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def rounded_down(value: float, spec: str) -> str:
    """Return a lower bound as text that claims no more than it: `1.4838` as `1.483` with `.4g`.

    Args:
        value: The bound; NaN and infinity too.
        spec: As for `format`: `.6f`, `.9g`, `#.4g`.
    """
    with localcontext(rounding=ROUND_FLOOR):
        digits = format(Decimal(value), spec.removeprefix("#"))
    return format(float(digits), spec)


def whole(text: str) -> int:
    """Return a whole number that is written in decimal digits.

    Raises:
        ValueError: It is written in another way, 1e3 or 1.0 too, or in over 400 characters.
    """
    value = parsed(text)
    if not isinstance(value, int):
        raise ValueError(f"{shown(text)} is not a whole number.")
    return value


def decimal(text: str) -> float:
    """Return a finite decimal number, perhaps with an exponent.

    Raises:
        ValueError: It is written in another way, in over 400 characters, or too large for a float.
    """
    value = parsed(text)
    if value is None or not is_number(value):
        raise ValueError(f"{shown(text)} is not a finite number.")
    return float(value)


def exact(text: str) -> Decimal:
    """Return a finite decimal number with all its digits; raises `ValueError` as `decimal` does."""
    decimal(text)
    return Decimal(text)


def floats(texts: Iterable[str]) -> list[float]:
    """Read finite decimal numbers; any other text becomes NaN or infinite."""
    return [
        float(text) if len(text) <= MAX_LENGTH and _DECIMAL.fullmatch(text) else math.nan
        for text in texts
    ]


def is_number(value: Any) -> bool:
    """Return whether a value is a finite number that a float holds; True and False are not."""
    if not isinstance(value, int | float | np.integer | np.floating):
        return False
    if isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond every float
        return False
