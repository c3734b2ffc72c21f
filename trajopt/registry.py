"""Names to planners and back: the one door by which every planner enters.

Ours, the baselines and a stranger's register under the entry-point group `trajopt.planners`: a
class, an object, or a function that returns one.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from trajopt import numerals
from trajopt.exceptions import InvalidInput, MissingBackend, TrajoptError, UnknownName
from trajopt.planner import Planner, adapted

GROUP = "trajopt.planners"

PlannerT = TypeVar("PlannerT")


@dataclass(frozen=True)
class Entry:
    """A registered planner, not yet imported."""

    name: str
    point: EntryPoint

    def load(self) -> Planner:
        """The planner with its default options; raises `TrajoptError` if it cannot be imported."""
        try:
            return adapted(_object(self.point.load()))
        except Exception as error:
            package = error.name if isinstance(error, ModuleNotFoundError) else None
            if package and package.split(".")[0] != self.point.module.split(".")[0]:
                raise MissingBackend(package.split(".")[0]) from error
            raise TrajoptError(f"planner {self.name!r} cannot be loaded: {error}") from error

    def missing(self) -> str | None:
        """What keeps this planner from running, with the command that mends it; or None."""
        try:
            planner = self.load()
        except TrajoptError as error:
            return str(error)
        absent = [name for name in planner.requires if not importlib.util.find_spec(name)]
        if not absent:
            return None
        return str(MissingBackend(" ".join(absent)))


def _object(target: Any) -> object:
    """What an entry point names: an object, or what a class or a function makes."""
    is_planner = hasattr(target, "solve") and not isinstance(target, type)
    return target if is_planner else target()


@cache
def entries() -> dict[str, Entry]:
    """Every registered planner by name."""
    return {point.name: Entry(point.name, point) for point in entry_points(group=GROUP)}


def load(spec: str) -> Planner:
    """A planner from `"name"` or `"name:key=value,key=value"`.

    Raises `UnknownName`, or `InvalidInput` naming the option, its value and what would be right.
    """
    return named(spec)[1]


def named(spec: str) -> tuple[str, Planner]:
    """A planner's registered name, and the planner; raises as `load` does."""
    name, options = parse(spec)
    if name not in entries():
        raise UnknownName("planner", name, entries())
    return name, configured(entries()[name].load(), options, name)


def parse(spec: str) -> tuple[str, dict[str, str]]:
    """`"issa:fitness=scaled,population=50"` to its name and its options as text."""
    name, _, rest = spec.partition(":")
    pairs = [pair.partition("=") for pair in rest.split(",") if pair]
    for key, equals, _ in pairs:
        if not equals:
            right = "options as key=value, separated by commas"
            raise InvalidInput(f"planner {name}", right, value=key)
    return name.strip(), {key.strip(): value.strip() for key, _, value in pairs}


def options(planner: object) -> dict[str, Any]:
    """Every option of a planner with its value, whether it has the base class or not."""
    return adapted(planner).options()


def label(name: str, planner: object) -> str:
    """A planner's name with the options that differ from the registered ones, or its defaults."""
    own = adapted(planner)
    defaults = entries()[name].load().options() if name in entries() else own.defaults()
    changed = [
        f"{key}={value}"
        for key, value in own.options().items()
        if key not in defaults or repr(defaults[key]) != repr(value)
    ]
    return f"{name}:{','.join(changed)}" if changed else name


def configured(planner: PlannerT, changes: Mapping[str, Any], name: str = "") -> PlannerT:
    """A copy of the planner with some options changed; text is converted to the option's type."""
    known = options(planner)
    for key, value in changes.items():
        if key not in known:
            listed = ", ".join(known) or "no options"
            raise InvalidInput(f"planner {name}, option {key}", f"one of: {listed}", value=value)
    changed: PlannerT = _replaced(planner, changes, name)
    return changed


def _replaced(planner: Any, changes: Mapping[str, Any], name: str) -> Any:
    hints = get_type_hints(type(planner))
    new = {}
    for field in fields(planner):
        value = getattr(planner, field.name)
        if is_dataclass(value):
            new[field.name] = _replaced(value, changes, name)
        elif field.name in changes:
            key = f"planner {name}, option {field.name}"
            new[field.name] = _converted(key, changes[field.name], hints[field.name])
    try:
        return replace(planner, **new)
    except InvalidInput as error:
        key = f"planner {name}, option {error.key}"
        raise InvalidInput(key, error.expected, value=error.value) from None


def _converted(key: str, value: Any, hint: Any) -> Any:
    """A value of the annotated type, from that type or from text; as given, or refused."""
    text = value
    if isinstance(text, str):
        value = _read(text)
    if get_origin(hint) is Literal:
        for choice in (text, value):
            if choice in get_args(hint):
                return choice
        raise InvalidInput(key, " or ".join(repr(a) for a in get_args(hint)), value=value)
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    for kind in kinds:
        if kind is float and _is_whole(value) and abs(value) < _LARGEST_FLOAT:
            return float(value)
        if isinstance(value, kind) and (kind is bool or not isinstance(value, bool)):
            return value
    if isinstance(text, str) and str in kinds:
        return text
    raise InvalidInput(key, " or ".join(k.__name__ for k in kinds), value=value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _read(text: str) -> Any:
    """A word or a decimal number of Python's; the text itself where it is neither."""
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    for reading in (numerals.whole, numerals.decimal):
        with suppress(ValueError):
            return reading(text)
    return text


_WORDS = {"true": True, "false": False, "none": None}
_LARGEST_FLOAT = 2**1023
