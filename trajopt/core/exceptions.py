"""What can go wrong, each error carrying the data that a script needs to react.

Not solving a problem is not an error: it is a `Status` (see `trajopt.core.solution`).
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from typing import Any

_LONGEST_KEY = 200  # characters that a message shows of a key
_LONGEST_HINT = 1000  # and of what would be right

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxlist = _SHORT.maxtuple = 12
_SHORT.maxstring = _SHORT.maxother = 120


def shown(value: object) -> str:
    """A value as an error shows it: the whole of a number or a name, the beginning of a table."""
    try:
        return shortened(_SHORT.repr(value), 4 * _LONGEST_KEY)
    except ValueError:  # Python prints no whole number of more than 4300 digits
        return f"a value of type {type(value).__name__}"


def shortened(text: str, length: int) -> str:
    """The beginning of a text that is longer than so many characters."""
    if len(text) <= length:
        return text
    return f"{text[: length - 1]}…"


class TrajoptError(Exception):
    """Base of every error that this package raises on purpose; each survives pickling."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (type(self), super().__reduce__()[1], self.__dict__)


def _rebuilt(kind: type[TrajoptError], args: tuple[Any, ...], data: dict[str, Any]) -> TrajoptError:
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
        if hasattr(value, "item"):  # one of NumPy's numbers
            value = value.item()
        if value is not None:
            text += f" is {shown(value)}"
        return f"{text}: expected {shortened(self.expected, _LONGEST_HINT)}"

    def in_file(self, file: str) -> InvalidInput:
        """The same error, naming the file it came from."""
        return InvalidInput(
            self.key,
            self.expected,
            value=self.value,
            joint=self.joint,
            file=file,
        )


class InvalidTrajectory(TrajoptError, ValueError):
    """Arrays that do not make a piecewise polynomial, or not one of this problem's size."""


class UnknownName(TrajoptError, LookupError):
    """No planner or problem of this name; the message lists those there are."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        from difflib import get_close_matches  # late: most commands know their names

        self.kind = kind
        self.name = name
        self.known = sorted(known)
        hint = f"known: {', '.join(self.known)}"
        close = get_close_matches(name, self.known, n=1)
        if close:
            hint = f"did you mean {close[0]!r}?"
        super().__init__(f"no {kind} is called {shown(name)}; {hint}")


class MissingBackend(TrajoptError, ImportError):
    """A package that is not installed; the message is the command that mends it.

    `extra` is the extra of this package that brings it, if it belongs to one.
    """

    def __init__(self, package: str, extra: str = "") -> None:
        self.package = package
        self.extra = extra
        wanted = f'"trajopt[{extra}]"' if extra else package
        super().__init__(f"{package} is not installed; mend it with: pip install {wanted}")


class StoreError(TrajoptError, OSError):
    """A results folder or file that cannot be read or written."""


class WorkerError(TrajoptError):
    """A process for trials that could not do what it was asked; the message says why."""


class UnitWarning(UserWarning):
    """Numbers that look as if they were written in different units."""
