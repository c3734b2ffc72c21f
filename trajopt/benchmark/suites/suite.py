"""What a suite is: problems that belong together, each with a name."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from numpy.typing import ArrayLike

from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem


def _unnamed(name: str) -> Problem | None:
    return None


@dataclass(frozen=True)
class Suite:
    """Problems that belong together; `stream` yields the same ones at each call.

    Where `stream` has no end, `size` is the default number of problems. `named` returns the
    problem of a name, or None; of problems that are files the catalogue finds the names. Problems
    that are not `recorded` have no best known motion and bound in the repository.
    """

    name: str
    description: str
    version: int
    stream: Callable[[], Iterator[Problem]]
    named: Callable[[str], Problem | None] = _unnamed
    size: int | None = None
    recorded: bool = True

    def problems(self, size: int | None = None) -> list[Problem]:
        """Return the first `size` problems, or all if there are fewer."""
        if size is not None and size < 1:
            raise InvalidInput("size", "1 or more", value=size)
        return list(itertools.islice(self.stream(), size or self.size))


def source(suite: str, words: str) -> str:
    """Return where a problem of a suite comes from, as its file says it."""
    return f"trajopt.benchmark.suites.{suite}, {words}"


def closed_forms(
    suite: str, rows: Mapping[str, tuple[ArrayLike, Limits, Mapping[str, Any]]]
) -> dict[str, Callable[[], Problem]]:
    """Return what makes the problem of each key: of waypoints, limits and demands."""

    def made(key: str) -> Problem:
        waypoints, limits, demands = rows[key]
        name, where = f"{suite}-{key}", source(suite, "closed form")
        return Problem(waypoints, limits, name, where, demands=demands)

    return {key: partial(made, key) for key in rows}


def made_and_drawn(
    name: str,
    description: str,
    version: int,
    made: Mapping[str, Callable[[], Problem]],
    draw: Callable[[int], Problem],
    number_drawn: int,
) -> Suite:
    """Return a suite of problems made by hand, `NAME-KEY`, then of drawn ones, without end.

    Args:
        name: Of the suite.
        description: One line.
        version: Of the suite's problems.
        made: Makes the problem of each key.
        draw: Draws a problem, `NAME-random-INDEX`, by its index.
        number_drawn: How many drawn problems the suite has by default.
    """
    index_in = re.compile(rf"{name}-random-(\d{{2,18}})")

    def stream() -> Iterator[Problem]:
        for make in made.values():
            yield make()
        yield from map(draw, itertools.count())

    def named(wanted: str) -> Problem | None:
        match = index_in.fullmatch(wanted)
        if match is not None:
            problem = draw(int(match[1]))
            return problem if problem.name == wanted else None
        make = made.get(wanted.removeprefix(f"{name}-"))
        return make() if make is not None and wanted.startswith(f"{name}-") else None

    return Suite(name, description, version, stream, named, size=len(made) + number_drawn)
