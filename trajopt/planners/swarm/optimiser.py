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
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array, Indices
from trajopt.core.exceptions import InvalidInput

if TYPE_CHECKING:
    from numpy.random import SeedSequence

Objective = Callable[[Array], Array]


class Contest(NamedTuple):
    """Candidates `x` `(runs, m, dim)`, each compared with its `incumbent` `(runs, m)` and no more.

    A candidate is taken if its fitness is below its incumbent. No incumbent is below the best
    fitness of its run so far.
    """

    x: Array
    incumbent: Array


Search = Generator[Array | Contest, Array, None]


@dataclass(frozen=True)
class Compared:
    """An objective that is told the incumbents of a `Contest` beside its candidates, else None.

    A fitness below its incumbent must be exact. In place of any other it may return whatever is not
    below its incumbent: no search can tell.
    """

    fitness: Callable[[Array, Array | None], Array]


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
        """Yield candidates `(runs, m, dim)`, or a `Contest`, and be sent their fitness `(runs, m)`.

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
        """Build the box from bounds `(dim,)`, or `(runs, dim)` where each run has its own."""
        bottom = np.atleast_1d(np.asarray(low, dtype=float))
        top = np.atleast_1d(np.asarray(high, dtype=float))
        dim = np.broadcast_shapes(bottom.shape, top.shape)[-1]
        bottom = np.broadcast_to(bottom, (runs, dim))
        top = np.broadcast_to(top, (runs, dim))
        ordered = bottom < top
        require("bounds", [low, high], bool(ordered.all()), "low < high")
        return cls(low=bottom[:, None], high=top[:, None])

    @property
    def dim(self) -> int:
        return int(self.low.shape[-1])

    @property
    def size(self) -> Array:
        return self.high - self.low

    def spread(self, unit: Array) -> Array:
        """Map points of the unit cube `(runs, m, dim)` linearly to this box."""
        x = self.low + unit * self.size
        return self.clip(x)

    def clip(self, x: Array) -> Array:
        """Move points outside to the bound that they pass."""
        above = np.maximum(x, self.low)
        return np.minimum(above, self.high)

    def reflect(self, x: Array) -> Array:
        """Mirror points outside at the bounds until they are inside; infinite ones become NaN."""
        there_and_back = 2 * self.size
        with np.errstate(invalid="ignore"):
            travelled = np.mod(x - self.low, there_and_back)
        from_wall = np.abs(self.size - travelled)
        mirrored = self.low + self.size - from_wall
        return self.clip(mirrored)


class Streams:
    """One random stream per run; every draw has the runs as its first axis."""

    def __init__(self, seeds: Sequence[int | SeedSequence]) -> None:
        self._seeds = [_sequence(seed) for seed in seeds]
        self._generators = [np.random.Generator(np.random.PCG64(seed)) for seed in self._seeds]

    def __len__(self) -> int:
        return len(self._seeds)

    def beside(self) -> Streams:
        """Streams of their own for the same runs: drawing from them leaves these as they are."""
        children = []
        for seed in self._seeds:
            key = (*seed.spawn_key, 0)
            children.append(np.random.SeedSequence(seed.entropy, spawn_key=key))
        return Streams(children)

    def uniform(self, *shape: int) -> Array:
        """Uniform on `[0, 1)`, `(runs, *shape)`."""
        draws = np.empty((len(self), *shape))
        for generator, own in zip(self._generators, draws, strict=True):
            generator.random(out=own)
        return draws

    def normal(self, *shape: int) -> Array:
        """Standard normal, `(runs, *shape)`."""
        draws = np.empty((len(self), *shape))
        for generator, own in zip(self._generators, draws, strict=True):
            generator.standard_normal(out=own)
        return draws


def _sequence(seed: int | SeedSequence) -> SeedSequence:
    if isinstance(seed, np.random.SeedSequence):
        return seed
    return np.random.SeedSequence(seed)


@dataclass(frozen=True, eq=False)
class Result:
    """The best of each run of a search.

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
    objective: Objective | Compared,
    low: ArrayLike,
    high: ArrayLike,
    seeds: Sequence[int | SeedSequence],
    *,
    iterations: int = 1000,
    evaluations: int | None = None,
) -> Result:
    """Minimise over a box, one independent run per seed.

    Args:
        optimiser: the swarm algorithm with its options.
        objective: takes candidates `(runs, m, dim)` and returns their fitness `(runs, m)`, finite;
            as `Compared` it need not be exact above the incumbent.
        low, high: the box, `(dim,)`, or `(runs, dim)` where each run has its own.
        seeds: one per run.
        iterations: the budget, where `evaluations` is not given.
        evaluations: the budget of each run, spent exactly: the last batch is cut to its first
            candidates, and formulas that depend on the number of iterations use the number begun.

    Raises:
        InvalidInput: an empty box or budget.
    """
    runs = len(seeds)
    require("seeds", list(seeds), runs > 0, "at least one")
    require("iterations", iterations, iterations >= 0, "0 or more")
    first = optimiser.population
    each = optimiser.evaluations_per_iteration
    budget = evaluations
    if budget is None:
        budget = first + iterations * each
    require("evaluations", budget, budget >= 1, "at least 1")
    remaining = max(0, budget - first)
    begun = -(-remaining // each)  # rounded up
    box = Box.of(low, high, runs)
    search = optimiser.search(box, Streams(seeds), begun)
    tally = _Tally(runs)
    asked = next(search)
    while True:
        left = budget - tally.spent
        incumbent = None
        if isinstance(asked, Contest):
            candidates = asked.x[:, :left]
            incumbent = asked.incumbent[:, :left]
        else:
            candidates = asked[:, :left]
        if isinstance(objective, Compared):
            fitness = objective.fitness(candidates, incumbent)
        else:
            fitness = objective(candidates)
        tally.add(candidates, fitness)
        if tally.spent == budget:
            return Result(
                tally.position,
                tally.fitness,
                evaluations=budget,
                iterations=begun,
                histories=tally.histories(),
            )
        asked = search.send(fitness)


class _Tally:
    """Counts evaluations and remembers the best of each run, and when it improved."""

    def __init__(self, runs: int) -> None:
        self.spent = 0
        self.fitness = np.full(runs, np.inf)
        self.position: Array = np.empty(0)
        self._rows = np.arange(runs)
        self._log: list[tuple[Indices, Indices, Array]] = []

    def add(self, candidates: Array, fitness: Array) -> None:
        if self.spent == 0:
            self.position = candidates[:, 0].copy()
        winner = fitness.argmin(axis=1)
        lowest = fitness[self._rows, winner]
        better = lowest < self.fitness
        if better.any():
            self._remember(fitness)
            best = candidates[self._rows, winner]
            self.position[better] = best[better]
            self.fitness[better] = lowest[better]
        self.spent += fitness.shape[1]

    def _remember(self, fitness: Array) -> None:
        """Log every candidate that improved on all before it."""
        so_far = np.column_stack([self.fitness, fitness])
        lowest = np.minimum.accumulate(so_far, axis=1)
        before = lowest[:, :-1]
        after = lowest[:, 1:]
        run, column = np.nonzero(after < before)
        spent = self.spent + column + 1
        best = fitness[run, column]
        self._log.append((run, spent, best))

    def histories(self) -> tuple[Array, ...]:
        parts = zip(*self._log, strict=True)
        run, spent, best = map(np.concatenate, parts)
        points = np.column_stack([spent, best])
        histories = []
        for row in self._rows:
            own = points[run == row]
            histories.append(self._ended(own, int(row)))
        return tuple(histories)

    def _ended(self, points: Array, row: int) -> Array:
        """A run's improvements, and its end unless it ended with one."""
        if points[-1, 0] == self.spent:
            return points
        end = np.array([self.spent, self.fitness[row]])
        return np.concatenate([points, end[None]])


def added(values: Array) -> Array:
    """The sum over the last axis, always in the same order: `np.sum`'s depends on the layout."""
    columns = [values[..., i] for i in range(values.shape[-1])]
    return reduce(np.add, columns)


def require(option: str, value: object, holds: bool, expected: str) -> None:
    """Raise `InvalidInput` naming the option, its value and what would be right."""
    if not holds:
        raise InvalidInput(option, expected, value=value)


def require_size(options: object, name: str) -> None:
    """Raise `InvalidInput` unless an option is a finite number, 0 or more."""
    value = getattr(options, name)
    require(name, value, 0 <= value < np.inf, "a finite number, 0 or more")


def check_choices(options: object) -> None:
    """Raise `InvalidInput` where a `Literal` field of a dataclass holds something else."""
    for name, hint in get_type_hints(type(options)).items():
        if get_origin(hint) is not Literal:
            continue
        value = getattr(options, name)
        choices = get_args(hint)
        known = " or ".join(map(repr, choices))
        require(name, value, value in choices, known)
