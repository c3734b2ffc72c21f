"""The planner contract: what a planner must offer, and what it has unless it says otherwise.

A planner is a frozen dataclass whose fields are its options:

    @dataclass(frozen=True)
    class MyPlanner(Planner):
        samples: int = 100

        def solve(self, problem: Problem, *, seed: int = 0) -> Solution: ...

or a function, whose keywords with their defaults are its options:

    def my_planner(problem: Problem, *, seed: int = 0, samples: int = 100) -> Solution: ...

`trajopt.planners.registry` finds planners by their names; in a script, pass the object itself.
"""

from __future__ import annotations

import importlib
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, make_dataclass, replace
from enum import Enum
from functools import cached_property, wraps
from types import FunctionType
from typing import Any, TypeVar, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from trajopt.core.exceptions import InvalidInput, MissingBackend
from trajopt.core.problem import LimitName, Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory


class Relation(Enum):
    """How a planner's answers relate to the minimum-time problem."""

    SAME = "solves the same problem"
    RESTRICTION = "cannot beat the optimum"
    RELAXATION = "ignores a limit: its motion may break it"


def _refusing(solve: Callable[..., Solution]) -> Callable[..., Solution]:
    """A `solve` that answers `unsupported` where the planner refuses the problem."""

    @wraps(solve)
    def checked_solve(self: Planner, problem: Problem, *, seed: int = 0) -> Solution:
        reason = self.unsupported(problem)
        if reason is not None:
            return Solution(Status.UNSUPPORTED, message=reason)
        return solve(self, problem, seed=seed)

    return checked_solve


def _refusing_batch(
    solve_batch: Callable[..., list[Solution]],
) -> Callable[..., list[Solution]]:
    """The same for `solve_batch`."""

    @wraps(solve_batch)
    def checked_batch(self: Planner, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
        reason = self.unsupported(problem)
        if reason is not None:
            return [Solution(Status.UNSUPPORTED, message=reason) for _ in seeds]
        return solve_batch(self, problem, seeds)

    return checked_batch


class Planner(ABC):
    """Turns a `Problem` into a `Solution`. Only `solve` must be written; all else has a default.

    Its docstring's first line describes it in `trajopt list`.

    Attributes:
        stochastic: Whether the seed matters. If not, a comparison runs it once.
        on_request: Whether it is left out where all planners run, unless asked for by name.
        requires: Modules that `solve` imports, from packages that may be missing: looked for before
            the planner is listed, and imported before its time is taken.
        extra: The extra of this package that installs them, if there is one.
        knows: Kinds of limits that it plans for. Where it breaks another kind the verifier says
            so: it dilates the answer, or finds it outside its position limits.
    """

    stochastic: bool = False
    on_request: bool = False
    requires: tuple[str, ...] = ()
    extra: str = ""
    knows: tuple[LimitName, ...] = ("velocity", "acceleration")

    def __init_subclass__(cls, **arguments: Any) -> None:
        """A class's own `solve` and `solve_batch` answer `unsupported` what it cannot solve.

        So nobody who calls them directly has to remember to ask `unsupported` first. It is done
        here and not in a wrapper around `solve`, so that a planner still writes a plain `solve`.
        """
        super().__init_subclass__(**arguments)
        if "solve" in vars(cls):
            cls.solve = _refusing(cls.solve)  # type: ignore[method-assign]
        if "solve_batch" in vars(cls):
            cls.solve_batch = _refusing_batch(cls.solve_batch)  # type: ignore[method-assign]

    @abstractmethod
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The answer; the same for the same seed. Nothing it returns is believed unverified."""

    def solve_batch(self, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
        """One answer per seed, each what `solve` gives; by default one after the other."""
        return [self.solve(problem, seed=seed) for seed in seeds]

    @property
    def implementation(self) -> object:
        """The object that does the work: itself, unless another was adapted to this interface."""
        return self

    @property
    def batched(self) -> bool:
        """Whether it advances several seeds together."""
        return type(self).solve_batch is not Planner.solve_batch

    def relation(self, problem: Problem) -> Relation:
        """How its answers relate to the optimum of this problem; by default a restriction."""
        return Relation.RESTRICTION

    def unsupported(self, problem: Problem) -> str | None:
        """Why it cannot solve this problem, from a quick look; None (the default) if it can."""
        return None

    def along(self, problem: Problem, trajectory: Trajectory) -> Solution:
        """The fastest timing of a given trajectory's path; by default unsupported."""
        return Solution(Status.UNSUPPORTED, message="it does not time given paths")

    def options(self) -> dict[str, Any]:
        """Every option with its value; those of nested dataclasses beside the outer ones."""
        return field_values(self)

    def defaults(self) -> dict[str, Any]:
        """The values of those options that have one by default."""
        return field_defaults(self)

    @property
    def description(self) -> str:
        """What `trajopt list` says of it."""
        return first_line(self)


def first_line(planner: object) -> str:
    """The first line of a planner's own docstring."""
    text = type(planner).__doc__ or ""
    return text.strip().partition("\n")[0]


def field_values(value: object) -> dict[str, Any]:
    """The fields of a dataclass, with those of nested dataclasses beside the outer ones."""
    if not is_dataclass(value):
        return {}
    table: dict[str, Any] = {}
    for field in fields(value):
        own = getattr(value, field.name)
        if is_dataclass(own):
            table |= field_values(own)
        else:
            table[field.name] = own
    return table


def field_defaults(value: object) -> dict[str, Any]:
    """The defaults of a dataclass's fields, with those of nested dataclasses beside them."""
    if not is_dataclass(value):
        return {}
    table: dict[str, Any] = {}
    for field in fields(value):
        default = field.default
        if field.default_factory is not MISSING:
            default = field.default_factory()
        if is_dataclass(default):
            table |= field_values(default)
        elif default is not MISSING:
            table[field.name] = default
    return table


@dataclass(frozen=True)
class _Adapted(Planner):
    """A planner that offers the methods without the base class, with the defaults for the rest."""

    own: Any
    stochastic: bool
    on_request: bool
    requires: tuple[str, ...]
    knows: tuple[LimitName, ...]

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        solution: Solution = self.own.solve(problem, seed=seed)
        return solution

    def solve_batch(self, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
        if not self.batched:
            return super().solve_batch(problem, seeds)
        solutions: list[Solution] = self.own.solve_batch(problem, seeds)
        return solutions

    @property
    def implementation(self) -> object:
        return self.own

    @property
    def batched(self) -> bool:
        return hasattr(self.own, "solve_batch")

    def relation(self, problem: Problem) -> Relation:
        if not hasattr(self.own, "relation"):
            return super().relation(problem)
        relation: Relation = self.own.relation(problem)
        return relation

    def unsupported(self, problem: Problem) -> str | None:
        if not hasattr(self.own, "unsupported"):
            return super().unsupported(problem)
        reason: str | None = self.own.unsupported(problem)
        return reason

    def along(self, problem: Problem, trajectory: Trajectory) -> Solution:
        if not hasattr(self.own, "along"):
            return super().along(problem, trajectory)
        solution: Solution = self.own.along(problem, trajectory)
        return solution

    def options(self) -> dict[str, Any]:
        if not hasattr(self.own, "options"):
            return field_values(self.own)
        table: dict[str, Any] = self.own.options()
        return table

    def defaults(self) -> dict[str, Any]:
        return field_defaults(self.own)

    @property
    def description(self) -> str:
        return str(getattr(self.own, "description", first_line(self.own)))


def is_solve(target: object) -> bool:
    """Whether this is a function that plans: one whose first argument, the problem, is needed."""
    if not isinstance(target, FunctionType):
        return False
    first = next(iter(inspect.signature(target).parameters.values()), None)
    return first is not None and first.kind in _POSITIONAL and first.default is first.empty


def of_function(function: Callable[..., Solution]) -> Planner:
    """A planner that calls a function; its options are the function's keywords.

    What a planner may say of itself beyond that (`stochastic`, `requires`, `knows`, `on_request`,
    `relation`, `unsupported`) a function says by attributes of these names.

    Raises:
        InvalidInput: An option has no default, or cannot be seen.
    """
    name = function.__name__
    options = _function_options(function)
    takes_seed = "seed" in inspect.signature(function).parameters

    def solve(self: Any, problem: Problem, *, seed: int = 0) -> Solution:
        given = {option: getattr(self, option) for option, _, _ in options}
        if takes_seed:
            given["seed"] = seed
        return function(problem, **given)

    members: dict[str, Any] = {"solve": solve, "__doc__": function.__doc__}
    for said in _SAID_BY_ATTRIBUTES:
        if hasattr(function, said):
            members[said] = getattr(function, said)
    for said in ("relation", "unsupported"):
        if hasattr(function, said):
            members[said] = staticmethod(getattr(function, said))
    try:
        made = make_dataclass(name, options, bases=(Planner,), namespace=members, frozen=True)
    except ValueError as error:  # a list as a default, which all calls would share
        raise InvalidInput(f"planner {name}", f"other defaults: {error}") from None
    made.__module__ = function.__module__ or "__main__"
    made.__qualname__ = function.__qualname__
    planner: Planner = made()
    return planner


def _function_options(function: Callable[..., Solution]) -> list[tuple[str, Any, Any]]:
    """Name, type and default of each option."""
    _, *others = inspect.signature(function).parameters.values()
    try:
        hints = get_type_hints(function)
    except NameError:  # of what is imported for type checkers only
        hints = {}
    options = []
    for parameter in others:
        if parameter.name == "seed":
            continue
        key = f"planner {function.__name__}, {parameter.name}"
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise InvalidInput(key, "options by their names: what * takes nobody sees")
        if parameter.kind is parameter.POSITIONAL_ONLY or parameter.default is parameter.empty:
            raise InvalidInput(key, "a keyword with a default, as every option")
        hint = hints.get(parameter.name, type(parameter.default))
        options.append((parameter.name, hint, parameter.default))
    return options


_POSITIONAL = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
_SAID_BY_ATTRIBUTES = ("stochastic", "on_request", "requires", "knows")


def adapted(planner: object) -> Planner:
    """The planner itself, or one around a function, or around an object with the methods alone.

    The one place where an object of a stranger is asked what it has. Raises `InvalidInput` if it
    has no `solve`.
    """
    if isinstance(planner, Planner):
        return planner
    if is_solve(planner):
        return of_function(cast(Callable[..., Solution], planner))
    name = type(planner).__name__
    if isinstance(planner, type):
        raise InvalidInput("planner", f"an object, {planner.__name__}()", value=planner)
    if not callable(getattr(planner, "solve", None)):
        right = "a planner, with a method solve(problem, *, seed) (see trajopt.Planner)"
        raise InvalidInput("planner", right, value=name)
    return _Adapted(
        own=planner,
        stochastic=getattr(planner, "stochastic", False),
        on_request=getattr(planner, "on_request", False),
        requires=getattr(planner, "requires", ()),
        knows=getattr(planner, "knows", Planner.knows),
    )


def check_visible(planner: Planner) -> None:
    """Refuse a planner that could run with options that nobody sees.

    Its trials would be kept under the options that are seen, so that another configuration would
    show the first one's results.

    Raises:
        InvalidInput: with the lines that mend it.
    """
    own = planner.implementation
    kind = type(own)
    if "options" in dir(kind) and getattr(kind, "options", None) is not Planner.options:
        return  # it lists them itself
    parameters = getattr(kind, "__dataclass_params__", None)
    if parameters is None:
        raise _unseen(kind, "its options are no fields", _attributes(own))
    if not parameters.frozen:
        raise _unseen(kind, "its options can change while it runs", [])
    hidden = _hidden(own)
    if hidden:
        raise _unseen(kind, f"{', '.join(hidden)} cannot be seen", hidden)


def _attributes(own: object) -> list[str]:
    return sorted(vars(own)) if hasattr(own, "__dict__") else []


def _hidden(value: Any) -> list[str]:
    """Attributes of a dataclass, and of those nested in it, that are no fields."""
    shown = {field.name for field in fields(value)}
    kind = type(value)
    hidden = [
        name
        for name in _attributes(value)
        if name not in shown and not isinstance(getattr(kind, name, None), cached_property)
    ]
    for name in shown:
        nested = getattr(value, name, None)
        if is_dataclass(nested) and not isinstance(nested, type):
            hidden += [f"{name}.{inner}" for inner in _hidden(nested)]
    return hidden


def _unseen(kind: type, why: str, names: Sequence[str]) -> InvalidInput:
    options = [f"    {name}: float = 1.0" for name in names if "." not in name]
    lines = ["@dataclass(frozen=True)", f"class {kind.__name__}(Planner):", *options, "    ..."]
    right = "a frozen dataclass whose fields are its options (or a method options()):\n\n"
    return InvalidInput(f"planner {kind.__name__}: {why}", right + "\n".join(lines))


SolveT = TypeVar("SolveT", bound=Callable[..., Solution])


def passing_once(solve: SolveT) -> SolveT:
    """Let a `solve` method see consecutive identical waypoints as one, passed once."""

    @wraps(solve)
    def merged_solve(self: Any, problem: Problem, *, seed: int = 0) -> Solution:
        merged, index = problem.merged()
        solution = solve(self, merged, seed=seed)
        if merged is problem:
            return solution
        return expanded(solution, index)

    return cast(SolveT, merged_solve)


def expanded(solution: Solution, index: NDArray[np.intp]) -> Solution:
    """A merged problem's solution with one waypoint time per original waypoint.

    Args:
        solution: The merged problem's.
        index: `(waypoints,)`, where each original waypoint went, from `Problem.merged`.
    """
    if solution.trajectory is None:
        return solution
    merged = solution.trajectory
    original = Trajectory(merged.breaks, merged.coefficients, merged.waypoint_times[index])
    return replace(solution, trajectory=original)


def backend(name: str, extra: str = "") -> Any:
    """Import a solver when it is needed; `MissingBackend` names the command that mends it.

    Args:
        name: Of the module.
        extra: Of this package, that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise MissingBackend(package, extra) from error
