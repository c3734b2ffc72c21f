"""The objective for anybody's search: it counts, keeps the best, and ends the search."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.planners.library_time import outside_library
from trajopt.planners.objective import Fitness, Objective

# Replaces an infinite fitness; its square is still finite.
INFINITE_FITNESS = 1e100


class Spent(BaseException):
    """The budget is spent. Not an `Exception`: a library must not catch it."""


class Late(BaseException):
    """The CPU time is spent."""


class Counted:
    """The objective for a search: it counts evaluations, keeps the best, and ends the search.

    Called with one candidate `(variables,)` it returns its fitness, s, with many `(n, variables)`
    an array `(n,)`.

    Attributes:
        fitness: The objective.
        budget: Number of candidates that may be evaluated.
        spent: Number of candidates evaluated.
        best: The best of them, segment times, s, `(variables,)`.
        value: Its fitness, s.
        rows: Evaluations spent and the best fitness by then, at each improvement.
    """

    def __init__(self, fitness: Objective, budget: int, cpu_limit: float | None) -> None:
        self.fitness = fitness
        self.budget = budget
        self.spent = 0
        self.best = fitness.high
        self.value = np.inf
        self.rows: list[tuple[int, float]] = []
        self.deadline = np.inf if cpu_limit is None else time.process_time() + cpu_limit

    @property
    def low(self) -> Array:
        """Return the lower end of the box, s, `(variables,)`."""
        return self.fitness.low.copy()

    @property
    def high(self) -> Array:
        """Return the upper end of the box, s, `(variables,)`."""
        return self.fitness.high.copy()

    @property
    def variables(self) -> int:
        """Return the number of times."""
        return self.fitness.variables

    @property
    def evaluations(self) -> int:
        """Return the number of candidates evaluated."""
        return self.spent

    @property
    def left(self) -> int:
        """Return the number of candidates that may still be evaluated."""
        return self.budget - self.spent

    def __call__(self, candidates: Any) -> Any:
        """Return the fitness of one candidate, or of many; raises `Spent` after the budget."""
        if np.ndim(candidates) == 2:
            return self.many(candidates)
        return self.one(candidates)

    def one(self, candidate: Any) -> float:
        """Return the fitness of one candidate, whatever its shape."""
        if self.spent >= self.budget:
            raise Spent
        if time.process_time() > self.deadline:
            raise Late
        times = self._times(candidate)
        with outside_library():
            value = min(self.fitness(times), INFINITE_FITNESS)
        self.spent += 1
        if value < self.value:
            self.value = value
            self.rows.append((self.spent, value))
            if value < INFINITE_FITNESS:
                self.best = np.clip(times, self.fitness.low, self.fitness.high)
        return value

    def many(self, candidates: Array) -> Array:
        """Return the fitness of candidates `(n, variables)`, `(n,)`."""
        return np.array([self.one(candidate) for candidate in candidates])

    def history(self) -> Array:
        """Return `Solution.history`: NaN until a candidate keeps the limits."""
        rows = list(self.rows)
        if rows[-1][0] < self.spent:
            rows.append((self.spent, self.value))
        spent, best = np.array(rows).T
        return np.column_stack([spent, np.where(best > self.fitness.ceiling, np.nan, best)])

    def _times(self, candidate: Any) -> Array:
        try:
            times = np.asarray(candidate, dtype=float).reshape(-1)
        except (TypeError, ValueError):
            times = np.empty(0)
        if times.size == self.fitness.variables:
            return times
        return np.full(self.fitness.variables, np.nan)


def compiled(
    problem: Problem, shape: str, fitness: Fitness, lower: float, upper: float
) -> Objective:
    """Return the compiled objective; compiling takes long, so the last ones are kept."""
    key = (problem.digest(), shape, fitness, lower, upper)
    if key not in _KEPT:
        made = Objective(problem, shape, fitness, lower=lower, upper=upper)
        made(made.high)
        if len(_KEPT) == _MAX_KEPT:
            _KEPT.pop(next(iter(_KEPT)))
        _KEPT[key] = made
    return _KEPT[key]


_KEPT: dict[tuple[Any, ...], Objective] = {}
_MAX_KEPT = 8
