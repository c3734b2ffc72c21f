"""Names to planners and back: the one door by which every planner enters.

Ours, the baselines and a stranger's register under the entry-point group `trajopt.planners`: a
class, an object, a function that returns one, or a function that plans: `solve(problem, *, seed)`.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from trajopt.core import numerals
from trajopt.core.exceptions import InvalidInput, MissingBackend, TrajoptError, UnknownName
from trajopt.planners.planner import Planner, adapted, is_solve

GROUP = "trajopt.planners"
# What a planner was called before; it still answers to that name.
FORMER_NAMES = {"ruckig": "ruckig-search"}

PlannerT = TypeVar("PlannerT")


@dataclass(frozen=True)
class Entry:
    """A registered planner, not yet imported."""

    name: str
    point: EntryPoint

    def load(self) -> Planner:
        """The planner with its default options; raises `TrajoptError` if it cannot be imported."""
        try:
            target = self.point.load()
            return adapted(_object(target))
        except Exception as error:
            package = self.point.module.partition(".")[0]
            absent = _missing_package(error)
            if absent and absent != package:
                raise MissingBackend(absent) from error
            why = _shadow(package) or str(error)
            raise TrajoptError(f"planner {self.name!r} cannot be loaded: {why}") from error

    def missing(self) -> str | None:
        """What keeps this planner from running, with the command that mends it; or None."""
        try:
            planner = self.load()
        except TrajoptError as error:
            return str(error)
        packages = sorted({name.partition(".")[0] for name in planner.requires})
        absent = [name for name in packages if importlib.util.find_spec(name) is None]
        if not absent:
            return None
        return str(MissingBackend(" ".join(absent), planner.extra))


def _missing_package(error: Exception) -> str:
    """The package that could not be found, if that is what went wrong."""
    if not isinstance(error, ModuleNotFoundError):
        return ""
    module = error.name or ""
    return module.partition(".")[0]


def _shadow(package: str) -> str:
    """In words, a folder that hides a package of ours: `baselines` is a frequent name."""
    root = Path(__file__).resolve().parents[2]
    ours = root / package
    found = importlib.util.find_spec(package)
    if found is None or not ours.is_dir():
        return ""
    locations = found.submodule_search_locations or ()
    folders = [Path(folder).resolve() for folder in locations]
    if ours in folders:
        return ""
    hiding = folders[0] if folders else found.origin
    return f"{hiding} hides our package {package}; rename it, or run elsewhere"


def _object(target: Any) -> object:
    """What an entry point names: an object, a function that plans, or what something makes."""
    is_object = hasattr(target, "solve") and not isinstance(target, type)
    is_planner = is_object or is_solve(target)
    return target if is_planner else target()


@cache
def entries() -> dict[str, Entry]:
    """Every registered planner by name."""
    points = entry_points(group=GROUP)
    return {point.name: Entry(point.name, point) for point in points}


def load(spec: str) -> Planner:
    """A planner from `"name"` or `"name:key=value,key=value"`.

    Raises `UnknownName`, or `InvalidInput` naming the option, its value and what would be right.
    """
    _, planner = named(spec)
    return planner


def named(spec: str) -> tuple[str, Planner]:
    """A planner's registered name, and the planner; raises as `load` does."""
    name, options = parse(spec)
    registered = entries()
    if name not in registered:
        name = FORMER_NAMES.get(name, name)
    if name not in registered:
        raise UnknownName("planner", name, registered)
    planner = registered[name].load()
    return name, configured(planner, options, name)


def parse(spec: str) -> tuple[str, dict[str, str]]:
    """`"issa:fitness=scaled,population=50"` to its name and its options as text."""
    name, _, rest = spec.partition(":")
    options = {}
    for pair in filter(None, rest.split(",")):
        key, equals, value = pair.partition("=")
        if not equals:
            right = "options as key=value, separated by commas"
            raise InvalidInput(f"planner {name}", right, value=pair)
        options[key.strip()] = value.strip()
    return name.strip(), options


def options(planner: object) -> dict[str, Any]:
    """Every option of a planner with its value, whether it has the base class or not."""
    return adapted(planner).options()


def label(name: str, planner: object) -> str:
    """A planner's name with the options that differ from the registered ones, or its defaults."""
    own = adapted(planner)
    entry = entries().get(name)
    usual = own.defaults()
    if entry is not None:
        usual = entry.load().options()
    changed = []
    for key, value in own.options().items():
        if key not in usual or repr(usual[key]) != repr(value):
            changed.append(f"{key}={value}")
    if not changed:
        return name
    listed = ",".join(changed)
    return f"{name}:{listed}"


def configured(planner: PlannerT, changes: Mapping[str, Any], name: str = "") -> PlannerT:
    """A copy of the planner with some options changed; text is converted to the option's type."""
    known = options(planner)
    listed = ", ".join(known) or "no options"
    for option, value in changes.items():
        if option not in known:
            key = f"planner {name}, option {option}"
            raise InvalidInput(key, f"one of: {listed}", value=value)
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
            given = changes[field.name]
            new[field.name] = _converted(key, given, hints[field.name])
    try:
        return replace(planner, **new)
    except InvalidInput as error:
        key = f"planner {name}, option {error.key}"
        raise InvalidInput(key, error.expected, value=error.value) from None


def _converted(key: str, given: Any, hint: Any) -> Any:
    """A value of the annotated type, from that type or from text; as given, or refused."""
    value = given
    if isinstance(given, str):
        value = _read(given)
    origin = get_origin(hint)
    if origin is Literal:
        return _chosen(key, given, value, get_args(hint))
    kinds = (hint,)
    if origin in (Union, UnionType):
        kinds = get_args(hint)
    for kind in kinds:
        if kind is float and _is_whole(value) and abs(value) < _LARGEST_FLOAT:
            return float(value)
        if isinstance(value, bool) and kind is not bool:
            continue
        if isinstance(value, kind):
            return value
    if isinstance(given, str) and str in kinds:
        return given
    names = [kind.__name__ for kind in kinds]
    raise InvalidInput(key, " or ".join(names), value=value)


def _chosen(
    key: str,
    given: Any,
    value: Any,
    choices: tuple[Any, ...],
) -> Any:
    """One of the choices: the text as given, or the value that it says."""
    for candidate in (given, value):
        if candidate in choices:
            return candidate
    names = map(repr, choices)
    raise InvalidInput(key, " or ".join(names), value=value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _read(text: str) -> Any:
    """A word or a decimal number of Python's; the text itself where it is neither."""
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    number = numerals.parsed(text)
    return text if number is None else number


_WORDS = {"true": True, "false": False, "none": None}
_LARGEST_FLOAT = 2**1023
