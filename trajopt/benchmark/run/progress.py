"""Progress of a comparison: the numbers, the sentence, and a line of standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

REWRITE_INTERVAL_S = 0.2
LOG_INTERVAL_S = 10.0  # between lines where there is no terminal


@dataclass(frozen=True)
class Progress:
    """Numbers of trials: asked for, finished, and finished before the run began.

    `ended` says in a line what the planner that has just ended answered; empty at the start.
    """

    total: int
    finished: int
    kept: int
    ended: str = ""

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
        return NotebookOutput()
    if wanted is None:
        wanted = sys.stderr is not None and sys.stderr.isatty()
    return Line() if wanted else lambda _: None


class Line:
    """Write progress on standard error, and nothing where nothing is left to do.

    Args:
        what: Of which there are so many.
        rewritten: True for one line that is rewritten, False for a line now and then, as for a log.
        answers: Whether each answer has a line of its own above the one that is rewritten.
        clock: Seconds.
    """

    def __init__(
        self,
        what: str = "trials",
        *,
        rewritten: bool = True,
        answers: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._what = what
        self._rewritten = rewritten
        self._answers = answers and rewritten
        self._interval = REWRITE_INTERVAL_S if rewritten else LOG_INTERVAL_S
        self._clock = clock
        self._began = clock()
        self._written = -self._interval if rewritten else 0.0
        self._length = 0

    def __call__(self, state: Progress) -> None:
        elapsed = self._clock() - self._began
        if self._answers and state.ended:
            sys.stderr.write(f"\r{state.ended.ljust(self._length)}\n")
            self._written = -self._interval
        ended = self._rewritten and state.finished == state.total
        begins_at_end = state.kept == state.total
        too_early = elapsed - self._written < self._interval
        if begins_at_end or (too_early and not ended):
            return
        self._show(state.after(elapsed, self._what), ended=ended)
        self._written = elapsed

    def _show(self, text: str, *, ended: bool) -> None:
        if self._rewritten:
            line = text.ljust(self._length)
            said = f"\r{line}" + "\n" * ended
        else:
            said = f"trajopt: {text}\n"
        sys.stderr.write(said)
        sys.stderr.flush()
        self._length = len(text)


class NotebookOutput(Line):
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
