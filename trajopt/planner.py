"""The planner contract, and the one door by which every planner enters.

A planner is a frozen dataclass whose fields are its options. Ours, the baselines and a stranger's
register under the entry-point group `trajopt.planners`; in a script, pass the object itself.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from functools import cache, wraps
from importlib.metadata import EntryPoint, entry_points
from types import UnionType
from typing import (
    Any,
    Literal,
    Protocol,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    runtime_checkable,
)

from trajopt.exceptions import InvalidInput, MissingBackend, TrajoptError, UnknownName
from trajopt.problem import Problem
from trajopt.solution import Solution
from trajopt.trajectory import Trajectory

GROUP = "trajopt.planners"


class Relation(Enum):
    """How a planner's answers relate to the minimum-time problem."""

    SAME = "solves the same problem"
    RESTRICTION = "cannot beat the optimum"
    RELAXATION = "ignores a limit: its answer is a lower bound"


@runtime_checkable
class Planner(Protocol):
    """What a planner must offer. Optional besides:

    - `solve_batch(problem, seeds) -> list[Solution]`: all seeds together, used where it exists;
    - `along(problem, trajectory) -> Solution`: the fastest timing of a given trajectory's path;
    - `stochastic: bool` (default False): whether the seed matters; if not, or where `unsupported`
      (a quick look at the problem) refuses, it runs once;
    - `on_request: bool` (default False): left out where all planners run unless asked for by name;
    - `requires: tuple[str, ...]`: packages that `solve` imports, checked before listing;
    - a docstring, whose first line describes the planner in `trajopt list`.
    """

    def relation(self, problem: Problem) -> Relation: ...
    def unsupported(self, problem: Problem) -> str | None: ...
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution: ...


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
            planner: Planner = target() if isinstance(target, type) else target
        except Exception as error:
            package = error.name if isinstance(error, ModuleNotFoundError) else None
            if package and package.split(".")[0] != self.point.module.split(".")[0]:
                raise MissingBackend(package.split(".")[0]) from error
            raise TrajoptError(f"planner {self.name!r} cannot be loaded: {error}") from error
        return planner

    def missing(self) -> str | None:
        """What keeps this planner from running, with the command that mends it; or None."""
        try:
            planner = self.load()
        except TrajoptError as error:
            return str(error)
        absent = [p for p in getattr(planner, "requires", ()) if not importlib.util.find_spec(p)]
        return str(MissingBackend(" ".join(absent))) if absent else None


@cache
def entries() -> dict[str, Entry]:
    """Every registered planner by name."""
    found = [Entry(point.name, point) for point in entry_points(group=GROUP)]
    return {e.name: e for e in found}


def load(spec: str) -> Planner:
    """A planner from `"name"` or `"name:key=value,key=value"`.

    Raises `UnknownName`, or `InvalidInput` naming the option, its value and what would be right.
    """
    name, options = parse(spec)
    if name not in entries():
        raise UnknownName("planner", name, entries())
    return configured(entries()[name].load(), options, name)


def parse(spec: str) -> tuple[str, dict[str, str]]:
    """`"issa:fitness=scaled,population=50"` to its name and its options as text."""
    name, _, rest = spec.partition(":")
    pairs = [pair.partition("=") for pair in rest.split(",") if pair]
    for key, equals, _ in pairs:
        if not equals:
            raise InvalidInput(
                f"planner {name}", "options as key=value, separated by commas", value=key
            )
    return name.strip(), {key.strip(): value.strip() for key, _, value in pairs}


def options(planner: object) -> dict[str, Any]:
    """Every option with its value; those of a nested dataclass are listed beside the outer ones."""
    if not is_dataclass(planner):
        return {}
    table: dict[str, Any] = {}
    for field in fields(planner):
        value = getattr(planner, field.name)
        table |= options(value) if is_dataclass(value) else {field.name: value}
    return table


def label(name: str, planner: object) -> str:
    """A planner's name with the options that differ from the registered ones, or its defaults."""
    defaults = options(entries()[name].load()) if name in entries() else _defaults(planner)
    changed = [
        f"{k}={v}" for k, v in options(planner).items() if repr(defaults.get(k, v)) != repr(v)
    ]
    return f"{name}:{','.join(changed)}" if changed else name


def _defaults(planner: Any) -> dict[str, Any]:
    return {f.name: f.default for f in fields(planner)} if is_dataclass(planner) else {}


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
    hints, new = get_type_hints(type(planner)), {}
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
    """A value of the annotated type, from that type or from text."""
    text = value
    if isinstance(value, str):
        with contextlib.suppress(ValueError, SyntaxError):
            value = _WORDS[value.lower()] if value.lower() in _WORDS else ast.literal_eval(value)
    if get_origin(hint) is Literal:
        for choice in (text, value):
            if choice in get_args(hint):
                return choice
        raise InvalidInput(key, " or ".join(repr(a) for a in get_args(hint)), value=value)
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    for kind in kinds:
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
        if isinstance(value, kind) and (kind is bool or not isinstance(value, bool)):
            return value
    if isinstance(text, str) and str in kinds:
        return text
    raise InvalidInput(key, " or ".join(k.__name__ for k in kinds), value=value)


_WORDS = {"true": True, "false": False, "none": None}


def backend(name: str) -> Any:
    """Import a solver when it is needed; `MissingBackend` names the command that mends it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingBackend(name) from error


def passing_once(solve: Any) -> Any:
    """Let a `solve` method see consecutive identical waypoints as one, passed once."""

    @wraps(solve)
    def merged_solve(self: Any, problem: Problem, *, seed: int = 0) -> Solution:
        merged, index = problem.merged()
        return expanded(solve(self, merged, seed=seed), index)

    return merged_solve


def expanded(solution: Solution, index: Any) -> Solution:
    """A merged problem's solution with one waypoint time per original waypoint."""
    if solution.trajectory is None:
        return solution
    t = solution.trajectory
    return replace(
        solution, trajectory=Trajectory(t.breaks, t.coefficients, t.waypoint_times[index])
    )
