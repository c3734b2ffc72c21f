"""YAML files as ROS writes them: tables, lists and plain values, angles tagged `!degrees`.

PyYAML's events are read, not its constructors. Aliases and merge keys count as the values that they
repeat, so a few hundred bytes cannot make an endless table. A text that some version of YAML reads
as another number (1:30 as 90, 010 as 8) is not read as a number.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from math import pi
from pathlib import Path
from typing import Any

try:
    import yaml
except ImportError:  # `check_installed` raises an error
    yaml = None

from trajopt.core import files, numerals
from trajopt.core.exceptions import InvalidInput, MissingBackend, shortened

_DEGREE = pi / 180  # rad
_TEXT_TAGS = ("!", "tag:yaml.org,2002:str")
_KINDS = ("bool", "float", "int", "map", "null", "seq")
_TAGS = (*_TEXT_TAGS, *(f"tag:yaml.org,2002:{kind}" for kind in _KINDS))
_OCTAL = re.compile(r"[+-]?0[0-9]+")
_WORDS: dict[str, bool | None] = {
    "": None,
    "~": None,
    "null": None,
    "true": True,
    "yes": True,
    "on": True,
    "false": False,
    "no": False,
    "off": False,
}


def read(path: Path, what: str) -> Any:
    """Read a YAML file: mappings, lists, texts, numbers, truth values.

    Args:
        path: The file; JSON is YAML too.
        what: The expected content, in words, for errors.

    Raises:
        InvalidInput: The file cannot be read, is not YAML, has a key twice, or several documents.
    """
    found = documents(path, what)
    if len(found) > 1:
        raise InvalidInput(what, "one YAML document", value=len(found), file=str(path))
    return found[0] if found else None


def documents(path: Path, what: str) -> list[Any]:
    """Read the documents of a YAML file that are not empty.

    `ros2 topic echo` ends each document with `---`.

    Args:
        path: The file; JSON is YAML too.
        what: The expected content, in words, for errors.

    Raises:
        InvalidInput: The file cannot be read, is not YAML, has a key twice or an alias.
    """
    check_installed()
    content = files.text(path, what, "YAML")
    try:
        found = list(_Documents(content))
    except yaml.MarkedYAMLError as error:
        reason = f"{error.problem}{_line(error.problem_mark)}"
        raise files.unreadable(path, what, "YAML", ValueError(reason)) from None
    except (ValueError, yaml.YAMLError) as error:
        raise files.unreadable(path, what, "YAML", error) from None
    return [document for document in found if document is not None]


def text(table: Any) -> str:
    """Return a table as YAML."""
    check_installed()
    written: str = yaml.safe_dump(table, sort_keys=False, default_flow_style=None)
    return written


def check_installed() -> None:
    """Raise `MissingBackend` where YAML can be neither read nor written."""
    if yaml is None:
        raise MissingBackend("pyyaml", "ros")


def number(value: Any) -> float | None:
    """A finite number, also in quotes; None for any other value, and for 010 (octal to some)."""
    if isinstance(value, str) and not _OCTAL.fullmatch(value):
        value = numerals.parsed(value)
    return float(value) if numerals.is_number(value) else None


class _Documents:
    """The documents of a text. An alias counts as the values that it repeats."""

    def __init__(self, content: str) -> None:
        parser = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        self._events: Iterator[yaml.Event] = yaml.parse(content, Loader=parser)
        self._anchored: dict[str, Any] = {}
        self._count = 0

    def __iter__(self) -> Iterator[Any]:
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                self._anchored.clear()
                yield self._value(next(self._events), 0)

    def _value(self, event: yaml.Event, depth: int) -> Any:
        """Return the value that begins with this event."""
        line = _line(event.start_mark)
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self._anchored:
                raise ValueError(f"an alias *{event.anchor} of no value before it{line}")
            value = self._anchored[event.anchor]
            self._check(value, depth, line)
            return value
        self._check(None, depth, line)
        value = self._stated(event, depth + 1)
        if event.anchor:
            self._anchored[event.anchor] = value
        return value

    def _check(self, value: Any, depth: int, line: str) -> None:
        """Count a value and all within it; refuse too many, and those nested too deep."""
        self._count += 1
        if self._count > files.MAX_VALUES:
            raise ValueError(f"it has more than {files.MAX_VALUES} values{line}")
        if depth > files.MAX_DEPTH:
            raise ValueError(f"{files.TOO_DEEP}{line}")
        for inner in files.items(value):
            self._check(inner, depth + 1, line)

    def _stated(self, event: yaml.Event, depth: int) -> Any:
        """Return the value of an event that is no alias."""
        if isinstance(event, yaml.ScalarEvent):
            return _scalar(event)
        _check_tag(event)
        if isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(item := next(self._events), yaml.SequenceEndEvent):
                items.append(self._value(item, depth))
            return items
        table: dict[str, Any] = {}
        merged: dict[str, Any] = {}
        while not isinstance(key := next(self._events), yaml.MappingEndEvent):
            name = _key(key, table)
            value = self._value(next(self._events), depth)
            if name != "<<":
                table[name] = value
            elif merged or not isinstance(value, dict):
                raise ValueError(f"a merge key << of more than one table{_line(key.start_mark)}")
            else:
                merged = value
        return merged | table


def _key(event: yaml.Event, table: dict[str, Any]) -> str:
    """A key, always a text: a joint may be called `1` or `on`."""
    line = _line(event.start_mark)
    if not isinstance(event, yaml.ScalarEvent):
        raise ValueError(f"a key is no text{line}")
    name = str(event.value)
    if name in table:
        raise ValueError(f"the key {shortened(name, 60)} is there twice{line}")
    return name


def _scalar(event: yaml.ScalarEvent) -> Any:
    text = event.value
    if event.tag in ("!degrees", "!radians"):
        angle = number(text)
        if event.tag == "!radians" or angle is None:
            return text
        return angle * _DEGREE
    _check_tag(event)
    is_text = event.tag in _TEXT_TAGS or not (event.tag or event.implicit[0])
    if is_text:
        return text
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    if _OCTAL.fullmatch(text):
        return text
    found = numerals.parsed(text)
    return text if found is None else found


def _check_tag(event: yaml.Event) -> None:
    """Refuse tags of values that are no table, list, text, number or truth value."""
    tag = event.tag
    if tag is not None and tag not in _TAGS:
        line = _line(event.start_mark)
        raise ValueError(f"a tag {shortened(tag, 60)}, which is not supported{line}")


def _line(mark: Any) -> str:
    return "" if mark is None else f", line {mark.line + 1}"
