"""Progress of a comparison: the numbers, the sentence, and a line of standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

REWRITE_INTERVAL_S = 0.2


@dataclass(frozen=True)
class Progress:
    """Numbers of trials: asked for, finished, and finished before the run began."""

    total: int
    finished: int
    kept: int

    def after(self, seconds: float, what: str = "trials") -> str:
        """Say how many are finished after so many seconds, and how long the others may take."""
        text = f"{self.finished} of {self.total} {what} after {_duration(seconds)}"
        done_here = self.finished - self.kept
        remaining = self.total - self.finished
        if done_here > 0 and remaining > 0:
            left = seconds * remaining / done_here
            text += f", about {_duration(left)} left"
        return text


Report = Callable[[Progress], None]


def reporter(wanted: Report | bool | None) -> Report:
    """Return what reports progress.

    Args:
        wanted: A function, which is returned; True for a line, False for none; None for a line
            where standard error is a terminal. A notebook has its line below the cell.
    """
    if callable(wanted):
        return wanted
    if wanted is not False and type(sys.stderr).__module__.startswith("ipykernel"):
        return Cell()
    if wanted is None:
        wanted = sys.stderr is not None and sys.stderr.isatty()
    return Line() if wanted else lambda _: None


class Line:
    """Write progress on one line of standard error, and nothing where nothing is left to do."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = clock()
        self._written = -REWRITE_INTERVAL_S
        self._length = 0

    def __call__(self, state: Progress) -> None:
        elapsed = self._clock() - self._began
        ended = state.finished == state.total
        begins_at_end = state.kept == state.total
        too_early = elapsed - self._written < REWRITE_INTERVAL_S
        if begins_at_end or (too_early and not ended):
            return
        self._show(state.after(elapsed), ended=ended)
        self._written = elapsed

    def _show(self, text: str, *, ended: bool) -> None:
        line = text.ljust(self._length)
        sys.stderr.write(f"\r{line}" + "\n" * ended)
        sys.stderr.flush()
        self._length = len(text)


class Cell(Line):
    """Show progress as one output of a notebook's cell, which is updated."""

    _handle: Any = None

    def _show(self, text: str, *, ended: bool) -> None:
        content = {"text/plain": text}
        if self._handle is None:
            display = import_module("IPython.display").display
            self._handle = display(content, raw=True, display_id=True)
        else:
            self._handle.update(content, raw=True)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes} min"
    if minutes:
        return f"{minutes} min {rest} s"
    return f"{rest} s"
