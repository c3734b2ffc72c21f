"""The time that a planner spends inside the calls of a library that plans for it.

    with inside_library():
        found = package.solve(problem)

A planner that wraps somebody's library surrounds the library's own calls with it, and nothing of
its own. Where the library calls back, `outside_library` stops the clock again. `Planner` adds the
parts up and states the sum in its answer (`Solution.library_time`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import TracebackType


class Clock:
    """Seconds inside a library, during one call of a planner."""

    def __init__(self) -> None:
        self.seconds = 0.0


class _TimedPart:
    """A part of a planner's call that counts, or does not count, as the library's."""

    def __init__(self, sign: float) -> None:
        self._sign = sign
        self._began = 0.0

    def __enter__(self) -> None:
        self._began = time.perf_counter()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        spent = time.perf_counter() - self._began
        clock = _CLOCK.get()
        if clock is not None:
            clock.seconds += self._sign * spent


def inside_library() -> _TimedPart:
    """Count the time of a `with` block as the library's."""
    return _TimedPart(1.0)


def outside_library() -> _TimedPart:
    """Do not count the time of a `with` block inside a block of `inside_library`."""
    return _TimedPart(-1.0)


@contextmanager
def measured() -> Iterator[Clock]:
    """Measure a call of a planner; a call of another planner within it counts for both."""
    clock = Clock()
    outer = _CLOCK.set(clock)
    try:
        yield clock
    finally:
        _CLOCK.reset(outer)
        around = _CLOCK.get()
        if around is not None:
            around.seconds += clock.seconds


_CLOCK: ContextVar[Clock | None] = ContextVar("library clock", default=None)
