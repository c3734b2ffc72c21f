"""How much a call does, counted instead of timed: the same on a slow and on a busy machine."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import pytest

# A limit of time for a search or a child process that only ends a hang, and never decides a test.
HANG_S = 600.0


def one_in(count: int, cases: Iterable[Any]) -> list[Any]:
    """Return all cases; the short run has one in so many, the long run the others.

    Args:
        count: 4: the first, the fifth, and so on.
        cases: Values of a parameter, or tuples of several.
    """
    marks = [[], *[[pytest.mark.long]] * (count - 1)]
    tuples = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*own, marks=marks[i % count]) for i, own in enumerate(tuples)]


def without_progress(text: str) -> str:
    """Return what a command said without the lines that a slow machine adds."""
    return re.sub(r"^trajopt: (planning |\d+ of \d+ ).*\n", "", text, flags=re.M)


class TooMuch(BaseException):
    """A call went beyond what it may do. No `except Exception` on the way catches it."""


def calls(function: Callable[[], object], at_most: int) -> int:
    """Return how many calls of functions, Python's and C's, a call makes.

    Args:
        function: Called once.
        at_most: The number of calls at which it is ended.

    Raises:
        TooMuch: It makes more.
    """
    made = 0

    def count(_frame: object, event: str, _argument: object) -> None:
        nonlocal made
        made += event in ("call", "c_call")
        if made > at_most:
            raise TooMuch(f"more than {at_most} calls")

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        function()
    finally:
        sys.setprofile(before)
    return made


def doubling(function: Callable[[int], object], size: int) -> float:
    """Return how many times the calls are made at twice a size: 2 where work is in proportion."""
    function(size)  # what the first call imports is no part of it
    once, twice = (calls(partial(function, n), at_most=10_000_000) for n in (size, 2 * size))
    return twice / once
