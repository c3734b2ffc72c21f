"""Keys of a table in a file: which are known, of which type, and one rule for all others.

Each reader declares its keys once, as `Keys`, and checks its tables with `unread`. A key that is
not known may be a known one misspelt, or another program's. It counts as misspelt, and is refused,
only if the known key is missing and the value is of its type. Else the table is read without it,
and a line says so (`note_unread`).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from trajopt.core.exceptions import FileNote, InvalidInput, nearest
from trajopt.core.numerals import is_number, parsed
from trajopt.core.out_of_scope import out_of_scope

_SIMILAR = 0.6  # share of letters that two names have in common, at least
_MISSPELT = 0.8  # the same in a table that other programs fill too
_SHOWN = 6  # names in a note
_RATE = re.compile(r"vel|speed|acc|decel|jerk", re.IGNORECASE)
_UNIT = re.compile(r"(\w+_)?units?", re.IGNORECASE)

Strictness = Literal["theirs", "ours", "exact"]


def number(value: Any) -> bool:
    """Return whether a value is a number, or a text that says one or is to be filled in."""
    if isinstance(value, str):
        return parsed(value.strip()) is not None or "$" in value
    return is_number(value)


def numbers(value: Any) -> bool:
    """Return whether a value is a number or a list, perhaps of lists."""
    return number(value) or a_list(value)


def a_list(value: Any) -> bool:
    """Return whether a value is a list."""
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def flag(value: Any) -> bool:
    """Return whether a value is true or false."""
    return isinstance(value, bool)


def text(value: Any) -> bool:
    """Return whether a value is a text."""
    return isinstance(value, str)


def table(value: Any) -> bool:
    """Return whether a value is a table."""
    return isinstance(value, Mapping)


def anything(value: Any) -> bool:
    """Return True."""
    return True


@dataclass(frozen=True)
class Key:
    """A known key: its type, its meaning, and the names that it has in other programs' files."""

    type: Callable[[Any], bool]
    meaning: str
    elsewhere: tuple[str, ...] = ()


Keys = Mapping[str, Key]


def holding(keys: Keys) -> Callable[[Any], bool]:
    """Return the type of a table that has some of these keys."""
    return lambda value: isinstance(value, Mapping) and not keys.keys().isdisjoint(value)


def unread(
    where: str,
    given: Mapping[str, Any],
    keys: Keys,
    required: Iterable[str] = (),
    *,
    strictness: Strictness = "theirs",
    shared: bool = False,
) -> list[str]:
    """Return the keys of a table that are not read; refuse misspelt and missing ones.

    Args:
        where: Text before a key in errors.
        given: A table of the file.
        keys: The known keys.
        required: Those that it must have.
        strictness: "theirs": other programs' keys may be there. "ours": people write the file for
            this tool, and every key that resembles none, or asks for something of another tool, is
            refused. "exact": every unknown key is refused.
        shared: Whether other programs fill the table too: names then have to resemble each other
            more, and only such names are returned.

    Raises:
        InvalidInput: Names the key, the value and what would be right.
    """
    found = []
    similarity = _MISSPELT if shared else _SIMILAR
    for key, value in given.items():
        if key in keys:
            continue
        right, extended = _by_other_name(str(key), keys), False
        if not right:
            right, extended = _resembled(str(key), tuple(keys), similarity)
        absent = right not in given
        elsewhere = "" if strictness == "theirs" else out_of_scope(str(key))
        misspelt = bool(right) and not extended and absent and keys[right].type(value)
        if not shared and _UNIT.fullmatch(str(key)) and not right:
            elsewhere = "numbers are in rad (m for a joint that slides) and s"
        foreign = bool(elsewhere) or not right or (extended and absent)
        unknown = strictness == "exact" or (strictness == "ours" and foreign)
        if elsewhere and (misspelt or unknown or strictness == "theirs"):
            expected = f"this key left out: {elsewhere}"
            raise InvalidInput(f"{where}{key}", expected, value=value)
        if misspelt or unknown:
            value = None if table(value) else value
            expected = f"the key {right}" if right else f"one of the keys {', '.join(sorted(keys))}"
            raise InvalidInput(f"{where}{key}", expected, value=value)
        if right or not shared:
            found.append(str(key))
    for key in required:
        if key not in given:
            raise InvalidInput(f"{where}{key}", "this key; it is missing")
    return found


@lru_cache(maxsize=1024)
def _resembled(key: str, known: tuple[str, ...], similarity: float) -> tuple[str, bool]:
    """Return the known key that a key resembles, and whether it extends it by words; or empty.

    A known key with further words, as max_velocity_scaling or has_jerk, is no misspelling.
    """
    parts = [own for own in known if re.search(rf"(^|_){re.escape(own)}(_|$)", key)]
    if parts:
        return max(parts, key=len), True
    return nearest(key, known, similarity), False


def _by_other_name(key: str, keys: Keys) -> str:
    return next((name for name, own in keys.items() if key in own.elsewhere), "")


def bounds_rate(key: str) -> bool:
    """Return whether a key names a velocity, an acceleration or a jerk.

    Every reader reads such a key, refuses it, or names it with `note_unread`.
    """
    return _RATE.search(key) is not None


def note_unread(source: str, found: Iterable[str]) -> None:
    """Say, with one `FileNote`, which keys of a file are not read."""
    note(source, "not read: ", found)


def note_unreal(source: str, joints: Iterable[str]) -> None:
    """Name, in one `FileNote`, the joints whose inertia no body has (`Masses.unreal`)."""
    start = "largest moment of inertia above the sum of the other two, as no body has it; behind "
    note(source, start, joints)


def note(source: str, start: str, names: Iterable[str]) -> None:
    """Say something, with one `FileNote`, of some names in a file; nothing where there are none."""
    own = list(dict.fromkeys(names))
    if own:
        more = ", …" if len(own) > _SHOWN else ""
        message = f"{source}: {start}{', '.join(own[:_SHOWN])}{more}"
        warnings.warn(FileNote(message), stacklevel=4)
