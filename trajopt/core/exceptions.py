"""All errors of this package, each with the data that a script needs to react.

An unsolved problem is not an error: it is a `Status` (see `trajopt.core.solution`).
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from typing import Any

from trajopt.core.renamed import current

_LONGEST_KEY = 200  # characters of a key in a message
_LONGEST_HINT = 1000  # characters of the hint in a message

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxlist = _SHORT.maxtuple = 12
_SHORT.maxstring = _SHORT.maxother = 120


def shown(value: object) -> str:
    """A value as an error shows it: a number or a name as a whole, the beginning of a table."""
    try:
        return shortened(_SHORT.repr(value), 4 * _LONGEST_KEY)
    except ValueError:  # Python prints no whole number of more than 4300 digits
        return f"a value of type {type(value).__name__}"


def shortened(text: str, length: int) -> str:
    """The beginning of a text that is longer than so many characters."""
    if len(text) <= length:
        return text
    return f"{text[: length - 1]}…"


def nearest(name: str, known: Iterable[str], similarity: float = 0.6) -> str:
    """The known name that resembles a name, in upper or lower case; empty where none does.

    Args:
        name: The name.
        known: The known names.
        similarity: The share of letters, at least, that both have in common.
    """
    from difflib import get_close_matches  # late: most names are right

    named = {own.lower(): own for own in known}
    close = get_close_matches(name.lower(), named, n=1, cutoff=similarity)
    return named[close[0]] if close else ""


class TrajoptError(Exception):
    """Base of every error that this package raises on purpose; each survives pickling."""

    def __reduce__(self) -> tuple[Any, ...]:
        return rebuilt, (type(self), super().__reduce__()[1], self.__dict__)


def rebuilt(kind: type[TrajoptError], args: tuple[Any, ...], data: dict[str, Any]) -> TrajoptError:
    """Return an error of this class with this data."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(data)
    return error


class InvalidInput(TrajoptError, ValueError):
    """A value that cannot be used: names the file, key, joint, value, and what would be right.

    `joint` counts from 0, as arrays do; the message counts from 1, as people do.
    """

    def __init__(
        self,
        key: str,
        expected: str,
        *,
        value: object = None,
        joint: int | None = None,
        file: str | None = None,
    ) -> None:
        self.key = key
        self.expected = expected
        self.value = value
        self.joint = joint
        self.file = file
        super().__init__(self.__str__())

    def __str__(self) -> str:
        text = shortened(self.key, _LONGEST_KEY)
        if self.file:
            text = f"{self.file}: {text}"
        if self.joint is not None:
            text += f", joint {self.joint + 1}"
        value = self.value
        if hasattr(value, "tolist"):  # a number or an array of NumPy
            value = value.tolist()
        if value is not None:
            text += f" is {shown(value)}"
        return f"{text}: expected {shortened(self.expected, _LONGEST_HINT)}"

    def in_file(self, file: str) -> InvalidInput:
        """Return this error with the name of its file, unless it names one."""
        return InvalidInput(
            self.key, self.expected, value=self.value, joint=self.joint, file=self.file or file
        )


class WrongType(TrajoptError, TypeError):
    """A value of another type than is needed; the message says how to make the right one."""


class InvalidTrajectory(TrajoptError, ValueError):
    """Arrays that are no piecewise polynomial, or one of another size than the problem's."""


class UnknownName(TrajoptError, LookupError):
    """No planner or problem has this name; the message says its new name, or the known names."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.kind = kind
        self.name = name
        self.known = sorted(known)
        hint = f"known: {', '.join(self.known) or 'none'}"
        close = nearest(name, self.known)
        within = [own for own in self.known if name.lower() in own.lower()]
        if not close and len(within) == 1:
            close = within[0]
        if close:
            hint = f"did you mean {close!r}?"
        if current(name) in self.known:
            hint = f"it is now called {current(name)!r}"
        super().__init__(f"no {kind} is called {shown(name)}; {hint}")


class MissingBackend(TrajoptError, ImportError):
    """A package that is not installed; the message gives the command that installs it.

    `extra` is the extra of this package that installs it, if there is one.
    """

    def __init__(self, package: str, extra: str = "") -> None:
        self.package = package
        self.extra = extra
        wanted = f'"mintime[{extra}]"' if extra else package
        super().__init__(f"{package} is not installed; install it with: pip install {wanted}")


class StoreError(TrajoptError, OSError):
    """A results folder or file that cannot be read or written."""


class WorkerError(TrajoptError):
    """A worker process that could not run a trial; the message gives the reason."""


class UnitWarning(UserWarning):
    """Numbers that look as if they were written in different units."""


class FileNote(UserWarning):
    """A decision of a reader: columns that it left out, times that it counts from their first."""


class PlannerWarning(UserWarning):
    """A planner that probably does not run, or answer, as its author means it."""
