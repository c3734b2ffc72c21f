"""JSON and text, compressed to what fits into a page; a browser's DecompressionStream reads it."""

from __future__ import annotations

import base64
import gzip
import json
from contextlib import suppress
from math import fsum, isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def packed(text: str) -> str:
    """Return the text gzipped, in Base64, of which no character can end a script element."""
    return as_text(gzip.compress(text.encode(), compresslevel=9, mtime=0))


def as_text(content: bytes) -> str:
    """Return bytes in Base64."""
    return base64.b64encode(content).decode()


def packed_json(value: Any) -> str:
    """Return the value as JSON, packed; numbers that are not finite are null."""
    try:
        return packed(_json(value))
    except ValueError:  # some are
        return packed(_json(finite(value)))


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    """Return what JSON has for another value."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def finite(value: Any) -> Any:
    """Replace infinity and NaN, which JSON does not have, by None."""
    if isinstance(value, dict):
        return {str(k): finite(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return finite(value.tolist())
    if isinstance(value, list | tuple):
        with suppress(
            TypeError, ValueError, OverflowError
        ):  # others than numbers, or infinite ones
            if isfinite(fsum(value)):  # a tenth of the time of looking at each
                return list(value)
        return [finite(v) for v in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value


def rounded(values: ArrayLike, digits: int = 4) -> list[Any]:
    """Numbers to so many digits of the largest, for curves: they are drawn, never read off."""
    array = np.asarray(values, dtype=float)
    finite = np.isfinite(array)
    sizes = np.abs(array[finite])
    largest = float(sizes.max(initial=0.0)) or 1.0
    power = np.log10(largest)
    before_point = int(np.ceil(power))
    found: list[Any] = np.round(array, digits - before_point).tolist()
    return found
