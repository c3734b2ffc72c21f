"""How many starts are tried: as many as asked for, fewer that agree, more while all fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from baselines.several_starts import no_start_succeeded, optima_together


@dataclass(frozen=True)
class Ended:
    duration: float


@pytest.mark.parametrize(
    ("durations", "solved"),
    [
        ([1.0, 2.0, 3.0, 4.0], 3),  # as many as asked for
        ([np.inf, 2.0, 3.0, 4.0], 3),
        ([np.inf, np.inf, np.inf, 4.0, 5.0], 4),  # more while none has succeeded
        ([np.inf, np.inf, np.inf, np.inf], 4),
        ([2.0, 2.0 + 1e-9, 1.0], 2),  # two agree
        ([2.0, 2.0 + 1e-8, 1.0, 1.0], 3),
        ([2.0, 1.0, 2.0, 1.0], 3),  # on the best so far, not on another
    ],
)
def test_several_starts_and_more_while_all_fail(durations: list[float], solved: int) -> None:
    batches = []

    def solve(starts: Sequence[float]) -> list[Ended]:
        batches.append(len(starts))
        return [Ended(duration) for duration in starts]

    assert len(optima_together(solve, durations, count=3, agreeing=2)) == solved
    assert batches[0] == 2


def test_the_message_names_every_status_once() -> None:
    message = no_start_succeeded(["Infeasible", "Diverged", "Infeasible"])
    assert message == "no start succeeded: Diverged, Infeasible"


def test_what_agrees_is_the_callers_to_say() -> None:
    durations = [2.0, 2.0 + 1e-6, 2.0]

    def solve(starts: Sequence[float]) -> list[Ended]:
        return [Ended(duration) for duration in starts]

    assert len(optima_together(solve, durations, count=3, agreeing=2)) == 3
    assert len(optima_together(solve, durations, count=3, agreeing=2, rtol=1e-5)) == 2
