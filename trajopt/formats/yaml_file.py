"""YAML files as ROS writes them: tables, lists and plain values, angles tagged `!degrees`.

Read event by event, not by PyYAML's constructors: aliases and merge keys count as what they repeat,
so that a few hundred bytes make nothing endless, and a number is what it looks like in every
version of YAML (1:30 is no 90, 010 no 8).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import yaml

from trajopt.core import files, numerals
from trajopt.core.exceptions import InvalidInput, shortened

_DEGREE = pi / 180  # rad
_PARSER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
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
    """What a YAML file says: mappings, lists, texts, numbers, truth values.

    Args:
        path: The file; JSON is YAML too.
        what: It should be, in words, as an error says it.

    Raises:
        InvalidInput: It cannot be read, is not YAML, has a key twice, or several documents.
    """
    found = documents(path, what)
    if len(found) > 1:
        raise InvalidInput(what, "one YAML document", value=len(found), file=str(path))
    return found[0] if found else None


def documents(path: Path, what: str) -> list[Any]:
    """The documents of a YAML file that are not empty: `ros2 topic echo` ends each with `---`.

    Args:
        path: The file; JSON is YAML too.
        what: It should be, in words, as an error says it.

    Raises:
        InvalidInput: It cannot be read, is not YAML, has a key twice or an alias.
    """
    content = files.text(path, what, "YAML")
    try:
        found = list(_Documents(content))
    except yaml.MarkedYAMLError as error:
        reason = f"{error.problem}{_line(error.problem_mark)}"
        raise files.unreadable(path, what, "YAML", ValueError(reason)) from None
    except (ValueError, yaml.YAMLError) as error:
        raise files.unreadable(path, what, "YAML", error) from None
    return [document for document in found if document is not None]


def number(value: Any) -> float | None:
    """A finite number, also in quotes; None for others, and for what is octal to some."""
    if isinstance(value, str) and not _OCTAL.fullmatch(value):
        value = numerals.parsed(value)
    return float(value) if numerals.is_number(value) else None


@dataclass(frozen=True)
class _Anchored:
    """A value that aliases repeat, how many values it holds, and how deep they are nested."""

    value: Any
    size: int
    height: int


class _Documents:
    """The documents of a text, whose aliases count as what they repeat."""

    def __init__(self, content: str) -> None:
        self._events: Iterator[yaml.Event] = yaml.parse(content, Loader=_PARSER)
        self._anchored: dict[str, _Anchored] = {}
        self._size = 0
        self._deepest = 0

    def __iter__(self) -> Iterator[Any]:
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                self._anchored.clear()
                yield self._value(next(self._events), 0)

    def _value(self, event: yaml.Event, depth: int) -> Any:
        """What begins with this event."""
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self._anchored:
                line = _line(event.start_mark)
                raise ValueError(f"an alias *{event.anchor} of no value before it{line}")
            repeated = self._anchored[event.anchor]
            self._count(event, repeated.size, depth + repeated.height)
            return repeated.value
        before = self._size
        deepest = self._deepest
        self._deepest = depth
        self._count(event, 1, depth)
        value = self._stated(event, depth)
        if event.anchor:
            height = self._deepest - depth
            self._anchored[event.anchor] = _Anchored(value, self._size - before, height)
        self._deepest = max(deepest, self._deepest)
        return value

    def _count(self, event: yaml.Event, size: int, depth: int) -> None:
        self._size += size
        self._deepest = max(self._deepest, depth)
        if self._size > files.MAX_VALUES:
            raise ValueError(f"it has more than {files.MAX_VALUES} values{_line(event.start_mark)}")
        if depth > files.MAX_DEPTH:
            line = _line(event.start_mark)
            raise ValueError(f"it is nested deeper than {files.MAX_DEPTH}{line}")

    def _stated(self, event: yaml.Event, depth: int) -> Any:
        """A value that is no alias."""
        if isinstance(event, yaml.ScalarEvent):
            return _scalar(event)
        _check_tag(event)
        if isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(item := next(self._events), yaml.SequenceEndEvent):
                items.append(self._value(item, depth + 1))
            return items
        table: dict[str, Any] = {}
        merged: dict[str, Any] = {}
        while not isinstance(key := next(self._events), yaml.MappingEndEvent):
            name = _key(key, table)
            value = self._value(next(self._events), depth + 1)
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
    """Refuse what only a program could make."""
    tag = event.tag
    if tag is not None and tag not in _TAGS:
        line = _line(event.start_mark)
        raise ValueError(f"a tag {shortened(tag, 60)}, which is not supported{line}")


def _line(mark: Any) -> str:
    return "" if mark is None else f", line {mark.line + 1}"
