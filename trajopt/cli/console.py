"""Print text, tables and progress: encodings, control characters, closed streams.

Names of problems and planners are text: rich's markup and a terminal's escape sequences in them are
shown, not obeyed. A character that a terminal or file cannot hold is replaced by ASCII.
"""

from __future__ import annotations

import codecs
import json
import os
import re
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from math import isfinite
from threading import Timer
from typing import Any, TextIO

from rich.console import Console
from rich.markup import escape
from rich.status import Status
from rich.table import Table
from rich.text import Text

from trajopt.benchmark.run.progress import Line, Progress


class _Console(Console):
    """A console whose reader may close the pipe, as `head` does; the command ends as usual."""

    def on_broken_pipe(self) -> None:
        """Discard all further output."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


OUT = _Console(highlight=False, emoji=False)
ERR = _Console(stderr=True, highlight=False, emoji=False)

HELD: list[str] = []
"""Notes of readers: they are shown once everything is read."""

_MAX_NOTE_CHARACTERS = 1400
_SILENT_S = 2.0  # a longer wait says what is done
# A line of a traceback that names a file and a line in it, outside of installed packages.
_PLACE = re.compile(r'^ *File "(?!.*site-packages)(?:.*/)?(.+)"(, line \d+)', re.M)
_DEGRADE = "trajopt-degrade"  # the error handler's name among Python's codecs
_ASCII = str.maketrans(
    {
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
        "⁵": "^5",
        "∫": "int",
        "∞": "inf",
        "ü": "ue",
        "ö": "oe",
        "ä": "ae",
        "ß": "ss",
    }
)


def prepare() -> None:
    """Make the standard streams exist and accept any text."""
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
    """Return the characters that a stream cannot hold in ASCII, and where they end."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end].translate(_ASCII)
    return characters.encode("ascii", "backslashreplace").decode("ascii"), error.end


def visible(value: object) -> str:
    """Return a value as text with control characters written out; line breaks and tabs stay."""
    return "".join(map(_written_out, str(value)))


def _written_out(character: str) -> str:
    if character.isprintable() or character in "\n\t":
        return character
    return character.encode("unicode_escape").decode("ascii")


def markup(value: object) -> str:
    """Return a value as text inside rich's markup."""
    return escape(visible(value))


def bold(value: object) -> Text:
    """Return a value as bold text."""
    return Text(visible(value), "bold")


def alarm(value: object) -> Text:
    """Return a value as bold red text."""
    return Text(visible(value), "bold red")


def option_lines(label: str) -> Text:
    """Return a planner's label with one option a line, where folding would break options."""
    name, _, options = label.partition(":")
    lines = [name, *filter(None, options.split(","))]
    return Text(visible("\n  ".join(lines)))


def last_line(message: str) -> str:
    """Return the last line; of a traceback with the place of the last code outside of packages."""
    *_, last = message.strip().splitlines() or [""]
    places = _PLACE.findall(message)
    return f"{last} ({''.join(places[-1])})" if places else last


def headline(subject: str, rest: str, verdict: str) -> None:
    """Print one line: a subject in bold, the rest, a verdict in bold."""
    OUT.print(Text.assemble(bold(subject), visible(rest), bold(verdict)), soft_wrap=True)


def paragraph(text: object = "") -> None:
    """Print text on standard output, folded at the terminal's width."""
    OUT.print(visible(text), markup=False)


def line(text: object) -> None:
    """Print one line on standard output without folding it, so that a path can be copied."""
    OUT.print(visible(text), markup=False, soft_wrap=True)


def show_held(*error: str) -> None:
    """Print the notes of readers that were held back; an error prints them on its own line."""
    lines = ["; ".join([*error, *HELD])] if error else HELD
    for text in lines:
        note(text)
    HELD.clear()


def note(text: object) -> None:
    """Print one line on standard error, shortened in the middle to what a screen holds.

    An argument in Python, as `unit=deg`, is an option here.
    """
    words = " ".join(visible(text).replace("unit=", "--unit ").split())
    if len(words) > _MAX_NOTE_CHARACTERS:
        half = _MAX_NOTE_CHARACTERS // 2
        words = f"{words[:half]} … {words[-half:]}"
    ERR.print(f"trajopt: {words}", markup=False, soft_wrap=True)


def warn_of_bug(sentence: str) -> None:
    """Print on standard error that a motion is below the optimum: a bug, or a better one."""
    ERR.print(f"[bold red]BUG OR BETTER OPTIMUM[/bold red]: {markup(sentence)}")


def print_json(table: Any) -> None:
    """Print one JSON object and nothing else; infinity and NaN are null, paths are texts."""
    print(json.dumps(_finite(table), indent=2, allow_nan=False, default=str))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return value


class PlainTable(Table):
    """A table without lines, whose cells are text, numbers, or rich's text."""

    def row(self, *cells: object) -> None:
        """Add a row, in which no text is read as markup."""
        self.add_row(*(cell if isinstance(cell, Text) else markup(cell) for cell in cells))


def table(*columns: str, numbers: Collection[str] = (), title: str | None = None) -> PlainTable:
    """Make a table; its first column of text takes the width that is left.

    Args:
        columns: Headings, from the left.
        numbers: The headings of columns that are aligned to the right and never folded: further
            columns, unless `columns` has them.
        title: Printed above the table.
    """
    made = PlainTable(box=None, pad_edge=False, collapse_padding=True, title_justify="left")
    made.title = None if title is None else markup(title)
    for column in dict.fromkeys((*columns, *numbers)):
        if column in numbers:
            made.add_column(markup(column), justify="right", no_wrap=True)
        else:
            made.add_column(markup(column), overflow="fold")
    return made


@contextmanager
def waiting(message: str, *, long: bool = False) -> Iterator[Callable[[str], None]]:
    """Show a spinner on standard error, if that is a terminal; planners print there too.

    Call the yielded function with what is done now: it is shown after the message. Where standard
    error is no terminal, a line says both after two seconds of what may be `long`.
    """
    show_held()
    now = [message]

    def tell(step: str) -> None:
        now[0] = f"{message}: {step}"
        if isinstance(shown, Status):
            shown.update(now[0])

    shown = ERR.status(message, spinner="line") if ERR.is_terminal else nullcontext()
    late = Timer(_SILENT_S, lambda: note(now[0]))
    late.daemon = True
    if long and not ERR.is_terminal:
        late.start()
    try:
        with shown, redirect_stdout(sys.stderr):
            yield tell
    finally:
        late.cancel()


def progress_line(what: str = "trials", *, answers: bool = False) -> Line:
    """Return what shows progress on standard error: rewritten in a terminal, else line by line.

    With `answers` a terminal shows each planner's answer when it has one.
    """
    show_held()
    return Line(what, rewritten=ERR.is_terminal, answers=answers)


@contextmanager
def progress(total: int, what: str = "trials") -> Iterator[Callable[[int], None]]:
    """Show progress and the time left on standard error.

    Call the yielded function with the number just finished. The first call counts what was there
    before, which the estimate leaves out.
    """
    line = progress_line(what)
    counts: list[int] = []

    def advance(count: int) -> None:
        counts.append(count)
        line(Progress(total, sum(counts), counts[0]))

    yield advance
