"""The planner contract: what a planner must offer, and the defaults of everything else.

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

import dis
import importlib
import inspect
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass, make_dataclass, replace
from enum import Enum
from functools import cached_property, partial, wraps
from types import FunctionType
from typing import Any, cast, get_type_hints

import numpy as np

from trajopt.core import dwell
from trajopt.core.demand import DEMANDS, names
from trajopt.core.end_states import impossible
from trajopt.core.exceptions import InvalidInput, MissingBackend
from trajopt.core.limits import Limit
from trajopt.core.problem import Problem, check_problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners import given_times, library_time
from trajopt.planners.durations import timed


class Relation(Enum):
    """How a planner's answers relate to the minimum-time problem."""

    SAME = "solves the same problem"
    RESTRICTION = "cannot beat the optimum"
    RELAXATION = "ignores a limit: its motion may break it"


def _knowing(unsupported: Callable[[Any, Problem], str | None]) -> Any:
    """Wrap `unsupported` so that it also refuses unknown limits and demands."""

    @wraps(unsupported)
    def checked(self: Planner, problem: Problem) -> str | None:
        problem = self._without_whole(problem)
        if self.splits(problem):
            return next(filter(None, map(self.unsupported, dwell.parts(problem))), None)
        return Planner.unsupported(self, problem) or unsupported(self, problem)

    return checked


def _refusing(solve: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap `solve` or `solve_batch` to answer `unsupported` where the planner refuses a problem.

    Limits and demands that it may leave out are removed from the problem; the message names the
    limits. An argument that is no `Problem` raises `WrongType`.
    """

    @wraps(solve)
    def checked(self: Planner, problem: Problem, *seeds: Sequence[int], **keywords: int) -> Any:
        check_problem(problem)
        is_batch = solve.__name__ == "solve_batch"
        free = self._without_whole(problem)
        if free is not problem:
            answer = checked(self, free, *seeds, **keywords)
            if not is_batch:
                return timed(problem, answer, lambda slower: checked(self, slower, **keywords))
            each = zip(answer, seeds[0], strict=True)
            return [
                timed(problem, solution, partial(self.solve, seed=seed)) for solution, seed in each
            ]
        reason = self.unsupported(problem)
        if reason is None and self.splits(problem):
            parts = [checked(self, part, *seeds, **keywords) for part in dwell.parts(problem)]
            if not is_batch:
                return _joined(problem, parts)
            return [_joined(problem, list(part)) for part in zip(*parts, strict=True)]
        refusal = None if reason else self._infeasible(problem)
        if reason is None and refusal is None:
            shown, said = self._shown(problem)
            answer = solve(self, shown, *seeds, **keywords)
            if not said:
                return answer
            relaxed = self.relation(problem) is Relation.RELAXATION
            if is_batch:
                return [_saying(said, solution, relaxed=relaxed) for solution in answer]
            return _saying(said, answer, relaxed=relaxed)
        refusal = refusal or Solution(Status.UNSUPPORTED, message=reason or "")
        if is_batch:
            return [refusal for _ in seeds[0]]
        return refusal

    return checked


def _sorting(solve_many: Callable[..., list[Solution]]) -> Callable[..., list[Solution]]:
    """Wrap `solve_many` so that it gets only problems that `solve` would get as they are.

    All others, refused ones too, are answered by `solve`. A planner need not handle `None`.
    """

    @wraps(solve_many)
    def checked(
        self: Planner, problems: Sequence[Problem], seeds: Sequence[int] | None = None
    ) -> list[Solution]:
        seeds = [0] * len(problems) if seeds is None else seeds
        pairs = list(zip(problems, seeds, strict=True))
        whole = [self._takes_whole(check_problem(problem)) for problem in problems]
        some = [pair for pair, is_whole in zip(pairs, whole, strict=True) if is_whole]
        answers = iter(solve_many(self, *map(list, zip(*some, strict=True))) if some else ())
        return [
            next(answers) if is_whole else self.solve(problem, seed=seed)
            for (problem, seed), is_whole in zip(pairs, whole, strict=True)
        ]

    return checked


def _timed(solve: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap `solve` or `solve_batch` to state the time inside the calls of a library.

    Answers of a batch have equal shares.
    """

    @wraps(solve)
    def timed(self: Planner, *arguments: Any, **keywords: Any) -> Any:
        with library_time.measured() as clock:
            answer = solve(self, *arguments, **keywords)
        if clock.seconds <= 0:
            return answer
        if isinstance(answer, Solution):
            return replace(answer, library_time=clock.seconds)
        if isinstance(answer, list) and all(isinstance(solution, Solution) for solution in answer):
            share = clock.seconds / len(answer)
            return [replace(solution, library_time=share) for solution in answer]
        return answer

    return timed


def _joined(problem: Problem, parts: list[Solution]) -> Solution:
    """Return the answer to a problem with waits, made of the answers to its parts.

    If a part has no motion, return its answer. The statistics are the durations of the starts, s:
    the shortest of each part added up, then the second shortest.
    """
    waits = float(problem.route.demand("dwell").sum())
    motions = [part.trajectory for part in parts if part.trajectory is not None]
    bounds = [part.lower_bound for part in parts if part.lower_bound is not None]
    lower_bound = sum(bounds) + waits if len(bounds) == len(parts) else None
    if len(motions) < len(parts):
        (*_, failed) = (part for part in parts if part.trajectory is None)
        return replace(failed, lower_bound=lower_bound, stats={}, history=None)
    relaxed = any(part.status is Status.RELAXED for part in parts)
    started = [np.sort(np.ravel(part.stats.get("start_duration", []))) for part in parts]
    count = min(map(len, started))
    stats = (
        {"start_duration": sum(durations[:count] for durations in started) + waits} if count else {}
    )
    return Solution(
        Status.RELAXED if relaxed else Status.SOLVED,
        dwell.joined(problem, motions),
        "; ".join(dict.fromkeys(part.message for part in parts if part.message)),
        lower_bound,
        setup_time=sum(part.setup_time for part in parts),
        stats=stats,
    )


def _saying(said: Sequence[str], solution: Solution, *, relaxed: bool) -> Solution:
    """Return the answer to the planner's own problem as an answer to the whole problem."""
    message = "; ".join(filter(None, [solution.message, *said]))
    status = solution.status
    if relaxed and status is Status.SOLVED:
        status = Status.RELAXED
    return replace(solution, status=status, message=message)


class Planner(ABC):
    """Turns a `Problem` into a `Solution`. Only `solve` must be written; all else has a default.

    A planner is derived from it as a frozen dataclass, whose fields are its options.

    Its docstring's first line describes it in `trajopt list`.

    Attributes:
        stochastic: True if the seed matters. If not, a comparison runs it once.
        on_request: Whether it runs only if it is named, and not among all planners.
        requires: Modules that `solve` imports, from packages that may be missing. They are searched
            before the planner is listed, and imported before its time is measured.
        extra: The extra of this package that installs them, if there is one.
        knows: Kinds of limits and demands that it plans for, by key. A problem with another kind of
            limit is unsupported, unless that kind is `forgiven` (`trajopt.core.limits.Limit`): the
            verifier then dilates or reports an answer that breaks it. A problem with another demand
            is unsupported, unless all motions without the demand keep it
            (`trajopt.core.demand.Demand.left_out`). The key "segment" stands for limits that differ
            from segment to segment. Planners without it get the tightest limits of all segments for
            the whole motion, and their message says so. The key "rows" stands for every kind of
            limit that states its inequalities (`trajopt.core.limits.Limit.rows`).
        drops: Whether it leaves out all kinds that it does not know, and says so. That is right for
            lower bounds: what is proved with fewer limits holds under all. Demands are left out
            too, if the problem without them is a relaxation.
    """

    stochastic: bool = False
    on_request: bool = False
    requires: tuple[str, ...] = ()
    extra: str = ""
    knows: tuple[str, ...] = ("velocity", "acceleration")
    drops: bool = False

    def __init_subclass__(cls, **arguments: Any) -> None:
        """Make a class's own `solve` and `solve_batch` refuse what it cannot solve.

        They also state the time inside a library (`trajopt.planners.library_time`). So callers
        need not call `unsupported` first, and a planner's own `solve` is simple.
        """
        super().__init_subclass__(**arguments)
        for name in ("solve", "solve_batch"):
            if name in vars(cls):
                setattr(cls, name, _timed(_refusing(vars(cls)[name])))
        if "solve_many" in vars(cls):
            cls.solve_many = _timed(_sorting(vars(cls)["solve_many"]))  # type: ignore[method-assign]
        stated = vars(cls).get("unsupported")
        if isinstance(stated, staticmethod):
            cls.unsupported = _knowing(lambda _, problem: stated(problem))  # type: ignore[method-assign]
        elif stated is not None:
            cls.unsupported = _knowing(stated)  # type: ignore[method-assign]

    @abstractmethod
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the answer; the same for the same seed. The verifier judges what it returns."""

    def solve_batch(self, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
        """Return one answer per seed, each equal to that of `solve`; by default one by one.

        It is the case of one problem of `solve_many`: a planner that advances many seeds together
        overrides this one, a planner that advances many problems together the other one.
        """
        return [self.solve(problem, seed=seed) for seed in seeds]

    def solve_many(
        self, problems: Sequence[Problem], seeds: Sequence[int] | None = None
    ) -> list[Solution]:
        """Return one answer per problem, as `solve` does; by default one by one.

        Durations equal those of `solve` to 1e-12, relative: sums of many are rounded in another
        order.

        Args:
            problems: In any order, of any size.
            seeds: One for each problem; by default 0 for all.
        """
        seeds = [0] * len(problems) if seeds is None else seeds
        return [
            self.solve(problem, seed=seed) for problem, seed in zip(problems, seeds, strict=True)
        ]

    @property
    def batched(self) -> bool:
        """True if it advances several seeds together."""
        return type(self).solve_batch is not Planner.solve_batch

    @property
    def takes_many(self) -> bool:
        """True if it advances several problems together."""
        return type(self).solve_many is not Planner.solve_many

    @property
    def may_be_stochastic(self) -> bool:
        """True if `solve` uses the seed, and no class of the planner sets `stochastic`."""
        if sum("stochastic" in vars(kind) for kind in type(self).__mro__) > 1:
            return False
        code = dis.Bytecode(inspect.unwrap(type(self).solve))
        return any("seed" in step.argrepr.split(", ") for step in code)

    def relation(self, problem: Problem) -> Relation:
        """Return how its answers relate to the optimum of this problem."""
        return Relation.RESTRICTION

    def unsupported(self, problem: Problem) -> str | None:
        """Return why it cannot solve this problem, from a quick look; None if it can.

        A planner's own reasons come after the limits and demands that it does not know.
        """
        problem = self._without_whole(problem)
        if self.splits(problem):
            return next(filter(None, map(self.unsupported, dwell.parts(problem))), None)
        harmless = "relaxation" if self.drops else "restriction"
        demands = self.unknown_demands(problem)
        asked = [key for key in demands if DEMANDS[key].left_out != harmless]
        if asked:
            return f"it does not know {names(asked)}"
        limits = problem.limits.kinds
        refused = [limits[key].name() for key in self.unknown(problem) if not limits[key].forgiven]
        if self.drops or not refused:
            return None
        return f"it does not know {' and '.join(refused)} limits"

    def _infeasible(self, problem: Problem) -> Solution | None:
        """Return the answer `infeasible` if a known limit or a state at an end proves it."""
        known = (limit for limit in problem.limits.kinds.values() if self.plans_for(limit))
        reasons = (limit.infeasible(problem) for limit in known)
        reason = impossible(problem) or next(filter(None, reasons), None)
        # what proves bounds says more: by how much
        if reason is None and "given_times" in self.knows and not self.drops:
            reason = given_times.impossible(problem)
        return None if reason is None else Solution(Status.INFEASIBLE, message=reason)

    def unknown(self, problem: Problem) -> list[str]:
        """Return the kinds of the problem's limits that it does not plan for, by their keys."""
        return [key for key, limit in problem.limits.kinds.items() if not self.plans_for(limit)]

    def plans_for(self, limit: Limit | type[Limit]) -> bool:
        """Return whether it plans for a kind of limit."""
        return limit.key in self.knows or ("rows" in self.knows and limit.has_rows())

    def unknown_demands(self, problem: Problem) -> list[str]:
        """Return the demands of the problem that it does not plan for, by their keys."""
        keys = [key for key in problem.demands if key not in self.knows]
        return [key for key in keys if not DEMANDS[key].splits and not DEMANDS[key].whole]

    def _takes_whole(self, problem: Problem) -> bool:
        """Return whether its `solve` gets a problem as it is, and refuses nothing."""
        if self._without_whole(problem) is not problem or self.splits(problem):
            return False
        if self.unsupported(problem) is not None or self._infeasible(problem) is not None:
            return False
        shown, said = self._shown(problem)
        return shown is problem and not said

    def _without_whole(self, problem: Problem) -> Problem:
        """Return the problem without what is asked of the whole motion, if it plans without it."""
        keys = [key for key in problem.demands if DEMANDS[key].whole and key not in self.knows]
        return problem.without(*keys) if keys else problem

    def splits(self, problem: Problem) -> bool:
        """Return whether it solves the problem part by part, from rest to rest between waits."""
        return any(DEMANDS[key].splits and key not in self.knows for key in problem.demands)

    def joins_segments(self, problem: Problem) -> bool:
        """Return whether it plans with the tightest limits of all segments, as these differ."""
        return problem.limits.segments is not None and "segment" not in self.knows

    def _shown(self, problem: Problem) -> tuple[Problem, list[str]]:
        """Return the problem with the limits that it plans for, and a sentence about the others."""
        left_out = [key for key in self.unknown(problem) if key in problem.limits.others]
        kinds = " and ".join(problem.limits.others[key].name() for key in left_out)
        demands = self.unknown_demands(problem)
        without = problem.without(*left_out, *demands)
        shown = self.tightened(without, [problem.limits.others[key] for key in left_out])
        said = [f"{kinds} limits are left out"] if left_out else []
        if shown is not without:
            said[0] += ", but for the least times of segments that follow from them"
        if "tolerance" in demands:
            said.append("it passes waypoints exactly")
        if self.joins_segments(problem):
            side = "widest" if self.drops else "tightest"
            limits = shown.limits.in_all_segments(tightest=not self.drops)
            shown = replace(shown, limits=limits)
            said.append(f"planned with the {side} limits of all segments everywhere")
        return shown, said

    def tightened(self, problem: Problem, left_out: Sequence[Limit]) -> Problem:
        """Return the problem with what follows from limits that it leaves out; by default nothing.

        Where that is proved, the problem stays a relaxation.
        """
        return problem

    def along(self, problem: Problem, trajectory: Trajectory) -> Solution:
        """Return the fastest timing of a given trajectory's path; by default unsupported."""
        return Solution(Status.UNSUPPORTED, message="it does not time given paths")

    def options(self) -> dict[str, Any]:
        """Return every option with its value, including those of nested dataclasses."""
        return field_values(self)

    def choices(self) -> dict[str, Sequence[str]]:
        """Return the values that a library offers for options, by option; may import the library.

        Raises:
            MissingBackend: The library is not installed.
        """
        return {}

    def defaults(self) -> dict[str, Any]:
        """Return the values of those options that have one by default."""
        return _field_defaults(type(self))

    @property
    def description(self) -> str:
        """Return the first line of its docstring, for `trajopt list`."""
        text = type(self).__doc__ or ""
        return text.strip().partition("\n")[0]


def field_values(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass, including those of nested dataclasses."""
    if not is_dataclass(value):
        return {}
    return _flat({field.name: getattr(value, field.name) for field in fields(value)})


def _field_defaults(kind: Any) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for field in fields(kind) if is_dataclass(kind) else ():
        if field.default_factory is not MISSING:
            table[field.name] = field.default_factory()
        elif field.default is not MISSING:
            table[field.name] = field.default
    return _flat(table)


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    """Replace every dataclass in a table by its fields."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        if is_dataclass(value):
            flat |= field_values(value)
        else:
            flat[name] = value
    return flat


def is_solve(target: object) -> bool:
    """Return whether this is a function whose first argument, the problem, has no default."""
    if not isinstance(target, FunctionType):
        return False
    first = next(iter(inspect.signature(target).parameters.values()), None)
    return first is not None and first.kind in _POSITIONAL and first.default is first.empty


def of_function(function: Callable[..., Solution]) -> Planner:
    """Return a planner that calls a function; its options are the function's keywords.

    A function sets the other members of a planner (`stochastic`, `relation`, …) as attributes.

    Raises:
        InvalidInput: An option has no default, or cannot be seen.
    """
    name = function.__name__
    _check_takes_a_problem(function)
    options = function_options(function)
    takes_seed = "seed" in inspect.signature(function).parameters

    def solve(self: Any, problem: Problem, *, seed: int = 0) -> Solution:
        given = {option: getattr(self, option) for option, _, _ in options}
        if takes_seed:
            given["seed"] = seed
        return function(problem, **given)

    members: dict[str, Any] = {
        "solve": solve,
        "may_be_stochastic": takes_seed and not hasattr(function, "stochastic"),
        "__doc__": function.__doc__,
    }
    for member in _FUNCTION_ATTRIBUTES:
        if hasattr(function, member):
            value = getattr(function, member)
            members[member] = staticmethod(value) if callable(value) else value
    try:
        made = make_dataclass(name, options, bases=(Planner,), namespace=members, frozen=True)
    except ValueError as error:  # a list as a default, which all calls would share
        raise InvalidInput(f"planner {name}", f"other defaults: {error}") from None
    made.__module__ = function.__module__ or "__main__"
    made.__qualname__ = function.__qualname__
    planner: Planner = made()
    return planner


def _check_takes_a_problem(function: Callable[..., Any]) -> None:
    """Refuse a function that minimises, whose first argument is called as a function is."""
    first = next(iter(inspect.signature(function).parameters))
    if first in _OBJECTIVES:
        name = function.__name__
        right = (
            f"{name} = trajopt.optimiser({name}), which makes a planner of a function that "
            f"minimises {first}; a bare function plans: its first argument is a problem"
        )
        raise InvalidInput(f"planner {name}", right)


def function_options(function: Callable[..., Any], given: int = 1) -> list[tuple[str, Any, Any]]:
    """Return name, type and default of each option, which are its keywords.

    Args:
        function: Or a class.
        given: The number of first arguments that are no options.

    Raises:
        InvalidInput: An option has no default, or cannot be seen.
    """
    others = list(inspect.signature(function).parameters.values())[given:]
    try:
        hints = get_type_hints(function)
    except NameError:  # a name that is imported for type checkers only
        hints = {}
    options = []
    for parameter in others:
        if parameter.name == "seed":
            continue
        key = f"planner {function.__name__}, {parameter.name}"
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise InvalidInput(key, "options by their names, without *")
        if parameter.kind is parameter.POSITIONAL_ONLY or parameter.default is parameter.empty:
            raise InvalidInput(key, "a keyword with a default, as every option")
        hint = hints.get(parameter.name, type(parameter.default))
        options.append((parameter.name, hint, parameter.default))
    return options


_OBJECTIVES = ("f", "fn", "fun", "func", "objective", "fitness", "cost")
_POSITIONAL = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
_FUNCTION_ATTRIBUTES = (
    *("stochastic", "on_request", "requires", "knows", "drops", "relation", "unsupported"),
)


def adapted(planner: object) -> Planner:
    """Return the planner itself, or one around a function.

    Raises:
        InvalidInput: The object is neither a planner nor a function.
    """
    if isinstance(planner, Planner):
        return planner
    if is_solve(planner):
        return of_function(cast(Callable[..., Solution], planner))
    if isinstance(planner, type):
        raise InvalidInput("planner", f"an object, {planner.__name__}()", value=planner)
    right = "a planner: an object of a class derived from trajopt.Planner, or a function"
    raise InvalidInput("planner", right, value=type(planner).__name__)


def check_visible(planner: Planner) -> None:
    """Refuse a planner with options that its fields do not show.

    Its trials would be stored under the visible options, so another configuration would get the
    results of the first one. A member of `Planner` with an annotation is refused too, since it
    would be an option.

    Raises:
        InvalidInput: The message has the lines that correct the planner.
    """
    kind = type(planner)
    for name in getattr(kind, "__dataclass_fields__", {}).keys() & Planner.__annotations__.keys():
        right = f"a member, no option: write `{name} = {getattr(planner, name)!r}` without its type"
        raise InvalidInput(f"planner {kind.__name__}: {name}", right)
    if kind.options is not Planner.options:
        return  # it lists them itself
    parameters = getattr(kind, "__dataclass_params__", None)
    if parameters is None:
        raise _unseen(kind, "its options are no fields", sorted(vars(planner)))
    if not parameters.frozen:
        raise _unseen(kind, "its options can change while it runs", [])
    hidden = _hidden(planner)
    if hidden:
        names = ", ".join(hidden)
        raise _unseen(kind, f"{names} cannot be seen", hidden)


def _hidden(value: Any) -> list[str]:
    """Return the attributes of a dataclass, and of nested ones, that are no fields."""
    shown = {field.name for field in fields(value)}
    kind = type(value)
    hidden = []
    for name in sorted(getattr(value, "__dict__", {})):
        is_cached = isinstance(getattr(kind, name, None), cached_property)
        if name not in shown and not is_cached:
            hidden.append(name)
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


def backend(name: str, extra: str = "") -> Any:
    """Import a solver when it is needed; `MissingBackend` names the command that installs it.

    Args:
        name: Of the module.
        extra: Of this package, that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise MissingBackend(package, extra) from error


def raised(error: BaseException) -> str:
    """Name an exception of a planner, and the last line outside of other packages."""
    frames = traceback.extract_tb(error.__traceback__)
    outside = (frame for frame in reversed(frames) if "site-packages" not in frame.filename)
    last = next(outside, frames[-1])
    return f"{type(error).__name__}: {error} ({last.filename}, line {last.lineno})"
