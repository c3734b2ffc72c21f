"""The loop that every swarm shares: ask for candidates, tell their fitness, count, remember.

Independent runs advance together, and no run can tell: each has its own random streams, drawn in
shapes that depend on nothing but the options, and nothing is summed across the batch. So a run
gives the same bits alone, among others, and in another process.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np
from numpy.random import PCG64, SeedSequence
from numpy.typing import ArrayLike, NDArray

from trajopt.exceptions import InvalidInput

Array = NDArray[np.float64]
Objective = Callable[[Array], Array]
Search = Generator[Array, Array, None]


@dataclass(frozen=True)
class Optimiser(ABC):
    """A swarm algorithm; its fields are its options. Raises `InvalidInput` for bad ones."""

    population: int = 30

    def __post_init__(self) -> None:
        check_choices(self)
        require("population", self.population, self.population >= 2, "at least 2")

    @property
    @abstractmethod
    def evaluations_per_iteration(self) -> int:
        """Candidates evaluated per iteration; the first population comes on top, once."""

    @abstractmethod
    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        """Yield candidates `(runs, m, dim)` and be sent their fitness `(runs, m)`.

        First the initial population, then `evaluations_per_iteration` candidates in any number of
        batches, `iterations` times. `minimise` may stop asking at any point.
        """


@dataclass(frozen=True, eq=False)
class Box:
    """The space searched: `low` and `high` `(runs, 1, dim)`."""

    low: Array
    high: Array

    @classmethod
    def of(cls, low: ArrayLike, high: ArrayLike, runs: int) -> Box:
        """From bounds `(dim,)`, or `(runs, dim)` where each run has its own."""
        bottom, top = (np.atleast_1d(np.asarray(side, dtype=float)) for side in (low, high))
        dim = np.broadcast_shapes(bottom.shape, top.shape)[-1]
        bottom, top = (np.broadcast_to(side, (runs, dim)) for side in (bottom, top))
        require("bounds", [low, high], bool((bottom < top).all()), "low < high")
        return cls(bottom[:, None], top[:, None])

    @property
    def size(self) -> Array:
        return self.high - self.low

    def spread(self, unit: Array) -> Array:
        """Points of the unit cube `(runs, m, dim)`, moved linearly to this box."""
        return self.clip(self.low + unit * self.size)

    def clip(self, x: Array) -> Array:
        """Points outside, moved to the wall."""
        return np.minimum(np.maximum(x, self.low), self.high)

    def reflect(self, x: Array) -> Array:
        """Points outside, mirrored at the walls as often as it takes; infinite ones become NaN."""
        with np.errstate(invalid="ignore"):
            beyond = np.mod(x - self.low, 2 * self.size)
        return self.clip(self.low + self.size - np.abs(self.size - beyond))


class Streams:
    """One random stream per run; every draw has the runs as its first axis."""

    def __init__(self, seeds: Sequence[int | SeedSequence]) -> None:
        self._seeds = [s if isinstance(s, SeedSequence) else SeedSequence(s) for s in seeds]
        self._generators = [np.random.Generator(PCG64(s)) for s in self._seeds]

    def __len__(self) -> int:
        return len(self._seeds)

    def beside(self) -> Streams:
        """Streams of their own for the same runs: drawing from them leaves these as they are."""
        return Streams([SeedSequence(s.entropy, spawn_key=(*s.spawn_key, 0)) for s in self._seeds])

    def uniform(self, *shape: int) -> Array:
        """Uniform on `[0, 1)`, `(runs, *shape)`."""
        return np.stack([g.random(shape) for g in self._generators])

    def normal(self, *shape: int) -> Array:
        """Standard normal, `(runs, *shape)`."""
        return np.stack([g.standard_normal(shape) for g in self._generators])


@dataclass(frozen=True, eq=False)
class Result:
    """What a search found.

    - `position` `(runs, dim)` and `fitness` `(runs,)`: the best candidate of each run;
    - `evaluations`: candidates evaluated in each run (the same number in all);
    - `iterations`: iterations begun;
    - `histories`: per run `(points, 2)`, evaluations spent and best fitness by then, one row per
      improvement and one for the end.
    """

    position: Array
    fitness: Array
    evaluations: int
    iterations: int
    histories: tuple[Array, ...]


def minimise(
    optimiser: Optimiser,
    objective: Objective,
    low: ArrayLike,
    high: ArrayLike,
    seeds: Sequence[int | SeedSequence],
    *,
    iterations: int = 1000,
    evaluations: int | None = None,
) -> Result:
    """Minimise over a box, one independent run per seed.

    `objective` takes `(runs, m, dim)` and returns `(runs, m)`, finite. `low` and `high` are
    `(dim,)`, or `(runs, dim)` where each run has its own box. The budget is a number of iterations,
    or, if given, of evaluations per run, which is spent exactly: the last batch is cut to its first
    candidates, and formulas that depend on the number of iterations use the number begun.

    Raises `InvalidInput` for an empty box or budget.
    """
    require("seeds", list(seeds), len(seeds) > 0, "at least one")
    require("iterations", iterations, iterations >= 0, "0 or more")
    first, each = optimiser.population, optimiser.evaluations_per_iteration
    budget = first + iterations * each if evaluations is None else evaluations
    require("evaluations", budget, budget >= 1, "at least 1")
    begun = max(0, -(-(budget - first) // each))
    search = optimiser.search(Box.of(low, high, len(seeds)), Streams(seeds), begun)
    tally, candidates = _Tally(len(seeds)), next(search)
    while True:
        candidates = candidates[:, : budget - tally.spent]
        fitness = objective(candidates)
        tally.add(candidates, fitness)
        if tally.spent == budget:
            return Result(tally.position, tally.fitness, budget, begun, tally.histories())
        candidates = search.send(fitness)


class _Tally:
    """Counts evaluations and remembers the best of each run, and when it improved."""

    def __init__(self, runs: int) -> None:
        self.spent = 0
        self.fitness = np.full(runs, np.inf)
        self.position: Array = np.empty(0)
        self._rows = np.arange(runs)
        self._log: list[tuple[NDArray[np.intp], NDArray[np.intp], Array]] = []

    def add(self, candidates: Array, fitness: Array) -> None:
        if self.spent == 0:
            self.position = candidates[:, 0].copy()
        winner = fitness.argmin(axis=1)
        better = fitness[self._rows, winner] < self.fitness
        if better.any():
            self._remember(fitness)
            self.position[better] = candidates[self._rows, winner][better]
            self.fitness[better] = fitness[self._rows, winner][better]
        self.spent += fitness.shape[1]

    def _remember(self, fitness: Array) -> None:
        lowest = np.minimum.accumulate(np.column_stack([self.fitness, fitness]), axis=1)
        run, column = np.nonzero(lowest[:, 1:] < lowest[:, :-1])
        self._log.append((run, self.spent + column + 1, fitness[run, column]))

    def histories(self) -> tuple[Array, ...]:
        run, spent, best = (np.concatenate(column) for column in zip(*self._log, strict=True))
        points = np.column_stack([spent, best])
        return tuple(self._ended(points[run == row], int(row)) for row in self._rows)

    def _ended(self, points: Array, row: int) -> Array:
        end = np.array([[self.spent, self.fitness[row]]])
        return points if points[-1, 0] == self.spent else np.concatenate([points, end])


def added(values: Array) -> Array:
    """The sum over the last axis, always in the same order: `np.sum`'s depends on the layout."""
    return reduce(np.add, np.moveaxis(values, -1, 0))


def require(option: str, value: object, holds: bool, expected: str) -> None:
    """Raise `InvalidInput` naming the option, its value and what would be right."""
    if not holds:
        raise InvalidInput(option, expected, value=value)


def check_choices(options: object) -> None:
    """Raise `InvalidInput` where a `Literal` field of a dataclass holds something else."""
    for name, hint in get_type_hints(type(options)).items():
        if get_origin(hint) is Literal:
            known = " or ".join(repr(a) for a in get_args(hint))
            require(name, getattr(options, name), getattr(options, name) in get_args(hint), known)
