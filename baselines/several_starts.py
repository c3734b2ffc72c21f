"""Local optima from several initial guesses: how many are tried, and the message if all fail."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from typing import Protocol, TypeVar

import numpy as np

# Durations of local optima that differ by no more than this, relative, are one optimum.
AGREEMENT_RTOL = 1e-9


class Timed(Protocol):
    """The result of one initial guess."""

    @property
    def duration(self) -> float:
        """Return the duration, s; infinite where there is no answer."""


Start = TypeVar("Start")
TimedT = TypeVar("TimedT", bound=Timed)


def optima_together(
    solve: Callable[[Sequence[Start]], Sequence[TimedT]],
    starts: Iterable[Start],
    count: int,
    agreeing: int,
    rtol: float = AGREEMENT_RTOL,
    begun: Sequence[TimedT] = (),
) -> list[TimedT]:
    """Return the local optima of several initial guesses.

    `count` guesses are tried; fewer if enough of them agree, more while all fail.

    Args:
        solve: returns the local optimum of each guess of a batch. A batch has as many guesses as
            are missing for agreement.
        starts: the initial guesses, in the order in which they are tried.
        count: largest number of guesses, unless all of them fail.
        agreeing: stop when this many guesses share the shortest duration.
        rtol: durations that differ by less, relative, count as equal.
        begun: the local optima of the first guesses, where they are known already.

    Returns:
        The optima in the order of their guesses.
    """
    results = [*begun]
    remaining = iter(starts)
    while True:
        wanted = still_wanted(results, count, agreeing, rtol)
        if wanted <= 0:
            return results
        batch = list(islice(remaining, wanted))
        if not batch:
            return results
        results += solve(batch)


def still_wanted(
    results: Sequence[Timed], count: int, agreeing: int, rtol: float = AGREEMENT_RTOL
) -> int:
    """Return how many more initial guesses are to be tried; see `optima_together`."""
    durations = np.array([result.duration for result in results])
    shortest = durations.min(initial=np.inf)
    agreed = 0
    if shortest < np.inf:
        agreed = int((durations <= shortest * (1 + rtol)).sum())
    untried = count - len(results)
    return min(agreeing - agreed, untried if agreed > 0 else max(untried, 1))


def no_start_succeeded(statuses: Iterable[str]) -> str:
    """Return the message of a planner whose initial guesses have all failed."""
    different = sorted(set(statuses))
    return f"no start succeeded: {', '.join(different)}"
