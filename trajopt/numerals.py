"""Numbers written as text, on the command line or as a planner's options: as given, or refused.

Python reads more than people write: 1_000 is 1000, 1e999 is infinite, ١ is 1, and a command line's
library rounds 1.5 to 2 where a whole number is asked for.
"""

from __future__ import annotations

import math
import re

_WHOLE = re.compile(r"[+-]?[0-9]{1,400}")
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


def whole(text: str) -> int:
    """A whole number in decimal digits.

    Raises:
        ValueError: It is written in another way, 1e3 or 1.0 too.
    """
    if not _WHOLE.fullmatch(text):
        raise ValueError(f"{text!r} is not a whole number.")
    return int(text)


def decimal(text: str) -> float:
    """A finite decimal number, perhaps with an exponent.

    Raises:
        ValueError: It is written in another way, or too large for a float.
    """
    if not _DECIMAL.fullmatch(text) or not math.isfinite(float(text)):
        raise ValueError(f"{text!r} is not a finite number.")
    return float(text)
