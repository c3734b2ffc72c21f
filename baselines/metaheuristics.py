"""Segment times by any optimiser of mealpy, pymoo or nevergrad, to compare the swarms with.

The library calls the fitness that our swarms search, in the same box; what it sees is
`trajopt.planners.objective.Objective`. Its settings are its own defaults, but for the population
where an optimiser has one.

The budget is spent exactly:

- an optimiser is given the whole budget. If it asks for more it is stopped, also in the middle of a
  generation, and the best candidate so far is the answer. mealpy is given as many epochs as there
  are populations in the budget, whatever an epoch of the optimiser costs;
- an optimiser that ends early starts again with another seed until the budget is spent;
- a candidate outside the box is evaluated as the nearest one inside. A candidate that is not a list
  of finite times gets the fitness 1e100 s. Both count as evaluations.

An optimiser that raises, or takes longer than `cpu_limit`, has failed. Its answer says so, with the
number of its evaluations. An optimiser that hangs is stopped by the time limit of the comparison.

    from baselines.metaheuristics import Mealpy
    solution = Mealpy(name="OriginalGWO", evaluations=10_000).solve(problem, seed=1)
"""

from __future__ import annotations

import inspect
import io
import pkgutil
import random
import signal
import threading
import time
import warnings
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput, MissingBackend, nearest
from trajopt.core.limits import LIMIT_NAMES
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners import objective, spline353
from trajopt.planners.counted import Counted, Late, Spent, compiled
from trajopt.planners.library_time import inside_library
from trajopt.planners.objective import CLOSED_FORM, LOWER, UPPER, Fitness
from trajopt.planners.planner import Planner, backend, raised
from trajopt.planners.swarm.optimiser import check_choices, require


@dataclass(frozen=True)
class Metaheuristic(Planner):
    """Segment times by an optimiser of another library.

    - `name`: the library's own, which `trajopt list PLANNER` lists;
    - `population`: where the optimiser has one, and allows this;
    - `iterations`: the budget, in populations beside the first; `evaluations`: in candidates, if
      given;
    - `shape`, `fitness`: those of `trajopt.objective`;
    - `upper`, `lower`: the box, as of `SwarmPlanner`;
    - `cpu_limit`: CPU time after which the search has failed, s; None for no limit.
    """

    name: str = ""
    population: int = 30
    shape: str = CLOSED_FORM
    fitness: Fitness = "penalty"
    iterations: int = 1000
    evaluations: int | None = None
    upper: float = UPPER
    lower: float = LOWER
    cpu_limit: float | None = None

    stochastic = True
    on_request = True
    knows = LIMIT_NAMES

    def __post_init__(self) -> None:
        check_choices(self)
        require("population", self.population, self.population >= 2, "at least 2")
        require("iterations", self.iterations, self.iterations >= 0, "0 or more")
        some = self.evaluations is None or self.evaluations >= 1
        require("evaluations", self.evaluations, some, "at least 1, or None")
        require("upper", self.upper, 0 < self.upper < np.inf, "a finite number above 0")
        require("lower", self.lower, 0 < self.lower < 1, "a number between 0 and 1")
        limited = self.cpu_limit is None or self.cpu_limit > 0
        require("cpu_limit", self.cpu_limit, limited, "above 0, s, or None")
        if self.name != type(self).name:
            self._check_name()

    @staticmethod
    @abstractmethod
    def optimisers() -> Mapping[str, Any]:
        """Return the library's optimisers, by name; raises `MissingBackend` without it."""

    @abstractmethod
    def search(self, counted: Counted, seed: int) -> None:
        """Minimise until the optimiser ends by itself, or `Spent` ends it."""

    def choices(self) -> dict[str, Sequence[str]]:
        return {"name": sorted(self.optimisers())}

    @property
    def budget(self) -> int:
        """Return the largest number of candidates to evaluate."""
        if self.evaluations is not None:
            return self.evaluations
        return self.population * (1 + self.iterations)

    def unsupported(self, problem: Problem) -> str | None:
        if self.shape == CLOSED_FORM:
            return spline353.unsupported(problem)
        return objective.unsupported(problem, self.shape)

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best candidate. `stats`: segment times, s, and number of searches begun."""
        if self.shape == CLOSED_FORM:
            reason = spline353.infeasible(problem)
            if reason is not None:
                return Solution(Status.INFEASIBLE, message=reason)
        started = time.perf_counter()
        fitness = compiled(problem, self.shape, self.fitness, self.lower, self.upper)
        setup_time = time.perf_counter() - started
        counted = Counted(fitness, self.budget, self.cpu_limit)
        begun = 0
        try:
            while counted.left > 0:
                before = counted.spent
                own_seed = int(np.random.SeedSequence([seed, begun]).generate_state(1)[0] >> 1)
                begun += 1
                with _alone(own_seed), _limited(counted.deadline), inside_library():
                    self.search(counted, own_seed)
                if counted.spent == before:
                    return self._failed(counted, "ends without an evaluation")
        except Spent:
            pass
        except Late:
            return self._failed(counted, f"takes more than {self.cpu_limit:g} s of CPU time")
        except MissingBackend:
            raise
        except Exception as error:
            return self._failed(counted, raised(error))
        times = counted.best
        history = counted.history()
        message = ""
        if np.isnan(history[-1, 1]):
            message = "no candidate kept the limits (1 of 1 searches)"
        return Solution(
            Status.SOLVED,
            fitness.trajectory(times),
            message,
            evaluations=counted.spent,
            history=history,
            setup_time=setup_time,
            stats={"segment_times": times, "searches": begun},
        )

    def _failed(self, counted: Counted, why: str) -> Solution:
        message = f"{self.name} {why}, after {counted.spent} of {counted.budget} evaluations"
        return Solution(Status.FAILED, message=message, evaluations=counted.spent)

    def _check_name(self) -> None:
        try:
            known = self.choices()["name"]
        except MissingBackend:
            return  # a missing library is reported by the comparison
        if self.name in known:
            return
        library = self.requires[0]
        close = nearest(self.name, known)
        within = [own for own in known if self.name.lower() in own.lower()]
        suggestion = close or (min(within, key=len) if within and self.name else "")
        right = f"the name of an optimiser of {library}; `trajopt list {library}` lists them"
        if suggestion:
            right = f"the name of an optimiser of {library}; did you mean {suggestion!r}?"
        raise InvalidInput("name", right, value=self.name)


@contextmanager
def _alone(seed: int) -> Iterator[None]:
    """Seed the global random streams and restore them afterwards; suppress warnings and output."""
    of_numpy = np.random.get_state()  # noqa: NPY002  # some optimisers draw from it
    of_python = random.getstate()
    np.random.seed(seed % 2**32)  # noqa: NPY002
    random.seed(seed)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                yield
    finally:
        np.random.set_state(of_numpy)  # noqa: NPY002
        random.setstate(of_python)


@contextmanager
def _limited(deadline: float) -> Iterator[None]:
    """Raise `Late` at this CPU time, s, also in a loop that evaluates nothing.

    Where Python has no such signal (Windows, other threads), `Counted` alone raises it.
    """
    signals = hasattr(signal, "setitimer")
    signals &= threading.current_thread() is threading.main_thread()
    if not np.isfinite(deadline) or not signals:
        yield
        return

    def late(*_: Any) -> None:
        raise Late

    before = signal.signal(signal.SIGPROF, late)
    left = max(deadline - time.process_time(), _SHORTEST_S)
    signal.setitimer(signal.ITIMER_PROF, left, _AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


# CPU time, s, after which `Late` is raised again in a library that caught it.
_AGAIN_S = 1.0
# Zero would switch the timer off.
_SHORTEST_S = 1e-3


@dataclass(frozen=True)
class Mealpy(Metaheuristic):
    """Segment times by any optimiser of mealpy, by its class's name."""

    name: str = "OriginalGWO"
    requires = ("mealpy",)
    extra = "mealpy"

    @staticmethod
    @cache
    def optimisers() -> Mapping[str, Any]:
        found: dict[str, Any] = backend("mealpy", "mealpy").get_all_optimizers(verbose=False)
        return found

    def search(self, counted: Counted, seed: int) -> None:
        epochs = -(-counted.budget // self.population)  # rounded up
        kind = self.optimisers()[self.name]
        try:
            optimiser = kind(epoch=epochs, pop_size=self.population)
        except ValueError:  # the optimiser does not allow this population: its own default
            optimiser = kind(epoch=epochs)
        box = counted.fitness
        bounds = backend("mealpy", "mealpy").FloatVar(lb=box.low.tolist(), ub=box.high.tolist())
        task = {"obj_func": counted.one, "bounds": bounds, "minmax": "min", "log_to": None}
        optimiser.solve(task, seed=seed)


@dataclass(frozen=True)
class Pymoo(Metaheuristic):
    """Segment times by any single-objective optimiser of pymoo, by its class's name."""

    name: str = "PSO"
    requires = ("pymoo",)
    extra = "pymoo"

    @staticmethod
    @cache
    def optimisers() -> Mapping[str, Any]:
        """Return the optimisers for one objective whose own packages are installed.

        `BGA` is not among them: its variables are bits, so it tries only segment times of 0 and 1.
        """
        backend("pymoo", "pymoo")
        kind = import_module("pymoo.core.algorithm").Algorithm
        folder = import_module("pymoo.algorithms.soo.nonconvex")
        bits = import_module("pymoo.operators.sampling.rnd").BinaryRandomSampling
        found: dict[str, Any] = {}
        for module in pkgutil.iter_modules(folder.__path__, f"{folder.__name__}."):
            try:
                members = vars(import_module(module.name))
            except Exception:  # pymoo raises no `ImportError` where a package of its own is missing
                continue
            for name, member in members.items():
                own = isinstance(member, type) and issubclass(member, kind)
                if not own or member.__module__ != module.name or inspect.isabstract(member):
                    continue
                sampling = inspect.signature(member).parameters.get("sampling")
                if sampling is None or not isinstance(sampling.default, bits):
                    found[name] = member
        return found

    def search(self, counted: Counted, seed: int) -> None:
        kind = self.optimisers()[self.name]
        settings = {}
        if "pop_size" in inspect.signature(kind).parameters:
            settings["pop_size"] = self.population
        import_module("pymoo.optimize").minimize(
            _pymoo_problem(counted),
            kind(**settings),
            ("n_eval", counted.budget),
            seed=seed,
            copy_algorithm=False,
        )


def _pymoo_problem(counted: Counted) -> Any:
    base = import_module("pymoo.core.problem").Problem

    class CountedProblem(base):  # type: ignore[misc, valid-type]
        def _evaluate(self, x: Array, out: dict[str, Array], *_: Any, **__: Any) -> None:
            out["F"] = counted.many(x)[:, None]

    box = counted.fitness
    return CountedProblem(n_var=box.variables, n_obj=1, xl=box.low, xu=box.high)


@dataclass(frozen=True)
class Nevergrad(Metaheuristic):
    """Segment times by any optimiser of nevergrad's registry, by its name there."""

    name: str = "CMA"
    requires = ("nevergrad",)
    extra = "nevergrad"

    @staticmethod
    @cache
    def optimisers() -> Mapping[str, Any]:
        registry = backend("nevergrad", "nevergrad").optimizers.registry
        return {name.strip(): made for name, made in registry.items()}  # one ends with a space

    def search(self, counted: Counted, seed: int) -> None:
        ng = backend("nevergrad", "nevergrad")
        box = counted.fitness
        times = ng.p.Array(init=(box.low + box.high) / 2, lower=box.low, upper=box.high)
        times.random_state = np.random.RandomState(seed % 2**32)  # it needs this
        made = self.optimisers()[self.name]
        optimiser = self._sized(made)(times, budget=counted.budget, num_workers=1)
        while counted.left > 0:
            try:
                asked = optimiser.ask()
            except ng.errors.NevergradEarlyStopping:
                return
            optimiser.tell(asked, counted.one(asked.value))

    def _sized(self, made: Any) -> Any:
        """Return the optimiser with this population size, where it has one."""
        if isinstance(made, type) or "popsize" not in inspect.signature(type(made)).parameters:
            return made
        return type(made)(**{**made._config, "popsize": self.population})
