"""Names to planners and back: every planner enters here.

Our planners, the baselines and other people's register under the entry-point group
`trajopt.planners`: a class, an object, a function that returns one, or a function that plans.
A planner of a Python file needs no registration: `./my_planner.py:MyPlanner` names the same things.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from trajopt.core import numerals
from trajopt.core.exceptions import InvalidInput, MissingBackend, TrajoptError, UnknownName
from trajopt.core.renamed import of_other_tools
from trajopt.planners.planner import Planner, adapted, is_solve, raised

GROUP = "trajopt.planners"
DISTRIBUTION = "mintime"  # whose planners are ours

PlannerT = TypeVar("PlannerT")


@dataclass(frozen=True)
class Entry:
    """A registered planner, not yet imported.

    Attributes:
        name: Name of the planner.
        point: The entry point that is imported.
        rival: An entry point of another distribution with the same name; neither can be imported.
    """

    name: str
    point: EntryPoint
    rival: EntryPoint | None = None

    @property
    def is_own(self) -> bool:
        """True if this distribution registers it, and no other does."""
        return self.rival is None and _distribution(self.point) == DISTRIBUTION

    def load(self) -> Planner:
        """The planner with its default options; raises `TrajoptError` if it cannot be imported."""
        if self.rival is not None:
            both = f"{_distribution(self.point)} and {_distribution(self.rival)}"
            raise TrajoptError(
                f"planner {self.name!r} is registered by two distributions, {both}: uninstall one"
            )
        with self.imports():
            return adapted(_object(self.point.load()))

    @contextmanager
    def imports(self) -> Iterator[None]:
        """Convert every error during the import of a planner's code to `TrajoptError`."""
        try:
            yield
        except (Exception, SystemExit) as error:
            package = self.point.module.partition(".")[0]
            if isinstance(error, ModuleNotFoundError):
                absent = (error.name or package).partition(".")[0]
                if absent != package:
                    raise MissingBackend(absent) from error
            says_where = isinstance(error, TrajoptError | SyntaxError)
            why = _shadow(package) or (str(error) if says_where else raised(error))
            raise TrajoptError(f"planner {self.name!r} cannot be loaded: {why}") from error

    def missing(self) -> str | None:
        """Return why this planner cannot run, with the command to install; None if it can."""
        try:
            planner = self.load()
        except TrajoptError as error:
            return str(error)
        return missing(planner)


def missing(planner: Planner) -> str | None:
    """Return which packages are missing for a planner, with the command to install; or None."""
    packages = sorted({name.partition(".")[0] for name in planner.requires})
    absent = [name for name in packages if importlib.util.find_spec(name) is None]
    if not absent:
        return None
    return str(MissingBackend(" ".join(absent), planner.extra))


def _distribution(point: EntryPoint) -> str:
    """Return the name of the distribution that registers an entry point; empty for a file's."""
    return point.dist.name if point.dist else ""


def _shadow(package: str) -> str:
    """Name a folder that hides a package of ours, if one does: `baselines` is a frequent name."""
    ours = Path(__file__).resolve().parents[2] / package
    origin = getattr(importlib.util.find_spec(package), "origin", None)
    if origin is None or not ours.is_dir():
        return ""
    hiding = Path(origin.removesuffix("/__init__.py")).resolve()
    if hiding == ours:
        return ""
    return f"{hiding} hides our package {package}; rename it, or run elsewhere"


def _object(target: Any) -> object:
    """Return the object or planning function that an entry point names, or calls to make."""
    is_object = hasattr(target, "solve") and not isinstance(target, type)
    is_planner = is_object or is_solve(target)
    return target if is_planner or not callable(target) else target()


@cache
def entries() -> dict[str, Entry]:
    """Every registered planner by name."""
    found: dict[str, Entry] = {}
    for point in entry_points(group=GROUP):
        known = found.get(point.name)
        if known is None:
            found[point.name] = Entry(point.name, point)
        elif _distribution(known.point) != _distribution(point):
            found[point.name] = replace(known, rival=point)
    return found


def in_file(file: Path, name: str) -> Entry:
    """A planner that a Python file defines, under its name in the file.

    The file's folder joins the import path, as a script's does: there the file finds the modules
    beside it, and the processes that run the planner find the file.

    Raises:
        InvalidInput: There is no such file, or Python finds another module under its name.
        UnknownName: The file defines no such name; the message lists its planners.
        TrajoptError: The file cannot be imported.
    """
    label = _name_in_file(file, name)
    path = file.resolve()
    folder = str(path.parent)
    if folder not in sys.path:
        sys.path.append(folder)
    entry = Entry(label, EntryPoint(label, f"{path.stem}:{name}", GROUP))
    with entry.imports():
        module = importlib.import_module(path.stem)
    found = getattr(module, "__file__", None) or "a module of Python"
    if Path(found).resolve() != path:
        right = f"a file of another name: import {path.stem} finds {found}"
        raise InvalidInput("planner", right, value=str(file))
    members = vars(module)
    if name not in members:
        own = [key for key in members if getattr(members[key], "__module__", "") == path.stem]
        if not name:
            right = f"{file}:NAME, where NAME is one of {', '.join(own)}"
            raise InvalidInput("planner", right, value=str(file))
        raise UnknownName(f"planner of {file}", name, own)
    return entry


def _name_in_file(file: Path, name: str) -> str:
    """Return the name of a planner of a file; a registered planner's name gets the file's."""
    if not file.is_file():
        raise InvalidInput("planner", "a Python file that exists", value=str(file))
    return f"{file.resolve().stem}.{name}" if name in entries() else name


@dataclass(frozen=True)
class Spec:
    """The name of a planner with its options, before anything is imported.

    Attributes:
        text: The spec, with the absolute path of a file.
        name: The planner's name.
        is_own: Whether this distribution registers the planner.
    """

    text: str
    name: str
    is_own: bool


def find(spec: str) -> Spec:
    """Find what a spec names, and import nothing; raises as `named` does."""
    name, _ = parse(spec)
    file, _, own = name.partition(":")
    if file.endswith(".py"):
        label = _name_in_file(Path(file), own)
        return Spec(spec.strip().replace(file, str(Path(file).resolve()), 1), label, False)
    if name not in entries():
        raise UnknownName("planner", name, entries())
    return Spec(spec, name, entries()[name].is_own)


def load(spec: str) -> Planner:
    """A planner from `"name"` or `"name:key=value,key=value"`; `"file.py:name"` is a name too.

    Raises `UnknownName`, or `InvalidInput` naming the option, its value and what would be right.
    """
    _, planner = named(spec)
    return planner


def named(spec: str) -> tuple[str, Planner]:
    """A planner's name, and the planner; raises as `load` and `in_file` do."""
    name, options = parse(spec)
    file, _, own = name.partition(":")
    entry = in_file(Path(file), own) if file.endswith(".py") else entries().get(name)
    if entry is None:
        raise UnknownName("planner", name, entries())
    return entry.name, configured(entry.load(), options, entry.name)


def parse(spec: str) -> tuple[str, dict[str, str]]:
    """`"issa:fitness=scaled,population=50"` to its name and its options as text."""
    file, ending, inner = spec.rpartition(".py:")
    own, _, rest = inner.partition(":")
    name = f"{file}{ending}{own}".strip()
    options = {}
    for pair in filter(None, rest.split(",")):
        key, equals, value = pair.partition("=")
        if not equals:
            right = "options as key=value, separated by commas"
            raise InvalidInput(f"planner {name}", right, value=pair)
        options[key.strip()] = value.strip()
    return name, options


def options(planner: object) -> dict[str, Any]:
    """Return every option of a planner with its value."""
    return adapted(planner).options()


def label(name: str, planner: object) -> str:
    """Return a planner's name with the options that differ from the registered ones."""
    own = adapted(planner)
    entry = entries().get(name)
    usual = entry.load().options() if entry is not None else own.defaults()
    changed = []
    for key, value in own.options().items():
        if key not in usual or repr(usual[key]) != repr(value):
            changed.append(f"{key}={value}")
    if not changed:
        return name
    listed = ",".join(changed)
    return f"{name}:{listed}"


def configured(planner: PlannerT, changes: Mapping[str, Any], name: str = "") -> PlannerT:
    """Copy a planner with some options changed; text is converted to the option's type."""
    known = options(planner)
    listed = ", ".join(known) or "no options"
    for option, value in changes.items():
        if option not in known:
            key = f"planner {name}, option {option}"
            ours = of_other_tools(option)
            right = f"{ours}={value}, as it is called here; options: {listed}"
            raise InvalidInput(key, right if ours in known else f"one of: {listed}", value=value)
    changed: PlannerT = _replaced(planner, changes, name)
    return changed


def _replaced(planner: Any, changes: Mapping[str, Any], name: str) -> Any:
    hints = get_type_hints(type(planner))
    new = {}
    known = fields(planner) if is_dataclass(planner) else ()
    for field in known:
        value = getattr(planner, field.name)
        if is_dataclass(value):
            new[field.name] = _replaced(value, changes, name)
        elif field.name in changes:
            key = f"planner {name}, option {field.name}"
            new[field.name] = _converted(key, changes[field.name], hints[field.name])
    if not new:
        return planner
    try:
        return replace(planner, **new)
    except InvalidInput as error:
        key = f"planner {name}, option {error.key}"
        raise InvalidInput(key, error.expected, value=error.value) from None


def _converted(key: str, given: Any, hint: Any) -> Any:
    """Return a value of the annotated type, from that type or from text.

    Raises:
        InvalidInput: The value is of another type, or not among the choices.
    """
    value = _read(given) if isinstance(given, str) else given
    origin = get_origin(hint)
    if origin is Literal:
        choices = get_args(hint)
        for candidate in (given, value):
            if candidate in choices:
                return candidate
        raise InvalidInput(key, " or ".join(map(repr, choices)), value=value)
    kinds = get_args(hint) if origin in (Union, UnionType) else (hint,)
    for kind in kinds:
        if isinstance(value, bool) and kind is not bool:
            continue
        if kind is float and isinstance(value, int) and abs(value) < _LARGEST_FLOAT:
            return float(value)
        if isinstance(value, kind):
            return value
    if isinstance(given, str) and str in kinds:
        return given
    names = [kind.__name__ for kind in kinds]
    raise InvalidInput(key, " or ".join(names), value=value)


def _read(text: str) -> Any:
    """Read a word or a decimal number of Python's; else return the text itself."""
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    number = numerals.parsed(text)
    return text if number is None else number


_WORDS = {"true": True, "false": False, "none": None}
_LARGEST_FLOAT = 2**1023
