"""The one place where text meets the terminal: encodings, control characters, tables, progress.

Names of problems and planners are text: what looks like rich's markup or a terminal's escape
sequence is shown, not obeyed. Where a terminal or file cannot hold a character, a likeness in ASCII
stands for it.
"""

from __future__ import annotations

import codecs
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from trajopt.comparison import Progress as TrialProgress


class _Console(Console):
    """A console whose reader may leave: the work goes on, and its files and exit code are kept."""

    def on_broken_pipe(self) -> None:
        """What is still to be said is said to nobody: `head` perhaps has seen enough."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


OUT = _Console(highlight=False, emoji=False)
ERR = _Console(stderr=True, highlight=False, emoji=False)

_LOG_INTERVAL = 10.0  # s between a log's lines of progress, where there is no terminal
_LONGEST_NOTE = 1400  # characters
_DEGRADE = "trajopt-degrade"  # the error handler's name among Python's codecs
_ASCII = {
    "–": "-",
    "—": "-",
    "−": "-",
    "×": "x",
    "…": "...",
    "≥": ">=",
    "≤": "<=",
    "·": ".",
    "²": "^2",
    "³": "^3",
    "ü": "ue",
    "ö": "oe",
    "ä": "ae",
    "ß": "ss",
}


def prepare() -> None:
    """Make the standard streams take any text, and be there at all."""
    codecs.register_error(_DEGRADE, _degraded)
    sys.stdin = sys.stdin or open(os.devnull, encoding="utf-8")  # noqa: SIM115
    sys.stdout = _tolerant(sys.stdout)
    sys.stderr = _tolerant(sys.stderr)


def _tolerant(stream: TextIO | None) -> TextIO:
    if stream is None:  # it was closed when Python started
        return open(os.devnull, "w", encoding="utf-8")
    with suppress(AttributeError):  # a stand-in, of a test or a notebook
        stream.reconfigure(errors=_DEGRADE)  # type: ignore[attr-defined]
    return stream


def _degraded(error: UnicodeError) -> tuple[str, int]:
    """Characters that a stream cannot hold, in ASCII."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end]
    return "".join(map(_in_ascii, characters)), error.end


def _in_ascii(character: str) -> str:
    if character in _ASCII:
        return _ASCII[character]
    return character.encode("ascii", "backslashreplace").decode("ascii")


def visible(value: object) -> str:
    """A value as text whose control characters are written out; line breaks and tabs stay."""
    return "".join(map(_written_out, str(value)))


def _written_out(character: str) -> str:
    if character.isprintable() or character in "\n\t":
        return character
    return character.encode("unicode_escape").decode("ascii")


def markup(value: object) -> str:
    """A value as text inside rich's markup."""
    return escape(visible(value))


def option_lines(label: str) -> str:
    """A planner's label as markup, an option a line: folded in the middle it is hard to read."""
    name, _, options = label.partition(":")
    lines = [name, *(option for option in options.split(",") if option)]
    return markup("\n  ".join(lines))


def paragraph(text: object = "") -> None:
    """Text on standard output, folded at the terminal's width."""
    OUT.print(visible(text), markup=False)


def line(text: object) -> None:
    """One line on standard output, however long: to be copied, like a path."""
    OUT.print(visible(text), markup=False, soft_wrap=True)


def note(text: object) -> None:
    """One line on standard error, of whose middle no more is shown than a screen holds."""
    words = " ".join(visible(text).split())
    if len(words) > _LONGEST_NOTE:
        half = _LONGEST_NOTE // 2
        words = f"{words[:half]} … {words[-half:]}"
    ERR.print(f"trajopt: {words}", markup=False, soft_wrap=True)


def print_json(table: Any) -> None:
    """One JSON object and nothing else; what does not exist (infinity, NaN) is null."""
    print(json.dumps(_finite(table), indent=2, allow_nan=False, default=str))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value


def table(*columns: str, numbers: tuple[str, ...] = (), title: str | None = None) -> Table:
    """A table without lines; the first column of text takes the width that is left.

    Args:
        columns: Headings, from the left.
        numbers: Those of columns aligned to the right and never folded.
        title: Above the table.
    """
    made = Table(box=None, pad_edge=False, collapse_padding=True, title_justify="left")
    if title is not None:
        made.title = markup(title)
    for column in columns:
        if column in numbers:
            made.add_column(markup(column), justify="right", no_wrap=True)
        else:
            made.add_column(markup(column), overflow="fold")
    return made


@contextmanager
def waiting(message: str) -> Iterator[None]:
    """A spinner on standard error, in a terminal."""
    if not ERR.is_terminal:
        yield
        return
    with ERR.status(message, spinner="line"):
        yield


@contextmanager
def progress(total: int, what: str = "trials") -> Iterator[Callable[[int], None]]:
    """Progress on standard error with the time left: a bar in a terminal, else lines for a log.

    Call what it yields with the number just finished. What is finished at the first call was there
    already and does not count for the estimate.
    """
    if not ERR.is_terminal:
        yield LoggedProgress(total, what)
        return
    # not for commands without a bar: what draws it takes as long to import as the tables
    from rich import progress as bars

    columns = (
        bars.TextColumn("{task.description}"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TimeElapsedColumn(),
        bars.TextColumn("left"),
        bars.TimeRemainingColumn(),
    )
    with bars.Progress(*columns, console=ERR, transient=True, speed_estimate_period=600) as bar:
        task = bar.add_task(what, total=total)
        yield lambda count: bar.advance(task, count)


@contextmanager
def trials() -> Iterator[Callable[[TrialProgress], None]]:
    """The same for a comparison, which says itself how many trials there are."""
    finished = 0
    advance: Callable[[int], None] | None = None
    with ExitStack() as stack:

        def show(state: TrialProgress) -> None:
            nonlocal advance, finished
            if advance is None:
                advance = stack.enter_context(progress(state.total))
            advance(state.finished - finished)
            finished = state.finished

        yield show


class LoggedProgress:
    """Lines of progress on standard error, `interval` seconds apart or more."""

    def __init__(
        self,
        total: int,
        what: str,
        interval: float = _LOG_INTERVAL,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._total = total
        self._what = what
        self._interval = interval
        self._clock = clock
        self._began = clock()
        self._said = self._began
        self._finished = 0
        self._there_already: int | None = None

    def __call__(self, count: int) -> None:
        self._finished += count
        if self._there_already is None:
            self._there_already = count
        now = self._clock()
        if now - self._said >= self._interval:
            self._said = now
            note(self._line(now - self._began))

    def _line(self, elapsed: float) -> str:
        text = f"{self._finished} of {self._total} {self._what} after {_duration(elapsed)}"
        done_here = self._finished - (self._there_already or 0)
        remaining = self._total - self._finished
        if done_here > 0 and remaining > 0:
            left = elapsed * remaining / done_here
            text += f", about {_duration(left)} left"
        return text


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes} min"
    if minutes:
        return f"{minutes} min {rest} s"
    return f"{rest} s"
