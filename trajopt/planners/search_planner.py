"""An optimiser of numbers as a planner: it searches the segment times of a spline.

def firefly(f, seed):
    rng = np.random.default_rng(seed)
    while f.left:
        f(rng.uniform(f.low, f.high))          # counted, and the best is kept

compare(["six-axis"], [trajopt.optimiser(firefly), "pso"])
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, make_dataclass
from typing import Any

import numpy as np

from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import LIMIT_NAMES
from trajopt.core.problem import Problem
from trajopt.core.renamed import of_other_tools
from trajopt.core.solution import Solution, Status
from trajopt.planners import objective
from trajopt.planners.counted import Counted, Spent, compiled
from trajopt.planners.library_time import inside_library
from trajopt.planners.objective import CLOSED_FORM, LOWER, UPPER, Fitness
from trajopt.planners.planner import Planner, function_options
from trajopt.planners.swarm.optimiser import check_choices, require

EVALUATIONS = 30_030
"""Those of the swarms by default: 30 candidates, and 1000 iterations of 30 more."""


@dataclass(frozen=True)
class SearchPlanner(Planner):
    """Segment times by a search that someone else wrote.

    - `evaluations`: the budget in candidates; the search ends with it;
    - `shape`, `fitness`: those of `trajopt.objective`.
    """

    evaluations: int = EVALUATIONS
    shape: str = CLOSED_FORM
    fitness: Fitness = "penalty"

    stochastic = True
    knows = LIMIT_NAMES

    def __post_init__(self) -> None:
        check_choices(self)
        require("evaluations", self.evaluations, self.evaluations >= 1, "at least 1")

    @staticmethod
    def search(counted: Counted, seed: int, options: Mapping[str, Any]) -> Any:
        """Minimise; return a candidate, or None for the best that was evaluated."""
        raise NotImplementedError

    def unsupported(self, problem: Problem) -> str | None:
        return objective.unsupported(problem, self.shape)

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best candidate that was evaluated. `stats`: its segment times, s."""
        fitness = compiled(problem, self.shape, self.fitness, LOWER, UPPER)
        counted = Counted(fitness, self.evaluations, None)
        known = {"evaluations", "shape", "fitness"}
        own = {name: value for name, value in self.options().items() if name not in known}
        try:
            with inside_library():
                found = self.search(counted, seed, own)
            if found is not None and counted.left:
                counted.one(found)
        except Spent:
            pass
        if not counted.spent:
            return Solution(Status.FAILED, message="it evaluates no candidate", evaluations=0)
        history = counted.history()
        kept = np.isfinite(history[-1, 1])
        return Solution(
            Status.SOLVED,
            fitness.trajectory(counted.best),
            "" if kept else "no candidate kept the limits",
            evaluations=counted.spent,
            history=history,
            stats={"segment_times": counted.best},
        )


def optimiser(
    search: Callable[..., Any],
    *,
    evaluations: int = EVALUATIONS,
    shape: str = CLOSED_FORM,
    fitness: Fitness = "penalty",
    **others: Any,
) -> Planner:
    """Return a planner that searches the segment times of a spline with an optimiser.

    Args:
        search: A function `(f)` or `(f, seed)` that minimises `f` and returns the best times
            `(variables,)`, or None: then it is the best that `f` was asked for. `f` is called with
            one candidate, or with many `(n, variables)`; it has `low`, `high`, `variables` and
            `left`, the number of candidates that may still be evaluated, and counts by itself. Or a
            class `(low, high)` or `(low, high, seed)` with the methods `ask()`, which returns
            candidates, and `tell(candidates, values)`. Further keywords with defaults are options.
        evaluations: The budget in candidates; by default that of the swarms.
        shape: The degrees of the spline's pieces, as of `trajopt.objective`.
        fitness: `penalty` or `scaled`, as of `trajopt.objective`.
        others: None; a word of other tools is answered with ours.

    Returns:
        A planner for `trajopt.compare`; in a file, for the option `--planner`.

    Raises:
        InvalidInput: `search` is neither, or an option has no default.
    """
    if others:
        raise InvalidInput(*_other_word(next(iter(others))), value=next(iter(others.values())))
    asks = inspect.isclass(search)
    if not callable(search) or (asks and not (hasattr(search, "ask") and hasattr(search, "tell"))):
        right = "a function (f, seed), or a class (low, high, seed) with ask() and tell()"
        raise InvalidInput("optimiser", right, value=search)
    given = 2 if asks else 1
    takes_seed = "seed" in inspect.signature(search).parameters
    own = function_options(search, given)
    budget = [("evaluations", int, evaluations), ("shape", str, str(shape))]
    fields = [*budget, ("fitness", Fitness, fitness), *own]

    def run(counted: Counted, seed: int, options: Mapping[str, Any]) -> Any:
        seeded = {"seed": seed} if takes_seed else {}
        if not asks:
            return search(counted, **seeded, **options)
        swarm: Any = search(counted.low, counted.high, **seeded, **options)
        while counted.left:
            candidates = np.atleast_2d(np.asarray(swarm.ask(), dtype=float))
            if not candidates.size:
                return None
            swarm.tell(candidates, counted.many(candidates))
        return None

    name = getattr(search, "__name__", type(search).__name__)
    members = {"search": staticmethod(run), "stochastic": takes_seed, "__doc__": search.__doc__}
    made = make_dataclass(name, fields, bases=(SearchPlanner,), namespace=members, frozen=True)
    made.__module__ = getattr(search, "__module__", None) or "__main__"
    made.__qualname__ = getattr(search, "__qualname__", name)
    planner: Planner = made()
    return planner


def _other_word(name: str) -> tuple[str, str]:
    """Return the key and what would be right for an option of another tool."""
    ours = of_other_tools(name)
    if ours == "evaluations":
        return name, "evaluations=…, the number of candidates"
    return name, "a keyword of the search, with its default"
