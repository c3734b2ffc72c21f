"""Local optima from several starts: how many a planner tries, what it says if all fail."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from typing import Protocol, TypeVar

import numpy as np

# Durations of local optima that differ by no more than this, relative, are one optimum.
AGREEMENT_RTOL = 1e-9


class Timed(Protocol):
    """What one start led to."""

    @property
    def duration(self) -> float:
        """Infinite where there is no answer."""


Start = TypeVar("Start")
TimedT = TypeVar("TimedT", bound=Timed)


def optima_together(
    solve: Callable[[Sequence[Start]], Sequence[TimedT]],
    starts: Iterable[Start],
    count: int,
    agreeing: int,
    rtol: float = AGREEMENT_RTOL,
) -> list[TimedT]:
    """Local optima: of `count` starts, of fewer that agree, of more while none has succeeded.

    Args:
        solve: leads from some starts to a local optimum each: from as many as are missing for
            agreement.
        starts: where to start from, in order.
        count: no more starts than these, unless all of them fail.
        agreeing: no more starts once so many share the shortest duration.
        rtol: what durations may differ by and count as one, relative.

    Returns:
        The optima in the order of their starts.
    """
    results: list[TimedT] = []
    remaining = iter(starts)
    while True:
        durations = np.array([result.duration for result in results])
        shortest = durations.min(initial=np.inf)
        as_short = durations <= shortest * (1 + rtol)
        agreed = 0
        if shortest < np.inf:
            agreed = int(as_short.sum())
        missing = agreeing - agreed
        untried = count - len(results)
        if agreed > 0 and min(missing, untried) <= 0:
            return results
        wanted = min(missing, max(untried, 1))
        batch = list(islice(remaining, wanted))
        if not batch:
            return results
        results += solve(batch)


def no_start_succeeded(statuses: Iterable[str]) -> str:
    """The message of a planner whose starts have all failed."""
    different = sorted(set(statuses))
    return f"no start succeeded: {', '.join(different)}"
