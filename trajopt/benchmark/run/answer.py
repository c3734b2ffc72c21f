"""What crosses from the process that runs a planner to the one that judges it: plain data.

A text in JSON, in the terms of a trial's text. Reading it runs no code of whoever wrote it, as a
pickle would; `unpacked` checks it like any file of a stranger.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import inf
from typing import Any

from trajopt.benchmark.store.document import packed_solution, solution_of
from trajopt.benchmark.trial import Answers, crash
from trajopt.core.solution import Solution
from trajopt.planners.planner import Relation

LARGEST = 2**26  # bytes of one message: far more than any answer has


class TooLarge(ValueError):
    """An answer that no message holds."""

    def __init__(self) -> None:
        super().__init__(f"its answer is larger than {LARGEST >> 20} MiB")


def packed(answers: Answers) -> bytes:
    """The answers as a message; one that cannot be said in plain data is a crash that says why."""
    table = {
        "solutions": [_packed(solution) for solution in answers.solutions],
        "relation": answers.relation.name,
        "loading_time": answers.loading_time,
        "wall_time": answers.wall_time,
    }
    message = json.dumps(table).encode()
    if len(message) > LARGEST:
        lost = crash(str(TooLarge()))
        return packed(answers.instead(lost))
    return message


def unpacked(message: bytes, count: int) -> Answers:
    """The answers of a message, `count` of them.

    Raises:
        ValueError: it is not what `packed` makes. (Or another `Exception`: it is a stranger's.)
    """
    table = json.loads(message)
    solutions = [solution_of(row) for row in table["solutions"]]
    if len(solutions) != count:
        raise ValueError(f"expected {count} answers, found {len(solutions)}")
    return Answers(
        solutions,
        Relation[table["relation"]],
        loading_time=_seconds(table["loading_time"]),
        wall_time=_seconds(table["wall_time"]),
    )


def _packed(solution: Solution) -> Mapping[str, Any]:
    try:
        return packed_solution(solution)
    except Exception as error:
        return packed_solution(crash(f"{type(error).__name__}: {error}"))


def _seconds(value: Any) -> float:
    seconds = float(value)
    if not 0 <= seconds < inf:
        raise ValueError(f"{seconds} s is no time that anything took")
    return seconds
